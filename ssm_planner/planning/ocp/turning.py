"""Where joints turn back on a free motion that begins or ends at speed, and the guess of such a motion.

A joint that begins at a speed brakes, goes the rest of its way, and speeds up to the speed of its end. Where the rest points
against a speed at an end, the joint turns back: at a border whose position is free. The borders of all joints, one after the
other in time, divide the motion into segments in which every joint keeps its direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ssm_planner.planning.lower_bound import SCurve, fastest
from ssm_planner.planning.ocp.mesh import SegmentGuess, elements_between
from ssm_planner.typing import Array, Mask

STANDS = 1e-9
"""Rest of a way (rad, m) that is none."""
GAP = 4e-3
"""Least time from border to border in the guess, as a share of all: it may become a hundredth of that."""
ROUNDS = 60
"""Of bisection."""


@dataclass(frozen=True, eq=False)
class TurningGuess:
    """The segments of a motion between two points."""

    guesses: tuple[SegmentGuess, ...]
    """k."""
    positions: Array
    """q − start at their borders, in the guess, (k + 1, joints)."""
    given: Mask
    """Where these are not free, (k + 1, joints)."""
    directions: Array
    """Of every joint in every segment, (k, joints)."""


@dataclass(frozen=True, eq=False)
class _Profile:
    """One joint from a speed to a speed: at its deceleration to `peak`, and on to the end."""

    way: float
    speeds: tuple[float, float]
    velocity: float
    acceleration: float
    sign: float
    """Of the peak."""

    @classmethod
    def of(cls, way: float, speeds: tuple[float, float], limits: Array) -> _Profile:
        """limits (3,): velocity, acceleration, and the acceleration of `braking`, which tells whether it stops in time."""
        velocity, acceleration, brake = (float(limit) for limit in limits)
        sign = _peak_sign(way, speeds, brake)
        if sign != _peak_sign(way, speeds, acceleration):
            acceleration = brake
        return cls(way, speeds, max(velocity, *map(abs, speeds)), acceleration, sign)

    @property
    def moves(self) -> bool:
        return abs(self.way) > STANDS or any(self.speeds)

    @property
    def turns(self) -> tuple[float, float]:
        """Time from either end at which the joint turns back; 0 where it does not."""
        first, last = (
            abs(speed) / self.acceleration if speed * self.sign < 0 else 0.0
            for speed in self.speeds
        )
        return first, last

    @property
    def duration(self) -> float:
        """The least, s."""
        return (
            fastest(self.way, self.velocity, self.acceleration, self.speeds) if self.moves else 0.0
        )

    def lasting(self, duration: float) -> SCurve:
        """The motion that takes so long; the slowest there is where none does."""
        begin, end = (self.sign * speed for speed in self.speeds)
        way, a = self.sign * self.way, self.acceleration
        squares = (begin * abs(begin) + end * abs(end)) / (2 * a)
        low = math.sqrt(max(squares - way, 0.0) * a)
        high = min(math.sqrt(max(a * way + (begin**2 + end**2) / 2, 0.0)), self.velocity)

        def lengths(peak: float) -> tuple[float, float, float]:
            ramps = abs(peak - begin) / a, abs(peak - end) / a
            travelled = ramps[0] * (begin + peak) / 2 + ramps[1] * (end + peak) / 2
            return ramps[0], max(way - travelled, 0.0) / peak if peak > 0 else 0.0, ramps[1]

        for _ in range(ROUNDS):
            middle = (low + high) / 2
            low, high = (low, middle) if sum(lengths(middle)) < duration else (middle, high)
        first, cruise, last = lengths(high)
        cruise = cruise if way - squares > STANDS else max(duration - first - last, 0.0)
        pulls = (
            self.sign
            * a
            * np.array([math.copysign(1.0, high - begin), 0.0, math.copysign(1.0, end - high)])
        )
        parts = np.array([first, cruise, last])
        kept = parts > 1e-13 * max(duration, parts.sum())
        return SCurve(parts[kept], pulls[kept], pulls[kept], self.speeds[0])


def _peak_sign(way: float, speeds: tuple[float, float], acceleration: float) -> float:
    """Direction between braking from the first speed and speeding up to the last."""
    begin, end = speeds
    rest = way - (begin * abs(begin) + end * abs(end)) / (2 * acceleration)
    if (
        begin * end > 0 and rest * begin < 0
    ):  # it need not stop on its way, unless that is too short even so
        direct = (begin + end) / 2 * abs(end - begin) / acceleration
        return math.copysign(1.0, begin if (way - direct) * begin >= 0 else -begin)
    return math.copysign(1.0, rest if abs(rest) > STANDS else end or begin)


def braking(speed: Array, pull: Array, limits: Array) -> Array:
    """The constant accelerations (m,) that stop joints over the way that their quickest stops take.

    From q̇ and q̈ (m,) under limits (3, m) of velocity, acceleration and jerk. A joint that turns back before its acceleration
    has ended has its limit.
    """
    _, most, jerk = limits
    sign = np.where(speed < 0, -1.0, 1.0)
    v, a = sign * speed, sign * pull
    peak = np.minimum(np.sqrt(np.maximum(jerk * v + a**2 / 2, 0.0)), most)
    rise, fall = np.maximum((a + peak) / jerk, 0.0), peak / jerk
    flat = np.maximum(v + (a**2 - 2 * peak**2) / (2 * jerk), 0.0) / np.where(peak > 0, peak, 1.0)
    way = v * rise + a * rise**2 / 2 - jerk * rise**3 / 6
    v = v + a * rise - jerk * rise**2 / 2
    way += v * flat - peak * flat**2 / 2
    v = v - peak * flat
    way += v * fall - peak * fall**2 / 2 + jerk * fall**3 / 6
    return np.where(
        (way > 0) & (speed != 0),
        np.minimum(speed**2 / (2 * np.where(way > 0, way, 1.0)), most),
        most,
    )


def turning_guess(
    way: Array, speeds: tuple[Array, Array], limits: Array, *, count: int, fewest: int
) -> TurningGuess:
    """For joints that move by `way` (m,) from one q̇ (m,) to another under limits (3, m): velocity, acceleration, `braking`.

    About `count` elements, at least `fewest` between two switching points.
    """
    joints = range(len(way))
    profiles = [
        _Profile.of(float(way[i]), (float(speeds[0][i]), float(speeds[1][i])), limits[:, i])
        for i in joints
    ]
    duration = max(profile.duration for profile in profiles)
    curves = [profile.lasting(duration) if profile.moves else None for profile in profiles]
    ends = [(t, i, side) for i in joints for side, t in enumerate(profiles[i].turns) if t > 0]
    turns = sorted((t if side == 0 else max(duration - t, 0.0), i, side) for t, i, side in ends)
    borders = [0.0]
    for t, _, _ in turns:
        borders.append(max(t, borders[-1] + GAP * duration))
    borders.append(max(duration, borders[-1] + GAP * duration))
    direction = np.array(
        [
            0.0 if not profile.moves else profile.sign * (-1.0 if profile.turns[0] else 1.0)
            for profile in profiles
        ]
    )
    directions = [direction.copy()]
    for _, i, _ in turns:
        direction[i] *= -1
        directions.append(direction.copy())
    leader = max((i for i in joints if curves[i] is not None), key=lambda i: profiles[i].duration)
    switches = curves[leader].switches  # type: ignore[union-attr]
    guesses = []
    for start, end in pairwise(borders):
        instants = [start]
        for t in switches:
            if instants[-1] + GAP * duration < t < end - GAP * duration:
                instants.append(float(t))
        guesses.append(_guess_between(curves, [*instants, end], count / borders[-1], fewest))
    positions = np.array(
        [
            [0.0 if curve is None else float(curve.at(np.array([t]))[0][0]) for curve in curves]
            for t in borders
        ]
    )
    positions[-1] = way
    given = np.tile([not profile.moves for profile in profiles], (len(borders), 1))
    given[[0, -1]] = True
    return TurningGuess(tuple(guesses), positions, given, np.array(directions))


def _guess_between(
    curves: list[SCurve | None], switches: list[float], density: float, fewest: int
) -> SegmentGuess:
    """The part of a motion between the first and the last of some instants, with so many elements a second."""
    arcs, t = elements_between(switches, density, fewest)
    middle, size = (t[1:] + t[:-1]) / 2, (len(t) - 1, len(curves))
    states = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    for i, curve in enumerate(curves):
        if curve is None:
            continue
        q, qd, _ = curve.at(t[:-1])
        qdd = curve.at(middle)[2]
        for state, value in zip(states, (q - q[0], qd, qdd, qdd), strict=True):
            state[:, i] = value
    return SegmentGuess(switches[-1] - switches[0], t - t[0], states, arcs)
