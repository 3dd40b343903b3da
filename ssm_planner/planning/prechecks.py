"""Checks before any solver runs: phases, feasibility of places, and lower bounds of durations."""

from __future__ import annotations

import numpy as np

from ssm_planner.kinematics import Mechanism, task_rates
from ssm_planner.planning.feasibility import infeasible_place, with_boundary_rates
from ssm_planner.planning.lower_bound import lower_bound, rate_bound
from ssm_planner.planning.motor_strength import motor_too_hot
from ssm_planner.planning.phases import Phase, phases_from, start_configurations
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.tolerances import SAME
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
        reason = infeasible_place(problem, mechanism, phases)
        if reason is None:
            return with_boundary_rates(problem, mechanism, phases)
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
    return None if reason is not None else motor_too_hot(problem, phases)


def least_duration(problem: Problem, mechanism: Mechanism, phase: Phase) -> float:
    """Return a duration that no motion between the ends of a phase can beat, s."""
    speeds = np.stack([phase.qd_start, phase.qd_end])
    rates = task_rates(mechanism, phase.points[[0, -1]], speeds)
    by_rates = rate_bound(
        problem.robot, np.stack([phase.start, phase.end]), rates, problem.task_limits
    )
    return max(lower_bound(problem.robot, phase.points, speeds, problem.task_limits), by_rates)


def bounded_duration(problem: Problem, mechanism: Mechanism, phase: Phase) -> float:
    """Return the least duration of a phase, s: the requested one, or its lower bound.

    It is infinite if the requested duration is shorter than the bound.
    """
    duration = phase.motion.duration
    if phase.stands:
        return duration or 0.0
    bound = least_duration(problem, mechanism, phase)
    return bound if duration is None else duration if bound <= duration * (1 + SAME) else np.inf
