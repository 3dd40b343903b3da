"""From a problem to a trajectory: legs, TOPP-RA and optimal control per leg, joined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.diagnosis import all_timed, no_motion, too_short, too_weak
from ssm_planner.planning.lower_bound import lower_bound, rate_bound
from ssm_planner.planning.ocp.constraints import tightened
from ssm_planner.planning.ocp.free import solve_free
from ssm_planner.planning.ocp.straight import PathMotion, joint_pieces, solve_straight
from ssm_planner.planning.phase import Leg
from ssm_planner.planning.phases import legs_of
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.paths import StepPath, TravelledPath
from ssm_planner.planning.retiming.retime import retime
from ssm_planner.problem.problem import Problem
from ssm_planner.trajectory import Trajectory, hermite, hold, join
from ssm_planner.typing import Array

CREEPING = 10.0
"""TOPP-RA's duration in lower bounds beyond which its motion is no guess."""
SAME = 1e-5
"""Share by which durations may differ that are meant to be the same."""
BETWEEN = 2e-5
"""By how much TOPP-RA's motion keeps off the limits, for what happens between its grid points."""


@dataclass(frozen=True, eq=False)
class PlannedLeg:
    """A leg with its duration, TOPP-RA's duration for the same path and limits, and the solver's account."""

    leg: Leg
    duration: float
    toppra_duration: float | None
    """None where TOPP-RA finds no motion along the path that was taken, or where a duration was asked for."""
    lower_bound: float
    """A duration that no motion within the same limits can beat."""
    iterations: int
    borders: Array = field(default_factory=lambda: np.zeros(0))
    """Instants at which a free motion passes its points, (k + 1,), s."""


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
    """Plan every leg of a problem, each from rest to rest but for the speeds asked for at the two ends of all.

    tighten (4, 4): factors ≤ 1 on velocity, acceleration, jerk and torque limits (rows) by joint (columns).
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    legs, reason = legs_of(problem, mechanism)
    if reason is None and problem.duration is not None:
        legs, reason = _timed(problem, mechanism, legs, problem.duration, tighten, progress)
    if reason is not None:
        return Planned("infeasible", None, (), reason)
    planned: list[PlannedLeg] = []
    parts = []
    for k, leg in enumerate(legs, 1):
        progress(leg.motion.name if len(legs) == 1 else f"{leg.motion.name} ({k} of {len(legs)})")
        outcome = _PLANNERS[leg.motion.kind](problem, mechanism, leg, tighten)
        if isinstance(outcome, Reason):
            status = "infeasible" if outcome.constraint != "solver" else "not converged"
            return Planned(status, None, tuple(planned), outcome)
        done, breaks, coefficients = _cross_checked(problem, mechanism, outcome)
        planned.append(done)
        parts.append((leg.motion.name, breaks, coefficients))
    return Planned("solved", join(parts), tuple(planned), None)


def _timed(
    problem: Problem,
    mechanism: Mechanism,
    legs: tuple[Leg, ...],
    duration: float,
    tighten: Array | None,
    progress: Callable[[str], None],
) -> tuple[tuple[Leg, ...], Reason | None]:
    """The legs with durations that add up to the one asked for: what has none of its own is slowed down in proportion."""
    fastest = replace(problem, objective="time")
    least = []
    for leg in legs:
        progress(f"{leg.motion.name}, fastest")
        if leg.motion.duration is not None:
            least.append(0.0)
            continue
        outcome = _PLANNERS[leg.motion.kind](fastest, mechanism, leg, tighten)
        if isinstance(outcome, Reason):
            return legs, outcome
        least.append(outcome[0].duration)
    fixed = sum(leg.motion.duration or 0.0 for leg in legs)
    room, needed = duration - fixed, sum(least)
    if needed == 0.0:
        return legs, None if abs(room) <= SAME * duration else all_timed(duration, fixed)
    if room < needed:
        return legs, too_short("the whole motion", duration, fixed + needed)
    timed = (
        leg if own == 0.0 else replace(leg, motion=replace(leg.motion, duration=own * room / needed))
        for leg, own in zip(legs, least, strict=True)
    )
    return tuple(timed), None


Outcome = tuple[PlannedLeg, Array, Array]
"""A planned leg and its pieces: breaks from 0, coefficients."""


def _dwell(problem: Problem, mechanism: Mechanism, leg: Leg, tighten: Array | None) -> Outcome | Reason:
    duration = float(leg.motion.duration or 0.0)
    return PlannedLeg(leg, duration, duration, duration, 0), np.array([0.0, duration]), hold(leg.first)


def _straight(problem: Problem, mechanism: Mechanism, leg: Leg, tighten: Array | None) -> Outcome | Reason:
    path, limits, asked = leg.straight, problem.task_limits, leg.motion.duration
    speeds = path.speed_at(0.0, leg.first_speed), path.speed_at(1.0, leg.last_speed)
    least = _bound(problem, leg, at_rest=not any(speeds))
    alone = problem.planner == "toppra"
    robot = problem.robot
    if alone:
        factors = np.ones((4, len(robot.joints))) if tighten is None else tighten
        robot = tightened(robot, factors * (1 - BETWEEN))
    retiming = retime(path, robot, limits=limits, speeds=speeds)
    if not retiming.solved:
        return no_motion(problem, leg, path, retiming.message)
    if alone:
        breaks, coefficients = joint_pieces(path, PathMotion.of(retiming), subdivision=1, end_speed=speeds[1])
        return PlannedLeg(leg, retiming.duration, retiming.duration, least, 0), breaks, coefficients
    guess = retiming
    if retiming.duration > CREEPING * least:
        # a motor that barely starts creeps over TOPP-RA's first interval, where a real one breaks away at a point
        kinetic = retime(path, problem.robot, limits=limits, speeds=speeds, static=False)
        guess = kinetic if kinetic.solved else retiming
    motion = solve_straight(problem.robot, path, guess, limits, tighten, problem.objective, asked, speeds)
    if not motion.solved:
        return no_motion(problem, leg, path, motion.message)
    if asked is not None and motion.duration > asked * (1 + 1e-6):
        return too_short(leg.motion.name, asked, motion.duration)
    breaks, coefficients = joint_pieces(path, motion, end_speed=speeds[1])
    return (
        PlannedLeg(leg, motion.duration, None if asked else retiming.duration, asked or least, motion.iterations),
        breaks,
        coefficients,
    )


def _free(problem: Problem, mechanism: Mechanism, leg: Leg, tighten: Array | None) -> Outcome | Reason:
    asked, speeds = leg.motion.duration, (leg.first_speed, leg.last_speed)
    direct = StepPath(mechanism, leg.points)
    reason = too_weak(problem, leg, direct)
    if reason is not None:
        return reason
    result = solve_free(problem, mechanism, leg.points, tighten, asked, speeds)
    duration = float(result.breaks[-1])
    if not result.solved:
        return no_motion(problem, leg, direct, result.message)
    if asked is not None and duration > asked * (1 + 1e-6):
        return too_short(leg.motion.name, asked, duration)
    coefficients = hermite(result.breaks, result.start, result.end)
    bound = asked or _bound(problem, leg, at_rest=not np.any(speeds))
    return PlannedLeg(leg, duration, None, bound, result.iterations, result.borders), result.breaks, coefficients


def _cross_checked(problem: Problem, mechanism: Mechanism, outcome: Outcome) -> Outcome:
    """With TOPP-RA's duration along the path that a free motion took; a straight one has it from its guess."""
    done, breaks, coefficients = outcome
    leg = done.leg
    if leg.motion.kind != "free" or leg.motion.duration is not None:
        return outcome
    trajectory = Trajectory(breaks, coefficients, ())
    path = TravelledPath.of(mechanism, trajectory, done.borders, np.diff(leg.points, axis=0))
    speeds = path.speed(leg.first_speed), path.speed(leg.last_speed)
    again = retime(path, problem.robot, limits=problem.task_limits, speeds=speeds)
    return replace(done, toppra_duration=again.duration if again.solved else None), breaks, coefficients


def _bound(problem: Problem, leg: Leg, *, at_rest: bool) -> float:
    rates = rate_bound(leg.start, leg.end, problem.rates)
    return max(lower_bound(problem.robot, leg.points, at_rest=at_rest), rates)


_PLANNERS: dict[str, Callable[[Problem, Mechanism, Leg, Array | None], Outcome | Reason]] = {
    "dwell": _dwell,
    "straight": _straight,
    "free": _free,
}
