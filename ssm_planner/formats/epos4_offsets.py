"""Velocity and torque offsets of EPOS4 streams, held against what their target positions ask for."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ssm_planner.dynamics.motors import motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.problem.limits import FeedForward, MotorTorque
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import LimitCheck

NEAR = 2
"""Intervals on either side of a setpoint whose accelerations it may have."""
AT_REST = ((1.0, True), (-1.0, False), (-1.0, True), (0.0, False))
"""Direction and breaking away of a joint that may stand, beside moving on."""
FULL = 0.02
"""s: of a period this long or longer an acceleration may come and go between two setpoints."""


@dataclass(frozen=True, eq=False)
class Offsets:
    """What a stream says of one joint beside its positions, at n setpoints, on the joint's side."""

    velocity: Array
    """(n,), rad/s or m/s."""
    torque: Array
    """(n,), N·m at the motor, in the direction of the joint."""
    velocity_rounding: float
    torque_rounding: float


def offset_checks(
    robot: Robot, t: Array, q: Array, resolution: Array, offsets: dict[int, Offsets]
) -> list[LimitCheck]:
    """Offsets of the joints (by index) against positions q (n, 4) with a rounding of `resolution` (4,), rad or m.

    Between two setpoints the velocity changes by no more than the acceleration limit allows; torques follow from the
    motor law with any acceleration that is near. The motors' largest torques are limits too.
    """
    slopes = np.diff(q, axis=0) / np.diff(t)[:, None]
    qd = np.gradient(q, t, axis=0) if len(t) > 1 else np.zeros_like(q)
    for i, offset in offsets.items():
        qd[:, i] = offset.velocity
    checks = []
    for i, offset in offsets.items():
        joint = robot.joints[i]
        checks.append(
            _velocity_check(joint, t, slopes[:, i], offset, rounding=float(resolution[i]))
        )
    low, high = _torque_range(robot, t, q, qd, offsets)
    for i, offset in offsets.items():
        joint = robot.joints[i]
        beyond = np.maximum(offset.torque - high[:, i], low[:, i] - offset.torque)
        k = int(np.argmax(beyond))
        allowed = 2 * offset.torque_rounding + 1e-3 * float(np.abs(high[:, i]).max())
        limit = FeedForward(joint.name, allowed, of_torque=True)
        checks.append(LimitCheck.of(limit, max(float(beyond[k]), 0.0), float(t[k])))
        torque = np.maximum(np.abs(offset.torque) - offset.torque_rounding, 0.0)
        k = int(np.argmax(torque))
        checks.append(LimitCheck.of(joint.limit(MotorTorque), float(torque[k]), float(t[k])))
    return checks


def _velocity_check(
    joint: Joint, t: Array, slope: Array, offset: Offsets, rounding: float
) -> LimitCheck:
    """|q̇(t) − mean of q̇ over an adjacent interval| ≤ q̈_max h / 2."""
    h = np.diff(t)
    allowed = joint.acceleration * (1 + 1e-6) * h / 2 + 2 * rounding / h + offset.velocity_rounding
    beyond = (
        np.maximum(np.abs(offset.velocity[1:] - slope), np.abs(offset.velocity[:-1] - slope))
        / allowed
    )
    k = int(np.argmax(beyond))
    limit = FeedForward(joint.name, float(allowed[k]), prismatic=joint.kind == "prismatic")
    return LimitCheck.of(limit, float(beyond[k] * allowed[k]), float(t[k]))


def _torque_range(
    robot: Robot, t: Array, q: Array, qd: Array, offsets: dict[int, Offsets]
) -> tuple[Array, Array]:
    """(lowest, highest) motor torque (n, 4) with any acceleration that is near a setpoint and either friction at rest."""
    lowest, highest = _accelerations(robot, t, qd, offsets)
    body = RigidBody.from_robot(robot)
    rest = np.array([_slow(robot, i, offsets) for i in range(4)])
    low, high = np.full(q.shape, np.inf), np.full(q.shape, -np.inf)
    standing = np.abs(qd) <= rest
    some = np.flatnonzero(standing.any(axis=1))
    every = np.arange(len(t))
    # the torque of a motor rises or falls throughout with each acceleration but where its effort changes sign
    for share in (*product((0.0, 1.0), repeat=4), (0.5,) * 4):
        qdd = lowest + np.array(share) * (highest - lowest)
        for rows, sign, breaking in ((every, 1.0, False), *((some, *case) for case in AT_REST)):
            still = standing[rows]
            samples = Samples(t[rows], q[rows], qd[rows], qdd[rows], np.zeros_like(q[rows]))
            direction = np.where(still, sign, np.sign(qd[rows]))
            torque = motor_motion(
                robot, body, samples, direction, (still & breaking).astype(float)
            ).torque
            low[rows], high[rows] = np.fmin(low[rows], torque), np.fmax(high[rows], torque)
    return low, high


def _slow(robot: Robot, i: int, offsets: dict[int, Offsets]) -> float:
    """Speed up to which a joint may stand, as far as its rounded offset tells."""
    return 1e-6 * robot.joints[i].velocity + (offsets[i].velocity_rounding if i in offsets else 0.0)


def _accelerations(
    robot: Robot, t: Array, qd: Array, offsets: dict[int, Offsets]
) -> tuple[Array, Array]:
    """(lowest, highest) acceleration (n, 4) near every setpoint, within the joints' limits."""
    h = np.diff(t)
    mean = np.diff(qd, axis=0) / h[:, None]
    n = len(t)
    low, high = np.full((n, 4), np.inf), np.full((n, 4), -np.inf)
    for shift in range(-NEAR, NEAR):
        of = np.clip(np.arange(n) + shift, 0, n - 2)
        low, high = np.minimum(low, mean[of]), np.maximum(high, mean[of])
    limit = np.array([joint.acceleration for joint in robot.joints])
    rounding = np.array([offsets[i].velocity_rounding if i in offsets else 0.0 for i in range(4)])
    pad = limit * np.minimum(1.0, h.max() / FULL) + 2 * rounding / h.min()
    # a drive that holds, or a motion that has ended, needs no acceleration
    return np.maximum(np.minimum(low - pad, 0.0), -limit), np.minimum(
        np.maximum(high + pad, 0.0), limit
    )
