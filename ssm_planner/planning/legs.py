"""From the motion list of a problem to legs with closed-form inverse kinematics: end points, branch, joint turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.model.inverse import inverse_task
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.task import task_from_joints
from ssm_planner.model.workspace import tilt_interval
from ssm_planner.planning.path import StraightPath
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.values import TASK, Array, Motion, Problem, Robot, Target


@dataclass(frozen=True, eq=False)
class Leg:
    """One entry of the motion list with its end points in task coordinates and joints, (4,) each."""

    motion: Motion
    start: Array
    end: Array
    first: Array
    last: Array
    path: StraightPath | None
    """None for a dwell."""


def legs_of(problem: Problem, mechanism: Mechanism) -> tuple[tuple[Leg, ...], Reason | None]:
    """The legs of a problem, or the reason why no IK branch carries it.

    Branches are tried from the home configuration's on; the first whose joints stay in range all along is taken.
    Raises ProblemError for a point that the mechanism cannot reach or a motion that goes nowhere.
    """
    start = _task_of(problem, mechanism, problem.start, np.zeros(4))
    reasons = []
    for branch in _branches(problem, mechanism):
        for first in _turns(problem, mechanism, start, branch):
            legs = _chain(problem, mechanism, start, first, branch)
            reason = _out_of_range(problem.robot, legs)
            if reason is None:
                return legs, None
            reasons.append(reason)
    return (), reasons[0]


def _branches(problem: Problem, mechanism: Mechanism) -> tuple[int, ...]:
    if problem.start.joints is not None:
        elbow = float(np.sin(problem.start.joints[1] - mechanism.delta))
        return (1,) if elbow > 0 else (-1,)
    return (mechanism.home_branch, -mechanism.home_branch)


def _turns(problem: Problem, mechanism: Mechanism, start: Array, branch: int) -> list[Array]:
    """Start joints to try: as given, or the closed form with whole turns, nearest to q = 0 first."""
    if problem.start.joints is not None:
        return [np.array(problem.start.joints)]
    solutions = inverse_task(mechanism, start[None, :])
    q = np.array(solutions.joints[0, int(np.argmax(solutions.branch[0] == branch))])
    q[:3] = np.arctan2(np.sin(q[:3]), np.cos(q[:3]))
    choices = [[angle, angle - 2 * np.pi * np.sign(angle)] if angle else [angle] for angle in q[:3]]
    grid = [np.array([a, b, c, q[3]]) for a in choices[0] for b in choices[1] for c in choices[2]]
    return sorted(grid, key=lambda joints: float(np.abs(joints[:3]).sum()))


def _chain(problem: Problem, mechanism: Mechanism, start: Array, first: Array, branch: int) -> tuple[Leg, ...]:
    legs = []
    driven = tuple(i for i, joint in enumerate(problem.robot.joints) if joint.drive is not None)
    for motion in problem.motion:
        if motion.kind == "dwell":
            legs.append(Leg(motion, start, start, first, first, None))
            continue
        end = _task_of(problem, mechanism, _target(motion), start)
        if np.abs(end - start).max() < 1e-9:
            raise _bad(problem, motion.line, motion.name, "this motion goes nowhere: its start and target are the same")
        path = StraightPath(mechanism, start, end, branch, first, driven)
        last = path.sample(np.array([1.0])).q[0]
        legs.append(Leg(motion, start, end, first, last, path))
        start, first = end, last
    return tuple(legs)


def _task_of(problem: Problem, mechanism: Mechanism, target: Target, held: Array) -> Array:
    """Task coordinates (4,) of a target; coordinates that it does not name are held."""
    if target.joints is not None:
        return task_from_joints(mechanism, np.array([target.joints]), near=held[None, :])[0]
    if target.task is None:
        raise _bad(problem, target.line, "tip", "tip positions are not planned yet; give task coordinates or joints")
    task = np.array([target.task.get(name, held[k]) for k, name in enumerate(TASK)])
    low, high = tilt_interval(mechanism)
    if not low < task[1] < high:
        allowed = f"{np.degrees(low):.3f} deg to {np.degrees(high):.3f} deg, ends excluded (paper, eq. 9)"
        raise ProblemError(
            "the mechanism cannot reach this tilt",
            file=problem.file,
            line=target.line,
            key="tilt",
            value=f"{np.degrees(task[1]):.6g} deg",
            allowed=allowed,
        )
    return task


def _target(motion: Motion) -> Target:
    return motion.target if motion.target is not None else Target(task={})


def _bad(problem: Problem, line: int | None, key: str, reason: str) -> ProblemError:
    return ProblemError(reason, file=problem.file, line=line, key=key)


def _out_of_range(robot: Robot, legs: tuple[Leg, ...]) -> Reason | None:
    """The first joint that leaves its position range along the legs."""
    for leg in legs:
        if leg.path is None:
            continue
        s = np.linspace(0.0, 1.0, 201)
        q = leg.path.sample(s).q
        for i, joint in enumerate(robot.joints):
            low, high = joint.position
            slack = 1e-9 * (high - low)
            for bad, value, limit in (
                (q[:, i] < low - slack, q[:, i].min(), low),
                (q[:, i] > high + slack, q[:, i].max(), high),
            ):
                if bad.any():
                    unit, scale = ("deg", 180 / np.pi) if joint.kind == "revolute" else ("mm", 1e3)
                    place = f"{leg.motion.name}, {100 * s[np.argmax(bad)]:.0f} % of the way"
                    return Reason(
                        "position",
                        joint.name,
                        place,
                        float(value),
                        float(limit),
                        f"joint range to {value * scale:.6g} {unit}",
                        f"joint {joint.name} would have to reach {value * scale:.6g} {unit}, "
                        f"its range ends at {limit * scale:.6g} {unit} ({place})",
                    )
    return None
