"""Join the points of a joint motion as joint_trajectory_controller of ROS 2 does.

The motion between two points is a straight line if only positions are given. It is a cubic with
velocities, and a quintic with velocities and accelerations (ros2_controllers,
joint_trajectory_controller, trajectory representation). All readers of trajectory files build a
`Points` object and pass it to `interpolate_points`, which returns a `Reading`.

The module also rejects values that do not fit their column: degrees instead of radians, millimetres
instead of metres, and swapped columns.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.agreement import ExportContent
from ssm_planner.problem import Robot, TaskLimits
from ssm_planner.trajectory import (
    DEGREE,
    PIECES_PER_BLOCK,
    Trajectory,
    blocks,
    cubic_coefficients,
    quintic_coefficients,
)
from ssm_planner.typing import Array, Indices, Mask, record
from ssm_planner.verification import Certificate, LimitCheck
from ssm_planner.verification.check import check

IN_MEMORY_ROWS = 1_000_000
"""Number of points up to which points and coefficients are kept in memory instead of files."""


@record
class Points:
    """Positions of the joints at n times, with velocities and accelerations if they are known.

    Attributes
    ----------
    t : (n,) array
        Times, s.
    q : (n, 4) array
        Positions of joints 1 to 3 in rad, and of joint 4 in m. The array is in memory or in a file.
    qd, qdd : (n, 4) arrays or None
        Velocities and accelerations of the joints, in the same units per s and per s². None if no
        point states them.
    """

    t: Array
    q: Array
    qd: Array | None = None
    qdd: Array | None = None
    has_qd: Mask | None = None
    """Array (n,) that is True for points with velocities.

    None if all points have velocities, or if `qd` is None.
    """
    has_qdd: Mask | None = None
    """Array (n,) that is True for points with accelerations.

    None if all points have accelerations, or if `qdd` is None.
    """
    resolution: Array | None = None
    """Largest rounding error of the positions of each joint (4,), in the units of `q`.

    None if the rounding is unknown.
    """
    point_name: Callable[[int], str] = "point {}".format
    """Function that returns the name of a point for messages, given its index."""


@record
class Reading:
    """A trajectory that was read from a file, with the other data of the file.

    All readers of trajectory files return it. Its method `check` checks everything that the file
    contains.
    """

    trajectory: Trajectory
    interpolation: str
    """Description of the motion between the points, such as "cubic between points (…)"."""
    resolution: Array | None
    """Largest rounding error of the positions of each joint (4,), rad for joints 1 to 3, m for 4.

    None if no piece of the motion is a straight line in joint space.
    """
    notes: tuple[str, ...] = ()
    """Remarks on the file for the user."""
    checks: tuple[LimitCheck, ...] = ()
    """Results for data in the file that are not part of the trajectory, such as torque offsets."""
    start_rate: Mapping[str, float] = field(default_factory=dict)
    """Rates of task coordinates that the file declares at the start, rad/s or m/s.

    Coordinates without a rate are at rest.
    """
    end_rate: Mapping[str, float] = field(default_factory=dict)
    """Rates of task coordinates that the file declares at the end, rad/s or m/s."""
    content: ExportContent | None = None
    """Content that an export folder with this motion must have. None for a single file."""
    stops: tuple["Reading", ...] = ()
    """Controlled stops that the file contains as positions. `check` checks each of them."""

    def check(self, robot: Robot, limits: TaskLimits) -> Certificate:
        """Check the trajectory, its controlled stops and the other data of the file.

        Parameters
        ----------
        robot : Robot
            Robot that performs the motion.
        limits : TaskLimits
            Limits of the task, with the rates at both ends.

        Returns
        -------
        Certificate
            Result for every limit of the motion. If there are stops, it also contains the one
            result with the smallest margin of all stops.
        """
        certificate = check(
            self.trajectory,
            robot,
            limits,
            interpolation=self.interpolation,
            resolution=self.resolution,
        )
        checks = self.checks
        if self.stops:
            # A stop begins in motion, and ends at rest unless the motion itself ends moving. The
            # rate None allows any motion at an end.
            end_rate = None if limits.end_rate else limits.end_rate
            stop_limits = replace(limits, start_rate=None, end_rate=end_rate, motion=())
            results = []
            for stop in self.stops:
                resolution = stop.resolution if self.resolution is None else self.resolution
                result = check(stop.trajectory, robot, stop_limits, resolution=resolution)
                results.append(result.worst)
            tightest = min(results, key=lambda result: result.margin)
            checks += (replace(tightest, name="controlled stop", case=tightest.name),)
        return certificate.with_more(checks)

    def add_declared_rates(self, limits: TaskLimits) -> TaskLimits:
        """Return limits of a task with the rates that the file declares at the start and the end.

        A rate is the velocity of a task coordinate (roll, tilt, spin or depth). The motion must
        have the declared rates at its ends. Rates that the limits already contain take precedence.
        """
        start = limits.start_rate if limits.start_rate != {} else self.start_rate
        end = limits.end_rate if limits.end_rate != {} else self.end_rate
        return replace(limits, start_rate=start, end_rate=end)


def interpolate_points(points: Points, robot: Robot, notes: tuple[str, ...] = ()) -> Reading:
    """Build the trajectory through points as joint_trajectory_controller of ROS 2 does.

    Two points are joined by a straight line if at least one of them has no velocity, by a quintic
    if both have velocities and accelerations, and otherwise by a cubic.

    Parameters
    ----------
    points : Points
        Points of the motion.
    robot : Robot
        Robot that performs the motion.
    notes : tuple of str
        Notes that are passed on with the trajectory.

    Returns
    -------
    Reading
        The trajectory. Coefficients of a long trajectory are computed when they are used.

    Raises
    ------
    TrajectoryError
        If the points do not form a trajectory of this robot, for example if a time decreases or a
        unit is wrong.
    """
    check_points(points, robot)
    n = len(points.t)
    has_qd, has_qdd = points.has_qd, points.has_qdd
    if has_qd is None:
        has_qd = np.full(n, points.qd is not None)
    if has_qdd is None:
        has_qdd = np.full(n, points.qdd is not None)
    cubic = has_qd[:-1] & has_qd[1:]
    quintic = cubic & has_qdd[:-1] & has_qdd[1:]
    pieces: Any = _LazyCoefficients(points, cubic, quintic)
    trajectory = Trajectory(points.t, pieces if n > PIECES_PER_BLOCK else pieces[:], ())
    resolution = None
    if not cubic.all():
        # The rounding of positions changes the slopes of straight pieces.
        resolution = np.zeros(4) if points.resolution is None else points.resolution
    return Reading(trajectory, describe_interpolation(cubic, quintic), resolution, notes)


def large_array(shape: tuple[int, ...]) -> Array:
    """Return an uninitialised array of floats with a given shape (n, …).

    An array with more than `IN_MEMORY_ROWS` rows is mapped to a temporary file, so that the
    operating system can keep parts of it on the disk.
    """
    if shape[0] <= IN_MEMORY_ROWS:
        return np.empty(shape)
    with TemporaryFile() as file:
        return np.asarray(np.memmap(file, float, "w+", shape=shape))


def describe_interpolation(cubic: Mask, quintic: Mask) -> str:
    """Describe the interpolation between points in words, for certificates and notes.

    Parameters
    ----------
    cubic : (n,) array of bool
        True for pieces that are cubic or quintic. A piece is the motion between two consecutive
        points.
    quintic : (n,) array of bool
        True for quintic pieces.

    Returns
    -------
    str
        Description such as "cubic between points (positions and velocities given)".
    """
    if quintic.all():
        return "quintic between points (positions, velocities and accelerations given)"
    if cubic.all() and not quintic.any():
        return "cubic between points (positions and velocities given)"
    if not cubic.any():
        return "linear between points (only positions given)"
    counts = {
        "linear": np.count_nonzero(~cubic),
        "cubic": np.count_nonzero(cubic & ~quintic),
        "quintic": np.count_nonzero(quintic),
    }
    texts = [f"{count} {name}" for name, count in counts.items() if count]
    return f"mixed between points: {', '.join(texts)}"


def check_points(points: Points, robot: Robot) -> None:
    """Raise TrajectoryError if points do not form a trajectory of the robot.

    Faults are fewer than two points, values that are not finite, times that do not increase, wrong
    units and swapped columns. The message names the first faulty point, or the joint whose
    derivatives contradict its positions.

    Parameters
    ----------
    points : Points
        Points of a joint motion.
    robot : Robot
        Robot that shall perform the motion. Its joints determine the plausible values.
    """
    t = points.t
    n = len(t)
    if n < 2:
        raise TrajectoryError(f"{points.point_name(0)}: {n} point; a trajectory needs at least two")
    columns = (
        ("time", t),
        ("position", points.q),
        ("velocity", points.qd),
        ("acceleration", points.qdd),
    )
    for name, values in columns:
        if values is None:
            continue
        for block in blocks(n, PIECES_PER_BLOCK):
            finite = np.isfinite(values[block])
            if not finite.all():
                k = block.start + int(np.argwhere(~finite)[0][0])
                raise TrajectoryError(f"{points.point_name(k)}: {name} is not a finite number")
    backward = np.flatnonzero(t[1:] <= t[:-1])
    if len(backward):
        k = int(backward[0]) + 1
        fault = "the same time twice" if t[k] == t[k - 1] else "time goes back"
        raise TrajectoryError(
            f"{points.point_name(k)}: {fault}: {t[k]:.12g} s after {t[k - 1]:.12g} s"
        )
    for block in blocks(n, PIECES_PER_BLOCK):
        check_magnitudes(points.q[block], robot, points.point_name, block.start)
    if points.qd is not None and np.all(points.has_qd is None or points.has_qd):
        check_derivatives(t, points.q, points.qd, robot, ("positions", "velocities"))
        if points.qdd is not None and np.all(points.has_qdd is None or points.has_qdd):
            check_derivatives(t, points.qd, points.qdd, robot, ("velocities", "accelerations"))


@record
class _LazyCoefficients:
    """Coefficients (n − 1, 6, 4) of the pieces between n points, computed when they are used.

    An object of this class replaces the array of coefficients of a Trajectory, which would need
    more memory than the points of a long table. It supports indexing like this array.
    """

    points: Points
    """The n points. A piece is the motion between two consecutive points."""
    cubic: Mask
    """Array (n − 1,) that is True for pieces whose two points state velocities."""
    quintic: Mask
    """Array (n − 1,) that is True for pieces whose two points also state accelerations."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the array of coefficients: pieces, powers of time, joints."""
        return len(self.cubic), DEGREE + 1, 4

    def __getitem__(self, index: slice | Indices) -> Array:
        """Return the coefficients (m, 6, 4) of m pieces.

        Parameters
        ----------
        index : slice or array of int
            Indices of the pieces.

        Returns
        -------
        (m, 6, 4) array
            Coefficient of each power of the time (s) since the start of the piece, from 0 to 5, for
            each of the four joints. The position is in rad for joints 1 to 3 and in m for joint 4.
        """
        points = self.points
        start = np.arange(len(self.cubic))[index]
        tables = [table for table in (points.q, points.qd, points.qdd) if table is not None]
        starts = [table[start] for table in tables]
        ends = [table[start + 1] for table in tables]
        length = points.t[start + 1] - points.t[start]
        is_cubic = self.cubic[start] & ~self.quintic[start]
        is_quintic = self.quintic[start]
        # All pieces are first straight. Cubics and quintics then replace straight pieces.
        coefficients = np.zeros((len(length), DEGREE + 1, 4))
        coefficients[:, 0] = starts[0]
        coefficients[:, 1] = (ends[0] - starts[0]) / length[:, None]
        if is_cubic.any():
            curves = cubic_coefficients(length, tuple(starts[:2]), tuple(ends[:2]))
            coefficients[is_cubic] = curves[is_cubic]
        if is_quintic.any():
            curves = quintic_coefficients(length, tuple(starts), tuple(ends))
            coefficients[is_quintic] = curves[is_quintic]
        return coefficients


LARGEST_ANGLE = 8 * math.pi
"""Largest plausible joint angle, rad. Larger values are probably degrees."""
LARGEST_STROKE = 1.0
"""Largest plausible position of a prismatic joint, m. Larger values are probably millimetres."""
SHORT_TABLE_POINTS = 20
"""Number of points up to which derivatives are not compared with slopes.

In a short table, the joints may rest at every point and move in between.
"""
LARGEST_COMPARED_INTERVALS = 20_000
"""Largest number of intervals on which derivatives are compared with slopes.

In a table with more intervals, a selection at equal distances is compared.
"""
AGREEMENT_TOLERANCE = 0.05
"""Tolerance for the comparison of derivatives with slopes.

Derivatives = factor · slopes is fitted by least squares. The columns agree if the relative residual
and the deviation of the factor from 1 are smaller than the tolerance.
"""
UNIT_ERROR_FACTOR = 2.0
"""Ratio of derivatives to slopes beyond which the derivatives have another unit than the values."""
UNIT_CONFUSIONS = (
    (180 / math.pi, "degrees where radians are meant"),
    (1000.0, "millimetres where metres are meant"),
)
"""Ratios of units that are often confused, each with a hint for the user."""


def check_magnitudes(q: Array, robot: Robot, point_name: Callable[[int], str], start: int) -> None:
    """Raise TrajectoryError if a joint position is implausibly large.

    Values above `LARGEST_ANGLE` for a revolute joint, or above `LARGEST_STROKE` for a prismatic
    joint, suggest a wrong unit or swapped columns.

    Parameters
    ----------
    q : (n, 4) array
        Positions of joints 1 to 3 in rad, and of joint 4 in m.
    robot : Robot
        Robot that performs the motion.
    point_name : callable
        Function that returns the name of a point for messages, given its index.
    start : int
        Index of the first point of `q` in the table.
    """
    for i, joint in enumerate(robot.joints):
        k = int(np.argmax(np.abs(q[:, i])))
        value = float(q[k, i])
        if abs(value) > (LARGEST_STROKE if joint.slides else LARGEST_ANGLE):
            unit = "millimetres" if joint.slides else "degrees"
            raise TrajectoryError(
                f"{point_name(start + k)}: position of joint {joint.name} = {value:.6g} "
                f"{joint.unit}: this is too large for this kind of joint; are these {unit}, or "
                "are columns swapped?"
            )


def check_derivatives(
    t: Array, value: Array, derivative: Array, robot: Robot, names: tuple[str, str]
) -> None:
    """Raise TrajectoryError if derivatives have a wrong unit or belong to another joint.

    For each joint, the mean of the derivatives at both ends of an interval is compared with the
    slope of the values, that is, their change divided by the length of the interval. If the means
    are proportional to the slopes by a factor that is far from 1, the unit is wrong. If the means
    of another joint equal the slopes, columns are swapped.

    Parameters
    ----------
    t : (n,) array
        Instants, s.
    value, derivative : (n, 4) arrays
        Positions and velocities, or velocities and accelerations.
    robot : Robot
        Robot that performs the motion.
    names : (str, str)
        Names of the values and of the derivatives for messages, such as ("positions",
        "velocities").
    """
    if len(t) <= SHORT_TABLE_POINTS:
        return
    intervals = np.unique(np.linspace(0, len(t) - 2, LARGEST_COMPARED_INTERVALS).astype(int))
    slopes = (value[intervals + 1] - value[intervals]) / (t[intervals + 1] - t[intervals])[:, None]
    means = (derivative[intervals + 1] + derivative[intervals]) / 2
    for i, joint in enumerate(robot.joints):
        if not slopes[:, i].any():
            continue
        factor, residual = _fit_factor(slopes[:, i], means[:, i])
        # Between sparse points on a curve, the mean of two velocities differs from the slope.
        has_same_unit = 1 / UNIT_ERROR_FACTOR < factor < UNIT_ERROR_FACTOR
        if residual < AGREEMENT_TOLERANCE and has_same_unit:
            continue
        for k, neighbour in enumerate(robot.joints):
            swapped_factor, swapped_residual = _fit_factor(slopes[:, i], means[:, k])
            if _columns_agree(swapped_factor, swapped_residual):
                raise TrajectoryError(
                    f"the {names[1]} given for joint {neighbour.name} are those of joint "
                    f"{joint.name}: swapped columns?"
                )
        if residual < AGREEMENT_TOLERANCE:
            hint = ""
            for scale, text in UNIT_CONFUSIONS:
                if 1 / UNIT_ERROR_FACTOR < factor / scale < UNIT_ERROR_FACTOR:
                    hint = f": {text}?"
                elif 1 / UNIT_ERROR_FACTOR < 1 / factor / scale < UNIT_ERROR_FACTOR:
                    hint = f": {text} in the {names[0]}?"
            raise TrajectoryError(
                f"the {names[1]} of joint {joint.name} are {factor:.4g} times the slope of its "
                f"{names[0]}{hint}"
            )


def _columns_agree(factor: float, residual: float) -> bool:
    """Return True if two columns are equal, given the factor and the residual of `_fit_factor`."""
    return residual < AGREEMENT_TOLERANCE and abs(factor - 1) < AGREEMENT_TOLERANCE


def _fit_factor(slope: Array, mean: Array) -> tuple[float, float]:
    """Fit a factor between mean derivatives and slopes by least squares.

    Parameters
    ----------
    slope, mean : (n,) arrays
        Slopes of the values over n intervals, and the mean derivatives over these intervals.

    Returns
    -------
    factor : float
        Factor that minimises the norm of mean − factor · slope, or 0 if all mean derivatives are 0.
    residual : float
        This norm divided by the norm of `mean`, or 1 if all mean derivatives are 0.
    """
    size = float(np.linalg.norm(mean))
    if size == 0.0:
        return 0.0, 1.0
    factor = float(slope @ mean) / float(slope @ slope)
    return factor, float(np.linalg.norm(mean - factor * slope)) / size
