"""TOPP-RA behind one adapter: the fastest motion along a given path, friction as exact linear rows.

The rows are those of constraints.py. Viscous terms are concave in ṡ²: each pass replaces them by their tangents at the motion
of the previous pass. Tangents over-estimate, so every pass is feasible and the next one no slower.
Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on Reachability Analysis, IEEE
T-RO 34(3), 2018, and its interpolation scheme.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np

from ssm_planner.planning.retiming.constraints import LinearConstraints, PathLimits
from ssm_planner.planning.retiming.paths import JointPath, MotionPath
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array

UNUSED = ("matplotlib", "matplotlib.pyplot", "scipy.interpolate", "scipy.sparse")
"""What toppra imports for plots, splines and solvers that are not used here; loading it takes longer than to plan."""
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
) -> Retiming:
    """Time-optimal motion along the path on `points` grid intervals; speeds: ṡ at both ends, 1/s.

    static: friction at a start from rest is static.
    """
    rough = retime(path, robot, COARSE, limits, speeds, static=static) if points > COARSE else None
    grid = _grid(path.directions[0], points, rough)
    path_limits = PathLimits.along(path, grid, robot, limits)
    # the tangents of the rough motion are nearly settled, and its passes cost a fifth
    tangent = (
        path_limits.ceiling if rough is None or not rough.solved else np.interp(grid, rough.s, rough.speed_squared)
    )
    return _retimed(grid, path_limits, tangent, speeds, static=static and speeds[0] == 0.0)


def retime_motion(path: MotionPath, robot: Robot, limits: TaskLimits, points: int = POINTS) -> Retiming:
    """Time-optimal motion along the path that a motion took: about as fast as that, or faster where it was no optimum."""
    grid = path.grid(points)
    speed = 1 / path.trajectory.duration
    path_limits = PathLimits.along(path, grid, robot, limits)
    # where all joints rest nothing limits ṡ
    path_limits = replace(path_limits, ceiling=np.minimum(path_limits.ceiling, (FASTER * speed) ** 2))
    return _retimed(grid, path_limits, np.full_like(grid, speed**2), (speed, speed), static=True)


def _retimed(
    grid: Array, path_limits: PathLimits, tangent: Array, speeds: tuple[float, float], *, static: bool
) -> Retiming:
    """TOPP-RA on the grid, pass after pass until the tangents, first those at ṡ² = tangent (n,), have settled."""
    message = "TOPP-RA finds no motion along the path within the limits"
    best = Retiming(
        "infeasible",
        message,
        duration=np.inf,
        s=grid,
        speed_squared=np.zeros_like(grid),
        passes=0,
        active=np.full(len(grid) - 1, -2),
    )
    for count in range(1, PASSES + 1):
        rows = path_limits.constraints(tangent, static_start=static)
        found = _solve(grid, rows, tangent, speeds)
        if found is None:
            if best.solved or count == TRIES:
                break
            # a tangent at high speed over-estimates viscous friction at low speed: try nearer to rest
            tangent = tangent * SLOWER
            continue
        duration = float(_times(grid, found)[-1])
        # the tangents only over-estimate: where no row that has one binds with it, they do not matter
        binding = rows.tangent(_lifted(tangent)).active(grid, found)
        settled = abs(best.duration - duration) <= CONVERGED * duration or not rows.k[:, binding[binding >= 0]].any()
        best = Retiming(
            "solved",
            "",
            duration=duration,
            s=grid,
            speed_squared=found,
            passes=count,
            active=rows.active(grid, found),
            converged=settled,
        )
        if settled:
            break
        tangent = found
    return best


def _lifted(speed_squared: Array) -> Array:
    """ṡ² (n,) at which tangents are taken: a root has none at 0."""
    return np.maximum(speed_squared, 1e-12 * speed_squared.max())


def _times(grid: Array, speed_squared: Array) -> Array:
    """Time at each grid point, (n + 1,), ṡ² being linear in s between them."""
    speed = np.sqrt(speed_squared)
    return np.concatenate([[0.0], np.cumsum(2 * np.diff(grid) / np.maximum(speed[1:] + speed[:-1], 1e-300))])


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


def _solve(grid: Array, rows: LinearConstraints, tangent: Array, speeds: tuple[float, float]) -> Array | None:
    """One TOPP-RA pass with the tangents at ṡ² = tangent (n,): ṡ² at the grid points (n,), None where there is no motion."""
    load_toppra()
    from toppra.algorithm import TOPPRA
    from toppra.constraint import LinearConstraint
    from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate
    from toppra.interpolator import AbstractGeometricPath

    # TOPP-RA has absolute tolerances: choose the unit of time in which ṡ² is of order one
    unit = 1 / max(float(np.abs(rows.a).max()), 1 / float(rows.ceiling.max()))
    scaled = rows.in_time_unit(unit).tangent(_lifted(tangent / unit))
    count = scaled.a.shape[1]

    class Rows(LinearConstraint):  # type: ignore[misc, no-any-unimported]
        """a s̈ + b ṡ² + c ≤ 1 and 0 ≤ ṡ² ≤ ceiling, both ends of an interval with one s̈."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, *_: object, **__: object) -> tuple[object, ...]:
            collocated = scaled.a, scaled.b, scaled.c, np.eye(count), np.ones(count)
            a, b, c, f, g, *_ = canlinear_colloc_to_interpolate(*collocated, None, None, grid, identical=True)
            return a, b, c, f, g, None, np.stack([np.zeros(len(grid)), scaled.ceiling], axis=1)

    class Line(AbstractGeometricPath):  # type: ignore[misc, no-any-unimported]
        """The path as TOPP-RA asks for it; the rows know it already."""

        dof = 1
        path_interval = np.array([0.0, 1.0])
        waypoints = None

        def __call__(self, s: Array, order: int = 0) -> Array:
            return np.zeros((np.size(s), 1))

    algorithm = TOPPRA([Rows()], Line(), grid, solver_wrapper="seidel", parametrizer="ParametrizeConstAccel")
    first, last = (speed / float(np.sqrt(unit)) for speed in speeds)
    _, speed, _, _ = algorithm.compute_parameterization(first, last, return_data=True)
    if speed is None or not np.all(np.isfinite(speed)):
        return None
    return np.asarray(speed, dtype=float) ** 2 * unit


@cache
def load_toppra() -> None:
    """Import toppra, silent but for critical faults; whoever imports from it afterwards finds it loaded.

    While it is imported, UNUSED are stand-ins whose names load the real module when they are called or looked into, so that
    the rest of toppra works as ever.
    """
    with _standing_in(UNUSED):
        package = importlib.import_module("toppra")
    package.setup_logging("CRITICAL")


@contextmanager
def _standing_in(names: tuple[str, ...]) -> Iterator[None]:
    """Stand-ins for those modules of the names, parents first, that are not loaded yet."""
    absent = [] if "toppra" in sys.modules else [name for name in names if name not in sys.modules]
    for name in absent:
        parent, _, child = name.rpartition(".")
        sys.modules[name] = _Module(name)
        if parent in absent:
            setattr(sys.modules[parent], child, sys.modules[name])
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]


class _Module(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Name(self.__name__, name)


class _Name:
    """A function or class of a module that is not loaded until this is used."""

    def __init__(self, module: str, name: str) -> None:
        self._where = module, name

    def _real(self) -> Any:
        module, name = self._where
        return getattr(importlib.import_module(module), name)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self._real()(*arguments, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real(), name)
