"""From a problem to a trajectory: legs, TOPP-RA and optimal control per leg, joined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.trajectory import Trajectory, hold, join
from ssm_planner.planning.bound import lower_bound
from ssm_planner.planning.diagnosis import no_motion
from ssm_planner.planning.legs import Leg, legs_of
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming import retime
from ssm_planner.planning.straight import StraightPhase, plan_straight
from ssm_planner.problem.values import Array, Problem


@dataclass(frozen=True, eq=False)
class PlannedLeg:
    """A leg with its duration, TOPP-RA's duration for the same path and limits, and the solver's account."""

    leg: Leg
    duration: float
    toppra_duration: float
    lower_bound: float
    """A duration that no motion along the same path within the same limits can beat."""
    phase: StraightPhase | None


@dataclass(frozen=True, eq=False)
class Planned:
    """status: "solved", "infeasible" or "not converged"; trajectory None and a reason unless solved."""

    status: str
    trajectory: Trajectory | None
    legs: tuple[PlannedLeg, ...]
    reason: Reason | None

    @property
    def toppra_duration(self) -> float:
        return float(sum(leg.toppra_duration for leg in self.legs))


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
        if leg.path is None:
            duration = float(leg.motion.duration or 0.0)
            planned.append(PlannedLeg(leg, duration, duration, duration, None))
            parts.append((leg.motion.name, np.array([0.0, duration]), hold(leg.first)))
            continue
        progress(f"{leg.motion.name}: TOPP-RA")
        retiming = retime(leg.path, problem.robot, tip_speed=problem.tip_speed)
        if not retiming.solved:
            return Planned("infeasible", None, tuple(planned), no_motion(problem, leg, retiming))
        progress(f"{leg.motion.name}: optimal control")
        phase = plan_straight(problem.robot, leg.path, retiming, problem.tip_speed, tighten)
        if not phase.ocp.solved:
            return Planned("not converged", None, tuple(planned), no_motion(problem, leg, retiming))
        planned.append(PlannedLeg(leg, phase.duration, retiming.duration, lower_bound(problem.robot, leg.path), phase))
        parts.append((leg.motion.name, phase.breaks, phase.coefficients))
    return Planned("solved", join(parts), tuple(planned), None)
