"""Represent solutions of the inverse kinematics, mark them by joint limits, and sort them.

The module `inverse` computes the solutions, and `mark_and_sort` selects whole turns and the order.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.rotations import check_rows
from ssm_planner.typing import Array, Mask, record

FULL_TURN = 2.0 * math.pi
"""Angle of a full turn, rad."""
JOINT_DISTANCE_WEIGHTS = (1.0, 1.0, 1.0, 10.0)
"""Factors of the joint differences in the distance between two configurations.

A difference of 0.1 m in the insertion counts as much as 1 rad in a revolute joint.
"""


PER_SOLUTION_FIELDS = ("joints", "branch", "reaches", "in_limits")
"""Fields of `Solutions` that have an entry for each of the k solutions of n targets: (n, k, …)."""


@record
class Solutions:
    """Solutions of the inverse kinematics for n targets, with k solutions for each target."""

    joints: Array
    """Joints (n, k, 4) in rad and m."""
    branch: NDArray[np.int_]
    """Branch of each solution: the sign of sin(θ2 − δ) with `Mechanism.delta`, (n, k)."""
    reaches: Mask
    """True if the solution reaches the target itself and not only the nearest pose, (n, k)."""
    in_limits: Mask
    """True if the solution is within the joint limits, (n, k). True if no limits were given."""
    reachable: Mask
    """True if the target is in the workspace, (n,).

    For other targets, `joints` reach the nearest pose in the workspace.
    """
    orientation_error: Array
    """Angle between the requested and the reached tool axis, (n,), rad."""
    tip_error: Array
    """Distance between the requested and the reached tip position, (n,), m."""

    @property
    def valid(self) -> Mask:
        """True if the solution reaches its target within the joint limits, (n, k)."""
        return self.reaches & self.in_limits


def mark_and_sort(
    solutions: Solutions, limits: ArrayLike | None, reference: ArrayLike | None
) -> Solutions:
    """Mark the solutions within joint limits, and sort them by their distance to a reference.

    Parameters
    ----------
    solutions : Solutions
        Solutions of n targets.
    limits : (4, 2) array or None
        Smallest and largest joint positions (rad, and m for joint 4). None leaves `in_limits`
        unchanged.
    reference : (4,) or (n, 4) array or None
        Joint positions (rad, and m for joint 4). None leaves the order unchanged.

    Returns
    -------
    Solutions
        The same solutions, marked and sorted. Revolute joints may differ by whole turns.
    """
    if limits is not None:
        solutions = mark_within_limits(solutions, limits, reference)
    if reference is not None:
        solutions = sort_by_distance(solutions, reference, limits)
    return solutions


def mark_within_limits(
    solutions: Solutions, limits: ArrayLike, reference: ArrayLike | None = None
) -> Solutions:
    """Mark the solutions that are within joint limits.

    A revolute joint reaches the same pose at positions that differ by whole turns. If one of these
    positions is within the limits, the solution gets it. Among several, it gets the one nearest to
    the reference.

    Parameters
    ----------
    solutions : Solutions
        Solutions of n targets.
    limits : (4, 2) array
        Smallest and largest joint positions (rad, and m for joint 4).
    reference : (4,) or (n, 4) array, optional
        Joint positions (rad, and m for joint 4). The default is the middle of the limits.

    Returns
    -------
    Solutions
        The solutions with moved revolute joints and the new values of `in_limits`.

    Raises
    ------
    GeometryError
        If the limits or the reference are invalid.
    """
    bounds = check_joint_limits("limits", limits)
    joints = solutions.joints.copy()
    _shift_into_range(joints, _turn_centres(bounds, reference, len(joints)), bounds)
    is_within = np.all((joints >= bounds[:, 0] - 1e-12) & (joints <= bounds[:, 1] + 1e-12), axis=2)
    return replace(solutions, joints=joints, in_limits=is_within)


def sort_by_distance(
    solutions: Solutions, reference: ArrayLike, limits: ArrayLike | None = None
) -> Solutions:
    """Sort the solutions of each target by their distance to a reference, valid solutions first.

    Valid solutions reach their target within the joint limits. Before the comparison, revolute
    joints are moved by whole turns as close as possible to the reference. The distance is the
    Euclidean norm of the joint differences, each multiplied by its factor in
    `JOINT_DISTANCE_WEIGHTS`.

    Parameters
    ----------
    solutions : Solutions
        Solutions of n targets.
    reference : (4,) or (n, 4) array
        Joint positions (rad, and m for joint 4).
    limits : (4, 2) array, optional
        Smallest and largest joint positions (rad, and m for joint 4). Whole turns do not move a
        joint out of these limits.

    Returns
    -------
    Solutions
        The solutions with moved revolute joints in the new order.

    Raises
    ------
    GeometryError
        If the limits or the reference are invalid.
    """
    bounds = np.tile((-np.inf, np.inf), (4, 1))
    if limits is not None:
        bounds = check_joint_limits("limits", limits)
    joints = solutions.joints.copy()
    centres = _turn_centres(bounds, reference, len(joints))
    _shift_into_range(joints, centres, bounds)
    distance = np.linalg.norm((joints - centres) * JOINT_DISTANCE_WEIGHTS, axis=2)
    order = np.lexsort((distance, ~solutions.valid), axis=1)
    rows = np.arange(len(joints))[:, np.newaxis]
    return replace(
        solutions,
        joints=joints[rows, order],
        branch=solutions.branch[rows, order],
        reaches=solutions.reaches[rows, order],
        in_limits=solutions.in_limits[rows, order],
    )


def check_joint_limits(name: str, value: ArrayLike) -> Array:
    """Check joint limits, and return them as an array.

    Parameters
    ----------
    name : str
        Name of the argument. The error message contains it.
    value : (4, 2) array-like
        Smallest and largest position of each joint (rad, and m for joint 4). Joints without limits
        have infinite ones.

    Returns
    -------
    (4, 2) array
        The same limits.

    Raises
    ------
    GeometryError
        If the shape is wrong, a value is NaN, a lower limit is above the upper one, or a limit of a
        revolute joint is more than four turns from zero, which suggests degrees.
    """
    limits = np.asarray(value, dtype=float)
    if limits.shape != (4, 2):
        hint = f"; it looks transposed: pass {name}.T" if limits.shape == (2, 4) else ""
        raise GeometryError(
            f"{name} has shape {limits.shape}: must be (4, 2), lower and upper of each joint{hint}"
        )
    if np.isnan(limits).any() or np.any(limits[:, 0] > limits[:, 1]):
        row = int(np.flatnonzero(~(limits[:, 0] <= limits[:, 1]))[0])
        raise GeometryError(
            f"{name}[{row}] = {limits[row].tolist()}, of shape (4, 2): lower must not exceed upper"
        )
    revolute = np.where(np.isfinite(limits[:3]), np.abs(limits[:3]), 0.0)
    if np.any(revolute > 4.0 * FULL_TURN):
        row = int(np.argmax(revolute.max(axis=1)))
        raise GeometryError(
            f"{name}[{row}] = {limits[row].tolist()}, of shape (4, 2): more than four turns from "
            "zero; revolute joints are in radians, not degrees (a joint without limits: infinity)"
        )
    return limits


def nearest_turn(angle: Array, centre: ArrayLike) -> Array:
    """Shift angles by whole turns into the interval (centre − π, centre + π].

    Parameters
    ----------
    angle : (...) array
        Angles (rad).
    centre : (...) array
        Centres of the intervals (rad), in a shape that broadcasts with that of `angle`.

    Returns
    -------
    (...) array
        Shifted angles (rad).
    """
    return angle - FULL_TURN * np.ceil((angle - np.asarray(centre)) / FULL_TURN - 0.5)


def _turn_centres(bounds: Array, reference: ArrayLike | None, count: int) -> Array:
    """Return the joint positions near which whole turns shall place each joint.

    They are the reference or, without one, the middle of the limits. A joint with only one finite
    limit has this limit as its centre, and a joint without limits has 0.

    Parameters
    ----------
    bounds : (4, 2) array
        Smallest and largest joint positions (rad, and m for joint 4).
    reference : (4,) or (n, 4) array or None
        Joint positions (rad, and m for joint 4).
    count : int
        Number n of targets.

    Returns
    -------
    (1, 1, 4) or (n, 1, 4) array
        Centres (rad and m) for all targets or for each target. The second axis broadcasts over the
        solutions of a target.

    Raises
    ------
    GeometryError
        If the shape of the reference is wrong, or one of its values is not finite.
    """
    if reference is None:
        low, high = bounds.T
        low_or_high = np.where(np.isfinite(low), low, high)
        high_or_low = np.where(np.isfinite(high), high, low)
        middle = np.where(np.isfinite(low_or_high), (low_or_high + high_or_low) / 2.0, 0.0)
        return middle[np.newaxis, np.newaxis]
    centres = check_rows("reference", reference, 4)
    if len(centres) not in (1, count):
        raise GeometryError(
            f"reference has shape {centres.shape}: must be (4,) or ({count}, 4), one for each "
            "target"
        )
    return centres[:, np.newaxis]


def _shift_into_range(joints: Array, centres: Array, bounds: Array) -> None:
    """Move revolute joints by whole turns as close as possible to given positions, in place.

    If this position of a joint is outside the bounds, the joint moves on by the fewest whole turns
    that bring it inside. If no number of whole turns does, the position next to the centre remains.

    Parameters
    ----------
    joints : (n, k, 4) array
        Joint positions (rad, and m for joint 4) of k solutions for each of n targets. The function
        changes them.
    centres : (1, 1, 4) or (n, 1, 4) array
        Positions of `_turn_centres` (rad, and m for joint 4).
    bounds : (4, 2) array
        Smallest and largest joint positions (rad, and m for joint 4).
    """
    for i in range(3):
        angle = nearest_turn(joints[..., i], centres[..., i])
        low, high = bounds[i]
        raised_angle = angle + FULL_TURN * np.ceil(np.maximum(low - angle, 0.0) / FULL_TURN)
        lowered_angle = angle - FULL_TURN * np.ceil(np.maximum(angle - high, 0.0) / FULL_TURN)
        shifted = np.where(angle < low, raised_angle, np.where(angle > high, lowered_angle, angle))
        joints[..., i] = np.where((shifted >= low) & (shifted <= high), shifted, angle)
