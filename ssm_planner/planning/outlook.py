"""What is known of a problem before anything is solved: its phases, whether they can be, and what they take at least."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.planning.feasibility import infeasible_place, motor_too_hot, with_boundary_rates
from ssm_planner.planning.kept import SameObject, kept
from ssm_planner.planning.lower_bound import lower_bound, rate_bound
from ssm_planner.planning.phases import Phase, phases_from, start_configurations
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.problem import Problem

LONGER = 1e-6
"""Share by which a motion may take longer than the duration asked for."""


def feasible_phases(
    problem: Problem, mechanism: Mechanism
) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases of a problem with the speeds at both ends, or the reason why no start configuration carries it.

    Start configurations are tried from the home branch and the one nearest to q = 0 on; the first whose joints stay in
    range all along is taken. Raises ProblemError for a point out of reach or a motion that goes nowhere.
    """
    return kept(("feasible", *geometry_of(problem)), lambda: _feasible_phases(problem, mechanism))


def geometry_of(problem: Problem) -> tuple[Hashable, ...]:
    """What the phases of a problem and their bounds depend on, to know it by; neither motors nor a duration of the whole."""
    robot = problem.robot
    joints = (
        (j.position, j.velocity, j.acceleration, j.jerk, SameObject(j.drive)) for j in robot.joints
    )
    rates = (tuple(sorted(rate.items())) for rate in (problem.start_rate, problem.end_rate))
    own = problem.start, problem.start_acceleration, problem.limits, robot.limits, *rates
    return *map(SameObject, (robot.geometry, problem.eye, *problem.motion)), *joints, *own


def _feasible_phases(
    problem: Problem, mechanism: Mechanism
) -> tuple[tuple[Phase, ...], Reason | None]:
    reasons = []
    for q in start_configurations(problem, mechanism):
        phases = phases_from(problem, mechanism, q)
        reason = infeasible_place(problem, mechanism, phases)
        if reason is None:
            return with_boundary_rates(problem, mechanism, phases)
        reasons.append(reason)
    return (), reasons[0]


def hopelessly_hot(problem: Problem) -> Reason | None:
    """The motor whose continuous torque no motion keeps, however slow; None where that is not certain without planning."""
    phases, reason = feasible_phases(problem, Mechanism.from_geometry(problem.robot.geometry))
    return None if reason is not None else motor_too_hot(problem, phases)


def least_duration(problem: Problem, mechanism: Mechanism, phase: Phase) -> float:
    """A duration that no motion between the ends of a phase can beat, s."""
    speeds = np.stack([phase.qd_start, phase.qd_end])
    rates = task_rates(mechanism, phase.points[[0, -1]], speeds)
    found = rate_bound(
        problem.robot, np.stack([phase.start, phase.end]), rates, problem.task_limits
    )
    return max(lower_bound(problem.robot, phase.points, speeds, problem.task_limits), found)


def bounded_duration(problem: Problem, mechanism: Mechanism, phase: Phase) -> float:
    """What a phase takes at least, s: what it is asked to take, or infinite where that is less than its bound."""
    asked = phase.motion.duration
    if phase.stands:
        return asked or 0.0
    bound = least_duration(problem, mechanism, phase)
    return bound if asked is None else asked if bound <= asked * (1 + LONGER) else np.inf
