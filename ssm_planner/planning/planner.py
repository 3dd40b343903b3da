"""From a problem to a trajectory: phases, TOPP-RA and optimal control per phase, joined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.boundary_rates import with_speeds
from ssm_planner.planning.diagnosis import all_timed, no_motion, too_short, too_weak
from ssm_planner.planning.feasibility import misplaced
from ssm_planner.planning.lower_bound import lower_bound, rate_bound
from ssm_planner.planning.ocp.constraints import kept_off
from ssm_planner.planning.ocp.free import solve_free
from ssm_planner.planning.ocp.straight import PathMotion, joint_pieces, solve_straight
from ssm_planner.planning.phases import Phase, phases_from, start_configurations
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.paths import PolylinePath, SplinePath
from ssm_planner.planning.retiming.retime import retime
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory, hermite, hold, join
from ssm_planner.typing import Array

CREEPING = 10.0
"""TOPP-RA's duration in lower bounds beyond which its motion is no guess."""
SAME = 1e-5
"""Share by which durations may differ that are meant to be the same."""
BETWEEN = 2e-5
"""By how much TOPP-RA's motion keeps off the limits, for what happens between its grid points."""


@dataclass(frozen=True, eq=False)
class PlannedPhase:
    """A phase with its duration, TOPP-RA's duration for the same path and limits, and the solver's account."""

    phase: Phase
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
    phases: tuple[PlannedPhase, ...]
    reason: Reason | None


def plan_motion(
    problem: Problem, strict: Robot | None = None, progress: Callable[[str], None] = lambda _: None
) -> Planned:
    """Plan every phase of a problem, each from rest to rest but for the speeds asked for at the two ends of all.

    strict: the problem's robot with stricter limits, which the motion is to keep; None: its own.
    """
    strict = strict or problem.robot
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    phases, reason = phases_of(problem, mechanism)
    if reason is None and problem.duration is not None:
        phases, reason = _timed(problem, mechanism, phases, problem.duration, strict, progress)
    if reason is not None:
        return Planned("infeasible", None, (), reason)
    planned: list[PlannedPhase] = []
    parts = []
    for k, phase in enumerate(phases, 1):
        progress(phase.motion.name if len(phases) == 1 else f"{phase.motion.name} ({k} of {len(phases)})")
        outcome = _PLANNERS[phase.motion.kind](problem, mechanism, phase, strict)
        if isinstance(outcome, Reason):
            status = "infeasible" if outcome.limit is not None else "not converged"
            return Planned(status, None, tuple(planned), outcome)
        done, breaks, coefficients = _cross_checked(problem, mechanism, outcome)
        planned.append(done)
        parts.append((phase.motion.name, breaks, coefficients))
    return Planned("solved", join(parts), tuple(planned), None)


def _timed(
    problem: Problem,
    mechanism: Mechanism,
    phases: tuple[Phase, ...],
    duration: float,
    strict: Robot,
    progress: Callable[[str], None],
) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases with durations that add up to the one asked for: what has none of its own is slowed down in proportion."""
    fastest = replace(problem, objective="time")
    least = []
    for phase in phases:
        progress(f"{phase.motion.name}, fastest")
        if phase.motion.duration is not None:
            least.append(0.0)
            continue
        outcome = _PLANNERS[phase.motion.kind](fastest, mechanism, phase, strict)
        if isinstance(outcome, Reason):
            return phases, outcome
        least.append(outcome[0].duration)
    fixed = sum(phase.motion.duration or 0.0 for phase in phases)
    room, needed = duration - fixed, sum(least)
    if needed == 0.0:
        return phases, None if abs(room) <= SAME * duration else all_timed(duration, fixed)
    if room < needed:
        return phases, too_short("the whole motion", duration, fixed + needed)
    timed = (
        phase if own == 0.0 else replace(phase, motion=replace(phase.motion, duration=own * room / needed))
        for phase, own in zip(phases, least, strict=True)
    )
    return tuple(timed), None


Outcome = tuple[PlannedPhase, Array, Array]
"""A planned phase and its pieces: breaks from 0, coefficients."""


def _dwell(problem: Problem, mechanism: Mechanism, phase: Phase, strict: Robot) -> Outcome | Reason:
    duration = float(phase.motion.duration or 0.0)
    return PlannedPhase(phase, duration, duration, duration, 0), np.array([0.0, duration]), hold(phase.first)


def _straight(problem: Problem, mechanism: Mechanism, phase: Phase, strict: Robot) -> Outcome | Reason:
    path, limits, asked = phase.straight, problem.task_limits, phase.motion.duration
    speeds = path.speed_at(0.0, phase.first_speed), path.speed_at(1.0, phase.last_speed)
    least = _bound(problem, phase, at_rest=not any(speeds))
    alone = problem.planner == "toppra"
    robot = kept_off(strict, BETWEEN) if alone else problem.robot
    retiming = retime(path, robot, limits=limits, speeds=speeds)
    if not retiming.solved:
        return no_motion(problem, phase, path, retiming.message)
    if alone:
        breaks, coefficients = joint_pieces(path, PathMotion.of(retiming), subdivision=1, end_speed=speeds[1])
        return PlannedPhase(phase, retiming.duration, retiming.duration, least, 0), breaks, coefficients
    guess = retiming
    if retiming.duration > CREEPING * least:
        # a motor that barely starts creeps over TOPP-RA's first interval, where a real one breaks away at a point
        kinetic = retime(path, problem.robot, limits=limits, speeds=speeds, static=False)
        guess = kinetic if kinetic.solved else retiming
    motion = solve_straight(
        problem.robot,
        path,
        guess,
        limits=limits,
        strict=strict,
        objective=problem.objective,
        duration=asked,
        speeds=speeds,
    )
    if not motion.solved:
        return no_motion(problem, phase, path, motion.message)
    if asked is not None and motion.duration > asked * (1 + 1e-6):
        return too_short(phase.motion.name, asked, motion.duration)
    breaks, coefficients = joint_pieces(path, motion, end_speed=speeds[1])
    return (
        PlannedPhase(phase, motion.duration, None if asked else retiming.duration, asked or least, motion.iterations),
        breaks,
        coefficients,
    )


def _free(problem: Problem, mechanism: Mechanism, phase: Phase, strict: Robot) -> Outcome | Reason:
    asked, speeds = phase.motion.duration, (phase.first_speed, phase.last_speed)
    direct = PolylinePath(mechanism, phase.points)
    reason = too_weak(problem, phase, direct)
    if reason is not None:
        return reason
    result = solve_free(problem, mechanism, phase.points, strict=strict, duration=asked, speeds=speeds)
    duration = float(result.breaks[-1])
    if not result.solved:
        return no_motion(problem, phase, direct, result.message)
    if asked is not None and duration > asked * (1 + 1e-6):
        return too_short(phase.motion.name, asked, duration)
    coefficients = hermite(result.breaks, result.start, result.end)
    bound = asked or _bound(problem, phase, at_rest=not np.any(speeds))
    return PlannedPhase(phase, duration, None, bound, result.iterations, result.borders), result.breaks, coefficients


def _cross_checked(problem: Problem, mechanism: Mechanism, outcome: Outcome) -> Outcome:
    """With TOPP-RA's duration along the path that a free motion took; a straight one has it from its guess."""
    done, breaks, coefficients = outcome
    phase = done.phase
    if phase.motion.kind != "free" or phase.motion.duration is not None:
        return outcome
    trajectory = Trajectory(breaks, coefficients, ())
    path = SplinePath.of(mechanism, trajectory, done.borders, np.diff(phase.points, axis=0))
    speeds = path.speed(phase.first_speed), path.speed(phase.last_speed)
    again = retime(path, problem.robot, limits=problem.task_limits, speeds=speeds)
    return replace(done, toppra_duration=again.duration if again.solved else None), breaks, coefficients


def _bound(problem: Problem, phase: Phase, *, at_rest: bool) -> float:
    rates = rate_bound(phase.start, phase.end, problem.rates)
    return max(lower_bound(problem.robot, phase.points, at_rest=at_rest), rates)


_PLANNERS: dict[str, Callable[[Problem, Mechanism, Phase, Robot], Outcome | Reason]] = {
    "dwell": _dwell,
    "straight": _straight,
    "free": _free,
}


def phases_of(problem: Problem, mechanism: Mechanism) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases of a problem with the speeds at both ends, or the reason why no start configuration carries it.

    Start configurations are tried from the home branch and the one nearest to q = 0 on; the first whose joints stay in
    range all along is taken. Raises ProblemError for a point out of reach or a motion that goes nowhere.
    """
    reasons = []
    for first in start_configurations(problem, mechanism):
        phases = phases_from(problem, mechanism, first)
        reason = misplaced(problem, mechanism, phases)
        if reason is None:
            return with_speeds(problem, mechanism, phases)
        reasons.append(reason)
    return (), reasons[0]
