"""Durations that no motion can beat, in closed form: each joint, and each limited rate, alone; S-curves from rest to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.limits import TASK, TipSpeed
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, Indices

MOVES, ROUNDING = 1e-12, 1e-9
NONE = TaskLimits()


AT_REST = np.zeros((2, 4))


def lower_bound(
    robot: Robot, points: Array, speeds: Array = AT_REST, limits: TaskLimits = NONE
) -> float:
    """A duration that no motion through points (k + 1, 4) beats: everything but one joint at a time ignored, s.

    speeds (2, 4): q̇ at both ends. The larger of two: the slowest joint over the whole way, and the sum over the stretches
    between points of the slowest joint there, whose speed at the points within is free. Joint 4 keeps what the rate of depth
    and the tip's speed allow; the tip goes straight.
    """
    most = [joint.velocity for joint in robot.joints]
    tip = next((limit.largest for limit in limits.speeds if isinstance(limit, TipSpeed)), math.inf)
    most[3] = min(most[3], tip, limits.rates.get("depth", math.inf))
    joints = range(4)
    whole = max(
        _time(robot, i, positions=points[:, i], speeds=speeds[:, i], velocity=most[i])
        for i in joints
    )
    if len(points) == 2:
        return max(whole, _straight_ways(robot, points, tip).sum())
    steps, last = np.diff(points, axis=0), len(points) - 2
    stretches = _straight_ways(robot, points, tip)
    for k, step in enumerate(steps):
        begin, end = (
            (speeds[0] if k == 0 else (None,) * 4),
            (speeds[1] if k == last else (None,) * 4),
        )
        times = [
            fastest(step[i], most[i], robot.joints[i].acceleration, (begin[i], end[i]))
            for i in joints
        ]
        stretches[k] = max(stretches[k], *times)
    return max(whole, float(stretches.sum()))


def _straight_ways(robot: Robot, points: Array, speed: float) -> Array:
    """Time of the tip straight from point to point at a speed, (k,), s; points in the joints (k + 1, 4)."""
    if math.isinf(speed):
        return np.zeros(len(points) - 1)
    tips = tip_position(Mechanism.from_geometry(robot.geometry), points)
    return np.asarray(np.linalg.norm(np.diff(tips, axis=0), axis=1) / speed)


def rate_bound(robot: Robot, ends: Array, rates: Array, limits: TaskLimits) -> float:
    """The time that limits on the rates of angles allow between task coordinates at both ends (2, 4), s.

    rates (2, 4): at both ends.
    """
    bound = 0.0
    for name, rate in limits.rates.items():
        if name == "depth":  # it is joint 4's
            continue
        k, way = TASK.index(name), float(np.diff(ends[:, TASK.index(name)])[0])
        acceleration = angular_acceleration(robot, name, limits)
        speeds = (
            (None, None) if math.isinf(acceleration) else (float(rates[0, k]), float(rates[1, k]))
        )
        bound = max(bound, fastest(way, rate, acceleration, speeds))
    return bound


def angular_acceleration(robot: Robot, name: str, limits: TaskLimits) -> float:
    """What the accelerations of roll, tilt or spin stay below, as those of the joints and their velocities do, rad/s².

    The tool's axis turns about joint 2 on a circle of radius sin β, so that as functions of θ2, with φ the tilt,
    |φ'| ≤ sin β and |φ''| ≤ (sin β + |cos φ| sin² β)/sin φ, and of the azimuth ζ = ψ − θ1
    |ζ'| ≤ sin β/sin φ and |ζ''| ≤ (sin β + 2 |cos φ| sin² β/sin φ)/sin φ; of that of spin the same with α.
    """
    mechanism, (first, second, third, _) = Mechanism.from_geometry(robot.geometry), robot.joints
    low, high = limits.ranges.get("tilt", (-math.pi, math.pi))
    if not (-math.pi < low < high < 0 or 0 < low < high < math.pi):
        return math.inf
    sine = min(abs(math.sin(low)), abs(math.sin(high)))
    radius = math.sin(mechanism.alpha if name == "spin" else mechanism.beta)
    once, twice = (1.0, 1.0) if name == "tilt" else (1 / sine, 2 / sine)
    along = (
        radius * once * second.acceleration
        + (radius + twice * radius**2) / sine * second.velocity**2
    )
    return along + {"roll": first.acceleration, "tilt": 0.0, "spin": third.acceleration}[name]


def fastest(
    way: float,
    velocity: float,
    acceleration: float,
    speeds: tuple[float | None, float | None] = (0.0, 0.0),
) -> float:
    """The shortest time over a way of either sign with |v| and |a| limited, from one speed to another; None: free ones, s."""
    begin, end = (
        None if speed is None else float(math.copysign(1.0, way)) * speed for speed in speeds
    )
    way, known = abs(way), [speed for speed in (begin, end) if speed is not None]
    if begin is None or end is None:
        velocity = max([velocity, *map(abs, known)])
        if not known:
            return way / velocity
        # at the free end it is as fast as the way allows
        top = min(math.sqrt(known[0] ** 2 + 2 * acceleration * way), velocity)
        ramp = (top - known[0]) / acceleration
        return (
            ramp + (way - (top**2 - known[0] ** 2) / (2 * acceleration)) / top if top > 0 else ramp
        )
    return float(
        fastest_times(np.array(way), velocity, acceleration, (np.array(begin), np.array(end)))
    )


def fastest_times(
    way: Array, velocity: Array | float, acceleration: Array | float, speeds: tuple[Array, Array]
) -> Array:
    """As `fastest`, of arrays that broadcast; from given speeds to given ones."""
    sign = np.where(way < 0, -1.0, 1.0)
    way, begin, end = sign * way, sign * speeds[0], sign * speeds[1]
    direct = (begin + end) / 2 * np.abs(end - begin) / acceleration
    at_once = np.abs(way - direct) <= MOVES + ROUNDING * np.abs(direct)
    side = np.where(way < direct, -1.0, 1.0)  # it overshoots and comes back
    way, begin, end = side * way, side * begin, side * end
    squares = (begin**2 + end**2) / 2
    most = np.maximum(velocity, np.maximum(np.abs(begin), np.abs(end)))
    top = np.minimum(np.sqrt(np.maximum(acceleration * way + squares, 0.0)), most)
    cruise = (way - (top**2 - squares) / acceleration) / np.where(top > 0, top, 1.0)
    taken = (2 * top - begin - end) / acceleration + np.where(top > 0, cruise, 0.0)
    return np.asarray(np.where(at_once, np.abs(end - begin) / acceleration, taken))


def _time(robot: Robot, i: int, *, positions: Array, speeds: Array, velocity: float) -> float:
    """Shortest time of one joint alone through its positions (k + 1,), s."""
    joint = robot.joints[i]
    acceleration, steps = joint.acceleration, np.diff(positions)
    runs = _runs(positions)
    if not speeds.any():
        # where it turns back its velocity is zero, but with a jerk limit its acceleration need not be
        jerk = joint.jerk if len(runs) == 1 else None
        return sum(rest_time(run, velocity, acceleration, jerk) for run in runs)
    moved = steps[np.abs(steps) > MOVES]
    if len(runs) < 2:
        return fastest(float(moved.sum()), velocity, acceleration, (speeds[0], speeds[1]))
    # where it turns back it rests, beyond the point if it cannot stop before
    ends = speeds * np.sign(moved[[0, -1]])
    for k, speed in zip((0, -1), ends, strict=True):
        runs[k] = max(runs[k], max(speed, 0.0) ** 2 / (2 * acceleration))
    middle = sum(fastest(run, velocity, acceleration) for run in runs[1:-1])
    return (
        fastest(runs[0], velocity, acceleration, (ends[0], 0.0))
        + middle
        + fastest(runs[-1], velocity, acceleration, (0.0, ends[1]))
    )


def _runs(positions: Array) -> list[float]:
    """Distances between the points where the motion turns back."""
    runs: list[float] = []
    for step in np.diff(positions).tolist():
        if abs(step) <= MOVES:
            continue
        if runs and runs[-1] * step > 0:
            runs[-1] += step
        else:
            runs.append(step)
    return [abs(run) for run in runs]


@dataclass(frozen=True, eq=False)
class SCurve:
    """Pieces of linear acceleration: lengths (m,) in s, acceleration at their starts and ends (m,); begins at a speed."""

    lengths: Array
    start: Array
    end: Array
    speed: float = 0.0

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
        return SCurve(
            self.lengths * factor, self.start / factor**2, self.end / factor**2, self.speed / factor
        )

    def scaled(self, factor: float) -> SCurve:
        """The same motion over `factor` times the distance."""
        return SCurve(self.lengths, self.start * factor, self.end * factor, self.speed * factor)

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
        velocity = np.concatenate([[self.speed], self.speed + np.cumsum(gained)[:-1]])
        way, _ = Cubic(begin, velocity, self.start, self.end, self.lengths).end
        return (
            np.concatenate([[0.0], np.cumsum(way)[:-1]]),
            velocity,
            self.start,
            self.end,
            self.lengths,
        )

    def _piece(self, t: Array) -> Indices:
        return np.clip(
            np.searchsorted(self.switches, t, side="right") - 1, 0, len(self.lengths) - 1
        )

    @property
    def peaks(self) -> tuple[float, float, float]:
        """Largest velocity, acceleration and jerk (infinite where the acceleration jumps)."""
        _, velocity, _ = self.at(self.switches)
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


def rest_time(
    distance: float, velocity: float, acceleration: float, jerk: float | None = None
) -> float:
    """The duration of `rest_to_rest`, s."""
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
    """Peak speed of the motion that never cruises: v T_ramp(v) = distance."""
    if jerk is None:
        return math.sqrt(distance * acceleration)
    # acceleration limit reached: v (v/a + a/j) = d
    half = acceleration**2 / jerk
    speed = (-half + math.sqrt(half**2 + 4 * acceleration * distance)) / 2
    if speed >= half:
        return speed
    return (distance**2 * jerk / 4) ** (1 / 3)


def least_times(robot: Robot, ways: Array, tips: Array, limits: TaskLimits) -> Array:
    """Times (n,) of motions from rest to rest in which every joint moves by its way, (n, 4), and the tip by its own, (n,), s.

    The slowest joint alone, or the tip at its largest speed; the same as `rest_to_rest`, many at a time.
    """
    tip = min(
        (limit.largest for limit in limits.speeds if isinstance(limit, TipSpeed)), default=math.inf
    )
    times = np.asarray(tips) / tip
    for i, joint in enumerate(robot.joints):
        way, v, a, j = np.abs(ways[:, i]), joint.velocity, joint.acceleration, joint.jerk
        if i == 3:
            v = min(v, limits.rates.get("depth", math.inf))
        if j is None:
            speed = np.minimum(v, np.sqrt(way * a))
            ramp = speed / a
        else:
            half = a**2 / j
            reached = (-half + np.sqrt(half**2 + 4 * a * way)) / 2
            speed = np.minimum(v, np.where(reached >= half, reached, np.cbrt(way**2 * j / 4)))
            ramp = np.where(speed >= half, speed / a + a / j, 2 * np.sqrt(speed / j))
        times = np.maximum(times, ramp + way / np.maximum(speed, MOVES))
    return np.asarray(times)
