"""Refinement of a transcription until the true motion keeps all limits.

The program has path constraints only at collocation points, and only the active ones. After each
solution, every constraint is evaluated densely on the true path. A violated row that is not active
becomes active, an element with a large violation is cut (mesh refinement), and a small violation
lowers the bound of its row (backoff). Then the program is solved again. `optimise` combines this
with the objectives.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from ssm_planner.dynamics import motorised
from ssm_planner.elements.compiled import rows_between
from ssm_planner.elements.element import COLLOCATION, DENSE, Aim, ElementModel, shared
from ssm_planner.elements.rows import RowName
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
from ssm_planner.planning.ocp.structured import NOT_CONVERGED, solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.tolerances import SAME
from ssm_planner.problem import LensClearance, MotorTorque, Objective
from ssm_planner.typing import Array, Indices, Mask, keyword_record, record

NEAR = 0.8
"""A row below this share of its limit in the guess stays inactive until it is found violated."""
TOLERANCE = 5e-7
"""Share by which a row may exceed its limit between collocation points."""
COARSE = 4e-3
"""Excess of a row over its limit above which its element is cut."""
DIVERGED = 1.0
"""Excess of an inactive row above which a solution is a bad initial point.

Without the restart at the guess, random problem 30436 and two missions with a hot motor
(tests/planning/test_continuous_torque.py) have no plan.
"""
PARTS = 3
"""Number of elements into which an element is cut."""
CUTS = 2
"""Number of rounds that may cut elements. They start cold."""
BACKOFF = 2.0
"""Ratio of the added backoff to the violation."""
SHORTEST = 0.2
"""Smallest time of a block, as a share of the guess's."""
ROUNDS = 12
HEAT_ROUNDS = 4
"""The fastest motion is already good, so cooling it must not take long."""
ESTIMATE_ROUNDS = 3
"""Largest number of rounds of an estimate."""
HOPELESS = 1.01
"""Ratio to the requested duration above which the fastest motion is not refined any further."""
CENTRING = 8
"""Largest number of iterations that centre a solution for Ipopt."""
NOT_CONFIRMED = "Not_Confirmed_By_Ipopt"
SOLVE = 0.02
PRICES = {
    ("structured", False): 6e-6,
    ("structured", True): 8e-6,
    ("Ipopt", False): 1e-4,
    ("Ipopt", True): 3e-4,
}
"""Effort of an iteration per element, by solver and by whether heat or effort counts, approximately
in s.

SOLVE is the effort of a solve without its iterations.
"""
LONGER = 1e-3
"""Relative amount by which the motion of least heat may be longer than the fastest motion."""


@keyword_record
class OcpProblem(ABC):
    """An optimal control problem with n elements, k segments, b blocks and r path rows.

    A subclass provides the element models and their parameters.
    """

    structure: NlpStructure
    fractions: Array
    """Length of every element as a share of its block, (n,)."""
    times: Array
    """Time of every block in the guess, (b,), in scaled time."""
    joint_limits: dict[str, Array]
    """Result of `rows.joint_limits` for the robot whose limits the motion must keep."""
    time_scale: float
    """Length of a scaled second, s."""
    directions: Array
    """Direction of every joint in every segment: +1, −1 or 0, (k, 4)."""
    starting: Array
    """True for joints that begin the motion at rest, (4,)."""
    method: Method = "Ipopt"
    """Solution method."""
    shortest: float = SHORTEST
    """Smallest time of a block, as a share of the guess's."""
    alone: bool = False
    """True if Ipopt does not solve where the structured solver does not converge."""

    @property
    @abstractmethod
    def boundary(self) -> BoundaryConditions:
        """Positions and velocities at borders and ends, in scaled time."""

    @property
    @abstractmethod
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of u̇, ü and u⃛ of the coordinates in scaled time, (m,) each.

        Infinite without a limit.
        """

    @property
    @abstractmethod
    def complete_element(self) -> ElementModel:
        """Element model with all r rows that this problem may need."""

    @abstractmethod
    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return the parameters of the element model near elements (n, 4 m + 1), each (size,) or
        (n, size).
        """

    def element(self, active: frozenset[RowName], aim: Aim) -> ElementModel:
        """Return the element model with the active rows."""
        return shared(replace(self.complete_element, active=active, aim=aim))

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """Return the program's parameters and bounds near elements.

        `backoff` is (n, active rows).
        """
        velocity, acceleration, jerk = self.limits
        boundary = self.boundary
        lower, upper, v_bounds = boundary.bounds(self.structure, velocity, acceleration)
        return NlpData(
            element_parameters=self.element_parameters(elements),
            fractions=self.fractions,
            least_times=self.shortest * self.times,
            lower=lower,
            upper=upper,
            velocity=v_bounds,
            end=np.concatenate([boundary.points[-1], boundary.end_velocity]),
            acceleration=acceleration,
            jerk=jerk,
            path_bound=np.tile(1.0 - backoff, (1, len(COLLOCATION))),
            breakaway_bound=self._breakaway_bound(),
        )

    def with_cut_elements(self, counts: Indices) -> OcpProblem:
        """Return the problem with every element cut into equal parts.

        `counts` (n,) are their numbers.
        """
        fractions = np.repeat(self.fractions / counts, counts)
        return replace(self, structure=self.structure.split(counts), fractions=fractions)

    def with_one_time(self, lengths: Array) -> OcpProblem:
        """Return the problem with one time for all elements, with proportional lengths (n,)."""
        structure = replace(self.structure, block_sizes=(len(lengths),))
        total = lengths.sum(keepdims=True)
        return replace(self, structure=structure, fractions=lengths / total, times=total)

    @property
    def has_free_borders(self) -> bool:
        """True if borders are unknown: reversals, or passages of the port of an eye."""
        return bool(np.isnan(self.boundary.points).any())

    @property
    def always_active(self) -> frozenset[RowName]:
        """Rows that are active for every value in the guess."""
        return frozenset()

    @property
    def sigma(self) -> Array:
        """Directions σ of the joints in every element, (n, 4)."""
        return np.asarray(self.directions[self.structure.segment])

    @cached_property
    def row_names(self) -> list[RowName]:
        """Names of all r rows."""
        return self.complete_element.row_names

    @property
    def ignored_rows(self) -> Mask:
        """True for rows that do not count in an element, (n, r)."""
        return np.zeros((self.structure.elements, len(self.row_names)), dtype=bool)

    @cached_property
    def _row_cache(self) -> list[tuple[Array, Array]]:
        """Elements for which `row_maxima` was called last, and its result."""
        return []

    def row_maxima(self, elements: Array) -> Array:
        """Return the largest value of every row in every element on the true path, (n, r)."""
        n = len(elements)
        if not self.row_names:
            return np.zeros((n, 0))
        if self._row_cache and np.array_equal(self._row_cache[0][0], elements):
            return self._row_cache[0][1]
        rows = rows_between(self.complete_element, elements, self.element_parameters(elements))
        peaks = parabolic_peak(rows.reshape(n, len(DENSE), -1).transpose(0, 2, 1))
        maxima = np.where(self.ignored_rows, -np.inf, peaks)
        maxima.setflags(write=False)
        self._row_cache[:] = [(elements.copy(), maxima)]
        return maxima

    def _breakaway_bound(self) -> Array:
        """Return upper bounds of the breakaway rows, (sets, rows).

        They are 1 for joints that start or reverse there, and infinite for the others.
        """
        sigma = self.sigma
        joints = self.complete_element.breakaway_joints
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
    cutoff: float = np.inf,
    finish: bool = True,
) -> NlpSolution:
    """Return the motion that is best for an objective.

    With the objective "time" this is the fastest motion. With "time then heat" it is the motion of
    least heat among those that are not much longer. With a requested duration it is the motion of
    least effort that takes it, or the fastest motion if that is longer. If `joint_limits` contains
    heat weights (`cooling`), the weighted heat is traded for time instead.

    With the method "confirmed", the search ends if the structured solver finds no fastest motion or
    if Ipopt does not confirm it. The caller then tries another method.

    Parameters
    ----------
    problem : OcpProblem
        The problem on its first mesh.
    guess : Guess
        Motion at which the optimisation begins.
    objective : str
        "time", "time then heat" or "effort".
    duration : float or None
        Requested duration in scaled time.
    cutoff : float
        Duration in scaled time beyond which the fastest motion is not refined any further.
    finish : bool
        False: return the fastest motion as the structured solver finds it. It then has a
        `continuation`, which returns the motion for the objective, confirmed by Ipopt.

    Returns
    -------
    NlpSolution
        The motion, or the status of the failure.
    """
    cutoff = cutoff if duration is None else HOPELESS * duration
    fastest = _solve_to_tolerance(
        _RefinementState.from_guess(problem, guess), "time", cutoff=cutoff
    )
    if finish or not fastest.solution.solved:
        return _for_objective(fastest, objective, duration, cutoff)
    continuation = partial(_for_objective, fastest, objective, duration, cutoff)
    return replace(fastest.solution, continuation=continuation)


def _for_objective(
    result: _RefinementResult, objective: Objective, duration: float | None, cutoff: float
) -> NlpSolution:
    """Return the motion for an objective, from the refined fastest motion."""
    if not result.solution.solved or result.solution.times.sum() > cutoff:
        return result.solution
    fastest = _confirm(result, "time")
    if fastest is None:
        return replace(result.solution, message=NOT_CONFIRMED)
    if not fastest.solution.solved or fastest.solution.times.sum() > (duration or np.inf):
        return fastest.solution
    cheapest = _of_least_cost(fastest, objective, duration)
    if cheapest is None:
        return fastest.solution
    confirmation, of_cost = fastest.solution.confirmation, cheapest.confirmation
    if confirmation is not None and of_cost is not None:
        both = confirmation.iterations + of_cost.iterations
        confirmation = replace(confirmation, iterations=both)
    iterations = fastest.solution.iterations + cheapest.iterations
    return replace(cheapest, iterations=iterations, confirmation=confirmation)


def _of_least_cost(
    fastest: _RefinementResult, objective: Objective, duration: float | None
) -> NlpSolution | None:
    """Return the motion of least heat or effort. None if time alone counts, or if there is none."""
    problem = fastest.state.problem
    cooled = bool(problem.joint_limits["cooling"].any())
    if duration is not None:
        return _of_least_effort(fastest, duration, "cooling" if cooled else "effort")
    # Without motors there is no heat to reduce.
    heated = objective != "time" and any(motorised(problem.complete_element.robot.joints))
    return _of_least_heat(fastest, cooled=cooled) if heated or cooled else None


def _of_least_heat(fastest: _RefinementResult, *, cooled: bool) -> NlpSolution | None:
    """Return the motion of least heat that is not much longer than the fastest, or None.

    With heat weights (`cooled`), it is the motion of least weighted sum of time and heat.
    """
    solution, problem = fastest.solution, fastest.state.problem
    guess = Guess(solution.elements, solution.times)
    if solution.solver == "structured" and problem.has_free_borders:
        # Heat barely depends on when borders are passed, so segments between them would shrink to
        # nothing over many iterations.
        problem = problem.with_one_time(guess.elements[:, -1])
        guess = replace(guess, times=problem.times)
    state = replace(fastest.state, problem=problem).restarted(guess)
    max_duration = np.inf if cooled else (1 + LONGER) * float(solution.times.sum())
    result = _solve_and_confirm(state, "cooling" if cooled else "heat", (0.0, max_duration))
    return result.solution if result.solution.solved and result.feasible else None


def _of_least_effort(fastest: _RefinementResult, duration: float, aim: Aim) -> NlpSolution:
    """Return the motion of least effort, or of least weighted heat, that takes `duration`."""
    solution = fastest.solution
    guess = Guess(solution.elements, solution.times).stretched(duration / solution.times.sum())
    state = _RefinementState.from_guess(fastest.state.problem, guess)
    result = _solve_and_confirm(state, aim, (duration, duration)).solution
    # Any motion of this duration is better than none.
    return (
        result
        if result.solved
        else _solve_to_tolerance(state, "time", duration=(duration, duration)).solution
    )


class Effort(threading.local):
    """Work that a thread has spent on solving, approximately in seconds.

    Unlike time it does not depend on the machine or its load.
    """

    spent = 0.0

    def beyond(self, start: float, budget: float) -> bool:
        """Return True if more than `budget` has been spent since the value was `start`."""
        return self.spent - start > budget


EFFORT = Effort()
"""Work of this thread.

Searches are bounded by it, so that neither load nor cached results of earlier plans change a
result.
"""

NlpProgram = tuple[NlpStructure, ElementModel, NlpData]


@record
class _RefinementState:
    """State of a refinement."""

    guess: Guess
    """Guess at which the refinement began."""
    problem: OcpProblem
    active: frozenset[RowName]
    backoff: Array
    """Backoff of all rows, (n, r)."""
    elements: Array
    """Latest solution, or the guess, (n, 4 m + 1)."""
    start: InitialPoint
    """Initial point of the next solve."""

    @classmethod
    def from_guess(cls, problem: OcpProblem, guess: Guess) -> _RefinementState:
        """Begin a refinement. The rows that the guess comes near to are active."""
        elements = guess.elements
        active = problem.always_active | chosen_rows(
            problem.row_names, problem.row_maxima(elements), NEAR
        )
        backoff = np.zeros((len(elements), len(problem.row_names)))
        return cls(guess, problem, active, backoff, elements=elements, start=guess.point)

    def restarted(self, guess: Guess) -> _RefinementState:
        """Return the state with another guess, and with the same active rows and backoff."""
        return replace(self, guess=guess, elements=guess.elements, start=guess.point)

    def program(self, aim: Aim, duration: tuple[float, float] | None) -> NlpProgram:
        """Return the program to solve next."""
        structure = self.problem.structure
        element = self.problem.element(self.active, aim)
        is_active = [name in self.active for name in self.problem.row_names]
        backoff = np.where(self.problem.ignored_rows, -np.inf, self.backoff)
        data = self.problem.data(self.elements, backoff[:, is_active])
        if duration is not None:
            data = data.least_cost(duration, time=float(aim == "cooling"))
        return structure, element, data

    def solve(self, program: NlpProgram, aim: Aim) -> NlpSolution:
        """Solve the program with the solver that the method requires."""
        structure, element, data = program
        beside_eye = any(name == LensClearance.name for name, _ in self.active)
        # A solve after Ipopt continues with Ipopt, which starts warm from its own multipliers.
        after_ipopt = self.start.multipliers is not None
        alone = (
            self.problem.alone
            or self.problem.method == "estimated"
            or (self.problem.method == "confirmed" and aim == "time")
        )
        try_structured = self.problem.method == "structured" or (
            self.problem.method != "Ipopt" and not beside_eye
        )
        if try_structured and not after_ipopt:
            solution = solve_structured(
                structure,
                element,
                data,
                self.start,
                switching=beside_eye,
            )
            if solution.solved or alone:
                return solution
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
        return Transcription.build(structure, element).solve(data, self.start)

    def cut(self, solution: NlpSolution, coarse: Array) -> _RefinementState:
        """Return the state with the coarse elements (n,) cut into PARTS.

        The parts keep the backoff.
        """
        counts = np.where(coarse, PARTS, 1)
        elements = split(self.elements, counts)
        backoff = np.repeat(self.backoff, counts, axis=0)
        start = Guess(elements, solution.times).point
        return replace(
            self,
            problem=self.problem.with_cut_elements(counts),
            elements=elements,
            backoff=backoff,
            start=start,
        )

    def tightened(self, solution: NlpSolution, increase: Array) -> _RefinementState:
        """Return the state with more backoff (n, r). The next solve is warm from the solution."""
        return replace(self, backoff=self.backoff + increase, start=solution.point)


@record
class _RefinementResult:
    """Latest solution with the iterations of all rounds, and the state in which it was found."""

    solution: NlpSolution
    state: _RefinementState
    feasible: bool
    """True if no row is violated between the collocation points."""
    program: NlpProgram
    """Program that was solved last."""


def _solve_to_tolerance(
    state: _RefinementState,
    aim: Aim,
    *,
    duration: tuple[float, float] | None = None,
    cutoff: float = np.inf,
) -> _RefinementResult:
    """Solve, find the violations and refine, until the motion keeps all limits.

    Parameters
    ----------
    state : _RefinementState
        Initial state.
    aim : str
        Cost that is added to time.
    duration : (float, float) or None
        Bounds of the duration. None if the duration is minimised.
    cutoff : float
        Duration beyond which the refinement ends, since it only makes a motion longer.
    """
    rounds = (
        HEAT_ROUNDS
        if aim == "heat"
        else ESTIMATE_ROUNDS
        if state.problem.method == "estimated"
        else ROUNDS
    )
    iterations = 0
    feasible = False
    for k in range(1, rounds + 1):
        program = state.program(aim, duration)
        solution = state.solve(program, aim)
        iterations += solution.iterations
        EFFORT.spent += SOLVE + PRICES[solution.solver, aim != "time"] * solution.iterations * len(
            solution.elements
        )
        state = replace(state, elements=solution.elements)
        if not solution.solved or solution.times.sum() > cutoff:
            break
        violation = state.problem.row_maxima(solution.elements) - 1
        feasible = bool(violation.max(initial=-1.0) <= TOLERANCE)
        if feasible or k == rounds:
            break
        state = _next_state(state, solution, violation, k, may_cut=aim != "heat")
    return _RefinementResult(
        replace(solution, iterations=iterations), state, feasible, program=program
    )


def _solve_and_confirm(
    state: _RefinementState, aim: Aim, duration: tuple[float, float]
) -> _RefinementResult:
    """Return a refined and confirmed motion. If Ipopt does not confirm it, Ipopt refines alone."""
    result = _confirm(_solve_to_tolerance(state, aim, duration=duration), aim)
    by_ipopt = replace(state, problem=replace(state.problem, method="Ipopt"))
    return result or _solve_to_tolerance(by_ipopt, aim, duration=duration)


def _confirm(refined: _RefinementResult, aim: Aim) -> _RefinementResult | None:
    """Confirm a motion of the structured solver by Ipopt. None if Ipopt does not confirm it.

    Ipopt starts at the solution. If both motions are equally good, that of the structured solver is
    taken, because it satisfies the dynamics exactly, which very short elements need. A better
    motion of Ipopt that violates a row between the collocation points would have to be refined, so
    it confirms nothing. If Ipopt's motion is longer, the structured one is taken, and its confirmation
    states the difference. A motion that needs no confirmation is returned unchanged.
    """
    structured, problem = refined.solution, refined.state.problem
    if problem.method != "confirmed" or structured.solver != "structured" or not structured.solved:
        return refined
    structure, element, data = refined.program
    centred = solve_structured(
        structure, element, data, structured.point, iterations=CENTRING, centred=True
    )
    start = InitialPoint((centred if centred.solved else structured).point.x)
    ipopts = Transcription.build(structure, element).solve(data, start, confirming=True)
    EFFORT.spent += PRICES["Ipopt", aim != "time"] * ipopts.iterations * len(ipopts.elements)
    if not ipopts.solved:
        return None
    own_value, ipopt_value = (
        float(motion.times.sum()) if aim == "time" else motion.objective
        for motion in (structured, ipopts)
    )
    difference = ipopt_value / own_value - 1 if own_value else 0.0
    better = difference < -SAME
    if better and problem.row_maxima(ipopts.elements).max(initial=0.0) > 1 + TOLERANCE:
        return None
    solution = replace(
        ipopts if better else structured,
        iterations=structured.iterations + ipopts.iterations,
        confirmation=Confirmation(ipopts.iterations, difference, ipopts.residual),
    )
    return replace(
        refined, solution=solution, state=replace(refined.state, elements=solution.elements)
    )


def _next_state(
    state: _RefinementState, solution: NlpSolution, violation: Array, k: int, *, may_cut: bool
) -> _RefinementState:
    """Return the state after round k from the violations (n, r) of its solution.

    The first of these steps that applies is taken.

    1. Violated rows that are not active become active. If the solution has diverged, the next
       solve begins at the guess again.
    2. Elements with large violations are cut, in the first CUTS rounds.
    3. The bounds of violated rows are lowered.
    """
    missed = chosen_rows(state.problem.row_names, violation, TOLERANCE) - state.active
    if missed:
        state = replace(state, active=state.active | missed)
        if violation.max() > DIVERGED and len(state.elements) == len(state.guess.elements):
            return state.restarted(state.guess)
        return replace(state, start=InitialPoint(solution.point.x))
    coarse = violation.max(axis=1) > COARSE
    if may_cut and k <= CUTS and coarse.any():
        return state.cut(solution, coarse)
    return state.tightened(solution, backoff_of(violation))


def backoff_of(violation: Array) -> Array:
    """Return the backoff of rows (n, r) that are violated between collocation points."""
    return np.where(violation > 0, BACKOFF * violation + TOLERANCE, 0.0)


def parabolic_peak(values: Array) -> Array:
    """Return the maximum over the last axis of the parabolas through the largest samples.

    The axis (…, n) holds n ≥ 3 evenly spaced samples. The result (…,) is not below the largest
    sample.
    """
    count = values.shape[-1]
    rows = values.reshape(-1, count)
    peak = rows.max(axis=1)
    middle = np.clip(rows.argmax(axis=1), 1, count - 2) + np.arange(len(rows)) * count
    previous, centre, following = (rows.ravel()[middle + k] for k in (-1, 0, 1))
    slope = (following - previous) / 2
    bend = following - 2 * centre + previous
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.clip(np.nan_to_num(-slope / bend), -1.0, 1.0)
    return np.asarray(
        np.maximum(peak, centre + offset * (slope + offset * bend / 2)).reshape(values.shape[:-1])
    )


def chosen_rows(names: list[RowName], values: Array, threshold: float) -> frozenset[RowName]:
    """Return the rows with a value (n, r) above `threshold` in some element.

    Of the torque rows of one motor at several corners of a range of friction and payload, only
    those count that are the largest of them in some element.
    """
    above = values > threshold
    joints = np.array(
        [-1 if name != MotorTorque.name or i is None else i % 4 for name, i in names], dtype=int
    )
    for i in set(joints[joints >= 0].tolist()):
        of_motor = joints == i
        above[:, of_motor] &= values[:, of_motor] >= values[:, of_motor].max(axis=1, keepdims=True)
    return frozenset(names[k] for k in np.flatnonzero(above.any(axis=0)))
