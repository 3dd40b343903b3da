"""Optimal control problem of a free phase: the solver chooses the joint path.

Every joint moves in one direction between two points. Positions thus lie between those of the
points, and the friction law is exact. A joint that continues in its direction passes a point at
speed. A joint that reverses at a point, or rests on one side of it, is at rest there. Limits of
velocity, acceleration and jerk hold by construction. Motor torque, tip speed, rates, ranges of roll
and spin, and the eye are path constraints, which are active where they come near their limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.elements.element import shared
from ssm_planner.elements.free_element import RATED, WATCHED, FreeElement
from ssm_planner.elements.rows import (
    UNLIMITED,
    RowName,
    joint_limits,
    limits_jerk,
    tool_limits,
    tool_names,
    torque_names,
)
from ssm_planner.kinematics import (
    Mechanism,
    retina_row,
    task_from_joints,
    task_of_joints,
    tip_position,
)
from ssm_planner.planning.ocp.mesh import (
    SegmentGuess,
    closed_form_guess,
    retimed_guess,
    sampled_guess,
)
from ssm_planner.planning.ocp.nlp import (
    BoundaryConditions,
    DirectionMultipliers,
    Guess,
    Method,
    Multipliers,
    NlpData,
    NlpSolution,
    NlpStructure,
    PhaseSolution,
    Reversals,
    blocks_of,
    cubics,
)
from ssm_planner.planning.ocp.reduced_costs import constraint_gradient, steepest_descent
from ssm_planner.planning.ocp.refinement import SHORTEST, OcpProblem, optimise
from ssm_planner.planning.ocp.structured import SLOWER
from ssm_planner.planning.ocp.turning import TurningGuess, braking, turning_guess
from ssm_planner.planning.phases import reversal_ranges
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.problem import TASK, Problem, RetinaClearance, Robot, TaskRange, TaskRate
from ssm_planner.trajectory import Trajectory, hermite
from ssm_planner.typing import Array, Indices, Mask, keyword_record, record

ELEMENTS, ONE_TIME_ELEMENTS = 40, 96
"""Number of elements of a motion, and of one in which all elements share one time.

The latter need more, because they cannot move to where they are needed.
"""
PASSING_ELEMENTS = 56
"""Number of elements with one time per segment through points."""
MOVING_ELEMENTS = 80
"""Number of elements of a jerk-limited motion that begins or ends at speed.

The mesh must be fine, because the initial acceleration has to end within one element.
"""
SHORTEST_TURNING, SHORTEST_PASSING = 0.02, 0.01
"""Smallest time of a block, as a share of the guess's, with free borders, and through points.

The guess rests at these points, so its times are long.
"""
FAR, MORE = 2.0, 1.5
"""Row value of the closed-form guess above which TOPP-RA makes the guess, and factor on its number
of elements.

The best distribution of elements is uncertain in that case.
"""
RAMP = 5e-4
"""Share of the time between two points in which a joint without a jerk limit reaches its
acceleration.

It applies if another joint has a jerk limit.
"""
KINEMATIC = ("velocity", "acceleration", "jerk")
AT_LIMIT = 8e-7
"""Share by which rows may exceed their limit at an end at which the motion has a given velocity."""
LEAST_UNIT = 0.05
"""Smallest unit of a joint that may reverse, as a share of its way at full velocity."""


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
    start_acceleration: Array | None = None,
    reversals: Reversals | None = None,
    cutoff: float = np.inf,
    finish: bool = True,
) -> PhaseSolution:
    """Return a motion through the joints `points` (k + 1, 4).

    Parameters
    ----------
    problem : Problem
        The problem with its objective and limits.
    mechanism : Mechanism
        Geometry of the robot.
    points : (k + 1, 4) array
        Joints at both ends and at the via points.
    strict : Robot or None
        The robot with tighter limits, which the motion must keep.
    cooling : (4,) array or None
        Weights of the motors' heat relative to time.
    duration : float or None
        Requested duration, s.
    speeds : ((4,), (4,)) arrays or None
        q̇ at both ends. None: at rest.
    count : int or None
        Approximate number of elements. None: chosen by the kind of motion.
    method : str
        Solution method, see `nlp.Method`.
    start_acceleration : (4,) array or None
        q̈ at the start if jerk is limited. None: 0.
    reversals : Reversals or None
        Borders at which joints reverse. They replace the points.
    cutoff : float
        Duration in s beyond which a motion is not refined any further.
    finish : bool
        False: only return the fastest motion, as in `refinement.optimise`.

    Returns
    -------
    PhaseSolution
        Joint polynomials, or the status of the failure.
    """
    reversals = reversals or Reversals(points)
    displacements = np.diff(reversals.points, axis=0)
    displacements[np.abs(displacements) <= ROUNDING] = 0.0
    ends = speeds or (np.zeros(4), np.zeros(4))
    request = _FreeRequest(
        problem=problem,
        mechanism=mechanism,
        points=reversals.points,
        displacements=displacements,
        limits=_limits(
            problem, joint_limits(strict or problem.robot, cooling), displacements, ends
        ),
        ends=ends,
        start_acceleration=np.zeros(4) if start_acceleration is None else start_acceleration,
        method=method,
        reversals=reversals,
    )
    ocp = request.with_guess(count, time_only=duration is None and cooling is None)
    takes = None if duration is None else duration / ocp.time_scale
    guess = ocp.guess.stretched(SLOWER) if request.has_one_time else ocp.guess
    return ocp.result(
        optimise(
            ocp,
            guess,
            problem.objective,
            takes,
            cutoff=cutoff / ocp.time_scale,
            finish=finish,
        )
    )


def _limits(
    problem: Problem,
    limits: dict[str, Array],
    displacements: Array,
    ends: tuple[Array, Array],
) -> dict[str, Array]:
    """Return the limits of the joints with the rate of depth, and with jerk limits for all."""
    limits = dict(limits)
    if "depth" in problem.rates:  # The rate of depth is the velocity of joint 4.
        limits["velocity"][3] = min(limits["velocity"][3], problem.rates["depth"])
    if limits_jerk(problem.robot):
        limits["jerk"] = jerk_for_all(limits, displacements, ends)
    return limits


@keyword_record
class _FreeRequest:
    """Request for a free motion, as in `solve_free`, and the meshes for it."""

    problem: Problem
    mechanism: Mechanism
    points: Array
    displacements: Array
    """Displacements from point to point, (k, 4)."""
    limits: dict[str, Array]
    """Limits of the joints, by the names in LIMITS."""
    ends: tuple[Array, Array]
    start_acceleration: Array
    method: Method
    reversals: Reversals

    @property
    def jerk(self) -> bool:
        """True if jerk is limited."""
        return limits_jerk(self.problem.robot)

    @property
    def at_rest(self) -> bool:
        """True if the joints are at rest at both ends."""
        return not (self.ends[0].any() or self.ends[1].any())

    @property
    def rests_at_points(self) -> bool:
        """True if the guess rests at all points."""
        return self.at_rest and self.reversals.via_velocity is None and self.reversals.guess is None

    @property
    def has_one_time(self) -> bool:
        """True if all elements share one time.

        Beside an eye, elements move to where the tool may turn, and with limited jerk to the ends
        of arcs.
        """
        alone = self.at_rest and len(self.displacements) == 1 and self.problem.eye is None
        return alone and self.method == "Ipopt" and not self.jerk

    @property
    def is_confirmed_finer(self) -> bool:
        """True if Ipopt confirms the motion on a finer mesh."""
        return self.method == "confirmed" and self.at_rest and not self.reversals.free

    @property
    def is_structured(self) -> bool:
        """True if the structured solver is tried.

        With a jerk limit it can only begin at q̈ = 0.
        """
        return self.method == "estimated" or (
            self.method != "Ipopt" and not self.start_acceleration.any()
        )

    @property
    def least_count(self) -> int:
        """Smallest number of elements between two switching points."""
        return 2 if len(self.displacements) < 16 else 1

    def count(self, *, finer: bool) -> int:
        """Return the number of elements. `finer` selects that of motions which Ipopt confirms."""
        if self.jerk and not self.at_rest:
            return MOVING_ELEMENTS
        if not finer:
            return ONE_TIME_ELEMENTS if self.has_one_time else ELEMENTS
        return ONE_TIME_ELEMENTS if len(self.displacements) == 1 else PASSING_ELEMENTS

    def elements_per_segment(self, count: int) -> int:
        """Return the number of elements between two points, of `count` elements in all."""
        return (
            max(2 * count // len(self.displacements), 8) if len(self.displacements) > 1 else count
        )

    def segments(self, per_segment: int) -> list[TurningGuess]:
        """Return the guesses from point to point, with about `per_segment` elements each."""
        displacements, jerk = self.displacements, self.jerk
        if self.reversals.guess is not None and self.reversals.directions is not None:
            return _sampled_segments(
                *self.reversals.guess,
                displacements,
                self.reversals.directions,
                count=per_segment * len(displacements),
                least_count=self.least_count,
            )
        table = np.stack([self.limits[name] for name in KINEMATIC])
        within = self.reversals.via_velocity
        if within is None:
            within = np.zeros((len(displacements) - 1, 4))
        speeds = np.vstack([self.ends[0], within, self.ends[1]])
        start_acceleration = self.start_acceleration
        return [
            _segment(
                displacements[k],
                speeds[k : k + 2],
                table,
                per_segment=per_segment,
                least_count=self.least_count,
                jerk=jerk,
                start_acceleration=start_acceleration * (k == 0),
            )
            for k in range(len(displacements))
        ]

    def with_guess(self, count: int | None, *, time_only: bool) -> FreeProblem:
        """Return the problem with its guess, on `count` elements or on a suitable number.

        `time_only` tells that the fastest motion is sought.
        """
        finer = count is None and self.is_confirmed_finer
        # If the closed form keeps all other limits, it is the fastest motion on any mesh, so a
        # coarse mesh suffices.
        coarse_first = finer and time_only and len(self.displacements) == 1
        per_segment = self.elements_per_segment(
            count or self.count(finer=finer and not coarse_first)
        )
        segments = self.segments(per_segment)
        ocp = self.on_mesh_of(segments)
        largest_row = ocp.row_maxima(ocp.guess.elements).max(initial=0.0)
        if coarse_first and (ocp.chain.ports or largest_row > 1):
            return self.with_guess(self.count(finer=True), time_only=time_only)
        if not self.rests_at_points or largest_row < FAR:
            return ocp
        return self.on_mesh_of(segments, self._retimed_guesses(round(MORE * per_segment)))

    def _retimed_guesses(self, count: int) -> list[SegmentGuess | None]:
        """Return TOPP-RA's motions from point to point, with `count` elements each."""
        lines = (PolylinePath(self.mechanism, np.stack(ends)) for ends in pairwise(self.points))
        limits = self.problem.task_limits
        return [retimed_guess(self.problem.robot, limits, line, count) for line in lines]

    def on_mesh_of(
        self, segments: list[TurningGuess], replacements: list[SegmentGuess | None] | None = None
    ) -> FreeProblem:
        """Build the problem on the mesh of a guess, with the guess's duration as the unit of time.

        `replacements` are guesses that replace those of the segments. None keeps a segment's own
        guess.
        """
        guesses = [guess for segment in segments for guess in segment.guesses]
        if replacements is not None:
            guesses = [
                replacement or guess
                for replacement, guess in zip(replacements, guesses, strict=True)
            ]
        chain = self._segment_chain(segments, guesses)
        few_times = self.has_one_time or self._has_few_times(segments)
        structure = chain.structure(few_times=few_times, smooth=self.jerk)
        lengths = np.concatenate([np.diff(guess.instants) for guess in chain.guesses])
        times = np.bincount(structure.block, lengths)
        return FreeProblem(
            structure=structure,
            fractions=lengths / times[structure.block],
            times=times / times.sum(),
            joint_limits=self.limits,
            time_scale=sum(guess.duration for guess in chain.guesses),
            method=self.method if self.is_structured else "Ipopt",
            problem=self.problem,
            mechanism=self.mechanism,
            chain=chain,
            directions=chain.directions,
            speeds=self.ends,
            start_acceleration=self.start_acceleration,
            starting=self.ends[0] == 0.0,
            shortest=self._shortest(len(chain.directions)),
            alone=self.is_structured and self.reversals.guess is not None,
        )

    def _shortest(self, segments: int) -> float:
        """Return the smallest time of a block, as a share of the guess's."""
        if segments == 1:
            return SHORTEST
        return SHORTEST_TURNING if self.reversals.free else SHORTEST_PASSING

    def _fixed_positions(self, segments: list[TurningGuess]) -> Mask:
        """Return which positions at borders are fixed, (k + 1, 4)."""
        fixed = np.concatenate(
            [segments[0].fixed[:1], *(segment.fixed[1:] for segment in segments)]
        )
        # A joint that rests on one side of a border stays where it is.
        for k in self.reversals.free:
            signs = (
                self.displacements
                if self.reversals.directions is None
                else self.reversals.directions
            )
            fixed[k] = (signs[k - 1] == 0) | (signs[k] == 0)
        return fixed

    def _segment_chain(
        self, segments: list[TurningGuess], guesses: list[SegmentGuess]
    ) -> SegmentChain:
        """Return the segments with their borders, also where the tip passes an eye's port."""
        borders = [
            start + segment.positions[1:]
            for start, segment in zip(self.points, segments, strict=False)
        ]
        fixed = self._fixed_positions(segments)
        directions = np.concatenate([segment.directions for segment in segments])
        chain = SegmentChain(
            np.concatenate([self.points[:1], *borders]), fixed, directions, tuple(guesses)
        )
        if self.problem.eye is None:
            return chain
        return chain.cut_at(
            self.problem.eye.port,
            partial(_is_outside, self.problem, self.mechanism),
            self.least_count,
        )

    def _has_few_times(self, segments: list[TurningGuess]) -> bool:
        """Return True if each segment, instead of each arc, has one time.

        Joints that reverse then switch where the guess does.
        """
        if not self.is_structured or self.method == "estimated" or self.reversals.guess is not None:
            return self.is_structured
        # With one time for each segment, jerk-limited motions are up to 0.13 % longer.
        return bool(self._fixed_positions(segments).all()) and not (
            self.jerk and len(self.displacements) > 1
        )


def _is_outside(problem: Problem, mechanism: Mechanism, q: Array) -> bool:
    """Return True if only the port allows the tip of joints (4,) to be where it is."""
    assert problem.eye is not None
    return bool(retina_row(NUMPY, problem.eye, tip_position(mechanism, q[None])[0]) > 0)


def _segment(
    displacement: Array,
    speeds: Array,
    table: Array,
    *,
    per_segment: int,
    least_count: int,
    jerk: bool,
    start_acceleration: Array,
) -> TurningGuess:
    """Return the guess over a displacement (4,) between velocities (2, 4).

    `start_acceleration` (4,) is q̈ at its start.
    """
    start, end = speeds
    if not speeds.any():
        guess = closed_form_guess(displacement, table, jerk, per_segment, least_count)
        positions = np.stack([np.zeros(4), displacement])
        return TurningGuess(
            (guess,), positions, np.ones((2, 4), dtype=bool), np.sign(displacement[None])
        )
    brake = table[1]
    if jerk:
        brake = np.minimum(
            braking(start, start_acceleration, table), braking(end, np.zeros(4), table)
        )
    limits = np.stack([table[0], table[1], brake])
    return turning_guess(
        displacement, (start, end), limits, count=per_segment, least_count=least_count
    )


def _sampled_segments(
    motion: Trajectory,
    instants: Array,
    displacements: Array,
    directions: Array,
    *,
    count: int,
    least_count: int,
) -> list[TurningGuess]:
    """Return guesses for displacements (k, 4) by about `count` elements, sampled from a motion.

    `instants` (k + 1,) are the borders of the motion, s.
    """
    segments = []
    for start, end, displacement, signs in zip(
        instants[:-1], instants[1:], displacements, directions, strict=True
    ):
        n = max(2 * least_count, round(count * (end - start) / motion.duration))
        guess = sampled_guess(motion, float(start), float(end), n)
        speed = np.where(guess.states[1] * signs > 0, guess.states[1], 0.0)
        guess = replace(guess, states=(guess.states[0], speed, *guess.states[2:]))
        positions = np.stack([np.zeros(4), displacement])
        segments.append(TurningGuess((guess,), positions, np.ones((2, 4), dtype=bool), signs[None]))
    return segments


def jerk_for_all(
    limits: dict[str, Array], displacements: Array, ends: tuple[Array, Array]
) -> Array:
    """Return a jerk limit for every joint, (4,), if one joint has a limit.

    A joint without a limit reaches its acceleration in a share RAMP of the time of the quickest
    displacement (k, 4).
    """
    velocity, acceleration, jerk = (limits[name] for name in KINEMATIC)
    takes = np.abs(displacements) / velocity + 2 * np.sqrt(np.abs(displacements) / acceleration)
    takes[[0, -1]] += np.abs(ends) / acceleration
    ramp = RAMP * takes.max(axis=1).min()
    return np.where(jerk < UNLIMITED, jerk, acceleration / ramp)


@record
class SegmentChain:
    """The k segments of a free motion, and its guess."""

    points: Array
    """Joints at the borders, (k + 1, 4)."""
    fixed: Mask
    """True where these are fixed, (k + 1, 4)."""
    directions: Array
    """Direction of every joint in every segment, (k, 4)."""
    guesses: tuple[SegmentGuess, ...]
    ports: tuple[int, ...] = ()
    """Borders at which the tip passes the port of an eye. Joint 4 alone is fixed there."""

    def structure(self, *, few_times: bool, smooth: bool) -> NlpStructure:
        """Return the structure of the program. With `few_times`, each segment has one time."""
        sizes = tuple(sum(guess.arcs) for guess in self.guesses)
        arcs = [n for guess in self.guesses for n in guess.arcs]
        moves = self.directions[:, np.any(self.directions != 0, axis=0)] != 0
        return NlpStructure(
            moves=tuple(map(tuple, moves.tolist())),
            segment_sizes=sizes,
            block_sizes=sizes if few_times else blocks_of(arcs),
            smooth=smooth,
            velocity_limits=True,
            joints=True,
        )

    def cut_at(
        self, port: float, is_outside: Callable[[Array], bool], least_count: int
    ) -> SegmentChain:
        """Insert a border where joint 4 passes the port. The retina's row only holds beyond it.

        If a segment begins or ends at the edge of the port, joint 4 stands there until the others
        allow it to move on. In the guess it stands as long as it then moves. `is_outside` tells
        whether the retina's row forbids joints (4,).
        """
        points, fixed, ports = [self.points[0]], [self.fixed[0]], []
        directions: list[Array] = []
        guesses: list[SegmentGuess] = []
        for k, guess in enumerate(self.guesses):
            ends = self.points[k : k + 2]
            sides = np.tile(self.directions[k], (2, 1))
            beyond = np.abs(ends[:, 3]) - port
            inner = int(beyond.argmin())
            at_edge = bool(abs(beyond[inner]) <= ROUNDING)
            if beyond.max() > ROUNDING and (
                is_outside(ends[inner]) if at_edge else beyond[inner] < 0
            ):
                sides[inner, 3] *= not at_edge
                halves, position = guess.halves(
                    3, np.copysign(port, ends[1 - inner, 3]) - ends[0, 3], least_count
                )
                ports.append(len(points))
                points.append(ends[0] + position)
                fixed.append((sides == 0).any(axis=0) | (np.arange(4) == 3))
                guesses += halves
                directions += [*sides]
            else:
                guesses.append(guess)
                directions.append(sides[0])
            points.append(ends[1])
            fixed.append(self.fixed[k + 1])
        return SegmentChain(
            np.array(points), np.array(fixed), np.array(directions), tuple(guesses), tuple(ports)
        )

    def within(self, port: float) -> Mask:
        """Return the segments (k,) in which the depth of the tip is at most `port`, m.

        The depth of a point that is not fixed is unknown. Within a segment, the depth only grows or
        only shrinks. A point is therefore at most as deep as its neighbour if the depth grows
        towards the neighbour. Two passes, forwards and backwards, carry the depths of the fixed
        points to all others.
        """
        depths = np.abs(self.points[:, 3])
        upper = np.where(self.fixed[:, 3], depths, np.inf)
        grows = np.diff(depths)
        for k in [*range(len(grows)), *reversed(range(len(grows)))]:
            if grows[k] >= 0:
                upper[k] = min(upper[k : k + 2])
            if grows[k] <= 0:
                upper[k + 1] = min(upper[k : k + 2])
        return np.asarray(np.maximum(upper[:-1], upper[1:]) <= port + ROUNDING)


@keyword_record
class FreeProblem(OcpProblem):
    """Problem with k segments between points, reversals, and passages of the port."""

    problem: Problem
    mechanism: Mechanism
    chain: SegmentChain
    speeds: tuple[Array, Array]
    """q̇ at both ends, (4,) each."""
    start_acceleration: Array
    """q̈ at the start if jerk is limited, (4,)."""

    @cached_property
    def moving(self) -> Indices:
        """Indices of the joints that are coordinates, (m,)."""
        return np.flatnonzero(np.any(self.directions != 0, axis=0))

    @cached_property
    def unit(self) -> Array:
        """Length d of u = 1 for each joint, (4,)."""
        extent = np.abs(np.diff(self.chain.points, axis=0)).max(axis=0)
        if self.chain.fixed.all():
            return np.asarray(extent)
        return np.maximum(extent, LEAST_UNIT * self.joint_limits["velocity"] * self.time_scale)

    @cached_property
    def ranges(self) -> Array:
        """Ranges in which joints may reverse, (2, 4)."""
        return reversal_ranges(
            self.problem, self.mechanism, self.chain.points[self.chain.fixed.all(axis=1)]
        )

    @property
    def boundary(self) -> BoundaryConditions:
        """Boundary conditions in scaled coordinates and time."""
        start, end = (self.scaled(speed, 1) for speed in self.speeds)
        points = self.scaled(
            np.where(self.chain.fixed, self.chain.points, np.nan) - self.chain.points[0], 0
        )
        ranges = self.scaled(self.ranges - self.chain.points[0], 0)
        start_acceleration = self.scaled(self.start_acceleration, 2)
        return BoundaryConditions(
            points,
            self.directions[:, self.moving],
            start,
            end,
            start_acceleration=start_acceleration,
            ranges=ranges,
        )

    @property
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of u̇, ü and u⃛ in scaled time, (m,) each."""
        velocity, acceleration, jerk = (
            self.scaled(self.joint_limits[name], order) for order, name in enumerate(KINEMATIC, 1)
        )
        return velocity, acceleration, jerk

    @property
    def guess(self) -> Guess:
        """Guesses of all segments, one after the other."""
        states = []
        for guess, point in zip(self.chain.guesses, self.chain.points, strict=False):
            position, *rates = guess.states
            values = [position + point - self.chain.points[0], *rates]
            scaled = [
                self.scaled(value, order) for value, order in zip(values, (0, 1, 2, 2), strict=True)
            ]
            states.append(np.hstack(scaled))
        lengths = self.times[self.structure.block] * self.fractions
        return Guess(np.column_stack([np.vstack(states), lengths]), self.times)

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """Return parameters and bounds of the program.

        At an end with a given velocity, rows may be at their limit up to rounding.
        """
        base = super().data(elements, backoff)
        bound = base.path_bound.copy()
        rows = backoff.shape[1]
        if self.speeds[0].any():
            bound[0, :rows] = np.where(np.isfinite(bound[0, :rows]), 1 + AT_LIMIT, np.inf)
        if self.speeds[1].any():
            bound[-1, -rows:] = np.where(np.isfinite(bound[-1, -rows:]), 1 + AT_LIMIT, np.inf)
        return replace(base, path_bound=bound)

    def scaled(self, values: Array, order: int) -> Array:
        """Return a derivative of q − q0 (…, 4) as that of u (…, m) with respect to scaled time."""
        return (values * self.time_scale**order / np.where(self.unit > 0, self.unit, 1.0))[
            ..., self.moving
        ]

    @cached_property
    def complete_element(self) -> FreeElement:
        """The element model with the rows that limits and the eye require."""
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
    def ignored_rows(self) -> Mask:
        """True for rows that do not count in an element, (n, r)."""
        mask = super().ignored_rows.copy()
        if self.problem.eye is not None:
            mask[:, self.row_names.index((RetinaClearance.name, None))] = self.at_port(
                self.problem.eye.port
            )
        return mask

    def at_port(self, port: float) -> Mask:
        """Return the elements in which the tip stays within the port, (n,)."""
        return self.chain.within(port)[self.structure.segment]

    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return σ and the parameters of the element model."""
        return self.sigma, self._parameters

    @cached_property
    def _parameters(self) -> Array:
        problem = self.problem
        ranges = np.array([problem.ranges.get(name, (-UNLIMITED, UNLIMITED)) for name in WATCHED])
        return FreeElement.layout.pack(
            q0=self.chain.points[0],
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
        """Differences between WATCHED at the first point and the closed form that the rows use."""
        start = self.chain.points[0]
        unwrapped = task_of_joints(NUMPY, self.mechanism, tuple(start))
        wrapped = task_from_joints(self.mechanism, start[None])
        return np.array([float(unwrapped[k]) - wrapped[0, k] for k in map(TASK.index, WATCHED)])

    @property
    def _retina_easing(self) -> float:
        """Amount by which the retina's row forbids one of the points.

        The tolerance of the limit allows it.
        """
        if self.problem.eye is None:
            return 0.0
        in_eye = np.abs(self.chain.points[:, 3]) > self.problem.eye.port + ROUNDING
        points = self.chain.points[self.chain.fixed.all(axis=1) & in_eye]
        rows = retina_row(NUMPY, self.problem.eye, tip_position(self.mechanism, points).T)
        return float(rows.max(initial=0.0))

    def direction_multipliers(self, solution: NlpSolution) -> DirectionMultipliers | None:
        """Return first-order savings of the motion if joints left their directions."""
        multipliers = solution.multipliers
        structure = solution.structure
        if multipliers is None:
            return None
        lengths = solution.elements[:, -1]
        directions = self.directions[structure.segment]
        velocity = self.joint_limits["velocity"] * self.time_scale
        values = np.zeros((structure.elements, 4))
        values[:, self.moving] = multipliers.direction * (
            velocity[self.moving] / self.unit[self.moving]
        )
        standing = np.setdiff1d(np.arange(4), self.moving)
        if standing.size and multipliers.rows.any():
            gradient = self._gradient_of_all_joints(solution, multipliers)
            for i in standing:
                values[:, i] = velocity[i] * steepest_descent(gradient[:, :, i], lengths)
        instants = np.append(0.0, np.cumsum(lengths))
        is_point = [
            k not in self.chain.ports and bool(fixed.all())
            for k, fixed in enumerate(self.chain.fixed)
        ]
        points = instants[[*structure.borders, structure.elements]][is_point]
        return DirectionMultipliers(
            instants * self.time_scale,
            directions,
            values / lengths.sum(),
            points=points * self.time_scale,
        )

    def _gradient_of_all_joints(self, solution: NlpSolution, multipliers: Multipliers) -> Array:
        """Return ∂(λᵀ G)/∂(q, q̇, q̈) of every joint, in scaled time, (n, 3, 4)."""
        elements, orders = solution.elements, np.arange(4)
        unit = np.where(self.unit > 0, self.unit, 1.0)
        z = np.zeros((len(elements), 17))
        z[:, np.add.outer(4 * orders, self.moving).ravel()] = elements[:, :-1]
        z[:, -1] = elements[:, -1]
        element = shared(
            replace(self.complete_element, moving=(0, 1, 2, 3), active=multipliers.active)
        )
        parameters = self._parameters.copy()
        parameters[FreeElement.layout.slices["d"]] = unit
        sigma = self.directions[solution.structure.segment]
        gradient = constraint_gradient(element, z, (sigma, parameters), multipliers.rows)
        by_state = gradient[:, :-1].reshape(-1, 4, 4) / unit
        return np.stack([by_state[:, 0], by_state[:, 1], by_state[:, 2] + by_state[:, 3]], axis=1)

    def result(self, solution: NlpSolution) -> PhaseSolution:
        """Return the solution as joint polynomials.

        Neighbours share position and velocity exactly.
        """
        if not solution.solved:
            return PhaseSolution(
                solution.status, solution.message, solution.iterations, solver=solution.solver
            )
        n = len(solution.elements)
        pieces = cubics(solution.elements)
        boundary = self.boundary

        def joints(values: Array, order: int) -> Array:
            expanded = np.zeros((n, 4))
            expanded[:, self.moving] = values * self.unit[self.moving] / self.time_scale**order
            return expanded + (self.chain.points[0] if order == 0 else 0.0)

        breaks = np.concatenate([[0.0], np.cumsum(solution.elements[:, -1] * self.time_scale)])
        next_states = (
            np.vstack([pieces.u[1:], boundary.points[-1]]),
            np.vstack([pieces.v[1:], boundary.end_velocity]),
        )
        coefficients = hermite(
            breaks,
            (joints(pieces.u, 0), joints(pieces.v, 1), joints(pieces.a0, 2)),
            (joints(next_states[0], 0), joints(next_states[1], 1), joints(pieces.a1, 2)),
        )
        indices = [k for k in range(len(self.chain.points)) if k not in self.chain.ports]
        borders = breaks[[*solution.structure.borders, n]][indices]
        directions = np.sign(np.add.reduceat(self.directions, indices[:-1]))
        continuation = solution.continuation
        return PhaseSolution(
            "solved",
            solution.message,
            solution.iterations,
            breaks,
            coefficients,
            solver=solution.solver,
            borders=borders,
            directions=directions,
            direction_multipliers=self.direction_multipliers(solution),
            confirmation=solution.confirmation,
            continuation=None if continuation is None else lambda: self.result(continuation()),
        )
