"""Motion of one joint between two points in closed form, for the initial guess of a free motion.

The velocities of the joint at both points are given. There are three cases:

- A joint that moves from rest to rest makes its fastest motion, stretched in time to the duration
  of the slowest joint.
- A joint with limited jerk that must reverse because of its velocity and acceleration at the start
  begins with its quickest stop. It then moves from rest to rest.
- Any other joint changes its velocity to a peak velocity, cruises (moves at this constant
  velocity), and changes to its final velocity. Each change of velocity takes place at constant
  acceleration and is called a ramp. If the peak velocity and the velocity at an end have opposite
  directions, the joint reverses near that end.
"""

import math
from dataclasses import replace

import numpy as np

from ssm_planner.planning.lower_bound import (
    SCurve,
    minimum_times,
    quickest_stop,
    rest_to_rest,
)
from ssm_planner.planning.retiming.paths import find_sign_change
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.typing import Array, record


@record
class JointProfile:
    """Family of motions of one joint over a given displacement, one motion for each duration.

    The joint changes its velocity to a peak, cruises at this velocity, and changes its velocity
    again. Jerk is only limited in motions from rest to rest, and in the prelude.

    With a jerk limit, a joint that begins at speed or with an acceleration, and must reverse, has a
    prelude: its quickest stop. The other fields describe the motion after the prelude. Without a
    reversal, the profile ignores the initial acceleration.
    """

    displacement: float
    """Displacement, rad or m."""
    speeds: tuple[float, float]
    """Velocities at the start and at the end, rad/s or m/s."""
    velocity: float
    """Limit of |q̇|, rad/s or m/s. It is at least as large as |q̇| at both ends."""
    acceleration: float
    """Limit of |q̈|, rad/s² or m/s². All changes of velocity of a joint at speed reach it."""
    jerk: float
    """Limit of |q⃛|, rad/s³ or m/s³. Infinite without a limit."""
    sign: float
    """Direction of the peak velocity: +1 or −1."""
    prelude: SCurve | None = None
    """Motion with limited jerk before the profile."""
    prelude_reversals: tuple[float, ...] = ()
    """Times from the start at which the joint reverses during and at the end of the prelude, s."""

    @classmethod
    def from_limits(
        cls,
        displacement: float,
        speeds: tuple[float, float],
        limits: Array,
        initial_acceleration: float = 0.0,
    ) -> "JointProfile":
        """Build the motions of a joint from its displacement, its velocities and its limits.

        Parameters
        ----------
        displacement : float
            Displacement, rad or m.
        speeds : (float, float)
            Velocities at the start and at the end, rad/s or m/s.
        limits : (3,) array
            Limits of velocity, acceleration and jerk, in SI units.
        initial_acceleration : float
            Acceleration at the start, rad/s² or m/s². It only counts if the jerk is limited.

        Returns
        -------
        JointProfile
            The motions, with the direction of their peak velocity.
        """
        velocity, acceleration, jerk = limits.tolist()
        # A given velocity may exceed the limit by rounding, so the limit is raised to it.
        fastest = max(velocity, *map(abs, speeds))
        sign = _peak_sign(displacement, speeds, acceleration)
        profile = cls(displacement, speeds, fastest, acceleration, jerk=jerk, sign=sign)
        start, end = speeds
        if math.isinf(jerk) or end or not (start or initial_acceleration):
            return profile
        first_direction = math.copysign(1.0, start or initial_acceleration)
        prelude = quickest_stop(start, initial_acceleration, acceleration, jerk)
        # The last piece of the stop brakes, so its velocity has the opposite sign of its
        # acceleration.
        last_direction = -math.copysign(1.0, prelude.start[-1])
        remaining = displacement - prelude.distance
        is_at_target = abs(remaining) <= ROUNDING_TOLERANCE
        sign = last_direction if is_at_target else math.copysign(1.0, remaining)
        # The joint may reverse at the end of the first piece of the stop, and at the end of the
        # whole stop.
        is_reversal = [last_direction != first_direction, sign != last_direction]
        reversals = tuple(prelude.switching_times[[1, -1]][is_reversal].tolist())
        if not reversals:
            return profile
        return replace(
            profile,
            displacement=remaining,
            speeds=(0.0, 0.0),
            sign=sign,
            prelude=prelude,
            prelude_reversals=reversals,
        )

    @property
    def is_moving(self) -> bool:
        """True if the joint moves, False if it rests during the whole motion."""
        has_displacement = abs(self.displacement) > ROUNDING_TOLERANCE
        return has_displacement or any(self.speeds) or self.prelude is not None

    @property
    def reversal_times(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Times from the start to the first reversals, and from the last reversal to the end, s.

        A joint reverses near an end if its velocity there points against its peak velocity. The
        time is that of a stop from this velocity. A joint may also reverse during its prelude and
        at the end of it. Each of the two tuples is empty if the joint does not reverse near that
        end.
        """
        at_start, at_end = (
            (abs(speed) / self.acceleration,) if speed * self.sign < 0 else ()
            for speed in self.speeds
        )
        return self.prelude_reversals or at_start, at_end

    @property
    def duration(self) -> float:
        """Smallest duration of a motion of this family, s. 0 if the joint does not move."""
        prelude = 0.0 if self.prelude is None else self.prelude.duration
        if any(self.speeds):
            limits = self.velocity, self.acceleration
            return prelude + float(minimum_times(self.displacement, *limits, self.speeds))
        if abs(self.displacement) <= ROUNDING_TOLERANCE:
            return prelude
        return prelude + self._fastest_from_rest().duration

    def with_duration(self, duration: float) -> SCurve:
        """Compute the motion that takes a given duration.

        From rest to rest, it is the fastest motion, stretched in time. Otherwise a search finds
        the peak velocity for which the ramps (changes of velocity) and the cruise (motion at the
        peak velocity) take this duration together.

        Parameters
        ----------
        duration : float
            Duration, s. If a joint with a velocity at an end needs more, the result is its fastest
            motion.

        Returns
        -------
        SCurve
            The motion. If a stop and a start cover exactly the displacement, the joint rests in
            between. If they cover more, the joint cannot stop. It then cruises at its lowest peak
            velocity until the duration has passed, and moves too far. As a guess this suffices.
        """
        if self.prelude is not None:
            profile = replace(self, prelude=None)
            if not profile.is_moving:
                return self.prelude.followed_by_rest(duration)
            return self.prelude.followed_by(profile.with_duration(duration - self.prelude.duration))
        if not any(self.speeds):
            return self._fastest_from_rest().stretched(duration)
        # All velocities and distances count positive in the direction of the peak.
        start, end = (self.sign * speed for speed in self.speeds)
        distance = self.sign * self.displacement
        acceleration = self.acceleration
        # Signed distance of a stop from the initial velocity and of a start to the final velocity.
        ramp_distance = (start * abs(start) + end * abs(end)) / (2 * acceleration)
        # Peak velocities of the slowest and of the fastest motion. In the slowest motion the joint
        # comes to rest (low = 0), unless the displacement is shorter than `ramp_distance`. Without
        # a cruise, both ramps cover (peak² − (start² + end²)/2) / acceleration if the peak is above
        # both velocities, and the negative of this if it is below. Solved for the peak, this gives
        # `high` and `low`.
        low = math.sqrt(max(ramp_distance - distance, 0.0) * acceleration)
        high = min(
            math.sqrt(max(acceleration * distance + (start**2 + end**2) / 2, 0.0)), self.velocity
        )

        def ramp_and_cruise_times(peaks: Array) -> Array:
            """Return the durations of the first ramp, of the cruise and of the last ramp, s.

            The function reads `start`, `end`, `distance` and `acceleration` from the enclosing
            method.

            Parameters
            ----------
            peaks : (n,) array
                Peak velocities ≥ 0 in the direction `sign`, rad/s or m/s.

            Returns
            -------
            (3, n) array
                Durations.
            """
            ramp_up, ramp_down = (np.abs(peaks - speed) / acceleration for speed in (start, end))
            travelled = ramp_up * (start + peaks) / 2 + ramp_down * (end + peaks) / 2
            cruise = np.maximum(distance - travelled, 0.0) / np.maximum(peaks, 1e-300)
            return np.array([ramp_up, cruise, ramp_down])

        # A higher peak velocity gives a shorter motion.
        peak = find_sign_change(
            lambda peaks: ramp_and_cruise_times(peaks).sum(axis=0) - duration, low, high
        )
        ramp_up, cruise, ramp_down = ramp_and_cruise_times(np.array([peak]))[:, 0]
        # If a stop and a start already cover the displacement, the middle piece fills the remaining
        # time: the joint rests, or cruises too far.
        if distance - ramp_distance <= ROUNDING_TOLERANCE:
            cruise = max(duration - ramp_up - ramp_down, 0.0)
        times = np.array([ramp_up, cruise, ramp_down])
        directions = [math.copysign(1.0, peak - start), 0.0, math.copysign(1.0, end - peak)]
        accelerations = self.sign * acceleration * np.array(directions)
        return SCurve.from_pieces(times, accelerations, accelerations, self.speeds[0])

    def _fastest_from_rest(self) -> SCurve:
        """Return the fastest motion from rest to rest over the displacement."""
        limits = self.velocity, self.acceleration, self.jerk
        return rest_to_rest(abs(self.displacement), *limits).scaled(self.sign)


def _peak_sign(displacement: float, speeds: tuple[float, float], acceleration: float) -> float:
    """Determine the direction of the peak velocity of a joint.

    It is the direction in which the joint must still move if it stops from its initial velocity and
    starts to its final velocity. The exception is a joint whose two velocities have the same
    direction: it need not stop in between.

    Parameters
    ----------
    displacement : float
        Displacement, rad or m.
    speeds : (float, float)
        Velocities at the start and at the end, rad/s or m/s.
    acceleration : float
        Magnitude of the acceleration while the velocity changes, rad/s² or m/s².

    Returns
    -------
    float
        +1 or −1.
    """
    start, end = speeds
    # A stop from the velocity v covers v |v| / (2 a), and so does a start to v.
    remaining = displacement - (start * abs(start) + end * abs(end)) / (2 * acceleration)
    if start * end > 0 and remaining * start < 0:
        # Both velocities have the same direction, but the displacement is too short for a stop in
        # between. The joint reverses only if the displacement is also shorter than the distance of
        # a direct change of velocity.
        shortest = (start + end) / 2 * abs(end - start) / acceleration
        return math.copysign(1.0, start if (displacement - shortest) * start >= 0 else -start)
    # If no displacement remains, the joint keeps the direction of a velocity at an end.
    return math.copysign(1.0, remaining if abs(remaining) > ROUNDING_TOLERANCE else end or start)
