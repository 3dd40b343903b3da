"""Speeds at the two ends of all motions: task rates as joint speeds, and why a motion cannot have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.limits import Direction, JointAcceleration, JointVelocity
from ssm_planner.problem.problem import TASK, Problem
from ssm_planner.problem.robot import Joint
from ssm_planner.typing import Array

LOOKS = 201
UNITS = {"revolute": ("deg", 180 / np.pi), "prismatic": ("mm", 1e3)}
SLACK = 1 + 1e-9


def with_speeds(
    problem: Problem, mechanism: Mechanism, phases: tuple[Phase, ...]
) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases with q̇ at the start of the first and the end of the last, or the reason why they cannot have them.

    Raises ProblemError where a straight motion would leave its line.
    """
    changed = list(phases)
    for key, rates, k in (("start_rate", problem.start_rate, 0), ("end_rate", problem.end_rate, -1)):
        rate = np.array([rates.get(name, 0.0) for name in TASK])
        if not rate.any():
            continue
        phase = changed[k]
        if phase.motion.kind == "dwell":
            raise ProblemError("a dwell has no speed", file=problem.file, line=phase.motion.line, key=key)
        if phase.path is not None:
            way = phase.end - phase.start
            along = way * (way @ rate) / (way @ way)
            if way @ rate < 0 or np.abs(rate - along).max() > 1e-9 * np.abs(rate).max():
                raise ProblemError(
                    f"a straight motion ({phase.motion.name}) keeps to its line, from its start to its target",
                    file=problem.file,
                    key=key,
                    allowed="rates of the coordinates that the motion changes, in their ratio, and in its direction",
                )
        q = phase.points[k]
        by_joint = task_rates(mechanism, np.tile(q, (4, 1)), np.eye(4)).T
        speed = np.linalg.solve(by_joint, rate)
        speed[np.abs(speed) < 1e-12 * np.abs(speed).max()] = 0.0
        step = phase.points[1] - phase.points[0] if k == 0 else phase.points[-1] - phase.points[-2]
        reason = _too_fast(problem, phase, key, speed, step)
        if reason is not None:
            return phases, reason
        changed[k] = replace(phase, first_speed=speed) if k == 0 else replace(phase, last_speed=speed)
    return tuple(changed), next((r for phase in changed if (r := _too_near(problem, phase)) is not None), None)


def _too_fast(problem: Problem, phase: Phase, key: str, speed: Array, step: Array) -> Reason | None:
    """A joint that would be faster than its limit, or move against its way in a free motion."""
    place = f"{phase.motion.name}, {key.replace('_', ' ')}"
    for i, joint in enumerate(problem.robot.joints):
        unit, scale = UNITS[joint.kind]
        if abs(speed[i]) > joint.velocity * SLACK:
            text = (
                f"joint {joint.name} would move at {scale * abs(speed[i]):.4g} {unit}/s, its limit is "
                f"{scale * joint.velocity:.4g} {unit}/s ({place})"
            )
            return Reason(joint.limit(JointVelocity), place, float(abs(speed[i])), joint.velocity, text)
        if phase.path is None and speed[i] * np.sign(step[i]) <= 0 and speed[i] != 0:
            text = (
                f"joint {joint.name} would move against its way: free motions turn back only at their points ({place}); "
                "add a point where it turns, or leave this rate out"
            )
            return Reason(Direction(joint.name), place, float(np.sign(step[i])), float(np.sign(speed[i])), text)
    return None


def _too_near(problem: Problem, phase: Phase) -> Reason | None:
    """A joint that its acceleration limit does not let stop, or get up to speed, on all the way that it has."""
    if not (phase.first_speed.any() or phase.last_speed.any()):
        return None
    q = phase.points if phase.path is None else phase.path.sample(np.linspace(0.0, 1.0, LOOKS)).q
    for i, joint in enumerate(problem.robot.joints):
        first, last = float(phase.first_speed[i]), float(phase.last_speed[i])
        way = float(np.abs(np.diff(q[:, i])).sum())
        needed = abs(first**2 - last**2) / (2 * way) if way > 0 else 0.0
        if needed > joint.acceleration * SLACK:
            return _no_room(phase, joint, way, (first, last), needed)
    return None


def _no_room(phase: Phase, joint: Joint, way: float, speeds: tuple[float, float], needed: float) -> Reason:
    unit, scale = UNITS[joint.kind]
    begin, end = (scale * abs(speed) for speed in speeds)
    text = (
        f"joint {joint.name} has {scale * way:.4g} {unit} to go from {begin:.4g} to {end:.4g} {unit}/s: that takes "
        f"{scale * needed:.4g} {unit}/s², its limit is {scale * joint.acceleration:.4g} {unit}/s² ({phase.motion.name})"
    )
    return Reason(joint.limit(JointAcceleration), phase.motion.name, needed, joint.acceleration, text)
