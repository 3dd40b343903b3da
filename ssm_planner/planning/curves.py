"""The joints along given curves: through points of any form, and of lines and arcs of the tool's tip."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.inverse import inverse_tip
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.solutions import Flags
from ssm_planner.kinematics.task import joints_of_task, pose_from_task, task_from_joints
from ssm_planner.planning.retiming.paths import TipPath
from ssm_planner.planning.scan_pattern import refuse_tilt, tips_over_retina
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import Follow, Joints, Point, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array

Curve = tuple[Array, float]
"""Terms and angle of a TipPath."""
NOWHERE = 1e-9
"""A motion over less than this (rad, m) goes nowhere."""
FLAT = 1e-6
"""Sine of the angle between two sides of a triangle up to which it is a line."""
LOOKS = 401
"""Points of a line or an arc of which the mechanism has to reach every one."""
NEAR_CENTRE = 1e-5
"""m from the remote centre, nearer than which a line or an arc has no joints to follow it."""
AT_START = np.array([1e-4, 1e-4, 1e-4, 1e-5])
"""rad and m within which the first point of a table is where the robot is."""
OVER_RETINA = 1e-7
"""m within which the tip is at its distance from the retina."""


def points_of_curve(
    problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array
) -> tuple[Array, int]:
    """Points (n, 4) of a spline or table from where the robot is, task (4,) and q (4,) on; and how many of them lead to it.

    None do, but one to a table that begins elsewhere. Raises ProblemError for what is out of reach.
    """
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
                missed = int(np.argmin(reaches))
                raise _unreached(problem, motion, tips[missed], len(rows) - 1 + missed)
        else:
            tasks = _filled(problem, mechanism, motion, points, task, first=len(rows) - 1)
            found = np.stack(
                joints_of_task(NUMPY, mechanism, tasks.T, int(mechanism.branch_of(rows[-1]))),
                axis=1,
            )
            turns = np.round((rows[-1] - found[0]) / (2 * np.pi))
            found = (found + 2 * np.pi * turns * (1, 1, 1, 0))[1:]
        rows = np.vstack([rows, found])
        task = task_from_joints(
            mechanism, found[-1:], near=task if kind is not Task else tasks[-1]
        )[0]
    return rows


def _key(motion: Follow, k: int, name: str) -> str:
    """Of a point of the motion, below it; a table's line says more."""
    if motion.file is not None:
        return name
    passed = "through" if motion.curve == "arc" else f"through[{k}]"
    return f"{'to' if k == len(motion.through) else passed}.{name}"


def _unreached(problem: Problem, motion: Follow, tip: Tip, k: int) -> ProblemError:
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
    """Of points (n, 4) those that differ from the one before; the first at any rate."""
    return np.asarray(
        points[np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1) > NOWHERE)]
    )


def _filled(
    problem: Problem,
    mechanism: Mechanism,
    motion: Follow,
    points: Sequence[Point],
    task: Array,
    first: int = 0,
) -> Array:
    """Task coordinates from where the robot is on, (n + 1, 4); what is left out is kept. first: place of the first point."""
    rows = [task]
    for k, point in enumerate(points, first):
        assert isinstance(point, Task)
        rows.append(np.array([point.given.get(name, rows[-1][k]) for k, name in enumerate(TASK)]))
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
    mechanism: Mechanism, tips: Array, spins: ArrayLike, before: Array
) -> tuple[Array, Flags]:
    """Joints (n, 4) that bring the tip there (n, 3) from beyond the remote centre, on the branch of the joints before (4,)
    and without jumps from these on; and which of them do (n,)."""
    found = inverse_tip(mechanism, tips, spins)
    column = 0 if mechanism.branch_of(before) > 0 else 1
    joints = found.joints[:, column]
    turned = np.unwrap(np.vstack([before, joints])[:, :3], axis=0)[1:]
    return np.column_stack([turned, joints[:, 3]]), found.reaches[:, column]


def tip_curve(
    problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array
) -> TipPath | Array:
    """The joints along a line or an arc of the tip from where the robot is, task (4,) and q (4,) on, spin in proportion.

    Where it goes nowhere q itself; radially from or to the remote centre its end, (4,). Raises ProblemError.
    """
    if motion.distance is None:
        given = _joints(problem, mechanism, motion, task, q)
        tips, spins = tip_position(mechanism, given), [float(task[2])]
        for row in given[1:]:
            spins.append(
                float(
                    task_from_joints(mechanism, row[None, :], near=[*task[:2], spins[-1], task[3]])[
                        0, 2
                    ]
                )
            )
    else:
        (end,) = _filled(problem, mechanism, motion, [motion.to], task)[1:]
        tips = np.vstack(
            [tip_position(mechanism, q[None]), _over_retina(problem, mechanism, motion, end)]
        )
        given, spins = np.vstack([q, q]), [float(task[2]), float(end[2])]
    if (
        np.abs(given - q).max() < NOWHERE
        and np.abs(tips - tips[0]).max() < NOWHERE
        and np.ptp(spins) < NOWHERE
    ):
        return q
    found = _arc(tips) if motion.curve == "arc" else _line(tips)
    if motion.curve == "retina" and problem.eye is not None:
        found = _great_circle(tips, problem.eye.centre)
    reason, keeps = "the three points of this arc lie on one line", "points that a circle passes"
    if found is not None:
        terms, angle = found
        if motion.constant_speed is not None and np.abs(tips - tips[0]).max() < NOWHERE:
            reason, keeps = (
                "the tip does not move, so it has no speed to keep",
                "a motion of the tip, or no constant_speed",
            )
            raise ProblemError(
                reason,
                file=problem.file,
                line=motion.line,
                key="constant_speed",
                value=f"{1e3 * motion.constant_speed:g} mm/s",
                allowed=keeps,
            )
        branch, driven = int(mechanism.branch_of(q)), driven_joints(problem)
        path = TipPath(
            mechanism, terms, angle, (spins[0], spins[-1]), branch=branch, first=q, watched=driven
        )
        at = path.tips(np.linspace(0.0, 1.0, LOOKS))
        nearest = np.linalg.norm(at, axis=1).min()
        keeps = "a curve within the workspace, away from the remote centre"
        reason = f"the mechanism cannot bring the tip along all of this {motion.curve}"
        if inverse_tip(mechanism, at, spins[0]).reaches[:, 0 if branch > 0 else 1].all():
            if nearest >= NEAR_CENTRE:
                return path
            reason = f"the joints cannot follow this {motion.curve}: the tip would pass the remote centre"
            if motion.curve == "line" and np.abs((given[-1] - q)[:2]).max() < NOWHERE:
                return np.asarray(given[-1])
    raise ProblemError(reason, file=problem.file, line=motion.line, allowed=keeps)


def _over_retina(problem: Problem, mechanism: Mechanism, motion: Follow, task: Array) -> Array:
    """The tip (1, 3) of a tool that points as task coordinates (4,) say, at its distance from the retina."""
    axis = pose_from_task(mechanism, [[*task[:3], 1.0]])[1]  # the tip at a depth of 1 m
    return tips_over_retina(problem, motion, axis, motion.distance or 0.0)


def at_distance(
    problem: Problem, mechanism: Mechanism, motion: Follow, task: Array, q: Array
) -> Array:
    """The joints q (4,), of task coordinates (4,), with the tool as deep as a distance from the retina asks."""
    tip = tip_position(mechanism, q[None])
    wanted = _over_retina(problem, mechanism, motion, task)
    if np.linalg.norm(wanted - tip) <= OVER_RETINA:
        return q
    return np.append(q[:3], mechanism.insertion_sign * np.linalg.norm(wanted))


def driven_joints(problem: Problem) -> tuple[int, ...]:
    """Those with a drive."""
    return tuple(i for i, joint in enumerate(problem.robot.joints) if joint.drive is not None)


def _line(tips: Array) -> Curve:
    """The straight line between two points."""
    return np.array([tips[0], tips[1] - tips[0], 0 * tips[0], 0 * tips[0]]), 0.0


def _great_circle(tips: Array, centre: Array) -> Curve:
    """From the first to the second of two points that are as far from a centre (3,), the shorter way about it."""
    first, last = tips - centre
    along = last - first * (last @ first) / (first @ first)
    size = float(np.linalg.norm(along))
    angle = float(np.arctan2(size, last @ first / np.linalg.norm(first)))
    second = along * np.linalg.norm(first) / size if size else along
    return np.array([centre, 0 * centre, first, second]), angle


def _arc(tips: Array) -> Curve | None:
    """The circle from the first through the second to the third of three points; None where they lie on a line."""
    u, v = tips[1] - tips[0], tips[2] - tips[0]
    normal = np.cross(u, v)
    size = float(normal @ normal)
    if size <= (FLAT * np.linalg.norm(u) * np.linalg.norm(v)) ** 2:
        return None
    centre = tips[0] + ((u @ u) * np.cross(v, normal) + (v @ v) * np.cross(normal, u)) / (2 * size)
    first, normal = tips[0] - centre, normal / np.sqrt(size)
    second, end = np.cross(normal, first), tips[2] - centre
    angle = float(np.arctan2(end @ second, end @ first)) % (2 * np.pi)
    return np.array([centre, 0 * centre, first, second]), angle
