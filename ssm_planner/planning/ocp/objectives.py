"""Optimisation of one motion for the objective of a problem: duration, heat or effort.

`find_fastest_motion` computes the motion of least duration. From there, `find_best_motion` computes
the motion of least heat of the motors, or of least effort (torque that the speed needs), if the
objective or a requested duration asks for one. If the solution method is "confirmed", the
structured solver (`ocp.structured`) computes both motions, and Ipopt confirms them.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import motorised_joints
from ssm_planner.elements.element import Aim
from ssm_planner.planning.ocp.nlp import Confirmation, NlpSolution, stretched
from ssm_planner.planning.ocp.problem import OcpProblem
from ssm_planner.planning.ocp.refinement import (
    LIMIT_TOLERANCE,
    RefinedMotion,
    RefinementState,
    solve_to_tolerance,
)
from ssm_planner.planning.ocp.structured import solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, GAP
from ssm_planner.typing import Array

CENTRING_ITERATIONS = 8
"""Largest number of iterations of the structured solver that centre a solution before Ipopt starts.

A slack is the distance of a constraint from its bound. Near the central path, the product of slack
and multiplier is equal for all constraints. Ipopt then computes nearly exact multipliers from the
slacks.
"""
NOT_CONFIRMED = "Not_Confirmed_By_Ipopt"
"""Message of a solution that Ipopt did not confirm."""
LEAST_HEAT_EXTRA_TIME = 1e-3
"""Relative amount by which the motion of least heat may take longer than the fastest motion.

The objective "time then heat" gives up so much time to save heat.
"""


def find_fastest_motion(problem: OcpProblem, guess: Array, cutoff: float = np.inf) -> RefinedMotion:
    """Compute the motion of least duration, with the solver that the problem's method tries first.

    Ipopt does not confirm the motion yet. `find_best_motion` continues from the result.

    Parameters
    ----------
    problem : OcpProblem
        The optimal control problem on its first mesh.
    guess : (n, 4 m + 1) array
        Motion at which the optimisation begins: u, u̇, ü at the start, ü at the end (a number for
        each of the m coordinates), and length of each element (time interval).
    cutoff : float
        Duration in s beyond which a motion is of no use. Such a motion is not refined further, so
        it may violate limits. A requested duration replaces it.

    Returns
    -------
    RefinedMotion
        The solution with the state of its refinement.
    """
    state = RefinementState.from_guess(problem, guess)
    return solve_to_tolerance(state, "time", cutoff=_scaled_cutoff(problem, cutoff))


def find_best_motion(fastest: RefinedMotion, cutoff: float = np.inf) -> NlpSolution:
    """Compute the motion that is best for the objective, starting from the fastest motion.

    - With the objective "time", it is the fastest motion.
    - With the objective "time then heat", it has the least heat among the motions that take at most
      a share `LEAST_HEAT_EXTRA_TIME` more time than the fastest one.
    - If a duration is requested, it has the least effort (torque that the speed needs) among the
      motions of this duration. If the fastest motion takes longer, it is the fastest motion.
    - If motors have heat weights (`joint_limits["cooling"]`), it has the least weighted sum of heat
      and time, or the least weighted heat in the requested duration.

    If the method is "confirmed" and Ipopt does not confirm the fastest motion, the result is a
    failure with the message `NOT_CONFIRMED`. The caller then tries another method.

    Parameters
    ----------
    fastest : RefinedMotion
        Result of `find_fastest_motion`.
    cutoff : float
        Duration in s beyond which a motion is of no use. A requested duration replaces it.

    Returns
    -------
    NlpSolution
        The motion, or the status of the failure.
    """
    problem = fastest.state.problem
    longest = _scaled_cutoff(problem, cutoff)
    if not fastest.solution.solved or fastest.solution.duration > longest:
        return fastest.solution
    confirmed = _confirm(fastest, "time")
    if confirmed is None:
        return replace(fastest.solution, message=NOT_CONFIRMED)
    too_long = confirmed.solution.duration > (problem.requested_duration or np.inf)
    if not confirmed.solution.solved or too_long:
        return confirmed.solution
    cheapest = _least_cost_motion(confirmed)
    if cheapest is None:
        return confirmed.solution
    # The result counts the iterations of both motions.
    confirmation, cost_confirmation = confirmed.solution.confirmation, cheapest.confirmation
    if confirmation is not None and cost_confirmation is not None:
        total = confirmation.iterations + cost_confirmation.iterations
        confirmation = replace(confirmation, iterations=total)
    iterations = confirmed.solution.iterations + cheapest.iterations
    return replace(cheapest, iterations=iterations, confirmation=confirmation)


def _scaled_cutoff(problem: OcpProblem, cutoff: float) -> float:
    """Return the duration in scaled time beyond which a motion is of no use.

    Parameters
    ----------
    problem : OcpProblem
        The optimal control problem.
    cutoff : float
        Such a duration in s for a motion without a requested duration.
    """
    duration = problem.requested_duration
    # A motion that exceeds the requested duration by less than `GAP` is still refined.
    return cutoff / problem.time_scale if duration is None else (1 + GAP) * duration


def _least_cost_motion(fastest: RefinedMotion) -> NlpSolution | None:
    """Compute the motion of least heat or effort of the motors, starting from the fastest motion.

    If a duration is requested, the motion has the least effort (torque that the speed needs), or
    the least weighted heat if motors have heat weights. Otherwise it has the least heat, or the
    least weighted sum of heat and time if motors have heat weights.

    Parameters
    ----------
    fastest : RefinedMotion
        The fastest motion, which Ipopt has confirmed if the method requires it.

    Returns
    -------
    NlpSolution or None
        The motion, or the status of a failure if a duration is requested. None if only the time
        counts, or if no duration is requested and the solver finds no such motion.
    """
    solution, problem = fastest.solution, fastest.state.problem
    duration = problem.requested_duration
    cooled = bool(problem.joint_limits["cooling"].any())
    if duration is not None:
        # The fastest motion, stretched in time, is the guess.
        guess = stretched(solution.elements, duration / solution.duration)
        state = RefinementState.from_guess(problem, guess)
        interval = duration, duration
        result = _solve_and_confirm(state, "cooling" if cooled else "effort", interval)
        if not result.solution.solved:
            # The solver found no motion of least cost, so any motion of this duration is accepted.
            result = solve_to_tolerance(state, "time", duration=interval)
        return result.solution
    # Without motors there is no heat to reduce.
    robot, objective = problem.phase.problem.robot, problem.phase.problem.objective
    heated = objective != "time" and any(motorised_joints(robot.joints))
    if not (heated or cooled):
        return None
    has_free_borders = np.isnan(problem.boundary.points).any()
    if solution.solver == "structured" and has_free_borders:
        # A free border is a reversal whose position the solver chooses. Heat barely depends on when
        # the motion passes it. If the segments between borders had separate durations, some of them
        # would shrink to nothing over many iterations.
        problem = problem.with_single_block(solution.elements[:, -1])
    elements = solution.elements
    state = replace(fastest.state, problem=problem, guess=elements, elements=elements, warm=None)
    longest = np.inf if cooled else (1 + LEAST_HEAT_EXTRA_TIME) * solution.duration
    result = _solve_and_confirm(state, "cooling" if cooled else "heat", (0.0, longest))
    return result.solution if result.solution.solved and result.feasible else None


def _solve_and_confirm(
    state: RefinementState, aim: Aim, duration: tuple[float, float]
) -> RefinedMotion:
    """Compute the motion of least cost that keeps all limits, and let Ipopt confirm it.

    If the solution or its confirmation fails, Ipopt solves the program alone, from the same initial
    state. A motion that only serves to estimate a duration is not solved again.

    Parameters
    ----------
    state : RefinementState
        Initial state, with the problem and the guess.
    aim : str
        Cost that is minimised: "heat" or "cooling" (heat of the motors without or with weights), or
        "effort" (torque that the speed of the motion needs).
    duration : (float, float)
        Smallest and largest duration in scaled time.

    Returns
    -------
    RefinedMotion
        The motion, or the status of the failure.
    """
    result = _confirm(solve_to_tolerance(state, aim, duration=duration), aim)
    if result is not None and (result.solution.solved or state.problem.method == "estimated"):
        return result
    by_ipopt = replace(state, problem=replace(state.problem, method="Ipopt"))
    return solve_to_tolerance(by_ipopt, aim, duration=duration)


def _confirm(refined: RefinedMotion, aim: Aim) -> RefinedMotion | None:
    """Let Ipopt confirm an optimum of the structured solver.

    Ipopt starts at this optimum and solves the same program. If both solvers agree, the result is
    the structured solver's motion, because it satisfies the dynamics exactly even in very short
    elements (time intervals). If Ipopt's motion is shorter (or cheaper) by more than the share
    `EQUALITY_TOLERANCE`, the result is Ipopt's motion. A motion is returned unchanged if the method
    of the problem asks for no confirmation, or if the structured solver has not converged.

    Parameters
    ----------
    refined : RefinedMotion
        Motion to confirm, with the program that was solved last.
    aim : str
        Cost that was minimised. With "time", the durations of both solvers are compared, otherwise
        the values of the objective.

    Returns
    -------
    RefinedMotion or None
        The motion, with a `Confirmation` if Ipopt was used. None if Ipopt fails, or if its better
        motion violates a limit between the collocation points, the instants at which the program
        imposes its path constraints. Such a motion would have to be refined, so it confirms
        nothing.
    """
    structured, problem = refined.solution, refined.state.problem
    if problem.method != "confirmed" or structured.solver != "structured" or not structured.solved:
        return refined
    structure, element, data = refined.program
    # Ipopt computes its first multipliers from the slacks. They are nearly exact only near the
    # central path (`CENTRING_ITERATIONS`), so the structured solver first approaches it.
    centred = solve_structured(
        structure,
        element,
        data,
        structured.elements,
        warm=structured,
        iterations=CENTRING_ITERATIONS,
        centred=True,
    )
    start = (centred if centred.solved else structured).elements
    ipopt_solution = Transcription.build(structure, element).solve(data, start, confirming=True)
    problem.work.add_iterations(
        "Ipopt", ipopt_solution.iterations, len(ipopt_solution.elements), costs=aim != "time"
    )
    if not ipopt_solution.solved:
        return None
    structured_value, ipopt_value = (
        motion.duration if aim == "time" else motion.objective
        for motion in (structured, ipopt_solution)
    )
    difference = ipopt_value / structured_value - 1 if structured_value else 0.0
    # Ipopt's better motion is only useful if it keeps the limits between collocation points too.
    better = difference < -EQUALITY_TOLERANCE
    if (
        better
        and problem.row_maxima(ipopt_solution.elements).max(initial=0.0) > 1 + LIMIT_TOLERANCE
    ):
        return None
    solution = replace(
        ipopt_solution if better else structured,
        iterations=structured.iterations + ipopt_solution.iterations,
        confirmation=Confirmation(ipopt_solution.iterations, difference, ipopt_solution.residual),
    )
    return replace(
        refined, solution=solution, state=replace(refined.state, elements=solution.elements)
    )
