"""Solve the inverse kinematics in closed form on both branches, for many targets at once.

A target is either a point in task coordinates (`inverse_task`) or a tip position (`inverse_tip`). A
branch, +1 or −1, is one of the two joint solutions for a tilt, which differ in the sign of sin(θ2 −
δ). The function `joints_of_task` contains the closed forms. Those for θ1 to θ3 solve the
subproblems 2 and 1 of Paden and Kahan. The depth gives θ4 (subproblem 3′ of the paper).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen import NUMPY
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.mechanism import PARALLEL_AXES_SINE, Mechanism, tilt_magnitudes
from ssm_planner.kinematics.rotations import check_finite, check_rows
from ssm_planner.kinematics.solutions import PER_SOLUTION_FIELDS, Solutions, mark_and_sort
from ssm_planner.kinematics.task import check_task, joints_of_task, roll_and_tilt, task_from_joints
from ssm_planner.trajectory import blocks
from ssm_planner.typing import Array, Mask

BRANCHES = (1, -1)
"""Branches of the inverse kinematics, in the order of the solutions."""
REACH_TOLERANCE = 1e-7
"""Largest error of a solution that reaches its target, rad and m."""
TARGETS_PER_BLOCK = 3072
"""Number of targets per block.

Temporary arrays then stay in the cache, and BLAS starts no threads.
"""


def inverse_task(
    mechanism: Mechanism,
    task: ArrayLike,
    *,
    limits: ArrayLike | None = None,
    reference: ArrayLike | None = None,
) -> Solutions:
    """Compute the joint positions for task coordinates on both branches.

    A tilt outside the workspace is replaced by the nearest tilt inside, and the depth by its
    projection on the reached tool axis. With the angle ε between the requested and the reached tool
    axis, the depth becomes depth · cos ε, and the tip misses its target by |depth · sin ε|.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    task : (n, 4) array
        Roll, tilt and spin (rad), and depth (m). The tilt may have either sign. Roll and spin are
        not reduced to one turn, so without limits and reference, θ1 and θ3 are continuous in them.
    limits : (4, 2) array, optional
        Smallest and largest joint positions (rad, and m for joint 4).
    reference : (4,) or (n, 4) array, optional
        Joint positions (rad, and m for joint 4). The solutions are sorted by their distance to it.

    Returns
    -------
    Solutions
        Two solutions for each target. The errors are zero for targets in the workspace.

    Raises
    ------
    GeometryError
        If two adjacent axes are parallel, or a target is not finite or has a tilt outside [−π, π].
    """
    _check_axes_not_parallel(mechanism)
    task = check_task("task", task)
    n = len(task)
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    joints = np.empty((n, 2, 4))
    orientation_error = np.empty(n)
    tip_error = np.empty(n)
    for block in blocks(n, TARGETS_PER_BLOCK):
        roll, tilt, spin, depth = task[block].T
        clipped = np.clip(np.abs(tilt), low, high)
        error = np.abs(np.abs(tilt) - clipped)
        nearest_task = roll, np.copysign(clipped, tilt), spin, depth * np.cos(error)
        for k, branch in enumerate(BRANCHES):
            for i, angle in enumerate(joints_of_task(NUMPY, mechanism, nearest_task, branch)):
                joints[block, k, i] = angle
        orientation_error[block] = error
        tip_error[block] = np.abs(depth * np.sin(error))
    return _select_solutions(joints, orientation_error, tip_error, limits, reference)


def inverse_tip(
    mechanism: Mechanism,
    tip: ArrayLike,
    spin: ArrayLike = 0.0,
    *,
    limits: ArrayLike | None = None,
    reference: ArrayLike | None = None,
) -> Solutions:
    """Compute up to four joint solutions for each tip position.

    The tool can reach a tip from both sides of the remote centre of motion (RCM), with the depths
    +d and −d, where d is the distance of the tip from the RCM (subproblem 3′ of the paper). Each
    depth has two branches. Without a reference, the solutions of a tip have the order (depth > 0,
    branch +1), (depth > 0, −1), (depth < 0, +1), (depth < 0, −1).

    A tip at the RCM does not determine the direction of the tool. The tool then has the direction
    that it has at `reference`, or at q = 0 without a reference. Both depths are then zero up to
    `REACH_TOLERANCE`, so the solutions of the second depth repeat those of the first. They are
    marked as not reaching the tip.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    tip : (n, 3) array
        Tip positions in the base frame (m).
    spin : float or (n,) array
        Rotation of the tool about its axis (rad).
    limits : (4, 2) array, optional
        Smallest and largest joint positions (rad, and m for joint 4).
    reference : (4,) or (n, 4) array, optional
        Joint positions (rad, and m for joint 4). The solutions are sorted by their distance to it.

    Returns
    -------
    Solutions
        Four solutions for each tip. A tip is reachable if one of its depths is.

    Raises
    ------
    GeometryError
        If a shape is wrong, a value is not finite, or two adjacent axes are parallel.
    """
    tip = check_rows("tip", tip, 3)
    spins = np.asarray(spin, dtype=float)
    check_finite("spin", spins)
    if spins.shape not in ((), (len(tip),)):
        raise GeometryError(
            f"spin has shape {spins.shape}: must be ({len(tip)},), one for each tip"
        )
    spins = np.broadcast_to(spins, len(tip))
    distance = np.linalg.norm(tip, axis=1)
    at_rcm = distance <= REACH_TOLERANCE
    solutions_of_depth = []
    for depth in (distance, -distance):
        roll, tilt = _roll_and_tilt_of_tips(mechanism, tip, depth, at_rcm, reference)
        task = np.column_stack((roll, tilt, spins, depth))
        solutions_of_depth.append(inverse_task(mechanism, task))
    deep, opposite = solutions_of_depth
    opposite.reaches[at_rcm] = False
    fields = {}
    for name in PER_SOLUTION_FIELDS:
        fields[name] = np.concatenate([getattr(deep, name), getattr(opposite, name)], axis=1)
    result = Solutions(
        **fields,
        reachable=deep.reachable | opposite.reachable,
        orientation_error=np.minimum(deep.orientation_error, opposite.orientation_error),
        tip_error=np.minimum(deep.tip_error, opposite.tip_error),
    )
    return mark_and_sort(result, limits, reference)


def _select_solutions(
    joints: Array,
    orientation_error: Array,
    tip_error: Array,
    limits: ArrayLike | None,
    reference: ArrayLike | None,
) -> Solutions:
    """Combine the joints of both branches to solutions, mark those within limits, and sort them.

    A target counts as reachable if neither error exceeds `REACH_TOLERANCE`.

    Parameters
    ----------
    joints : (n, 2, 4) array
        Joint positions (rad, and m for joint 4). The second axis has the order of `BRANCHES`.
    orientation_error : (n,) array
        Angles between the requested and the reached tool axes (rad).
    tip_error : (n,) array
        Distances between the requested and the reached tip positions (m).
    limits : (4, 2) array or None
        Smallest and largest joint positions (rad, and m for joint 4).
    reference : (4,) or (n, 4) array or None
        Joint positions (rad, and m for joint 4), see `inverse_task`.

    Returns
    -------
    Solutions
        Two solutions for each of the n targets.
    """
    reachable = (orientation_error <= REACH_TOLERANCE) & (tip_error <= REACH_TOLERANCE)
    shape = joints.shape[:2]
    result = Solutions(
        joints,
        branch=np.broadcast_to(BRANCHES, shape),
        reaches=np.repeat(reachable[:, np.newaxis], 2, axis=1),
        in_limits=np.broadcast_to(True, shape),
        reachable=reachable,
        orientation_error=orientation_error,
        tip_error=tip_error,
    )
    return mark_and_sort(result, limits, reference)


def _roll_and_tilt_of_tips(
    mech: Mechanism, tip: Array, depth: Array, at_rcm: Mask, reference: ArrayLike | None
) -> tuple[Array, Array]:
    """Compute the roll and the tilt with which the tool reaches tip positions.

    The tool axis points to the tip if `depth · insertion_sign` is positive, and away from the tip
    if it is negative. A tip on the axis ω1 does not determine the roll, which is then 0.

    Parameters
    ----------
    mech : Mechanism
        Axes and tool frame.
    tip : (n, 3) array
        Tip positions in the base frame (m).
    depth : (n,) array
        Signed depth of each tip (m).
    at_rcm : (n,) mask
        True for tips at the RCM. They get the roll and the tilt of `reference` or, without one, of
        q = 0.
    reference : (4,) or (n, 4) array, optional
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    roll, tilt : (n,) array
        Roll and tilt (rad). The tilt has the sign of the home tilt.
    """
    # The tool axis points to the tip, or away from it if the insertion is negative.
    sign = np.where(depth * mech.insertion_sign < 0.0, -1.0, 1.0)
    direction = mech.frame.T @ (tip * sign[:, np.newaxis]).T
    lateral = np.hypot(direction[1], direction[2])
    roll, tilt = roll_and_tilt(NUMPY, mech, direction, lateral)
    roll = np.where(lateral > 0.0, roll, 0.0)
    reference_task = np.array([[mech.home_roll, mech.home_tilt, 0.0, 0.0]])
    if reference is not None and at_rcm.any():
        reference_task = task_from_joints(mech, reference)
    roll = np.where(at_rcm, reference_task[:, 0], roll)
    tilt = np.where(at_rcm, reference_task[:, 1], tilt)
    return roll, tilt


def _check_axes_not_parallel(mech: Mechanism) -> None:
    """Raise an error if two adjacent axes are parallel, so that the joint angles are not unique.

    Parameters
    ----------
    mech : Mechanism
        Mechanism with the angles α and β between adjacent axes.

    Raises
    ------
    GeometryError
        If sin α or sin β is below `PARALLEL_AXES_SINE`.
    """
    for name, angle, joints in (("alpha", mech.alpha, "1 and 2"), ("beta", mech.beta, "2 and 3")):
        if math.sin(angle) < PARALLEL_AXES_SINE:
            raise GeometryError(
                f"{name} = {angle:.6g} rad: joints {joints} turn about one axis, their angles are "
                "not unique"
            )
