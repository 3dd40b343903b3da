"""Limits at one instant as CasADi expressions for the peers, written as a user of CasADi would.

The expressions use the equations of the model and nothing of `planning/`. A row that is ≤ 1 keeps
its limit.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ssm_planner.dynamics.friction import friction_coefficient, required_friction
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque_rows, output_effort
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import joints_from_task_symbolic
from ssm_planner.problem.robot import Joint, Robot

SOFT = 1e-3
"""Smoothing of the braking side of the friction law, relative to the torque limit."""
LIMITS = 12
"""Number of limits: velocity, acceleration and motor torque of four joints, in this order."""


def straight_rows(
    robot: Robot, mechanism: Mechanism, branch: int, sigma: Sequence[float]
) -> ca.Function:
    """Return the function of the rows on the line from start to end in task coordinates.

    It maps (s, ṡ, s̈, start (4), end (4), limits (LIMITS)) to the rows and to the rows of
    breakaway. The joints follow from symbolic inverse kinematics, their rates from the chain rule,
    and the loads from the rigid-body recursion.
    """
    s, speed, acceleration = (ca.SX.sym(name) for name in ("s", "speed", "acceleration"))
    start, end, limits = ca.SX.sym("start", 4), ca.SX.sym("end", 4), ca.SX.sym("limits", LIMITS)
    q = joints_from_task_symbolic(mechanism, start + s * (end - start), branch)
    slope = ca.jacobian(q, s)
    bend = ca.jacobian(slope, s)
    qd, qdd = slope * speed, bend * speed**2 + slope * acceleration
    tau = RigidBody.from_robot(robot).symbolic(q, qd, qdd)
    rows = kinematic(qd, qdd, limits)
    inputs = [s, speed, acceleration, start, end, limits]
    torque = [
        motor(robot.joints, qd, qdd, tau, limits, sigma, at_rest) for at_rest in (False, True)
    ]
    return ca.Function("rows", inputs, [ca.vertcat(*rows, *torque[0]), ca.vertcat(*torque[1])])


def free_rows(robot: Robot) -> ca.Function:
    """Return the function of the torque rows of a free motion.

    It maps (q, q̇, q̈, limits (LIMITS), directions (4)) to the torque rows and to those of
    breakaway.
    """
    q, qd, qdd, sigma = (ca.SX.sym(name, 4) for name in ("q", "qd", "qdd", "sigma"))
    limits = ca.SX.sym("limits", LIMITS)
    tau = RigidBody.from_robot(robot).symbolic(q, qd, qdd)
    directions = [sigma[i] for i in range(4)]
    torque = [
        motor(robot.joints, qd, qdd, tau, limits, directions, at_rest) for at_rest in (False, True)
    ]
    return ca.Function("rows", [q, qd, qdd, limits, sigma], [ca.vertcat(*rows) for rows in torque])


def kinematic(qd: ca.SX, qdd: ca.SX, limits: ca.SX) -> list[ca.SX]:
    """Return rows for ± velocity and ± acceleration of every joint."""
    rows = []
    for i in range(4):
        rows += [
            qd[i] / limits[i],
            -qd[i] / limits[i],
            qdd[i] / limits[4 + i],
            -qdd[i] / limits[4 + i],
        ]
    return rows


def motor(
    joints: Sequence[Joint],
    qd: ca.SX,
    qdd: ca.SX,
    tau: ca.SX,
    limits: ca.SX,
    sigma: Sequence[ca.SX | float],
    at_rest: bool,
) -> list[ca.SX]:
    """Return the rows of the motor torque of the driven joints.

    The rows are exact for the known direction of motion. Every joint has two rows, and a third one
    for braking.
    """
    rows = []
    for i, joint in enumerate(joints):
        drive = joint.drive
        if drive is None or joint.motor is None:
            continue
        friction, limit = required_friction(drive), limits[8 + i]
        w, wd = drive.ratio * qd[i], drive.ratio * qdd[i]
        mu = friction.mu_static if at_rest else friction_coefficient(friction, sigma[i] * w)
        effort = output_effort(drive, tau[i], qd[i], qdd[i], sigma[i])
        law = {side: motor_torque_rows(drive, side, mu) for side in (1, -1)}

        def value(k: int, law=law, effort=effort, w=w, wd=wd, i=i) -> ca.SX:  # type: ignore[no-untyped-def]
            ahead, back = (
                law[side].slope[k] * effort
                + law[side].inertia * wd
                + law[side].coulomb
                + law[side].viscous * w
                for side in (1, -1)
            )
            return (sigma[i] * (sigma[i] + 1) * ahead - sigma[i] * (sigma[i] - 1) * back) / 2

        first, second = value(0), value(1)
        half = (first - second) / (2 * limit)
        larger = (first + second) / (2 * limit) + ca.sqrt(half**2 + SOFT**2) - SOFT
        rows += [first / limit, second / limit, -larger]
    return rows
