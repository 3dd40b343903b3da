"""Lower bounds on durations, and motions of a single joint, in closed form.

A lower bound considers each joint, and each limited task rate, as if it moved alone. The search
over candidates (ways to move) compares these bounds (`Phase.lower_bound`). `SCurve` is a motion of
one joint with limited jerk. `rest_to_rest` and `quickest_stop` build the fastest ones.
"""

import math
from functools import cached_property

import numpy as np

from ssm_planner.elements.rows import UNLIMITED
from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.problem import TASK_COORDINATES, Robot, TaskLimits, TipSpeed
from ssm_planner.trajectory import CubicPiece
from ssm_planner.typing import Array, Indices, record


def lower_bound(
    robot: Robot,
    points: Array,
    speeds: Array | None = None,
    limits: TaskLimits = TaskLimits(),  # noqa: B008  frozen
) -> float:
    """Return a lower bound on the duration of any motion through given joint positions, s.

    A via point is a position between start and end. The bound is the larger of two numbers:

    - the time that the slowest joint, moving alone, needs through all points;
    - a sum over the segments between consecutive points. Each term is the time that the slowest
      joint needs alone, with the most favourable velocities at the via points, or the time that the
      tip needs for a straight line at its largest speed.

    The limits on the rate of depth and on the tip speed also limit joint 4, which inserts the tool.

    Parameters
    ----------
    robot : Robot
        The robot with the limits of its joints.
    points : (k + 1, 4) array
        Joint positions at the ends and at the via points, rad and m.
    speeds : (2, 4) array, optional
        Joint velocities q̇ at both ends, rad/s and m/s. The default is 0.
    limits : TaskLimits
        Limits on task rates and on the tip speed.

    Returns
    -------
    float
        Duration, s.
    """
    velocity, acceleration, jerk = kinematic_limits(robot, limits)
    ends = np.zeros((2, 4)) if speeds is None else speeds
    through_all = max(
        _single_joint_time(*joint)
        for joint in zip(points.T, ends.T, velocity, acceleration, jerk, strict=True)
    )
    # NaN stands for a free velocity at a via point.
    at_points = np.insert(ends, 1, np.full((len(points) - 2, 4), np.nan), axis=0)
    segments = minimum_times(
        np.diff(points, axis=0), velocity, acceleration, (at_points[:-1], at_points[1:])
    )
    tips = tip_position(Mechanism.from_robot(robot), points)
    tip_times = np.linalg.norm(np.diff(tips, axis=0), axis=1) / _tip_speed(limits)
    return max(through_all, float(np.maximum(segments.max(axis=1), tip_times).sum()))


def slowest_joint_times(
    robot: Robot, displacements: Array, distances: Array, limits: TaskLimits
) -> Array:
    """Return the shortest times of motions from rest to rest if each joint moves alone.

    The slowest joint determines the time, or the tip at its largest speed. The search for a short
    order of the spots of a scan uses these times as distances.

    Parameters
    ----------
    robot : Robot
        The robot with the limits of its joints.
    displacements : (..., 4) array
        Displacements of the joints, rad and m.
    distances : (...) array
        Distances that the tip covers, m.
    limits : TaskLimits
        Limits on the rate of depth and on the tip speed.

    Returns
    -------
    (...) array
        Times, s.
    """
    times = rest_to_rest_times(np.abs(displacements), *kinematic_limits(robot, limits)).max(axis=-1)
    return np.maximum(times, distances / _tip_speed(limits))


def _tip_speed(limits: TaskLimits) -> float:
    """Return the largest speed of the tip, m/s. Infinite without a limit."""
    return next((limit.largest for limit in limits.speeds if isinstance(limit, TipSpeed)), math.inf)


def kinematic_limits(robot: Robot, limits: TaskLimits) -> Array:
    """Return the largest velocity, acceleration and jerk of every joint.

    Joint 4 moves the tool along its axis, so the limits of the tip speed and of the rate of depth
    also limit its velocity.

    Parameters
    ----------
    robot : Robot
        The robot with its joint limits.
    limits : TaskLimits
        Limits of the motion of the tool.

    Returns
    -------
    (3, 4) array
        Rows for velocity, acceleration and jerk, in rad (joints 1 to 3) or m (joint 4) and s. A
        missing limit is infinite.
    """
    joints = [
        (joint.velocity, joint.acceleration, joint.jerk or math.inf) for joint in robot.joints
    ]
    result = np.array(joints).T
    result[0, 3] = min(result[0, 3], _tip_speed(limits), limits.rates.get("depth", math.inf))
    return result


def _single_joint_time(
    positions: Array, speeds: Array, velocity: float, acceleration: float, jerk: float
) -> float:
    """Return the shortest time in which one joint passes through given positions, s.

    A joint is at rest where it reverses. If it cannot stop at the first or last of its reversals
    because of its velocity at an end, it reverses beyond the point. The limit of jerk only counts
    if the joint moves in one direction from rest to rest, because the acceleration need not be zero
    at a reversal.

    Parameters
    ----------
    positions : (k + 1,) array
        Positions, rad or m.
    speeds : (2,) array
        Velocities at both ends, rad/s or m/s.
    velocity, acceleration, jerk : float
        Limits of the joint, in the unit of the positions and s.

    Returns
    -------
    float
        Duration, s.
    """
    steps = np.diff(positions)
    steps = steps[np.abs(steps) > ROUNDING_TOLERANCE]
    # A run is the displacement between two reversals. Runs replace the steps between points.
    reversals = np.flatnonzero(steps[1:] * steps[:-1] < 0) + 1
    runs = np.add.reduceat(steps, np.append(0, reversals)) if len(steps) else np.zeros(1)
    if len(runs) == 1 and not speeds.any():
        return float(rest_to_rest_times(np.abs(runs), velocity, acceleration, jerk)[0])
    starts, ends = np.zeros((2, len(runs)))
    starts[0], ends[-1] = speeds
    if len(runs) > 1:
        sign = np.sign(runs)
        # The first and the last run cover at least the distance v²/(2a) that a stop from v needs.
        to_stop = np.maximum(np.maximum(sign * starts, sign * ends), 0.0) ** 2 / (2 * acceleration)
        runs = sign * np.maximum(np.abs(runs), to_stop)
    return float(minimum_times(runs, velocity, acceleration, (starts, ends)).sum())


def rate_bound(robot: Robot, ends: Array, rates: Array, limits: TaskLimits) -> float:
    """Return a lower bound on a duration that follows from limits on rates of task coordinates, s.

    It is the longest time that one of the limited angles would need alone. If the joint limits
    bound its angular acceleration, the time also includes the change of rate at both ends. Depth
    needs no such bound, because `lower_bound` treats its rate as the velocity of joint 4.

    Parameters
    ----------
    robot : Robot
        The robot with the limits of its joints.
    ends : (2, 4) array
        Task coordinates at the start and at the end, rad and m.
    rates : (2, 4) array
        Rates of the task coordinates at both ends, rad/s and m/s.
    limits : TaskLimits
        Limits on task rates and on the range of tilt.

    Returns
    -------
    float
        Duration, s. 0 if no rate of an angle is limited.
    """
    times = [0.0]
    for name, rate in limits.rates.items():
        if name != "depth":
            k = TASK_COORDINATES.index(name)
            acceleration = angular_acceleration_bound(robot, name, limits)
            distance, speeds = ends[1, k] - ends[0, k], (rates[0, k], rates[1, k])
            times.append(float(minimum_times(distance, rate, acceleration, speeds)))
    return max(times)


def angular_acceleration_bound(robot: Robot, name: str, limits: TaskLimits) -> float:
    """Return an upper bound on the angular acceleration of a task coordinate, rad/s².

    The bound holds for all joint positions in the range of tilt, and for all velocities and
    accelerations within the limits of the joints. Let θ1, θ2, θ3 be the revolute joints, α and β
    the angles between the axes of joints 1 and 2 and of joint 2 and the tool, ψ the roll and φ the
    tilt. The tool axis moves about joint 2 on a circle of radius sin β. The tilt φ and the azimuth
    ζ = ψ − θ1 are therefore functions of θ2 alone. Primes are derivatives by θ2:

        |φ'| ≤ sin β,           |φ''| ≤ (sin β + |cos φ| sin² β) / sin φ,
        |ζ'| ≤ sin β / sin φ,   |ζ''| ≤ (sin β + 2 |cos φ| sin² β / sin φ) / sin φ.

    For example, ψ̈ = θ̈1 + ζ' θ̈2 + ζ'' θ̇2². For spin, θ3 takes the place of θ1, and α that of β.

    Parameters
    ----------
    robot : Robot
        The robot with its geometry and limits.
    name : str
        "roll", "tilt" or "spin".
    limits : TaskLimits
        Limits with the range of tilt.

    Returns
    -------
    float
        The bound. `UNLIMITED` if the range of tilt contains 0 or ±π, where roll and spin are
        singular.
    """
    mechanism = Mechanism.from_robot(robot)
    first, second, third, _ = robot.joints
    low, high = limits.ranges.get("tilt", (-math.pi, math.pi))
    if not (-math.pi < low < high < 0 or 0 < low < high < math.pi):
        return UNLIMITED
    # The sine has its minimum over the range at one of the ends.
    smallest_sine = min(abs(math.sin(low)), abs(math.sin(high)))
    radius = math.sin(mechanism.alpha if name == "spin" else mechanism.beta)
    # Factors in the bounds of the docstring: |first derivative| ≤ radius · slope, and
    # |second derivative| ≤ (radius + curvature · radius²) / sin φ, with |cos φ| ≤ 1.
    slope, curvature = (1.0, 1.0) if name == "tilt" else (1 / smallest_sine, 2 / smallest_sine)
    second_joint_term = radius * slope * second.acceleration
    velocity_term = (radius + curvature * radius**2) / smallest_sine * second.velocity**2
    same_axis_term = {"roll": first.acceleration, "tilt": 0.0, "spin": third.acceleration}[name]
    return second_joint_term + velocity_term + same_axis_term


def minimum_times(
    distance: Array | float,
    velocity: Array | float,
    acceleration: Array | float,
    speeds: tuple[Array | float, Array | float] = (0.0, 0.0),
) -> Array:
    """Return the shortest times over given distances with limited velocity and acceleration.

    A joint that starts too fast to stop within its distance moves beyond it and returns. All
    arguments broadcast.

    Parameters
    ----------
    distance : array
        Signed distances, rad or m.
    velocity, acceleration : array
        Limits. If a velocity at an end exceeds its limit, the limit is raised to it.
    speeds : (array, array)
        Signed velocities at the start and at the end. NaN stands for a free velocity, which is then
        as large as the distance and the limit allow.

    Returns
    -------
    array of the broadcast shape
        Times, s.
    """
    # All motions are mirrored to positive distances.
    sign = np.where(np.asarray(distance) < 0, -1.0, 1.0)
    distance = sign * distance
    start, end = (sign * speed for speed in speeds)
    # A free velocity at one end is the largest one that the joint can reach from the other end. If
    # both ends are free, it is the limit, because fmin and fmax ignore NaN.
    known = np.where(np.isnan(start), end, start)
    reachable = np.sqrt(np.maximum(known**2 + 2 * acceleration * distance, 0.0))
    free_speed = np.fmin(reachable, np.fmax(velocity, np.abs(known)))
    start, end = (np.where(np.isnan(speed), free_speed, speed) for speed in (start, end))
    # A direct change of velocity from start to end, without reversal, covers this distance.
    direct_distance = (start + end) / 2 * np.abs(end - start) / acceleration
    # Distances that are equal to it except for rounding count as equal.
    rounding = ROUNDING_TOLERANCE * (1 + np.abs(direct_distance)) * np.sign(start + end)
    # A joint whose direct change of velocity covers more than the distance moves beyond it and
    # returns. This motion is mirrored once more, so that its peak velocity is positive.
    direction = np.where(distance + rounding < direct_distance, -1.0, 1.0)
    distance, start, end = (direction * values for values in (distance, start, end))
    mean_square = (start**2 + end**2) / 2
    peak_limit = np.maximum(velocity, np.maximum(np.abs(start), np.abs(end)))
    # Without cruising, the ramps to and from the peak cover (peak² − mean_square) / acceleration.
    peak = np.minimum(np.sqrt(np.maximum(acceleration * distance + mean_square, 0.0)), peak_limit)
    cruise = (distance - (peak**2 - mean_square) / acceleration) / np.where(peak > 0, peak, 1.0)
    return np.asarray((2 * peak - start - end) / acceleration + np.where(peak > 0, cruise, 0.0))


@record
class SCurve:
    """A motion of one joint from position 0, whose acceleration is linear in time on each piece.

    Positions are in rad or m, and velocities and accelerations in the same unit per s and per s².
    """

    lengths: Array
    """Durations of the pieces, (m,), s."""
    start: Array
    """Accelerations at the start of the pieces, (m,)."""
    end: Array
    """Accelerations at the end of the pieces, (m,)."""
    speed: float = 0.0
    """Velocity at the start of the motion."""

    @classmethod
    def from_pieces(cls, lengths: Array, start: Array, end: Array, speed: float = 0.0) -> "SCurve":
        """Build a motion from pieces, and leave out those whose durations are mere rounding errors.

        Parameters
        ----------
        lengths : (m,) array
            Durations of the pieces, s.
        start, end : (m,) arrays
            Accelerations at the start and at the end of each piece, in rad or m and s.
        speed : float
            Velocity at the start of the motion, rad/s or m/s.

        Returns
        -------
        SCurve
            The motion with the remaining pieces.
        """
        # Differences of durations have rounding errors of about 1e-16 of the whole duration.
        lasting = lengths > 1e-13 * lengths.sum()
        return cls(lengths[lasting], start[lasting], end[lasting], speed)

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.lengths.sum())

    @property
    def distance(self) -> float:
        """Displacement between start and end, rad or m."""
        return float(self._cubics.end[0][-1])

    @property
    def switching_times(self) -> Array:
        """Instants between the pieces, both ends included, (m + 1,), s. The jerk may jump there."""
        return _cumulative_sums(self.lengths)

    def followed_by_rest(self, duration: float) -> "SCurve":
        """Return the motion followed by a rest, so that both together take a given duration.

        Parameters
        ----------
        duration : float
            Duration of the motion with the rest, s.

        Returns
        -------
        SCurve
            The motion. It is unchanged if it takes at least this duration already.
        """
        # A rest is a piece with the acceleration 0.
        pause = duration - self.duration
        if pause <= ROUNDING_TOLERANCE:
            return self
        return self.followed_by(SCurve(np.array([pause]), np.zeros(1), np.zeros(1)))

    def followed_by(self, other: "SCurve") -> "SCurve":
        """Return the motion followed by the pieces of another one.

        Parameters
        ----------
        other : SCurve
            The second motion. It begins with the velocity that this motion has at its end. Its own
            field `speed` is not read.

        Returns
        -------
        SCurve
            Both motions in one.
        """
        lengths, start, end = (
            np.concatenate([getattr(part, name) for part in (self, other)])
            for name in ("lengths", "start", "end")
        )
        return SCurve(lengths, start, end, self.speed)

    def stretched(self, duration: float) -> "SCurve":
        """Return the motion over the same distance with another duration.

        All velocities are divided by the ratio of the durations, and all accelerations by its
        square.

        Parameters
        ----------
        duration : float
            New duration, s.
        """
        factor = duration / self.duration
        return SCurve(
            self.lengths * factor, self.start / factor**2, self.end / factor**2, self.speed / factor
        )

    def scaled(self, factor: float) -> "SCurve":
        """Return the motion over `factor` times the distance in the same time."""
        return SCurve(self.lengths, self.start * factor, self.end * factor, self.speed * factor)

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Evaluate the motion at given times.

        Parameters
        ----------
        t : (n,) array
            Times since the start, s.

        Returns
        -------
        tuple of three (n,) arrays
            Position, velocity and acceleration, in rad or m and s. Where the acceleration jumps,
            its value after the jump is returned, except at the end of the motion.
        """
        index = self._piece_index(t)
        cubics = self._cubics
        pieces = (cubics.u, cubics.v, cubics.a0, cubics.a1, cubics.h)
        return CubicPiece(*(values[index] for values in pieces)).at_time(
            t - self.switching_times[index]
        )

    def jerk_at(self, t: Array) -> Array:
        """Return the jerk (n,) at times t (n,), in s. At a jump it is the value after the jump."""
        return np.asarray(self._cubics.jerk[self._piece_index(t)])

    @cached_property
    def _cubics(self) -> CubicPiece:
        """Cubic polynomials of the position on all m pieces. The fields have the shape (m,)."""
        velocity_changes = self.lengths * (self.start + self.end) / 2
        velocity = self.speed + _cumulative_sums(velocity_changes)[:-1]
        # Cubics that start at position 0 end at the displacement of their piece. The sums of these
        # displacements are the positions at which the pieces start.
        from_zero = CubicPiece(0.0, velocity, self.start, self.end, self.lengths)
        return CubicPiece(
            _cumulative_sums(from_zero.end[0])[:-1], velocity, self.start, self.end, self.lengths
        )

    def _piece_index(self, t: Array) -> Indices:
        """Return the index (n,) of the piece that contains each of the times (n,), s.

        Times before the start or after the end give the first or the last piece.
        """
        return np.clip(
            np.searchsorted(self.switching_times, t, side="right") - 1, 0, len(self.lengths) - 1
        )


def _cumulative_sums(values: Array) -> Array:
    """Return the cumulative sums (m + 1,) of values (m,). The first one is 0."""
    return np.append(0.0, np.cumsum(values))


def rest_to_rest(
    distance: float, velocity: float, acceleration: float, jerk: float | None = None
) -> SCurve:
    """Return the fastest motion of a joint from rest to rest.

    The motion is symmetric in time. Without a jerk limit, its velocity over time is a trapezoid, or
    a triangle if it does not reach its limit. With a jerk limit, the motion has up to seven pieces.

    Parameters
    ----------
    distance : float
        Distance > 0, rad or m.
    velocity, acceleration : float
        Limits, in units of the distance per s and per s².
    jerk : float or None
        Limit on the jerk, or None if the acceleration may jump.

    Returns
    -------
    SCurve
        The motion, which begins at time 0 and position 0.
    """
    limit = math.inf if jerk is None else jerk
    speed = float(_peak_speed(np.array(distance), velocity, acceleration, limit))
    # A ramp is a piece in which the acceleration changes at the limit of jerk.
    ramp = min(acceleration / limit, math.sqrt(speed / limit))
    peak = min(acceleration, math.sqrt(speed * limit))
    constant_time = max(speed / peak - ramp, 0.0)
    # The columns are the duration of a piece, and the acceleration at its start and end.
    speed_up = np.array([[ramp, 0.0, peak], [constant_time, peak, peak], [ramp, peak, 0.0]])
    cruise = [max(distance / speed - speed_up[:, 0].sum(), 0.0), 0.0, 0.0]
    slow_down = speed_up[::-1, [0, 2, 1]] * (1, -1, -1)
    lengths, start, end = np.vstack([speed_up, cruise, slow_down]).T
    return SCurve.from_pieces(lengths, start, end)


def quickest_stop(speed: float, acceleration: float, limit: float, jerk: float) -> SCurve:
    """Compute the quickest stop of a joint from a given velocity and acceleration.

    The acceleration is 0 at the end. If it cannot return to 0 before the velocity does, the joint
    moves beyond the position at which it stops, and returns to it.

    Parameters
    ----------
    speed, acceleration : float
        Velocity and acceleration at the beginning, in rad or m and s.
    limit, jerk : float
        Limits of acceleration and jerk. With an infinite limit of jerk the acceleration may jump.

    Returns
    -------
    SCurve
        Motion to rest, with the acceleration 0 at its end.
    """
    # Without a jerk limit, the whole stop is one piece with the largest deceleration.
    if math.isinf(jerk):
        braking = np.array([-math.copysign(limit, speed)])
        return SCurve(np.array([abs(speed) / limit]), braking, braking, speed)
    # The joint brakes against the velocity that it would have once its acceleration is 0.
    sign = math.copysign(1.0, speed + acceleration * abs(acceleration) / (2 * jerk))
    # Mirrored in this way, the joint brakes with a negative acceleration. The acceleration changes
    # to −peak, stays there, and rises to 0. If v < 0, the joint reverses during the first change.
    v, a = sign * speed, sign * acceleration
    peak = min(math.sqrt(max(jerk * v + a**2 / 2, 0.0)), limit)
    ramp_time = abs(a + peak) / jerk
    time_to_reversal = (a - math.sqrt(max(a**2 + 2 * jerk * v, 0.0))) / jerk if v < 0 else 0.0
    at_reversal = a - jerk * time_to_reversal
    constant_time = max(v + (a - peak) / 2 * ramp_time - peak**2 / (2 * jerk), 0.0) / (peak or 1.0)
    pieces = np.array(
        [
            [time_to_reversal, a, at_reversal],
            [ramp_time - time_to_reversal, at_reversal, -peak],
            [constant_time, -peak, -peak],
            [peak / jerk, -peak, 0.0],
        ]
    )
    lengths, start, end = (pieces * (1, sign, sign)).T
    return SCurve.from_pieces(lengths, start, end, speed)


def stopping_curves(robot: Robot, qd: Array, qdd: Array, share: float = 1.0) -> list[SCurve | None]:
    """Return the quickest stops of all joints from given velocities and accelerations.

    Every joint stops as soon as it can, and rests until the last one has stopped.

    Parameters
    ----------
    robot : Robot
        The robot with the limits of its joints.
    qd, qdd : (4,) arrays
        Joint velocities q̇ and accelerations q̈ at the beginning, in rad or m and s.
    share : float
        Share of the acceleration limits that the joints use.

    Returns
    -------
    list of SCurve or None
        Motion of every joint. None for a joint without velocity and acceleration.
    """
    joints = zip(qd.tolist(), qdd.tolist(), robot.joints, strict=True)
    curves = [
        quickest_stop(speed, acceleration, share * joint.acceleration, joint.jerk or np.inf)
        if speed or acceleration
        else None
        for speed, acceleration, joint in joints
    ]
    longest = max((stop.duration for stop in curves if stop is not None), default=0.0)
    return [stop and stop.followed_by_rest(longest) for stop in curves]


def rest_to_rest_times(
    distance: Array,
    velocity: Array | float,
    acceleration: Array | float,
    jerk: Array | float = math.inf,
) -> Array:
    """Return the durations of the fastest motions from rest to rest, s.

    Such a motion speeds up, moves on at its peak velocity v, and slows down. With the distance d
    and the time T in which the velocity rises from 0 to v, its duration is T + d / v. All arguments
    broadcast.

    Parameters
    ----------
    distance : array
        Distances ≥ 0, rad or m.
    velocity, acceleration, jerk : array or float
        Limits. An infinite jerk stands for no limit.

    Returns
    -------
    array of the broadcast shape
        Durations, s.
    """
    # At the peak velocity v = a²/j, the acceleration just reaches its limit a.
    speed = _peak_speed(distance, velocity, acceleration, jerk)
    reaches_limit = speed >= acceleration**2 / jerk
    ramp_times = np.where(
        reaches_limit, speed / acceleration + acceleration / jerk, 2 * np.sqrt(speed / jerk)
    )
    # For a distance of 0 the speed is 0, and the lower bound on the divisor gives the time 0.
    return np.asarray(ramp_times + distance / np.maximum(speed, ROUNDING_TOLERANCE))


def _peak_speed(
    distance: Array,
    velocity: Array | float,
    acceleration: Array | float,
    jerk: Array | float,
) -> Array:
    """Return the peak velocity of the fastest motion from rest to rest.

    It is the limit of the velocity, or the peak velocity v of a motion that does not cruise, that
    is, without a part at constant velocity. Let T be the time in which the velocity rises to v.
    Then

        d = v T,
        T = v/a + a/j   if the acceleration reaches its limit a,
        T = 2 √(v/j)    otherwise.

    Parameters
    ----------
    distance : array
        Distances d ≥ 0, rad or m.
    velocity, acceleration, jerk : array or float
        Limits, the latter two a and j. All arguments broadcast.

    Returns
    -------
    array of the broadcast shape
        Peak velocities, rad/s or m/s.
    """
    # The equations of the docstring are solved for v. The acceleration reaches its limit a if v is
    # at least a²/j.
    limit_speed = acceleration**2 / jerk
    speed = (np.sqrt(limit_speed**2 + 4 * acceleration * distance) - limit_speed) / 2
    with np.errstate(invalid="ignore"):  # 0 · ∞ for a joint at rest without a limit of jerk.
        below_limit = np.cbrt(distance**2 * jerk / 4)
    return np.minimum(velocity, np.where(speed >= limit_speed, speed, below_limit))
