"""TOPP-RA: the fastest motion along a given path, with friction as exact linear rows.

The rows come from constraints.py, and reachability.py computes one pass over them. Viscous terms
are concave in ṡ². Each pass replaces them by their tangents at the motion of the previous pass.
Tangents overestimate the terms, so every pass is feasible and the next one is not slower.

Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018, and its interpolation scheme.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.kinematics import tool_speed
from ssm_planner.planning.retiming.constraints import PathLimits
from ssm_planner.planning.retiming.paths import FEW, JointPath, MotionPath
from ssm_planner.planning.retiming.reachability import fastest_profile
from ssm_planner.planning.tolerances import GAP, ROUNDING, SAME, SAMPLES
from ssm_planner.problem import Robot, TaskLimits, TipSpeed
from ssm_planner.trajectory import Samples, Trajectory, hermite
from ssm_planner.typing import Array, Indices, record

UNIFORM = 0.1
"""Share of the grid points that is uniform in s."""
PASSES = 12
"""Largest number of passes."""
FASTER = 10.0
"""Largest ratio of the speed after retiming to that of the motion."""
SLOWER = 1 / 16
"""Factor on ṡ² at the tangents after a pass without a motion."""


@record
class Retiming:
    """Result of TOPP-RA: ṡ² at the grid points s, (n + 1,) each."""

    s: Array
    speed_squared: Array
    active: Indices
    """Row that binds on each grid interval, (n,), as `LinearConstraints.active`."""

    @property
    def solved(self) -> bool:
        """True if there is a motion."""
        return bool(self.speed_squared.any())

    @property
    def status(self) -> str:
        """The word "solved" or "infeasible"."""
        return "solved" if self.solved else "infeasible"

    @property
    def message(self) -> str:
        """Reason why there is no motion."""
        return "" if self.solved else "TOPP-RA finds no motion along the path within the limits"

    @property
    def times(self) -> Array:
        """Time at each grid point, (n + 1,), s."""
        return _times(self.s, self.speed_squared)

    @property
    def duration(self) -> float:
        """Duration, s. Infinite without a motion."""
        return float(self.times[-1]) if self.solved else np.inf


def retime(
    path: JointPath,
    robot: Robot,
    points: int = FEW,
    limits: TaskLimits = TaskLimits(),  # noqa: B008  frozen
    speeds: tuple[float, float] = (0.0, 0.0),
) -> Retiming:
    """Return the time-optimal motion along a path.

    Parameters
    ----------
    path : JointPath
        The path.
    robot : Robot
        The robot with its limits.
    points : int
        Number of grid intervals.
    limits : TaskLimits
        Limits on task coordinates and on the tool.
    speeds : (float, float)
        ṡ at both ends, 1/s.

    Returns
    -------
    Retiming
        The motion, or the status "infeasible".
    """
    # A rough motion determines where grid points lie.
    few = SAMPLES // 2
    rough = retime(path, robot, few, limits, speeds) if points > few else None
    grid = _grid(path.directions[0], points, rough)
    path_limits = PathLimits.on_grid(path, grid, robot, limits)
    tangent = path_limits.ceiling
    if rough is not None and rough.solved:
        tangent = np.interp(grid, rough.s, rough.speed_squared)
    return _retimed(grid, path_limits, tangent, speeds, static=speeds[0] == 0.0)


def stays_at(retiming: Retiming, path: JointPath, speed: float) -> bool:
    """Return True if a motion reaches a tip speed, m/s, and keeps it until its end."""
    samples = path.sample(retiming.s)
    tip = tool_speed(TipSpeed, path.mechanism, samples.q, samples.dq) * np.sqrt(
        retiming.speed_squared
    )
    at_speed = np.flatnonzero(tip >= (1 - ROUNDING) * speed)
    return len(at_speed) > 2 and len(at_speed) == at_speed[-1] - at_speed[0] + 1


def retime_motion(
    path: MotionPath, robot: Robot, limits: TaskLimits, speed_ratio: float = 1.0
) -> Retiming:
    """Return the time-optimal motion along the path of a motion.

    It is about as fast as that motion, or faster if the motion was no optimum. `speed_ratio` is ṡ
    at both ends relative to that of the motion.
    """
    grid = path.grid(FEW)
    speed = speed_ratio / path.trajectory.duration
    path_limits = PathLimits.on_grid(path, grid, robot, limits)
    # Where all joints rest nothing limits ṡ.
    path_limits = replace(
        path_limits, ceiling=np.minimum(path_limits.ceiling, (FASTER * speed) ** 2)
    )
    return _retimed(grid, path_limits, np.full_like(grid, speed**2), (speed, speed), static=True)


def keeps_limits(path: MotionPath, robot: Robot, limits: TaskLimits) -> bool:
    """Return True if the motion that a path stems from keeps the limits between its breaks.

    They are those of joints, motors, speeds of the tool and the distance to stop. Jerk is left out.
    """
    grid = path.grid(FEW)
    squares = np.full_like(grid, 1 / path.trajectory.duration**2)
    path_limits = replace(PathLimits.on_grid(path, grid, robot, limits), stops=None)
    rows = path_limits.constraints(squares, static_start=True).tangent(squares)
    x = squares[:, None]
    peak = max((rows.b * x + rows.c).max(), (squares / rows.ceiling).max())
    return bool(peak <= 1 + SAME)


def motion_along(path: MotionPath, retiming: Retiming) -> Trajectory:
    """Return a motion with the timing of `retime_motion`, as quintics between grid points.

    Two grid points lie beside every break of the path. They become one point on the break, where
    the acceleration may jump.
    """
    motion = path.trajectory
    t = retiming.s * motion.duration
    x = retiming.speed_squared * motion.duration**2
    behind = np.searchsorted(t, motion.breaks[1:-1])
    x[behind - 1] = (x[behind - 1] + x[behind]) / 2
    t[behind - 1] = motion.breaks[1:-1]
    t, x = np.delete(t, behind), np.delete(x, behind)
    pull = (np.diff(x) / (2 * np.diff(t)))[:, None]

    def states(samples: Samples, squares: Array) -> tuple[Array, Array, Array]:
        speed, square = np.sqrt(squares)[:, None], squares[:, None]
        return samples.q, samples.qd * speed, samples.qdd * square + samples.qd * pull

    breaks = _times(t, x)
    starts = states(motion.sample(t[:-1], "right"), x[:-1])
    ends = states(motion.sample(t[1:], "left"), x[1:])
    return Trajectory(breaks, hermite(breaks, starts, ends), ())


def _retimed(
    grid: Array,
    path_limits: PathLimits,
    tangent: Array,
    speeds: tuple[float, float],
    *,
    static: bool,
) -> Retiming:
    """Return the motion of TOPP-RA on a grid, pass after pass until the tangents converge.

    The first tangents are taken at ṡ² = tangent (n,).
    """
    result = Retiming(grid, np.zeros_like(grid), np.zeros(len(grid) - 1, dtype=int))
    for _ in range(PASSES):
        rows = path_limits.constraints(tangent, static_start=static)
        # The square root has no tangent at 0.
        linear = rows.tangent(np.maximum(tangent, 1e-12 * tangent.max()))
        squares = fastest_profile(grid, linear, speeds)
        if squares is None and result.solved:
            break
        if squares is None:
            # A tangent at high speed overestimates viscous friction at low speed. A tangent nearer
            # to rest may be feasible.
            tangent = tangent * SLOWER
            continue
        # Tangents only overestimate. If no row with a tangent binds, they do not change the motion.
        has_tangent = np.append(rows.k.any(axis=0), [False, False])
        exact = not has_tangent[linear.active(grid, squares)].any()
        duration = float(_times(grid, squares)[-1])
        # Another pass would change the duration by about the square of the last change.
        converged = exact or abs(result.duration - duration) <= GAP * duration
        result = Retiming(grid, squares, rows.active(grid, squares))
        if converged:
            break
        tangent = squares
    return result


def _times(grid: Array, speed_squared: Array) -> Array:
    """Return the time at each grid point, (n + 1,), for ṡ² that is linear in s between them."""
    speed = np.sqrt(speed_squared)
    steps = 2 * np.diff(grid) / np.maximum(speed[1:] + speed[:-1], 1e-300)
    return np.append(0.0, np.cumsum(steps))


def _grid(knots: Array, points: int, rough: Retiming | None) -> Array:
    """Return the grid (points + 1,): uniform in s, or after a rough motion nearly uniform in time.

    Every knot gets a grid point. Where ṡ is small, a step in s takes long, and the interpolation
    scheme, which keeps the rows at both ends with one s̈, loses most. A grid uniform in time loses
    a quarter as much with the same number of points.
    """
    grid = np.linspace(0.0, 1.0, points + 1)
    if rough is not None and rough.solved:
        shares = UNIFORM * rough.s + (1 - UNIFORM) * rough.times / rough.duration
        grid[1:-1] = np.interp(grid, shares, rough.s)[1:-1]
    used = [0, points]
    for knot in knots[1:-1]:
        index = int(np.clip(np.argmin(np.abs(grid - knot)), 1, points - 1))
        if index not in used:
            grid[index] = knot
            used.append(index)
    return grid
