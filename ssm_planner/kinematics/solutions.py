"""Solutions of inverse kinematics: which are within joint limits, which is nearest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.rotations import batch
from ssm_planner.typing import Array

Flags = NDArray[np.bool_]

TURN = 2.0 * math.pi
WEIGHTS = (1.0, 1.0, 1.0, 10.0)
"""Distance of two configurations: 0.1 m of insertion counts as 1 rad of a revolute joint."""


OF_EACH = ("joints", "branch", "reaches", "in_limits")
"""Fields of Solutions with an entry for every solution of a target."""


@dataclass(frozen=True, eq=False)
class Solutions:
    """All solutions for n targets, k for each."""

    joints: Array
    """(n, k, 4), rad and m."""
    branch: NDArray[np.int_]
    """(n, k): sign of sin(θ2 − δ) of each solution."""
    reaches: Flags
    """(n, k): the solution reaches its target, not only the nearest pose to it."""
    in_limits: Flags
    """(n, k): the solution is within the joint limits that were given; True where none were."""
    reachable: Flags
    """(n,): the target is in the workspace; where it is not, `joints` reach the nearest that is."""
    orientation_error: Array
    """(n,): angle between the tool axes asked for and reached, rad."""
    tip_error: Array
    """(n,): distance between the tip positions asked for and reached, m."""

    @property
    def valid(self) -> Flags:
        """(n, k): reaches the target within the limits."""
        return self.reaches & self.in_limits


def select(
    solutions: Solutions, limits: ArrayLike | None, reference: ArrayLike | None
) -> Solutions:
    """Solutions marked by joint limits (4, 2) and ordered by distance to a reference (..., 4), where these are given."""
    if limits is not None:
        solutions = within_limits(solutions, limits, reference)
    if reference is not None:
        solutions = by_distance(solutions, reference, limits)
    return solutions


def within_limits(
    solutions: Solutions, limits: ArrayLike, reference: ArrayLike | None = None
) -> Solutions:
    """The same solutions marked by limits (4, 2), rad and m.

    Revolute joints are moved by whole turns into their limits, next to `reference` (4,) or (n, 4) or else to the
    middle.
    """
    bounds = joint_limits("limits", limits)
    joints = solutions.joints.copy()
    _place(joints, _centres(bounds, reference, len(joints)), bounds)
    inside = np.all((joints >= bounds[:, 0] - 1e-12) & (joints <= bounds[:, 1] + 1e-12), axis=2)
    return replace(solutions, joints=joints, in_limits=inside)


def by_distance(
    solutions: Solutions, reference: ArrayLike, limits: ArrayLike | None = None
) -> Solutions:
    """The same solutions, valid ones first, each group in order of distance to `reference` (4,) or (n, 4).

    Revolute joints are moved by whole turns next to the reference, within `limits` if given.
    """
    bounds = (
        np.tile((-np.inf, np.inf), (4, 1)) if limits is None else joint_limits("limits", limits)
    )
    joints = solutions.joints.copy()
    centres = _centres(bounds, reference, len(joints))
    _place(joints, centres, bounds)
    distance = np.linalg.norm((joints - centres) * WEIGHTS, axis=2)
    order = np.lexsort((distance, ~solutions.valid), axis=1)
    of_row = np.arange(len(joints))[:, np.newaxis]
    moved = replace(solutions, joints=joints)
    return replace(moved, **{name: getattr(moved, name)[of_row, order] for name in OF_EACH})


def joint_limits(name: str, value: ArrayLike) -> Array:
    """Limits (4, 2), lower and upper, checked; infinite where a joint has none."""
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
    if np.any(revolute > 4.0 * TURN):
        row = int(np.argmax(revolute.max(axis=1)))
        raise GeometryError(
            f"{name}[{row}] = {limits[row].tolist()}, of shape (4, 2): more than four turns from zero; revolute joints"
            " are in radians, not degrees (a joint without limits: infinity)"
        )
    return limits


def nearest_turn(angle: Array, centre: ArrayLike) -> Array:
    """The 2π-equivalent of each angle in (centre − π, centre + π]; broadcast shape of both, rad."""
    moved: Array = angle - TURN * np.ceil((angle - np.asarray(centre)) / TURN - 0.5)
    return moved


def _centres(bounds: Array, reference: ArrayLike | None, count: int) -> Array:
    """Where to look for 2π-equivalents, (n or 1, 1, 4)."""
    if reference is None:
        low, high = bounds.T
        low, high = np.where(np.isfinite(low), low, high), np.where(np.isfinite(high), high, low)
        return np.where(np.isfinite(low), (low + high) / 2.0, 0.0)[np.newaxis, np.newaxis]
    centres = batch("reference", reference, 4)
    if len(centres) not in (1, count):
        raise GeometryError(
            f"reference has shape {centres.shape}: must be (4,) or ({count}, 4), one for each target"
        )
    return centres[:, np.newaxis]


def _place(joints: Array, centres: Array, bounds: Array) -> None:
    """Move revolute joints by whole turns next to their centres, and then into the bounds if turns can do it."""
    for i in range(3):
        angle = nearest_turn(joints[..., i], centres[..., i])
        low, high = bounds[i]
        raised = angle + TURN * np.ceil(np.maximum(low - angle, 0.0) / TURN)
        lowered = angle - TURN * np.ceil(np.maximum(angle - high, 0.0) / TURN)
        moved = np.where(angle < low, raised, np.where(angle > high, lowered, angle))
        joints[..., i] = np.where((moved >= low) & (moved <= high), moved, angle)
