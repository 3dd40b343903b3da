"""A motion played slower: what its certificate says at one speed, and at which speed of a range it is worst.

At a share k of the speed, velocities, accelerations and jerks are k, k² and k³ times as large, so their limits hold if the
motion keeps them; places are the same. Motor torque is not: friction may grow towards low speed (Stribeck), and a load that
inertia carried must then be carried by the motor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.dynamics.motors import directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ProblemError
from ssm_planner.problem.limits import ContinuousTorque, MotorTorque
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Samples, Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate, LimitCheck
from ssm_planner.verification.check import RATE, check

SLOWEST = 0.01
FACTORS = 48
"""Speeds of a range that are looked at first, at equal ratios."""
INSTANTS = 1500
"""Of the motion at which torque is looked for at every speed; beside them both sides of every break."""
REFINED = 3
"""Rounds in which the neighbourhood of the worst speed is looked at again, each a tenth as wide."""


@dataclass(frozen=True)
class WorstSpeed:
    """The share of the speed at which one limit is nearest to be broken, and what the check finds there."""

    speed: float
    found: LimitCheck


@dataclass(frozen=True, eq=False)
class SpeedRange:
    """Every speed from `slowest` to 1."""

    slowest: float
    worst: tuple[WorstSpeed, ...]
    """Motor torque and continuous torque of every joint with a motor."""
    certificates: tuple[tuple[float, Certificate], ...]
    """At each of these speeds, at the slowest and at full speed."""

    @property
    def passed(self) -> bool:
        """Every limit holds at every speed."""
        return all(certificate.passed for _, certificate in self.certificates)

    def to_dict(self) -> dict[str, Any]:
        """`speeds` in what `check --json` prints; SI."""
        worst = [{"speed": each.speed, **each.found.to_dict()} for each in self.worst]
        return {"slowest": self.slowest, "passed": self.passed, "worst": worst}


def check_slower(
    motion: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    speed: float,
    interpolation: str = "quintic polynomial pieces",
) -> Certificate:
    """Certificate of a motion played at a share of its speed, above 0 and up to 1. Raises ProblemError."""
    if not 0 < speed <= 1:
        raise ProblemError(
            "no playback", key="speed", value=speed, allowed="above 0 and up to 1 (100 %)"
        )
    slow = motion.slower(speed)
    return check(
        slow, robot, limits.slower(1 / speed), rate=RATE * speed, interpolation=interpolation
    )


def check_speeds(
    motion: Trajectory, robot: Robot, limits: TaskLimits, slowest: float = SLOWEST
) -> SpeedRange:
    """Certificate of every speed from `slowest` to 1: the worst one for each motor, found among all and then checked."""
    if not 0 < slowest < 1:
        raise ProblemError(
            "no range of speeds", key="speed", value=slowest, allowed="above 0 and below 1 (100 %)"
        )
    driven = [
        i
        for i, joint in enumerate(robot.joints)
        if joint.drive is not None and joint.motor is not None
    ]
    names = [(kind, i) for kind in (MotorTorque.name, ContinuousTorque.name) for i in driven]
    factors = np.geomspace(slowest, 1.0, FACTORS)
    pause = limits.duty or 0.0
    found = _torques(motion, robot, factors, pause)
    speeds = [
        _worst(
            motion,
            robot,
            factors,
            found[kind == ContinuousTorque.name][:, i],
            (kind == ContinuousTorque.name, i),
            pause=pause,
        )
        for kind, i in names
    ]
    looked = sorted({slowest, 1.0, *speeds})
    certificates = {speed: check_slower(motion, robot, limits, speed) for speed in looked}
    worst = []
    for (kind, i), speed in zip(names, speeds, strict=True):
        listed = certificates[speed].limits
        name = robot.joints[i].name
        worst += [
            WorstSpeed(speed, each) for each in listed if each.name == kind and each.joint == name
        ]
    return SpeedRange(slowest, tuple(worst), tuple(certificates.items()))


def _worst(
    motion: Trajectory,
    robot: Robot,
    factors: Array,
    values: Array,
    at: tuple[bool, int],
    pause: float,
) -> float:
    """The factor of the largest value: the best of the grid (m,), then ever closer around it."""
    for _ in range(REFINED):
        k = int(np.argmax(values))
        low, high = factors[max(k - 1, 0)], factors[min(k + 1, len(factors) - 1)]
        factors = np.geomspace(low, high, 13)
        values = _torques(motion, robot, factors, pause)[int(at[0])][:, at[1]]
    return float(np.clip(factors[int(np.argmax(values))], 0.0, 1.0))


def _torques(motion: Trajectory, robot: Robot, factors: Array, pause: float) -> tuple[Array, Array]:
    """(largest |motor torque|, its RMS over motion and pause) of every joint at each of the factors (m,): (m, 4) each."""
    ends = np.linspace(motion.breaks[0], motion.breaks[-1], INSTANTS + 1)
    parts = [
        (motion.sample(ends), 1),
        (motion.sample(motion.breaks[:-1]), 1),
        (motion.sample(motion.breaks[1:], "left"), -1),
    ]
    body = RigidBody.from_robot(robot)
    peak, rms = np.zeros((len(factors), 4)), np.zeros((len(factors), 4))
    for samples, side in parts:
        k = factors[:, None, None]
        many = [
            (k**order * getattr(samples, name)[None]).reshape(-1, 4)
            for order, name in enumerate(("q", "qd", "qdd", "qddd"))
        ]
        slow = Samples(np.tile(samples.t, len(factors)), *many)
        way, away = directions(robot, slow, side)
        torque = motor_motion(robot, body, slow, way, away).torque.reshape(len(factors), -1, 4)
        peak = np.fmax(peak, np.nanmax(np.abs(np.nan_to_num(torque)), axis=1))
        if samples is parts[0][0]:
            rms = np.sqrt(np.mean(np.nan_to_num(torque) ** 2, axis=1))
    return peak, rms * np.sqrt(motion.duration / (motion.duration + factors * pause))[:, None]
