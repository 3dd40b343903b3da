"""The optimal control problem of one free phase: the planner chooses the joint path through the points given.

Between two points every joint moves one way, so positions lie between the points' and the friction law enters exactly. A
joint that goes on in its direction passes a point at speed; one that turns back there, or stands on one side, is at rest.
Velocity, acceleration and jerk are kept by construction; motor torque, tip speed, rates, roll and spin ranges and the eye at
collocation points, as far as they come near their limits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ssm_planner.codegen.functions import call
from ssm_planner.kinematics.eye import LENS, RETINA, retina_row
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.planning.ocp.constraints import UNLIMITED, limit_table, limits_jerk
from ssm_planner.planning.ocp.free_element import NUMBERS, RATED, WATCHED, FreeElement
from ssm_planner.planning.ocp.guesses import FreeGuess, guess, retimed
from ssm_planner.planning.ocp.nlp import BoundaryConditions, NlpData, NlpSolution, NlpStructure, blocks_of
from ssm_planner.planning.ocp.refinement import PARTS, SHORTEST, Start, optimise, parabolic_peak
from ssm_planner.planning.ocp.transcription import DENSE, Aim, RowName, shared
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.problem.problem import TASK, Problem
from ssm_planner.typing import Array, Indices

ELEMENTS = 40
SHORTEST_PASSING = 0.01
"""Least time of a block where points are passed, as a share of the guess's, which rests at each of them."""
MOVES = 1e-9
"""A joint that has less than this to go (rad, m) stands."""
FAR, MORE = 2.0, 1.5
"""Where a row of the closed-form guess is larger than this, TOPP-RA makes the guess; and times as many elements, for less
is then known of where they are needed."""
ANYWHERE = 1e3
"""Half width of a range that is not limited, rad."""


@dataclass(frozen=True, eq=False)
class FreeResult:
    """status: "solved", "infeasible" or "not converged"; breaks (n + 1,) in s; q, q̇, q̈ at both ends of elements, (n, 4)."""

    status: str
    message: str
    breaks: Array
    start: tuple[Array, Array, Array]
    end: tuple[Array, Array, Array]
    borders: Array
    """Instants at which the points are passed, (k + 1,)."""
    iterations: int

    @property
    def solved(self) -> bool:
        return self.status == "solved"


def solve_free(
    problem: Problem,
    mechanism: Mechanism,
    points: Array,
    tighten: Array | None = None,
    duration: float | None = None,
    speeds: tuple[Array, Array] | None = None,
    count: int = ELEMENTS,
) -> FreeResult:
    """Motion through the joints `points` (k + 1, 4).

    tighten (4, 4): as for `solve_straight`. duration: asked for, s. speeds: q̇ (4,) at both ends, at rest by default.
    """
    task = _FreeTask.of(problem, mechanism, points, tighten, speeds or (np.zeros(4), np.zeros(4)), count)
    asked = None if duration is None else duration / task.scale
    return task.result(optimise(task, task.start, problem.objective, asked))


@dataclass(frozen=True, eq=False)
class _FreeTask:
    """A free phase as solving.Task."""

    problem: Problem
    mechanism: Mechanism
    points: Array
    way: Array
    """(k, 4): of every joint in every segment."""
    table: Array
    speeds: tuple[Array, Array]
    guesses: tuple[FreeGuess, ...]
    shape: NlpStructure
    fractions: Array
    """Length of every element as a share of its block, (n,)."""
    times: Array
    """Time of every block in the guess, (b,), in scaled time."""

    @classmethod
    def of(
        cls,
        problem: Problem,
        mechanism: Mechanism,
        points: Array,
        tighten: Array | None,
        speeds: tuple[Array, Array],
        count: int,
    ) -> _FreeTask:
        robot = problem.robot
        table = limit_table(robot) * (1.0 if tighten is None else tighten)
        if "depth" in problem.rates:
            table[0, 3] = min(table[0, 3], problem.rates["depth"])
        way = np.diff(points, axis=0)
        way[np.abs(way) <= MOVES] = 0.0
        each = max(2 * count // len(way), 8) if len(way) > 1 else count
        guesses = tuple(guess(w, table[:3], limits_jerk(robot), each, 2 if len(way) < 16 else 1) for w in way)
        task = cls._from(problem, mechanism, points, way, table, speeds, guesses)
        if task.largest(task.start.elements).max(initial=0.0) < FAR:
            return task
        slower = tuple(
            retimed(robot, problem.task_limits, PolylinePath(mechanism, points[k : k + 2]), round(MORE * each))
            or guesses[k]
            for k in range(len(way))
        )
        return cls._from(problem, mechanism, points, way, table, speeds, slower)

    @classmethod
    def _from(
        cls,
        problem: Problem,
        mechanism: Mechanism,
        points: Array,
        way: Array,
        table: Array,
        speeds: tuple[Array, Array],
        guesses: tuple[FreeGuess, ...],
    ) -> _FreeTask:
        robot = problem.robot
        blocks = blocks_of([n for g in guesses for n in g.arcs])
        shape = NlpStructure(
            moves=tuple(tuple((w[np.any(way != 0, axis=0)] != 0).tolist()) for w in way),
            share=tuple(sum(g.arcs) for g in guesses),
            blocks=blocks,
            smooth=limits_jerk(robot),
            hull=True,
            joints=True,
        )
        lengths = np.concatenate([np.diff(g.instants) for g in guesses])
        times = np.bincount(shape.block, lengths)
        return cls(
            problem,
            mechanism,
            points,
            way,
            table,
            speeds,
            guesses,
            shape,
            lengths / times[shape.block],
            times / times.sum(),
        )

    def refined(self, chosen: Array) -> _FreeTask:
        counts = np.where(chosen, PARTS, 1)
        shape = self.shape.split(chosen, PARTS)
        return replace(self, shape=shape, fractions=np.repeat(self.fractions / counts, counts))

    @cached_property
    def moving(self) -> Indices:
        return np.flatnonzero(np.any(self.way != 0, axis=0))

    @cached_property
    def unit(self) -> Array:
        """Length of u = 1 by joint, (4,)."""
        return np.asarray(np.abs(self.way).max(axis=0))

    @cached_property
    def scale(self) -> float:
        """Length of a scaled second, s."""
        return sum(g.duration for g in self.guesses)

    @cached_property
    def start(self) -> Start:
        states = []
        for guess_, point in zip(self.guesses, self.points, strict=False):
            y, *rates = guess_.states
            parts = [(y + point - self.points[0]), *rates]
            orders = (0, 1, 2, 2)
            states.append(np.hstack([self._scaled(part, k) for part, k in zip(parts, orders, strict=True)]))
        return Start(np.vstack(states), self.times, self.times[self.shape.block] * self.fractions)

    def _scaled(self, values: Array, order: int) -> Array:
        return (values * self.scale**order / np.where(self.unit > 0, self.unit, 1.0))[..., self.moving]

    @cached_property
    def names(self) -> list[RowName]:
        return self._everything.names

    always: frozenset[RowName] = frozenset()

    def stage(self, kept: frozenset[RowName], aim: Aim) -> FreeElement:
        eye = self.problem.eye if any(name in (RETINA, LENS) for name, _ in kept) else None
        return shared(FreeElement(self.problem.robot, self.mechanism, tuple(self.moving.tolist()), kept, eye, aim))

    def question(self, elements: Array, backoff: Array) -> NlpData:
        points = self._scaled(self.points - self.points[0], 0)
        start_speed, end_speed = (self._scaled(speed, 1) for speed in self.speeds)
        course = BoundaryConditions(points, np.sign(self.way)[:, self.moving], start_speed, end_speed)
        limits = (self._scaled(self.table[k], k + 1) for k in range(3))
        speed, acceleration, jerk = limits
        lower, upper, hull = course.bounds(self.shape, speed, acceleration)
        return NlpData(
            arguments=(self._sigma, self._numbers),
            fractions=self.fractions,
            times=(SHORTEST if len(self.way) == 1 else SHORTEST_PASSING) * self.times,
            lower=lower,
            upper=upper,
            speed=hull,
            end=np.concatenate([points[-1], end_speed]),
            acceleration=acceleration,
            jerk=jerk,
            allowed=np.ones((len(elements), backoff.shape[1])) - backoff,
            starting=self._starting,
        )

    def largest(self, elements: Array) -> Array:
        n = len(elements)
        if not self.names:
            return np.zeros((n, 0))
        rows = call(self._everything.between, elements, self._sigma, np.tile(self._numbers, (n, 1)))[0]
        return parabolic_peak(rows.reshape(n, len(DENSE), -1).transpose(0, 2, 1))

    @cached_property
    def _everything(self) -> FreeElement:
        """All coupled limits that this problem has."""
        problem = self.problem
        rows: set[RowName] = {(f"{name} range", None) for name in WATCHED if name in problem.ranges}
        rows |= {(f"{name} rate", None) for name in RATED if name in problem.rates}
        if problem.tip_speed is not None:
            rows.add(("tip speed", None))
        if problem.eye is not None:
            rows |= {(RETINA, None), *({(LENS, None)} if problem.eye.lens is not None else ())}
        for i in self.moving:
            joint = problem.robot.joints[i]
            if joint.drive is not None and joint.motor is not None:
                rows.add(("motor torque", int(i)))
        moving = tuple(self.moving.tolist())
        return shared(FreeElement(problem.robot, self.mechanism, moving, frozenset(rows), problem.eye))

    @cached_property
    def _sigma(self) -> Array:
        return np.sign(self.way)[self.shape.segment]

    @cached_property
    def _starting(self) -> Array:
        """1 for the joints that are at rest at the beginning of a segment and may move then."""
        joints = self._everything.breakaway_joints
        rows = []
        for k, side in self.shape.starts:
            rest = self._sigma[k] != self._sigma[k - 1] if k else self.speeds[0] == 0.0
            rows.append(np.where(rest & (self._sigma[side] != 0), 1.0, np.inf)[joints])
        return np.array(rows)

    @cached_property
    def _numbers(self) -> Array:
        problem = self.problem
        rates = [problem.rates.get(name, UNLIMITED) for name in RATED]
        scalars = [self._easing(), self.scale]
        numbers = [self.points[0], self.unit, self.table.ravel(), self._ranges(), rates, scalars]
        return np.concatenate(numbers).reshape(NUMBERS)

    def _easing(self) -> float:
        """By how much the rounding of the retina's row forbids one of the points, which the limit itself allows."""
        from ssm_planner.codegen.namespace import NUMPY

        if self.problem.eye is None:
            return 0.0
        return max(0.0, float(retina_row(NUMPY, self.problem.eye, tip_position(self.mechanism, self.points).T).max()))

    def _ranges(self) -> list[float]:
        """Tip speed, centre and half width of the watched ranges, in the turn of the closed form at the first joints."""
        from ssm_planner.codegen.namespace import NUMPY
        from ssm_planner.kinematics.task import task_of_joints

        problem, first = self.problem, self.points[0]
        unwrapped = task_of_joints(NUMPY, self.mechanism, tuple(first))
        wrapped = task_from_joints(self.mechanism, first[None, :])[0]
        values = [UNLIMITED if problem.tip_speed is None else problem.tip_speed]
        for name in WATCHED:
            k = TASK.index(name)
            low, high = problem.ranges.get(name, (-ANYWHERE, ANYWHERE))
            values += [(low + high) / 2 + float(unwrapped[k]) - wrapped[k], (high - low) / 2]
        return values

    def result(self, answer: NlpSolution) -> FreeResult:
        """Joint states in s at both ends of every element; neighbours share position and velocity to the last digit."""
        m, n = len(self.moving), len(answer.elements)
        u, v, a0, a1 = (answer.elements[:, k * m : (k + 1) * m] for k in range(4))
        end = self._scaled(self.points[-1] - self.points[0], 0), self._scaled(self.speeds[1], 1)

        def joints(values: Array, order: int) -> Array:
            full = np.zeros((n, 4))
            full[:, self.moving] = values * self.unit[self.moving] / self.scale**order
            return full + (self.points[0] if order == 0 else 0.0)

        start = joints(u, 0), joints(v, 1), joints(a0, 2)
        after = joints(np.vstack([u[1:], end[0]]), 0), joints(np.vstack([v[1:], end[1]]), 1), joints(a1, 2)
        breaks = np.concatenate([[0.0], np.cumsum(answer.elements[:, -1] * self.scale)])
        borders = breaks[[*answer.shape.borders, n]]
        return FreeResult(answer.status, answer.message, breaks, start, after, borders, answer.iterations)
