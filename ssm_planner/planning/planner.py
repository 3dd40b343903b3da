"""From a problem to a trajectory: legs, TOPP-RA and optimal control per leg, joined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.trajectory import Trajectory, hermite, hold, join
from ssm_planner.planning.bound import lower_bound
from ssm_planner.planning.diagnosis import no_motion
from ssm_planner.planning.free_ocp import solve_free
from ssm_planner.planning.joint_path import StepPath, TravelledPath
from ssm_planner.planning.legs import Leg, legs_of
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming import retime
from ssm_planner.planning.straight import plan_straight
from ssm_planner.problem.values import Array, Problem


@dataclass(frozen=True, eq=False)
class PlannedLeg:
    """A leg with its duration, TOPP-RA's duration for the same path and limits, and the solver's account."""

    leg: Leg
    duration: float
    toppra_duration: float | None
    """None where TOPP-RA finds no motion along the path that was taken."""
    lower_bound: float
    """A duration that no motion within the same limits can beat."""
    iterations: int


@dataclass(frozen=True, eq=False)
class Planned:
    """status: "solved", "infeasible" or "not converged"; trajectory None and a reason unless solved."""

    status: str
    trajectory: Trajectory | None
    legs: tuple[PlannedLeg, ...]
    reason: Reason | None


def plan_motion(
    problem: Problem, tighten: Array | None = None, progress: Callable[[str], None] = lambda _: None
) -> Planned:
    """Plan every leg of a problem, each from rest to rest.

    tighten (4, 4): factors ≤ 1 on velocity, acceleration, jerk and torque limits (rows) by joint (columns).
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    legs, reason = legs_of(problem, mechanism)
    if reason is not None:
        return Planned("infeasible", None, (), reason)
    planned: list[PlannedLeg] = []
    parts = []
    for leg in legs:
        progress(leg.motion.name)
        outcome = _PLANNERS[leg.motion.kind](problem, mechanism, leg, tighten)
        if isinstance(outcome, Reason):
            status = "infeasible" if outcome.constraint != "solver" else "not converged"
            return Planned(status, None, tuple(planned), outcome)
        done, breaks, coefficients = outcome
        planned.append(done)
        parts.append((leg.motion.name, breaks, coefficients))
    return Planned("solved", join(parts), tuple(planned), None)


Outcome = tuple[PlannedLeg, Array, Array]
"""A planned leg and its pieces: breaks from 0, coefficients."""


def _dwell(problem: Problem, mechanism: Mechanism, leg: Leg, tighten: Array | None) -> Outcome | Reason:
    duration = float(leg.motion.duration or 0.0)
    return PlannedLeg(leg, duration, duration, duration, 0), np.array([0.0, duration]), hold(leg.first)


def _straight(problem: Problem, mechanism: Mechanism, leg: Leg, tighten: Array | None) -> Outcome | Reason:
    path = leg.straight
    retiming = retime(path, problem.robot, tip_speed=problem.tip_speed)
    if not retiming.solved:
        return no_motion(problem, leg, path, retiming.message)
    phase = plan_straight(problem.robot, path, retiming, problem.tip_speed, tighten)
    if not phase.ocp.solved:
        return no_motion(problem, leg, path, phase.ocp.message)
    bound = lower_bound(problem.robot, leg.first, leg.last)
    done = PlannedLeg(leg, phase.duration, retiming.duration, bound, phase.ocp.iterations)
    return done, phase.breaks, phase.coefficients


def _free(problem: Problem, mechanism: Mechanism, leg: Leg, tighten: Array | None) -> Outcome | Reason:
    result = solve_free(problem, mechanism, leg.first, leg.last, tighten)
    if not result.solved:
        return no_motion(problem, leg, StepPath(mechanism, leg.first, leg.last), result.message)
    coefficients = hermite(result.breaks, result.start, result.end)
    path = TravelledPath.of(mechanism, Trajectory(result.breaks, coefficients, ()), leg.last - leg.first)
    again = retime(path, problem.robot, tip_speed=problem.tip_speed)
    bound = lower_bound(problem.robot, leg.first, leg.last)
    duration = float(result.breaks[-1])
    toppra_duration = again.duration if again.solved else None
    return PlannedLeg(leg, duration, toppra_duration, bound, result.iterations), result.breaks, coefficients


_PLANNERS: dict[str, Callable[[Problem, Mechanism, Leg, Array | None], Outcome | Reason]] = {
    "dwell": _dwell,
    "straight": _straight,
    "free": _free,
}
