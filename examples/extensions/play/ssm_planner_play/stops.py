"""Compute the certified controlled stops from the set points of a program before anything moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ssm_planner.dynamics import REST_FRACTION
from ssm_planner.dynamics.robot_dynamics import motor_torque
from ssm_planner.stopping import controlled_stops
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from ssm_planner.units import rpm
from ssm_planner_play.program import PlayError, Program, Rows

MOST = 10_000
"""Largest number of instants with a stop. It bounds memory (70 MB) and computing time (20 s)."""
BLOCK = 1000
"""Number of stops that are computed together, which bounds the memory."""


@dataclass(frozen=True)
class StopTable:
    """Set points of the stop from every `every`-th row of a program."""

    every: int
    first: Array
    """Index (n + 1,) of the first set point of each stop, and the number of set points."""
    rows: Rows
    longest: float
    """Longest duration of a stop, s."""

    def stop_at(self, row: int) -> Rows | None:
        """Return the set points that follow a row in a stop.

        The result is None if no stop begins at this row, because stops begin only at every
        `every`-th row.
        """
        if row % self.every:
            return None
        part = slice(*self.first[row // self.every : row // self.every + 2].tolist())
        return Rows(*(values[part] for values in vars(self.rows).values()))


def stop_table(program: Program, progress: Callable[[str], None] = lambda text: None) -> StopTable:
    """Compute the quickest controlled stops along the path, and check all of them.

    Parameters
    ----------
    program : Program
    progress : callable
        Receives one line per block of stops.

    Raises
    ------
    PlayError
        If a stop exceeds a limit.
    """
    plan = program.plan
    every = math.ceil(len(program.rows) / MOST)
    starts = np.arange(0, len(program.rows), every)
    lengths, parts, longest = [], [], 0.0
    for begin in range(0, len(starts), BLOCK):
        times = np.minimum(starts[begin : begin + BLOCK] * program.period, plan.motion.duration)
        stops = controlled_stops(plan.motion, plan.robot, plan.limits, times)
        if not stops.passed:
            raise PlayError(
                f"{program.folder}: a controlled stop exceeds {stops.certificate.worst.excess}"
            )
        samples = [
            stop_samples(motion, early, program.period)
            for motion, early in zip(stops.motions, times - stops.time, strict=True)
        ]
        lengths += [len(sample) for sample in samples]
        parts.append(_rows(program, np.concatenate(samples)))
        longest = max(longest, float(stops.duration.max()))
        progress(f"computed {begin + len(times)} of {len(starts)} controlled stops")
    rows = Rows(*(np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])))
    return StopTable(every, np.concatenate([[0], np.cumsum(lengths)]), rows, longest)


def stop_samples(motion: Trajectory | None, early: float, period: float) -> Array:
    """Return q, qd and qdd (n, 3, 4) at the set points that follow the beginning of a stop.

    Parameters
    ----------
    motion : Trajectory or None
        The stop, or None if all joints already rest.
    early : float
        Time from the beginning of the stop to the last set point before it, s. It is not 0 if the
        stop begins at a break of the motion that is close to the set point.
    period : float
        Interval between set points, s.
    """
    if motion is None:
        return np.zeros((0, 3, 4))
    count = math.ceil((motion.duration - early) / period - 1e-9)
    t = np.minimum(early + period * np.arange(1, count + 1), motion.duration)
    samples = motion.sample(t)
    result = np.stack([samples.q, samples.qd, samples.qdd], axis=1)
    result[-1, 1:] = 0.0  # all joints rest
    return result


def _rows(program: Program, samples: Array) -> Rows:
    """Convert q, qd and qdd (n, 3, 4) to set points."""
    q, qd, qdd = samples[:, 0], samples[:, 1], samples[:, 2]
    still = np.abs(qd) <= REST_FRACTION * program.plan.robot.velocities
    torque = motor_torque(program.plan.robot, q, np.where(still, 0.0, qd), qdd)
    indices = [axis.index for axis in program.axes]
    direction = np.array([axis.direction for axis in program.axes])
    speed = qd[:, indices] * np.array([axis.ratio for axis in program.axes])
    rated = np.array([axis.rated_torque for axis in program.axes])
    counts = q[:, indices] * np.array([axis.per_unit for axis in program.axes])
    return Rows(
        np.rint(counts).astype(np.int32),
        np.rint(1000 * direction * speed / rpm).astype(np.int32),
        np.rint(1000 * direction * torque[:, indices] / rated).astype(np.int16),
    )
