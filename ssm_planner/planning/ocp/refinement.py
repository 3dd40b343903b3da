"""Refinement of a transcription until the true motion keeps all limits.

The program has path constraints only at collocation points, and only the active ones. After each
solution, every constraint is evaluated densely on the true path. A violated row that is not active
becomes active, an element with a large violation is cut (mesh refinement), and a small violation
lowers the bound of its row (backoff). Then the program is solved again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.elements.element import Aim, ElementModel
from ssm_planner.elements.rows import RowName
from ssm_planner.planning.ocp.nlp import (
    NlpData,
    NlpSolution,
    NlpStructure,
    split,
)
from ssm_planner.planning.ocp.problem import OcpProblem
from ssm_planner.planning.ocp.structured import solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.work import SOLVE
from ssm_planner.problem import LensClearance, MotorTorque
from ssm_planner.typing import Array, record

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
ROUNDS = 12
"""Largest number of solves.

A motion that still violates a row then is left to the independent check. None of 311 problems of
tests/benchmarks needed that many.
"""
NlpProgram = tuple[NlpStructure, ElementModel, NlpData]


@record
class RefinementState:
    """State of a refinement."""

    guess: Array
    """Elements of the guess at which the refinement began, (n, 4 m + 1)."""
    problem: OcpProblem
    active: frozenset[RowName]
    backoff: Array
    """Backoff of all rows, (n, r)."""
    elements: Array
    """Latest solution, or the guess, (n, 4 m + 1)."""
    warm: NlpSolution | None = None
    """Solution whose multipliers are those at which the next solve starts."""

    @classmethod
    def from_guess(cls, problem: OcpProblem, guess: Array) -> RefinementState:
        """Begin a refinement. The rows that the guess comes near to are active."""
        active = problem.always_active | chosen_rows(
            problem.row_names, problem.row_maxima(guess), NEAR
        )
        backoff = np.zeros((len(guess), len(problem.row_names)))
        return cls(guess, problem, active, backoff, elements=guess)

    def restarted(self, guess: Array) -> RefinementState:
        """Return the state with another guess, and with the same active rows and backoff."""
        return replace(self, guess=guess, elements=guess, warm=None)

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

    def solve(self, program: NlpProgram) -> NlpSolution:
        """Solve the program with the solver that the method requires."""
        structure, element, data = program
        if self.problem.method == "Ipopt":
            return Transcription.build(structure, element).solve(data, self.elements, self.warm)
        beside_lens = any(name == LensClearance.name for name, _ in self.active)
        return solve_structured(
            structure, element, data, self.elements, warm=self.warm, switching=beside_lens
        )

    def cut(self, coarse: Array) -> RefinementState:
        """Return the state with the coarse elements (n,) cut into PARTS.

        The parts keep the backoff.
        """
        counts = np.where(coarse, PARTS, 1)
        elements = split(self.elements, counts)
        backoff = np.repeat(self.backoff, counts, axis=0)
        return replace(
            self,
            problem=self.problem.with_cut_elements(counts),
            elements=elements,
            backoff=backoff,
            warm=None,
        )

    def tightened(self, solution: NlpSolution, increase: Array) -> RefinementState:
        """Return the state with more backoff (n, r). The next solve is warm from the solution."""
        return replace(self, backoff=self.backoff + increase, warm=solution)


@record
class RefinedMotion:
    """Latest solution with the iterations of all rounds, and the state in which it was found."""

    solution: NlpSolution
    state: RefinementState
    feasible: bool
    """True if no row is violated between the collocation points."""
    program: NlpProgram
    """Program that was solved last."""


def solve_to_tolerance(
    state: RefinementState,
    aim: Aim,
    *,
    duration: tuple[float, float] | None = None,
    cutoff: float = np.inf,
) -> RefinedMotion:
    """Solve, find the violations and refine, until the motion keeps all limits.

    Parameters
    ----------
    state : RefinementState
        Initial state.
    aim : str
        Cost that is added to time.
    duration : (float, float) or None
        Bounds of the duration. None if the duration is minimised.
    cutoff : float
        Duration beyond which the refinement ends, since it only makes a motion longer.
    """
    iterations, work = 0, state.problem.work
    feasible = False
    for k in range(1, ROUNDS + 1):
        program = state.program(aim, duration)
        solution = state.solve(program)
        iterations += solution.iterations
        work.spent += SOLVE
        work.add_iterations(
            solution.solver, solution.iterations, len(solution.elements), costs=aim != "time"
        )
        state = replace(state, elements=solution.elements)
        if not solution.solved or solution.duration > cutoff:
            break
        violation = state.problem.row_maxima(solution.elements) - 1
        feasible = bool(violation.max(initial=-1.0) <= TOLERANCE)
        if feasible or k == ROUNDS:
            break
        state = _next_state(state, solution, violation, k, may_cut=aim != "heat")
    return RefinedMotion(replace(solution, iterations=iterations), state, feasible, program=program)


def _next_state(
    state: RefinementState, solution: NlpSolution, violation: Array, k: int, *, may_cut: bool
) -> RefinementState:
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
        if violation.max() > DIVERGED and len(state.elements) == len(state.guess):
            return state.restarted(state.guess)
        return replace(state, warm=None)
    coarse = violation.max(axis=1) > COARSE
    if may_cut and k <= CUTS and coarse.any():
        return state.cut(coarse)
    return state.tightened(solution, backoff_of(violation))


def backoff_of(violation: Array) -> Array:
    """Return the backoff of rows (n, r) that are violated between collocation points."""
    return np.where(violation > 0, BACKOFF * violation + TOLERANCE, 0.0)


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
