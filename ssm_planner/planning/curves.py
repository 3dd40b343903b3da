"""Joints along given curves: splines, tables of points, and lines and arcs of the tip."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import (
    Mechanism,
    inverse_tip,
    joints_of_task,
    pose_from_task,
    task_from_joints,
    tip_position,
)
from ssm_planner.planning.retiming.paths import TipPath
from ssm_planner.planning.scan_pattern import refuse_tilt, tips_over_retina
from ssm_planner.planning.tolerances import ROUNDING, SAME, SAMPLES
from ssm_planner.problem import TASK, Follow, Joints, Point, Problem, Task, Tip
from ssm_planner.typing import Array, Mask

Curve = tuple[Array, float]
"""Terms (4, 3) and angle of a TipPath."""
NEAR_CENTRE = 1e-5
"""Smallest distance of a line or arc from the remote centre, m.

Closer to it the joints cannot follow.
"""
AT_START = np.array([1e-4, 1e-4, 1e-4, 1e-5])
"""Distances (rad, m) within which the first point of a table counts as the present position."""


def points_of_curve(
    problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array
) -> tuple[Array, int]:
    """Return the points (n, 4) of a spline or table, and how many of them lead to its start.

    The first point is the present position q (4,) with task coordinates `task` (4,). One point
    leads to a table that begins elsewhere, otherwise none. Raises ProblemError if a point is out of
    reach.
    """
    points = _joints(problem, mechanism, motion, task, q)
    if motion.curve == "spline":
        return points, 0
    if np.all(np.abs(points[1] - q) <= AT_START):
        return np.delete(points, 1, axis=0), 0
    return points, 1


def _joints(problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array) -> Array:
    """Return q and the joints of all points, (n + 1, 4), on one branch and without jumps."""
    rows = q[None, :]
    for point_class, group in groupby((*motion.through, motion.to), type):
        points = list(group)
        if point_class is Joints:
            joints = np.array([point.values for point in points if isinstance(point, Joints)])
        elif point_class is Tip:
            tips = [point for point in points if isinstance(point, Tip)]
            positions = np.array([tip.position for tip in tips])
            spins = [tip.spin for tip in tips]
            joints, reaches = _of_tips(mechanism, positions, spins, rows[-1])
            if not reaches.all():
                missed = int(np.argmin(reaches))
                raise _unreached(problem, motion, tips[missed], len(rows) - 1 + missed)
        else:
            tasks = _complete_tasks(problem, mechanism, motion, points, task, index=len(rows) - 1)
            joints = np.stack(
                joints_of_task(NUMPY, mechanism, tasks.T, int(mechanism.branch_of(rows[-1]))),
                axis=1,
            )
            turns = np.round((rows[-1] - joints[0]) / (2 * np.pi))
            joints = (joints + 2 * np.pi * turns * (1, 1, 1, 0))[1:]
        rows = np.vstack([rows, joints])
        task = task_from_joints(
            mechanism, joints[-1:], near=task if point_class is not Task else tasks[-1]
        )[0]
    return rows


def _key(motion: Follow, k: int, name: str) -> str:
    """Return the key of point k of the motion.

    For tables the line number already locates the point.
    """
    if motion.file is not None:
        return name
    via_key = "through" if motion.curve == "arc" else f"through[{k}]"
    return f"{'to' if k == len(motion.through) else via_key}.{name}"


def _unreached(problem: Problem, motion: Follow, tip: Tip, k: int) -> ProblemError:
    """Return the error for a tip position that the mechanism cannot reach."""
    value = ", ".join(f"{1e3 * x:.4g} mm" for x in tip.position)
    reason = "the mechanism cannot bring the tip there"
    return ProblemError(
        reason,
        file=motion.file or problem.file,
        line=tip.line,
        key=_key(motion, k, "tip"),
        value=value,
    )


def without_repeats(points: Array) -> Array:
    """Return points (n, 4) without those that equal their predecessor."""
    return np.asarray(
        points[np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1) > ROUNDING)]
    )


def _complete_tasks(
    problem: Problem,
    mechanism: Mechanism,
    motion: Follow,
    points: Sequence[Point],
    task: Array,
    index: int = 0,
) -> Array:
    """Return task coordinates (n + 1, 4) of points after `task` (4,), without gaps.

    `index` is the index of the first point, for error messages.
    """
    rows = [task]
    for k, point in enumerate(points, index):
        assert isinstance(point, Task)
        rows.append(
            np.array([point.set_coordinates.get(name, rows[-1][k]) for k, name in enumerate(TASK)])
        )
        refuse_tilt(
            problem,
            mechanism,
            float(rows[-1][1]),
            line=point.line,
            key=_key(motion, k, "tilt"),
            file=motion.file,
        )
    return np.array(rows)


def _of_tips(
    mechanism: Mechanism, tips: Array, spins: ArrayLike, previous: Array
) -> tuple[Array, Mask]:
    """Return joints (n, 4) for tip positions (n, 3), and whether the mechanism reaches them, (n,).

    The tips lie beyond the remote centre. The joints are on the branch of `previous` (4,) and do
    not jump by a turn.
    """
    solutions = inverse_tip(mechanism, tips, spins)
    column = 0 if mechanism.branch_of(previous) > 0 else 1
    joints = solutions.joints[:, column]
    unwrapped = np.unwrap(np.vstack([previous, joints])[:, :3], axis=0)[1:]
    return np.column_stack([unwrapped, joints[:, 3]]), solutions.reaches[:, column]


def tip_curve(
    problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array
) -> TipPath | Array:
    """Return the path of the joints along a line or an arc of the tip, from q (4,) and `task` (4,).

    The spin changes in proportion to the path parameter. If the motion goes nowhere, q itself is
    returned. If it is radial, from or to the remote centre, its end (4,) is returned.

    Raises
    ------
    ProblemError
        If the curve is out of reach or passes the remote centre, or if an arc is a line.
    """
    joints, tips, spins = _points_of_tip_curve(problem, mechanism, motion, task, q)
    tip_stands = np.abs(tips - tips[0]).max() < ROUNDING
    if tip_stands and np.abs(joints - q).max() < ROUNDING and np.ptp(spins) < ROUNDING:
        return q

    def refused(reason: str, allowed: str, **place: str) -> ProblemError:
        return ProblemError(reason, file=problem.file, line=motion.line, allowed=allowed, **place)

    curve = _curve_through(problem, motion, tips)
    if curve is None:
        raise refused("the three points of this arc lie on one line", "points that a circle passes")
    if motion.constant_speed is not None and tip_stands:
        raise refused(
            "the tip does not move, so it cannot keep a speed",
            "a motion of the tip, or no constant_speed",
            key="constant_speed",
            value=f"{1e3 * motion.constant_speed:g} mm/s",
        )
    branch = int(mechanism.branch_of(q))
    driven = driven_joints(problem)
    path = TipPath(mechanism, *curve, (spins[0], spins[-1]), branch=branch, first=q, watched=driven)
    samples = path.tips(np.linspace(0.0, 1.0, SAMPLES))
    reason = f"the mechanism cannot bring the tip along all of this {motion.curve}"
    if inverse_tip(mechanism, samples, spins[0]).reaches[:, 0 if branch > 0 else 1].all():
        if np.linalg.norm(samples, axis=1).min() >= NEAR_CENTRE:
            return path
        reason = f"the tip would pass the remote centre along this {motion.curve}"
        if motion.curve == "line" and np.abs((joints[-1] - q)[:2]).max() < ROUNDING:
            return np.asarray(joints[-1])
    raise refused(reason, "a curve within the workspace, away from the remote centre")


def _curve_through(problem: Problem, motion: Follow, tips: Array) -> Curve | None:
    """Return the curve of the tip through points (n, 3). None if those of an arc lie on a line."""
    if motion.curve == "arc":
        return _arc(tips)
    if motion.curve == "retina" and problem.eye is not None:
        return _great_circle(tips, problem.eye.centre)
    return _line(tips)


def _points_of_tip_curve(
    problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array
) -> tuple[Array, Array, list[float]]:
    """Return joints (n, 4), tips (n, 3) and spins of the points of a line or an arc of the tip."""
    if motion.distance is not None:
        (end,) = _complete_tasks(problem, mechanism, motion, [motion.to], task)[1:]
        target = _over_retina(problem, mechanism, motion, end)
        tips = np.vstack([tip_position(mechanism, q[None]), target])
        return np.vstack([q, q]), tips, [float(task[2]), float(end[2])]
    joints = _joints(problem, mechanism, motion, task, q)
    spins = [float(task[2])]
    for row in joints[1:]:
        near = [*task[:2], spins[-1], task[3]]
        spins.append(float(task_from_joints(mechanism, row[None, :], near=near)[0, 2]))
    return joints, tip_position(mechanism, joints), spins


def _over_retina(problem: Problem, mechanism: Mechanism, motion: Follow, task: Array) -> Array:
    """Return the tip (1, 3) at its distance from the retina, in the direction of `task` (4,)."""
    # The tip at a depth of 1 m gives the direction.
    axis = pose_from_task(mechanism, [[*task[:3], 1.0]])[1]
    return tips_over_retina(problem, motion, axis, motion.distance or 0.0)


def at_distance(
    problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array
) -> Array:
    """Return the joints q (4,) with the depth at which the tip has its distance from the retina."""
    tip = tip_position(mechanism, q[None])
    target = _over_retina(problem, mechanism, motion, task)
    if np.linalg.norm(target - tip) <= SAME:
        return q
    return np.append(q[:3], mechanism.insertion_sign * np.linalg.norm(target))


def driven_joints(problem: Problem) -> tuple[int, ...]:
    """Return the indices of the joints that have a drive."""
    return tuple(i for i, joint in enumerate(problem.robot.joints) if joint.drive is not None)


def _line(tips: Array) -> Curve:
    """Return the straight line between two points."""
    return np.array([tips[0], tips[1] - tips[0], 0 * tips[0], 0 * tips[0]]), 0.0


def _great_circle(tips: Array, centre: Array) -> Curve:
    """Return the shorter great circle between two points about a centre (3,).

    Both points are equally far from the centre.
    """
    start, end = tips - centre
    tangent = end - start * (end @ start) / (start @ start)
    size = float(np.linalg.norm(tangent))
    angle = float(np.arctan2(size, end @ start / np.linalg.norm(start)))
    across = tangent * np.linalg.norm(start) / size if size else tangent
    return np.array([centre, 0 * centre, start, across]), angle


def _arc(tips: Array) -> Curve | None:
    """Return the circular arc through three points, or None if they lie on a line."""
    u, v = tips[1] - tips[0], tips[2] - tips[0]
    normal = np.cross(u, v)
    size = float(normal @ normal)
    if size <= (SAME * np.linalg.norm(u) * np.linalg.norm(v)) ** 2:
        return None
    centre = tips[0] + ((u @ u) * np.cross(v, normal) + (v @ v) * np.cross(normal, u)) / (2 * size)
    start, normal = tips[0] - centre, normal / np.sqrt(size)
    across, end = np.cross(normal, start), tips[2] - centre
    angle = float(np.arctan2(end @ across, end @ start)) % (2 * np.pi)
    return np.array([centre, 0 * centre, start, across]), angle
