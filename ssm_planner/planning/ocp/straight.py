"""The optimal control problem of one straight phase: cubic pieces s(t) along a path.

The guess is TOPP-RA's motion along the same path, and the mesh is aligned with its switching points. Between turning
points every joint keeps its direction, so the friction law enters exactly (planning/rows.py).

From s(t) along a path to joint polynomials.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ssm_planner.codegen.functions import call
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.planning.lower_bound import lower_bound
from ssm_planner.planning.ocp.constraints import UNLIMITED, limit_table, limits_jerk
from ssm_planner.planning.ocp.mesh import Mesh
from ssm_planner.planning.ocp.nlp import BoundaryConditions, NlpData, NlpSolution, NlpStructure
from ssm_planner.planning.ocp.path_fit import LOCAL, fit, serves
from ssm_planner.planning.ocp.refinement import PARTS, SHORTEST, Start, optimise, parabolic_peak
from ssm_planner.planning.ocp.straight_element import StraightElement
from ssm_planner.planning.ocp.transcription import DENSE, Aim, RowName, shared
from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.problem.problem import TASK, Objective, TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import hermite
from ssm_planner.typing import Array

ELEMENTS = 72


@dataclass(frozen=True, eq=False)
class PathMotion:
    """s(t) as elements (n, 5): s, ṡ, s̈ at the start, s̈ at the end, length; s, and s ∈ [0, 1]. message: Ipopt's word."""

    status: str
    message: str
    elements: Array
    iterations: int

    @classmethod
    def of(cls, retiming: Retiming) -> PathMotion:
        """TOPP-RA's motion: ṡ² linear in s, so that s̈ is constant, between its grid points."""
        s, speed = retiming.s, np.sqrt(retiming.speed_squared)
        acceleration = np.diff(retiming.speed_squared) / (2 * np.diff(s))
        elements = np.column_stack([s[:-1], speed[:-1], acceleration, acceleration, np.diff(retiming.times)])
        return cls(retiming.status, retiming.message, elements, 0)

    @property
    def solved(self) -> bool:
        return self.status == "solved"

    @property
    def duration(self) -> float:
        return float(self.elements[:, 4].sum())


def solve_straight(
    robot: Robot,
    path: StraightPath,
    guess: Retiming,
    limits: TaskLimits = TaskLimits(),  # noqa: B008  frozen
    tighten: Array | None = None,
    objective: Objective = "time",
    duration: float | None = None,
    speeds: tuple[float, float] = (0.0, 0.0),
    count: int = ELEMENTS,
) -> PathMotion:
    """Motion along the path, from TOPP-RA's motion as guess.

    tighten (4, 4): factors on the velocity, acceleration, jerk and torque limits (rows) of the joints (columns).
    duration: asked for, s; speeds: ṡ at both ends, 1/s.
    """
    jerk = limits_jerk(robot)
    knots, signs = path.directions
    mesh = Mesh.along(guess, knots, count, _path_jerk(robot, path, guess.s) if jerk else None)
    scale = max(guess.duration, lower_bound(robot, path.sample(np.array([0.0, 1.0])).q))
    table = limit_table(robot) * (1.0 if tighten is None else tighten)
    task = _StraightTask(robot, path, mesh, signs, table, scale, limits, (speeds[0] * scale, speeds[1] * scale))
    start = Start(mesh.guess(guess), mesh.times, np.diff(mesh.instants) / mesh.instants[-1])
    answer: NlpSolution = optimise(task, start, objective, None if duration is None else duration / scale)
    elements = answer.elements * np.array([1.0, 1 / scale, 1 / scale**2, 1 / scale**2, scale])
    return PathMotion(answer.status, answer.message, elements, answer.iterations)


@dataclass(frozen=True, eq=False)
class _StraightTask:
    """A straight phase as solving.Task."""

    robot: Robot
    path: StraightPath
    mesh: Mesh
    signs: Array
    table: Array
    scale: float
    limits: TaskLimits
    speeds: tuple[float, float]

    @cached_property
    def shape(self) -> NlpStructure:
        limited = self._fastest < UNLIMITED
        moves = ((True,),) * len(self.mesh.share)
        return NlpStructure(
            moves, self.mesh.share, self.mesh.blocks, limits_jerk(self.robot), hull=limited, joints=False
        )

    @cached_property
    def names(self) -> list[RowName]:
        return self._everything.names

    @cached_property
    def always(self) -> frozenset[RowName]:
        """Jerk: TOPP-RA's motion has none."""
        return frozenset(name for name in self.names if name[0] == "jerk")

    def stage(self, kept: frozenset[RowName], aim: Aim) -> StraightElement:
        return shared(StraightElement(self.robot, limits_jerk(self.robot), kept, aim))

    def question(self, elements: Array, backoff: Array) -> NlpData:
        knots, _ = self.path.directions
        n, intervals = len(elements), len(self.signs)
        course = BoundaryConditions(
            knots[:, None], np.ones((intervals, 1)), np.array(self.speeds[:1]), np.array(self.speeds[1:])
        )
        lower, upper, speed = course.bounds(self.shape, np.array([self._fastest]), np.array([np.inf]))
        return NlpData(
            arguments=(self._sigma, self._local(elements), self._numbers),
            fractions=self.mesh.fractions,
            times=SHORTEST * self.mesh.times,
            lower=lower,
            upper=upper,
            speed=speed,
            end=np.array([1.0, self.speeds[1]]),
            acceleration=np.ones(1),
            jerk=np.zeros(1),
            allowed=np.ones((n, backoff.shape[1])) - backoff,
            starting=self._starting,
        )

    def refined(self, chosen: Array) -> _StraightTask:
        return replace(self, mesh=self.mesh.split(chosen, PARTS))

    def largest(self, elements: Array) -> Array:
        rows = call(
            self._everything.between,
            elements,
            self._sigma,
            self._local(elements),
            np.tile(self._numbers, (len(elements), 1)),
        )[0]
        return parabolic_peak(rows.reshape(len(elements), len(DENSE), -1).transpose(0, 2, 1))

    @cached_property
    def _everything(self) -> StraightElement:
        """All rows that can bind: what moves, and what has a limit."""
        moving = np.abs(self.path.sample(np.linspace(0, 1, 33)).dq).max(axis=0) > 0
        names: set[RowName] = {("motor torque", i) for i in range(4)}
        for i in np.flatnonzero(moving):
            names |= {("velocity", int(i)), ("acceleration", int(i))}
            if self.robot.joints[i].jerk is not None:
                names.add(("jerk", int(i)))
        if self.limits.tip_speed is not None:
            names.add(("tip speed", None))
        return shared(StraightElement(self.robot, limits_jerk(self.robot), frozenset(names)))

    @cached_property
    def _sigma(self) -> Array:
        return self.signs[self.mesh.interval]

    @cached_property
    def _numbers(self) -> Array:
        tip_speed = UNLIMITED if self.limits.tip_speed is None else self.limits.tip_speed
        return np.concatenate([self.table.ravel(), [tip_speed, self.scale]])

    @cached_property
    def _fastest(self) -> float:
        """Largest ṡ that the rates of the task coordinates allow, in scaled time."""
        return rate_ceiling(self.path, self.limits.rates) * self.scale

    @cached_property
    def _body(self) -> RigidBody:
        return RigidBody.from_robot(self.robot)

    def _local(self, elements: Array) -> Array:
        """The fits around these elements; renewed for those that have left theirs."""
        low, high = elements[:, 0], np.append(elements[1:, 0], 1.0)
        old = np.logical_not(serves(self._fits, low, high))
        if old.any():
            self._fits[old] = fit(self.path, self._body, low[old], high[old])
        return self._fits

    @cached_property
    def _fits(self) -> Array:
        return np.full((len(self.mesh.interval), LOCAL), np.nan)

    @cached_property
    def _starting(self) -> Array:
        """1 for the joints that start or turn back at the beginning of an interval."""
        joints = self._everything.breakaway_joints
        rows = []
        for k, side in self.shape.starts:
            turning = self._sigma[k] != self._sigma[k - 1] if k else np.full(4, self.speeds[0] == 0.0)
            rows.append(np.where(turning & (self._sigma[side] != 0), 1.0, np.inf)[joints])
        return np.array(rows)


def rate_ceiling(path: StraightPath, rates: Mapping[str, float]) -> float:
    """Largest ṡ at which every task coordinate keeps its rate, 1/s."""
    way = np.abs(path.end - path.start)
    return min(
        (rate / way[TASK.index(name)] for name, rate in rates.items() if way[TASK.index(name)] > 0), default=UNLIMITED
    )


def _path_jerk(robot: Robot, path: StraightPath, s: Array) -> Array:
    """Largest s⃛ that the jerk limits of the joints allow at low speed, (n,)."""
    limit = np.array([UNLIMITED if joint.jerk is None else joint.jerk for joint in robot.joints])
    with np.errstate(divide="ignore"):
        return np.asarray((limit / np.abs(path.sample(s).dq)).min(axis=1))


SUBDIVISION = 4
"""Quintic pieces per element: the path between their ends is then followed to about 1e-9 rad."""


def joint_pieces(
    path: StraightPath, motion: PathMotion, subdivision: int = SUBDIVISION, end_speed: float = 0.0
) -> tuple[Array, Array]:
    """Quintic joint polynomials that follow the path: exact q, q̇, q̈ at both ends of every piece.

    end_speed: ṡ at the end, 1/s. Returns breaks (m + 1,) and coefficients (m, 6, 4).
    """
    elements = motion.elements
    share = np.arange(subdivision) / subdivision
    starts = np.concatenate([[0.0], np.cumsum(elements[:, 4])])
    breaks = np.append((starts[:-1, None] + elements[:, 4:] * share).ravel(), starts[-1])
    ends = [_joint_state(path, elements, share + offset, end_speed) for offset in (0.0, 1.0 / subdivision)]
    return breaks, hermite(breaks, ends[0], ends[1])


def _joint_state(path: StraightPath, elements: Array, share: Array, end_speed: float) -> tuple[Array, Array, Array]:
    """q, q̇, q̈ at the given shares of every element, (n · shares, 4) each."""
    s0, v0, a0, a1, h = (column[:, None] for column in elements.T)
    t = share * h
    rise = a1 - a0
    s = np.clip(s0 + t * (v0 + t * (a0 / 2 + share * rise / 6)), 0.0, 1.0).ravel()
    speed = (v0 + t * (a0 + share * rise / 2)).ravel()[:, None]
    acceleration = (a0 + share * rise).ravel()[:, None]
    if share[-1] == 1.0:  # without the solver's rounding
        s[-1], speed[-1] = 1.0, end_speed
    at = path.sample(s)
    return at.q, at.dq * speed, at.ddq * speed**2 + at.dq * acceleration
