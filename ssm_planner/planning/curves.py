"""Compute the joint positions along the curves of a motion list.

The motion list of a problem may contain curves: splines, tables of points, and lines and arcs of
the tip. The module `phases.py` creates a `CurveFollower` for each of these entries.
"""

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
from ssm_planner.planning.scan_pattern import complete_task, tips_over_retina, tool_axis
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, PATH_SAMPLES, ROUNDING_TOLERANCE
from ssm_planner.problem import Follow, Joints, Point, Problem, Task, Tip
from ssm_planner.typing import Array, Mask, record

CurveTerms = tuple[Array, float]
"""The fields `terms` (4, 3), m, and `angle`, rad, of a `TipPath`, which describe a line or an arc.
"""
MIN_CENTRE_DISTANCE = 1e-5
"""Smallest distance of a line or arc from the remote centre, m.

All axes of rotation meet at the remote centre. Closer to it than this distance, the direction of
the tool would change too fast along the curve.
"""
START_TOLERANCES = np.array([1e-4, 1e-4, 1e-4, 1e-5])
"""Largest joint distances (rad, m) at which the robot counts as being at a table's first point.

If a joint is farther away, the robot first makes a free motion to the first point.
"""


@record
class CurveFollower:
    """Entry of the motion list that follows a curve, and the state of the robot at its start.

    `joints`, `beginning`, `points` and `tip_path` raise ProblemError if the mechanism cannot reach
    a point of the curve.
    """

    problem: Problem
    """Problem with its limits."""
    mechanism: Mechanism
    """Geometry of the robot."""
    motion: Follow
    """Entry of the motion list."""
    task: Array
    """Task coordinates at the start of the motion, (4,), rad and m."""
    q: Array
    """Joint positions at the start of the motion, (4,), rad and m."""

    @cached_property
    def joints(self) -> Array:
        """Joint positions at the start and at all n points of the curve, (n + 1, 4), rad and m.

        They lie on one branch, that is, they all follow the same one of the two solutions of the
        inverse kinematics, without jumps by a whole turn. Points that the problem gives as joint
        positions are taken as they are.
        """
        # Consecutive points that are given in the same kind of coordinates are converted together.
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
                # Row 0 of `tasks` and `joints` is the previous point. The whole turns by which it
                # differs from its known joint positions are added to all points.
                turns = np.round((rows[-1] - joints[0]) / (2 * np.pi))
                # Joint 4 translates, so it does not turn.
                joints = (joints + 2 * np.pi * turns * (1, 1, 1, 0))[1:]
                task = tasks[-1]
            rows = np.vstack([rows, joints])
            task = task_from_joints(self.mechanism, joints[-1:], near=task)[0]
        return rows

    @property
    def beginning(self) -> Array:
        """Joint positions (4,) at which the curve begins, rad and m.

        A table begins at its first point, and a motion at a given distance from the retina begins
        at this distance. The robot may have to move there first. If it is there already, or for any
        other curve, the result is `q` itself (the same object, for which the caller can test).
        """
        if self.motion.distance is not None:
            tip = tip_position(self.mechanism, self.q[None])
            target = self._tip_over_retina(self.task)
            if np.linalg.norm(target - tip) <= EQUALITY_TOLERANCE:
                return self.q
            # Joints 1 to 3 keep the direction. Joint 4 moves the tip to its depth, |target|.
            return np.append(self.q[:3], self.mechanism.insertion_sign * np.linalg.norm(target))
        if self.motion.curve != "samples" or np.all(
            np.abs(self.joints[1] - self.q) <= START_TOLERANCES
        ):
            return self.q
        return np.asarray(self.joints[1])

    @property
    def points(self) -> Array:
        """Joint positions at the points of a spline or table, (n, 4), rad and m.

        The first row is `beginning`. A point that equals the one before it is left out.
        """
        # `beginning` replaces row 0, the present position. For a table it is the first point, so it
        # replaces row 1 too.
        first_row = 1 if self.motion.curve == "spline" else 2
        points = np.vstack([self.beginning, self.joints[first_row:]])
        differs = np.abs(np.diff(points, axis=0)).max(axis=1) > ROUNDING_TOLERANCE
        return np.asarray(points[np.append(True, differs)])

    def tip_path(self) -> TipPath | Array:
        """Build the joint path along which the tip follows a line or an arc.

        The spin changes in proportion to the path parameter.

        Returns
        -------
        TipPath or (4,) array
            The path, or the joint positions at the end (rad, m) in two cases. They are `q` if
            neither the tip nor a joint moves. They are those of the last point if a line leads
            along the tool axis to or through the remote centre, because then only joints 3 and 4
            move.

        Raises
        ------
        ProblemError
            If the mechanism cannot reach the whole curve, if any other curve passes the remote
            centre, if the three points of an arc lie on one line, or if the tip should keep a
            constant speed but stays at one point.
        """
        motion, q = self.motion, self.q
        joints, tips, spins = self._points_of_curve()
        tip_stands = np.abs(tips - tips[0]).max() < ROUNDING_TOLERANCE
        if (
            tip_stands
            and np.abs(joints - q).max() < ROUNDING_TOLERANCE
            and np.ptp(spins) < ROUNDING_TOLERANCE
        ):
            return q
        # Only an arc may lack a curve, if its three points lie on one line.
        curve = self._curve_through(tips)
        if curve is None:
            reason = "the three points of this arc lie on one line"
            raise self._curve_error(reason, "points that a circle passes")
        if motion.constant_speed is not None and tip_stands:
            raise self._curve_error(
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
            driven=driven_joints(self.problem),
        )
        # The mechanism must reach the whole curve, and the tip must stay away from the remote
        # centre.
        samples = path.tips(np.linspace(0.0, 1.0, PATH_SAMPLES))
        reason = f"the mechanism cannot bring the tip along all of this {motion.curve}"
        if _joints_of_tips(self.mechanism, samples, spins[0], q)[1].all():
            if np.linalg.norm(samples, axis=1).min() >= MIN_CENTRE_DISTANCE:
                return path
            reason = f"the tip would pass the remote centre along this {motion.curve}"
            # Joints 1 and 2 are at rest, so the tip moves on a radius through the remote centre.
            if motion.curve == "line" and np.abs((joints[-1] - q)[:2]).max() < ROUNDING_TOLERANCE:
                return np.asarray(joints[-1])
        raise self._curve_error(reason, "a curve within the workspace, away from the remote centre")

    def _curve_error(self, reason: str, allowed: str, **place: str) -> ProblemError:
        """Create the error for a curve that the tip cannot follow.

        Parameters
        ----------
        reason : str
            Why the tip cannot follow the curve.
        allowed : str
            What the problem may contain instead.
        **place : str
            The arguments `key` and `value`: the key of the problem file that causes the error, and
            its value. Empty if no single key is the cause.

        Returns
        -------
        ProblemError
            The error with the file and the line of the motion.
        """
        file, line = self.problem.file, self.motion.line
        return ProblemError(reason, file=file, line=line, allowed=allowed, **place)

    def _key_of_point(self, k: int, name: str) -> str:
        """Return the name under which an error message mentions a coordinate of a point.

        It is the key in the problem file, such as `through[0].depth`. For a point of a table it is
        only the coordinate, because the message states the line of the table.

        Parameters
        ----------
        k : int
            Index of the point. The points between start and end come first, and the end comes last.
        name : str
            Name of the coordinate.
        """
        if self.motion.file is not None:
            return name
        # An arc has a single point between start and end, so its key lacks an index.
        via_key = "through" if self.motion.curve == "arc" else f"through[{k}]"
        return f"{'to' if k == len(self.motion.through) else via_key}.{name}"

    def _joints_of_tips(self, tips: Sequence[Tip], previous: Array, index: int) -> Array:
        """Compute the joint positions for consecutive points that are positions of the tip.

        Parameters
        ----------
        tips : sequence of n Tip
            Positions of the tip, with spins.
        previous : (4,) array
            Joint positions at the point before them, rad and m.
        index : int
            Index of the first of them among all points of the motion, for error messages.

        Returns
        -------
        (n, 4) array
            Joint positions, rad and m. They stay on the branch of `previous`, that is, they follow
            the same one of the two solutions of the inverse kinematics.

        Raises
        ------
        ProblemError
            If the mechanism cannot reach a position.
        """
        positions = np.array([tip.position for tip in tips])
        joints, reaches = _joints_of_tips(
            self.mechanism, positions, [tip.spin for tip in tips], previous
        )
        if reaches.all():
            return joints
        k = int(np.argmin(reaches))
        raise ProblemError(
            "the mechanism cannot bring the tip there",
            file=self.motion.file or self.problem.file,
            line=tips[k].line,
            key=self._key_of_point(index + k, "tip"),
            value=", ".join(f"{1e3 * x:.4g} mm" for x in tips[k].position),
        )

    def _complete_tasks(self, points: Sequence[Point], task: Array, index: int = 0) -> Array:
        """Return the task coordinates of consecutive points, with values for omitted coordinates.

        A coordinate that a point omits keeps the value of the previous point.

        Parameters
        ----------
        points : sequence of n Point
            Points in task coordinates, that is, with some of roll, tilt, spin and depth. All of
            them must be of the class `Task`.
        task : (4,) array
            Task coordinates before the first point, rad and m.
        index : int
            Index of the first point among all points of the motion, for error messages.

        Returns
        -------
        (n + 1, 4) array
            `task` as row 0, and the coordinates of the points.

        Raises
        ------
        ProblemError
            If the mechanism cannot reach a tilt.
        """
        rows = [task]
        for k, point in enumerate(points, index):
            assert isinstance(point, Task)
            key, file = self._key_of_point(k, "tilt"), self.motion.file
            # Omitted coordinates are those of the previous point.
            rows.append(
                complete_task(self.problem, self.mechanism, point, rows[-1], key=key, file=file)
            )
        return np.array(rows)

    def _curve_through(self, tips: Array) -> CurveTerms | None:
        """Describe the line or arc of the tip through given points by its terms.

        Parameters
        ----------
        tips : (n, 3) array
            Points of the tip, m. The first one is the start of the curve. An arc has 3 points. A
            line and a curve along the retina have 2.

        Returns
        -------
        CurveTerms or None
            The vectors fixed, line, u and v, and the angle, of the curve fixed + s line + cos(s
            angle) u + sin(s angle) v with s from 0 to 1 (`TipPath`). None if the three points of an
            arc lie on one line.
        """
        if self.motion.curve == "arc":
            return _arc_through_points(tips)
        if self.motion.curve == "retina" and self.problem.eye is not None:
            start, end = tips - self.problem.eye.centre
            normal = np.cross(start, end)
            # `or 1.0` avoids 0 / 0 if start and end are equal. The arc then has the angle 0.
            return _arc_about_axis(
                tips, self.problem.eye.centre, normal / (np.linalg.norm(normal) or 1.0)
            )
        return np.array([tips[0], tips[1] - tips[0], 0 * tips[0], 0 * tips[0]]), 0.0

    def _points_of_curve(self) -> tuple[Array, Array, Array]:
        """Return the points of a line or arc. The first one is the start of the motion.

        Returns
        -------
        joints : (n, 4) array
            Joint positions, rad (joints 1 to 3) and m (joint 4). For a motion that keeps its
            distance from the retina, both rows are `q`, because such a motion does not need joint
            positions at its end.
        tips : (n, 3) array
            Positions of the tip, m.
        spins : (n,) array
            Spins, rad, without jumps by a whole turn.
        """
        if self.motion.distance is not None:
            tasks = self._complete_tasks([self.motion.to], self.task)
            start = tip_position(self.mechanism, self.q[None])
            tips = np.vstack([start, self._tip_over_retina(tasks[-1])])
            return np.vstack([self.q, self.q]), tips, tasks[:, 2]
        spins = np.append(self.task[2], task_from_joints(self.mechanism, self.joints[1:])[:, 2])
        return self.joints, tip_position(self.mechanism, self.joints), np.unwrap(spins)

    def _tip_over_retina(self, task: Array) -> Array:
        """Return the tip position in a given direction at the motion's distance from the retina.

        Parameters
        ----------
        task : (4,) array
            Task coordinates (rad, m), which give the direction of the tool. Their depth is not
            used.

        Returns
        -------
        (1, 3) array
            Position of the tip, m.

        Raises
        ------
        ProblemError
            If the tip cannot have this distance in this direction.
        """
        axis = tool_axis(self.mechanism, task)
        # A motion along the retina always has a distance. `or 0.0` tells this to the type checker.
        return tips_over_retina(self.problem, self.motion, axis, self.motion.distance or 0.0)


def _joints_of_tips(
    mechanism: Mechanism, tips: Array, spins: ArrayLike, previous: Array
) -> tuple[Array, Mask]:
    """Compute joint positions for consecutive positions of the tip.

    The tip lies on the far side of the remote centre, that is, at a positive depth.

    Parameters
    ----------
    mechanism : Mechanism
        Geometry of the robot.
    tips : (n, 3) array
        Positions of the tip, m.
    spins : float or (n,) array
        Spins, rad.
    previous : (4,) array
        Joint positions before them, rad and m. They determine the branch, that is, which of the two
        solutions of the inverse kinematics the result follows, and the whole turns.

    Returns
    -------
    joints : (n, 4) array
        Joint positions, rad and m, without jumps by a whole turn. They are those of the nearest
        pose where the mechanism cannot reach the position.
    reaches : (n,) mask
        True where the mechanism reaches the position.
    """
    solutions = inverse_tip(mechanism, tips, spins)
    # The solutions with depth > 0 come first: column 0 is the branch +1, and column 1 is −1.
    column = 0 if mechanism.branch_of(previous) > 0 else 1
    joints = solutions.joints[:, column]
    unwrapped = np.unwrap(np.vstack([previous, joints])[:, :3], axis=0)[1:]
    return np.column_stack([unwrapped, joints[:, 3]]), solutions.reaches[:, column]


def driven_joints(problem: Problem) -> tuple[int, ...]:
    """Return the indices of the robot's joints that have a drive."""
    return tuple(i for i, joint in enumerate(problem.robot.joints) if joint.drive is not None)


def _arc_about_axis(tips: Array, centre: Array, normal: Array) -> CurveTerms:
    """Describe the arc of a given circle from the first to the last of several points.

    The arc is fixed + cos(s angle) u + sin(s angle) v for s from 0 to 1. The vector fixed is its
    centre. The vector u leads from there to the start, and v is perpendicular to u and of equal
    length.

    Parameters
    ----------
    tips : (n, 3) array
        Points on the arc, m. Only the first and the last one are used.
    centre : (3,) array
        Centre of the circle, m.
    normal : (3,) array
        Unit vector perpendicular to the plane of the circle, or 0 for an arc of no length.

    Returns
    -------
    terms : (4, 3) array
        Vectors fixed, line (0 for an arc), u and v, m.
    angle : float
        Angle from the first to the last point about `normal`, from −π to π, rad.
    """
    start, end = tips[0] - centre, tips[-1] - centre
    across = np.cross(normal, start)
    return np.array([centre, 0 * centre, start, across]), float(
        np.arctan2(end @ across, end @ start)
    )


def _arc_through_points(tips: Array) -> CurveTerms | None:
    """Describe the circular arc through three points.

    Let u and v be the vectors from the first point to the second and the third one, and n = u × v.
    The vector w from the first point to the centre lies in the plane of u and v. The centre is
    equally far from all three points, so w · u = |u|² / 2 and w · v = |v|² / 2. The solution is

        w = (|u|² v × n + |v|² n × u) / (2 |n|²).

    Parameters
    ----------
    tips : (3, 3) array
        The points in their order on the arc, m.

    Returns
    -------
    CurveTerms or None
        The terms of `TipPath` and the angle from 0 to 2π, rad. None if the points lie on one line.
    """
    u, v = tips[1] - tips[0], tips[2] - tips[0]
    normal = np.cross(u, v)
    normal_squared = float(normal @ normal)
    # |n| = |u| |v| sin(angle between u and v), so the test bounds this sine.
    if normal_squared <= (EQUALITY_TOLERANCE * np.linalg.norm(u) * np.linalg.norm(v)) ** 2:
        return None
    centre = tips[0] + ((u @ u) * np.cross(v, normal) + (v @ v) * np.cross(normal, u)) / (
        2 * normal_squared
    )
    terms, angle = _arc_about_axis(tips, centre, normal / np.sqrt(normal_squared))
    # The arc turns about n in the positive sense, also by more than π, where atan2 is negative.
    return terms, angle % (2 * np.pi)
