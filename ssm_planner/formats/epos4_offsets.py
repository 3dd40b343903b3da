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


def offset_checks(robot: Robot, t: Array, q: Array, resolution: Array, offsets: dict[int, Offsets]) -> list[LimitCheck]:
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
        checks.append(_velocity_check(joint, t, slopes[:, i], offset, rounding=float(resolution[i])))
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


def _velocity_check(joint: Joint, t: Array, slope: Array, offset: Offsets, rounding: float) -> LimitCheck:
    """|q̇(t) − mean of q̇ over an adjacent interval| ≤ q̈_max h / 2."""
    h = np.diff(t)
    allowed = joint.acceleration * (1 + 1e-6) * h / 2 + 2 * rounding / h + offset.velocity_rounding
    beyond = np.maximum(np.abs(offset.velocity[1:] - slope), np.abs(offset.velocity[:-1] - slope)) / allowed
    k = int(np.argmax(beyond))
    limit = FeedForward(joint.name, float(allowed[k]), prismatic=joint.kind == "prismatic")
    return LimitCheck.of(limit, float(beyond[k] * allowed[k]), float(t[k]))


def _torque_range(robot: Robot, t: Array, q: Array, qd: Array, offsets: dict[int, Offsets]) -> tuple[Array, Array]:
    """(lowest, highest) motor torque (n, 4) with any acceleration that is near a setpoint and either friction at rest."""
    lowest, highest = _accelerations(robot, t, qd, offsets)
    body = RigidBody.from_robot(robot)
    rest = np.array([_slow(robot, i, offsets) for i in range(4)])
    low, high = np.full(q.shape, np.inf), np.full(q.shape, -np.inf)
    zero = np.zeros_like(q)
    # the torque of a motor rises or falls throughout with each acceleration but where its effort changes sign
    for share in product((0.0, 0.5, 1.0), repeat=4):
        qdd = lowest + np.array(share) * (highest - lowest)
        samples = Samples(t, q, qd, qdd, zero)
        for sign, breaking in ((1.0, False), (1.0, True), (-1.0, False), (-1.0, True), (0.0, False)):
            standing = np.abs(qd) <= rest
            if (sign != 1.0 or breaking) and not standing.any():
                continue
            direction = np.where(standing, sign, np.sign(qd))
            torque = motor_motion(robot, body, samples, direction, (standing & breaking).astype(float)).torque
            low, high = np.fmin(low, torque), np.fmax(high, torque)
    return low, high


def _slow(robot: Robot, i: int, offsets: dict[int, Offsets]) -> float:
    """Speed up to which a joint may stand, as far as its rounded offset tells."""
    return 1e-6 * robot.joints[i].velocity + (offsets[i].velocity_rounding if i in offsets else 0.0)


def _accelerations(robot: Robot, t: Array, qd: Array, offsets: dict[int, Offsets]) -> tuple[Array, Array]:
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
    return np.maximum(np.minimum(low - pad, 0.0), -limit), np.minimum(np.maximum(high + pad, 0.0), limit)
