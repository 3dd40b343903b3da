"""Inverse kinematics in closed form, every branch, in batch (paper, §II-C).

Subproblem 3′ gives θ4, Subproblem 2 gives θ1 and θ2, Subproblem 1 gives θ3: subproblems.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssm_planner.errors import GeometryError
from ssm_planner.model import arguments
from ssm_planner.model.arguments import batch
from ssm_planner.model.closed_form import joints_of_task
from ssm_planner.model.forward import blocks
from ssm_planner.model.inverse_block import BRANCHES, are_rotations, solve_block
from ssm_planner.model.mechanism import PARALLEL, Mechanism
from ssm_planner.model.namespace import NUMPY
from ssm_planner.model.solutions import Solutions, select
from ssm_planner.model.subproblems import subproblem_3_prime
from ssm_planner.model.task import task_batch, task_from_joints
from ssm_planner.model.workspace import tilt_magnitudes

Array = NDArray[np.float64]

TOLERANCE = 1e-7
"""Error, rad and m, up to which a target counts as reached."""
BLOCK = 3072
"""Targets per block: temporaries stay in the cache, and the matrix product is too small for BLAS to start threads."""


def inverse(
    mechanism: Mechanism,
    rotations: ArrayLike,
    positions: ArrayLike,
    *,
    limits: ArrayLike | None = None,
    reference: ArrayLike | None = None,
) -> Solutions:
    """Joints of tool poses R (n, 3, 3) and p (n, 3) on both branches.

    Of the two θ4 = ±|p| of Subproblem 3′ the orientation takes one. Where p is off the tool axis R e_z, which no joints
    can reach, the pointing v is taken that minimises |p − θ4 v|² + LEVER² |v − R e_z|² for θ4 = pᵀR e_z, and then
    θ4 = pᵀv. At depth 0 this is the orientation alone. A pointing outside the workspace is moved to the boundary at its
    own roll, the nearest that Subproblem 2 reaches.
    With `limits` (4, 2) solutions are marked, with `reference` (4,) or (n, 4) ordered: see solutions.py.
    Raises GeometryError for shapes, NaN and matrices that are not rotations.
    """
    _refuse_parallel(mechanism)
    matrix = arguments.matrices("rotations", rotations)
    p = batch("positions", positions, 3)
    if len(p) != len(matrix):
        raise GeometryError(f"rotations of shape {matrix.shape} and positions of shape {p.shape}: not of one length")
    n = len(p)
    joints, orientation_error, tip_error = np.empty((n, 2, 4)), np.empty(n), np.empty(n)
    to_frame = np.einsum("ik,cj->jkic", mechanism.frame, _spin(-mechanism.tool_angle)).reshape(9, 9)
    flat = matrix.reshape(n, 9)
    for block in blocks(n, BLOCK):
        columns = to_frame @ flat[block].T
        if not are_rotations(columns):
            arguments.rotations("rotations", matrix)
        out = joints[block], orientation_error[block], tip_error[block]
        solve_block(mechanism, columns[0:3], columns[6:9], mechanism.frame.T @ p[block].T, *out)
    return _solutions(joints, orientation_error, tip_error, limits, reference)


def inverse_task(
    mechanism: Mechanism, task: ArrayLike, *, limits: ArrayLike | None = None, reference: ArrayLike | None = None
) -> Solutions:
    """Joints of (roll, tilt, spin, depth) (n, 4) on both branches; tilt of either sign.

    Roll and spin are taken as given: θ1 and θ3 are continuous in them. A tilt outside the workspace is moved to its
    nearest end. `limits` and `reference` as for `inverse`.
    """
    _refuse_parallel(mechanism)
    task = task_batch("task", task)
    n = len(task)
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    joints, orientation_error, tip_error = np.empty((n, 2, 4)), np.empty(n), np.empty(n)
    for block in blocks(n, BLOCK):
        roll, tilt, spin, depth = task[block].T
        inside = np.clip(np.abs(tilt), low, high)
        error = np.abs(np.abs(tilt) - inside)
        nearest = roll, np.copysign(inside, tilt), spin, depth * np.cos(error)
        for k, branch in enumerate(BRANCHES):
            for i, angle in enumerate(joints_of_task(NUMPY, mechanism, nearest, branch)):
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
    """Joints of tip positions (n, 3) with spin (n,): up to four solutions.

    Subproblem 3′ gives two translations θ4 (tool through the RCM to the tip, or from the tip's side), each with two
    branches; k counts (depth > 0, +1), (depth > 0, −1), (depth < 0, +1), (depth < 0, −1). A tip at the RCM gives no
    pointing: then the tool keeps that of `reference`, or of home, and the second pair does not count.
    """
    tip = batch("tip", tip, 3)
    spins = np.asarray(spin, dtype=float)
    arguments.finite("spin", spins)
    if spins.shape not in ((), (len(tip),)):
        raise GeometryError(f"spin has shape {spins.shape}: must be ({len(tip)},), one for each tip")
    spins = np.broadcast_to(spins, len(tip))
    zero = np.zeros(3)
    theta4, _ = subproblem_3_prime(mechanism.omega3, zero, zero, np.linalg.norm(tip, axis=1))
    at_rcm = np.abs(theta4[:, 0]) <= TOLERANCE
    pair = []
    for depth in np.sort(mechanism.insertion_sign * theta4, axis=1)[:, ::-1].T:
        task = np.column_stack((*_pointing(mechanism, tip, depth, at_rcm, reference), spins, depth))
        pair.append(inverse_task(mechanism, task))
    pair[1].reaches[at_rcm] = False
    found = Solutions(
        joints=np.concatenate([each.joints for each in pair], axis=1),
        branch=np.concatenate([each.branch for each in pair], axis=1),
        reaches=np.concatenate([each.reaches for each in pair], axis=1),
        in_limits=np.concatenate([each.in_limits for each in pair], axis=1),
        reachable=pair[0].reachable | pair[1].reachable,
        orientation_error=np.minimum(pair[0].orientation_error, pair[1].orientation_error),
        tip_error=np.minimum(pair[0].tip_error, pair[1].tip_error),
    )
    return select(found, limits, reference)


def _solutions(
    joints: Array, orientation_error: Array, tip_error: Array, limits: ArrayLike | None, reference: ArrayLike | None
) -> Solutions:
    reachable = (orientation_error <= TOLERANCE) & (tip_error <= TOLERANCE)
    shape = joints.shape[:2]
    found = Solutions(
        joints=joints,
        branch=np.broadcast_to(BRANCHES, shape),
        reaches=np.repeat(reachable[:, np.newaxis], 2, axis=1),
        in_limits=np.broadcast_to(True, shape),
        reachable=reachable,
        orientation_error=orientation_error,
        tip_error=tip_error,
    )
    return select(found, limits, reference)


def _pointing(
    mech: Mechanism, tip: Array, depth: Array, at_rcm: NDArray[np.bool_], reference: ArrayLike | None
) -> tuple[Array, Array]:
    """Roll and tilt of the tool whose tip is at the given depth, at the RCM those of the reference or of home."""
    u = mech.frame.T @ (tip * np.where(depth * mech.insertion_sign < 0.0, -1.0, 1.0)[:, np.newaxis]).T
    around = np.hypot(u[1], u[2])
    roll = np.where(around > 0.0, np.arctan2(mech.side * u[1], -mech.side * u[2]), 0.0)
    tilt = mech.side * np.arctan2(around, u[0])
    kept = np.array([[mech.home_roll, mech.home_tilt, 0.0, 0.0]])
    if reference is not None and at_rcm.any():
        kept = task_from_joints(mech, reference)
    return np.where(at_rcm, kept[:, 0], roll), np.where(at_rcm, kept[:, 1], tilt)


def _refuse_parallel(mech: Mechanism) -> None:
    for name, angle, joints in (("alpha", mech.alpha, "1 and 2"), ("beta", mech.beta, "2 and 3")):
        if math.sin(angle) < PARALLEL:
            raise GeometryError(
                f"{name} = {angle:.6g} rad: joints {joints} turn about one axis, their angles are not unique"
            )


def _spin(angle: float) -> Array:
    """Rz."""
    return np.array(
        [[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
