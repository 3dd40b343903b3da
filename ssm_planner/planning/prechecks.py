"""Checks before any solver runs: phases, and feasibility of places."""

from __future__ import annotations

from ssm_planner.kinematics import Mechanism
from ssm_planner.planning.feasibility import infeasible_place, with_boundary_rates
from ssm_planner.planning.motor_strength import motor_too_hot
from ssm_planner.planning.phases import Phase, phases_from, start_configurations
from ssm_planner.planning.reason import Reason
from ssm_planner.problem import LensClearance, Problem, RetinaClearance


def feasible_phases(
    problem: Problem, mechanism: Mechanism
) -> tuple[tuple[Phase, ...], Reason | None]:
    """Return the phases of a problem, or the reason why no start configuration allows them.

    Start configurations are tried in order, from the home branch and the one nearest to q = 0. The
    first one is taken whose joints stay in range on all phases. The phases contain the rates at
    both ends.

    Raises
    ------
    ProblemError
        If a point is out of reach, or if no motion goes anywhere.
    """
    reasons = []
    for q in start_configurations(problem, mechanism):
        phases = phases_from(problem, mechanism, q)
        reason = infeasible_place(phases)
        if reason is None:
            return with_boundary_rates(phases)
        reasons.append(reason)
        if isinstance(reason.limit, (RetinaClearance, LensClearance)):
            # All joint solutions bring the tip to the same place, so other start configurations
            # do not help.
            break
    return (), reasons[0]


def eye_forbids_target(problem: Problem) -> bool:
    """Return True if the eye forbids a place that the problem gives.

    Other joints cannot change that.
    """
    _, reason = feasible_phases(problem, Mechanism.from_robot(problem.robot))
    return reason is not None and isinstance(reason.limit, (RetinaClearance, LensClearance))


def exceeds_thermal_bound(problem: Problem) -> Reason | None:
    """Return the motor whose continuous torque every motion exceeds, however slow it is.

    None if that is not certain without planning.
    """
    phases, reason = feasible_phases(problem, Mechanism.from_robot(problem.robot))
    return None if reason is not None else motor_too_hot(phases)
