"""A second opinion on durations: the package toppra computes the fastest timing of a path.

The path of a planned motion is kept, and only its timing is computed again. If toppra finds a much
shorter duration, the planner missed it. The planner and this module share only the module that
calls toppra. The main function is `second_opinions`.

The path parameter s is the time of the motion. With u = s̈ and x = ṡ², every limit of `path_rows`
is a row a u + b x + c ≤ 1. toppra imposes the row at both ends of every grid interval, and u is
constant in between. The timings that toppra compares therefore include every motion that keeps its
limits, up to the error of the grid.

Friction depends on the speed, and viscous friction on √x. In every pass, the friction coefficients
and the tangents of √x are taken at the speeds of the previous pass. The first pass takes them at
the speeds of the motion.

The error of a duration T is proportional to the length of the grid intervals. The result is
therefore the extrapolation 2 T(2n) − T(n) of the durations on n and 2n intervals. The grid is
refined until the estimated error is at most `GRID_TOLERANCE`.

Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018.
"""

from collections.abc import Sequence
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
from ssm_planner.verification.path_rows import PathRows, row_coefficients
from ssm_planner.verification.proof import Proof, prove_motion

GRID_TOLERANCE = 1e-5
"""Largest estimate of the relative error of toppra's duration at which the refinement ends.

The estimate is the median of three differences: between T(n) and T(2n), between the last two
extrapolated durations, and between the extrapolated duration and the lower bound. One of them alone
can be small by coincidence. A duration below the bound by more than this tolerance is an error of
toppra.
"""
SAVED_TIME_TOLERANCE = 0.01
"""Largest estimate of the error, as a share of the difference between toppra and the motion.

The refinement ends at the larger one of this error and of that by `GRID_TOLERANCE`. This error is
the larger one if the durations differ by more than 0.1 %.
"""
LARGEST_BOUND_GAP = 2e-4
"""Largest relative distance of the bound from toppra's duration.

If the distance is larger, the bound is computed again on the next grid.
"""
MAX_PASSES = 12
"""Largest number of passes, that is, of calls of toppra with updated friction."""
PASS_TOLERANCE = 2e-6
"""Relative change of the duration at which the passes have converged."""
MAX_PATH_SPEED = 10.0
"""Largest ṡ. Where the velocities of all joints are 0 for an instant, no other limit bounds ṡ."""
MIN_SQUARED_SPEED = 1e-9
"""Smallest ṡ² at which a tangent is taken."""


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


def second_opinions(
    trajectory: Trajectory, problem: Problem, lower_bounds: Sequence[float] = ()
) -> tuple[Opinion, ...]:
    """Compute the shortest duration of every phase along its path.

    Parameters
    ----------
    trajectory : Trajectory
        The motion. Only its polynomials and phases count.
    problem : Problem
        The problem with robot and limits.
    lower_bounds : sequence of float
        Known lower bounds on the durations of the phases, s. toppra's grid is refined until its
        durations are not below them.

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
    bounds = lower_bounds or [0.0] * len(spans)
    for span, request, lower_bound in zip(spans, requests, bounds, strict=True):
        if span.start == span.end:
            opinions.append(Opinion(duration=0.0, bound=0.0, sensitivities=()))
        elif request:
            opinions.append(Opinion(not_judged=request))
        else:
            arguments = trajectory, problem.robot, problem.task_limits
            times = span.start, span.end
            opinions.append(shortest_path_duration(*arguments, times, lower_bound))
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
    lower_bound: float = 0.0,
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
    lower_bound : float
        Known lower bound on the duration, s. The grid is refined until toppra's duration is not
        below it. On the finest grid, a duration below it is returned.

    Returns
    -------
    Opinion
        Duration, lower bound and sensitivities. The duration is None if toppra finds no timing or
        does not converge.
    """
    grid, squares = np.array(span) - span[0], np.ones(2)
    duration = estimate = np.inf
    bound, changes, opinion = None, None, None
    for refinement in (1, 2, 4, 8, 16, 32, 64):
        path = PathRows.from_trajectory(trajectory, robot, span, (0.0, 1.0), refinement)
        coarse_grid, grid = grid, path.grid
        # The friction converges on the first grid. It changes little on the finer ones.
        tolerance = PASS_TOLERANCE if refinement == 1 else np.inf
        result = _fastest_timing(
            path, path.largest_speed_ratio(limits), np.interp(grid, coarse_grid, squares), tolerance
        )
        if result is None:
            break
        squares = result
        # After the first grid, the estimate is −∞, so that the refinement continues.
        coarse, duration = duration, _timing_duration(path, squares)
        previous_estimate, estimate = estimate, 2 * duration - coarse
        if (bound or 0.0) < (1 - LARGEST_BOUND_GAP) * estimate:
            bound, changes = path_bound(
                trajectory, robot, limits, span, squares=squares, refinement=refinement
            )
        proven = bound or 0.0
        differences = coarse - duration, estimate - previous_estimate, estimate - proven
        saved = SAVED_TIME_TOLERANCE * abs(grid[-1] - duration)
        is_close = np.median(np.abs(differences)) <= max(GRID_TOLERANCE * duration, saved)
        if is_close and estimate >= (1 - GRID_TOLERANCE) * proven:
            opinion = Opinion(max(estimate, proven), bound, changes)
            if estimate >= (1 - GRID_TOLERANCE) * lower_bound:
                break
    if opinion is not None:
        return opinion
    bound = bound or path_bound(trajectory, robot, limits, span)[0]
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


def _fastest_timing(
    path: PathRows, speed_ratio: Array, squares: Array, tolerance: float
) -> Array | None:
    """Compute the fastest timing of a path with toppra, with repeated passes.

    Friction depends on the speed, which is the result. Each pass therefore takes the friction at
    the speeds of the previous pass.

    Parameters
    ----------
    path : PathRows
        The path at both ends of n intervals.
    speed_ratio : (2n,) array
        Largest ratio of a speed to its limit at ṡ = 1, at the starts of all intervals and then at
        their ends.
    squares : (n + 1,) array
        ṡ² at the grid points. The first pass takes the friction at these speeds.
    tolerance : float
        Relative change of the duration at which the passes have converged.

    Returns
    -------
    (n + 1,) array or None
        ṡ² at the grid points. None if toppra finds no timing or the passes do not converge.
    """
    # In a rest, the timing must keep the duration, so ṡ is at most 1.
    max_speed = np.where(path.moves, MAX_PATH_SPEED, 1.0)
    start_ceiling, end_ceiling = np.split(np.minimum(1 / speed_ratio, max_speed) ** 2, 2)
    ceiling = np.minimum(np.append(start_ceiling, np.inf), np.append(np.inf, end_ceiling))
    # An end at rest rests for every ṡ. At a moving end ṡ ≤ 1 is allowed, because the motion itself
    # may exceed a limit by rounding.
    is_rest = speed_ratio[[0, -1]] <= REST_FRACTION
    start_speed, end_speed = np.where(is_rest, np.sqrt(ceiling[[0, -1]]), 1.0)
    duration = _timing_duration(path, squares)
    for _ in range(MAX_PASSES):
        previous = duration
        halves = [np.split(matrix, 2) for matrix in _linear_rows(path, squares)]
        start_rows, end_rows = zip(*halves, strict=True)
        result = largest_speeds(
            path.grid,
            start_rows,
            end_rows,
            ceiling,
            speeds=(start_speed, end_speed),
            exact_ends=False,
        )
        if result is None or result.min() <= 0:
            return None
        squares, duration = result, _timing_duration(path, result)
        if abs(duration - previous) <= tolerance * duration:
            return squares
    return None


def _timing_duration(path: PathRows, squares: Array) -> float:
    """Compute the duration of a timing.

    Parameters
    ----------
    path : PathRows
        The path with n intervals.
    squares : (n + 1,) array
        ṡ² at the grid points. s̈ is constant in between.

    Returns
    -------
    float
        Duration, s.
    """
    root = np.sqrt(squares)
    return float((2 * path.lengths / (root[1:] + root[:-1])).sum())


def _linear_rows(path: PathRows, squares: Array) -> tuple[Array, Array, Array]:
    """Compute the limits on accelerations and torques as rows a s̈ + b ṡ² + c ≤ 1.

    Viscous friction adds a term in ṡ = √x with x = ṡ². It is linearised by the tangent at given
    values x₀, √x ≤ √x₀/2 + x/(2 √x₀).

    Parameters
    ----------
    path : PathRows
        The path at both ends of n intervals.
    squares : (n + 1,) array
        x₀ at the grid points. The friction coefficients are those at these speeds.

    Returns
    -------
    a, b, c : (2n, rows) arrays
        Coefficients at the starts of all intervals, followed by those at the ends.
    """
    u = np.tile(np.diff(squares) / (2 * path.lengths), 2)
    x = np.concatenate([squares[:-1], squares[1:]])
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
    return a, b + k / (2 * root), c + k * root / 2
