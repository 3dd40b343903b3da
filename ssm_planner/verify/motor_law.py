"""Motor torques of a robot as one expression: the laws of model/ put together for evaluation in bulk and for C."""

from __future__ import annotations

import casadi as ca

from ssm_planner.model.actuation import STILL
from ssm_planner.model.friction import friction_coefficient, friction_of
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.transmission import motor_torque_rows, output_effort
from ssm_planner.problem.values import Drive, Robot


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
