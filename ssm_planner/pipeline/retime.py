"""Timing of a given joint path: the fastest motion along it within the limits.

`retime` is the public function, and the command `ssm-planner retime` calls it. It converts the path
to a problem whose motions follow splines, and plans this problem with TOPP-RA.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError
from ssm_planner.formats.points import Reading
from ssm_planner.formats.read import read_trajectory
from ssm_planner.kinematics import Mechanism, check_rows
from ssm_planner.loading.load import load_problem, load_robot
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.retiming.paths import MAX_GRID_INTERVALS, SplinePath, split_at_corners
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE
from ssm_planner.plans import Plan
from ssm_planner.problem import Follow, Joints, Problem, Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

POINTS_PER_PIECE = 4
"""Number of points that are sampled from each polynomial piece of a trajectory.

A spline through them follows the polynomials closely.
"""


@checked
def retime(
    path: ArrayLike | Trajectory | str | Path,
    robot: Robot | str | Path | None = None,
    problem: Problem | str | Path | None = None,
) -> Plan:
    """Time a joint path as fast as the limits allow, and check the motion.

    Parameters
    ----------
    path : (n, 4) array, Trajectory, or file
        Joint positions in rad and m, a motion whose path is kept, or a file that
        `ssm-planner check` reads. The motion follows the smooth curve through the points, and
        stops at the points where the path has a corner.
    robot : Robot or file
        Robot whose limits hold. Only allowed without `problem`.
    problem : Problem or file
        Problem whose robot and task limits hold.

    Returns
    -------
    Plan
        The certified motion, or a plan without a motion that holds the reason.

    Raises
    ------
    GeometryError
        If an array is not (n, 4) or a value is not finite.
    ProblemError
        If neither or both of `robot` and `problem` are given, or if the path does not move or
        has too many points.
    TrajectoryError
        If a file cannot be read.

    Examples
    --------
    >>> import ssm_planner
    >>> q = [[-0.5, 0.5, 0.2, 0.0], [-0.3, 0.7, 0.1, 0.0], [-0.2, 0.9, 0.0, 0.0]]
    >>> ssm_planner.retime(q, "vitreoretinal").passed
    True
    """
    robot, base = robot_with_limits(robot, problem)
    if isinstance(path, (str, Path)):
        reading = read_trajectory(path, robot)
        name = f"{Path(path).stem}_retimed"
        return plan(retiming_problem(reading, robot, base, name)[0])
    points = Reading(path, "smooth pieces", None) if isinstance(path, Trajectory) else path
    return plan(retiming_problem(points, robot, base, "retimed")[0])


def robot_with_limits(
    robot: Robot | str | Path | None, problem: Problem | str | Path | None
) -> tuple[Robot, Problem | None]:
    """Return the robot and the problem whose limits apply to the timing of a path.

    Exactly one argument must be given. A problem adds limits on the tool and on task coordinates to
    those of its robot. Files are read.

    Parameters
    ----------
    robot : Robot, file or None
        The robot.
    problem : Problem, file or None
        The problem, which contains a robot.

    Returns
    -------
    robot : Robot
        The robot, or that of the problem.
    problem : Problem or None
        The problem. None if only a robot is given.

    Raises
    ------
    ProblemError
        If both or neither are given, or if a file is invalid.
    """
    if problem is None and robot is not None:
        return (robot if isinstance(robot, Robot) else load_robot(robot)), None
    if problem is None or robot is not None:
        raise ProblemError("pass either a robot or a problem", key="robot")
    base = problem if isinstance(problem, Problem) else load_problem(problem)
    return base.robot, base


def retiming_problem(
    path: ArrayLike | Reading, robot: Robot, base: Problem | None, name: str
) -> tuple[Problem, Array]:
    """Build the problem of following a path as fast as the limits allow.

    The path is divided at its corners. The motion follows a spline through each part and stops in
    between.

    Parameters
    ----------
    path : (n, 4) array or Reading
        Joint positions in rad and m, or a motion that was read from a file.
    robot : Robot
        Robot that follows the path.
    base : Problem or None
        Problem whose limits on the tool and on the task apply. None: only the robot's limits.
    name : str
        Name of the new problem.

    Returns
    -------
    problem : Problem
        One `Follow` motion for each smooth part of the path.
    deviation : (4,) array
        Largest distance of each joint from the straight lines between the points, rad and m.

    Raises
    ------
    GeometryError
        If an array is not (n, 4) or a value is not finite.
    ProblemError
        If the path does not move or has too many points.
    """
    q = _points(path) if isinstance(path, Reading) else check_rows("path", path, 4)
    if len(q) > MAX_GRID_INTERVALS:
        raise ProblemError(f"{len(q)} points", key="path", allowed=f"at most {MAX_GRID_INTERVALS}")
    low, high = np.array([joint.position for joint in robot.joints]).T
    clipped = np.clip(q, low, high)
    # Recorded points may lie outside the range by rounding.
    q = np.where(np.abs(q - clipped) <= EQUALITY_TOLERANCE, clipped, q)
    velocities = robot.velocities
    smooth_parts = split_at_corners(q, velocities)
    if not smooth_parts:
        raise ProblemError("this path has length zero: all its points are equal", key="path")
    mechanism = Mechanism.from_robot(robot)
    deviations = [
        SplinePath(mechanism, part, velocities).deviation_from_lines for part in smooth_parts
    ]
    points = [list(map(Joints.from_array, part)) for part in smooth_parts]
    motion = tuple(
        Follow(part[-1], tuple(part[1:-1]), f"path {k}") for k, part in enumerate(points, 1)
    )
    start = points[0][0]
    problem = replace(
        base or Problem(robot, start, motion),
        name=name,
        start=start,
        motion=motion,
        planner="toppra",
        objective="time",
        duration=None,
        start_rate={},
        end_rate={},
    )
    return problem, np.max(deviations, axis=0)


def _points(reading: Reading) -> Array:
    """Sample joint positions along a motion that was read from a file.

    If the file contains smooth polynomials, `POINTS_PER_PIECE` points of each are taken. If it
    contains points, or more pieces than `MAX_GRID_INTERVALS` allows, the ends of the pieces
    suffice.

    Parameters
    ----------
    reading : Reading
        The motion as joint polynomials, with its resolution if the file contains points.

    Returns
    -------
    (n, 4) array
        Joint positions, rad and m.
    """
    breaks = reading.trajectory.breaks
    has_pieces = reading.resolution is None and POINTS_PER_PIECE * len(breaks) <= MAX_GRID_INTERVALS
    count = POINTS_PER_PIECE if has_pieces else 1
    piece_position = np.arange(count * (len(breaks) - 1) + 1) / count
    return reading.trajectory.positions(np.interp(piece_position, np.arange(len(breaks)), breaks))
