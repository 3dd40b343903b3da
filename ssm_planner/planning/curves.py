"""Joints along given curves: splines, tables of points, and lines and arcs of the tip."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import (
    Mechanism,
    inverse_tip,
    joints_of_task,
    task_from_joints,
    tip_position,
)
from ssm_planner.planning.retiming.paths import TipPath
from ssm_planner.planning.scan_pattern import refuse_tilt, tips_over_retina, tool_axis
from ssm_planner.planning.tolerances import ROUNDING, SAME, SAMPLES
from ssm_planner.problem import TASK, Follow, Joints, Point, Problem, Task, Tip
from ssm_planner.typing import Array, Mask, record

Curve = tuple[Array, float]
"""Terms (4, 3) and angle of a TipPath."""
NEAR_CENTRE = 1e-5
"""Smallest distance of a line or arc from the remote centre, m.

Closer to it the joints cannot follow.
"""
AT_START = np.array([1e-4, 1e-4, 1e-4, 1e-5])
"""Distances (rad, m) within which the first point of a table counts as the present position."""


@record
class CurveFollower:
    """A motion along a curve from given joints.

    The properties raise ProblemError if a point is out of reach.
    """

    problem: Problem
    mechanism: Mechanism
    motion: Follow
    task: Array
    q: Array
    """Task coordinates and joints at the start of the motion, (4,) each."""

    @cached_property
    def joints(self) -> Array:
        """The joints q and those of all points, (n + 1, 4), on one branch and without jumps."""
        rows, task = self.q[None, :], self.task
        for point_class, group in groupby((*self.motion.through, self.motion.to), type):
            points = list(group)
            if point_class is Joints:
                joints = np.array([point.values for point in points if isinstance(point, Joints)])
            elif point_class is Tip:
                tips = [point for point in points if isinstance(point, Tip)]
                joints = self._joints_of_tips(tips, rows[-1], len(rows) - 1)
            else:
                tasks = self._complete_tasks(points, task, len(rows) - 1)
                branch = int(self.mechanism.branch_of(rows[-1]))
                joints = np.stack(joints_of_task(NUMPY, self.mechanism, tasks.T, branch), axis=1)
                turns = np.round((rows[-1] - joints[0]) / (2 * np.pi))
                joints = (joints + 2 * np.pi * turns * (1, 1, 1, 0))[1:]
                task = tasks[-1]
            rows = np.vstack([rows, joints])
            task = task_from_joints(self.mechanism, joints[-1:], near=task)[0]
        return rows

    @property
    def beginning(self) -> Array:
        """Joints (4,) at which the curve begins. They are q itself if the robot is there."""
        if self.motion.distance is not None:
            tip = tip_position(self.mechanism, self.q[None])
            target = self._over_retina(self.task)
            if np.linalg.norm(target - tip) <= SAME:
                return self.q
            return np.append(self.q[:3], self.mechanism.insertion_sign * np.linalg.norm(target))
        if self.motion.curve != "samples" or np.all(np.abs(self.joints[1] - self.q) <= AT_START):
            return self.q
        return np.asarray(self.joints[1])

    @property
    def points(self) -> Array:
        """Different points (n, 4) of a spline or table, from its beginning."""
        first = 1 if self.motion.curve == "spline" else 2
        points = np.vstack([self.beginning, self.joints[first:]])
        differs = np.abs(np.diff(points, axis=0)).max(axis=1) > ROUNDING
        return np.asarray(points[np.append(True, differs)])

    def tip_path(self) -> TipPath | Array:
        """Return the path of the joints along a line or an arc of the tip.

        The spin changes in proportion to the path parameter. If the motion goes nowhere, q itself
        is returned. If it is radial, from or to the remote centre, its end (4,) is returned.

        Raises
        ------
        ProblemError
            If the curve is out of reach or passes the remote centre, or if an arc is a line.
        """
        motion, q = self.motion, self.q
        joints, tips, spins = self._tip_points()
        tip_stands = np.abs(tips - tips[0]).max() < ROUNDING
        if tip_stands and np.abs(joints - q).max() < ROUNDING and np.ptp(spins) < ROUNDING:
            return q
        curve = self._curve_through(tips)
        if curve is None:
            reason = "the three points of this arc lie on one line"
            raise self._refused(reason, "points that a circle passes")
        if motion.constant_speed is not None and tip_stands:
            raise self._refused(
                "the tip does not move, so it cannot keep a speed",
                "a motion of the tip, or no constant_speed",
                key="constant_speed",
                value=f"{1e3 * motion.constant_speed:g} mm/s",
            )
        path = TipPath(
            self.mechanism,
            *curve,
            (spins[0], spins[-1]),
            branch=int(self.mechanism.branch_of(q)),
            first=q,
            watched=driven_joints(self.problem),
        )
        samples = path.tips(np.linspace(0.0, 1.0, SAMPLES))
        reason = f"the mechanism cannot bring the tip along all of this {motion.curve}"
        if _of_tips(self.mechanism, samples, spins[0], q)[1].all():
            if np.linalg.norm(samples, axis=1).min() >= NEAR_CENTRE:
                return path
            reason = f"the tip would pass the remote centre along this {motion.curve}"
            if motion.curve == "line" and np.abs((joints[-1] - q)[:2]).max() < ROUNDING:
                return np.asarray(joints[-1])
        raise self._refused(reason, "a curve within the workspace, away from the remote centre")

    def _refused(self, reason: str, allowed: str, **place: str) -> ProblemError:
        """Return the error for a curve that the tip cannot follow."""
        file, line = self.problem.file, self.motion.line
        return ProblemError(reason, file=file, line=line, allowed=allowed, **place)

    def _key(self, k: int, name: str) -> str:
        """Return the key of point k of the motion.

        For tables the line number already locates the point.
        """
        if self.motion.file is not None:
            return name
        via_key = "through" if self.motion.curve == "arc" else f"through[{k}]"
        return f"{'to' if k == len(self.motion.through) else via_key}.{name}"

    def _joints_of_tips(self, tips: Sequence[Tip], previous: Array, index: int) -> Array:
        """Return joints (n, 4) of points after joints `previous` (4,).

        `index` is the index of the first point, for error messages.
        """
        positions = np.array([tip.position for tip in tips])
        joints, reaches = _of_tips(self.mechanism, positions, [tip.spin for tip in tips], previous)
        if reaches.all():
            return joints
        k = int(np.argmin(reaches))
        raise ProblemError(
            "the mechanism cannot bring the tip there",
            file=self.motion.file or self.problem.file,
            line=tips[k].line,
            key=self._key(index + k, "tip"),
            value=", ".join(f"{1e3 * x:.4g} mm" for x in tips[k].position),
        )

    def _complete_tasks(self, points: Sequence[Point], task: Array, index: int = 0) -> Array:
        """Return `task` (4,) and the task coordinates of points after it, (n + 1, 4), without gaps.

        `index` is the index of the first point, for error messages.
        """
        rows = [task]
        for k, point in enumerate(points, index):
            assert isinstance(point, Task)
            stated = point.set_coordinates
            rows.append(np.array([stated.get(name, rows[-1][i]) for i, name in enumerate(TASK)]))
            refuse_tilt(
                self.problem,
                self.mechanism,
                float(rows[-1][1]),
                line=point.line,
                key=self._key(k, "tilt"),
                file=self.motion.file,
            )
        return np.array(rows)

    def _curve_through(self, tips: Array) -> Curve | None:
        """Return the curve of the tip through points (n, 3).

        None if those of an arc lie on a line.
        """
        if self.motion.curve == "arc":
            return _arc(tips)
        if self.motion.curve == "retina" and self.problem.eye is not None:
            start, end = tips - self.problem.eye.centre
            normal = np.cross(start, end)
            return _circle(tips, self.problem.eye.centre, normal / (np.linalg.norm(normal) or 1.0))
        return np.array([tips[0], tips[1] - tips[0], 0 * tips[0], 0 * tips[0]]), 0.0

    def _tip_points(self) -> tuple[Array, Array, Array]:
        """Return joints (n, 4), tips (n, 3) and spins (n,) of the points of a line or an arc."""
        if self.motion.distance is not None:
            tasks = self._complete_tasks([self.motion.to], self.task)
            start = tip_position(self.mechanism, self.q[None])
            tips = np.vstack([start, self._over_retina(tasks[-1])])
            return np.vstack([self.q, self.q]), tips, tasks[:, 2]
        spins = np.append(self.task[2], task_from_joints(self.mechanism, self.joints[1:])[:, 2])
        return self.joints, tip_position(self.mechanism, self.joints), np.unwrap(spins)

    def _over_retina(self, task: Array) -> Array:
        """Return the tip (1, 3) at its distance from the retina, in the direction of `task`."""
        axis = tool_axis(self.mechanism, task)
        return tips_over_retina(self.problem, self.motion, axis, self.motion.distance or 0.0)


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


def driven_joints(problem: Problem) -> tuple[int, ...]:
    """Return the indices of the joints that have a drive."""
    return tuple(i for i, joint in enumerate(problem.robot.joints) if joint.drive is not None)


def _circle(tips: Array, centre: Array, normal: Array) -> Curve:
    """Return the arc between the first and the last point about a centre and a unit vector (3,)."""
    start, end = tips[0] - centre, tips[-1] - centre
    across = np.cross(normal, start)
    return np.array([centre, 0 * centre, start, across]), float(
        np.arctan2(end @ across, end @ start)
    )


def _arc(tips: Array) -> Curve | None:
    """Return the circular arc through three points, or None if they lie on a line."""
    u, v = tips[1] - tips[0], tips[2] - tips[0]
    normal = np.cross(u, v)
    size = float(normal @ normal)
    if size <= (SAME * np.linalg.norm(u) * np.linalg.norm(v)) ** 2:
        return None
    centre = tips[0] + ((u @ u) * np.cross(v, normal) + (v @ v) * np.cross(normal, u)) / (2 * size)
    terms, angle = _circle(tips, centre, normal / np.sqrt(size))
    return terms, angle % (2 * np.pi)
