"""Other joints that reach the targets of free motions, planned where they may be faster: the other branch, whole turns.

A target in task coordinates, or of the tip, leaves open with which joints it is reached. The planner takes the nearest ones
on the branch where the motion is. Here the others are planned too, as far as their lower bounds leave them a chance, one
target after the other: what comes after it is reached with the nearest joints again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.curves import branch_of
from ssm_planner.planning.feasibility import infeasible_place, with_boundary_rates
from ssm_planner.planning.phases import Phase, other_ends, phases_from, start_configurations
from ssm_planner.planning.planner import PlannedPhase, PlannerResult, feasible_phases, least_duration
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.motion import Free, Joints, Motion
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

Outcome = tuple[PlannerResult, Certificate | None, Reason | None]
"""What was planned, its certificate, and the reason where it is none that passed."""
SHORTER = 1e-5
"""Share by which a motion with other joints has to be shorter to be taken."""
RESCUES = 1
"""Joints on other branches that are planned for a target where those of the planner give no motion."""
MOST = 8
"""Targets of a problem up to which other joints are tried: every change of one is another way of all that follows."""


def on_any_branch(
    problem: Problem, attempt: Callable[[Problem], Outcome], rescues: int = RESCUES
) -> tuple[Outcome, Problem]:
    """The shortest certified motion over the joints that reach the free targets of a problem, and the problem with these.

    attempt: plans and checks one. rescues: with how many on other branches a motion is looked for where there is none.
    """
    best, settled = attempt(problem), problem
    for entry, place in targets(problem):
        tried = 0
        for bound, other in _others(settled, entry, place, best):
            longest = _duration(best) * (1 - SHORTER)
            if bound >= longest or (best[2] is not None and tried >= rescues):
                break
            found, tried = attempt(other), tried + 1
            if found[2] is None and _duration(found) < longest:
                best, settled = found, other
    return best, settled


def targets(problem: Problem) -> list[tuple[int, int]]:
    """Targets that leave their joints open, as entry of the motion list and place among its targets; none of very many."""
    found = [
        (entry, place)
        for entry, motion in enumerate(problem.motion)
        if isinstance(motion, Free)
        for place, target in enumerate((*motion.through, motion.to))
        if not isinstance(target, Joints)
    ]
    return found if len(found) <= MOST else []


def _duration(outcome: Outcome) -> float:
    """Of a certified motion, s; infinite where there is none."""
    trajectory = outcome[0].trajectory
    return np.inf if outcome[2] is not None or trajectory is None else trajectory.duration


def _others(problem: Problem, entry: int, place: int, best: Outcome) -> list[tuple[float, Problem]]:
    """The problem with each of the other joints that reach a target of its free motion, and a bound of its duration, s.

    The least bound first; those that keep no range, or cannot be shorter than the best, are left out.
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    phases, reason = feasible_phases(problem, mechanism)
    if reason is not None:
        phases = phases_from(problem, mechanism, start_configurations(problem, mechanism)[0])
    motion = problem.motion[entry]
    phase = next(each for each in phases if each.motion is motion)
    stops = isinstance(motion, Free) and place == len(motion.through) and not phase.qd_end.any()
    found = []
    own_branch = branch_of(mechanism, phase.q_start)
    for q in other_ends(problem, mechanism, phase, place):
        if best[2] is not None and branch_of(mechanism, q) == own_branch:
            continue
        own = replace(phase, points=np.stack([phase.q_start, q]))
        if stops and least_duration(problem, mechanism, own) >= _duration(best):
            continue
        try:
            other = _with_target(problem, entry, place, q)
            theirs = phases_from(other, mechanism, phases[0].q_start)
            if infeasible_place(problem, mechanism, theirs) is not None:
                continue
            theirs, reason = with_boundary_rates(other, mechanism, theirs)
        except ProblemError:  # a straight motion after it has no line there
            continue
        bound = sum(_bound(problem, mechanism, each, best[0].phases) for each in theirs)
        if reason is None and bound < _duration(best):
            found.append((max(bound, problem.duration or 0.0), other))
    return sorted(found, key=lambda each: each[0])


def _bound(problem: Problem, mechanism: Mechanism, phase: Phase, planned: tuple[PlannedPhase, ...]) -> float:
    """What a phase takes at least, s; where it has been planned already, what it takes."""
    if phase.motion.duration is not None or phase.stands:
        return phase.motion.duration or 0.0
    same = (
        each.duration
        for each in planned
        if each.phase.motion is phase.motion and np.array_equal(each.phase.points, phase.points)
    )
    return next(same, least_duration(problem, mechanism, phase))


def _with_target(problem: Problem, entry: int, place: int, q: Array) -> Problem:
    """The problem whose free motion has joints (4,) as a target; place: of which of its targets."""
    motion = problem.motion[entry]
    assert isinstance(motion, Free)
    a, b, c, d = q.tolist()
    targets = [*motion.through, motion.to]
    targets[place] = Joints((a, b, c, d), targets[place].line)
    changed: Motion = replace(motion, through=tuple(targets[:-1]), to=targets[-1])
    return replace(problem, motion=(*problem.motion[:entry], changed, *problem.motion[entry + 1 :]))
