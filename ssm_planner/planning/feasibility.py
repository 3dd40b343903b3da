"""Whether a motion stays where limits allow: joint ranges and the eye, along straight paths and at the points of others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.kinematics.eye import eye_limits
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.planning.phases import Phase, branch_of, driven_joints
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.problem.limits import TASK, JointPosition, RetinaClearance, TaskRange
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array
from ssm_planner.units import shown

SAMPLES = 201
TOLERANCE = 1e-9
"""Share of a range, or m and shares of the lens, by which a joint or the tip may miss it."""
AT_POINTS = 1e-6
"""rad or m by which a task coordinate that follows from joints may miss its range; the check of the motion is finer."""


def infeasible_place(problem: Problem, mechanism: Mechanism, phases: Sequence[Phase]) -> Reason | None:
    """The first place that a limit forbids: range of a joint or of a task coordinate, the retina's clearance or the lens."""
    for phase in phases:
        q = phase.path.sample(np.linspace(0.0, 1.0, SAMPLES)).q if phase.path is not None else phase.points
        reason = (
            _beyond_range(problem.robot, phase, q)
            or _beyond_task_range(problem, mechanism, phase)
            or blocked_by_eye(problem, mechanism, phase, q)
        )
        if reason is not None:
            return reason
    return None


def _where(phase: Phase, k: int, count: int) -> str:
    """Words for sample k of `count` along a phase."""
    if phase.path is None and count == len(phase.points) and 0 < k < count - 1:
        return f"{phase.motion.name}, at point {k} on its way"
    if k in (0, count - 1):
        return f"{phase.motion.name}, at its {'end' if k else 'start'}"
    return f"{phase.motion.name}, {100 * k / (count - 1):.0f} % of the way"


def _beyond_range(robot: Robot, phase: Phase, q: Array) -> Reason | None:
    """The first joint that leaves its range at one of these samples (n, 4), where it does so most."""
    for i, joint in enumerate(robot.joints):
        low, high = joint.position
        over = np.maximum(low - q[:, i], q[:, i] - high)
        if over.max() <= TOLERANCE * (high - low):
            continue
        k = int(np.argmax(over))
        value, limit = float(q[k, i]), low if q[k, i] < low else high
        position = joint.limit(JointPosition)
        unit, scale = shown(position.unit)
        where = _where(phase, k, len(q))
        text = (
            f"joint {joint.name} would have to reach {value * scale:.6g} {unit}, its range ends at "
            f"{limit * scale:.6g} {unit} ({where})"
        )
        return Reason(position, where, value, limit, text)
    return None


def _beyond_task_range(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """The first task coordinate that is outside its range at a point given as joints or by the tip."""
    task = task_from_joints(mechanism, phase.points)
    for limit in problem.limits:
        if not isinstance(limit, TaskRange):
            continue
        values = task[:, TASK.index(limit.coordinate)]
        over = np.maximum(limit.low - values, values - limit.high)
        if over.max() <= AT_POINTS:
            continue
        k = int(np.argmax(over))
        value, bound = float(values[k]), limit.bound(float(values[k]))
        unit, scale = shown(limit.unit)
        where = _where(phase, k, len(values))
        text = (
            f"{limit.coordinate} would have to be {value * scale:.6g} {unit}, its range ends at "
            f"{bound * scale:.6g} {unit} ({where})"
        )
        return Reason(limit, where, value, bound, text)
    return None


def blocked_by_eye(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> Reason | None:
    """The retina or the lens where one of these samples (n, 4) comes too near, where it does so most."""
    if problem.eye is None:
        return None
    values = eye_limits(NUMPY, problem.eye, tip_position(mechanism, q).T)
    for each in problem.eye.limits:
        value, least = values[each.name]
        k = int(np.argmin(value))
        found = float(value[k])
        if found >= least - TOLERANCE:
            continue
        where = _where(phase, k, len(q))
        if isinstance(each, RetinaClearance):
            text = (
                f"the tip would come within {1e3 * found:.4g} mm of the retina, the clearance is {1e3 * least:.4g} mm"
            )
        else:
            text = (
                f"the shaft would touch the lens: {found:.4g} of its size from its centre, at least {least:.4g} is free"
            )
        return Reason(each, where, least, found, f"{text} ({where})")
    return None


def straight_instead(problem: Problem, mechanism: Mechanism, phase: Phase) -> Phase | None:
    """A free phase from rest to rest, straight in task coordinates; None where it cannot be, or a limit forbids a place."""
    if len(phase.points) != 2 or phase.qd_start.any() or phase.qd_end.any() or not _ways_differ(phase):
        return None
    first, last = phase.points
    path = StraightPath(
        mechanism,
        start=phase.start,
        end=phase.end,
        branch=branch_of(mechanism, first),
        first=first,
        watched=driven_joints(problem.robot),
    )
    if np.abs(path.sample(np.array([1.0])).q[0] - last).max() > TOLERANCE:
        return None
    straight = replace(phase, path=path)
    return None if infeasible_place(problem, mechanism, (straight,)) is not None else straight


def _ways_differ(phase: Phase) -> bool:
    """The straight line in task coordinates is another one than that in the joints."""
    return bool(np.abs((phase.end - phase.start)[:2]).max() > TOLERANCE)
