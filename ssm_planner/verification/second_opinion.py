"""A second opinion on durations: the package toppra computes the fastest timing of a path.

The path of a planned motion is kept, and only its timing is computed again. If toppra finds a much
shorter duration, the planner missed it. The planner and this module share only the adapter to
toppra. `second_opinions` is the main entry.

The path parameter s is the time of the motion. With u = s̈ and x = ṡ², every limit of `path_rows`
is a row a u + b x + c ≤ 1. The row holds at both ends of every grid interval, and u is
constant in between. The timings that toppra compares therefore include every motion that keeps its
limits, up to the error of the grid.

Friction depends on the speed, and viscous friction on √x. In every pass, the friction coefficients
and the tangents of √x are taken at the speeds of the previous pass. The first pass takes them at
the speeds of the motion.

The error of a duration T is proportional to the length of the grid intervals. The result is
therefore the extrapolation 2 T(2n) − T(n) of the durations on n and 2n intervals.

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
from ssm_planner.verification.path_rows import PathRows, row_coefficients
from ssm_planner.verification.proof import Proof, prove_motion

INTERVAL_ENDS = (0.0, 1.0)
"""Positions in a grid interval at which the rows hold, as fractions."""
GRID_REFINEMENTS = (1, 2, 4, 8)
"""Factors on the number of grid intervals, which are tried one after the other."""
GRID_TOLERANCE = 5e-5
"""Largest relative difference of T(n) and T(2n) at which the refinement ends.

The error of the result is then about 1e-5.
"""
SAVED_TIME_TOLERANCE = 0.05
"""Largest difference of T(n) and T(2n), as a share of the time that toppra saves.

The refinement also ends at this difference, which suffices for motions that are much slower than
necessary.
"""
MAX_PASSES = 12
"""Largest number of passes, that is, of calls of toppra with updated friction."""
PASS_TOLERANCE = 2e-6
"""Relative change of the duration at which the passes have converged."""
MAX_PATH_SPEED = 10.0
"""Largest ṡ where no joint moves, because no limit bounds ṡ there."""
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
        One for each phase. The duration of an empty phase is 0. The duration is None if toppra
        ignores a requirement on the phase, such as a limit on the jerk.
    """
    reason = _unsupported_requirement(problem)
    spans = trajectory.phases
    requests = [_unsupported_request(entry) for entry in problem.motion]
    if len(requests) != len(spans):  # scans and rounded corners
        requests = [next(filter(None, requests), "")] * len(spans)
    opinions = []
    for span, request in zip(spans, requests, strict=True):
        if span.start == span.end:
            opinions.append(Opinion(duration=0.0, bound=0.0, sensitivities=()))
        elif reason or request:
            opinions.append(Opinion(not_judged=reason or request))
        else:
            opinion = shortest_path_duration(
                trajectory, problem.robot, problem.task_limits, (span.start, span.end)
            )
            opinions.append(opinion)
    return tuple(opinions)


def second_opinions_and_proofs(
    trajectory: Trajectory, problem: Problem
) -> tuple[tuple[Opinion, ...], tuple[Proof, ...]]:
    """Return the results of `second_opinions` and of `prove_motion` for a motion."""
    return second_opinions(trajectory, problem), prove_motion(trajectory, problem)


def shortest_path_duration(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, span: tuple[float, float]
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
        Times in s, at breaks of the trajectory.

    Returns
    -------
    Opinion
        Duration, lower bound and sensitivities. The duration is None if toppra finds no timing or
        does not converge.
    """
    path_arguments = trajectory, robot, limits, span
    coarse, timing = np.inf, None
    for refinement in GRID_REFINEMENTS:
        path = PathRows.from_trajectory(trajectory, robot, span, INTERVAL_ENDS, refinement)
        squares = _fastest_timing(path, path.largest_speed_ratio(limits))
        if squares is None:
            break
        timing = squares if timing is None else timing
        duration = _timing_duration(path, squares)
        saved = path.lengths.sum() - duration
        if abs(coarse - duration) <= max(GRID_TOLERANCE * duration, SAVED_TIME_TOLERANCE * saved):
            bound, changes = path_bound(*path_arguments, timing)
            return Opinion(2 * duration - coarse, bound, changes)
        coarse = duration
    bound, _ = path_bound(*path_arguments, timing)
    return Opinion(bound=bound, not_judged="toppra does not converge")


def _unsupported_requirement(problem: Problem) -> str:
    """Return the reason why toppra cannot judge any motion of a problem, or an empty text."""
    if problem.robot.jerk_limited:
        return "toppra ignores limits on jerk"
    if problem.friction is not None or problem.payload is not None:
        return "toppra ignores ranges of friction and payload"
    if problem.stop_travel is not None:
        return "toppra ignores stop_travel"
    return "" if problem.duration is None else "a duration is requested"


def _unsupported_request(entry: Any) -> str:
    """Return the reason why toppra cannot judge one motion of a problem, or an empty text."""
    if getattr(entry, "constant_speed", None) is not None:
        return "a constant speed is requested"
    timed = entry.duration is not None and not isinstance(entry, Dwell)
    return "a duration is requested" if timed else ""


def _fastest_timing(path: PathRows, use: Array) -> Array | None:
    """Compute the fastest timing of a path with toppra.

    Friction depends on the speed, so several passes are necessary. Each pass takes the friction at
    the speeds of the previous pass.

    Parameters
    ----------
    path : PathRows
        The path at both ends of n intervals.
    use : (2n,) array
        Largest ratio of a speed to its limit at ṡ = 1.

    Returns
    -------
    (n + 1,) array or None
        ṡ² at the grid points. None if toppra finds no timing or the passes do not converge.
    """
    max_speed = np.where(path.moves, MAX_PATH_SPEED, 1.0)
    start_ceiling, end_ceiling = np.split(np.minimum(1 / use, max_speed) ** 2, 2)
    ceiling = np.minimum(np.append(start_ceiling, np.inf), np.append(np.inf, end_ceiling))
    # An end at rest rests for every ṡ. At a moving end ṡ ≤ 1 is allowed, because the motion itself
    # may exceed a limit by rounding.
    start_speed, end_speed = np.where(use[[0, -1]] <= REST_FRACTION, MAX_PATH_SPEED, 1.0)
    squares, grid = np.ones(len(path.lengths) + 1), np.append(0.0, np.cumsum(path.lengths))
    duration = path.lengths.sum()
    for _ in range(MAX_PASSES):
        previous = duration
        a, b, c = _linear_rows(path, squares)
        count = len(path.lengths)
        start_rows = (a[:count], b[:count], c[:count])
        end_rows = (a[count:], b[count:], c[count:])
        result = largest_speeds(
            grid, start_rows, end_rows, ceiling, speeds=(start_speed, end_speed), exact_ends=False
        )
        if result is None or result.min() <= 0:
            return None
        squares, duration = result, _timing_duration(path, result)
        if abs(duration - previous) <= PASS_TOLERANCE * duration:
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
    """Compute the coefficients of all rows a s̈ + b ṡ² + c ≤ 1, linearised at given speeds.

    With x = ṡ², the tangent √x ≤ √x₀/2 + x/(2 √x₀) at x₀ replaces √x in the terms of viscous
    friction.

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
        sides = path.torque_rows(i, drive, motor, mu)
        shares = []
        for side in sides:
            a, b, c, k = row_coefficients(side)
            shares.append(a * u + b * x + c + k * root)
        # The larger side is the torque, and the torque is at least −1.
        rows += sides
        rows.append(-np.where(shares[0] > shares[1], sides[0], sides[1]))
    a, b, c, k = row_coefficients(np.stack(rows, axis=2))
    root = root[:, None]
    return a, b + k / (2 * root), c + k * root / 2
