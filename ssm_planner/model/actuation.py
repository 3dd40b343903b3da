"""What the motors do while the joints move: speed and torque on the motor side, by the exact friction law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.model.friction import friction_coefficient, friction_of
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.trajectory import Samples
from ssm_planner.model.transmission import motor_torque, output_effort
from ssm_planner.problem.values import Array, Robot

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
