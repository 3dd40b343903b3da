"""Jumps at the breaks of a motion, and its velocities at both ends.

A motion must rest at both ends unless end velocities are declared.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from ssm_planner.kinematics import Mechanism, joint_rates
from ssm_planner.problem import TASK, EndVelocity, Jump, Robot, TaskLimits
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import LimitCheck
from ssm_planner.verification.limits import JUMP, JUMP_RATE
from ssm_planner.verification.pieces import Pieces

_jump = lru_cache(maxsize=256)(Jump)
_end_velocity = lru_cache(maxsize=256)(EndVelocity)
"""The same ones are asked for in every check of a robot."""


class Jumps:
    """Collect the worst jumps of position, velocity and acceleration of the four joints."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.worst = np.zeros((3, 4))
        self.time = np.zeros((3, 4))
        self._last: Array | None = None
        v, a, jerk = (
            np.array([getattr(joint, name) for joint in robot.joints], dtype=float)
            for name in ("velocity", "acceleration", "jerk")
        )
        self._tolerance = JUMP * np.array([np.ones(4), v, a])
        # Without a jerk limit, time excuses any sum of jumps of the acceleration.
        self._excused = JUMP_RATE * np.array([v, a, np.nan_to_num(jerk, nan=1e100)])
        self._level = np.zeros((3, 4))
        self._level_time = 0.0

    def look(self, pieces: Pieces) -> None:
        starts, ends = pieces.ends
        # nothing is before the first piece of all
        previous = np.concatenate(
            [(starts[0] if self._last is None else self._last)[None], ends[:-1]]
        )
        self._last = ends[-1]
        jump = np.abs(starts - previous)
        level = self._accumulated(jump, pieces.start)
        # A jump that alone exceeds its tolerance is reported as it is.
        added_up = (level > self._tolerance) & (jump <= self._tolerance)
        jump = np.where(added_up, level, jump)
        magnitude = jump.max(axis=0)
        k = jump.argmax(axis=0)
        self.time = np.where(magnitude > self.worst, pieces.start[k], self.time)
        self.worst = np.maximum(magnitude, self.worst)

    def _accumulated(self, jump: Array, time: Array) -> Array:
        """Return the largest sum of jumps up to each one, less what the time between excuses.

        jump: (m, 3, 4); time: (m,). Every jump is within its tolerance in a motion that teleports
        by many small ones. A sum is thus excused only by the small share JUMP_RATE of the next
        limit: Σ jumps ≤ tolerance + JUMP_RATE · limit · time, for every interval of time.
        """
        rise = np.cumsum(jump, axis=0) - self._excused * (time - self._level_time)[:, None, None]
        lowest = np.minimum.accumulate(np.concatenate([-self._level[None], rise - jump]))[1:]
        level = rise - lowest
        self._level = level[-1]
        self._level_time = float(time[-1])
        return level

    def checks(self, straight: bool = False) -> list[LimitCheck]:
        """Return the results for each joint.

        Acceleration jumps count only if the jerk is limited. straight: judge position jumps alone.
        """
        checks = []
        for i, joint in enumerate(self.robot.joints):
            limits = [_jump(joint.name, JUMP, joint.slides)]
            if not straight:
                limits.append(_jump(joint.name, JUMP * joint.velocity, joint.slides, derivative=1))
            if not straight and joint.jerk is not None:
                limits.append(
                    _jump(joint.name, JUMP * joint.acceleration, joint.slides, derivative=2)
                )
            for limit in limits:
                worst, time = (
                    float(values[limit.derivative, i]) for values in (self.worst, self.time)
                )
                checks.append(LimitCheck.from_extreme(limit, worst, time))
        return checks


def end_velocities(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return q̇ (4,) at the start and at the end of a trajectory."""
    start, end = trajectory.pieces(np.array([0, len(trajectory.breaks) - 2]))
    length = trajectory.breaks[-1] - trajectory.breaks[-2]
    orders = np.arange(1, len(end))
    return start[1], (end[1:] * (orders * length ** (orders - 1))[:, None]).sum(axis=0)


def declared_velocities(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> tuple[Array, Array]:
    """Return the declared q̇ (4,) at both ends.

    At an end where no rate is declared, this is the velocity of the trajectory itself.
    """
    velocities = []
    actual = end_velocities(trajectory)
    for velocity, rate, t in zip(
        actual, (limits.start_rate, limits.end_rate), trajectory.breaks[[0, -1]], strict=True
    ):
        velocities.append(velocity if rate is None else _joint_velocity(trajectory, robot, rate, t))
    return velocities[0], velocities[1]


def end_checks(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, straight: bool
) -> list[LimitCheck]:
    """Check the velocity of each joint at both ends.

    straight: skip an end with a linear piece, which does not determine the velocity.
    """
    checks = []
    declared = declared_velocities(trajectory, robot, limits)
    outer = trajectory.pieces(np.array([0, len(trajectory.breaks) - 2]))
    bent = [bool(coefficients[2:].any()) for coefficients in outer]
    for end, (velocity, declared_velocity) in enumerate(
        zip(end_velocities(trajectory), declared, strict=True)
    ):
        if straight and not bent[end]:
            continue
        for i, joint in enumerate(robot.joints):
            limit = _end_velocity(joint.name, JUMP * joint.velocity, joint.slides, at_end=bool(end))
            deviation = abs(float(velocity[i] - declared_velocity[i]))
            checks.append(LimitCheck.from_extreme(limit, deviation, float(trajectory.breaks[-end])))
    return checks


def _joint_velocity(
    trajectory: Trajectory, robot: Robot, rate: Mapping[str, float], t: float
) -> Array:
    q = trajectory.sample(np.array([t]), "left" if t == trajectory.breaks[-1] else "right").q[0]
    return joint_rates(
        Mechanism.from_robot(robot), q, np.array([rate.get(name, 0.0) for name in TASK])
    )
