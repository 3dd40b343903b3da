"""Durations that no motion can beat, in closed form: each joint alone, on the fastest S-curve from rest to rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ssm_planner.problem.limits import TASK
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, Indices

MOVES = 1e-12


def lower_bound(robot: Robot, points: Array, *, at_rest: bool = True) -> float:
    """The largest single-joint optimum through points (k + 1, 4): each joint alone, everything else ignored, s.

    A joint turns back only at the points, as the planner's joints do. at_rest: the motion begins and ends at rest; else
    only velocities bound it.
    """
    return max(_time(robot, joint, points[:, joint], at_rest) for joint in range(4))


def rate_bound(start: Array, end: Array, rates: Mapping[str, float]) -> float:
    """The time that the rates (by name in TASK) allow for the way from start to end in task coordinates, (4,), s."""
    way = np.abs(end - start)
    return max((float(way[TASK.index(name)]) / rate for name, rate in rates.items()), default=0.0)


def _time(robot: Robot, i: int, positions: Array, at_rest: bool) -> float:
    """Shortest time of one joint alone through its positions (k + 1,), s."""
    joint = robot.joints[i]
    runs = _runs(positions)
    if not at_rest:
        return sum(runs) / joint.velocity
    # where it turns back its velocity is zero, but with a jerk limit its acceleration need not be
    jerk = joint.jerk if len(runs) == 1 else None
    return sum(rest_to_rest(run, joint.velocity, joint.acceleration, jerk).duration for run in runs)


def _runs(positions: Array) -> list[float]:
    """Distances between the points where the motion turns back."""
    steps = np.diff(positions)
    steps = steps[np.abs(steps) > MOVES]
    turns = np.flatnonzero(np.diff(np.sign(steps))) + 1
    return [float(np.abs(run).sum()) for run in np.split(steps, turns) if len(run)]


@dataclass(frozen=True, eq=False)
class SCurve:
    """Pieces of linear acceleration: lengths (m,) in s, acceleration at their starts and ends (m,)."""

    lengths: Array
    start: Array
    end: Array

    @property
    def duration(self) -> float:
        return float(self.lengths.sum())

    @property
    def switches(self) -> Array:
        """Times at which the acceleration or its slope jumps, both ends included, (m + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])

    def stretched(self, duration: float) -> SCurve:
        """The same motion in another time."""
        factor = duration / self.duration
        return SCurve(self.lengths * factor, self.start / factor**2, self.end / factor**2)

    def scaled(self, factor: float) -> SCurve:
        """The same motion over `factor` times the distance."""
        return SCurve(self.lengths, self.start * factor, self.end * factor)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration (from the right, at the end from the left) at times t (n,)."""
        piece = self._piece(t)
        return Cubic(*(values[piece] for values in self._pieces)).at_time(t - self.switches[piece])

    def jerk_at(self, t: Array) -> Array:
        """Slope of the acceleration, from the right, at times t (n,)."""
        return np.asarray(((self.end - self.start) / self.lengths)[self._piece(t)])

    @property
    def _pieces(self) -> tuple[Array, ...]:
        """Position, velocity and acceleration at the start, acceleration at the end and length of every piece, (m,) each."""
        begin = np.zeros(len(self.lengths))
        _, gained = Cubic(begin, begin, self.start, self.end, self.lengths).end
        velocity = np.concatenate([[0.0], np.cumsum(gained)[:-1]])
        way, _ = Cubic(begin, velocity, self.start, self.end, self.lengths).end
        return np.concatenate([[0.0], np.cumsum(way)[:-1]]), velocity, self.start, self.end, self.lengths

    def _piece(self, t: Array) -> Indices:
        return np.clip(np.searchsorted(self.switches, t, side="right") - 1, 0, len(self.lengths) - 1)

    @property
    def peaks(self) -> tuple[float, float, float]:
        """Largest velocity, acceleration and jerk (infinite where the acceleration jumps)."""
        _, velocity, _ = self.at(self.switches)
        acceleration = max(np.abs(self.start).max(), np.abs(self.end).max())
        jumps = np.abs(np.append(self.start, 0.0) - np.append(0.0, self.end)).max() > 1e-9 * acceleration
        jerk = math.inf if jumps else float(np.abs((self.end - self.start) / self.lengths).max())
        return float(np.abs(velocity).max()), float(acceleration), jerk


def rest_to_rest(distance: float, velocity: float, acceleration: float, jerk: float | None = None) -> SCurve:
    """The fastest motion over a distance > 0.

    Without a jerk limit a trapezoid of velocity (a triangle where its limit is not reached), with one the profile of up to
    seven pieces, both symmetric in time.
    """
    speed = min(velocity, _reachable_speed(distance, acceleration, jerk))
    if jerk is None:
        lengths, start, end = [speed / acceleration], [acceleration], [acceleration]
    else:
        ramp = min(acceleration / jerk, math.sqrt(speed / jerk))
        peak = jerk * ramp
        flat = max(speed / peak - ramp, 0.0)
        lengths, start, end = [ramp, flat, ramp], [0.0, peak, peak], [peak, peak, 0.0]
    cruise = max(distance / speed - sum(lengths), 0.0)
    all_lengths = np.array([*lengths, cruise, *reversed(lengths)])
    starts, ends = (
        np.array([*start, 0.0, *(-x for x in reversed(end))]),
        np.array([*end, 0.0, *(-x for x in reversed(start))]),
    )
    kept = all_lengths > 1e-13 * all_lengths.sum()
    return SCurve(all_lengths[kept], starts[kept], ends[kept])


def _reachable_speed(distance: float, acceleration: float, jerk: float | None) -> float:
    """Peak speed of the motion that never cruises: v T_ramp(v) = distance."""
    if jerk is None:
        return math.sqrt(distance * acceleration)
    # acceleration limit reached: v (v/a + a/j) = d
    half = acceleration**2 / jerk
    speed = (-half + math.sqrt(half**2 + 4 * acceleration * distance)) / 2
    if speed >= half:
        return speed
    return (distance**2 * jerk / 4) ** (1 / 3)
