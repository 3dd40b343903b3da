"""TOPP-RA behind one adapter: the fastest motion along a given path, friction as exact linear rows.

Along a path the joints' directions are known, so the mesh effort F is affine in (s̈, ṡ²) and "torque ≤ limit" is two linear
rows per motor (one for each side of the mesh). The viscous terms are concave in ṡ²: each pass replaces √(ṡ²) by its
tangent at the previous pass, which over-estimates it, so every pass is feasible and the next is no slower.
Method: H. Pham, Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization based on Reachability Analysis", 2018.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.planning.retiming.constraints import LinearConstraints, PathLoad, linear_constraints, speed_ceiling
from ssm_planner.planning.retiming.paths import JointPath
from ssm_planner.planning.retiming.toppra_import import load_toppra
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array

PASSES = 12
CONVERGED = 1e-5
"""Relative change of the duration at which the tangents have settled: a further pass would change about its square."""

COARSE = 200
"""Grid intervals of the rough motion that tells where to put the points of the grid."""
UNIFORM = 0.1
"""Share of the points that is uniform in s."""


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

    @property
    def solved(self) -> bool:
        return self.status == "solved"

    @property
    def times(self) -> Array:
        return _times(self.s, self.speed_squared)


def retime(
    path: JointPath,
    robot: Robot,
    points: int = 1000,
    limits: TaskLimits = TaskLimits(),  # noqa: B008  frozen
    speeds: tuple[float, float] = (0.0, 0.0),
    *,
    static: bool = True,
) -> Retiming:
    """Time-optimal motion along the path on `points` grid intervals; speeds: ṡ at both ends, 1/s.

    static: friction at a start from rest is static.
    """
    knots, signs = path.directions
    rough = retime(path, robot, COARSE, limits, speeds, static=static) if points > COARSE else None
    grid = _grid(knots, points, rough)
    samples = path.sample(grid)
    interval = np.clip(np.searchsorted(knots, grid, side="right") - 1, 0, len(knots) - 2)
    ceiling = speed_ceiling(path, samples, robot, limits)
    load = PathLoad.along(RigidBody.from_robot(robot), samples)
    # the tangents of the rough motion are nearly settled, and its passes cost a fifth
    tangent = ceiling if rough is None or not rough.solved else np.interp(grid, rough.s, rough.speed_squared)
    best = Retiming(
        "infeasible",
        "TOPP-RA finds no motion along the path within the limits",
        np.inf,
        grid,
        np.zeros_like(grid),
        0,
        np.full(points, -2),
    )
    for count in range(1, PASSES + 1):
        rows = linear_constraints(
            robot, samples, load, signs[interval], ceiling, tangent, starts=static and speeds[0] == 0.0
        )
        found = _solve(grid, rows, tangent, speeds)
        if found is None:
            if best.solved:
                break
            # a tangent at high speed over-estimates viscous friction at low speed: try nearer to rest
            tangent = tangent / 16
            continue
        duration = float(_times(grid, found)[-1])
        active = rows.active(grid, found)
        # the tangents only over-estimate: where no row that has one binds, they do not matter
        settled = abs(best.duration - duration) <= CONVERGED * duration or not rows.k[:, active[active >= 0]].any()
        best = Retiming("solved", "", duration, grid, found, count, active)
        if settled:
            break
        tangent = found
    return best


def _times(grid: Array, speed_squared: Array) -> Array:
    """Time at each grid point, ṡ² being linear in s between them."""
    speed = np.sqrt(speed_squared)
    return np.concatenate([[0.0], np.cumsum(2 * np.diff(grid) / np.maximum(speed[1:] + speed[:-1], 1e-300))])


def _grid(knots: Array, points: int, rough: Retiming | None) -> Array:
    """A grid with the points nearest to the knots moved onto them: uniform, or after a rough motion nearly so in time.

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
    """One TOPP-RA pass; ṡ² at the grid points or None where there is no motion."""
    load_toppra()
    from toppra.algorithm import TOPPRA
    from toppra.constraint import LinearConstraint
    from toppra.interpolator import AbstractGeometricPath

    # TOPP-RA has absolute tolerances: choose the unit of time in which ṡ² is of order one
    unit = 1 / max(float(np.abs(rows.a).max()), 1 / float(rows.ceiling.max()))
    rows = LinearConstraints(rows.a * unit, rows.b * unit, rows.c, rows.k * np.sqrt(unit), rows.ceiling / unit)
    root = np.sqrt(np.maximum(tangent / unit, 1e-12 * tangent.max() / unit))
    b = rows.b + rows.k / (2 * root)[:, None]
    c = rows.c + rows.k * (root / 2)[:, None]
    count = rows.a.shape[1]

    # interpolation: the rows at the end of an interval too, for what the motion is there
    ahead = np.append(np.arange(1, len(grid)), len(grid) - 1)
    step = np.append(np.diff(grid), 0.0)[:, None]
    a = np.hstack([rows.a, rows.a[ahead] + 2 * step * b[ahead]])
    b, c = np.hstack([b, b[ahead]]), np.hstack([c, c[ahead]])

    class Rows(LinearConstraint):  # type: ignore[misc, no-any-unimported]
        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, *_: object, **__: object) -> tuple[object, ...]:
            bounds = np.stack([np.zeros(len(grid)), rows.ceiling], axis=1)
            return a, b, c, np.eye(2 * count), np.ones(2 * count), None, bounds

    class Line(AbstractGeometricPath):  # type: ignore[misc, no-any-unimported]
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
