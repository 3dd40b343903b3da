"""TOPP-RA behind one adapter: the fastest motion along a given path, friction as exact linear rows.

Along a path the joints' directions are known, so the mesh effort F is affine in (s̈, ṡ²) and "torque ≤ limit" is two linear
rows per motor (one for each side of the mesh). The viscous terms are concave in ṡ²: each pass replaces √(ṡ²) by its
tangent at the previous pass, which over-estimates it, so every pass is feasible and the next is no slower.
Method: H. Pham, Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization based on Reachability Analysis", 2018.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.model.friction import friction_coefficient, friction_of
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.task import task_rates
from ssm_planner.model.transmission import motor_torque_rows
from ssm_planner.planning.joint_path import JointPath
from ssm_planner.planning.path import PathSamples
from ssm_planner.planning.toppra_import import load_toppra
from ssm_planner.problem.values import TASK, Array, Drive, Robot, TaskLimits

PASSES = 12
CONVERGED = 1e-7
"""Relative change of the duration at which the tangents have settled."""

COARSE = 200
"""Grid intervals of the rough motion that tells where to put the points of the grid."""
UNIFORM = 0.1
"""Share of the points that is uniform in s."""
ACTIVE = 0.998
"""A row counts as binding from this share of its limit on."""


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


@dataclass(frozen=True, eq=False)
class PathRows:
    """a s̈ + b ṡ² + c + k √(ṡ²) ≤ 1, every row scaled by its limit, (n, rows) each; and ṡ² ≤ ceiling, (n,)."""

    a: Array
    b: Array
    c: Array
    k: Array
    ceiling: Array

    def active(self, grid: Array, speed_squared: Array) -> Array:
        """Which row binds on each grid interval, as in `Retiming.active`."""
        acceleration = (np.diff(speed_squared) / (2 * np.diff(grid)))[:, None]
        x = ((speed_squared[1:] + speed_squared[:-1]) / 2)[:, None]

        def middle(values: Array) -> Array:
            return (values[1:] + values[:-1]) / 2

        value = middle(self.a) * acceleration + middle(self.b) * x + middle(self.c) + middle(self.k) * np.sqrt(x)
        value = np.column_stack([value, x[:, 0] / middle(self.ceiling)])
        row = np.argmax(value, axis=1)
        row[row == value.shape[1] - 1] = -1
        return np.where(value.max(axis=1) > ACTIVE, row, -2)


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
    tangent = ceiling
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
        rows = path_rows(robot, samples, load, signs[interval], ceiling, tangent, starts=static and speeds[0] == 0.0)
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


@dataclass(frozen=True, eq=False)
class PathLoad:
    """τ_rigid = inertia s̈ + velocity ṡ² + gravity along a path, (n, 4) each."""

    inertia: Array
    velocity: Array
    gravity: Array

    @classmethod
    def along(cls, body: RigidBody, samples: PathSamples) -> PathLoad:
        gravity = body.gravity_load(samples.q)
        zero = np.zeros_like(samples.q)
        return cls(
            body.inverse_dynamics(samples.q, zero, samples.dq) - gravity,
            body.inverse_dynamics(samples.q, samples.dq, samples.ddq) - gravity,
            gravity,
        )


def speed_ceiling(path: JointPath, samples: PathSamples, robot: Robot, limits: TaskLimits) -> Array:
    """Largest ṡ² that joint, motor and tip speeds and the rates of task coordinates allow at each sample, (n,)."""
    limit = np.array([joint.velocity for joint in robot.joints])
    for i, joint in enumerate(robot.joints):
        if joint.drive is not None and joint.motor is not None:
            limit[i] = min(limit[i], joint.motor.max_speed / joint.drive.ratio)
    with np.errstate(divide="ignore"):
        speed = (limit / np.abs(samples.dq)).min(axis=1)
        if limits.tip_speed is not None:
            speed = np.minimum(speed, limits.tip_speed / np.linalg.norm(path.tip_slope(samples), axis=1))
        if limits.rates:
            slope = np.abs(task_rates(path.mechanism, samples.q, samples.dq))
            for name, rate in limits.rates.items():
                speed = np.minimum(speed, rate / slope[:, TASK.index(name)])
    return np.asarray(speed**2)


def path_rows(
    robot: Robot,
    samples: PathSamples,
    load: PathLoad,
    signs: Array,
    ceiling: Array,
    speed_squared: Array,
    *,
    starts: bool,
) -> PathRows:
    """Acceleration and motor-torque limits as rows, the friction coefficient taken at the speed of the last pass.

    starts: from rest, so that friction at the first sample is static.
    """
    rows = _RowList([], [], [], [])
    zero = np.zeros(len(samples.s))
    for i, joint in enumerate(robot.joints):
        for side in (1.0, -1.0):
            rows.add(side * samples.dq[:, i], side * samples.ddq[:, i], zero, zero, joint.acceleration)
        if joint.drive is not None and joint.motor is not None:
            _add_torque_rows(
                rows, joint.drive, joint.motor.max_torque, i, samples, load, signs[:, i], ceiling, speed_squared, starts
            )
    a, b, c, k = (np.stack(column, axis=1) for column in (rows.a, rows.b, rows.c, rows.k))
    return PathRows(a, b, c, k, ceiling)


@dataclass(frozen=True)
class _RowList:
    a: list[Array]
    b: list[Array]
    c: list[Array]
    k: list[Array]

    def add(self, a: Array, b: Array, c: Array, k: Array, limit: float) -> None:
        for column, value in zip((self.a, self.b, self.c, self.k), (a, b, c, k), strict=True):
            column.append(value / limit)


def _add_torque_rows(
    rows: _RowList,
    drive: Drive,
    limit: float,
    i: int,
    samples: PathSamples,
    load: PathLoad,
    sigma: Array,
    ceiling: Array,
    speed_squared: Array,
    starts: bool,
) -> None:
    """σ τ_motor ≤ limit as two rows, and −σ τ_motor ≤ limit as one on the safe side."""
    friction, r = friction_of(drive), drive.ratio
    dq, ddq = samples.dq[:, i], samples.ddq[:, i]
    moving = np.abs(sigma)
    mu = friction_coefficient(friction, r * np.abs(dq) * np.sqrt(speed_squared))
    mu = np.where((samples.s == 0.0) & starts, np.maximum(mu, friction.mu_static), mu)
    forward, backward = motor_torque_rows(drive, 1, mu), motor_torque_rows(drive, -1, mu)
    effort_a = sigma * (load.inertia[:, i] + drive.output_inertia * dq)
    effort_b = sigma * (load.velocity[:, i] + drive.output_inertia * ddq)
    effort_c = sigma * load.gravity[:, i] + moving * friction.b_oc
    effort = effort_b * speed_squared + effort_c
    inertia = np.where(sigma > 0, forward.inertia, backward.inertia) * sigma * r
    coulomb = np.where(sigma > 0, forward.coulomb, -backward.coulomb) * moving
    slopes = [np.where(sigma > 0, forward.slope[k], backward.slope[k]) for k in (0, 1)]
    for slope in slopes:
        root = (forward.viscous * r + slope * friction.b_ov) * np.abs(dq)
        rows.add(
            inertia * dq + slope * effort_a,
            inertia * ddq + slope * effort_b,
            coulomb + slope * effort_c,
            np.maximum(root, 0.0),
            limit,
        )
    # The torque is the larger of the two, so either one bounds it from below; √x ≥ x/√ceiling there.
    slope = np.where(slopes[0] * effort > slopes[1] * effort, slopes[0], slopes[1])
    chord = np.maximum(forward.viscous * r + slope * friction.b_ov, 0.0) * np.abs(dq) / np.sqrt(ceiling)
    rows.add(
        -(inertia * dq + slope * effort_a),
        -(inertia * ddq + slope * effort_b + chord),
        -(coulomb + slope * effort_c),
        np.zeros_like(dq),
        limit,
    )


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


def _solve(grid: Array, rows: PathRows, tangent: Array, speeds: tuple[float, float]) -> Array | None:
    """One TOPP-RA pass; ṡ² at the grid points or None where there is no motion."""
    load_toppra()
    from toppra.algorithm import TOPPRA
    from toppra.constraint import LinearConstraint
    from toppra.interpolator import AbstractGeometricPath

    # TOPP-RA has absolute tolerances: choose the unit of time in which ṡ² is of order one
    unit = 1 / max(float(np.abs(rows.a).max()), 1 / float(rows.ceiling.max()))
    rows = PathRows(rows.a * unit, rows.b * unit, rows.c, rows.k * np.sqrt(unit), rows.ceiling / unit)
    root = np.sqrt(np.maximum(tangent / unit, 1e-12 * tangent.max() / unit))
    b = rows.b + rows.k / (2 * root)[:, None]
    c = rows.c + rows.k * (root / 2)[:, None]
    count = rows.a.shape[1]

    # interpolation: the rows at the end of an interval too, for what the motion is there
    ahead = np.append(np.arange(1, len(grid)), len(grid) - 1)
    step = np.append(np.diff(grid), 0.0)[:, None]
    a = np.hstack([rows.a, rows.a[ahead] + 2 * step * b[ahead]])
    b, c = np.hstack([b, b[ahead]]), np.hstack([c, c[ahead]])

    class Rows(LinearConstraint):
        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, *_: object, **__: object) -> tuple[object, ...]:
            bounds = np.stack([np.zeros(len(grid)), rows.ceiling], axis=1)
            return a, b, c, np.eye(2 * count), np.ones(2 * count), None, bounds

    class Line(AbstractGeometricPath):
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
