"""The guard in Python, with the same thresholds and the same decisions as the guard in C."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from ssm_planner.problem import JOINTS
from ssm_planner.typing import Array
from ssm_planner_guard.thresholds import Thresholds


class Cause(IntEnum):
    """Cause of an alarm. The values are those of `ssm_guard_cause` in C."""

    NONE = 0
    CLOCK = 1
    LATE = 2
    NOT_A_NUMBER = 3
    POSITION_LIMIT = 4
    VELOCITY_LIMIT = 5
    TORQUE_LIMIT = 6
    PATH = 7
    SPEED = 8
    TORQUE = 9


TEXTS = {
    Cause.CLOCK: "the clock did not advance from one tick to the next",
    Cause.LATE: "no measurement for longer than the permitted lag",
    Cause.NOT_A_NUMBER: "a value is not a number",
    Cause.POSITION_LIMIT: "the position is outside its range",
    Cause.VELOCITY_LIMIT: "the velocity exceeds its limit",
    Cause.TORQUE_LIMIT: "the motor torque exceeds its limit",
    Cause.PATH: "the position left the tube around the path",
    Cause.SPEED: "the velocity differs from the plan",
    Cause.TORQUE: "the motor torque is outside the band of the friction law",
}
"""Description of each cause."""
STALLED = "the controller paused for longer than the permitted lag"
"""Description of the cause LATE if it concerns no joint."""


@dataclass(frozen=True)
class Alarm:
    """The first violation that a guard has seen."""

    cause: Cause
    joint: int
    """Index of the joint, or −1."""
    value: float
    bound: float
    """The bound that the value exceeds, in the same unit."""

    def __str__(self) -> str:
        joint = f"joint {JOINTS[self.joint]}: " if self.joint >= 0 else ""
        text = STALLED if self.stalled else TEXTS[self.cause]
        return f"{joint}{text} ({self.value:.6g}, allowed: {self.bound:.6g})"

    @property
    def stalled(self) -> bool:
        """True if the controller itself paused for longer than the lag."""
        return self.cause is Cause.LATE and self.joint < 0


@dataclass(frozen=True)
class Sample:
    """Measurements of the joints. Arrays are (4,), with the signs of the joints."""

    time: Array
    """Instant of each measurement, s. An old instant means that no new measurement has arrived."""
    q: Array
    """Positions, rad and m."""
    qd: Array
    """Velocities, rad/s and m/s."""
    tau: Array
    """Motor torques, N·m."""


class Guard:
    """Compare measurements with the set points at every tick."""

    def __init__(self, thresholds: Thresholds) -> None:
        """Prepare the guard for the first tick."""
        self.thresholds = thresholds
        self.alarm: Alarm | None = None
        self._driven = np.flatnonzero(thresholds.driven)
        self._ticks = 0
        self._time = 0.0
        # Set points: positions, velocities, lower and upper ends of the torque bands.
        self._planned = np.zeros((4, thresholds.rows, 4))
        # Measured velocities and torques.
        self._measured = np.zeros((2, thresholds.rows, 4))

    def tick(
        self, time: float, reference: tuple[Array, Array, Array, Array], sample: Sample
    ) -> Alarm | None:
        """Judge one tick, and return the first alarm since the start, or None.

        Parameters
        ----------
        time : float
            Present instant, s.
        reference : tuple of (4,)
            Set points: positions, velocities, accelerations, and motor torques by the friction law.
        sample : Sample
            The latest measurement of each joint.
        """
        if self.alarm is not None:
            return self.alarm
        passed = time - self._time if self._ticks else self.thresholds.period
        if not passed > 0 or not np.isfinite(time):
            return self._raise(Cause.CLOCK, -1, passed, 0.0)
        if passed > self.thresholds.lag:
            return self._raise(Cause.LATE, -1, passed, self.thresholds.lag)
        self._remember(reference, sample)
        self._time = time
        self._ticks += 1
        used = slice(min(self._ticks, self.thresholds.rows))
        lowest, highest = self._planned[:, used].min(axis=1), self._planned[:, used].max(axis=1)
        means = self._measured[:, used].mean(axis=1)
        ends = (lowest[0], highest[0]), (lowest[1], highest[1]), (lowest[2], highest[3])
        for k in self._driven:
            joint = [(low[k], high[k]) for low, high in ends]
            alarm = self._judge(int(k), time, sample, ends=joint, means=means[:, k])
            if alarm is not None:
                return alarm
        return None

    def _remember(self, reference: tuple[Array, Array, Array, Array], sample: Sample) -> None:
        """Replace the oldest row by the set points and the measurements (4,) of this tick."""
        q, qd, _, tau = reference
        spread = self.thresholds.torque_spread * np.abs(tau)
        row = self._ticks % self.thresholds.rows
        self._planned[:, row] = q, qd, tau - spread, tau + spread
        self._measured[:, row] = sample.qd, sample.tau

    def _judge(
        self, k: int, time: float, sample: Sample, *, ends: list[tuple[float, float]], means: Array
    ) -> Alarm | None:
        """Judge joint k.

        `ends` are the extremes of position, velocity and torque of the set points within the lag.
        `means` (2,) are the means of the measured velocities and torques.
        """
        limits = self.thresholds
        measured, q, qd, tau = (float(values[k]) for values in vars(sample).values())
        if measured > time:
            return self._raise(Cause.CLOCK, k, measured - time, 0.0)
        if not time - measured <= limits.lag:
            return self._raise(Cause.LATE, k, time - measured, limits.lag)
        if not np.isfinite([q, qd, tau, *means, *ends[0], *ends[1], *ends[2]]).all():
            return self._raise(Cause.NOT_A_NUMBER, k, np.nan, 0.0)
        position, velocity = limits.position_margin[k], limits.velocity_margin[k]
        torque = limits.torque_margin[k]
        (slowest, fastest) = ends[1]
        # A joint that may be at rest has any torque that its friction holds.
        moving = self._ticks >= limits.rows and (slowest > velocity or fastest < -velocity)
        tests = (
            (
                Cause.POSITION_LIMIT,
                q,
                (limits.position_min[k] - position, limits.position_max[k] + position),
            ),
            (
                Cause.VELOCITY_LIMIT,
                means[0],
                (-limits.velocity_max[k] - velocity, limits.velocity_max[k] + velocity),
            ),
            (
                Cause.TORQUE_LIMIT,
                tau,
                (
                    -limits.torque_max[k] - limits.torque_noise[k],
                    limits.torque_max[k] + limits.torque_noise[k],
                ),
            ),
            (Cause.PATH, q, (ends[0][0] - position, ends[0][1] + position)),
            (Cause.SPEED, means[0], (slowest - velocity, fastest + velocity)),
            (Cause.TORQUE, means[1], (ends[2][0] - torque, ends[2][1] + torque)),
        )
        for cause, value, (low, high) in tests:
            if cause is Cause.TORQUE and not moving:
                continue
            if value < low or value > high:
                return self._raise(cause, k, value, low if value < low else high)
        return None

    def _raise(self, cause: Cause, joint: int, value: float, bound: float) -> Alarm:
        """Keep the first alarm and return it."""
        self.alarm = Alarm(cause, joint, float(value), float(bound))
        return self.alarm
