"""What the motors do while the joints move: direction, torque and effort of every drive by the exact friction law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ssm_planner.codegen.namespace import namespace_of
from ssm_planner.dynamics.friction import breakaway_coefficient, friction_coefficient, friction_of
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array, Expression

STILL = 1e-9
"""A joint slower than this share of its velocity limit stands."""


def motorised(joints: Sequence[Joint]) -> Iterator[tuple[int, Drive, Motor]]:
    """Index, drive and motor of every joint that has both."""
    for i, joint in enumerate(joints):
        if joint.drive is not None and joint.motor is not None:
            yield i, joint.drive, joint.motor


@dataclass(frozen=True, eq=False)
class MotorMotion:
    """Motor angle, speed, acceleration, torque and mesh effort of the joints, (n, 4) each; NaN without a drive."""

    angle: Array
    speed: Array
    acceleration: Array
    torque: Array
    effort: Array


def motor_motion(
    robot: Robot, body: RigidBody, samples: Samples, direction: Array, breakaway: Array
) -> MotorMotion:
    """Motor side of a motion at n samples.

    direction (n, 4): +1, −1 or 0 (the joint stands and its drive holds) for every joint, as `directions` gives it.
    breakaway (n, 4), bool: the joint starts to move there, so friction is that of breakaway.
    """
    tau = body.inverse_dynamics(samples.q, samples.qd, samples.qdd)
    ratio = np.array(
        [np.nan if joint.drive is None else joint.drive.ratio for joint in robot.joints]
    )
    torque, effort = np.full(tau.shape, np.nan), np.full(tau.shape, np.nan)
    for i, joint in enumerate(robot.joints):
        if joint.drive is not None:
            motion = (samples.qd[:, i], samples.qdd[:, i], direction[:, i])
            torque[:, i], effort[:, i] = drive_torque(
                joint.drive, tau[:, i], *motion, breakaway=breakaway[:, i]
            )
    return MotorMotion(ratio * samples.q, ratio * samples.qd, ratio * samples.qdd, torque, effort)


def motor_law(
    robot: Robot, q: ca.SX, qd: ca.SX, qdd: ca.SX, direction: ca.SX, breakaway: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(tau (4,), tau_motor (4,), effort (4,)): joint efforts, motor torques and mesh efforts; 0 without a drive.

    direction (4,): +1, −1, or 0 where the joint stands and its drive holds; breakaway (4,): 1 where it starts to move.
    """
    tau = RigidBody.from_robot(robot).symbolic(q, qd, qdd)
    torque, effort = ca.SX.zeros(4), ca.SX.zeros(4)
    for i, joint in enumerate(robot.joints):
        if joint.drive is not None:
            motion = (qd[i], qdd[i], direction[i])
            torque[i], effort[i] = drive_torque(
                joint.drive, tau[i], *motion, breakaway=breakaway[i]
            )
    return tau, torque, effort


def drive_torque(
    drive: Drive,
    tau_rigid: Expression,
    qd: Expression,
    qdd: Expression,
    direction: Expression,
    *,
    breakaway: Expression,
) -> tuple[Expression, Expression]:
    """(motor torque, mesh effort) of one drive; direction +1, −1 or 0 (it holds); breakaway: it starts to move."""
    friction, w, wd = friction_of(drive), drive.ratio * qd, drive.ratio * qdd
    where = namespace_of(breakaway, qd).where
    mu = where(breakaway, breakaway_coefficient(friction, w), friction_coefficient(friction, w))
    effort = output_effort(drive, tau_rigid, qd, qdd, direction)
    return motor_torque(drive, effort, w, wd, direction=direction, mu=mu), effort


def directions(robot: Robot, samples: Samples, side: int) -> tuple[Array, Array]:
    """Direction of motion (n, 4) of every joint and where it breaks away from rest (n, 4), by `joint_direction`."""
    columns = [
        joint_direction(joint, samples.qd[:, i], samples.qdd[:, i], samples.qddd[:, i], side)
        for i, joint in enumerate(robot.joints)
    ]
    direction, breakaway = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
    return direction, breakaway


def directions_law(
    robot: Robot, qd: ca.SX, qdd: ca.SX, qddd: ca.SX, side: int
) -> tuple[ca.SX, ca.SX]:
    """(direction, breakaway), (4,) each, by `joint_direction`."""
    columns = [
        joint_direction(joint, qd[i], qdd[i], qddd[i], side) for i, joint in enumerate(robot.joints)
    ]
    direction, breakaway = (ca.vertcat(*column) for column in zip(*columns, strict=True))
    return direction, breakaway


def joint_direction(
    joint: Joint, qd: Expression, qdd: Expression, qddd: Expression, side: int
) -> tuple[Expression, Expression]:
    """(+1, −1 or 0; whether it breaks away) of a joint.

    A standing joint takes the direction in which its derivatives carry it: side = +1 looks just after each instant
    (a start: static friction), side = −1 just before it (an arrival). A joint without any motion has direction 0.
    """
    xp = namespace_of(qd, qdd, qddd)
    limit, bend = joint.velocity, joint.acceleration
    standing = abs(qd) <= STILL * limit
    # just beside an instant at rest, velocity has the sign of ±acceleration, or of the jerk where that is zero too
    jerking = xp.where(abs(qddd) > STILL * bend**2 / limit, xp.sign(qddd), 0.0)
    leaning = xp.where(abs(qdd) > STILL * bend, side * xp.sign(qdd), jerking)
    direction = xp.where(standing, leaning, xp.sign(qd))
    return direction, xp.where(standing, (direction != 0) * (side > 0), False)
