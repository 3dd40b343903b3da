"""A second opinion on durations: TOPP-RA by the package toppra along the path of a motion.

The package knows nothing of the planner. Each part of the motion between two rests is a path q(s)
with ds/dt = |(q̇_i / v_i)|, where v holds the velocity limits. Along it q̇ = q' ṡ and q̈ = q' s̈ +
q'' ṡ², so that with u = s̈ and x = ṡ² every limit is a row a u + b x + c ≤ 1. Friction depends on
the speed, so its rows are those at the speed of the previous pass. Passes are repeated until the
duration no longer changes.

Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_coefficient, friction_of
from ssm_planner.dynamics.motors import motorised
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque_rows
from ssm_planner.kinematics import Mechanism
from ssm_planner.kinematics.forward import tool_speed
from ssm_planner.kinematics.task import task_rates
from ssm_planner.problem import TASK, Robot, TaskLimits
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record

FEWEST, MOST = 300, 4800
"""Smallest and largest number of grid intervals of one part of a motion."""
GRID_ERROR = 5e-5
"""Relative change of the duration, when the grid intervals are halved, that ends the refinement."""
KEPT = 0.01
"""Share of a part at each end that keeps the plan's timing. Where all joints rest, q'' is infinite."""
PASSES = 8
"""Largest number of passes."""
CONVERGED = 1e-6
"""Relative change of the duration from which on the passes have converged."""
TINY = 1e-9
"""Smallest coefficient of a row that counts, and smallest ṡ²."""
REST = 1e-6
"""Largest ṡ of a motion at rest."""


@record
class PathGrid:
    """Points of a path: q, q' and q'' (n, 4), s and the plan's ṡ² (n,), and the time kept, s."""

    s: Array
    q: Array
    dq: Array
    ddq: Array
    speed_squared: Array
    kept: float


def path_duration(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, start: float, end: float
) -> float | None:
    """Return the shortest duration along the path of a motion between two times.

    Parameters
    ----------
    trajectory : Trajectory
        The motion, whose path counts.
    robot : Robot
        The robot with its limits.
    limits : TaskLimits
        Limits on task rates and on the speed of the tool.
    start, end : float
        Times in s.

    Returns
    -------
    float or None
        Duration in s, or None if the package finds no motion or does not converge.
    """
    parts = list(_parts(trajectory, robot, start, end))
    pieces = int(np.sum((trajectory.breaks > start) & (trajectory.breaks < end)))
    intervals, previous = max(FEWEST, pieces), np.inf
    while intervals <= MOST:
        durations = [
            _retimed(_grid(trajectory, robot, *part, intervals), robot, limits) for part in parts
        ]
        if None in durations:
            return None
        duration = float(sum(durations))
        if abs(duration - previous) <= GRID_ERROR * duration:
            return duration
        intervals, previous = 2 * intervals, duration
    return None


def _speed(robot: Robot, qd: Array) -> Array:
    """Return ṡ of samples, (n,)."""
    return np.asarray(np.linalg.norm(qd * _weights(robot), axis=1))


def _weights(robot: Robot) -> Array:
    """Return w of ṡ = |(w_i q̇_i)|, (4,)."""
    return np.array([1 / joint.velocity for joint in robot.joints])


def _parts(
    trajectory: Trajectory, robot: Robot, start: float, end: float
) -> Iterator[tuple[float, float]]:
    """Yield the intervals of time between two rests."""
    breaks = trajectory.breaks
    inside = breaks[(breaks > start) & (breaks < end)]
    times = np.concatenate([[start], inside, [end]])
    rests = _speed(robot, trajectory.sample(times, clamp=True).qd) < REST
    rests[[0, -1]] = True
    times = times[rests]
    for first, last in pairwise(times):
        if _speed(robot, trajectory.sample([(first + last) / 2]).qd)[0] > REST:
            yield first, last


def _grid(
    trajectory: Trajectory, robot: Robot, start: float, end: float, intervals: int
) -> PathGrid:
    """Return the grid of the part of a motion between two times."""
    kept = KEPT * (end - start)
    first, last = start + kept, end - kept
    breaks = trajectory.breaks
    breaks = np.concatenate([[first], breaks[(breaks > first) & (breaks < last)], [last]])
    lengths = np.diff(breaks)
    counts = np.maximum(np.round(intervals * lengths / lengths.sum()).astype(int), 1)
    times = np.concatenate(
        [
            begin + length * np.arange(count) / count
            for begin, length, count in zip(breaks[:-1], lengths, counts, strict=True)
        ]
        + [[last]]
    )
    samples = trajectory.sample((times[1:] + times[:-1]) / 2)
    speed = _speed(robot, samples.qd)
    acceleration = (samples.qd * samples.qdd * _weights(robot) ** 2).sum(axis=1) / speed
    dq = samples.qd / speed[:, None]
    ddq = (samples.qdd - dq * acceleration[:, None]) / speed[:, None] ** 2
    # Simpson's rule gives the length of each interval.
    at_ends = _speed(robot, trajectory.sample(times).qd)
    s = np.concatenate(
        [[0.0], np.cumsum(np.diff(times) * (at_ends[1:] + 4 * speed + at_ends[:-1]) / 6)]
    )
    return PathGrid(s, samples.q, dq, ddq, at_ends**2, 2 * kept)


def _retimed(grid: PathGrid, robot: Robot, limits: TaskLimits) -> float | None:
    """Return the shortest duration of one part, or None if the package finds none."""
    ceiling = _ceiling(grid, robot, limits)
    speed_squared, previous = grid.speed_squared, np.inf
    for _ in range(PASSES):
        rows = _rows(grid, robot, speed_squared)
        rows.append(np.stack([np.zeros_like(ceiling), 1 / ceiling, np.zeros_like(ceiling)]))
        result = _toppra(grid, rows)
        if result is None:
            return None
        # ṡ² may alternate between the ends of intervals, because rows hold in their middle only.
        middle = (result[1:] + result[:-1]) / 2
        if middle.min() <= 0:
            return None
        duration = float((np.diff(grid.s) / np.sqrt(middle)).sum()) + grid.kept
        if abs(duration - previous) <= CONVERGED * duration:
            break
        speed_squared, previous = result, duration
    return duration


def _ceiling(grid: PathGrid, robot: Robot, limits: TaskLimits) -> Array:
    """Return the largest ṡ² (n,) that the limits on speeds allow."""
    limit = np.array([joint.velocity for joint in robot.joints])
    for i, drive, motor in motorised(robot.joints):
        limit[i] = min(limit[i], motor.max_speed / drive.ratio)
    mechanism = Mechanism.from_geometry(robot.geometry)
    with np.errstate(divide="ignore"):
        speed = (limit / np.abs(grid.dq)).min(axis=1)
        for bound in limits.speeds:
            speed = np.minimum(
                speed, bound.largest / tool_speed(type(bound), mechanism, grid.q, grid.dq)
            )
        rates = np.abs(task_rates(mechanism, grid.q, grid.dq)) if limits.rates else None
        for name, rate in limits.rates.items():
            speed = np.minimum(speed, rate / rates[:, TASK.index(name)])
    return np.asarray(speed**2)


def _rows(grid: PathGrid, robot: Robot, speed_squared: Array) -> list[Array]:
    """Return the rows a, b, c (3, n) of a u + b x + c ≤ 1, for friction at ṡ² and s̈ (n,)."""
    rows = []
    for i, joint in enumerate(robot.joints):
        row = np.stack([grid.dq[:, i], grid.ddq[:, i], np.zeros(len(grid.q))]) / joint.acceleration
        rows += [row, -row]
    body = RigidBody.from_robot(robot)
    still = np.zeros_like(grid.q)
    gravity = body.inverse_dynamics(grid.q, still, still)
    inertia = body.inverse_dynamics(grid.q, still, grid.dq) - gravity
    centrifugal = body.inverse_dynamics(grid.q, grid.dq, grid.ddq) - gravity
    slope = np.diff(speed_squared) / (2 * np.diff(grid.s))
    middle = (speed_squared[1:] + speed_squared[:-1]) / 2
    root = np.sqrt(np.maximum(middle, TINY))
    for i, drive, motor in motorised(robot.joints):
        dq, ddq = grid.dq[:, i], grid.ddq[:, i]
        direction = np.where(dq < 0, -1.0, 1.0)
        mu = friction_coefficient(friction_of(drive), drive.ratio * np.abs(dq) * root)
        friction = friction_of(drive)
        law = motor_torque_rows(drive, direction, mu)
        # Coefficients of s̈, ṡ², 1 and ṡ.
        effort = np.stack(
            [
                inertia[:, i] + drive.output_inertia * dq,
                centrifugal[:, i] + drive.output_inertia * ddq,
                gravity[:, i] + friction.b_oc * direction,
                friction.b_ov * dq,
            ]
        )
        motor_speed = drive.ratio * dq
        own = np.stack(
            [
                law.inertia * motor_speed,
                law.inertia * drive.ratio * ddq,
                law.coulomb,
                law.viscous * motor_speed,
            ]
        )
        for mesh in law.slope:
            a, b, c, k = direction * (mesh * effort + own) / motor.max_torque
            # The tangent √x ≈ √x₀/2 + x/(2 √x₀) at the speed of the previous pass.
            rows.append(np.stack([a, b + k / (2 * root), c + k * root / 2]))
        first, second = rows[-2:]
        values = [row[0] * slope + row[1] * middle + row[2] for row in (first, second)]
        rows.append(-np.where(values[0] > values[1], first, second))
    return rows


def _toppra(grid: PathGrid, rows: Sequence[Array]) -> Array | None:
    """Return ṡ² (n,) by the package toppra, or None if it finds no motion."""
    import toppra
    from toppra.constraint import LinearConstraint
    from toppra.interpolator import AbstractGeometricPath

    toppra.setup_logging("CRITICAL")

    class Path(AbstractGeometricPath):  # type: ignore[misc, no-any-unimported]
        dof = 4
        path_interval = grid.s[[0, -1]]
        waypoints = None

    class Rows(LinearConstraint):  # type: ignore[misc, no-any-unimported]
        def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
            a, b, c = np.stack(rows, axis=2)
            # The rows hold in the middle of each interval, where x is that of its start + u Δs.
            a = a + b * np.diff(grid.s)[:, None]
            # The solver of the package fails if all coefficients of a row are small.
            largest = np.maximum(np.maximum(np.abs(a), np.abs(b)), TINY)
            a, b, c = (values / largest for values in (a, b, c - 1))
            a, b, c = (np.concatenate([values, values[-1:]]) for values in (a, b, c))
            return a, b, c, np.eye(a.shape[1]), np.zeros(a.shape[1]), None, None

    constraint = Rows()
    constraint.identical = True
    algorithm = toppra.algorithm.TOPPRA([constraint], Path(), grid.s, solver_wrapper="seidel")
    start, end = np.sqrt(grid.speed_squared[[0, -1]])
    # Both ends may be slower than the plan, because rounding can make its speed infeasible.
    controllable = algorithm.compute_controllable_sets(0.0, end)
    algorithm.compute_controllable_sets = lambda *_: controllable
    start = min(start, np.sqrt(controllable[0, 1]))
    _, speed, _, _ = algorithm.compute_parameterization(start, end, return_data=True)
    if speed is None or not np.all(np.isfinite(speed)):
        return None
    return np.asarray(speed, dtype=float) ** 2
