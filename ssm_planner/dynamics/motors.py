"""What the motors do while the joints move: speed and torque on the motor side, by the exact friction law.

Motor torques of a robot as one expression: the laws of model/ put together for evaluation in bulk and for C.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ssm_planner.dynamics.friction import friction_coefficient, friction_of
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque, motor_torque_rows, output_effort
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array

STILL = 1e-9
"""A joint slower than this share of its velocity limit stands."""


@dataclass(frozen=True, eq=False)
class MotorMotion:
    """Motor angle, speed, acceleration, torque and mesh effort of the joints, (n, 4) each; NaN without a drive."""

    angle: Array
    speed: Array
    acceleration: Array
    torque: Array
    effort: Array


def motor_motion(robot: Robot, body: RigidBody, samples: Samples, direction: Array, breakaway: Array) -> MotorMotion:
    """Motor side of a motion at n samples.

    direction (n, 4): +1, −1 or 0 (the joint stands and its drive holds) for every joint, as `directions` gives it.
    breakaway (n, 4), bool: the joint starts to move there, so the static friction coefficient applies.
    """
    tau = body.inverse_dynamics(samples.q, samples.qd, samples.qdd)
    columns = {
        name: np.full(samples.q.shape, np.nan) for name in ("angle", "speed", "acceleration", "torque", "effort")
    }
    for i, joint in enumerate(robot.joints):
        drive = joint.drive
        if drive is None:
            continue
        friction, sign = friction_of(drive), direction[:, i]
        w, wd = drive.ratio * samples.qd[:, i], drive.ratio * samples.qdd[:, i]
        mu = friction_coefficient(friction, w)
        mu = np.where(breakaway[:, i], np.maximum(mu, friction.mu_static), mu)
        effort = output_effort(drive, tau[:, i], samples.qd[:, i], samples.qdd[:, i], sign)
        columns["angle"][:, i] = drive.ratio * samples.q[:, i]
        columns["speed"][:, i] = w
        columns["acceleration"][:, i] = wd
        columns["effort"][:, i] = effort
        columns["torque"][:, i] = motor_torque(drive, effort, w, wd, direction=sign, mu=mu)
    return MotorMotion(**columns)


def directions(robot: Robot, samples: Samples, side: int) -> tuple[Array, Array]:
    """Direction of motion (n, 4) of every joint and where it breaks away from rest (n, 4).

    A standing joint takes the direction in which its derivatives carry it: side = +1 looks just after each instant
    (a start: static friction), side = −1 just before it (an arrival). A joint without any motion has direction 0.
    """
    limit = np.array([joint.velocity for joint in robot.joints])
    bend = np.array([joint.acceleration for joint in robot.joints])
    moving = np.abs(samples.qd) > STILL * limit
    # just beside an instant at rest, velocity has the sign of ±acceleration, or of the jerk where that is zero too
    accelerating = np.abs(samples.qdd) > STILL * bend
    jerking = np.abs(samples.qddd) > STILL * bend**2 / limit
    leaning = np.where(accelerating, side * np.sign(samples.qdd), np.where(jerking, np.sign(samples.qddd), 0.0))
    direction = np.where(moving, np.sign(samples.qd), leaning)
    breakaway = ~moving & (direction != 0) & (side > 0)
    return direction, breakaway


def motor_law(
    robot: Robot, q: ca.SX, qd: ca.SX, qdd: ca.SX, direction: ca.SX, breakaway: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(tau (4,), tau_motor (4,), effort (4,)): joint efforts, motor torques and mesh efforts.

    direction (4,): +1, −1, or 0 where the joint stands and its drive holds; breakaway (4,): 1 where the static friction
    coefficient applies. The same values as `model.actuation.motor_motion`; 0 for a joint without a drive.
    """
    tau = RigidBody.from_robot(robot).symbolic(q, qd, qdd)
    torque, effort = ca.SX.zeros(4), ca.SX.zeros(4)
    for i, joint in enumerate(robot.joints):
        if joint.drive is None:
            continue
        effort[i] = output_effort(joint.drive, tau[i], qd[i], qdd[i], direction[i])
        w, wd = joint.drive.ratio * qd[i], joint.drive.ratio * qdd[i]
        friction = friction_of(joint.drive)
        kinetic = friction_coefficient(friction, w)
        mu = ca.if_else(breakaway[i], ca.fmax(kinetic, friction.mu_static), kinetic)
        moving = ca.if_else(
            direction[i] > 0,
            _moving(joint.drive, 1, mu, effort[i], w, wd),
            _moving(joint.drive, -1, mu, effort[i], w, wd),
        )
        torque[i] = ca.if_else(direction[i] == 0, _holding(joint.drive, effort[i]), moving)
    return tau, torque, effort


def directions_law(robot: Robot, qd: ca.SX, qdd: ca.SX, qddd: ca.SX, side: int) -> tuple[ca.SX, ca.SX]:
    """(direction, breakaway), (4,) each: the rule of `model.actuation.directions` as an expression."""
    limit = ca.DM([joint.velocity for joint in robot.joints])
    bend = ca.DM([joint.acceleration for joint in robot.joints])
    standing = ca.fabs(qd) <= STILL * limit
    accelerating = ca.fabs(qdd) > STILL * bend
    jerking = ca.fabs(qddd) > STILL * bend**2 / limit
    leaning = ca.if_else(accelerating, side * ca.sign(qdd), ca.if_else(jerking, ca.sign(qddd), 0.0))
    direction = ca.if_else(standing, leaning, ca.sign(qd))
    breakaway = ca.logic_and(standing, direction != 0) if side > 0 else ca.SX.zeros(4)
    return direction, breakaway


def _moving(drive: Drive, direction: int, mu: ca.SX, effort: ca.SX, w: ca.SX, wd: ca.SX) -> ca.SX:
    """The torque law in one direction of motion: the larger (+1) or smaller (−1) of its two rows."""
    rows = motor_torque_rows(drive, direction, mu)
    first, second = (slope * effort + rows.inertia * wd + rows.coulomb + rows.viscous * w for slope in rows.slope)
    return ca.fmax(first, second) if direction > 0 else ca.fmin(first, second)


def _holding(drive: Drive, effort: ca.SX) -> ca.SX:
    """Smallest torque between the breakaway torques of both directions: 0 where the drive locks itself."""
    mu = ca.SX(friction_of(drive).mu_static)
    down, up = (
        _moving(drive, direction, mu, output_effort(drive, effort, 0.0, 0.0, direction), ca.SX(0), ca.SX(0))
        for direction in (-1, 1)
    )
    return ca.fmin(ca.fmax(0.0, ca.fmin(down, up)), ca.fmax(down, up))
