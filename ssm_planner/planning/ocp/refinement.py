"""Refinement of a nonlinear program until its solution keeps all limits at every instant.

A path constraint (row) is a function of the motion at one instant that must not exceed 1. The mesh
divides the motion into elements (time intervals). The program imposes a path constraint only at the
collocation points, which are the start, the middle and the end of each element. To remain small, it
also contains only those constraints that the motion comes close to (the active ones).

After each solution, all path constraints are evaluated at more instants. The first of these steps
that applies is taken, and the program is solved again:

1. A violated constraint that is not active becomes active.
2. An element with a large violation is divided (mesh refinement).
3. The bound of a violated constraint is lowered by a margin (backoff).

`solve_to_tolerance` is the main entry. It returns its final `RefinementState`, from which a later
refinement with another objective can continue.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.elements.element import Aim, ElementModel
from ssm_planner.elements.rows import RowName
from ssm_planner.planning.ocp.nlp import (
    NlpData,
    NlpSolution,
    NlpStructure,
    divide_elements,
)
from ssm_planner.planning.ocp.problem import OcpProblem
from ssm_planner.planning.ocp.structured import solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.work import SOLVE_WORK
from ssm_planner.problem import LensClearance, MotorTorque
from ssm_planner.typing import Array, record

INITIALLY_ACTIVE_SHARE = 0.8
"""Value, as a share of the limit, from which a constraint of the guess is active at the start."""
LIMIT_TOLERANCE = 5e-7
"""Largest excess of a constraint over its limit, as a share of the limit, in a refined motion."""
DIVISION_THRESHOLD = 4e-3
"""Excess of a constraint over its limit, as a share of it, above which the element is divided.

A backoff corrects smaller excesses, so that the number of elements remains small.
"""
DIVERGENCE_THRESHOLD = 1.0
"""Excess over the limit, as a share of it, above which a solution is a bad initial point.

The refinement then starts at the guess again. Without this, random problem 30436 and two missions
with a hot motor (tests/planning/test_continuous_torque.py) have no plan.
"""
PARTS_PER_DIVISION = 3
"""Number of parts into which an element is divided."""
DIVISION_ROUNDS = 2
"""Number of rounds at the beginning of a refinement that may divide elements.

A solve on a new mesh must start without multipliers, so it takes more iterations.
"""
BACKOFF_FACTOR = 2.0
"""Ratio of the additional backoff of a constraint to its violation.

A ratio above 1 makes a second violation unlikely.
"""
MAX_SOLVES = 12
"""Largest number of solves.

A motion that still violates a limit then is left to the independent check. None of 311 problems of
tests/benchmarks needed so many solves.
"""
NlpProgram = tuple[NlpStructure, ElementModel, NlpData]
"""A nonlinear program: its structure, the functions of one element (time interval), its data."""


@record
class RefinementState:
    """State of a refinement between two solves of the nonlinear program.

    A refinement solves the program repeatedly, with more path constraints, a finer mesh, or tighter
    bounds, until the motion keeps all limits at every instant. A path constraint is a function of
    the motion at one instant that must not exceed 1. Elements are the time intervals of the mesh.
    Arrays of elements (n, 4 m + 1) contain u, u̇, ü at the start and ü at the end of each element (a
    number for each of m coordinates u), and its length.
    """

    guess: Array
    """Elements of the guess at which the refinement began, (n, 4 m + 1).

    Their number n is that of the first mesh, which may be smaller than that of `elements`.
    """
    problem: OcpProblem
    """Optimal control problem on the present mesh."""
    active: frozenset[RowName]
    """Names and joints of the path constraints that are part of the program, the active ones."""
    backoff: Array
    """Amounts by which the bounds of all r path constraints are lowered in each element, (n, r)."""
    elements: Array
    """Elements of the latest solution, or those of the guess, (n, 4 m + 1)."""
    warm: NlpSolution | None = None
    """Solution at whose variables and multipliers the next solve starts (a warm start).

    None: the next solve starts at `elements`, without multipliers.
    """

    @classmethod
    def from_guess(cls, problem: OcpProblem, guess: Array) -> "RefinementState":
        """Create the initial state of a refinement.

        At first, the program contains only the path constraints that exceed the share
        `INITIALLY_ACTIVE_SHARE` of their limits in the guess, and those that are always active. A
        path constraint is a function of the motion that must not exceed 1.

        Parameters
        ----------
        problem : OcpProblem
            The optimal control problem.
        guess : (n, 4 m + 1) array
            Elements (time intervals) of the guess: u, u̇, ü at the start, ü at the end (m numbers
            each), and length.

        Returns
        -------
        RefinementState
            The state, without backoff and without multipliers.
        """
        active = problem.always_active | constraints_above(
            problem.row_names, problem.row_maxima(guess), INITIALLY_ACTIVE_SHARE
        )
        backoff = np.zeros((len(guess), len(problem.row_names)))
        return cls(guess, problem, active, backoff, elements=guess)

    def program(self, aim: Aim, duration: tuple[float, float] | None) -> NlpProgram:
        """Build the nonlinear program for the next solve.

        Parameters
        ----------
        aim : str
            Cost in addition to time: "time" (none), "heat" or "cooling" (heat of the motors without
            or with weights), or "effort" (torque that the speed needs).
        duration : (float, float) or None
            Smallest and largest duration of a motion of least cost, in scaled time. None: the
            duration is minimised.

        Returns
        -------
        NlpProgram
            Structure, functions of one element (time interval) with the active constraints, and
            data.
        """
        structure = self.problem.structure
        element = self.problem.element(self.active, aim)
        is_active = [name in self.active for name in self.problem.row_names]
        # A backoff of −∞ gives an infinite bound, so the constraint does not apply.
        backoff = np.where(self.problem.ignored_rows, -np.inf, self.backoff)
        data = self.problem.data(self.elements, backoff[:, is_active])
        if duration is not None:
            # The objective is the cost alone. Weighted heat is compared with time, so both count.
            time_weight = float(aim == "cooling")
            data = replace(data, duration=duration, weights=(time_weight, 1.0))
        return structure, element, data

    def solve(self, program: NlpProgram) -> NlpSolution:
        """Solve a nonlinear program with the solver that the problem's method names.

        The solver starts at the latest motion.

        Parameters
        ----------
        program : NlpProgram
            Structure, functions of one element (time interval), and data. The method `program`
            builds them.

        Returns
        -------
        NlpSolution
            The solution, or the status of the failure.
        """
        structure, element, data = program
        if self.problem.method == "Ipopt":
            return Transcription.build(structure, element).solve(data, self.elements)
        # The constraint of the lens has rounded edges, so the barrier must decrease slowly.
        limits_lens = any(name == LensClearance.name for name, _ in self.active)
        return solve_structured(
            structure, element, data, self.elements, warm=self.warm, slow_barrier=limits_lens
        )

    def with_divided_elements(self, coarse: Array) -> "RefinementState":
        """Return the state with some elements divided into `PARTS_PER_DIVISION` equal parts.

        Elements are the time intervals of the mesh. The parts of an element keep its backoff, that
        is, the margins by which the bounds of its path constraints are lowered.

        Parameters
        ----------
        coarse : (n,) mask
            True for the elements that are divided.

        Returns
        -------
        RefinementState
            The state on the finer mesh. The next solve starts without multipliers, because those of
            the last solution have the wrong number.
        """
        counts = np.where(coarse, PARTS_PER_DIVISION, 1)
        elements = divide_elements(self.elements, counts)
        backoff = np.repeat(self.backoff, counts, axis=0)
        return replace(
            self,
            problem=self.problem.with_divided_elements(counts),
            elements=elements,
            backoff=backoff,
            warm=None,
        )


@record
class RefinedMotion:
    """Result of a refinement: the motion, and whether it keeps all limits at every instant."""

    solution: NlpSolution
    """Latest solution. Its number of iterations is the sum over all solves of the refinement."""
    state: RefinementState
    """State of the refinement at its end."""
    feasible: bool
    """True if no path constraint exceeds its limit by more than the share `LIMIT_TOLERANCE`."""
    program: NlpProgram
    """Program that was solved last."""


def solve_to_tolerance(
    state: RefinementState,
    aim: Aim,
    *,
    duration: tuple[float, float] | None = None,
    cutoff: float = np.inf,
) -> RefinedMotion:
    """Solve the nonlinear program of an optimal control problem until the motion keeps all limits.

    Between two solves, `_next_state` refines the program: more path constraints become part of it,
    elements (time intervals) are divided, or bounds are lowered. The function adds the work of all
    solves to the counter of the problem.

    Parameters
    ----------
    state : RefinementState
        Initial state, with the problem and the guess.
    aim : str
        Cost in addition to time: "time" (none), "heat" or "cooling" (heat of the motors without or
        with weights), or "effort" (torque that the speed needs).
    duration : (float, float) or None
        Smallest and largest duration of a motion of least cost, in scaled time. None: the duration
        is minimised.
    cutoff : float
        Duration in scaled time beyond which a motion is of no use. The refinement ends when the
        motion takes longer, because each refinement makes the motion longer, not shorter.

    Returns
    -------
    RefinedMotion
        The latest solution with the final state. If a solve failed, the motion took longer than
        `cutoff`, or `MAX_SOLVES` solves did not suffice, the solution may violate limits.
    """
    iterations, work = 0, state.problem.work
    feasible = False
    for round_number in range(1, MAX_SOLVES + 1):
        program = state.program(aim, duration)
        solution = state.solve(program)
        iterations += solution.iterations
        work.spent += SOLVE_WORK
        work.add_iterations(
            solution.solver, solution.iterations, len(solution.elements), costs=aim != "time"
        )
        state = replace(state, elements=solution.elements)
        # A failed solve cannot be refined, and a motion beyond the cutoff is of no use.
        if not solution.solved or solution.duration > cutoff:
            break
        # Excess of each path constraint over its limit in each element, (n, r). The initial value
        # of the maximum serves programs without path constraints.
        violation = state.problem.row_maxima(solution.elements) - 1
        feasible = bool(violation.max(initial=-1.0) <= LIMIT_TOLERANCE)
        if feasible or round_number == MAX_SOLVES:
            break
        may_divide = aim != "heat" and round_number <= DIVISION_ROUNDS
        state = _next_state(state, solution, violation, may_divide=may_divide)
    return RefinedMotion(replace(solution, iterations=iterations), state, feasible, program=program)


def _next_state(
    state: RefinementState, solution: NlpSolution, violation: Array, *, may_divide: bool
) -> RefinementState:
    """Return the state for the next solve, after a solution that violates limits.

    A path constraint is a function of the motion that must not exceed 1, and it is active if it is
    part of the program. The function takes the first of these steps that applies.

    1. Violated constraints that are not active become active. If the largest violation exceeds
       `DIVERGENCE_THRESHOLD`, the next solve starts at the guess again.
    2. Elements (time intervals) whose violations exceed `DIVISION_THRESHOLD` are divided, if
       `may_divide` is true.
    3. The bounds of violated constraints are lowered (backoff).

    Parameters
    ----------
    state : RefinementState
        State of the last solve.
    solution : NlpSolution
        Solution of the last solve.
    violation : (n, r) array
        Excess of every path constraint over its limit in every element, as a share of the limit.
    may_divide : bool
        True if elements may be divided.

    Returns
    -------
    RefinementState
        The state. Only step 3 lets the next solve start at the multipliers of the last solution.
        Steps 1 and 2 change the number of constraints, so these multipliers no longer fit.
    """
    # Violated constraints that are not part of the program.
    missed = constraints_above(state.problem.row_names, violation, LIMIT_TOLERANCE) - state.active
    if missed:
        state = replace(state, active=state.active | missed)
        # A new start is possible only if no element has been divided since the guess.
        if violation.max() > DIVERGENCE_THRESHOLD and len(state.elements) == len(state.guess):
            state = replace(state, elements=state.guess)
        return replace(state, warm=None)
    coarse = violation.max(axis=1) > DIVISION_THRESHOLD
    if may_divide and coarse.any():
        return state.with_divided_elements(coarse)
    # The program imposes a path constraint only at three instants of each element. The next solve
    # requires a distance from the limit there, so that the motion keeps the limit in between.
    return replace(state, backoff=state.backoff + additional_backoff(violation), warm=solution)


def additional_backoff(violation: Array) -> Array:
    """Compute the amounts by which the bounds of violated path constraints are lowered further.

    The amount for a violation e > 0 is BACKOFF_FACTOR · e + LIMIT_TOLERANCE.

    Parameters
    ----------
    violation : (n, r) array
        Excess of each of r path constraints over its limit in each of n elements (time intervals),
        as a share of the limit. It is negative where the limit is kept.

    Returns
    -------
    (n, r) array
        The amounts, 0 where no limit is violated.
    """
    return np.where(violation > 0, BACKOFF_FACTOR * violation + LIMIT_TOLERANCE, 0.0)


def constraints_above(names: list[RowName], values: Array, threshold: float) -> frozenset[RowName]:
    """Select the path constraints that exceed a threshold in at least one element.

    If the friction or the payload is given as a range, a motor has one torque constraint for each
    extreme of the range. In each element, only the largest torque constraint of a motor counts. This
    rule keeps the number of constraints in the program small.

    Parameters
    ----------
    names : list of RowName
        Names and joints of all r constraints.
    values : (n, r) array
        Largest value of each constraint in each element (time interval), or its excess over the
        limit.
    threshold : float
        Value above which a constraint is selected.

    Returns
    -------
    frozenset of RowName
        Names and joints of the selected constraints.
    """
    above = values > threshold
    # Index of the motor that each constraint belongs to, or −1 for other constraints. The
    # second entry of a torque constraint's name is joint + 4 k with the index k of the extreme (see
    # `RowName`), so its remainder modulo 4 is the joint.
    motors = np.array(
        [-1 if name != MotorTorque.name or i is None else i % 4 for name, i in names], dtype=int
    )
    for motor in set(motors[motors >= 0].tolist()):
        of_motor = motors == motor
        above[:, of_motor] &= values[:, of_motor] >= values[:, of_motor].max(axis=1, keepdims=True)
    return frozenset(names[k] for k in np.flatnonzero(above.any(axis=0)))
