"""Motion of one joint between two given velocities in closed form, for the guess of a free motion.

A joint from rest to rest makes its fastest motion, stretched to the duration of the slowest joint.
A joint with a velocity at an end changes it to a peak velocity, cruises (moves at this constant
velocity), and changes to its final velocity. Each change of velocity, at constant acceleration, is
called a ramp. If the peak points against the velocity at an end, the joint reverses near that end.
"""

import math
from dataclasses import replace

import numpy as np

from ssm_planner.planning.lower_bound import (
    BISECTION_STEPS,
    SCurve,
    minimum_times,
    quickest_stop,
    rest_to_rest,
)
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.typing import Array, record


@record
class JointProfile:
    """Family of motions of one joint between two given velocities, one for each duration.

    The joint changes its velocity to a peak, cruises, and changes its velocity again. Jerk is only
    limited in motions from rest to rest, and in motions that begin with a stop.
    """

    displacement: float
    """Displacement, rad or m."""
    speeds: tuple[float, float]
    """Velocities at both ends, rad/s or m/s."""
    velocity: float
    """Limit of the velocity, at least as large as the velocities at both ends."""
    acceleration: float
    """Limit of the acceleration, which all changes of velocity reach."""
    jerk: float
    """Limit of the jerk. Infinite without a limit."""
    sign: float
    """Direction of the peak velocity: +1 or −1."""
    stop: SCurve | None = None
    """Quickest stop with which the motion begins, or None.

    It is only given if the joint must reverse because of its jerk limit. The joint then moves on
    from rest to rest.
    """
    stop_reversals: tuple[float, ...] = ()
    """Times from the start at which the joint reverses during and at the end of this stop, s."""

    @classmethod
    def from_limits(
        cls,
        displacement: float,
        speeds: tuple[float, float],
        limits: Array,
        initial_acceleration: float = 0.0,
    ) -> "JointProfile":
        """Build the profile of a joint from its limits.

        Parameters
        ----------
        displacement : float
            Displacement, rad or m.
        speeds : (float, float)
            Velocities at both ends.
        limits : (3,) array
            Limits of velocity, acceleration and jerk.
        initial_acceleration : float
            Acceleration at the start. It only counts if the jerk is limited.

        Returns
        -------
        JointProfile
            The motions of the joint, with the direction of their peak velocity.
        """
        velocity, acceleration, jerk = limits.tolist()
        sign = _peak_sign(displacement, speeds, acceleration)
        fastest = max(velocity, *map(abs, speeds))
        profile = cls(displacement, speeds, fastest, acceleration, jerk=jerk, sign=sign)
        start, end = speeds
        first_direction = np.sign(start or initial_acceleration)
        if math.isinf(jerk) or not first_direction or end:
            return profile
        stop = quickest_stop(start, initial_acceleration, acceleration, jerk)
        # At its end, the stop brakes against the velocity.
        last_direction = -float(np.sign(stop.start[-1]))
        remaining = displacement - stop.distance
        is_at_target = abs(remaining) <= ROUNDING_TOLERANCE
        sign = last_direction if is_at_target else math.copysign(1.0, remaining)
        is_reversal = [last_direction != first_direction, sign != last_direction]
        if not any(is_reversal):
            return profile
        reversals = stop.switching_times[[1, -1]][is_reversal]
        return replace(profile, sign=sign, stop=stop, stop_reversals=tuple(reversals.tolist()))

    @property
    def is_moving(self) -> bool:
        """True if the joint moves, False if it rests during the whole motion."""
        has_displacement = abs(self.displacement) > ROUNDING_TOLERANCE
        return has_displacement or any(self.speeds) or self.stop is not None

    @property
    def reversal_times(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Times from the start to the first reversals, and from the last reversal to the end, s."""
        if self.stop is not None:
            return self.stop_reversals, ()
        at_start, at_end = (
            (abs(speed) / self.acceleration,) if speed * self.sign < 0 else ()
            for speed in self.speeds
        )
        return at_start, at_end

    @property
    def duration(self) -> float:
        """Smallest duration, s. 0 if the joint does not move."""
        if not self.is_moving:
            return 0.0
        if self.stop is not None:
            return self.stop.duration + self._fastest_from_rest().duration
        if not any(self.speeds):
            return self._fastest_from_rest().duration
        limits = self.velocity, self.acceleration
        return float(minimum_times(self.displacement, *limits, self.speeds))

    def with_duration(self, duration: float) -> SCurve:
        """Return the motion that takes a given duration.

        From rest to rest, it is the fastest motion, stretched in time. Otherwise a bisection finds
        its peak velocity.

        Parameters
        ----------
        duration : float
            Duration, s. If a joint at speed needs more, the result is its fastest motion.

        Returns
        -------
        SCurve
            The motion. A joint whose peak velocity is 0 rests between both ramps. A joint that
            cannot be so slow cruises at its lowest peak velocity, and covers more than the
            displacement. As a guess this suffices.
        """
        if self.stop is not None:
            rest = self._fastest_from_rest().stretched(duration - self.stop.duration)
            return self.stop.followed_by(rest)
        if not any(self.speeds):
            return self._fastest_from_rest().stretched(duration)
        # All velocities and distances count positive in the direction of the peak.
        start, end = (self.sign * speed for speed in self.speeds)
        distance = self.sign * self.displacement
        acceleration = self.acceleration
        # Distance of a stop from the initial velocity and of a start to the final velocity.
        ramp_distance = (start * abs(start) + end * abs(end)) / (2 * acceleration)
        # Peak velocities of the slowest and of the fastest motion. The joint comes to rest in the
        # slowest motion (low = 0) unless the displacement is shorter than the ramps.
        low = math.sqrt(max(ramp_distance - distance, 0.0) * acceleration)
        high = min(
            math.sqrt(max(acceleration * distance + (start**2 + end**2) / 2, 0.0)), self.velocity
        )

        def ramp_and_cruise_times(peak: float) -> tuple[float, float, float]:
            """Return the durations of the first ramp, of cruising and of the last ramp, s."""
            ramps = abs(peak - start) / acceleration, abs(peak - end) / acceleration
            travelled = ramps[0] * (start + peak) / 2 + ramps[1] * (end + peak) / 2
            return ramps[0], max(distance - travelled, 0.0) / peak if peak > 0 else 0.0, ramps[1]

        # A higher peak velocity gives a shorter motion.
        for _ in range(BISECTION_STEPS):
            middle = (low + high) / 2
            low, high = (
                (low, middle) if sum(ramp_and_cruise_times(middle)) < duration else (middle, high)
            )
        ramp_up, cruise, ramp_down = ramp_and_cruise_times(high)
        # Between its ramps, a joint without any distance to cover rests for the remaining time.
        if distance - ramp_distance <= ROUNDING_TOLERANCE:
            cruise = max(duration - ramp_up - ramp_down, 0.0)
        times = np.array([ramp_up, cruise, ramp_down])
        directions = [math.copysign(1.0, high - start), 0.0, math.copysign(1.0, end - high)]
        accelerations = self.sign * acceleration * np.array(directions)
        return SCurve.from_pieces(times, accelerations, accelerations, self.speeds[0])

    def _fastest_from_rest(self) -> SCurve:
        """Return the fastest motion from rest to rest, after the stop if there is one."""
        limits = self.velocity, self.acceleration, self.jerk
        stopped = 0.0 if self.stop is None else self.stop.distance
        return rest_to_rest(abs(self.displacement - stopped), *limits).scaled(self.sign)


def _peak_sign(displacement: float, speeds: tuple[float, float], acceleration: float) -> float:
    """Return the direction +1 or −1 of the peak velocity of a joint.

    It is the sign of the displacement that remains after a stop from the initial velocity and a
    start to the final velocity.

    Parameters
    ----------
    displacement : float
        Displacement, rad or m.
    speeds : (float, float)
        Velocities at both ends.
    acceleration : float
        Acceleration of the changes of velocity, rad/s² or m/s².

    Returns
    -------
    float
        +1 or −1.
    """
    start, end = speeds
    remaining = displacement - (start * abs(start) + end * abs(end)) / (2 * acceleration)
    if start * end > 0 and remaining * start < 0:
        # Both velocities have the same direction, so the joint need not stop in between. It only
        # reverses if the displacement is shorter than a direct change of velocity needs.
        shortest = (start + end) / 2 * abs(end - start) / acceleration
        return math.copysign(1.0, start if (displacement - shortest) * start >= 0 else -start)
    return math.copysign(1.0, remaining if abs(remaining) > ROUNDING_TOLERANCE else end or start)
