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
AT_ONCE = 1e-6
"""A stretch shorter than this is over at once, s: the velocity in it is rounding."""
LOOKAHEAD = 1e-4
"""How far beside an instant the direction of a standing joint is looked for, s."""


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


def directions(
    robot: Robot, samples: Samples, side: int, before: Array | None = None, after: Array | None = None
) -> tuple[Array, Array]:
    """Direction of motion (n, 4) of every joint and where it breaks away from rest (n, 4).

    A standing joint takes the direction in which its derivatives carry it: side = +1 looks just after each instant
    (a start: static friction), side = −1 just before it (an arrival). A joint without any motion has direction 0.
    before, after (n,): times for which the derivatives hold on either side (default: long). A joint about to stop where
    they end is then not taken for one that turns back, and where they end at once the other side is looked at.
    """
    long = np.full(len(samples.t), np.inf)
    before, after = long if before is None else before, long if after is None else after
    limit = np.array([joint.velocity for joint in robot.joints])
    bend = np.array([joint.acceleration for joint in robot.joints])
    look = np.where((after if side > 0 else before) > AT_ONCE, side, -side)[:, None]
    ahead = look * np.minimum(np.where(look > 0, after[:, None], before[:, None]), LOOKAHEAD) / 2
    moving = np.abs(samples.qd) > STILL * limit
    # just beside an instant at rest, velocity has the sign of ±acceleration, or of the jerk where that is zero too
    accelerating = np.abs(samples.qdd) > STILL * bend
    jerking = np.abs(samples.qddd) > STILL * bend**2 / limit
    leaning = np.where(accelerating, look * np.sign(samples.qdd), np.where(jerking, np.sign(samples.qddd), 0.0))
    there = samples.qd + ahead * (samples.qdd + ahead * samples.qddd / 2)
    going_on = (leaning != 0) & (np.sign(there) == np.sign(samples.qd)) & (np.sign(samples.qd) != leaning)
    direction = np.where(moving | going_on, np.sign(samples.qd), leaning)
    breakaway = ~moving & ~going_on & (direction != 0) & (look > 0)
    return direction, breakaway
