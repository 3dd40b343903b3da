"""A second opinion on durations: the package toppra times the path of a motion.

Nothing is shared with the planner. The path parameter s is the time of the motion, so q' and q''
are its velocities and accelerations, and the motion itself has ṡ = 1. Another timing of the path
has q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ². With u = s̈ and x = ṡ², every limit is a row
a u + b x + c ≤ 1. It holds at both ends of every grid interval, and u is constant in between. A
motion that keeps its limits is thus one of the timings that toppra compares, so that no figure is
above its duration.

Friction depends on the speed, and viscous friction on √x. Every pass takes the coefficients of
friction, and the tangents of √x, at the speed of the previous pass. The first pass takes those of
the motion.

The error of a duration T is proportional to the length of the grid intervals. The result is the
limit 2 T(2n) − T(n) of the durations on n and 2n intervals.

Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ssm_planner.dynamics import (
    STILL,
    RigidBody,
    friction_coefficient,
    friction_of,
    motor_torque_rows,
    motorised,
    output_effort,
)
from ssm_planner.kinematics import Mechanism, task_rates, tool_speed
from ssm_planner.problem import TASK, Dwell, Problem, Robot, TaskLimits
from ssm_planner.toppra_passes import largest_speeds
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record

INTERVALS = 200
"""Smallest number n of grid intervals of a motion. Every polynomial piece has at least one."""
REFINEMENTS = (1, 2, 4, 8)
"""Factors on the number of intervals."""
GRID_ERROR = 5e-5
"""Relative difference of T(n) and T(2n) that ends the refinement. The result is then within 1e-5.
"""
SAVED_ERROR = 0.05
"""The same relative to the time that toppra saves, for motions that are much too slow."""
PASSES = 12
"""Largest number of passes."""
CONVERGED = 2e-6
"""Relative change of the duration at which the passes have converged."""
FASTEST = 10.0
"""Largest ṡ. No limit bounds it where nothing moves."""
TINY = 1e-9
"""Smallest use of a speed limit, and smallest ṡ² at which a tangent is taken."""
PROBES = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
"""Values of (s̈, ṡ) at which the laws are evaluated. They determine the coefficients of a row."""


def second_opinions(trajectory: Trajectory, problem: Problem) -> tuple[float | str, ...]:
    """Return the shortest duration along the path of every phase, or why there is none.

    Parameters
    ----------
    trajectory : Trajectory
        The motion. Only its polynomials and phases count.
    problem : Problem
        The problem with robot and limits.

    Returns
    -------
    tuple of float or str
        For each phase its duration in s, or the reason why toppra cannot judge it. A phase that
        takes no time has the duration 0.
    """
    reason = _not_judged(problem)
    spans = trajectory.phases
    requests = [_request(entry) for entry in problem.motion]
    if len(requests) != len(spans):  # scans and rounded corners
        requests = [next(filter(None, requests), "")] * len(spans)
    return tuple(
        0.0
        if span.start == span.end
        else reason
        or request
        or path_duration(trajectory, problem.robot, problem.task_limits, span.start, span.end)
        or "toppra does not converge"
        for span, request in zip(spans, requests, strict=True)
    )


def path_duration(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, start: float, end: float
) -> float | None:
    """Return the shortest duration along the path of a motion between two times.

    Parameters
    ----------
    trajectory : Trajectory
        The motion. It only serves as a path.
    robot : Robot
        The robot with its limits.
    limits : TaskLimits
        Limits on task rates and on the speed of the tool.
    start, end : float
        Times in s, at breaks of the trajectory.

    Returns
    -------
    float or None
        Duration in s, or None if toppra finds no motion or does not converge.
    """
    coarse = np.inf
    for refinement in REFINEMENTS:
        path = _Path.from_trajectory(trajectory, robot, start, end, refinement)
        duration = path.duration(path.ceiling(limits))
        if duration is None:
            return None
        saved = end - start - duration
        if abs(coarse - duration) <= max(GRID_ERROR * duration, SAVED_ERROR * saved):
            return 2 * duration - coarse
        coarse = duration
    return None


def _not_judged(problem: Problem) -> str:
    """Return the reason why toppra cannot judge the motions of a problem, or an empty text."""
    if problem.robot.jerk_limited:
        return "toppra ignores limits on jerk"
    if problem.friction is not None or problem.payload is not None:
        return "it ignores ranges of friction and payload"
    if problem.stop_travel is not None:
        return "it ignores stop_travel"
    return "" if problem.duration is None else "a duration is requested"


def _request(entry: Any) -> str:
    """Return the request of an entry that toppra ignores, or an empty text."""
    if getattr(entry, "constant_speed", None) is not None:
        return "a constant speed is requested"
    timed = entry.duration is not None and not isinstance(entry, Dwell)
    return "a duration is requested" if timed else ""


@record
class _Path:
    """A path at both ends of n grid intervals: first all their beginnings, then all their ends.

    The joint motions at the PROBES determine the rows.
    """

    robot: Robot
    width: Array
    """Lengths of the intervals, (n,), s."""
    q: Array
    """Joint positions, (2n, 4)."""
    direction: Array
    """Direction of every joint in the interval, (2n, 4). 0: it stands."""
    speed: Array
    acceleration: Array
    effort: Array
    """q̇, q̈ and joint efforts at the PROBES, (4, 2n, 4)."""

    @classmethod
    def from_trajectory(
        cls, trajectory: Trajectory, robot: Robot, start: float, end: float, refinement: int
    ) -> _Path:
        """Return the path between two times."""
        first = int(trajectory.piece_of(np.array([start]))[0])
        last = int(trajectory.piece_of(np.array([end]), "left")[0])
        lengths = np.diff(trajectory.breaks[first : last + 2])
        counts = np.maximum(np.rint(INTERVALS * lengths / lengths.sum()), 1).astype(int)
        counts *= refinement
        pieces = np.repeat(np.arange(first, last + 1), counts)
        width = np.repeat(lengths / counts, counts)
        before = width * (np.arange(len(pieces)) - np.repeat(np.cumsum(counts) - counts, counts))
        both = np.concatenate([before, before + width])
        samples = trajectory.sample_pieces(np.tile(pieces, 2), both)
        moved = np.diff(samples.q.reshape(2, -1, 4), axis=0)[0]
        slowest = STILL * np.array([joint.velocity for joint in robot.joints])
        moves = np.abs(moved) > slowest * width[:, None]
        speed = np.stack([rate * samples.qd for _, rate in PROBES])
        acceleration = np.stack([u * samples.qd + rate**2 * samples.qdd for u, rate in PROBES])
        body = RigidBody.from_robot(robot)
        motions = zip(speed, acceleration, strict=True)
        effort = np.stack([body.inverse_dynamics(samples.q, *motion) for motion in motions])
        direction = np.tile(np.sign(moved) * moves, (2, 1))
        return cls(
            robot,
            width,
            samples.q,
            direction,
            speed=speed,
            acceleration=acceleration,
            effort=effort,
        )

    def duration(self, ceiling: Array) -> float | None:
        """Return the duration after all passes, s. None: no motion, or no convergence.

        `ceiling` (n + 1,) bounds ṡ² at the grid points.
        """
        squares, grid = np.ones(len(self.width) + 1), np.append(0.0, np.cumsum(self.width))
        duration = self.width.sum()
        for _ in range(PASSES):
            previous, rows = duration, self._rows(squares)
            begin, end = zip(*(np.split(values, 2) for values in rows), strict=True)
            # The ends may be slower than those of the motion, which may exceed a limit by rounding.
            result = largest_speeds(grid, begin, end, ceiling, speeds=(1.0, 1.0), exact_ends=False)
            if result is None or result.min() <= 0:
                return None
            squares, root = result, np.sqrt(result)
            duration = float((2 * self.width / (root[1:] + root[:-1])).sum())
            if abs(duration - previous) <= CONVERGED * duration:
                return duration
        return None

    def ceiling(self, limits: TaskLimits) -> Array:
        """Return the largest ṡ² at the grid points that limits on speeds allow, (n + 1,)."""
        limit = np.array([joint.velocity for joint in self.robot.joints])
        for i, drive, motor in motorised(self.robot.joints):
            limit[i] = min(limit[i], motor.max_speed / drive.ratio)
        mechanism = Mechanism.from_geometry(self.robot.geometry)
        qd = self.speed[2]
        uses = [np.full(len(qd), TINY), *(np.abs(qd) / limit).T]
        for bound in limits.speeds:
            uses.append(tool_speed(type(bound), mechanism, self.q, qd) / bound.largest)
        if limits.rates:
            rates = np.abs(task_rates(mechanism, self.q, qd))
            uses += [rates[:, TASK.index(name)] / rate for name, rate in limits.rates.items()]
        fastest = np.where(self.direction.any(axis=1), FASTEST, 1.0)
        begin, end = np.split(np.minimum(1 / np.max(uses, axis=0), fastest) ** 2, 2)
        return np.minimum(np.append(begin, np.inf), np.append(np.inf, end))

    def _rows(self, squares: Array) -> tuple[Array, Array, Array]:
        """Return a, b, c (2n, rows) of the rows, with friction at given ṡ² (n + 1,)."""
        u = np.tile(np.diff(squares) / (2 * self.width), 2)
        x = np.concatenate([squares[:-1], squares[1:]])
        root = np.sqrt(np.maximum(x, TINY))
        rows = []
        for joint, values in zip(self.robot.joints, self.acceleration.T, strict=True):
            rows += [values.T / joint.acceleration, -values.T / joint.acceleration]
        for i, drive, motor in motorised(self.robot.joints):
            speed, acceleration = self.speed[..., i], self.acceleration[..., i]
            direction = self.direction[:, i]
            mu = friction_coefficient(friction_of(drive), drive.ratio * speed[2] * root)
            law = motor_torque_rows(drive, direction, mu)
            effort = output_effort(drive, self.effort[..., i], speed, acceleration, direction)
            motion = drive.ratio * speed, drive.ratio * acceleration
            sides = [
                direction * law.torque(slope * effort, *motion) / motor.max_torque
                for slope in law.slope
            ]
            used = []
            for side in sides:
                a, b, c, k = _coefficients(side)
                used.append(a * u + b * x + c + k * root)
            # The larger side is the torque, and the torque is at least −1.
            rows += [*sides, -np.where(used[0] > used[1], *sides)]
        a, b, c, k = _coefficients(np.stack(rows, axis=2))
        root = root[:, None]
        return a, b + k / (2 * root), c + k * root / 2


def _coefficients(values: Array) -> tuple[Array, Array, Array, Array]:
    """Return a, b, c and k of a u + b x + c + k √x from its values (4, ...) at the PROBES."""
    at_rest, pushed, forwards, backwards = values
    return (
        pushed - at_rest,
        (forwards + backwards) / 2 - at_rest,
        at_rest,
        (forwards - backwards) / 2,
    )
