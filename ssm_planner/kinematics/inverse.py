"""Solve the inverse kinematics in closed form on every branch, for batches of targets.

Targets are task coordinates or tip positions. The closed forms of Paden–Kahan subproblems 2 and 1,
which give θ1 to θ3, are in `task.joints_of_task`. The depth gives θ4 (subproblem 3′).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen import NUMPY
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.mechanism import PARALLEL, Mechanism
from ssm_planner.kinematics.rotations import batch, finite
from ssm_planner.kinematics.solutions import OF_EACH, Solutions, select
from ssm_planner.kinematics.task import joints_of_task, roll_and_tilt, task_batch, task_from_joints
from ssm_planner.kinematics.workspace import tilt_magnitudes
from ssm_planner.trajectory import blocks
from ssm_planner.typing import Array, Mask

BRANCHES = (1, -1)
TOLERANCE = 1e-7
"""Largest error of a solution that reaches its target, rad and m."""
BLOCK = 3072
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
    """Return the joints of task coordinates (roll, tilt, spin, depth) (n, 4) on both branches.

    The tilt may have either sign. Roll and spin are not wrapped, so θ1 and θ3 are continuous in
    them. A tilt outside the workspace is moved to the nearer end. The arguments `limits` and
    `reference` have the same meaning as in `inverse_tip`.
    """
    _refuse_parallel(mechanism)
    task = task_batch("task", task)
    n = len(task)
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    joints = np.empty((n, 2, 4))
    orientation_error = np.empty(n)
    tip_error = np.empty(n)
    for block in blocks(n, BLOCK):
        roll, tilt, spin, depth = task[block].T
        clipped = np.clip(np.abs(tilt), low, high)
        error = np.abs(np.abs(tilt) - clipped)
        closest = roll, np.copysign(clipped, tilt), spin, depth * np.cos(error)
        for k, branch in enumerate(BRANCHES):
            for i, angle in enumerate(joints_of_task(NUMPY, mechanism, closest, branch)):
                joints[block, k, i] = angle
        orientation_error[block] = error
        tip_error[block] = np.abs(depth * np.sin(error))
    return _solutions(joints, orientation_error, tip_error, limits, reference)


def inverse_tip(
    mechanism: Mechanism,
    tip: ArrayLike,
    spin: ArrayLike = 0.0,
    *,
    limits: ArrayLike | None = None,
    reference: ArrayLike | None = None,
) -> Solutions:
    """Return up to four solutions for each tip position (n, 3) in m with spin (n,) in rad.

    The distance of the tip from the RCM has two depths as solutions (subproblem 3′ of the paper),
    and each depth has two branches of the inverse kinematics, +1 and −1. The order of the solutions
    is (depth > 0, +1), (depth > 0, −1), (depth < 0, +1), (depth < 0, −1). A tip at the RCM does not
    determine the direction of the tool. The tool then has the direction of `reference`, or of home
    without a reference, and the two solutions with depth < 0 do not count as reaching the tip.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    tip : (n, 3)
        Tip positions in the base frame, m.
    spin : float or (n,)
        Rotation of the tool about its axis, rad.
    limits : (4, 2), optional
        Lowest and highest joint positions, rad and m.
    reference : (4,), optional
        Joint positions. The solutions are sorted by their distance to it.
    """
    tip = batch("tip", tip, 3)
    spins = np.asarray(spin, dtype=float)
    finite("spin", spins)
    if spins.shape not in ((), (len(tip),)):
        raise GeometryError(
            f"spin has shape {spins.shape}: must be ({len(tip)},), one for each tip"
        )
    spins = np.broadcast_to(spins, len(tip))
    distance = np.linalg.norm(tip, axis=1)
    at_rcm = distance <= TOLERANCE
    pair = []
    for depth in (distance, -distance):
        task = np.column_stack((*_pointing(mechanism, tip, depth, at_rcm, reference), spins, depth))
        pair.append(inverse_task(mechanism, task))
    pair[1].reaches[at_rcm] = False
    of_all = {
        name: np.concatenate([getattr(half, name) for half in pair], axis=1) for name in OF_EACH
    }
    result = Solutions(
        **of_all,
        reachable=pair[0].reachable | pair[1].reachable,
        orientation_error=np.minimum(pair[0].orientation_error, pair[1].orientation_error),
        tip_error=np.minimum(pair[0].tip_error, pair[1].tip_error),
    )
    return select(result, limits, reference)


def _solutions(
    joints: Array,
    orientation_error: Array,
    tip_error: Array,
    limits: ArrayLike | None,
    reference: ArrayLike | None,
) -> Solutions:
    """Return the joints (n, 2, 4) of both branches as solutions, marked by limits and sorted."""
    reachable = (orientation_error <= TOLERANCE) & (tip_error <= TOLERANCE)
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
    return select(result, limits, reference)


def _pointing(
    mech: Mechanism,
    tip: Array,
    depth: Array,
    at_rcm: Mask,
    reference: ArrayLike | None,
) -> tuple[Array, Array]:
    """Return roll and tilt of the tool for tip positions at given depths.

    At the RCM, they are those of the reference or, without one, those of home.
    """
    u = (
        mech.frame.T
        @ (tip * np.where(depth * mech.insertion_sign < 0.0, -1.0, 1.0)[:, np.newaxis]).T
    )
    around = np.hypot(u[1], u[2])
    roll, tilt = roll_and_tilt(NUMPY, mech, u, around)
    roll = np.where(around > 0.0, roll, 0.0)
    reference_task = np.array([[mech.home_roll, mech.home_tilt, 0.0, 0.0]])
    if reference is not None and at_rcm.any():
        reference_task = task_from_joints(mech, reference)
    return np.where(at_rcm, reference_task[:, 0], roll), np.where(
        at_rcm, reference_task[:, 1], tilt
    )


def _refuse_parallel(mech: Mechanism) -> None:
    """Raise GeometryError if two adjacent axes are parallel."""
    for name, angle, joints in (("alpha", mech.alpha, "1 and 2"), ("beta", mech.beta, "2 and 3")):
        if math.sin(angle) < PARALLEL:
            raise GeometryError(
                f"{name} = {angle:.6g} rad: joints {joints} turn about one axis, their angles are "
                "not unique"
            )
