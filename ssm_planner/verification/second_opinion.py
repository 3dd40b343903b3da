"""A second opinion on durations: the package toppra computes the fastest timing of a path.

The path of a planned motion is kept, and only its timing is computed again. If toppra finds a much
shorter duration, the planner missed it. The planner and this module share only the module that
calls toppra. The main function is `second_opinions`.

The path parameter s is the time of the motion. With u = s̈ and x = ṡ², every limit of `path_rows`
is a row a u + b x + c ≤ 1. In every interval of the grid, u is constant, and the mean of every row
over the interval must be at most 1. Simpson's rule computes the mean. Every row must also permit
the speeds at the grid points: there must be some u that satisfies all rows of the point.

Friction depends on the speed, and viscous friction on √x. On every grid, the friction coefficients
and the tangents of √x are taken at the speeds of the previous grid. The first grid takes them at
the speeds of the motion.

The error of a duration T is proportional to the squared length of the grid intervals. The result
is therefore the extrapolation T(2n) + (T(2n) − T(n))/3 of the durations on n and 2n intervals. The
grid is refined until this correction is at most `GRID_TOLERANCE`.

Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018.
"""

from typing import Any

import numpy as np

from ssm_planner.dynamics import (
    REST_FRACTION,
    friction_coefficient,
    motorised_joints,
    required_friction,
)
from ssm_planner.problem import Dwell, Problem, Robot, TaskLimits
from ssm_planner.toppra_passes import largest_speeds
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record
from ssm_planner.verification.path_bound import Sensitivity, path_bound
from ssm_planner.verification.path_rows import (
    POINT_POSITIONS,
    SIMPSON_WEIGHTS,
    PathRows,
    row_coefficients,
)
from ssm_planner.verification.proof import Proof, prove_motion

GRID_TOLERANCE = 1e-5
"""Largest relative correction of toppra's duration by extrapolation, which estimates its error.

A duration below the bound by more than this tolerance is an error of toppra.
"""
MAX_PATH_SPEED = 10.0
"""Largest ṡ. Where the velocities of all joints are 0 for an instant, no other limit bounds ṡ."""
MIN_SQUARED_SPEED = 1e-9
"""Smallest ṡ² at which a tangent is taken."""
REVERSAL_MARGIN = 1e-3
"""Largest |a|/b, as a share of an interval, at which a row does not limit s̈ but only ṡ²."""
MIN_COEFFICIENT = 1e-30
"""Lower limit of |a|, which prevents a division by 0."""
CEILING_STEPS = 5
"""Number of Newton steps that find the largest ṡ² at a point."""


@record
class Opinion:
    """Result of the cross-check of one phase: two durations in s, or a reason for their absence.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Opinion(duration=2.1491, bound=2.149).not_judged is None
    True
    """

    duration: float | None = None
    """Shortest duration along the path according to toppra, s."""
    bound: float | None = None
    """Lower bound on the duration of every motion along the path, s."""
    sensitivities: tuple[Sensitivity, ...] | None = None
    """Changes of the duration with the limits. None if toppra cannot judge the phase."""
    not_judged: str | None = None
    """Reason why toppra does not give a duration."""


def second_opinions(trajectory: Trajectory, problem: Problem) -> tuple[Opinion, ...]:
    """Compute the shortest duration of every phase along its path.

    Parameters
    ----------
    trajectory : Trajectory
        The motion. Only its polynomials and phases count.
    problem : Problem
        The problem with robot and limits.

    Returns
    -------
    tuple of Opinion
        One for each phase (the part of the trajectory for one motion). The duration of an empty
        phase is 0. The duration is None if toppra ignores a requirement on the phase, such as a
        limit on the jerk.
    """
    reason = _unsupported_requirement(problem)
    spans = trajectory.phases
    requests = [reason or _unsupported_request(entry) for entry in problem.motion]
    # With scans or rounded corners, the numbers of motions and phases differ. A motion that toppra
    # cannot judge then excludes all phases.
    if len(requests) != len(spans):
        requests = [next(filter(None, requests), "")] * len(spans)
    opinions = []
    for span, request in zip(spans, requests, strict=True):
        if span.start == span.end:
            opinions.append(Opinion(duration=0.0, bound=0.0, sensitivities=()))
        elif request:
            opinions.append(Opinion(not_judged=request))
        else:
            arguments = trajectory, problem.robot, problem.task_limits
            opinions.append(shortest_path_duration(*arguments, (span.start, span.end)))
    return tuple(opinions)


def second_opinions_and_proofs(
    trajectory: Trajectory, problem: Problem
) -> tuple[tuple[Opinion, ...], tuple[Proof, ...]]:
    """Compute the second opinions and the proofs of a motion with one call.

    A separate process calls this function while the main process continues.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    problem : Problem
        The problem with robot and limits.

    Returns
    -------
    opinions : tuple of Opinion
        One second opinion (durations by toppra) for each phase of the trajectory.
    proofs : tuple of Proof
        One proof (bounds over continuous time by prove.py) for each limit.
    """
    return second_opinions(trajectory, problem), prove_motion(trajectory, problem)


def shortest_path_duration(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    span: tuple[float, float],
) -> Opinion:
    """Compute the shortest duration along a path with toppra, and a lower bound on it.

    Parameters
    ----------
    trajectory : Trajectory
        The motion. Only its path counts, and not its timing.
    robot : Robot
        The robot with its limits.
    limits : TaskLimits
        Limits on task rates and on the speed of the tool.
    span : (float, float)
        Start and end of the path as times of the trajectory, s. Both are breaks.

    Returns
    -------
    Opinion
        Duration, lower bound and sensitivities. The duration is None if toppra finds no timing or
        does not converge.
    """
    grid, squares = np.array(span) - span[0], np.ones(2)
    duration = np.inf
    for refinement in (1, 2, 4, 8, 16, 32):
        path = PathRows.from_trajectory(trajectory, robot, span, refinement)
        if not path.moves.any():
            return Opinion(grid[-1], grid[-1], ())
        squares, grid = np.interp(path.grid, grid, squares), path.grid
        result = _fastest_timing(path, limits, squares)
        if result is None:
            break
        squares = result
        coarse, duration = duration, _timing_duration(path, squares)
        # After the first grid, the error is infinite, so that the refinement continues.
        error = (coarse - duration) / 3
        if abs(error) <= GRID_TOLERANCE * duration:
            bound, changes = path_bound(path, limits, squares)
            estimate, proven = duration - error, bound or 0.0
            # If the estimate is below the bound, one of them needs a finer grid.
            if estimate >= (1 - GRID_TOLERANCE) * proven:
                return Opinion(max(estimate, proven), bound, changes)
    bound, _ = path_bound(path, limits, squares)
    return Opinion(bound=bound, not_judged="toppra does not converge")


def _unsupported_requirement(problem: Problem) -> str:
    """Return the reason why toppra cannot judge any motion of a problem.

    Parameters
    ----------
    problem : Problem
        The problem with robot and limits.

    Returns
    -------
    str
        The reason, or an empty text if toppra can judge motions of this problem.
    """
    if problem.robot.jerk_limited:
        return "toppra ignores limits on jerk"
    if problem.friction is not None or problem.payload is not None:
        return "toppra ignores ranges of friction and payload"
    if problem.stop_travel is not None:
        return "toppra ignores stop_travel"
    return "" if problem.duration is None else "a duration is requested"


def _unsupported_request(entry: Any) -> str:
    """Return the reason why toppra cannot judge one motion of a problem.

    Parameters
    ----------
    entry : Motion
        An entry of `motion` in the problem file.

    Returns
    -------
    str
        The reason, or an empty text if toppra can judge the motion.
    """
    if getattr(entry, "constant_speed", None) is not None:
        return "a constant speed is requested"
    timed = entry.duration is not None and not isinstance(entry, Dwell)
    return "a duration is requested" if timed else ""


def _fastest_timing(path: PathRows, limits: TaskLimits, squares: Array) -> Array | None:
    """Compute the fastest timing of a path with toppra.

    Friction depends on the speed, which is the result. It is taken at given speeds.

    Parameters
    ----------
    path : PathRows
        The path with n intervals.
    limits : TaskLimits
        Limits on task rates and on the speed of the tool.
    squares : (n + 1,) array
        ṡ² at the grid points, at which the friction is taken.

    Returns
    -------
    (n + 1,) array or None
        ṡ² at the grid points. None if toppra finds no timing.
    """
    speed_ratio = path.largest_speed_ratio(limits)
    # A rest keeps its duration for every ṡ.
    max_speed = np.minimum(1 / speed_ratio, MAX_PATH_SPEED)
    max_square = max_speed.reshape(len(POINT_POSITIONS), -1)[[0, -1]] ** 2
    # An end at rest rests for every ṡ. At a moving end ṡ ≤ 1 is allowed, because the motion itself
    # may exceed a limit by rounding.
    is_rest = speed_ratio[[0, -1]] <= REST_FRACTION
    rows = _linear_rows(path, squares)
    start, end = np.minimum(max_square, _largest_squares(rows, path.lengths))
    ceiling = np.minimum(np.append(start, np.inf), np.append(np.inf, end))
    # The gain x₁ − x₀ of ṡ² is s̈ on a grid with intervals of the length 1/2.
    result = largest_speeds(
        np.arange(len(squares)) / 2,
        _mean_rows(rows, path.lengths),
        rows[:, 0, :, :0],
        ceiling,
        speeds=np.sqrt(np.where(is_rest, ceiling[[0, -1]], 1.0)),
        exact_ends=False,
    )
    return result if result is not None and result.min() > 0 else None


def _largest_squares(rows: Array, lengths: Array) -> Array:
    """Compute the largest ṡ² at which some s̈ satisfies all rows, at both ends of every interval.

    With x = ṡ², a row limits s̈ by (1 − c − b x) / a: from above if a > 0, and from below if a < 0.
    The distance between the smallest upper and the largest lower limit is a concave and piecewise
    linear function of x. Newton's method finds its zero.

    Parameters
    ----------
    rows : (3, 5, n, rows) array
        Coefficients a, b and c of the rows at the five points of all intervals.
    lengths : (n,) array
        Lengths of the intervals, s.

    Returns
    -------
    (2, n) array
        Largest ṡ² at the starts and at the ends of the intervals.
    """
    a, b, c = rows[:, [0, -1]]
    a = np.where(np.abs(a) < REVERSAL_MARGIN * lengths[:, None] * np.abs(b), 0.0, a)
    scale = np.maximum(np.abs(a), MIN_COEFFICIENT)
    limit_at_rest, slope = (1 - c) / scale, b / scale
    x = np.full(a.shape[:2], MAX_PATH_SPEED**2)
    for _ in range(CEILING_STEPS):
        limit = limit_at_rest - slope * x[..., None]
        pair = [np.where(side, limit, np.inf).argmin(axis=2) for side in (a >= 0, a <= 0)]
        distance_at_rest, total_slope = (
            sum(np.take_along_axis(values, row[..., None], 2)[..., 0] for row in pair)
            for values in (limit_at_rest, slope)
        )
        zero = np.divide(distance_at_rest, total_slope, out=x.copy(), where=total_slope > 0)
        x = np.clip(zero, 0.0, x)
    return x


def _mean_rows(rows: Array, lengths: Array) -> tuple[Array, Array, Array]:
    """Compute the means of the rows over the intervals, as rows in the gain of ṡ² and in ṡ².

    With the squared speeds x₀ and x₁ at the ends of an interval of the length Δ, s̈ is
    (x₁ − x₀)/(2Δ), and the mean of a row is p x₀ + q x₁ + r. toppra finds the fastest timing only
    if a larger x₀ does not reduce the largest x₁. Where a changes its sign, p and q can both be
    positive. The larger of them is then replaced by p + q, and the other one by 0.

    Parameters
    ----------
    rows : (3, 5, n, rows) array
        Coefficients a, b and c of the rows at the five points of all intervals.
    lengths : (n,) array
        Lengths Δ of the intervals, s.

    Returns
    -------
    q, p + q, r : (n, rows) arrays
        Coefficients of x₁ − x₀, of x₀, and of 1.
    """
    a, b, c = np.tensordot(SIMPSON_WEIGHTS[1], rows, (0, 1))
    q = a / (2 * lengths[:, None])
    q += np.tensordot(SIMPSON_WEIGHTS[1] * POINT_POSITIONS, rows[1], 1)
    both = np.minimum(q, b - q) > 0
    return np.where(both, np.where(2 * q > b, b, 0.0), q), b, c


def _timing_duration(path: PathRows, squares: Array) -> float:
    """Compute the duration of a timing.

    Parameters
    ----------
    path : PathRows
        The path with n intervals.
    squares : (n + 1,) array
        ṡ² at the grid points. s̈ is constant in between. Rests keep their durations.

    Returns
    -------
    float
        Duration, s.
    """
    root = np.sqrt(squares)
    mean_speed = (root[1:] + root[:-1]) / 2
    return float((path.lengths / np.where(path.moves[: len(mean_speed)], mean_speed, 1.0)).sum())


def _linear_rows(path: PathRows, squares: Array) -> Array:
    """Compute the limits on accelerations and torques as rows a s̈ + b ṡ² + c ≤ 1.

    Viscous friction adds a term in ṡ = √x with x = ṡ². It is linearised by the tangent at given
    values x₀, √x ≤ √x₀/2 + x/(2 √x₀).

    Parameters
    ----------
    path : PathRows
        The path with n intervals.
    squares : (n + 1,) array
        x₀ at the grid points. The friction coefficients are those at these speeds.

    Returns
    -------
    (3, 5, n, rows) array
        Coefficients a, b and c at the five points of all intervals.
    """
    positions = np.array(POINT_POSITIONS)[:, None]
    gained = np.diff(squares)
    u = np.tile(gained / (2 * path.lengths), len(positions))
    x = (squares[:-1] + positions * gained).ravel()
    root = np.sqrt(np.maximum(x, MIN_SQUARED_SPEED))
    rows = path.acceleration_rows()
    for i, drive, motor in motorised_joints(path.robot.joints):
        mu = friction_coefficient(
            required_friction(drive), drive.ratio * path.speed[2, :, i] * root
        )
        row_1, row_2 = path.torque_rows(i, drive, motor, mu)
        a, b, c, k = row_coefficients(row_1 - row_2)
        # The larger row is the torque in the direction of motion, as a share of the limit. It is at
        # least −1 if the motor can brake.
        torque = np.where(a * u + b * x + c + k * root > 0, row_1, row_2)
        rows += [row_1, row_2, -torque]
    a, b, c, k = row_coefficients(np.stack(rows, axis=2))
    root = root[:, None]
    coefficients = a, b + k / (2 * root), c + k * root / 2
    return np.reshape(coefficients, (3, len(positions), len(gained), -1))
