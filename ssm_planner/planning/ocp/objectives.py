"""Objectives in their order: the fastest motion first, then that of least heat or effort.

Ipopt confirms each of them if the method asks for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import motorised
from ssm_planner.elements.element import Aim
from ssm_planner.planning.ocp.nlp import Confirmation, NlpSolution, stretched
from ssm_planner.planning.ocp.problem import OcpProblem
from ssm_planner.planning.ocp.refinement import (
    TOLERANCE,
    RefinedMotion,
    RefinementState,
    solve_to_tolerance,
)
from ssm_planner.planning.ocp.structured import solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.tolerances import GAP, SAME
from ssm_planner.problem import Objective
from ssm_planner.typing import Array

CENTRING = 8
"""Largest number of iterations that centre a solution for Ipopt."""
NOT_CONFIRMED = "Not_Confirmed_By_Ipopt"
LONGER = 1e-3
"""Relative amount by which the motion of least heat may be longer than the fastest motion."""


def find_fastest_motion(
    problem: OcpProblem, guess: Array, duration: float | None = None, *, cutoff: float = np.inf
) -> RefinedMotion:
    """Return the fastest motion as the first solver finds it. `find_best_motion` makes it final.

    Parameters
    ----------
    problem : OcpProblem
        The problem on its first mesh.
    guess : (n, 4 m + 1) array
        Elements of the motion at which the optimisation begins.
    duration : float or None
        Requested duration in scaled time.
    cutoff : float
        Duration in scaled time beyond which the motion is not refined any further.
    """
    cutoff = cutoff if duration is None else (1 + GAP) * duration
    return solve_to_tolerance(RefinementState.from_guess(problem, guess), "time", cutoff=cutoff)


def find_best_motion(
    fastest: RefinedMotion,
    objective: Objective,
    duration: float | None = None,
    *,
    cutoff: float = np.inf,
) -> NlpSolution:
    """Return the motion that is best for an objective, from the fastest motion.

    With the objective "time" this is the fastest motion. With "time then heat" it is the motion of
    least heat among those that are not much longer. With a requested duration it is the motion of
    least effort that takes it, or the fastest motion if that is longer. If `joint_limits` contains
    heat weights (`cooling`), the weighted heat is traded for time instead.

    With the method "confirmed", there is no motion if Ipopt does not confirm the fastest one. The
    caller then tries another method.

    Parameters
    ----------
    fastest : RefinedMotion
        Result of `find_fastest_motion`.
    objective : str
        "time", "time then heat" or "effort".
    duration : float or None
        Requested duration in scaled time.
    cutoff : float
        Duration in scaled time beyond which a motion is of no use.

    Returns
    -------
    NlpSolution
        The motion, or the status of the failure.
    """
    cutoff = cutoff if duration is None else (1 + GAP) * duration
    if not fastest.solution.solved or fastest.solution.duration > cutoff:
        return fastest.solution
    confirmed = _confirm(fastest, "time")
    if confirmed is None:
        return replace(fastest.solution, message=NOT_CONFIRMED)
    if not confirmed.solution.solved or confirmed.solution.duration > (duration or np.inf):
        return confirmed.solution
    cheapest = _of_least_cost(confirmed, objective, duration)
    if cheapest is None:
        return confirmed.solution
    confirmation, of_cost = confirmed.solution.confirmation, cheapest.confirmation
    if confirmation is not None and of_cost is not None:
        both = confirmation.iterations + of_cost.iterations
        confirmation = replace(confirmation, iterations=both)
    iterations = confirmed.solution.iterations + cheapest.iterations
    return replace(cheapest, iterations=iterations, confirmation=confirmation)


def _of_least_cost(
    fastest: RefinedMotion, objective: Objective, duration: float | None
) -> NlpSolution | None:
    """Return the motion of least heat or effort. None if time alone counts, or if there is none."""
    problem = fastest.state.problem
    cooled = bool(problem.joint_limits["cooling"].any())
    if duration is not None:
        return _of_least_effort(fastest, duration, "cooling" if cooled else "effort")
    # Without motors there is no heat to reduce.
    heated = objective != "time" and any(motorised(problem.complete_element.robot.joints))
    return _of_least_heat(fastest, cooled=cooled) if heated or cooled else None


def _of_least_heat(fastest: RefinedMotion, *, cooled: bool) -> NlpSolution | None:
    """Return the motion of least heat that is not much longer than the fastest, or None.

    With heat weights (`cooled`), it is the motion of least weighted sum of time and heat.
    """
    solution, problem = fastest.solution, fastest.state.problem
    if solution.solver == "structured" and problem.has_free_borders:
        # Heat barely depends on when borders are passed, so segments between them would shrink to
        # nothing over many iterations.
        problem = problem.with_one_time(solution.elements[:, -1])
    state = replace(fastest.state, problem=problem).restarted(solution.elements)
    max_duration = np.inf if cooled else (1 + LONGER) * solution.duration
    result = _solve_and_confirm(state, "cooling" if cooled else "heat", (0.0, max_duration))
    return result.solution if result.solution.solved and result.feasible else None


def _of_least_effort(fastest: RefinedMotion, duration: float, aim: Aim) -> NlpSolution:
    """Return the motion of least effort, or of least weighted heat, that takes `duration`."""
    solution = fastest.solution
    guess = stretched(solution.elements, duration / solution.duration)
    state = RefinementState.from_guess(fastest.state.problem, guess)
    result = _solve_and_confirm(state, aim, (duration, duration)).solution
    # Any motion of this duration is better than none.
    return (
        result
        if result.solved
        else solve_to_tolerance(state, "time", duration=(duration, duration)).solution
    )


def _solve_and_confirm(
    state: RefinementState, aim: Aim, duration: tuple[float, float]
) -> RefinedMotion:
    """Return a refined and confirmed motion. If Ipopt does not confirm it, Ipopt refines alone."""
    result = _confirm(solve_to_tolerance(state, aim, duration=duration), aim)
    if result is not None and (result.solution.solved or state.problem.method == "estimated"):
        return result
    by_ipopt = replace(state, problem=replace(state.problem, method="Ipopt"))
    return solve_to_tolerance(by_ipopt, aim, duration=duration)


def _confirm(refined: RefinedMotion, aim: Aim) -> RefinedMotion | None:
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
        structure,
        element,
        data,
        structured.elements,
        warm=structured,
        iterations=CENTRING,
        centred=True,
    )
    start = (centred if centred.solved else structured).elements
    ipopts = Transcription.build(structure, element).solve(data, start, confirming=True)
    problem.work.add_iterations(
        "Ipopt", ipopts.iterations, len(ipopts.elements), costs=aim != "time"
    )
    if not ipopts.solved:
        return None
    own_value, ipopt_value = (
        motion.duration if aim == "time" else motion.objective for motion in (structured, ipopts)
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
