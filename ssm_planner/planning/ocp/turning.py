"""Reversals and guess of a free motion that begins or ends at speed.

A joint that begins at speed brakes, covers the rest of its displacement, and accelerates to its
velocity at the end. If the rest points against the velocity at an end, the joint reverses there, at
a border whose position is free. The borders of all joints, ordered in time, divide the motion into
segments in which every joint keeps its direction.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ssm_planner.planning.lower_bound import BISECTIONS, SCurve, minimum_times, quickest_stop
from ssm_planner.planning.ocp.segments import SegmentChain, guess_of_curves
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.typing import Array, record

LEAST_SEGMENT = 4e-3
"""Smallest time between two borders of the guess, as a share of the duration.

The solver may reduce it to a hundredth.
"""


@record
class _Profile:
    """Motion of one joint between two velocities: decelerate to a peak, cruise, and end."""

    displacement: float
    speeds: tuple[float, float]
    velocity: float
    acceleration: float
    sign: float
    """Sign of the peak."""

    @classmethod
    def from_limits(
        cls, displacement: float, speeds: tuple[float, float], limits: Array
    ) -> _Profile:
        """Build a profile from limits (3,) on velocity, acceleration, and that of `braking`.

        The last one decides whether the joint stops in time.
        """
        velocity, acceleration, brake = (float(limit) for limit in limits)
        sign = _peak_sign(displacement, speeds, brake)
        if sign != _peak_sign(displacement, speeds, acceleration):
            acceleration = brake
        return cls(displacement, speeds, max(velocity, *map(abs, speeds)), acceleration, sign)

    @property
    def moves(self) -> bool:
        """True if the joint moves."""
        return abs(self.displacement) > ROUNDING or any(self.speeds)

    @property
    def turns(self) -> tuple[float, float]:
        """Times between either end and the reversal next to it. 0 if there is none."""
        at_start, at_end = (
            abs(speed) / self.acceleration if speed * self.sign < 0 else 0.0
            for speed in self.speeds
        )
        return at_start, at_end

    @property
    def duration(self) -> float:
        """Smallest duration, s."""
        return (
            float(minimum_times(self.displacement, self.velocity, self.acceleration, self.speeds))
            if self.moves
            else 0.0
        )

    def with_duration(self, duration: float) -> SCurve:
        """Return the motion that takes `duration` seconds, or else the slowest one."""
        start, end = (self.sign * speed for speed in self.speeds)
        distance = self.sign * self.displacement
        a = self.acceleration
        squares = (start * abs(start) + end * abs(end)) / (2 * a)
        low = math.sqrt(max(squares - distance, 0.0) * a)
        high = min(math.sqrt(max(a * distance + (start**2 + end**2) / 2, 0.0)), self.velocity)

        def lengths(peak: float) -> tuple[float, float, float]:
            ramps = abs(peak - start) / a, abs(peak - end) / a
            travelled = ramps[0] * (start + peak) / 2 + ramps[1] * (end + peak) / 2
            return ramps[0], max(distance - travelled, 0.0) / peak if peak > 0 else 0.0, ramps[1]

        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (low, middle) if sum(lengths(middle)) < duration else (middle, high)
        ramp_up, cruise, ramp_down = lengths(high)
        cruise = (
            cruise if distance - squares > ROUNDING else max(duration - ramp_up - ramp_down, 0.0)
        )
        pulls = (
            self.sign
            * a
            * np.array([math.copysign(1.0, high - start), 0.0, math.copysign(1.0, end - high)])
        )
        times = np.array([ramp_up, cruise, ramp_down])
        nonempty = times > 1e-13 * max(duration, times.sum())
        return SCurve(times[nonempty], pulls[nonempty], pulls[nonempty], self.speeds[0])


def _peak_sign(displacement: float, speeds: tuple[float, float], acceleration: float) -> float:
    """Return the direction of motion between initial braking and final acceleration."""
    start, end = speeds
    remaining = displacement - (start * abs(start) + end * abs(end)) / (2 * acceleration)
    if (
        start * end > 0 and remaining * start < 0
    ):  # The joint need not stop on its way, unless the displacement is too short even so.
        direct = (start + end) / 2 * abs(end - start) / acceleration
        return math.copysign(1.0, start if (displacement - direct) * start >= 0 else -start)
    return math.copysign(1.0, remaining if abs(remaining) > ROUNDING else end or start)


def braking(speed: Array, acceleration: Array, limits: Array) -> Array:
    """Return the constant accelerations (m,) that stop joints as soon as their quickest stops.

    The joints have q̇ and q̈ (m,). `limits` (3, m) are those of velocity, acceleration and jerk. A
    joint that reverses before its acceleration has ended gets its acceleration limit.
    """
    _, strongest, jerk = limits
    result = strongest.copy()
    for k in np.flatnonzero(speed):
        state = float(speed[k]), float(acceleration[k])
        distance = np.sign(speed[k]) * quickest_stop(*state, strongest[k], jerk[k]).distance
        if distance > 0:
            result[k] = min(speed[k] ** 2 / (2 * distance), strongest[k])
    return result


def guess_with_reversals(
    start: Array, displacement: Array, speeds: Array, limits: Array, *, count: int, least_count: int
) -> SegmentChain:
    """Return the guess for joints that move by `displacement` (m,) between two q̇ (m,).

    Parameters
    ----------
    start : (m,) array
        Joints at the start.
    displacement : (m,) array
        Displacements in rad and m.
    speeds : (2, m) array
        q̇ at both ends.
    limits : (3, m) array
        Limits on velocity and acceleration, and the acceleration of `braking`.
    count : int
        Approximate number of elements.
    least_count : int
        Smallest number of elements between two switching points.

    Returns
    -------
    SegmentChain
        Segments between the reversals of all joints.
    """
    profiles = [
        _Profile.from_limits(float(way), (float(first), float(last)), limit)
        for way, first, last, limit in zip(displacement, *speeds, limits.T, strict=True)
    ]
    slowest = max(
        (profile for profile in profiles if profile.moves), key=lambda profile: profile.duration
    )
    duration = slowest.duration
    gap = LEAST_SEGMENT * duration
    curves = [profile.with_duration(duration) if profile.moves else None for profile in profiles]
    borders, directions = _reversals_in_order(profiles, duration)
    switches = slowest.with_duration(duration).switches
    guesses = []
    for begin, end in pairwise(borders):
        instants = [begin]
        for t in switches:
            if instants[-1] + gap < t < end - gap:
                instants.append(float(t))
        guesses.append(
            guess_of_curves(
                start,
                curves,
                [*instants, end],
                density=count / borders[-1],
                least_count=least_count,
            )
        )
    points = np.array([*(guess.elements.u[0] for guess in guesses), start + displacement])
    fixed = np.tile([not profile.moves for profile in profiles], (len(borders), 1))
    fixed[[0, -1]] = True
    return SegmentChain(points, fixed, directions, tuple(guesses))


def _reversals_in_order(profiles: list[_Profile], duration: float) -> tuple[list[float], Array]:
    """Return the borders (k + 1), s, where joints reverse, and the directions between them, (k, m).

    Both ends are borders too. Neighbouring borders keep a distance of LEAST_SEGMENT.
    """
    ends = [
        (t if side == 0 else max(duration - t, 0.0), i)
        for i, profile in enumerate(profiles)
        for side, t in enumerate(profile.turns)
        if t > 0
    ]
    borders = [0.0]
    directions = [
        [
            profile.sign * (-1.0 if profile.turns[0] else 1.0) if profile.moves else 0.0
            for profile in profiles
        ]
    ]
    for t, i in sorted(ends):
        borders.append(max(t, borders[-1] + LEAST_SEGMENT * duration))
        directions.append(directions[-1].copy())
        directions[-1][i] *= -1
    borders.append(max(duration, borders[-1] + LEAST_SEGMENT * duration))
    return borders, np.array(directions)
