"""Lower bounds of durations in closed form, and S-curves from rest to rest.

A bound takes each joint, and each limited rate, as if it moved alone.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.problem import TASK, Robot, TaskLimits, TipSpeed
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, Indices, record

BISECTIONS = 60
"""Number of bisections."""


def lower_bound(
    robot: Robot,
    points: Array,
    speeds: Array | None = None,
    limits: TaskLimits = TaskLimits(),  # noqa: B008  frozen
) -> float:
    """Return a lower bound on the duration of any motion through points, s.

    Each joint is bounded by itself, without regard to the others. The bound is the larger of two
    numbers. One is the time of the slowest joint through all points. The other is the sum over the
    segments of the slowest joint's time, with free velocities at the via points. The limits on the
    rate of depth and on the tip speed also limit joint 4, and the tip moves straight.

    Parameters
    ----------
    robot : Robot
        The robot with its limits.
    points : (k + 1, 4) array
        Joints at the ends and at the via points.
    speeds : (2, 4) array, optional
        q̇ at both ends, by default 0.
    limits : TaskLimits
        Limits on task rates and on the tip speed.
    """
    velocity, acceleration, jerk = _joint_limits(robot, limits)
    ends = np.zeros((2, 4)) if speeds is None else speeds
    through_all = max(
        _time_alone(*joint)
        for joint in zip(points.T, ends.T, velocity, acceleration, jerk, strict=True)
    )
    at_points = np.insert(ends, 1, np.full((len(points) - 2, 4), np.nan), axis=0)
    segments = minimum_times(
        np.diff(points, axis=0), velocity, acceleration, (at_points[:-1], at_points[1:])
    )
    tips = tip_position(Mechanism.from_robot(robot), points)
    straight = np.linalg.norm(np.diff(tips, axis=0), axis=1) / _tip_speed(limits)
    return max(through_all, float(np.maximum(segments.max(axis=1), straight).sum()))


def least_times(robot: Robot, displacements: Array, distances: Array, limits: TaskLimits) -> Array:
    """Return the times (...) of motions from rest to rest, s.

    Every joint moves by `displacements` (..., 4) and the tip by `distances` (...). The time is that
    of the slowest joint alone, as `rest_to_rest` gives it, or of the tip at its largest speed.
    """
    times = rest_times(np.abs(displacements), *_joint_limits(robot, limits)).max(axis=-1)
    return np.maximum(times, distances / _tip_speed(limits))


def _tip_speed(limits: TaskLimits) -> float:
    """Return the largest speed of the tip, m/s, or ∞."""
    return next((limit.largest for limit in limits.speeds if isinstance(limit, TipSpeed)), math.inf)


def _joint_limits(robot: Robot, limits: TaskLimits) -> Array:
    """Return the largest velocity, acceleration and jerk of the joints, (3, 4), or ∞."""
    joints = [
        (joint.velocity, joint.acceleration, joint.jerk or math.inf) for joint in robot.joints
    ]
    result = np.array(joints).T
    result[0, 3] = min(result[0, 3], _tip_speed(limits), limits.rates.get("depth", math.inf))
    return result


def _time_alone(
    positions: Array, speeds: Array, velocity: float, acceleration: float, jerk: float
) -> float:
    """Return the shortest time of one joint through positions (k + 1,), s.

    `speeds` (2,) are the velocities at both ends. A joint rests where it reverses, beyond the point
    if it cannot stop before. Jerk is left out unless the joint moves one way from rest to rest,
    because the acceleration need not be zero at a reversal.
    """
    steps = np.diff(positions)
    steps = steps[np.abs(steps) > ROUNDING]
    reversals = np.flatnonzero(steps[1:] * steps[:-1] < 0) + 1
    runs = np.add.reduceat(steps, np.append(0, reversals)) if len(steps) else np.zeros(1)
    if len(runs) == 1 and not speeds.any():
        return float(rest_times(np.abs(runs), velocity, acceleration, jerk)[0])
    starts, ends = np.zeros((2, len(runs)))
    starts[0], ends[-1] = speeds
    if len(runs) > 1:
        sign = np.sign(runs)
        to_stop = np.maximum(np.maximum(sign * starts, sign * ends), 0.0) ** 2 / (2 * acceleration)
        runs = sign * np.maximum(np.abs(runs), to_stop)
    return float(minimum_times(runs, velocity, acceleration, (starts, ends)).sum())


def rate_bound(robot: Robot, ends: Array, rates: Array, limits: TaskLimits) -> float:
    """Return a bound from limits on angular rates between task coordinates (2, 4), s.

    `rates` (2, 4) are the task rates at both ends. They are left out if the angular acceleration
    has no bound, and for depth, whose rate is already a limit of joint 4.
    """
    times = [0.0]
    for name, rate in limits.rates.items():
        k = TASK.index(name)
        distance = float(ends[1, k] - ends[0, k])
        acceleration = math.inf if name == "depth" else angular_acceleration(robot, name, limits)
        if math.isinf(acceleration):
            times.append(abs(distance) / rate)
        else:
            speeds = rates[0, k], rates[1, k]
            times.append(float(minimum_times(distance, rate, acceleration, speeds)))
    return max(times)


def angular_acceleration(robot: Robot, name: str, limits: TaskLimits) -> float:
    """Return a bound of the acceleration of roll, tilt or spin within the joint limits, rad/s².

    The tool axis turns about joint 2 on a circle of radius sin β. Let φ be the tilt and ζ = ψ − θ1
    the azimuth, both as functions of θ2. Then

        |φ'| ≤ sin β,           |φ''| ≤ (sin β + |cos φ| sin² β) / sin φ,
        |ζ'| ≤ sin β / sin φ,   |ζ''| ≤ (sin β + 2 |cos φ| sin² β / sin φ) / sin φ.

    The bounds of spin are the same with α instead of β. `name` is "roll", "tilt" or "spin". The
    result is infinite if the range of tilt contains 0 or ±π.
    """
    mechanism = Mechanism.from_robot(robot)
    first, second, third, _ = robot.joints
    low, high = limits.ranges.get("tilt", (-math.pi, math.pi))
    if not (-math.pi < low < high < 0 or 0 < low < high < math.pi):
        return math.inf
    sine = min(abs(math.sin(low)), abs(math.sin(high)))
    radius = math.sin(mechanism.alpha if name == "spin" else mechanism.beta)
    slope, curvature = (1.0, 1.0) if name == "tilt" else (1 / sine, 2 / sine)
    along = radius * slope * second.acceleration
    across = (radius + curvature * radius**2) / sine * second.velocity**2
    own = {"roll": first.acceleration, "tilt": 0.0, "spin": third.acceleration}[name]
    return along + across + own


def minimum_times(
    distance: Array | float,
    velocity: Array | float,
    acceleration: Array | float,
    speeds: tuple[Array | float, Array | float] = (0.0, 0.0),
) -> Array:
    """Return the shortest times over signed distances with bounded velocity and acceleration, s.

    `speeds` are the signed velocities at the start and at the end, in the units of `velocity`. NaN
    means that a velocity is free. It is then as large as the distance allows. The limit is raised
    to an end velocity that exceeds it. All arguments broadcast.
    """
    sign = np.where(np.asarray(distance) < 0, -1.0, 1.0)
    distance = sign * distance
    start, end = (sign * speed for speed in speeds)
    known = np.where(np.isnan(start), end, start)
    reached = np.sqrt(np.maximum(known**2 + 2 * acceleration * distance, 0.0))
    free = np.fmin(reached, np.fmax(velocity, np.abs(known)))
    start, end = (np.where(np.isnan(speed), free, speed) for speed in (start, end))
    direct = (start + end) / 2 * np.abs(end - start) / acceleration
    at_once = np.abs(distance - direct) <= ROUNDING * (1 + np.abs(direct))
    # A joint that cannot stop in time overshoots and comes back.
    side = np.where(distance < direct, -1.0, 1.0)
    distance, start, end = (side * values for values in (distance, start, end))
    squares = (start**2 + end**2) / 2
    peak_limit = np.maximum(velocity, np.maximum(np.abs(start), np.abs(end)))
    top = np.minimum(np.sqrt(np.maximum(acceleration * distance + squares, 0.0)), peak_limit)
    cruise = (distance - (top**2 - squares) / acceleration) / np.where(top > 0, top, 1.0)
    duration = (2 * top - start - end) / acceleration + np.where(top > 0, cruise, 0.0)
    return np.asarray(np.where(at_once, np.abs(end - start) / acceleration, duration))


@record
class SCurve:
    """A motion with piecewise linear acceleration.

    The lengths (m,) of the pieces are in s. `start` and `end` (m,) are the accelerations at the
    ends of the pieces. `speed` is the initial velocity.
    """

    lengths: Array
    start: Array
    end: Array
    speed: float = 0.0

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.lengths.sum())

    @property
    def distance(self) -> float:
        """Displacement at the end."""
        return float(self._cubics.end[0][-1])

    @property
    def switches(self) -> Array:
        """Times at which the acceleration or its slope jumps, both ends included, (m + 1,), s."""
        return _sums(self.lengths)

    def followed_by_rest(self, duration: float) -> SCurve:
        """Return the same motion with a rest at its end, so that both take `duration` seconds."""
        pause = duration - self.duration
        if pause <= ROUNDING:
            return self
        lengths, start, end = (
            np.append(values, added)
            for values, added in ((self.lengths, pause), (self.start, 0.0), (self.end, 0.0))
        )
        return SCurve(lengths, start, end, self.speed)

    def stretched(self, duration: float) -> SCurve:
        """Return the same motion with another duration, s."""
        factor = duration / self.duration
        return SCurve(
            self.lengths * factor, self.start / factor**2, self.end / factor**2, self.speed / factor
        )

    def scaled(self, factor: float) -> SCurve:
        """Return the same motion over `factor` times the distance."""
        return SCurve(self.lengths, self.start * factor, self.end * factor, self.speed * factor)

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration at times t (n,).

        The acceleration is taken from the right, and at the end from the left.
        """
        index = self._piece_index(t)
        cubics = self._cubics
        pieces = (cubics.u, cubics.v, cubics.a0, cubics.a1, cubics.h)
        return Cubic(*(values[index] for values in pieces)).at_time(t - self.switches[index])

    def jerk_at(self, t: Array) -> Array:
        """Return the slope of the acceleration from the right at times t (n,)."""
        return np.asarray(self._cubics.jerk[self._piece_index(t)])

    @cached_property
    def _cubics(self) -> Cubic:
        """All pieces, with fields of shape (m,)."""
        gained = self.lengths * (self.start + self.end) / 2
        velocity = self.speed + _sums(gained)[:-1]
        from_zero = Cubic(0.0, velocity, self.start, self.end, self.lengths)
        return Cubic(_sums(from_zero.end[0])[:-1], velocity, self.start, self.end, self.lengths)

    def _piece_index(self, t: Array) -> Indices:
        """Return the index of the piece that contains each time (n,)."""
        return np.clip(
            np.searchsorted(self.switches, t, side="right") - 1, 0, len(self.lengths) - 1
        )

    @property
    def peaks(self) -> tuple[float, float, float]:
        """Largest velocity, acceleration and jerk.

        The jerk is infinite if the acceleration jumps.
        """
        velocity = np.append(self._cubics.v, self._cubics.end[1])
        acceleration = float(np.abs([self.start, self.end]).max())
        jumps = np.abs(np.append(self.start, 0.0) - np.append(0.0, self.end))
        jerk = np.inf if jumps.max() > ROUNDING * acceleration else np.abs(self._cubics.jerk).max()
        return float(np.abs(velocity).max()), acceleration, float(jerk)


def _sums(values: Array) -> Array:
    """Return 0 and the cumulative sums of values (m,), (m + 1,)."""
    return np.append(0.0, np.cumsum(values))


def rest_to_rest(
    distance: float, velocity: float, acceleration: float, jerk: float | None = None
) -> SCurve:
    """Return the fastest motion from rest to rest over a distance > 0.

    Without a jerk limit the velocity is a trapezoid, or a triangle if it does not reach its limit.
    With a jerk limit the motion has up to seven pieces. Both are symmetric in time.
    """
    limit = math.inf if jerk is None else jerk
    speed = min(velocity, float(_reachable_speed(np.array(distance), acceleration, limit)))
    ramp = min(acceleration / limit, math.sqrt(speed / limit))
    peak = min(acceleration, math.sqrt(speed * limit))
    flat = max(speed / peak - ramp, 0.0)
    rise = np.array([[ramp, 0.0, peak], [flat, peak, peak], [ramp, peak, 0.0]])
    cruise = [max(distance / speed - rise[:, 0].sum(), 0.0), 0.0, 0.0]
    fall = rise[::-1, [0, 2, 1]] * (1, -1, -1)
    pieces = np.vstack([rise, cruise, fall])
    lengths, start, end = pieces[pieces[:, 0] > 1e-13 * pieces[:, 0].sum()].T
    return SCurve(lengths, start, end)


def quickest_stop(speed: float, acceleration: float, limit: float, jerk: float) -> SCurve:
    """Return the quickest motion of a joint to rest.

    The joint reverses if its acceleration cannot end before.

    Parameters
    ----------
    speed, acceleration : float
        Initial velocity and acceleration.
    limit, jerk : float
        Limits of acceleration and jerk. With an infinite jerk the acceleration may jump.
    """
    if math.isinf(jerk):
        lengths, pulls = np.array([abs(speed) / limit]), np.array([-math.copysign(limit, speed)])
        return SCurve(lengths, pulls, pulls, speed)
    # The velocity at which the acceleration can end first decides on the direction of braking.
    sign = math.copysign(1.0, speed + acceleration * abs(acceleration) / (2 * jerk))
    v, a = sign * speed, sign * acceleration
    peak = min(math.sqrt(max(jerk * v + a**2 / 2, 0.0)), limit)
    rise = abs(a + peak) / jerk
    before = (a - math.sqrt(max(a**2 + 2 * jerk * v, 0.0))) / jerk if v < 0 else 0.0
    at_reversal = a - jerk * before
    flat = max(v + (a - peak) / 2 * rise - peak**2 / (2 * jerk), 0.0) / (peak or 1.0)
    pieces = np.array(
        [
            [before, a, at_reversal],
            [rise - before, at_reversal, -peak],
            [flat, -peak, -peak],
            [peak / jerk, -peak, 0.0],
        ]
    )
    lengths, start, end = pieces[pieces[:, 0] > 1e-13 * pieces[:, 0].sum()].T
    return SCurve(lengths, sign * start, sign * end, speed)


def stopping_curves(
    robot: Robot, qd: Array, qdd: Array, share: float = 1.0, *, in_step: bool = False
) -> list[SCurve | None]:
    """Return the quickest stops of joints with q̇ and q̈ (4,). None for a joint at rest.

    The joints use a share of their accelerations. If `in_step` is true, they brake less hard, so
    that all of them stop at the same time.
    """
    joints = list(zip(qd.tolist(), qdd.tolist(), robot.joints, strict=True))

    def curve(k: int, limit: float) -> SCurve | None:
        speed, acceleration, joint = joints[k]
        jerk = joint.jerk or np.inf
        return quickest_stop(speed, acceleration, limit, jerk) if speed or acceleration else None

    limits = share * robot.accelerations
    curves = [curve(k, limits[k]) for k in range(4)]
    latest = max((item.duration for item in curves if item is not None), default=0.0)
    low, high = np.zeros(4), limits
    for _ in range(BISECTIONS * in_step):
        middle = (low + high) / 2
        curves = [curve(k, middle[k]) for k in range(4)]
        later = np.array([item is not None and item.duration > latest for item in curves])
        low, high = np.where(later, middle, low), np.where(later, high, middle)
    return [item and item.followed_by_rest(latest) for item in curves]


def rest_times(
    distance: Array,
    velocity: Array | float,
    acceleration: Array | float,
    jerk: Array | float = math.inf,
) -> Array:
    """Return the durations of `rest_to_rest` over distances ≥ 0, s. All arguments broadcast."""
    speed = np.minimum(velocity, _reachable_speed(distance, acceleration, jerk))
    reaches_limit = speed >= acceleration**2 / jerk
    ramp = np.where(
        reaches_limit, speed / acceleration + acceleration / jerk, 2 * np.sqrt(speed / jerk)
    )
    return np.asarray(ramp + distance / np.maximum(speed, ROUNDING))


def _reachable_speed(distance: Array, acceleration: Array | float, jerk: Array | float) -> Array:
    """Return the peak velocity of the motion that never cruises.

    It satisfies v T_ramp(v) = distance. If the acceleration reaches its limit, v (v/a + a/j) = d.
    Otherwise v 2 √(v/j) = d.
    """
    half = acceleration**2 / jerk
    speed = (np.sqrt(half**2 + 4 * acceleration * distance) - half) / 2
    with np.errstate(invalid="ignore"):  # 0 · ∞ for a joint at rest without a limit of jerk.
        below_limit = np.cbrt(distance**2 * jerk / 4)
    return np.asarray(np.where(speed >= half, speed, below_limit))
