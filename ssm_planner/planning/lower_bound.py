"""Lower bounds of durations in closed form, and S-curves from rest to rest.

A bound takes each joint, and each limited rate, as if it moved alone.
"""

from __future__ import annotations

import math

import numpy as np

from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.problem import TASK, Robot, TaskLimits, TipSpeed
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, Indices, record

NONE = TaskLimits()


AT_REST = np.zeros((2, 4))


def lower_bound(
    robot: Robot, points: Array, speeds: Array = AT_REST, limits: TaskLimits = NONE
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
    speeds : (2, 4) array
        q̇ at both ends.
    limits : TaskLimits
        Limits on task rates and on the tip speed.
    """
    velocities = [joint.velocity for joint in robot.joints]
    tip = next((limit.largest for limit in limits.speeds if isinstance(limit, TipSpeed)), math.inf)
    velocities[3] = min(velocities[3], tip, limits.rates.get("depth", math.inf))
    joints = range(4)
    through_all = max(
        _time(robot, i, positions=points[:, i], speeds=speeds[:, i], velocity=velocities[i])
        for i in joints
    )
    if len(points) == 2:
        return max(through_all, _straight_ways(robot, points, tip).sum())
    steps, last_segment = np.diff(points, axis=0), len(points) - 2
    stretches = _straight_ways(robot, points, tip)
    for k, step in enumerate(steps):
        start = speeds[0] if k == 0 else (None,) * 4
        end = speeds[1] if k == last_segment else (None,) * 4
        times = [
            minimum_time(step[i], velocities[i], robot.joints[i].acceleration, (start[i], end[i]))
            for i in joints
        ]
        stretches[k] = max(stretches[k], *times)
    return max(through_all, float(stretches.sum()))


def _straight_ways(robot: Robot, points: Array, speed: float) -> Array:
    """Return the time (k,) of the tip along straight lines between points (k + 1, 4), s."""
    if math.isinf(speed):
        return np.zeros(len(points) - 1)
    tips = tip_position(Mechanism.from_geometry(robot.geometry), points)
    return np.asarray(np.linalg.norm(np.diff(tips, axis=0), axis=1) / speed)


def rate_bound(robot: Robot, ends: Array, rates: Array, limits: TaskLimits) -> float:
    """Return a bound from limits on angular rates between task coordinates (2, 4), s.

    `rates` (2, 4) are the task rates at both ends.
    """
    bound = 0.0
    for name, rate in limits.rates.items():
        if name == "depth":  # The rate of depth is already a limit of joint 4.
            continue
        k = TASK.index(name)
        distance = float(np.diff(ends[:, k])[0])
        acceleration = angular_acceleration(robot, name, limits)
        speeds = (
            (None, None) if math.isinf(acceleration) else (float(rates[0, k]), float(rates[1, k]))
        )
        bound = max(bound, minimum_time(distance, rate, acceleration, speeds))
    return bound


def angular_acceleration(robot: Robot, name: str, limits: TaskLimits) -> float:
    """Return a bound of the acceleration of roll, tilt or spin within the joint limits, rad/s².

    The tool axis turns about joint 2 on a circle of radius sin β. Let φ be the tilt and ζ = ψ − θ1
    the azimuth, both as functions of θ2. Then

        |φ'| ≤ sin β,           |φ''| ≤ (sin β + |cos φ| sin² β) / sin φ,
        |ζ'| ≤ sin β / sin φ,   |ζ''| ≤ (sin β + 2 |cos φ| sin² β / sin φ) / sin φ.

    The bounds of spin are the same with α instead of β. `name` is "roll", "tilt" or "spin". The
    result is infinite if the range of tilt contains 0 or ±π.
    """
    mechanism = Mechanism.from_geometry(robot.geometry)
    first, second, third, _ = robot.joints
    low, high = limits.ranges.get("tilt", (-math.pi, math.pi))
    if not (-math.pi < low < high < 0 or 0 < low < high < math.pi):
        return math.inf
    sine = min(abs(math.sin(low)), abs(math.sin(high)))
    radius = math.sin(mechanism.alpha if name == "spin" else mechanism.beta)
    slope, curvature = (1.0, 1.0) if name == "tilt" else (1 / sine, 2 / sine)
    contribution = (
        radius * slope * second.acceleration
        + (radius + curvature * radius**2) / sine * second.velocity**2
    )
    return (
        contribution + {"roll": first.acceleration, "tilt": 0.0, "spin": third.acceleration}[name]
    )


def minimum_time(
    distance: float,
    velocity: float,
    acceleration: float,
    speeds: tuple[float | None, float | None] = (0.0, 0.0),
) -> float:
    """Return the shortest time over a signed distance with bounded velocity and acceleration, s.

    `speeds` are the signed velocities at the start and at the end, in the units of `velocity`.
    None means that the velocity is free. The limit is raised to an end velocity that exceeds it.
    """
    start, end = (
        None if speed is None else float(math.copysign(1.0, distance)) * speed for speed in speeds
    )
    distance = abs(distance)
    fixed_speeds = [speed for speed in (start, end) if speed is not None]
    if start is None or end is None:
        velocity = max([velocity, *map(abs, fixed_speeds)])
        if not fixed_speeds:
            return distance / velocity
        # At the free end the velocity is as large as the distance allows.
        top = min(math.sqrt(fixed_speeds[0] ** 2 + 2 * acceleration * distance), velocity)
        ramp = (top - fixed_speeds[0]) / acceleration
        return (
            ramp + (distance - (top**2 - fixed_speeds[0] ** 2) / (2 * acceleration)) / top
            if top > 0
            else ramp
        )
    return float(
        minimum_times(np.array(distance), velocity, acceleration, (np.array(start), np.array(end)))
    )


def minimum_times(
    distance: Array,
    velocity: Array | float,
    acceleration: Array | float,
    speeds: tuple[Array, Array],
) -> Array:
    """Return the shortest times over signed distances between given velocities.

    The closed form of `minimum_time` is evaluated for arrays that broadcast.
    """
    sign = np.where(distance < 0, -1.0, 1.0)
    distance = sign * distance
    start = sign * speeds[0]
    end = sign * speeds[1]
    direct = (start + end) / 2 * np.abs(end - start) / acceleration
    at_once = np.abs(distance - direct) <= ROUNDING * (1 + np.abs(direct))
    # A joint that cannot stop in time overshoots and comes back.
    side = np.where(distance < direct, -1.0, 1.0)
    distance = side * distance
    start = side * start
    end = side * end
    squares = (start**2 + end**2) / 2
    peak_limit = np.maximum(velocity, np.maximum(np.abs(start), np.abs(end)))
    top = np.minimum(np.sqrt(np.maximum(acceleration * distance + squares, 0.0)), peak_limit)
    cruise = (distance - (top**2 - squares) / acceleration) / np.where(top > 0, top, 1.0)
    duration = (2 * top - start - end) / acceleration + np.where(top > 0, cruise, 0.0)
    return np.asarray(np.where(at_once, np.abs(end - start) / acceleration, duration))


def _time(robot: Robot, i: int, *, positions: Array, speeds: Array, velocity: float) -> float:
    """Return the shortest time of joint i alone through its positions (k + 1,), s."""
    joint = robot.joints[i]
    acceleration, steps = joint.acceleration, np.diff(positions)
    runs = _runs(positions)
    if not speeds.any():
        # The velocity is zero at a reversal. With a jerk limit the acceleration need not be.
        jerk = joint.jerk if len(runs) == 1 else None
        return sum(rest_time(run, velocity, acceleration, jerk) for run in runs)
    nonzero = steps[np.abs(steps) > ROUNDING]
    if len(runs) < 2:
        return minimum_time(float(nonzero.sum()), velocity, acceleration, (speeds[0], speeds[1]))
    # The joint rests where it reverses, beyond the point if it cannot stop before.
    ends = speeds * np.sign(nonzero[[0, -1]])
    for k, speed in zip((0, -1), ends, strict=True):
        runs[k] = max(runs[k], max(speed, 0.0) ** 2 / (2 * acceleration))
    middle = sum(minimum_time(run, velocity, acceleration) for run in runs[1:-1])
    return (
        minimum_time(runs[0], velocity, acceleration, (ends[0], 0.0))
        + middle
        + minimum_time(runs[-1], velocity, acceleration, (0.0, ends[1]))
    )


def _runs(positions: Array) -> list[float]:
    """Return the distances between the reversals of a joint."""
    runs: list[float] = []
    for step in np.diff(positions).tolist():
        if abs(step) <= ROUNDING:
            continue
        if runs and runs[-1] * step > 0:
            runs[-1] += step
        else:
            runs.append(step)
    return [abs(run) for run in runs]


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
    def switches(self) -> Array:
        """Times at which the acceleration or its slope jumps, both ends included, (m + 1,), s."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])

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
        return Cubic(*(values[index] for values in self._pieces)).at_time(t - self.switches[index])

    def jerk_at(self, t: Array) -> Array:
        """Return the slope of the acceleration from the right at times t (n,)."""
        return np.asarray(((self.end - self.start) / self.lengths)[self._piece_index(t)])

    @property
    def _pieces(self) -> tuple[Array, ...]:
        """Position, velocity and acceleration at the start, acceleration at the end, and length of
        all pieces.

        Each is an (m,) array.
        """
        zeros = np.zeros(len(self.lengths))
        _, gained = Cubic(zeros, zeros, self.start, self.end, self.lengths).end
        velocity = np.concatenate([[self.speed], self.speed + np.cumsum(gained)[:-1]])
        distance, _ = Cubic(zeros, velocity, self.start, self.end, self.lengths).end
        return (
            np.concatenate([[0.0], np.cumsum(distance)[:-1]]),
            velocity,
            self.start,
            self.end,
            self.lengths,
        )

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
        _, velocity, _ = self.evaluate(self.switches)
        acceleration = max(np.abs(self.start).max(), np.abs(self.end).max())
        jumps = (
            np.abs(np.append(self.start, 0.0) - np.append(0.0, self.end)).max()
            > 1e-9 * acceleration
        )
        jerk = math.inf if jumps else float(np.abs((self.end - self.start) / self.lengths).max())
        return float(np.abs(velocity).max()), float(acceleration), jerk


def rest_to_rest(
    distance: float, velocity: float, acceleration: float, jerk: float | None = None
) -> SCurve:
    """Return the fastest motion from rest to rest over a distance > 0.

    Without a jerk limit the velocity is a trapezoid, or a triangle if it does not reach its limit.
    With a jerk limit the motion has up to seven pieces. Both are symmetric in time.
    """
    speed = min(velocity, _reachable_speed(distance, acceleration, jerk))
    if jerk is None:
        lengths = [speed / acceleration]
        start = [acceleration]
        end = [acceleration]
    else:
        ramp = min(acceleration / jerk, math.sqrt(speed / jerk))
        peak = jerk * ramp
        flat = max(speed / peak - ramp, 0.0)
        lengths = [ramp, flat, ramp]
        start = [0.0, peak, peak]
        end = [peak, peak, 0.0]
    cruise = max(distance / speed - sum(lengths), 0.0)
    all_lengths = np.array([*lengths, cruise, *reversed(lengths)])
    starts = np.array([*start, 0.0, *(-x for x in reversed(end))])
    ends = np.array([*end, 0.0, *(-x for x in reversed(start))])
    nonempty = all_lengths > 1e-13 * all_lengths.sum()
    return SCurve(all_lengths[nonempty], starts[nonempty], ends[nonempty])


def rest_time(
    distance: float, velocity: float, acceleration: float, jerk: float | None = None
) -> float:
    """Return the duration of `rest_to_rest`, s."""
    speed = min(velocity, _reachable_speed(distance, acceleration, jerk))
    if jerk is None:
        ramp = speed / acceleration
    else:
        limited = speed * jerk >= acceleration**2
        ramp = (
            speed / acceleration + acceleration / jerk if limited else 2 * math.sqrt(speed / jerk)
        )
    return ramp + max(distance / speed, ramp)


def _reachable_speed(distance: float, acceleration: float, jerk: float | None) -> float:
    """Return the peak velocity of the motion that never cruises.

    It satisfies v T_ramp(v) = distance.
    """
    if jerk is None:
        return math.sqrt(distance * acceleration)
    # If the acceleration reaches its limit, v (v/a + a/j) = d.
    half = acceleration**2 / jerk
    speed = (-half + math.sqrt(half**2 + 4 * acceleration * distance)) / 2
    if speed >= half:
        return speed
    return (distance**2 * jerk / 4) ** (1 / 3)


def least_times(robot: Robot, displacements: Array, distances: Array, limits: TaskLimits) -> Array:
    """Return the times (n,) of motions from rest to rest, s.

    Every joint moves by `displacements` (n, 4) and the tip by `distances` (n,). The time is that of
    the slowest joint alone, as `rest_to_rest` gives it, or of the tip at its largest speed.
    """
    tip = min(
        (limit.largest for limit in limits.speeds if isinstance(limit, TipSpeed)), default=math.inf
    )
    times = np.asarray(distances) / tip
    for i, joint in enumerate(robot.joints):
        distance = np.abs(displacements[:, i])
        v = joint.velocity
        a = joint.acceleration
        j = joint.jerk
        if i == 3:
            v = min(v, limits.rates.get("depth", math.inf))
        if j is None:
            speed = np.minimum(v, np.sqrt(distance * a))
            ramp = speed / a
        else:
            half = a**2 / j
            peak = (-half + np.sqrt(half**2 + 4 * a * distance)) / 2
            speed = np.minimum(v, np.where(peak >= half, peak, np.cbrt(distance**2 * j / 4)))
            ramp = np.where(speed >= half, speed / a + a / j, 2 * np.sqrt(speed / j))
        times = np.maximum(times, ramp + distance / np.maximum(speed, ROUNDING))
    return np.asarray(times)
