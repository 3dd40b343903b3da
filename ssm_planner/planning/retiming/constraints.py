"""The limits along a path q(s) as constraints on s̈ and ṡ² for TOPP-RA, with exact friction.

Along a path every quantity that is linear in q̈, q̇² and |q̇| becomes a function of the path's acceleration s̈ and speed ṡ ≥ 0,

    a(s) s̈ + b(s) ṡ² + c(s) + k(s) ṡ                                                                              (1)

because q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ², ' being the derivative by s. `PathTerm` is one such function. A limit becomes a row
(1) ≤ 1, scaled by the limit; `LinearConstraints` holds all rows of a path. With ṡ² = x, (1) is linear in (s̈, x) but for
k √x, which is concave and is replaced by a tangent that over-estimates it.

Sources: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on Reachability Analysis, IEEE
T-RO 34(3), 2018, §II (rows linear in (s̈, ṡ²)); dynamics/transmission.py (the friction law).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ssm_planner.dynamics.friction import breakaway_coefficient, friction_coefficient, friction_of
from ssm_planner.dynamics.motors import motorised
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque_rows, output_effort
from ssm_planner.kinematics.forward import tool_speed
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.planning.retiming.paths import JointPath, PathSamples
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.limits import TASK, TipSpeed
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array, Indices, Mask

ACTIVE = 0.998
"""A row counts as binding from this share of its limit on."""
BEYOND = 1e-9
"""Share by which a row that was left out may be exceeded."""
Actuation = tuple[int, int, Drive, tuple[int, ...]]
"""A joint with one of its `Robot.actuations`."""
CEILING, NONE = -1, -2
"""What binds instead of a row: the speed ceiling, or nothing."""


@dataclass(frozen=True, eq=False)
class PathTerm:
    """a s̈ + b ṡ² + c + k ṡ at n points of a path."""

    values: Array
    """a, b, c, k: (4, n)."""

    __array_ufunc__ = None
    """So that array * term is a term, not an array of objects."""

    @classmethod
    def of(cls, points: int, **given: Array | float) -> PathTerm:
        """From coefficients by name, each (points,) or a number for all; 0 where not given."""
        values = np.zeros((4, points))
        for name, value in given.items():
            values["abck".index(name)] = value
        return cls(values)

    def __add__(self, other: PathTerm | Array | float) -> PathTerm:
        if isinstance(other, PathTerm):
            return PathTerm(self.values + other.values)
        values = self.values.copy()
        values[2] += other
        return PathTerm(values)

    def __rmul__(self, factor: Array | float) -> PathTerm:
        return PathTerm(factor * self.values)

    def __neg__(self) -> PathTerm:
        return PathTerm(-self.values)

    def without_negative_k(self) -> PathTerm:
        """A term that is at least as large and concave in ṡ²."""
        values = self.values.copy()
        np.maximum(values[3], 0.0, out=values[3])
        return PathTerm(values)


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """a s̈ + b ṡ² + c + k ṡ ≤ 1, each row scaled by its limit, (n, rows) each; and ṡ² ≤ ceiling, (n,)."""

    a: Array
    b: Array
    c: Array
    k: Array
    ceiling: Array

    @classmethod
    def of(cls, rows: list[tuple[PathTerm, float]], ceiling: Array) -> LinearConstraints:
        """From the rows (term, limit), term ≤ limit, in their order."""
        values = np.empty((4, len(ceiling), len(rows)))
        for row, (term, limit) in enumerate(rows):
            values[:, :, row] = term.values / limit
        a, b, c, k = values
        return cls(a, b, c, k, ceiling)

    def tangent(self, speed_squared: Array) -> LinearConstraints:
        """Rows without k, at least as strict, exact at ṡ² = speed_squared (n,): √x ≤ √x₀/2 + x/(2 √x₀)."""
        root, k = np.sqrt(speed_squared)[:, None], self.k[:, self.curved]
        b, c = self.b.copy(), self.c.copy()
        b[:, self.curved] += k / (2 * root)
        c[:, self.curved] += k * (root / 2)
        return LinearConstraints(self.a, b, c, np.broadcast_to(0.0, c.shape), self.ceiling)

    @cached_property
    def curved(self) -> Indices:
        """Rows with a k somewhere."""
        return np.flatnonzero(self.k.any(axis=0))

    def part(self, points: slice) -> LinearConstraints:
        """At some of the points."""
        a, b, c, k, ceiling = (
            values[points] for values in (self.a, self.b, self.c, self.k, self.ceiling)
        )
        return LinearConstraints(a, b, c, k, ceiling)

    def largest(self, grid: Array, speed_squared: Array) -> Array:
        """Of every row on each interval of the grid (n,), at its ends, (n − 1, rows)."""
        acceleration, root = (
            (np.diff(speed_squared) / (2 * np.diff(grid)))[:, None],
            np.sqrt(speed_squared)[:, None],
        )
        rest = self.b * speed_squared[:, None] + self.c + self.k * root
        return np.maximum(
            self.a[:-1] * acceleration + rest[:-1], self.a[1:] * acceleration + rest[1:]
        )

    def active(self, grid: Array, speed_squared: Array) -> Array:
        """The row that binds on each interval of the grid (n,), or CEILING or NONE: (n − 1,)."""

        every = slice(None)
        value, ceiling = (
            self._middle(grid, speed_squared, every),
            (self.ceiling[1:] + self.ceiling[:-1]) / 2,
        )
        row = np.argmax(value, axis=1)
        largest = value[np.arange(len(row)), row]
        of_ceiling = (speed_squared[1:] + speed_squared[:-1]) / 2 / ceiling
        row[of_ceiling > largest] = CEILING
        return np.where(np.maximum(largest, of_ceiling) > ACTIVE, row, NONE)

    def bind(self, rows: Indices, grid: Array, speed_squared: Array) -> bool:
        """Whether some of these rows bind on an interval of the grid (n,)."""
        if not len(rows) or not (self._middle(grid, speed_squared, rows) > ACTIVE).any():
            return False
        mine = np.zeros(self.a.shape[1] - NONE, dtype=bool)  # the last two are CEILING and NONE
        mine[rows] = True
        return bool(mine[self.active(grid, speed_squared)].any())

    def _middle(self, grid: Array, speed_squared: Array, rows: Indices | slice) -> Array:
        """Of these rows in the middle of each interval of the grid (n,), (n − 1, rows)."""

        def middle(values: Array) -> Array:
            own = values[:, rows]
            return (own[1:] + own[:-1]) / 2

        acceleration = (np.diff(speed_squared) / (2 * np.diff(grid)))[:, None]
        x = ((speed_squared[1:] + speed_squared[:-1]) / 2)[:, None]
        value = middle(self.a) * acceleration + middle(self.b) * x + middle(self.c)
        return value + middle(self.k) * np.sqrt(x) if len(self.curved) else value


@dataclass(frozen=True, eq=False)
class _TorqueLaw:
    """Terms of which the torque of one motor is made, for friction coefficients mu (n,).

    With the output effort F = τ_rigid + J_out q̈ + b_oc σ + b_ov q̇ and the motor speed w = r q̇, the torque in the
    direction σ of motion is the larger of two linear functions (transmission.TorqueRows):

        σ τ = max_k [slope_k σF + σ (inertia ẇ + coulomb + viscous w)]

    Driving, σ τ ≤ limit: both functions, exact. Braking, −σ τ ≤ limit: either function bounds σ τ from below, so one of
    them is enough; that which is larger at the given ṡ² is taken, with ṡ ≥ ṡ² / √ceiling.
    """

    mu: Array
    slopes: tuple[Array, Array]
    effort: PathTerm
    """σF."""
    motor: PathTerm
    """σ (inertia ẇ + coulomb + viscous w)."""

    @cached_property
    def driving(self) -> list[PathTerm]:
        return [(slope * self.effort + self.motor).without_negative_k() for slope in self.slopes]

    def first_is_larger(self, speed_squared: Array) -> Mask:
        """Which of the two functions is the larger one at ṡ² (n,)."""
        first, second = self.slopes
        _, b, c, _ = self.effort.values
        mesh = b * speed_squared + c
        return np.asarray(first * mesh > second * mesh)

    def braking(self, first: Mask, ceiling: Array) -> PathTerm:
        """By the first function or the second one (n,), up to the ceiling of ṡ² (n,)."""
        larger = np.where(first, *self.slopes)
        values = (larger * self.effort + self.motor).without_negative_k().values
        values[1] += values[3] / np.sqrt(ceiling)
        values[3] = 0.0
        return PathTerm(-values)


@dataclass(frozen=True, eq=False)
class _Law:
    """What one actuation's rows are made of."""

    torque: _TorqueLaw
    sides: tuple[int, ...]
    first: Mask | None
    """As `_TorqueLaw.first_is_larger`; None where braking does not count."""
    limit: float

    def rows(self, ceiling: Array) -> list[tuple[PathTerm, float]]:
        """(term, limit), term ≤ limit."""
        driving = self.torque.driving if 1 in self.sides else ()
        braking = () if self.first is None else (self.torque.braking(self.first, ceiling),)
        return [(term, self.limit) for term in (*driving, *braking)]

    def same(self, other: _Law) -> bool:
        """Whether the rows are the same, of one robot and actuation."""
        if self.torque is not other.torque:
            return False
        if self.first is None or other.first is None:
            return self.first is other.first
        return np.array_equal(self.first, other.first)


@dataclass(frozen=True, eq=False)
class PathLimits:
    """The limits of a robot at n points of a path, and what of them does not depend on the motion along it."""

    robot: Robot
    samples: PathSamples
    loads: tuple[tuple[Array, Array, Array], ...]
    """A, B, C of τ_rigid = A s̈ + B ṡ² + C, (n, 4) each, for each of `Robot.loads`."""
    directions: Array
    """σ: sign of q'(s), 0 for a joint that stands, (n, 4)."""
    ceiling: Array
    """Largest ṡ² that the speed limits allow, (n,)."""
    starts: Mask
    """Where joints start from rest, (n, 4)."""
    stops: Array | None
    """|J q'| / (2d) (n,) of a limit d on the way of a stop."""
    actuations: tuple[Actuation, ...]
    """That have rows."""
    left_out: tuple[Actuation, ...] = ()
    """Others, at corners of a range of friction and payload: they get rows when a motion takes too much with them."""
    laws: dict[tuple[int, int, int, bool], _TorqueLaw] = field(default_factory=dict)
    """Of every joint's loads and drives, at a static start or not, as last asked for: most friction coefficients are the
    same in every pass."""
    last: list[tuple[list[_Law], LinearConstraints]] = field(default_factory=list, init=False)
    """The rows last asked for, and of which laws they are."""

    @classmethod
    def along(
        cls,
        path: JointPath,
        grid: Array,
        robot: Robot,
        limits: TaskLimits,
        like: PathLimits | None = None,
    ) -> PathLimits:
        """At the points s (n,) of a grid; like: of the same robot, whose actuations are to have rows."""
        knots, signs = path.directions
        interval = np.clip(np.searchsorted(knots, grid, side="right") - 1, 0, len(knots) - 2)
        samples = path.sample(grid)
        bodies = map(RigidBody.from_robot, robot.loads)
        loads = tuple(body.path_load(samples.q, samples.dq, samples.ddq) for body in bodies)
        ceiling = _speed_ceiling(path, samples, robot, limits)
        stops = None
        if limits.stop_travel is not None:
            stops = tool_speed(TipSpeed, path.mechanism, samples.q, samples.dq) / (
                2 * limits.stop_travel.largest
            )
        actuations, left_out = (
            _first_actuations(robot) if like is None else (like.actuations, like.left_out)
        )
        return cls(
            robot,
            samples,
            loads,
            directions=signs[interval],
            ceiling=ceiling,
            starts=path.starts(samples),
            stops=stops,
            actuations=actuations,
            left_out=left_out,
        )

    def constraints(self, speed_squared: Array, *, static_start: bool) -> LinearConstraints:
        """Rows for the joints' accelerations and the motors' torques.

        speed_squared (n,): ṡ² at which the friction coefficient is taken, that of the previous pass. static_start: friction
        is static where joints start.

        Acceleration: ±(q'_i s̈ + q''_i ṡ²) ≤ q̈_i,max, and (2) of `braking_travel`. Torque: see `_TorqueLaw`.
        """
        laws = self._laws(self.actuations, speed_squared, static_start)
        if self.last and all(map(_Law.same, self.last[0][0], laws)):
            return self.last[0][1]
        rows: list[tuple[PathTerm, float]] = []
        for i, joint in enumerate(self.robot.joints):
            acceleration = self._term(a=self.samples.dq[:, i], b=self.samples.ddq[:, i])
            rows += [(acceleration, joint.acceleration), (-acceleration, joint.acceleration)]
            if self.stops is not None:
                braking = self._term(b=self.stops * np.abs(self.samples.dq[:, i]))
                rows.append(
                    (braking + -np.sign(self.samples.dq[:, i]) * acceleration, joint.acceleration)
                )
        for law in laws:
            rows += law.rows(self.ceiling)
        found = LinearConstraints.of(rows, self.ceiling)
        self.last[:] = [(laws, found)]
        return found

    def with_missed(self, grid: Array, speed_squared: Array, *, static_start: bool) -> PathLimits:
        """With rows for what a motion ṡ² (n,) on the grid takes too much with: of each joint what is worst somewhere."""
        rows = [
            law.rows(self.ceiling) for law in self._laws(self.left_out, speed_squared, static_start)
        ]
        if not rows:
            return self
        values = LinearConstraints.of([row for each in rows for row in each], self.ceiling).largest(
            grid, speed_squared
        )
        of = np.cumsum([0, *map(len, rows[:-1])])
        worst = np.maximum.reduceat(values, of, axis=1)
        missed: set[int] = set()
        for i in {each[0] for each in self.left_out}:
            own = np.array([k for k, each in enumerate(self.left_out) if each[0] == i])
            exceeded = worst[:, own].max(axis=1) > 1 + BEYOND
            missed |= set(own[np.argmax(worst[:, own], axis=1)[exceeded]].tolist())
        if not missed:
            return self
        more = tuple(each for k, each in enumerate(self.left_out) if k in missed)
        left_out = tuple(each for k, each in enumerate(self.left_out) if k not in missed)
        return replace(self, actuations=(*self.actuations, *more), left_out=left_out)

    def _laws(
        self, actuations: Sequence[Actuation], speed_squared: Array, static_start: bool
    ) -> list[_Law]:
        """Of these, at the given ṡ² (n,)."""
        found = []
        for i, load, drive, sides in actuations:
            motor = self.robot.joints[i].motor
            key = i, load, id(drive), static_start
            law = self.laws.get(key)
            if law is None or friction_of(drive).stribeck_speed is not None:
                mu = self._friction_coefficient(drive, i, speed_squared, static_start)
                if law is None or not np.array_equal(law.mu, mu):
                    law = self.laws[key] = self._torque_law(drive, i, mu, self.loads[load])
            first = law.first_is_larger(speed_squared) if -1 in sides else None
            found.append(_Law(law, sides, first, np.inf if motor is None else motor.max_torque))
        return found

    def _friction_coefficient(
        self, drive: Drive, i: int, speed_squared: Array, static_start: bool
    ) -> Array:
        """μ (n,) of the drive of joint i at the given ṡ²; at a start from rest at least the static one."""
        friction = friction_of(drive)
        w: Array | float = 0.0  # where the speed does not count
        if friction.stribeck_speed is not None:
            w = drive.ratio * np.abs(self.samples.dq[:, i]) * np.sqrt(speed_squared)
        starts = self.starts[:, i] if static_start else np.zeros_like(self.starts[:, i])
        return np.where(
            starts,
            np.asarray(breakaway_coefficient(friction, w)),
            friction_coefficient(friction, w),
        )

    def _torque_law(
        self, drive: Drive, i: int, mu: Array, load: tuple[Array, Array, Array]
    ) -> _TorqueLaw:
        """The motor torque of joint i for friction coefficients mu (n,)."""
        sigma, dq, ddq = self.directions[:, i], self.samples.dq[:, i], self.samples.ddq[:, i]
        qd, qdd = self._term(k=sigma * np.abs(dq)), self._term(a=dq, b=ddq)
        tau_rigid = self._term(**{name: part[:, i] for name, part in zip("abc", load, strict=True)})
        rows = motor_torque_rows(drive, sigma, mu)
        first, second = (np.asarray(slope) for slope in rows.slope)
        effort = sigma * output_effort(drive, tau_rigid, qd, qdd, sigma)
        return _TorqueLaw(
            mu,
            (first, second),
            effort,
            sigma * rows.torque(self._term(), drive.ratio * qd, drive.ratio * qdd),
        )

    def _term(self, **given: Array | float) -> PathTerm:
        return PathTerm.of(len(self.ceiling), **given)


def _first_actuations(robot: Robot) -> tuple[tuple[Actuation, ...], tuple[Actuation, ...]]:
    """Those that get rows at once, for each joint and load the first of the corners, and the others."""
    every = [(i, *each) for i in range(4) for each in robot.actuations(i)]
    first: dict[tuple[int, int, tuple[int, ...]], Actuation] = {}
    left_out = []
    for each in every:
        i, load, _, sides = each
        if first.setdefault((i, load, sides), each) is not each:
            left_out.append(each)
    return tuple(first.values()), tuple(left_out)


def braking_travel(mechanism: Mechanism, robot: Robot, q: Array, qd: Array) -> Array:
    """Way of the tip (n,), m, from q and q̇ (n, 4) until rest, where every joint brakes evenly by its largest acceleration.

    Along a path q(s) a joint that brakes by itself too leaves less: while at every point s̈ ≤ −|J q'|/(2d) ṡ² is within the
    accelerations, for every speed up to ṡ, d(ṡ²)/ds = 2 s̈ takes ṡ to 0 within a way of d. So the limit d holds where

        |J q'| |q'_i| ṡ² / (2d) − min(0, ± (q'_i s̈ + q''_i ṡ²)) ≤ q̈_i,max,                                          (2)

    + where joint i goes forwards. It is sufficient; motors that cannot brake as hard are left to the check.
    """
    limit = np.array([joint.acceleration for joint in robot.joints])
    return np.asarray(tool_speed(TipSpeed, mechanism, q, qd) * (np.abs(qd) / limit).max(axis=1) / 2)


def _speed_ceiling(
    path: JointPath, samples: PathSamples, robot: Robot, limits: TaskLimits
) -> Array:
    """Largest ṡ² (n,) at which joints, motors, tool and task coordinates keep their speed limits, and stops theirs.

    The speeds are |q'_i| ṡ, r |q'_i| ṡ, |J(q) q'| ṡ and |dtask/ds| ṡ; for stops see `braking_travel`.
    """
    limit = np.array([joint.velocity for joint in robot.joints])
    for i, drive, motor in motorised(robot.joints):
        limit[i] = min(limit[i], motor.max_speed / drive.ratio)
    with np.errstate(divide="ignore"):
        speed = (limit / np.abs(samples.dq)).min(axis=1)
        for bound in limits.speeds:
            slope = tool_speed(type(bound), path.mechanism, samples.q, samples.dq)
            speed = np.minimum(speed, bound.largest / slope)
        if limits.stop_travel is not None:
            travel = braking_travel(path.mechanism, robot, samples.q, samples.dq)
            speed = np.minimum(speed, np.sqrt(limits.stop_travel.largest / travel))
        if limits.rates:
            slope = np.abs(task_rates(path.mechanism, samples.q, samples.dq))
            for name, rate in limits.rates.items():
                speed = np.minimum(speed, rate / slope[:, TASK.index(name)])
    return np.asarray(speed**2)
