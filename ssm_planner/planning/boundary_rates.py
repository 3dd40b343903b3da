"""Speeds at the two ends of all motions: task rates as joint speeds, and why a motion cannot have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import joint_rates
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.limits import TASK, Direction, JointAcceleration, JointPosition, JointVelocity
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Joint
from ssm_planner.typing import Array
from ssm_planner.units import shown

SAMPLES = 201
TOLERANCE = 1 + 1e-9
"""Factor by which a speed or acceleration may exceed its limit."""


def with_boundary_rates(
    problem: Problem, mechanism: Mechanism, phases: tuple[Phase, ...]
) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases with q̇ at the start of the first and the end of the last, or the reason why they cannot have them.

    Raises ProblemError where a straight motion would leave its line.
    """
    first, reason = _with_rate(problem, mechanism, phases[0], "start_rate")
    if reason is not None:
        return phases, reason
    phases = (first, *phases[1:])
    last, reason = _with_rate(problem, mechanism, phases[-1], "end_rate")
    if reason is not None:
        return phases, reason
    phases = (*phases[:-1], last)
    return phases, next((reason for phase in phases if (reason := _too_near(problem, phase)) is not None), None)


def _with_rate(problem: Problem, mechanism: Mechanism, phase: Phase, key: str) -> tuple[Phase, Reason | None]:
    """A phase with q̇ at one end, from the task rates that the problem asks for there; key: start_rate or end_rate."""
    at_start = key == "start_rate"
    asked = problem.start_rate if at_start else problem.end_rate
    rate = np.array([asked.get(name, 0.0) for name in TASK])
    if not rate.any():
        return phase, None
    if phase.motion.kind == "dwell":
        raise ProblemError("a dwell has no speed", file=problem.file, line=phase.motion.line, key=key)
    if phase.path is not None:
        _refuse_off_line(problem, phase, key, rate)
    qd = joint_rates(mechanism, phase.points[0 if at_start else -1], rate)
    step = phase.points[1] - phase.points[0] if at_start else phase.points[-1] - phase.points[-2]
    reason = _too_fast(problem, phase, key, qd, step)
    return replace(phase, qd_start=qd) if at_start else replace(phase, qd_end=qd), reason


def _refuse_off_line(problem: Problem, phase: Phase, key: str, rate: Array) -> None:
    """ProblemError for task rates (4,) that do not point along a straight motion."""
    way = phase.end - phase.start
    along = way * (way @ rate) / (way @ way)
    if way @ rate < 0 or np.abs(rate - along).max() > 1e-9 * np.abs(rate).max():
        raise ProblemError(
            f"a straight motion ({phase.motion.name}) keeps to its line, from its start to its target",
            file=problem.file,
            key=key,
            allowed="rates of the coordinates that the motion changes, in their ratio, and in its direction",
        )


def _too_fast(problem: Problem, phase: Phase, key: str, qd: Array, step: Array) -> Reason | None:
    """A joint that would be faster than its limit, or move against its way in a free motion; step (4,): that way."""
    place = f"{phase.motion.name}, {key.replace('_', ' ')}"
    for i, joint in enumerate(problem.robot.joints):
        limit = joint.limit(JointVelocity)
        unit, scale = shown(limit.unit)
        if abs(qd[i]) > joint.velocity * TOLERANCE:
            text = (
                f"joint {joint.name} would move at {scale * abs(qd[i]):.4g} {unit}, its limit is "
                f"{scale * limit.largest:.4g} {unit} ({place})"
            )
            return Reason(limit, place, float(abs(qd[i])), limit.largest, text)
        if phase.path is None and qd[i] * np.sign(step[i]) <= 0 and qd[i] != 0:
            text = (
                f"joint {joint.name} would move against its way: free motions turn back only at their points ({place}); "
                "add a point where it turns, or leave this rate out"
            )
            return Reason(Direction(joint.name), place, float(np.sign(step[i])), float(np.sign(qd[i])), text)
    return None


def _too_near(problem: Problem, phase: Phase) -> Reason | None:
    """A joint whose way is too short for its change of speed: |q̇₁² − q̇₀²| = 2 q̈ way at least needs more than q̈_max."""
    if not (phase.qd_start.any() or phase.qd_end.any()):
        return None
    q = phase.points if phase.path is None else phase.path.sample(np.linspace(0.0, 1.0, SAMPLES)).q
    for i, joint in enumerate(problem.robot.joints):
        first, last = float(phase.qd_start[i]), float(phase.qd_end[i])
        way = float(np.abs(np.diff(q[:, i])).sum())
        needed = abs(first**2 - last**2) / (2 * way) if way > 0 else 0.0
        if needed > joint.acceleration * TOLERANCE:
            return _no_room(phase, joint, way, (first, last), needed)
    return None


def _no_room(phase: Phase, joint: Joint, way: float, speeds: tuple[float, float], needed: float) -> Reason:
    unit, scale = shown(joint.limit(JointPosition).unit)
    begin, end = (scale * abs(speed) for speed in speeds)
    text = (
        f"joint {joint.name} has {scale * way:.4g} {unit} to go from {begin:.4g} to {end:.4g} {unit}/s: that takes "
        f"{scale * needed:.4g} {unit}/s², its limit is {scale * joint.acceleration:.4g} {unit}/s² ({phase.motion.name})"
    )
    return Reason(joint.limit(JointAcceleration), phase.motion.name, needed, joint.acceleration, text)
