"""From the motion list of a problem to legs with closed-form inverse kinematics: end points, branch, joint turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.model.inverse import inverse_task, inverse_tip
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.solutions import Solutions
from ssm_planner.model.task import task_from_joints
from ssm_planner.model.workspace import tilt_interval
from ssm_planner.planning.path import StraightPath
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.values import TASK, Array, Motion, Problem, Robot, Target

NOWHERE = 1e-9
"""A motion over less than this (rad, m) goes nowhere."""
LOOKS = 201


@dataclass(frozen=True, eq=False)
class Leg:
    """One entry of the motion list with its end points in task coordinates and joints, (4,) each."""

    motion: Motion
    start: Array
    end: Array
    first: Array
    last: Array
    path: StraightPath | None
    """None for a dwell and for a free motion."""

    @property
    def straight(self) -> StraightPath:
        if self.path is None:
            raise ValueError(f"{self.motion.name} is no straight motion")
        return self.path

    @property
    def branch(self) -> int | None:
        return None if self.path is None else self.path.branch


def legs_of(problem: Problem, mechanism: Mechanism) -> tuple[tuple[Leg, ...], Reason | None]:
    """The legs of a problem, or the reason why no start configuration carries it.

    Start configurations are tried from the home branch and the one nearest to q = 0 on; the first whose joints stay in
    range all along is taken. Raises ProblemError for a point out of reach or a motion that goes nowhere.
    """
    reasons = []
    for first in _starts(problem, mechanism):
        legs = _chain(problem, mechanism, first)
        reason = _out_of_range(problem.robot, legs)
        if reason is None:
            return legs, None
        reasons.append(reason)
    return (), reasons[0]


def _starts(problem: Problem, mechanism: Mechanism) -> list[Array]:
    """Start configurations to try: as given, or every closed-form solution with its whole turns."""
    target = problem.start
    if target.joints is not None:
        return [np.array(target.joints)]
    found = _solutions(problem, mechanism, target, np.zeros(4), None)
    branches = np.where(found.reaches[0], found.branch[0], 0)
    order = sorted(np.flatnonzero(branches), key=lambda k: bool(branches[k] != mechanism.home_branch))
    return [q for k in order for q in _with_turns(found.joints[0, k])]


def _with_turns(q: Array) -> list[Array]:
    """The same configuration with revolute joints within half a turn of zero, and one turn to the other side."""
    angles = np.arctan2(np.sin(q[:3]), np.cos(q[:3]))
    choices = [[angle, angle - 2 * np.pi * np.sign(angle)] if angle else [angle] for angle in angles]
    grid = [np.array([a, b, c, q[3]]) for a in choices[0] for b in choices[1] for c in choices[2]]
    return sorted(grid, key=lambda joints: float(np.abs(joints[:3]).sum()))


def _chain(problem: Problem, mechanism: Mechanism, first: Array) -> tuple[Leg, ...]:
    """The legs one after the other from a start configuration; start and end in task coordinates stay continuous."""
    legs = []
    driven = tuple(i for i, joint in enumerate(problem.robot.joints) if joint.drive is not None)
    near = None if problem.start.task is None else _task_of(problem, mechanism, problem.start, np.zeros(4))
    start = task_from_joints(mechanism, first[None, :], near=near)[0]
    for motion in problem.motion:
        if motion.kind == "dwell" or motion.target is None:
            legs.append(Leg(motion, start, start, first, first, None))
            continue
        path = None
        if motion.kind == "straight":
            end = _task_of(problem, mechanism, motion.target, start)
            _refuse_standstill(problem, motion, end - start)
            branch = 1 if np.sin(first[1] - mechanism.delta) > 0 else -1
            path = StraightPath(mechanism, start, end, branch, first, driven)
            last = path.sample(np.array([1.0])).q[0]
        else:
            last = _free_end(problem, mechanism, motion.target, start, first)
            _refuse_standstill(problem, motion, last - first)
            end = task_from_joints(mechanism, last[None, :], near=start)[0]
        legs.append(Leg(motion, start, end, first, last, path))
        start, first = end, last
    return tuple(legs)


def _free_end(problem: Problem, mechanism: Mechanism, target: Target, held: Array, first: Array) -> Array:
    """Joints at the end of a free motion: as given, or the solution nearest to where it starts, on the same branch."""
    if target.joints is not None:
        return np.array(target.joints)
    found = _solutions(problem, mechanism, target, held, first)
    branch = 1 if np.sin(first[1] - mechanism.delta) > 0 else -1
    usable = found.valid[0] & (found.branch[0] == branch)
    if not usable.any():
        usable = found.valid[0] if found.valid[0].any() else found.reaches[0]
    return np.array(found.joints[0, int(np.argmax(usable))])


def _solutions(
    problem: Problem, mechanism: Mechanism, target: Target, held: Array, reference: Array | None
) -> Solutions:
    """All joint solutions of a target in task coordinates or tip position."""
    limits = None if reference is None else np.array([joint.position for joint in problem.robot.joints])
    if target.tip is not None:
        spin = target.spin if target.spin is not None else float(held[2])
        found = inverse_tip(mechanism, [target.tip], spin, limits=limits, reference=reference)
        depth = mechanism.insertion_sign * found.joints[0, :, 3]
        low, high = problem.limits.get("depth", (-np.inf, np.inf))
        found.reaches[0] &= (depth >= low - NOWHERE) & (depth <= high + NOWHERE)
        if not found.reaches[0].any():
            raise ProblemError(
                "the mechanism cannot bring the tip there within the depth range",
                file=problem.file,
                line=target.line,
                key="tip",
                value=", ".join(f"{1e3 * x:.4g} mm" for x in target.tip),
            )
        return found
    task = _task_of(problem, mechanism, target, held)
    return inverse_task(mechanism, task[None, :], limits=limits, reference=reference)


def _task_of(problem: Problem, mechanism: Mechanism, target: Target, held: Array) -> Array:
    """Task coordinates (4,) of a target that names some; those that it does not name are held."""
    task = np.array([(target.task or {}).get(name, held[k]) for k, name in enumerate(TASK)])
    low, high = tilt_interval(mechanism)
    if not low < task[1] < high:
        raise ProblemError(
            "the mechanism cannot reach this tilt",
            file=problem.file,
            line=target.line,
            key="tilt",
            value=f"{np.degrees(task[1]):.6g} deg",
            allowed=f"{np.degrees(low):.3f} deg to {np.degrees(high):.3f} deg, ends excluded (paper, eq. 9)",
        )
    return task


def _refuse_standstill(problem: Problem, motion: Motion, way: Array) -> None:
    if np.abs(way).max() < NOWHERE:
        raise ProblemError(
            "this motion goes nowhere: its start and target are the same",
            file=problem.file,
            line=motion.line,
            key=motion.name,
        )


def _out_of_range(robot: Robot, legs: tuple[Leg, ...]) -> Reason | None:
    """The first joint that leaves its position range along the legs; free motions stay between their ends."""
    for leg in legs:
        s = np.linspace(0.0, 1.0, LOOKS)
        q = np.stack([leg.first, leg.last]) if leg.path is None else leg.path.sample(s).q
        for i, joint in enumerate(robot.joints):
            low, high = joint.position
            over = np.maximum(low - q[:, i], q[:, i] - high)
            if over.max() <= 1e-9 * (high - low):
                continue
            k = int(np.argmax(over))
            value, limit = float(q[k, i]), low if q[k, i] < low else high
            unit, scale = ("deg", 180 / np.pi) if joint.kind == "revolute" else ("mm", 1e3)
            place = f"{leg.motion.name}, {100 * k / (len(q) - 1):.0f} % of the way"
            cure = f"range of joint {joint.name} to {value * scale:.6g} {unit}"
            text = (
                f"joint {joint.name} would have to reach {value * scale:.6g} {unit}, its range ends at "
                f"{limit * scale:.6g} {unit} ({place})"
            )
            return Reason("position", joint.name, place, value, limit, cure, text)
    return None
