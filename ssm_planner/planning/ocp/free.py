"""The optimal control problem of one free phase: the planner chooses the joint path through the points given.

Between two points every joint moves one way, so positions lie between the points' and the friction law enters exactly. A
joint that goes on in its direction passes a point at speed; one that turns back there, or stands on one side, is at rest.
Velocity, acceleration and jerk limits hold by construction; motor torque, tip speed, rates, roll and spin ranges and the eye
are path constraints, active as far as they come near their limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.kinematics.eye import retina_row
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints, task_of_joints
from ssm_planner.planning.ocp.constraints import (
    UNLIMITED,
    RowName,
    joint_limits,
    limits_jerk,
    tool_limits,
    tool_names,
    torque_names,
)
from ssm_planner.planning.ocp.element import shared
from ssm_planner.planning.ocp.mesh import (
    SegmentGuess,
    closed_form_guess,
    retimed_guess,
    sampled_guess,
)
from ssm_planner.planning.ocp.models import RATED, WATCHED, FreeElement
from ssm_planner.planning.ocp.nlp import (
    BoundaryConditions,
    Guess,
    Method,
    NlpData,
    NlpSolution,
    NlpStructure,
    PhaseSolution,
    blocks_of,
    cubics,
)
from ssm_planner.planning.ocp.refinement import SHORTEST, OcpProblem, optimise
from ssm_planner.planning.ocp.turning import TurningGuess, braking, turning_guess
from ssm_planner.planning.phases import joint_room
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.problem.limits import TASK, RetinaClearance, TaskRange, TaskRate
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory, hermite
from ssm_planner.typing import Array, Indices, Mask

ELEMENTS, ONE_TIME_ELEMENTS = 40, 96
"""Of a motion; of one with one time for all elements, for they cannot move to where they are needed."""
PASSING_ELEMENTS, JERK_FINER = 56, 1.35
"""Of one with a time for each way between two points; times as many where jerk is limited."""
MOVING_ELEMENTS, FINER_ELEMENTS = 80, 160
"""Of a motion that begins or ends at speed where jerk is limited, for the first acceleration has to end within an element;
and of one for which nothing is found on fewer."""
STRETCHED = 1.2
"""Times of such a guess, which then is off its bounds."""
SHORTEST_TURNING, SHORTEST_PASSING = 0.02, 0.01
"""Least time of a block where joints turn back, or points are passed, as a share of the guess's, which rests there."""
MOVES = 1e-9
"""A joint that has less than this to go (rad, m) stands."""
FAR, MORE = 2.0, 1.5
"""Where a row of the closed-form guess is larger than this, TOPP-RA makes the guess; and times as many elements, for less
is then known of where they are needed."""
RAMP = 5e-4
"""Share of the time between two points in which a joint without a jerk limit reaches its acceleration, beside one with."""
EDGE = 1e-9
"""A tip so near to the edge of an eye's port is on it, m."""
KINEMATIC = ("velocity", "acceleration", "jerk")
AT_LIMIT = 8e-7
"""Share by which rows may exceed their limit at an instant at which the motion begins or ends at speed."""
ANYWHERE = 1e3
"""Half width of a range that is not limited, rad."""


def solve_free(
    problem: Problem,
    mechanism: Mechanism,
    points: Array,
    *,
    strict: Robot | None = None,
    cooling: Array | None = None,
    duration: float | None = None,
    speeds: tuple[Array, Array] | None = None,
    count: int | None = None,
    method: Method = "Ipopt",
    pull: Array | None = None,
    loose: tuple[int, ...] = (),
    passing: Array | None = None,
    useless: float = np.inf,
    sketch: tuple[Trajectory, Array] | None = None,
    about: bool = False,
) -> PhaseSolution:
    """Motion through the joints `points` (k + 1, 4), by about `count` elements.

    strict, cooling, method: as for `solve_straight`. duration: asked for, s. speeds: q̇ (4,) at both ends, at rest by default.
    pull: q̈ (4,) at the start where jerk is limited, 0 by default. loose: which of the points, of a motion from rest to rest,
    only guess where joints turn back; they are optimised. passing: q̇ (k − 1, 4) at the points within, a guess that tells
    between which of them joints turn back. useless: s, and about: as for `optimise`. sketch: a motion to begin from, and when
    it passes the points, (k + 1,), s.
    """
    robot = problem.robot
    limits = joint_limits(strict or robot, cooling)
    if "depth" in problem.rates:  # the rate of joint 4 alone
        limits["velocity"][3] = min(limits["velocity"][3], problem.rates["depth"])
    way = np.diff(points, axis=0)
    way[np.abs(way) <= MOVES] = 0.0
    ends = speeds or (np.zeros(4), np.zeros(4))
    if limits_jerk(robot):
        limits["jerk"] = jerk_for_all(limits, way, ends)
    asked = _Asked(
        problem=problem,
        mechanism=mechanism,
        points=points,
        way=way,
        limits=limits,
        ends=ends,
        pull=np.zeros(4) if pull is None else pull,
        method=method,
        loose=loose,
        passing=passing,
        sketch=sketch,
    )
    finer = count is None and asked.is_confirmed_finer
    # where the closed form keeps every other limit it is the fastest, on any mesh
    if_exceeded = finer and duration is None and cooling is None and len(way) == 1
    each = asked.between(count or asked.count(finer=finer and not if_exceeded))
    segments = asked.segments(each)
    ocp = asked.on_mesh_of(segments)
    if if_exceeded and (ocp.way.ports or ocp.row_maxima(ocp.guess.elements).max(initial=0.0) > 1):
        each = asked.between(asked.count(finer=True))
        segments = asked.segments(each)
        ocp = asked.on_mesh_of(segments)
    if asked.rests_at_points and not ocp.row_maxima(ocp.guess.elements).max(initial=0.0) < FAR:
        lines = (PolylinePath(mechanism, points[k : k + 2]) for k in range(len(way)))
        ocp = asked.on_mesh_of(
            segments,
            [retimed_guess(robot, problem.task_limits, line, round(MORE * each)) for line in lines],
        )
    takes = None if duration is None else duration / ocp.time_scale
    guess = (
        ocp.guess.stretched(STRETCHED)
        if asked.has_one_time
        else replace(ocp.guess, near=sketch is not None)
    )
    return ocp.result(
        optimise(
            ocp, guess, problem.objective, takes, useless=useless / ocp.time_scale, about=about
        )
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Asked:
    """What is asked of a free motion, as for `solve_free`, and the meshes of it."""

    problem: Problem
    mechanism: Mechanism
    points: Array
    way: Array
    """From point to point, (k, 4)."""
    limits: dict[str, Array]
    """Of the joints."""
    ends: tuple[Array, Array]
    pull: Array
    method: Method
    loose: tuple[int, ...]
    passing: Array | None
    sketch: tuple[Trajectory, Array] | None

    @property
    def jerk(self) -> bool:
        """It is limited."""
        return limits_jerk(self.problem.robot)

    @property
    def at_rest(self) -> bool:
        """At both ends."""
        return not (self.ends[0].any() or self.ends[1].any())

    @property
    def rests_at_points(self) -> bool:
        """As far as the guess goes."""
        return self.at_rest and self.passing is None and self.sketch is None

    @property
    def has_one_time(self) -> bool:
        """For all elements; beside an eye they move to where the tool may turn to, with limited jerk to the ends of arcs."""
        alone = self.at_rest and len(self.way) == 1 and self.problem.eye is None
        return alone and self.method == "Ipopt" and not self.jerk

    @property
    def is_confirmed_finer(self) -> bool:
        """Ipopt confirms it on a finer mesh."""
        return self.method == "confirmed" and self.at_rest and not self.loose

    @property
    def is_structured(self) -> bool:
        """The structured solver tries: with a jerk limit it begins at q̈ = 0 alone."""
        return self.method == "sketched" or (self.method != "Ipopt" and not self.pull.any())

    @property
    def fewest(self) -> int:
        """Elements between two switching points."""
        return 2 if len(self.way) < 16 else 1

    def count(self, *, finer: bool) -> int:
        """Elements; finer: that Ipopt confirms."""
        if self.jerk and not self.at_rest:
            return MOVING_ELEMENTS
        if not finer:
            return ONE_TIME_ELEMENTS if self.has_one_time else ELEMENTS
        return round(
            (ONE_TIME_ELEMENTS if len(self.way) == 1 else PASSING_ELEMENTS)
            * (JERK_FINER if self.jerk else 1)
        )

    def between(self, count: int) -> int:
        """Of so many elements those between two points."""
        return max(2 * count // len(self.way), 8) if len(self.way) > 1 else count

    def segments(self, each: int) -> list[TurningGuess]:
        """The guess from point to point, about so many elements each."""
        way, jerk = self.way, self.jerk
        if self.sketch is not None:
            return _sketched_segments(*self.sketch, way, each * len(way), self.fewest)
        table = np.stack([self.limits[name] for name in KINEMATIC])
        within = (
            _passing_at_need(way, self.ends, table[1]) if self.passing is None else self.passing
        )
        speeds, pull = np.vstack([self.ends[0], within, self.ends[1]]), self.pull
        return [
            _segment(
                way[k],
                speeds[k : k + 2],
                table,
                each=each,
                fewest=self.fewest,
                jerk=jerk,
                pull=pull * (k == 0),
            )
            for k in range(len(way))
        ]

    def on_mesh_of(
        self, segments: list[TurningGuess], slower: list[SegmentGuess | None] | None = None
    ) -> FreeProblem:
        """The problem whose elements, and whose unit of time, are those of a guess; slower: others where there are any."""
        guesses = [guess for each in segments for guess in each.guesses]
        if slower is not None:
            guesses = [other or guess for other, guess in zip(slower, guesses, strict=True)]
        way = self._way(segments, guesses)
        guesses = list(way.guesses)
        sizes = tuple(sum(guess.arcs) for guess in guesses)
        moving = np.any(way.directions != 0, axis=0)
        arcs = [n for guess in guesses for n in guess.arcs]
        structure = NlpStructure(
            moves=tuple(tuple((d[moving] != 0).tolist()) for d in way.directions),
            segment_sizes=sizes,
            block_sizes=sizes
            if self.has_one_time or self._has_few_times(segments)
            else blocks_of(arcs),
            smooth=self.jerk,
            velocity_limits=True,
            joints=True,
        )
        lengths = np.concatenate([np.diff(guess.instants) for guess in guesses])
        times = np.bincount(structure.block, lengths)
        turning = SHORTEST_TURNING if self.loose else SHORTEST_PASSING
        return FreeProblem(
            structure=structure,
            fractions=lengths / times[structure.block],
            times=times / times.sum(),
            joint_limits=self.limits,
            time_scale=sum(guess.duration for guess in guesses),
            method=self.method if self.is_structured else "Ipopt",
            problem=self.problem,
            mechanism=self.mechanism,
            way=way,
            directions=way.directions,
            speeds=self.ends,
            pull=self.pull,
            starting=self.ends[0] == 0.0,
            shortest=SHORTEST if len(way.directions) == 1 else turning,
        )

    def _given(self, segments: list[TurningGuess]) -> Mask:
        """Which borders are no guess, (k + 1, 4)."""
        given = np.concatenate([segments[0].given[:1], *(each.given[1:] for each in segments)])
        for k in self.loose:  # a joint that stands on one side of it is where it stands
            given[k] = (self.way[k - 1] == 0) | (self.way[k] == 0)
        return given

    def _way(self, segments: list[TurningGuess], guesses: list[SegmentGuess]) -> Way:
        borders = [
            start + each.positions[1:] for start, each in zip(self.points, segments, strict=False)
        ]
        given, directions = (
            self._given(segments),
            np.concatenate([each.directions for each in segments]),
        )
        way = Way(np.concatenate([self.points[:1], *borders]), given, directions, tuple(guesses))
        if self.problem.eye is None:
            return way
        return way.cut_at(
            self.problem.eye.port, partial(_is_outside, self.problem, self.mechanism), self.fewest
        )

    def _has_few_times(self, segments: list[TurningGuess]) -> bool:
        """One for each segment, not for each arc: with these, joints that turn back switch where they are told."""
        if not self.is_structured or self.method == "sketched" or self.sketch is not None:
            return self.is_structured
        # with one time for each way jerk-limited motions are up to 0.13 % longer
        return bool(self._given(segments).all()) and not (self.jerk and len(self.way) > 1)


def _is_outside(problem: Problem, mechanism: Mechanism, q: Array) -> bool:
    """Whether the tip of joints (4,) is where the port alone allows it."""
    assert problem.eye is not None
    return bool(retina_row(NUMPY, problem.eye, tip_position(mechanism, q[None])[0]) > 0)


def _segment(
    way: Array, speeds: Array, table: Array, *, each: int, fewest: int, jerk: bool, pull: Array
) -> TurningGuess:
    """The guess over a way (4,) from q̇ to q̇ (2, 4); pull: q̈ where it begins."""
    begin, end = speeds
    if not speeds.any():
        guess = closed_form_guess(way, table, jerk, each, fewest)
        positions = np.stack([np.zeros(4), way])
        return TurningGuess((guess,), positions, np.ones((2, 4), dtype=bool), np.sign(way[None]))
    brake = table[1]
    if jerk:
        brake = np.minimum(braking(begin, pull, table), braking(end, np.zeros(4), table))
    limits = np.stack([table[0], table[1], brake])
    return turning_guess(way, (begin, end), limits, count=each, fewest=fewest)


def _sketched_segments(
    motion: Trajectory, instants: Array, way: Array, count: int, fewest: int
) -> list[TurningGuess]:
    """Guesses over ways (k, 4) by about `count` elements, from a motion that begins and ends them at these instants."""
    found = []
    for start, end, each in zip(instants[:-1], instants[1:], way, strict=True):
        n = max(2 * fewest, round(count * (end - start) / motion.duration))
        guess, signs = sampled_guess(motion, float(start), float(end), n), np.sign(each)
        speed = np.where(guess.states[1] * signs > 0, guess.states[1], 0.0)
        guess = replace(guess, states=(guess.states[0], speed, *guess.states[2:]))
        positions = np.stack([np.zeros(4), each])
        found.append(TurningGuess((guess,), positions, np.ones((2, 4), dtype=bool), signs[None]))
    return found


def _passing_at_need(way: Array, ends: tuple[Array, Array], acceleration: Array) -> Array:
    """q̇ (n − 1, 4) at the points between ways (n, 4): rest, but of a joint that cannot stop between a point and an end.

    It passes the point at the least speed, if it goes on beyond it in its direction.
    """
    found = np.zeros((len(way) - 1, 4))
    for speed, near, beyond, k in (
        ((ends[0], 0, 1, 0), (ends[1], -1, -2, -1)) if len(way) > 1 else ()
    ):
        goes_on = (way[near] * way[beyond] > 0) & (speed * way[near] > 0)
        square = np.where(goes_on, speed**2 - 2 * acceleration * np.abs(way[near]), 0.0)
        least = np.sign(speed) * np.sqrt(np.maximum(square, 0.0))
        found[k] = np.where(np.abs(least) > np.abs(found[k]), least, found[k])
    return found


def jerk_for_all(limits: dict[str, Array], way: Array, ends: tuple[Array, Array]) -> Array:
    """A jerk limit for every joint, (4,): where one has a jerk limit, no acceleration jumps.

    A joint without one reaches its acceleration in RAMP of the time that the quickest of the ways (k, 4) takes.
    """
    velocity, acceleration, jerk = (limits[name] for name in KINEMATIC)
    takes = np.abs(way) / velocity + 2 * np.sqrt(np.abs(way) / acceleration)
    takes[[0, -1]] += np.abs(ends) / acceleration
    ramp = RAMP * takes.max(axis=1).min()
    return np.where(jerk < UNLIMITED, jerk, acceleration / ramp)


@dataclass(frozen=True, eq=False)
class Way:
    """The k segments of a free motion, and its guess."""

    points: Array
    """Where they begin and end, (k + 1, 4)."""
    given: Mask
    """Which of these are no guess, (k + 1, 4)."""
    directions: Array
    """Of every joint in every segment, (k, 4)."""
    guesses: tuple[SegmentGuess, ...]
    ports: tuple[int, ...] = ()
    """Those of the points where the tip passes the port of an eye, at which joint 4 alone is given."""

    def cut_at(self, port: float, is_outside: Callable[[Array], bool], fewest: int) -> Way:
        """With a point more where joint 4 passes the port: only beyond it does the retina's row count.

        Where it begins or ends at the port's edge it stands there until the others have turned to where it may go on, in the
        guess as long as it then moves. is_outside: whether the retina's row forbids joints (4,).
        """
        points, given, ports = [self.points[0]], [self.given[0]], []
        directions: list[Array] = []
        guesses: list[SegmentGuess] = []
        for k, guess in enumerate(self.guesses):
            ends, sides = self.points[k : k + 2], np.tile(self.directions[k], (2, 1))
            beyond = np.abs(ends[:, 3]) - port
            near = int(beyond.argmin())
            at_edge = bool(abs(beyond[near]) <= EDGE)
            if beyond.max() > EDGE and (is_outside(ends[near]) if at_edge else beyond[near] < 0):
                sides[near, 3] *= not at_edge
                halves, place = guess.halves(
                    3, np.copysign(port, ends[1 - near, 3]) - ends[0, 3], fewest
                )
                ports.append(len(points))
                points.append(ends[0] + place)
                given.append((sides == 0).any(axis=0) | (np.arange(4) == 3))
                guesses += halves
                directions += [*sides]
            else:
                guesses.append(guess)
                directions.append(sides[0])
            points.append(ends[1])
            given.append(self.given[k + 1])
        return Way(
            np.array(points), np.array(given), np.array(directions), tuple(guesses), tuple(ports)
        )

    def within(self, port: float) -> Mask:
        """Segments in which the tip does not go beyond the port, (k,), wherever joints turn back."""
        depths = np.abs(self.points[:, 3])
        most, grows = np.where(self.given[:, 3], depths, np.inf), np.diff(depths)
        for k in [*range(len(grows)), *reversed(range(len(grows)))]:
            if grows[k] >= 0:
                most[k] = min(most[k : k + 2])
            if grows[k] <= 0:
                most[k + 1] = min(most[k : k + 2])
        return np.asarray(np.maximum(most[:-1], most[1:]) <= port + EDGE)


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeProblem(OcpProblem):
    """With k segments: between the points, and where joints turn back on their way."""

    problem: Problem
    mechanism: Mechanism
    way: Way
    speeds: tuple[Array, Array]
    """q̇ at both ends, (4,)."""
    pull: Array
    """q̈ at the start where jerk is limited, (4,)."""

    @cached_property
    def moving(self) -> Indices:
        """Joints whose positions are the coordinates, (m,)."""
        return np.flatnonzero(np.any(self.directions != 0, axis=0))

    @cached_property
    def unit(self) -> Array:
        """d: length of u = 1 by joint, (4,)."""
        return np.asarray(np.abs(np.diff(self.way.points, axis=0)).max(axis=0))

    @cached_property
    def room(self) -> Array:
        """Where joints may turn back, (2, 4)."""
        return joint_room(self.problem, self.mechanism, self.way.points[self.way.given.all(axis=1)])

    @property
    def boundary(self) -> BoundaryConditions:
        start, end = (self.scaled(speed, 1) for speed in self.speeds)
        points = self.scaled(
            np.where(self.way.given, self.way.points, np.nan) - self.way.points[0], 0
        )
        room = self.scaled(self.room - self.way.points[0], 0)
        pull = self.scaled(self.pull, 2)
        return BoundaryConditions(
            points, self.directions[:, self.moving], start, end, start_acceleration=pull, room=room
        )

    @property
    def limits(self) -> tuple[Array, Array, Array]:
        velocity, acceleration, jerk = (
            self.scaled(self.joint_limits[name], order) for order, name in enumerate(KINEMATIC, 1)
        )
        return velocity, acceleration, jerk

    @property
    def guess(self) -> Guess:
        """The guesses of all segments, one after the other."""
        states = []
        for guess, point in zip(self.way.guesses, self.way.points, strict=False):
            position, *rates = guess.states
            values = [position + point - self.way.points[0], *rates]
            scaled = [
                self.scaled(value, order) for value, order in zip(values, (0, 1, 2, 2), strict=True)
            ]
            states.append(np.hstack(scaled))
        lengths = self.times[self.structure.block] * self.fractions
        return Guess(np.column_stack([np.vstack(states), lengths]), self.times)

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """Where the motion begins or ends at speed, what is given there may be at a limit, up to rounding."""
        found = super().data(elements, backoff)
        bound = found.path_bound.copy()
        rows = backoff.shape[1]
        if self.speeds[0].any():
            bound[0, :rows] = np.where(np.isfinite(bound[0, :rows]), 1 + AT_LIMIT, np.inf)
        if self.speeds[1].any():
            bound[-1, -rows:] = np.where(np.isfinite(bound[-1, -rows:]), 1 + AT_LIMIT, np.inf)
        return replace(found, path_bound=bound)

    def scaled(self, values: Array, order: int) -> Array:
        """A derivative of q − q0 (…, 4) as that of u (…, m) by scaled time."""
        return (values * self.time_scale**order / np.where(self.unit > 0, self.unit, 1.0))[
            ..., self.moving
        ]

    @cached_property
    def complete_element(self) -> FreeElement:
        problem = self.problem
        rows: set[RowName] = {
            (TaskRange.name_of(name), None) for name in WATCHED if name in problem.ranges
        }
        rows |= {(TaskRate.name_of(name), None) for name in RATED if name in problem.rates}
        rows |= tool_names(problem.speeds, ())
        if problem.eye is not None:
            rows |= {(limit.name, None) for limit in problem.eye.limits}
        rows = rows.union(*(torque_names(problem.robot, int(i)) for i in self.moving))
        return shared(
            FreeElement(
                robot=problem.robot,
                mechanism=self.mechanism,
                moving=tuple(self.moving.tolist()),
                active=frozenset(rows),
                eye=problem.eye,
            )
        )

    @cached_property
    def idle(self) -> Mask:
        found = super().idle.copy()
        if self.problem.eye is not None:
            found[:, self.row_names.index((RetinaClearance.name, None))] = self.at_port(
                self.problem.eye.port
            )
        return found

    def at_port(self, port: float) -> Mask:
        """Elements in which the tip stays within the port, (n,)."""
        return self.way.within(port)[self.structure.segment]

    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        return self.sigma, self._parameters

    @cached_property
    def _parameters(self) -> Array:
        problem = self.problem
        ranges = np.array([problem.ranges.get(name, (-ANYWHERE, ANYWHERE)) for name in WATCHED])
        return FreeElement.layout.pack(
            q0=self.way.points[0],
            d=self.unit,
            **self.joint_limits,
            **tool_limits(problem.speeds),
            range_centre=ranges.mean(axis=1) + self._whole_turns,
            range_half_width=(ranges[:, 1] - ranges[:, 0]) / 2,
            rate=[problem.rates.get(name, UNLIMITED) for name in RATED],
            retina_easing=self._retina_easing,
            time_scale=self.time_scale,
        )

    @property
    def _whole_turns(self) -> Array:
        """From WATCHED at the first point to the values of the closed form, which rows use, there."""
        first = self.way.points[0]
        unwrapped = task_of_joints(NUMPY, self.mechanism, tuple(first))
        wrapped = task_from_joints(self.mechanism, first[None])
        return np.array([float(unwrapped[k]) - wrapped[0, k] for k in map(TASK.index, WATCHED)])

    @property
    def _retina_easing(self) -> float:
        """By how much the retina's row forbids one of the points, which the tolerance of its limit allows."""
        if self.problem.eye is None:
            return 0.0
        in_eye = np.abs(self.way.points[:, 3]) > self.problem.eye.port + EDGE
        points = self.way.points[self.way.given.all(axis=1) & in_eye]
        rows = retina_row(NUMPY, self.problem.eye, tip_position(self.mechanism, points).T)
        return float(rows.max(initial=0.0))

    def result(self, solution: NlpSolution) -> PhaseSolution:
        """The solution as joint polynomials; neighbours share position and velocity to the last digit."""
        if not solution.solved:
            return PhaseSolution(
                solution.status, solution.message, solution.iterations, solver=solution.solver
            )
        n = len(solution.elements)
        pieces, boundary = cubics(solution.elements), self.boundary

        def joints(values: Array, order: int) -> Array:
            full = np.zeros((n, 4))
            full[:, self.moving] = values * self.unit[self.moving] / self.time_scale**order
            return full + (self.way.points[0] if order == 0 else 0.0)

        breaks = np.concatenate([[0.0], np.cumsum(solution.elements[:, -1] * self.time_scale)])
        after = (
            np.vstack([pieces.u[1:], boundary.points[-1]]),
            np.vstack([pieces.v[1:], boundary.end_velocity]),
        )
        coefficients = hermite(
            breaks,
            (joints(pieces.u, 0), joints(pieces.v, 1), joints(pieces.a0, 2)),
            (joints(after[0], 0), joints(after[1], 1), joints(pieces.a1, 2)),
        )
        kept = [k for k in range(len(self.way.points)) if k not in self.way.ports]
        borders = breaks[[*solution.structure.borders, n]][kept]
        directions = np.sign(np.add.reduceat(self.directions, kept[:-1]))
        rest = solution.rest
        return PhaseSolution(
            "solved",
            solution.message,
            solution.iterations,
            breaks,
            coefficients,
            solver=solution.solver,
            borders=borders,
            directions=directions,
            confirmation=solution.confirmation,
            rest=None if rest is None else lambda: self.result(rest()),
        )
