"""Reversals and initial guess of a free motion that begins or ends at speed.

A joint that begins at speed brakes, covers the rest of its displacement, and accelerates to its
velocity at the end. If the rest points against the velocity at an end, the joint reverses near that
end, at a position that the solver determines. The reversals of all joints, ordered in time, divide
the motion into segments in which every joint keeps its direction.
"""

import math
from itertools import pairwise

import numpy as np

from ssm_planner.planning.lower_bound import BISECTIONS, SCurve, minimum_times, quickest_stop
from ssm_planner.planning.ocp.segments import SegmentChain, guess_of_curves
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.typing import Array, record

LEAST_SEGMENT = 4e-3
"""Smallest time between two reversals of the guess, as a share of the duration.

The solver may reduce it to a hundredth of that.
"""


@record
class _Profile:
    """Motion of one joint between two given velocities.

    The joint changes its velocity to a peak, cruises, and changes it again, with constant
    accelerations.
    """

    displacement: float
    """Displacement, rad or m."""
    speeds: tuple[float, float]
    """Velocities at both ends, rad/s or m/s."""
    velocity: float
    acceleration: float
    """Limits of velocity and acceleration."""
    sign: float
    """Direction of the peak velocity: +1 or −1."""

    @classmethod
    def from_limits(
        cls, displacement: float, speeds: tuple[float, float], limits: Array
    ) -> "_Profile":
        """Build the profile of a joint.

        Parameters
        ----------
        displacement : float
            Displacement, rad or m.
        speeds : (float, float)
            Velocities at both ends.
        limits : (3,) array
            Limits of velocity and acceleration, and the constant acceleration of `braking`. The
            latter decides whether the joint can stop in time under its jerk limit.
        """
        velocity, acceleration, brake = (float(limit) for limit in limits)
        # If the jerk limit changes the direction of the peak, the profile brakes accordingly.
        sign = _peak_sign(displacement, speeds, brake)
        if sign != _peak_sign(displacement, speeds, acceleration):
            acceleration = brake
        return cls(displacement, speeds, max(velocity, *map(abs, speeds)), acceleration, sign)

    @property
    def moves(self) -> bool:
        """True if the joint moves."""
        return abs(self.displacement) > ROUNDING or any(self.speeds)

    @property
    def reversal_times(self) -> tuple[float, float]:
        """Times in s between either end and the reversal next to it. 0 stands for no reversal."""
        at_start, at_end = (
            abs(speed) / self.acceleration if speed * self.sign < 0 else 0.0
            for speed in self.speeds
        )
        return at_start, at_end

    @property
    def duration(self) -> float:
        """Smallest duration, s. 0 if the joint does not move."""
        return (
            float(minimum_times(self.displacement, self.velocity, self.acceleration, self.speeds))
            if self.moves
            else 0.0
        )

    def with_duration(self, duration: float) -> SCurve:
        """Return the motion that takes a given duration, by a bisection of its peak velocity.

        Parameters
        ----------
        duration : float
            Duration, s. If the joint needs more, the result is its fastest motion.

        Returns
        -------
        SCurve
            The motion. A joint whose peak velocity is 0 rests between both ramps. A joint that
            cannot be so slow cruises at its lowest peak velocity, and covers more than the
            displacement. As a guess this suffices.
        """
        start, end = (self.sign * speed for speed in self.speeds)
        distance = self.sign * self.displacement
        acceleration = self.acceleration
        squares = (start * abs(start) + end * abs(end)) / (2 * acceleration)
        # Peak velocities of the slowest and of the fastest motion.
        low = math.sqrt(max(squares - distance, 0.0) * acceleration)
        high = min(
            math.sqrt(max(acceleration * distance + (start**2 + end**2) / 2, 0.0)), self.velocity
        )

        def phase_lengths(peak: float) -> tuple[float, float, float]:
            """Return the durations of the first ramp, of cruising and of the last ramp, s."""
            ramps = abs(peak - start) / acceleration, abs(peak - end) / acceleration
            travelled = ramps[0] * (start + peak) / 2 + ramps[1] * (end + peak) / 2
            return ramps[0], max(distance - travelled, 0.0) / peak if peak > 0 else 0.0, ramps[1]

        # A higher peak velocity gives a shorter motion.
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (low, middle) if sum(phase_lengths(middle)) < duration else (middle, high)
        ramp_up, cruise, ramp_down = phase_lengths(high)
        cruise = (
            cruise if distance - squares > ROUNDING else max(duration - ramp_up - ramp_down, 0.0)
        )
        accelerations = (
            self.sign
            * acceleration
            * np.array([math.copysign(1.0, high - start), 0.0, math.copysign(1.0, end - high)])
        )
        times = np.array([ramp_up, cruise, ramp_down])
        # Pieces shorter than rounding are left out.
        nonempty = times > 1e-13 * max(duration, times.sum())
        return SCurve(
            times[nonempty], accelerations[nonempty], accelerations[nonempty], self.speeds[0]
        )


def _peak_sign(displacement: float, speeds: tuple[float, float], acceleration: float) -> float:
    """Return the direction +1 or −1 of a joint between its initial and its final acceleration.

    Parameters
    ----------
    displacement : float
        Displacement, rad or m.
    speeds : (float, float)
        Velocities at both ends.
    acceleration : float
        Acceleration at both ends, rad/s² or m/s².
    """
    start, end = speeds
    remaining = displacement - (start * abs(start) + end * abs(end)) / (2 * acceleration)
    if start * end > 0 and remaining * start < 0:
        # Both velocities have the same direction, so the joint need not stop in between. It only
        # reverses if the displacement is shorter than a direct change of velocity needs.
        shortest = (start + end) / 2 * abs(end - start) / acceleration
        return math.copysign(1.0, start if (displacement - shortest) * start >= 0 else -start)
    return math.copysign(1.0, remaining if abs(remaining) > ROUNDING else end or start)


def braking(speed: Array, acceleration: Array, limits: Array) -> Array:
    """Return the constant accelerations that give the stopping distances of the quickest stops.

    The quickest stop of a joint changes its acceleration with the jerk limit. A joint that reverses
    before it stops gets its acceleration limit.

    Parameters
    ----------
    speed, acceleration : (m,) arrays
        Joint velocities q̇ and accelerations q̈ at the beginning of the stop.
    limits : (3, m) array
        Limits of velocity, acceleration and jerk.

    Returns
    -------
    (m,) array
        q̇² / (2 · stopping distance), at most the acceleration limit.
    """
    _, largest_acceleration, jerk = limits
    result = largest_acceleration.copy()
    for k in np.flatnonzero(speed):
        state = float(speed[k]), float(acceleration[k])
        distance = (
            np.sign(speed[k]) * quickest_stop(*state, largest_acceleration[k], jerk[k]).distance
        )
        if distance > 0:
            result[k] = min(speed[k] ** 2 / (2 * distance), largest_acceleration[k])
    return result


def guess_with_reversals(
    start: Array, displacement: Array, speeds: Array, limits: Array, *, count: int, least_count: int
) -> SegmentChain:
    """Build the initial guess of joints that begin or end a motion at speed.

    All joints take the duration of the slowest one.

    Parameters
    ----------
    start : (m,) array
        Joint positions at the start, rad and m.
    displacement : (m,) array
        Displacements, rad and m.
    speeds : (2, m) array
        Joint velocities q̇ at both ends.
    limits : (3, m) array
        Limits of velocity and acceleration, and the constant acceleration of `braking`.
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
        _Profile.from_limits(
            float(joint_displacement), (float(joint_start_speed), float(joint_end_speed)), limit
        )
        for joint_displacement, joint_start_speed, joint_end_speed, limit in zip(
            displacement, *speeds, limits.T, strict=True
        )
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
    # The positions of joints that rest are given, all others only at both ends.
    points = np.array([*(guess.elements.u[0] for guess in guesses), start + displacement])
    fixed = np.tile([not profile.moves for profile in profiles], (len(borders), 1))
    fixed[[0, -1]] = True
    return SegmentChain(points, fixed, directions, tuple(guesses))


def _reversals_in_order(profiles: list[_Profile], duration: float) -> tuple[list[float], Array]:
    """Return the borders between segments in the order of time, and the directions of the joints.

    Parameters
    ----------
    profiles : list of _Profile
        Motions of the m joints.
    duration : float
        Duration of the motion, s.

    Returns
    -------
    borders : list of k + 1 floats
        Start, reversals and end, s. Neighbours have a distance of at least LEAST_SEGMENT ·
        duration.
    directions : (k, m) array
        Direction +1, −1 or 0 of each joint between two borders.
    """
    reversals = [
        (t if side == 0 else max(duration - t, 0.0), i)
        for i, profile in enumerate(profiles)
        for side, t in enumerate(profile.reversal_times)
        if t > 0
    ]
    borders = [0.0]
    directions = [
        [
            profile.sign * (-1.0 if profile.reversal_times[0] else 1.0) if profile.moves else 0.0
            for profile in profiles
        ]
    ]
    # Each reversal begins a segment in which one joint has the other direction.
    for t, i in sorted(reversals):
        borders.append(max(t, borders[-1] + LEAST_SEGMENT * duration))
        directions.append(directions[-1].copy())
        directions[-1][i] *= -1
    borders.append(max(duration, borders[-1] + LEAST_SEGMENT * duration))
    return borders, np.array(directions)
