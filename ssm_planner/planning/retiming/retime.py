"""TOPP-RA: the fastest motion along a given path, friction as exact linear rows.

The rows are those of constraints.py, a pass over them is reachability.py. Viscous terms are concave in ṡ²: each pass
replaces them by their tangents at the motion of the previous pass. Tangents over-estimate, so every pass is feasible and the
next one no slower.
Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on Reachability Analysis, IEEE
T-RO 34(3), 2018, and its interpolation scheme.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.kinematics.forward import tool_speed
from ssm_planner.planning.retiming.constraints import LinearConstraints, PathLimits
from ssm_planner.planning.retiming.paths import Chain, JointPath, MotionPath
from ssm_planner.planning.retiming.reachability import fastest
from ssm_planner.problem.limits import TipSpeed
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory, hermite
from ssm_planner.typing import Array

POINTS = 1000
"""Grid intervals."""
COARSE = 200
"""Grid intervals of the rough motion that tells where to put the points of the grid."""
UNIFORM = 0.1
"""Share of the points that is uniform in s."""
PASSES, TRIES = 40, 12
"""Most passes in all, and most until the first motion."""
CONVERGED = 1e-5
"""Relative change of the duration at which the tangents have settled: a further pass would change about its square."""
STEADY = 1e-9
"""Share by which a constant speed may be off at a grid point."""
FASTER = 10.0
"""Times the speed of a motion that its re-timing may have."""
SLOWER = 1 / 16
"""Factor on ṡ² of the tangents after a pass without a motion."""


@dataclass(frozen=True, eq=False)
class Retiming:
    """Outcome of TOPP-RA: status "solved" or "infeasible" with a message; ṡ² at the grid points s, (n + 1,)."""

    status: str
    message: str
    duration: float
    s: Array
    speed_squared: Array
    passes: int
    active: Array
    """Index of the row that binds on each grid interval, (n,); −1 the speed ceiling, −2 none."""
    converged: bool = False
    """The tangents have settled: another pass would not change the duration by more than about CONVERGED."""
    limits: PathLimits | None = None
    """Along the path, with the rows that were needed."""

    @property
    def solved(self) -> bool:
        return self.status == "solved"

    @property
    def times(self) -> Array:
        """Time at each grid point, (n + 1,), s."""
        return _times(self.s, self.speed_squared)


def retime(
    path: JointPath,
    robot: Robot,
    points: int = POINTS,
    limits: TaskLimits = TaskLimits(),  # noqa: B008  frozen
    speeds: tuple[float, float] = (0.0, 0.0),
    *,
    static: bool = True,
    judged: bool = True,
) -> Retiming:
    """Time-optimal motion along the path on `points` grid intervals; speeds: ṡ at both ends, 1/s.

    static: friction at a start from rest is static. judged: say which rows bind.
    """
    rough = (
        retime(path, robot, COARSE, limits, speeds, static=static, judged=False)
        if points > COARSE
        else None
    )
    grid = _grid(path.directions[0], points, rough)
    path_limits = PathLimits.along(
        path, grid, robot, limits, None if rough is None else rough.limits
    )
    # the tangents of the rough motion are nearly settled, and its passes cost a fifth
    tangent = (
        path_limits.ceiling
        if rough is None or not rough.solved
        else np.interp(grid, rough.s, rough.speed_squared)
    )
    return _retimed(
        grid, path_limits, tangent, speeds, static=static and speeds[0] == 0.0, judged=judged
    )


def stays_at(found: Retiming, path: JointPath, speed: float) -> bool:
    """Whether a motion along a path gets to a speed of the tip, m/s, and keeps it until it slows down at the end."""
    samples = path.sample(found.s)
    tip = tool_speed(TipSpeed, path.mechanism, samples.q, samples.dq) * np.sqrt(found.speed_squared)
    at_speed = np.flatnonzero(tip >= (1 - STEADY) * speed)
    return len(at_speed) > 2 and len(at_speed) == at_speed[-1] - at_speed[0] + 1


def retime_motion(
    path: MotionPath, robot: Robot, limits: TaskLimits, points: int = POINTS, pace: float = 1.0
) -> Retiming:
    """Time-optimal motion along the path that a motion took: about as fast as that, or faster where it was no optimum.

    pace: of both ends, relative to that motion.
    """
    grid = path.grid(points)
    speed = pace / path.trajectory.duration
    path_limits = PathLimits.along(path, grid, robot, limits)
    # where all joints rest nothing limits ṡ
    path_limits = replace(
        path_limits, ceiling=np.minimum(path_limits.ceiling, (FASTER * speed) ** 2)
    )
    return _retimed(grid, path_limits, np.full_like(grid, speed**2), (speed, speed), static=True)


def durations(
    paths: Sequence[MotionPath], robot: Robot, limits: TaskLimits, points: int, pace: float
) -> list[float]:
    """Of `retime_motion` along paths of motions on one mesh that last as long, all at once, s; infinite without a motion."""
    grid, speed = paths[0].grid(points), pace / paths[0].trajectory.duration
    n = len(grid)
    own = [slice(k * n, (k + 1) * n) for k in range(len(paths))]
    along = PathLimits.along(
        Chain(paths[0].mechanism, tuple(paths)), Chain.grid(grid, len(paths)), robot, limits
    )
    along = replace(along, ceiling=np.minimum(along.ceiling, (FASTER * speed) ** 2))
    every = list(range(len(paths)))
    found, tangent, open_ = (
        np.full(len(paths), np.inf),
        np.full(len(along.ceiling), speed**2),
        every,
    )
    for count in range(1, PASSES + 1):
        rows, left = along.constraints(tangent, static_start=True), []
        for k in open_:
            curved = rows.part(own[k])
            linear = curved.tangent(_lifted(tangent[own[k]]))
            squares = fastest(grid, linear, (speed, speed))
            if squares is None:
                tangent[own[k]] *= SLOWER
                left += [k] if np.isinf(found[k]) and count < TRIES else []
                continue
            before, found[k] = found[k], _times(grid, squares)[-1]
            tangent[own[k]] = squares
            if abs(before - found[k]) > CONVERGED * found[k] and _bind(
                linear, curved, grid, squares
            ):
                left.append(k)
        open_ = left
        if not open_:
            more = along.with_missed(Chain.grid(grid, len(paths)), tangent, static_start=True)
            if more is along:
                break
            along, found, open_ = more, np.full(len(paths), np.inf), every
    return [float(each) for each in found]


def motion_along(path: MotionPath, found: Retiming) -> Trajectory:
    """The motion along a path at the pace that `retime_motion` found: quintics from grid point to grid point.

    The points to both sides of a break of the path become one on it, where its acceleration may jump.
    """
    motion = path.trajectory
    t, x = found.s * motion.duration, found.speed_squared * motion.duration**2
    behind = np.searchsorted(t, motion.breaks[1:-1])
    x[behind - 1] = (x[behind - 1] + x[behind]) / 2
    t[behind - 1] = motion.breaks[1:-1]
    t, x = np.delete(t, behind), np.delete(x, behind)
    pull = (np.diff(x) / (2 * np.diff(t)))[:, None]
    ends = [
        (at.q, at.qd * np.sqrt(square)[:, None], at.qdd * square[:, None] + at.qd * pull)
        for at, square in (
            (motion.sample(t[:-1], "right"), x[:-1]),
            (motion.sample(t[1:], "left"), x[1:]),
        )
    ]
    breaks = _times(t, x)
    return Trajectory(breaks, hermite(breaks, ends[0], ends[1]), ())


def _retimed(
    grid: Array,
    path_limits: PathLimits,
    tangent: Array,
    speeds: tuple[float, float],
    *,
    static: bool,
    judged: bool = True,
) -> Retiming:
    """TOPP-RA on the grid, pass after pass until the tangents, first those at ṡ² = tangent (n,), have settled."""
    message = "TOPP-RA finds no motion along the path within the limits"
    infeasible = best = Retiming(
        "infeasible",
        message,
        duration=np.inf,
        s=grid,
        speed_squared=np.zeros_like(grid),
        passes=0,
        active=np.full(len(grid) - 1, -2),
    )
    last: LinearConstraints | None = None
    for count in range(1, PASSES + 1):
        rows = path_limits.constraints(tangent, static_start=static)
        linear = rows.tangent(_lifted(tangent))
        found = fastest(grid, linear, speeds)
        if found is None:
            if best.solved or count == TRIES:
                break
            # a tangent at high speed over-estimates viscous friction at low speed: try nearer to rest
            tangent = tangent * SLOWER
            continue
        duration = float(_times(grid, found)[-1])
        # the tangents only over-estimate: where no row that has one binds with it, they do not matter
        settled = abs(best.duration - duration) <= CONVERGED * duration or not _bind(
            linear, rows, grid, found
        )
        best = Retiming(
            "solved",
            "",
            duration=duration,
            s=grid,
            speed_squared=found,
            passes=count,
            active=best.active,
            converged=settled,
            limits=path_limits,
        )
        last = rows
        if settled:
            more = path_limits.with_missed(grid, found, static_start=static)
            if more is path_limits:
                break
            path_limits, best = more, infeasible
        tangent = found
    return replace(best, active=last.active(grid, best.speed_squared)) if last and judged else best


def _bind(
    linear: LinearConstraints, rows: LinearConstraints, grid: Array, speed_squared: Array
) -> bool:
    """Whether a row binds that has a tangent."""
    return linear.bind(rows.curved, grid, speed_squared)


def _lifted(speed_squared: Array) -> Array:
    """ṡ² (n,) at which tangents are taken: a root has none at 0."""
    return np.maximum(speed_squared, 1e-12 * speed_squared.max())


def _times(grid: Array, speed_squared: Array) -> Array:
    """Time at each grid point, (n + 1,), ṡ² being linear in s between them."""
    speed = np.sqrt(speed_squared)
    return np.concatenate(
        [[0.0], np.cumsum(2 * np.diff(grid) / np.maximum(speed[1:] + speed[:-1], 1e-300))]
    )


def _grid(knots: Array, points: int, rough: Retiming | None) -> Array:
    """The grid (points + 1,): uniform in s, or after a rough motion nearly uniform in time; a point on each knot.

    Where ṡ is small a step in s takes long, and the interpolation scheme, which keeps the rows of both its ends with one s̈,
    loses most; with a grid uniform in time as many points lose a quarter as much.
    """
    grid = np.linspace(0.0, 1.0, points + 1)
    if rough is not None and rough.solved:
        shares = UNIFORM * rough.s + (1 - UNIFORM) * rough.times / rough.duration
        grid[1:-1] = np.interp(grid, shares, rough.s)[1:-1]
    taken = [0, points]
    for knot in knots[1:-1]:
        nearest = int(np.clip(np.argmin(np.abs(grid - knot)), 1, points - 1))
        if nearest not in taken:
            grid[nearest] = knot
            taken.append(nearest)
    return grid
