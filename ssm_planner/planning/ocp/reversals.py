"""Sketch of a free motion from rest to rest whose joints may move either way, anywhere: it tells where they turn back.

Friction needs directions. Every round has those of the round before, by element, and lets the joints move against them; the
first round has those of a motion that is known. Where no direction changes any more, friction is that of the motion found.
What joints need to break away where they turn back is left out, and limits hold at a few instants of long elements: a sketch
gives the order in which joints turn back, a guess, and about how much time that saves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.ocp.constraints import joint_limits, limits_jerk
from ssm_planner.planning.ocp.free import EDGE, MOVES, FreeProblem, Way, jerk_for_all
from ssm_planner.planning.ocp.mesh import sampled_guess
from ssm_planner.planning.ocp.natively import compiled
from ssm_planner.planning.ocp.nlp import (
    InitialPoint,
    NlpData,
    NlpSolution,
    NlpStructure,
    PhaseSolution,
    cubics,
)
from ssm_planner.planning.ocp.refinement import NEAR, SHORTEST, chosen_rows
from ssm_planner.planning.ocp.structured import solve_structured
from ssm_planner.planning.phases import joint_room
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask

ELEMENTS, ROUNDS, ITERATIONS = 80, 6, 120
"""Of a sketch; rounds at most, and iterations in each."""
ROUGH = 1e-6
"""Tolerance of its solver."""
EXCEEDED = 1.005
"""A row larger than this becomes active."""
LOOKS = 400
"""Instants at which a sketch is looked at for joints that turn back."""
GAP = 4e-3
"""Least share of the duration between joints that turn back, and from the ends."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _EitherWay(FreeProblem):
    """One segment; `sense`: the direction that friction has, of every joint in every element, (n, 4)."""

    sense: Array
    depths: Array
    """Of the tip at the ends of the elements in the round before, (n + 1,): what was within the port stays there."""

    def at_port(self, port: float) -> Mask:
        return np.asarray(np.maximum(self.depths[:-1], self.depths[1:]) <= port + EDGE)

    def data(self, elements: Array, backoff: Array) -> NlpData:
        found, eye = super().data(elements, backoff), self.problem.eye
        if eye is None or 3 not in self.moving:
            return found
        column, within = list(self.moving).index(3), self.at_port(eye.port)
        held = within | np.append(False, within[:-1])
        edges = self.scaled(np.array([[-eye.port], [eye.port]]) - self.way.points[0], 0)[:, column]
        lower, upper = found.lower.copy(), found.upper.copy()
        lower[held, column] = np.maximum(lower[held, column], edges[0])
        upper[held, column] = np.minimum(upper[held, column], edges[1])
        return replace(found, lower=lower, upper=upper)

    @property
    def sigma(self) -> Array:
        return self.sense

    @property
    def unit(self) -> Array:
        return self.joint_limits["velocity"] * self.time_scale


def sketched(
    problem: Problem, mechanism: Mechanism, points: Array, motion: PhaseSolution, strict: Robot
) -> Trajectory | None:
    """About the fastest motion between two points (2, 4), near one that is known.

    None where none is found, and where nothing is compiled.

    strict: as for `solve_free`.
    """
    if compiled() is None:
        return None
    robot, n = problem.robot, ELEMENTS
    limits, scale = joint_limits(strict), motion.duration
    if "depth" in problem.rates:
        limits["velocity"][3] = min(limits["velocity"][3], problem.rates["depth"])
    if limits_jerk(robot):
        limits["jerk"] = jerk_for_all(limits, np.diff(points, axis=0), (np.zeros(4), np.zeros(4)))
    known = Trajectory(motion.breaks, motion.coefficients, ())
    guess = sampled_guess(known, 0.0, scale, n)
    middle = known.sample((guess.instants[1:] + guess.instants[:-1]) / 2).qd
    low, high = joint_room(problem, mechanism, points)
    directions = np.where(high - low > MOVES, np.nan, 0.0)[None]
    ocp = _EitherWay(
        structure=NlpStructure(
            moves=((True,) * int(np.count_nonzero(directions)),),
            segment_sizes=(n,),
            block_sizes=(n,),
            smooth=limits_jerk(robot),
            velocity_limits=True,
            joints=True,
        ),
        fractions=np.full(n, 1 / n),
        times=np.ones(1),
        joint_limits=limits,
        time_scale=scale,
        method="sketched",
        directions=directions,
        problem=problem,
        mechanism=mechanism,
        way=Way(points, np.ones((2, 4), dtype=bool), directions, (guess,)),
        speeds=(np.zeros(4), np.zeros(4)),
        pull=np.zeros(4),
        starting=np.zeros(4, dtype=bool),
        shortest=SHORTEST,
        sense=np.sign(middle),
        depths=np.abs(known.sample(guess.instants).q[:, 3]),
    )
    found = _settled(ocp)
    return None if found is None else Trajectory(found.breaks, found.coefficients, ())


def _settled(ocp: _EitherWay) -> PhaseSolution | None:
    """The motion in which friction has the directions of the joints."""
    elements, start = ocp.guess.elements, ocp.guess.point
    active = chosen_rows(ocp.row_names, ocp.row_maxima(elements), NEAR)
    for _ in range(ROUNDS):
        element = ocp.element(active, "time")
        backoff = np.where(ocp.idle, -np.inf, 0.0)[:, [name in active for name in ocp.row_names]]
        data = ocp.data(elements, backoff)
        found = solve_structured(
            ocp.structure, element, data, start, iterations=ITERATIONS, tolerance=ROUGH
        )
        if not found.solved:
            return None
        motion, before = ocp.result(found), ocp.sense
        depths = np.abs(
            Trajectory(motion.breaks, motion.coefficients, ()).sample(motion.breaks).q[:, 3]
        )
        ocp = replace(ocp, sense=_sense(ocp, found), depths=depths)
        elements = found.elements
        missed = chosen_rows(ocp.row_names, ocp.row_maxima(elements), EXCEEDED) - active
        if not missed and np.array_equal(ocp.sense, before):
            break
        start = InitialPoint(found.point.x) if missed else found.point
        active |= missed
    return ocp.result(found)


def _sense(ocp: _EitherWay, found: NlpSolution) -> Array:
    """Directions in the middle of the elements, (n, 4)."""
    pieces = cubics(found.elements)
    signs = np.zeros((ELEMENTS, 4))
    signs[:, ocp.moving] = np.sign(pieces.at(np.full((ELEMENTS, 1), 0.5))[1])
    return signs


def reversals(motion: Trajectory, least: Array) -> Array:
    """When joints turn back that go on by `least` (4,) before and after, s, ascending; close ones at once."""
    t = np.linspace(0.0, motion.duration, LOOKS + 1)
    q, gap = motion.sample(t).q, GAP * motion.duration
    turns = np.sort(np.concatenate([t[_extremes(q[:, i], float(least[i]))] for i in range(4)]))
    turns = turns[(turns > gap) & (turns < motion.duration - gap)]
    groups = np.split(turns, np.flatnonzero(np.diff(turns) >= gap) + 1)
    return np.array([group.mean() for group in groups if len(group)])


def _extremes(values: Array, least: float) -> list[int]:
    """Where values (n,) turn back, by so much at least before and after."""
    found: list[int] = []
    low = high = direction = 0
    for k in range(len(values)):
        low, high = (
            (k if values[k] < values[low] else low),
            (k if values[k] > values[high] else high),
        )
        if direction >= 0 and values[high] - values[k] >= least:
            found += [high] if direction else []
            direction, low = -1, k
        elif direction <= 0 and values[k] - values[low] >= least:
            found += [low] if direction else []
            direction, high = 1, k
    return found
