"""The joints along given curves: through points of any form, and of lines and arcs of the tool's tip."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.inverse import inverse_tip
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.solutions import Flags
from ssm_planner.kinematics.task import joints_of_task, task_from_joints
from ssm_planner.planning.retiming.paths import SplinePath
from ssm_planner.planning.scan_pattern import refuse_tilt
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import Follow, Joints, Point, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array

Curve = tuple[Callable[[Array], Array], Callable[[Array], Array]]
"""Points (n, 3) at shares (n,) of the way, and how far points (n, 3) are off the curve, (n,)."""
NOWHERE = 1e-9
"""A motion over less than this (rad, m) goes nowhere."""
FLAT = 1e-6
"""Sine of the angle between two sides of a triangle up to which it is a line."""
COUNTS = (100, 400, 1600)
"""Points of a line or an arc: more of them where the spline through the first ones is off it."""
OFF, LOOKS = 1e-6, 5
"""m by which the tip may be off a line or an arc, and looks between two of its points."""
AT_START = np.array([1e-4, 1e-4, 1e-4, 1e-5])
"""rad and m within which the first point of a table is where the robot is."""


def points_of_curve(problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array) -> tuple[Array, int]:
    """Joints (n, 4) along the curve from where the robot is, task (4,) and q (4,) on; and how many of them lead to it.

    None do, but one to a table that begins elsewhere. Raises ProblemError for what is out of reach.
    """
    if motion.curve in ("line", "arc"):
        return _in_space(problem, mechanism, motion, task, q), 0
    points = _joints(problem, mechanism, motion, task, q)
    if motion.curve == "spline":
        return points, 0
    if np.all(np.abs(points[1] - q) <= AT_START):
        return np.delete(points, 1, axis=0), 0
    return points, 1


def _joints(problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array) -> Array:
    """q and the joints of all points, (n + 1, 4): on q's branch, revolute joints without jumps from point to point."""
    rows = q[None, :]
    for kind, group in groupby((*motion.through, motion.to), type):
        points = list(group)
        if kind is Joints:
            found = np.array([point.values for point in points if isinstance(point, Joints)])
        elif kind is Tip:
            tips = [point for point in points if isinstance(point, Tip)]
            positions, spins = np.array([tip.position for tip in tips]), [tip.spin for tip in tips]
            found, reaches = _of_tips(mechanism, positions, spins, rows[-1])
            if not reaches.all():
                raise _unreached(tips[int(np.argmin(reaches))], motion.file or problem.file)
        else:
            tasks = _filled(problem, mechanism, motion, points, task)
            found = np.stack(joints_of_task(NUMPY, mechanism, tasks.T, int(mechanism.branch_of(rows[-1]))), axis=1)
            turns = np.round((rows[-1] - found[0]) / (2 * np.pi))
            found = (found + 2 * np.pi * turns * (1, 1, 1, 0))[1:]
        rows = np.vstack([rows, found])
        task = task_from_joints(mechanism, found[-1:], near=task if kind is not Task else tasks[-1])[0]
    return rows


def _unreached(tip: Tip, file: str | None) -> ProblemError:
    value = ", ".join(f"{1e3 * x:.4g} mm" for x in tip.position)
    reason = "the mechanism cannot bring the tip there"
    return ProblemError(reason, file=file, line=tip.line, key="tip", value=value)


def without_repeats(points: Array) -> Array:
    """Of points (n, 4) those that differ from the one before; the first at any rate."""
    return np.asarray(points[np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1) > NOWHERE)])


def _filled(problem: Problem, mechanism: Mechanism, motion: Follow, points: Sequence[Point], task: Array) -> Array:
    """Task coordinates from where the robot is on, (n + 1, 4); those left out keep their values."""
    rows = [task]
    for point in points:
        assert isinstance(point, Task)
        rows.append(np.array([point.given.get(name, rows[-1][k]) for k, name in enumerate(TASK)]))
        refuse_tilt(problem, mechanism, float(rows[-1][1]), line=point.line, key="tilt", file=motion.file)
    return np.array(rows)


def _of_tips(mechanism: Mechanism, tips: Array, spins: ArrayLike, before: Array) -> tuple[Array, Flags]:
    """Joints (n, 4) that bring the tip there (n, 3) from beyond the remote centre, on the branch of the joints before (4,)
    and without jumps from these on; and which of them do (n,)."""
    found = inverse_tip(mechanism, tips, spins)
    column = 0 if mechanism.branch_of(before) > 0 else 1
    joints = found.joints[:, column]
    turned = np.unwrap(np.vstack([before, joints])[:, :3], axis=0)[1:]
    return np.column_stack([turned, joints[:, 3]]), found.reaches[:, column]


def _in_space(problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array) -> Array:
    """Joints (n, 4) along a line or an arc of the tip, its spin in proportion to the way. Raises ProblemError."""
    given = _joints(problem, mechanism, motion, task, q)
    tips, spins = tip_position(mechanism, given), [task[2]]
    for row in given[1:]:
        spins.append(task_from_joints(mechanism, row[None, :], near=[*task[:2], spins[-1], task[3]])[0, 2])
    curve = (_line if motion.curve == "line" else _arc)(tips)
    reason, keeps = "the three points of this arc lie on one line", "points that a circle passes"
    if curve is not None:
        at, off_curve = curve
        scale, off = np.array([joint.velocity for joint in problem.robot.joints]), np.inf
        for count in COUNTS:
            s = np.linspace(0.0, 1.0, count + 1)[1:]
            found, reaches = _of_tips(mechanism, at(s), spins[0] + s * (spins[-1] - spins[0]), q)
            points = without_repeats(np.vstack([q, found]))
            if not reaches.all() or len(points) == 1:
                break
            off = off_curve(
                tip_position(
                    mechanism, SplinePath(mechanism, points, scale).sample(np.linspace(0.0, 1.0, LOOKS * count + 1)).q
                )
            ).max()
            if off <= OFF:
                return points
        if len(points) == 1:
            return points
        reason = f"the joints cannot follow this {motion.curve}: the tip would leave it by {1e3 * off:.3g} mm"
        if not reaches.all():
            reason = f"the mechanism cannot bring the tip along all of this {motion.curve}"
        keeps = "a curve within the workspace, away from the remote centre"
    raise ProblemError(reason, file=problem.file, line=motion.line, key=motion.name, allowed=keeps)


def _line(tips: Array) -> Curve:
    """The straight line between two points."""
    first, way = tips[0], tips[1] - tips[0]
    length = np.linalg.norm(way)
    unit = way / length if length else way

    def off(points: Array) -> Array:
        ahead = points - first
        return np.asarray(np.linalg.norm(ahead - (ahead @ unit)[:, None] * unit, axis=1))

    return lambda s: first + s[:, None] * way, off


def _arc(tips: Array) -> Curve | None:
    """The circle from the first through the second to the third of three points; None where they lie on a line."""
    u, v = tips[1] - tips[0], tips[2] - tips[0]
    normal = np.cross(u, v)
    size = float(normal @ normal)
    if size <= (FLAT * np.linalg.norm(u) * np.linalg.norm(v)) ** 2:
        return None
    centre = tips[0] + ((u @ u) * np.cross(v, normal) + (v @ v) * np.cross(normal, u)) / (2 * size)
    first, normal = tips[0] - centre, normal / np.sqrt(size)
    radius, second = float(np.linalg.norm(first)), np.cross(normal, first)
    end = tips[2] - centre
    angle = float(np.arctan2(end @ second, end @ first)) % (2 * np.pi)

    def off(points: Array) -> Array:
        ahead = points - centre
        height = ahead @ normal
        return np.hypot(np.linalg.norm(ahead - height[:, None] * normal, axis=1) - radius, height)

    return lambda s: centre + np.cos(angle * s)[:, None] * first + np.sin(angle * s)[:, None] * second, off
