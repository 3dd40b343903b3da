"""Timing of a given joint path: the fastest motion along it within the limits.

`retime` is the public function, and the command `ssm-planner retime` does the same. The path
becomes a problem whose motions follow splines. TOPP-RA, a method that computes the fastest timing
of a given path, plans this problem.
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

A cubic spline through so many points follows the polynomials of degree 5 closely.
"""


@checked
def retime(
    path: ArrayLike | Trajectory | str | Path,
    robot: Robot | str | Path | None = None,
    problem: Problem | str | Path | None = None,
) -> Plan:
    """Compute the fastest motion along a joint path within the limits, and check it.

    The motion follows a smooth curve through the points, and stops where the path has a corner.

    Parameters
    ----------
    path : (n, 4) array, Trajectory, or file
        Joint positions in rad and m, a motion whose path is kept, or a file that
        `ssm-planner check` reads.
    robot : Robot or file
        Robot whose limits the motion keeps. Only allowed without `problem`.
    problem : Problem or file
        Problem whose limits of the robot and of the task the motion keeps. Only allowed without
        `robot`.

    Returns
    -------
    Plan
        The motion, which has passed the independent check, or the reason why planning failed.

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

    Exactly one of the arguments must be given. A problem adds limits on the tool and on task
    coordinates to the limits of its robot.

    Parameters
    ----------
    robot : Robot, file or None
        The robot, or a file from which it is read.
    problem : Problem, file or None
        The problem, which contains a robot, or a file from which it is read.

    Returns
    -------
    robot : Robot
        The given robot, or that of the problem.
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

    The path is divided at its corners. The motion follows a cubic spline through the points of each
    part, and stops between the parts.

    Parameters
    ----------
    path : (n, 4) array or Reading
        Joint positions in rad and m, or a motion that was read from a file.
    robot : Robot
        Robot that follows the path.
    base : Problem or None
        Problem whose limits on the tool and on task coordinates apply too. None: only the limits of
        the robot apply.
    name : str
        Name of the new problem.

    Returns
    -------
    problem : Problem
        Problem with one `Follow` motion for each smooth part of the path.
    deviation : (4,) array
        Largest deviation of each joint on the splines from the straight lines between the points,
        rad and m.

    Raises
    ------
    GeometryError
        If an array is not (n, 4) or a value is not finite.
    ProblemError
        If the path does not move or has too many points.
    """
    q = _points(path) if isinstance(path, Reading) else check_rows("path", path, 4)
    if not 1 <= len(q) <= MAX_GRID_INTERVALS:
        allowed = f"at least 1 and at most {MAX_GRID_INTERVALS}"
        raise ProblemError(f"{len(q)} points", key="path", allowed=allowed)
    low, high = np.array([joint.position for joint in robot.joints]).T
    clipped = np.clip(q, low, high)
    # Recorded points may lie outside of the range by rounding errors, which must not be an error.
    q = np.where(np.abs(q - clipped) <= EQUALITY_TOLERANCE, clipped, q)
    # Joint positions divided by the velocity limits are comparable in rad and m.
    velocities = robot.velocities
    smooth_parts = split_at_corners(q, velocities)
    if not smooth_parts:
        raise ProblemError("this path has length zero: all its points are equal", key="path")
    mechanism = Mechanism.from_robot(robot)
    deviations = [
        SplinePath(mechanism, part, velocities).deviation_from_lines for part in smooth_parts
    ]
    points = [list(map(Joints.from_array, part)) for part in smooth_parts]
    # Arguments of `Follow`: the end, the points between start and end, and the name.
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

    If the file contains smooth polynomials, `POINTS_PER_PIECE` points of each polynomial are taken.
    If the file contains single points, or if the polynomials would give more points than
    `MAX_GRID_INTERVALS`, only the ends of the pieces are taken.

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
    # 0.25, for example, is a quarter of the way along the first piece.
    piece_position = np.arange(count * (len(breaks) - 1) + 1) / count
    return reading.trajectory.positions(np.interp(piece_position, np.arange(len(breaks)), breaks))
