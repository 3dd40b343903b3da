"""Refinement of a transcription: what it leaves out or misses is found on the true path, and the program is solved again.

The program holds path constraints at collocation points only, and only those that are active. After each solution every
constraint is evaluated densely. A violated one that was not active becomes active; an element with a large violation is cut
(mesh refinement); a small violation lowers the bound of its row (backoff). What a backoff turns out to take too much is
given back. `optimise` holds the objectives.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ssm_planner.planning.ocp.constraints import RowName
from ssm_planner.planning.ocp.element import COLLOCATION, DENSE, Aim, ElementModel, shared
from ssm_planner.planning.ocp.natively import rows_between
from ssm_planner.planning.ocp.nlp import (
    BoundaryConditions,
    Confirmation,
    Guess,
    InitialPoint,
    Method,
    NlpData,
    NlpSolution,
    NlpStructure,
    split,
)
from ssm_planner.planning.ocp.structured import ITERATIONS, NOT_CONVERGED, solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.problem.limits import LensClearance, MotorTorque
from ssm_planner.problem.problem import Objective
from ssm_planner.typing import Array, Indices, Mask

NEAR = 0.8
"""A row that stays below this share of its limit in the guess is not active until it is found violated."""
TOLERANCE = 5e-7
"""A row may exceed its limit between collocation points by this share."""
COARSE = 4e-3
"""Where a row exceeds its limit by more than this, its element is cut."""
ABOUT = 2e-3
"""Where no row exceeds its limit by more than this, a motion is about the fastest: refinement makes it hardly longer."""
ASTRAY = 1.0
"""Where a row that was not active is exceeded by more than this, the solution is no guess: the first one is taken again."""
PARTS = 3
"""Elements that a cut makes of one."""
CUTS = 2
"""Rounds that may cut elements; they start cold."""
MOST_ELEMENTS = 3
"""Times their first number."""
BACKOFF = 2.0
"""Backoff per violation found."""
NEIGHBOUR, REACH = 0.4, 6
"""Share of an element's backoff that its neighbours get, and so on from one to the next for so many elements."""
LITTLE = 2e-3
"""Backoff beyond which neighbours get no more: there the elements are too long, which is a matter of one element."""
SURPLUS = 5e-4
"""Backoff beyond what its row needs that is given back."""
GIVEN_BACK = 0.8
"""Share of it that is given back in one round, of at most BACK_ROUNDS; they start warm."""
BACK_ROUNDS = 6
GAIN = 1e-5
"""Share of the duration that the last of these rounds has to gain for another one."""
SHORTEST = 0.2
"""Least time of a block, as a share of the guess's."""
ROUNDS = 12
HEAT_ROUNDS = 4
"""The fastest motion is a good one already: what takes longer to cool it is not worth the wait."""
SKETCH_ROUNDS, SKETCH_ITERATIONS = 3, 60
"""Of a sketch, and in each of its rounds."""
WORTH, WORTH_TRYING = 4.0, 2.5
"""Effort after which the fastest motion is taken as far as it is refined; and after which one that is of use only where it is
faster than another is given up."""
HOPELESS = 1.01
"""Times the duration asked for: where the fastest motion takes longer, it is not worked out to the last digit."""
CENTRING = 8
"""Iterations at most that make Ipopt's start of a solution."""
NOT_CONFIRMED, GIVEN_UP = "Not_Confirmed_By_Ipopt", "Not_Worth_Its_Effort"
SAME, SAME_COST = 1e-6, 1e-5
"""Share by which the two solvers' durations, and their heat or effort, may differ; beyond, the better motion is taken."""
SOLVE = 0.02
PRICES = {
    ("structured", False): 6e-6,
    ("structured", True): 8e-6,
    ("Ipopt", False): 1e-4,
    ("Ipopt", True): 3e-4,
}
"""Effort of a solve, and of each of its iterations for every element, by solver and whether heat or effort counts: about the
seconds that it takes."""
LONGER = 1e-3
"""By how much the motion of least heat may be longer than the fastest."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OcpProblem(ABC):
    """An optimal control problem of n elements in k segments and b blocks, and r rows of path constraints.

    A subclass gives its element models and their parameters.
    """

    structure: NlpStructure
    fractions: Array
    """Length of every element as a share of its block, (n,)."""
    times: Array
    """Time of every block in the guess, (b,), in scaled time."""
    joint_limits: dict[str, Array]
    """`joint_limits` of the robot with the limits to keep."""
    time_scale: float
    """Length of a scaled second, s."""
    directions: Array
    """Of every joint in every segment: +1, −1 or 0, (k, 4)."""
    starting: Array
    """Which joints begin the motion at rest, (4,), bool."""
    method: Method = "Ipopt"
    """By which solver."""
    shortest: float = SHORTEST
    """Least time of a block, as a share of the guess's."""

    @property
    @abstractmethod
    def boundary(self) -> BoundaryConditions:
        """Where the coordinates pass, in scaled time."""

    @property
    @abstractmethod
    def limits(self) -> tuple[Array, Array, Array]:
        """Of u̇, ü and u⃛ of the coordinates in scaled time, (m,) each; infinite where there is none."""

    @property
    @abstractmethod
    def complete_element(self) -> ElementModel:
        """The element model with all r rows that this problem can need."""

    @abstractmethod
    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Parameters of the element models near these elements (n, 4 m + 1), each (size,) or (n, size)."""

    def element(self, active: frozenset[RowName], aim: Aim) -> ElementModel:
        """The element model with the active rows."""
        return shared(replace(self.complete_element, active=active, aim=aim))

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """The program's parameters and bounds near these elements; backoff (n, active rows)."""
        velocity, acceleration, jerk = self.limits
        boundary = self.boundary
        lower, upper, between = boundary.bounds(self.structure, velocity, acceleration)
        return NlpData(
            element_parameters=self.element_parameters(elements),
            fractions=self.fractions,
            least_times=self.shortest * self.times,
            lower=lower,
            upper=upper,
            velocity=between,
            end=np.concatenate([boundary.points[-1], boundary.end_velocity]),
            acceleration=acceleration,
            jerk=jerk,
            path_bound=np.tile(1.0 - backoff, (1, len(COLLOCATION))),
            breakaway_bound=self._breakaway_bound(),
        )

    def remeshed(self, solution: NlpSolution) -> tuple[OcpProblem, Guess] | None:
        """The same problem with elements where a solution needs them, and that as guess; None where they lie well."""
        return None

    def refined(self, counts: Indices) -> OcpProblem:
        """The same problem with every element cut into so many equal parts, (n,)."""
        fractions = np.repeat(self.fractions / counts, counts)
        return replace(self, structure=self.structure.split(counts), fractions=fractions)

    def with_one_time(self, lengths: Array) -> OcpProblem:
        """The same problem with one time for all elements, in the proportion of these lengths (n,)."""
        structure = replace(self.structure, block_sizes=(len(lengths),))
        total = lengths.sum(keepdims=True)
        return replace(self, structure=structure, fractions=lengths / total, times=total)

    @property
    def has_free_borders(self) -> bool:
        """Borders are unknown: where joints turn back, or the tip passes the port of an eye."""
        return bool(np.isnan(self.boundary.points).any())

    @property
    def always_active(self) -> frozenset[RowName]:
        """Rows that are active whatever their value in the guess."""
        return frozenset()

    @property
    def sigma(self) -> Array:
        """σ: directions of the joints in every element, (n, 4)."""
        return np.asarray(self.directions[self.structure.segment])

    @cached_property
    def row_names(self) -> list[RowName]:
        """Of all r rows."""
        return self.complete_element.row_names

    @property
    def idle(self) -> Mask:
        """Rows that do not count in an element, (n, r)."""
        return np.zeros((self.structure.elements, len(self.row_names)), dtype=bool)

    @cached_property
    def _looked(self) -> list[tuple[Array, Array]]:
        """Elements last looked at by `row_maxima`, and what was found."""
        return []

    def row_maxima(self, elements: Array) -> Array:
        """Largest value of every row in every element, (n, r), on the true path."""
        n = len(elements)
        if not self.row_names:
            return np.zeros((n, 0))
        if self._looked and np.array_equal(self._looked[0][0], elements):
            return self._looked[0][1]
        rows = rows_between(self.complete_element, elements, self.element_parameters(elements))
        found = parabolic_peak(rows.reshape(n, len(DENSE), -1).transpose(0, 2, 1))
        worst = np.where(self.idle, -np.inf, found)
        worst.setflags(write=False)
        self._looked[:] = [(elements.copy(), worst)]
        return worst

    def _breakaway_bound(self) -> Array:
        """Upper bounds of the breakaway rows, (sets, rows): 1 for joints that start or turn back there, else inf."""
        sigma, joints = self.sigma, self.complete_element.breakaway_joints
        bounds = []
        for k, side in self.structure.breakaways:
            turning = sigma[k] != sigma[k - 1] if k else self.starting
            bounds.append(np.where(turning & (sigma[side] != 0), 1.0, np.inf)[joints])
        return np.array(bounds)


def optimise(
    problem: OcpProblem,
    guess: Guess,
    objective: Objective,
    duration: float | None = None,
    *,
    useless: float = np.inf,
    about: bool = False,
) -> NlpSolution:
    """The fastest motion; for "time then heat" the one of least heat among those hardly longer.

    duration: asked for, in scaled time; then the motion of least effort that takes it, or the fastest if that is longer.
    useless: a duration from which on the fastest motion is not worked out to the last digit. about: nearly the fastest motion
    will do until `rest` is asked for.
    With a cooling in joint_limits the heat of the motors so weighted is traded for time, in place of heat and effort.
    What is to be confirmed is not solved where the structured solver finds no fastest motion, or Ipopt does not confirm it.
    """
    hopeless = useless if duration is None else HOPELESS * duration
    begun = _refine(_Refinement.begin(problem, guess), "time", hopeless=hopeless, about=about)
    if about and begun.solution.solved:
        return replace(
            begun.solution,
            rest=lambda: _finished(_resumed(begun, hopeless), objective, duration, hopeless),
        )
    return _finished(begun, objective, duration, hopeless)


def _finished(
    begun: _Refined, objective: Objective, duration: float | None, hopeless: float
) -> NlpSolution:
    """The motion of an objective, from the fastest as it is refined."""
    problem, found = begun.state.problem, _given_back(begun)
    if not found.solution.solved or found.solution.times.sum() > hopeless:
        return found.solution
    finer = _remeshed(found)
    confirmed = (finer and _confirmed(finer, "time")) or _confirmed(found, "time")
    if confirmed is None:
        return replace(found.solution, message=NOT_CONFIRMED)
    fastest, total = confirmed, float(confirmed.solution.times.sum())
    cooled = bool(problem.joint_limits["cooling"].any())
    enough = duration is None and objective == "time" and not cooled
    if not fastest.solution.solved or enough or (duration or np.inf) < total:
        return fastest.solution
    reached = Guess(fastest.solution.elements, fastest.solution.times)
    if duration is None:
        begin = fastest.state.restarted(reached)
        last = fastest.state.problem
        if fastest.solution.solver == "structured" and last.has_free_borders:
            # heat hardly depends on when borders are passed: ways between them would shrink to nothing, over many iterations
            lengths = reached.elements[:, -1]
            one_time = last.with_one_time(lengths)
            begin = replace(begin, problem=one_time).restarted(
                replace(reached, times=one_time.times)
            )
        longest = np.inf if cooled else (1 + LONGER) * total
        best = _refined(begin, "cooling" if cooled else "heat", (0.0, longest))
        if not (best.solution.solved and best.feasible):
            return fastest.solution
    else:
        begin = _Refinement.begin(fastest.state.problem, reached.stretched(duration / total))
        best = _refined(begin, "cooling" if cooled else "effort", (duration, duration))
        if not best.solution.solved:  # then any motion that takes as long
            best = _refine(begin, "time", duration=(duration, duration))
    confirmation, of_cost = fastest.solution.confirmation, best.solution.confirmation
    if confirmation is not None and of_cost is not None:
        confirmation = replace(
            confirmation, iterations=confirmation.iterations + of_cost.iterations
        )
    iterations = fastest.solution.iterations + best.solution.iterations
    return replace(best.solution, iterations=iterations, confirmation=confirmation)


class Effort(threading.local):
    """What a thread has spent on solving, about in seconds; unlike seconds it is the same whenever the same is asked."""

    spent = 0.0

    def beyond(self, before: float, allowed: float) -> bool:
        """Whether more than so much has been spent since it stood at `before`."""
        return self.spent - before > allowed


EFFORT = Effort()
"""Searches are bounded by it, so that neither load nor what is kept from earlier plans changes a result."""

NlpProgram = tuple[NlpStructure, ElementModel, NlpData]


@dataclass(frozen=True, eq=False)
class _Refinement:
    """The state of a refinement."""

    guess: Guess
    """Where it began."""
    problem: OcpProblem
    active: frozenset[RowName]
    backoff: Array
    """Of all rows, (n, r)."""
    elements: Array
    """The last solution, or the guess, (n, 4 m + 1)."""
    start: InitialPoint
    """Of the next solve."""

    @classmethod
    def begin(cls, problem: OcpProblem, guess: Guess) -> _Refinement:
        """Active are the rows that the guess comes near to."""
        elements = guess.elements
        active = problem.always_active | chosen_rows(
            problem.row_names, problem.row_maxima(elements), NEAR
        )
        backoff = np.zeros((len(elements), len(problem.row_names)))
        return cls(guess, problem, active, backoff, elements=elements, start=guess.point)

    def restarted(self, guess: Guess) -> _Refinement:
        """From another guess, with the same active rows and backoff."""
        return replace(self, guess=guess, elements=guess.elements, start=guess.point)

    def program(self, aim: Aim, duration: tuple[float, float] | None) -> NlpProgram:
        """What is to be solved next."""
        structure, element = self.problem.structure, self.problem.element(self.active, aim)
        is_active = [name in self.active for name in self.problem.row_names]
        backoff = np.where(self.problem.idle, -np.inf, self.backoff)
        data = self.problem.data(self.elements, backoff[:, is_active])
        if duration is not None:
            data = data.least_cost(duration, time=float(aim == "cooling"))
        return structure, element, data

    def solve(self, program: NlpProgram, aim: Aim) -> NlpSolution:
        """The program's solution, by the solver that is asked for."""
        structure, element, data = program
        beside_eye = any(name == LensClearance.name for name, _ in self.active)
        after_ipopt = self.start.multipliers is not None  # who starts warm from there
        alone = self.problem.method == "sketched" or (
            self.problem.method == "confirmed" and aim == "time"
        )
        tried = self.problem.method == "structured" or (
            self.problem.method != "Ipopt" and not beside_eye
        )
        if tried and not after_ipopt:
            found = solve_structured(
                structure,
                element,
                data,
                self.start,
                iterations=SKETCH_ITERATIONS if self.problem.method == "sketched" else ITERATIONS,
                switching=beside_eye,
            )
            if found.solved or alone:
                return found
        if alone:
            times = self.start.x[-len(data.least_times) :]
            return NlpSolution(
                NOT_CONVERGED,
                structure,
                self.elements,
                times,
                iterations=0,
                point=self.start,
                solver="structured",
            )
        return Transcription.of(structure, element).solve(data, self.start)

    def activated(
        self, solution: NlpSolution, missed: frozenset[RowName], *, astray: bool
    ) -> _Refinement:
        """With the missed rows active too, from the solution or, where it went astray, from the guess."""
        active = self.active | missed
        if astray and len(self.elements) == len(self.guess.elements):
            return replace(self.restarted(self.guess), active=active)
        return replace(self, active=active, start=InitialPoint(solution.point.x))

    def cut(self, solution: NlpSolution, coarse: Array) -> _Refinement:
        """With the coarse elements (n,) cut into PARTS; the parts have the backoff of the whole."""
        counts = np.where(coarse, PARTS, 1)
        elements, backoff = split(self.elements, counts), np.repeat(self.backoff, counts, axis=0)
        start = Guess(elements, solution.times).point
        return replace(
            self,
            problem=self.problem.refined(counts),
            elements=elements,
            backoff=backoff,
            start=start,
        )

    def tightened(self, solution: NlpSolution, more: Array) -> _Refinement:
        """With more backoff (n, r), warm from the solution."""
        return replace(self, backoff=self.backoff + more, start=solution.point)


@dataclass(frozen=True, eq=False)
class _Refined:
    """The last solution, with the iterations of all rounds, and the state it was found in."""

    solution: NlpSolution
    state: _Refinement
    feasible: bool
    """No row is violated between the collocation points."""
    program: NlpProgram
    """That was solved last."""
    paused: int = 0
    """Rounds after which it was left as about the fastest; 0: it was not."""


def _refine(
    state: _Refinement,
    aim: Aim,
    *,
    duration: tuple[float, float] | None = None,
    hopeless: float = np.inf,
    about: bool = False,
    first: int = 1,
) -> _Refined:
    """Solve, find the violations, refine, until there are none.

    duration: its bounds, where it is not the aim. hopeless: a duration beyond which a motion is of no use, for refinement
    only makes it longer. about: until they are small. first: the round it begins with.
    """
    rounds = (
        HEAT_ROUNDS
        if aim == "heat"
        else SKETCH_ROUNDS
        if state.problem.method == "sketched"
        else ROUNDS
    )
    iterations, feasible, paused, begin, worth = (
        0,
        False,
        0,
        EFFORT.spent,
        WORTH if hopeless == np.inf else WORTH_TRYING,
    )
    for k in range(first, rounds + 1):
        program = state.program(aim, duration)
        solution = state.solve(program, aim)
        iterations += solution.iterations
        EFFORT.spent += SOLVE + PRICES[solution.solver, aim != "time"] * solution.iterations * len(
            solution.elements
        )
        state = replace(state, elements=solution.elements)
        if not solution.solved or solution.times.sum() > hopeless:
            break
        violation = state.problem.row_maxima(solution.elements) - 1
        feasible = bool(violation.max(initial=-1.0) <= TOLERANCE)
        if feasible or k == rounds:
            break
        if about and violation.max() <= ABOUT:
            paused = k
            break
        if EFFORT.beyond(begin, worth):
            solution = solution if hopeless == np.inf else replace(solution, message=GIVEN_UP)
            break
        state = _next(state, solution, violation, k, may_cut=aim != "heat")
    return _Refined(
        replace(solution, iterations=iterations), state, feasible, program=program, paused=paused
    )


def _resumed(begun: _Refined, hopeless: float) -> _Refined:
    """A fastest motion refined to the end."""
    if not begun.paused:
        return begun
    solution, state = begun.solution, begun.state
    violation = state.problem.row_maxima(solution.elements) - 1
    state = _next(state, solution, violation, begun.paused, may_cut=True)
    found = _refine(state, "time", hopeless=hopeless, first=begun.paused + 1)
    iterations = solution.iterations + found.solution.iterations
    return replace(found, solution=replace(found.solution, iterations=iterations))


def _refined(begin: _Refinement, aim: Aim, duration: tuple[float, float]) -> _Refined:
    """Refined and confirmed; by Ipopt alone where it does not confirm what the structured solver found."""
    found = _confirmed(_refine(begin, aim, duration=duration), aim)
    by_ipopt = replace(begin, problem=replace(begin.problem, method="Ipopt"))
    return found or _refine(by_ipopt, aim, duration=duration)


def _confirmed(found: _Refined, aim: Aim) -> _Refined | None:
    """The structured solver's motion, confirmed by Ipopt from there, or Ipopt's where it is better; None: not confirmed.

    Of equals the structured solver's is taken: there the dynamics hold to the last digit, as tiny elements need. A better one
    that exceeds a row between the collocation points is still to be refined, and confirms nothing.
    """
    own, problem = found.solution, found.state.problem
    if problem.method != "confirmed" or own.solver != "structured" or not own.solved:
        return found
    structure, element, data = found.program
    centred = solve_structured(
        structure, element, data, own.point, iterations=CENTRING, centred=True
    )
    begin = InitialPoint((centred if centred.solved else own).point.x)
    ipopts = Transcription.of(structure, element).solve(data, begin, confirming=True)
    EFFORT.spent += PRICES["Ipopt", aim != "time"] * ipopts.iterations * len(ipopts.elements)
    if not ipopts.solved:
        return None
    before, after = (
        float(each.times.sum()) if aim == "time" else each.objective for each in (own, ipopts)
    )
    difference = after / before - 1 if before else 0.0
    same = SAME if aim == "time" else SAME_COST
    better = difference < -same
    if better and problem.row_maxima(ipopts.elements).max(initial=0.0) > 1 + TOLERANCE:
        return None
    solution = replace(
        ipopts if better else own,
        iterations=own.iterations + ipopts.iterations,
        confirmation=Confirmation(ipopts.iterations, difference),
    )
    return replace(found, solution=solution, state=replace(found.state, elements=solution.elements))


def _next(
    state: _Refinement, solution: NlpSolution, violation: Array, k: int, *, may_cut: bool
) -> _Refinement:
    """The refinement after round k, from the violations (n, r) of its solution: the first of these that applies.

    1. Violated rows that were not active become active.
    2. Elements with large violations are cut, in the first CUTS rounds and while they do not become too many.
    3. The bounds of violated rows are lowered, by more from round to round.
    """
    worst = violation.max(axis=0)
    missed = chosen_rows(state.problem.row_names, violation, TOLERANCE) - state.active
    if missed:
        return state.activated(solution, missed, astray=bool(worst.max() > ASTRAY))
    coarse = violation.max(axis=1) > COARSE
    more = (PARTS - 1) * np.count_nonzero(coarse)
    room = MOST_ELEMENTS * len(state.guess.elements) - len(state.elements)
    if may_cut and k <= CUTS and 0 < more <= room:
        return state.cut(solution, coarse)
    return state.tightened(solution, min(1.4 ** max(k - 2, 0), 3.0) * backoff_of(violation))


def _remeshed(found: _Refined) -> _Refined | None:
    """A faster motion on a mesh made for the one that was found; None where there is none, or that mesh is good."""
    again = (
        found.state.problem.remeshed(found.solution)
        if found.solution.solved and found.feasible
        else None
    )
    if again is None:
        return None
    finer = _given_back(_refine(_Refinement.begin(*again), "time"))
    faster = (
        finer.solution.solved
        and finer.feasible
        and finer.solution.times.sum() < found.solution.times.sum()
    )
    if not faster:
        return None
    iterations = found.solution.iterations + finer.solution.iterations
    return replace(finer, solution=replace(finer.solution, iterations=iterations))


def _given_back(found: _Refined) -> _Refined:
    """A fastest motion without the backoff that its rows did not need, round by round while that makes it faster.

    Where a motion squeezes past a limit within one element, refinement lowers bounds by more than the motion that comes of
    it needs. A motion for a range of friction keeps it: the drives that bound the range take more.
    """
    problem = found.state.problem
    kept = bool(problem.complete_element.robot.corners) or problem.method == "sketched"
    for _ in range(0 if kept else BACK_ROUNDS):
        if not (found.feasible and found.solution.solved):
            break
        solution, state = found.solution, found.state
        below = np.maximum(1 - state.problem.row_maxima(solution.elements), 0.0)
        surplus = np.minimum(below, state.backoff)
        if not surplus.max(initial=0.0) > SURPLUS:
            break
        less = replace(state, backoff=state.backoff - GIVEN_BACK * surplus, start=solution.point)
        again = _refine(less, "time")
        total, before = again.solution.times.sum(), solution.times.sum()
        if not (again.feasible and again.solution.solved and total < before):
            break
        found = replace(
            again,
            solution=replace(
                again.solution, iterations=solution.iterations + again.solution.iterations
            ),
        )
        if total > (1 - GAIN) * before:
            break
    return found


def backoff_of(violation: Array) -> Array:
    """By how much to lower the bounds of rows, (n, r), that were found violated between the collocation points."""
    own = np.where(violation > 0, BACKOFF * violation + TOLERANCE, 0.0)
    # a violation that is lowered in one element rises in its neighbours
    spread = np.minimum(own, LITTLE)
    for _ in range(min(REACH, len(own) - 1)):
        before, after = spread[:-1].copy(), spread[1:].copy()
        np.maximum(spread[1:], NEIGHBOUR * before, out=spread[1:])
        np.maximum(spread[:-1], NEIGHBOUR * after, out=spread[:-1])
    return np.asarray(np.maximum(own, spread))


def parabolic_peak(values: Array) -> Array:
    """Largest value over the last axis (evenly spaced samples, at least 3) of the parabolas through the largest one.

    Returns an array without the last axis; never less than the largest sample.
    """
    count = values.shape[-1]
    rows = values.reshape(-1, count)
    largest = rows.max(axis=1)
    middle = np.clip(rows.argmax(axis=1), 1, count - 2) + np.arange(len(rows)) * count
    left, here, right = (rows.ravel()[middle + k] for k in (-1, 0, 1))
    slope, bend = (right - left) / 2, right - 2 * here + left
    with np.errstate(divide="ignore", invalid="ignore"):
        where = np.clip(np.nan_to_num(-slope / bend), -1.0, 1.0)
    return np.asarray(
        np.maximum(largest, here + where * (slope + where * bend / 2)).reshape(values.shape[:-1])
    )


def chosen_rows(names: list[RowName], values: Array, least: float) -> frozenset[RowName]:
    """Rows with values (n, r) above the least one; of the torques of one motor, at several corners of a range of friction
    and payload, only those that are the largest of them somewhere."""
    above = values > least
    joints = np.array(
        [-1 if name != MotorTorque.name or i is None else i % 4 for name, i in names], dtype=int
    )
    for i in set(joints[joints >= 0].tolist()):
        own = joints == i
        above[:, own] &= values[:, own] >= values[:, own].max(axis=1, keepdims=True)
    return frozenset(names[k] for k in np.flatnonzero(above.any(axis=0)))
