"""Join the points of a joint motion as joint_trajectory_controller does.

The motion between two points is a straight line if only positions are given, a cubic with
velocities, and a quintic with velocities and accelerations (ros2_controllers,
joint_trajectory_controller, trajectory representation).

Points are also checked for values that do not fit their column: degrees instead of radians,
millimetres instead of metres, swapped columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from tempfile import TemporaryFile

import numpy as np

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.agreement import Content
from ssm_planner.problem import Robot, TaskLimits
from ssm_planner.trajectory import BLOCK, DEGREE, Trajectory, blocks, cubics, quintics
from ssm_planner.typing import Array, Mask, record
from ssm_planner.verification import Certificate, LimitCheck
from ssm_planner.verification.check import check

LONG = 1_000_000
"""Number of points beyond which points and pieces are kept in temporary files."""


@record
class Points:
    """n points of a joint motion in the order of the robot's joints (rad, m, s).

    Tables have the shape (n, 4) and are in memory or in a file.
    """

    t: Array
    q: Array
    qd: Array | None = None
    qdd: Array | None = None
    has_qd: Mask | None = None
    """Mask (n,) of the points with velocities. None if all points have them, or none has."""
    has_qdd: Mask | None = None
    resolution: Array | None = None
    """Largest rounding error of the positions, (4,). None if the rounding is unknown."""
    place: Callable[[int], str] = "point {}".format
    """Function that names a point in messages."""


@record
class Reading:
    """A trajectory that was read from a file, with the other data of the file."""

    trajectory: Trajectory
    interpolation: str
    resolution: Array | None
    """Rounding error for `check`, (4,). None if every piece is smooth."""
    notes: tuple[str, ...] = ()
    checks: tuple[LimitCheck, ...] = ()
    """Limit checks of data in the file that are not part of the trajectory."""
    start_rate: Mapping[str, float] = field(default_factory=dict)
    """Rates of task coordinates that the file declares at the start, rad/s or m/s.

    Coordinates without a rate are at rest.
    """
    end_rate: Mapping[str, float] = field(default_factory=dict)
    """Rates of task coordinates that the file declares at the end, rad/s or m/s."""
    content: Content | None = None
    """Content that an export folder with this motion must have. None for a single file."""
    stops: tuple[Trajectory, ...] = ()
    """Controlled stops through the points of a table."""

    def check(self, robot: Robot, limits: TaskLimits) -> Certificate:
        """Check the trajectory and the other data of the file."""
        certificate = check(
            self.trajectory,
            robot,
            limits,
            interpolation=self.interpolation,
            resolution=self.resolution,
        )
        # A stop begins in motion, and ends at rest unless the motion itself ends moving.
        alone = replace(limits, start_rate=None, end_rate=limits.end_rate and None, motion=())
        found = [check(stop, robot, alone, resolution=self.resolution) for stop in self.stops]
        of_stops = [
            replace(worst, name="controlled stop", case=worst.name)
            for worst in sorted((each.worst for each in found), key=lambda line: line.margin)[:1]
        ]
        return certificate.with_more((*self.checks, *of_stops))

    def ends_on(self, limits: TaskLimits) -> TaskLimits:
        """Add the start and end rates that the file declares to limits.

        Rates that the limits already contain take precedence.
        """
        start = limits.start_rate if limits.start_rate != {} else self.start_rate
        end = limits.end_rate if limits.end_rate != {} else self.end_rate
        return replace(limits, start_rate=start, end_rate=end)


def join_points(points: Points, robot: Robot, notes: tuple[str, ...] = ()) -> Reading:
    """Build the trajectory through points.

    Parameters
    ----------
    points : Points
    robot : Robot
    notes : tuple[str, ...]
        Notes to pass on with the trajectory.

    Returns
    -------
    Reading

    Raises
    ------
    TrajectoryError
        If the points are not a trajectory of this robot, see `check_points`.
    """
    check_points(points, robot)
    n = len(points.t)
    unset = np.zeros(n, dtype=bool)
    velocity = unset if points.qd is None else ~unset if points.has_qd is None else points.has_qd
    acceleration = (
        unset if points.qdd is None else ~unset if points.has_qdd is None else points.has_qdd
    )
    cubic = velocity[:-1] & velocity[1:]
    quintic = cubic & acceleration[:-1] & acceleration[1:]
    coefficients = large_array((n - 1, DEGREE + 1, 4))
    for block in blocks(n - 1, BLOCK):
        coefficients[block] = _pieces(points, block, cubic[block], quintic[block])
    trajectory = Trajectory(points.t, coefficients, ())
    straight = not cubic.all()
    resolution = None
    if straight:
        resolution = np.zeros(4) if points.resolution is None else points.resolution
    return Reading(trajectory, describe(cubic, quintic), resolution, notes)


def large_array(shape: tuple[int, ...]) -> Array:
    """Return an array (n, …) of a given shape without values.

    More than `LONG` rows are in a temporary file. The system reads and writes its parts on demand.
    """
    if shape[0] <= LONG:
        return np.empty(shape)
    with TemporaryFile() as file:
        return np.asarray(np.memmap(file, float, "w+", shape=shape))


def describe(cubic: Mask, quintic: Mask) -> str:
    """Describe the interpolation between points in words.

    `cubic` is a mask (n,) of the pieces that are cubic or quintic, and `quintic` a mask (n,) of the
    quintic pieces.
    """
    if quintic.all():
        return "quintic between points (positions, velocities and accelerations given)"
    if cubic.all() and not quintic.any():
        return "cubic between points (positions and velocities given)"
    if not cubic.any():
        return "linear between points (only positions given)"
    counts = (("linear", ~cubic), ("cubic", cubic & ~quintic), ("quintic", quintic))
    return "mixed between points: " + ", ".join(
        f"{int(flags.sum())} {name}" for name, flags in counts if flags.any()
    )


def check_points(points: Points, robot: Robot) -> None:
    """Raise TrajectoryError if points do not form a trajectory of the robot.

    Faults are too few points, values that are not finite, times that do not increase, wrong units
    and swapped columns.
    """
    t = points.t
    n = len(points.t)
    if n < 2:
        raise TrajectoryError(f"{points.place(0)}: {n} point; a trajectory needs at least two")
    row_name = (
        ("time", t),
        ("position", points.q),
        ("velocity", points.qd),
        ("acceleration", points.qdd),
    )
    for name, values in row_name:
        if values is None:
            continue
        for block in blocks(n, BLOCK):
            finite = np.isfinite(values[block])
            if not finite.all():
                k = block.start + int(np.argwhere(~finite)[0][0])
                raise TrajectoryError(f"{points.place(k)}: {name} is not a finite number")
    backward = np.flatnonzero(t[1:] <= t[:-1])
    if len(backward):
        k = int(backward[0]) + 1
        fault = "the same time twice" if t[k] == t[k - 1] else "time goes back"
        raise TrajectoryError(f"{points.place(k)}: {fault}: {t[k]:.12g} s after {t[k - 1]:.12g} s")
    for block in blocks(n, BLOCK):
        check_magnitudes(points.q[block], robot, points.place, block.start)
    if points.qd is not None and points.has_qd is None:
        check_derivatives(t, points.q, points.qd, robot, ("positions", "velocities"))
        if points.qdd is not None and points.has_qdd is None:
            check_derivatives(t, points.qd, points.qdd, robot, ("velocities", "accelerations"))


def _pieces(points: Points, block: slice, cubic: Mask, quintic: Mask) -> Array:
    """Return the coefficients (m, 6, 4) of m pieces.

    `cubic` and `quintic` are masks (m,) of the pieces of at least these degrees.
    """
    sides = block, slice(block.start + 1, block.stop + 1)
    tables = [table for table in (points.q, points.qd, points.qdd) if table is not None]
    ends = [[table[side] for table in tables] for side in sides]
    length = points.t[sides[1]] - points.t[block]
    coefficients = np.zeros((len(length), DEGREE + 1, 4))
    coefficients[:, 0] = ends[0][0]
    coefficients[:, 1] = (ends[1][0] - ends[0][0]) / length[:, None]
    for flags, count, curves in ((cubic & ~quintic, 2, cubics), (quintic, 3, quintics)):
        if flags.any():
            states = (tuple(end[:count]) for end in ends)
            coefficients[flags] = curves(length, *states)[flags]
    return coefficients


LARGEST_ANGLE = 8 * math.pi
"""Largest plausible joint angle, rad. Larger values are probably degrees."""
LARGEST_STROKE = 1.0
"""Largest plausible stroke, m. Larger values are probably millimetres."""
FEW = 20
"""Number of intervals up to which slopes are not compared, because joints may rest in between."""
ENOUGH = 20_000
"""Largest number of intervals that are compared."""
ALIKE = 0.05
"""Largest relative residual, and deviation of the factor, for proportional columns."""
UNLIKE = 2.0
"""Factor beyond which velocities proportional to the slopes have a different unit."""
FACTORS = (
    (180 / math.pi, "degrees where radians are meant"),
    (1000.0, "millimetres where metres are meant"),
)


def check_magnitudes(q: Array, robot: Robot, place: Callable[[int], str], start: int) -> None:
    """Raise TrajectoryError if a position in q (n, 4) is too large for its kind of joint.

    `place` returns the name of a point for messages, and `start` is the index of the first row.
    """
    for i, joint in enumerate(robot.joints):
        k = int(np.argmax(np.abs(q[:, i])))
        value = float(q[k, i])
        if abs(value) > (LARGEST_STROKE if joint.slides else LARGEST_ANGLE):
            unit = "millimetres" if joint.slides else "degrees"
            raise TrajectoryError(
                f"{place(start + k)}: position of joint {joint.name} = {value:.6g} {joint.unit}: "
                f"this is too large for this kind of joint; are these {unit}, or are columns "
                "swapped?"
            )


def check_derivatives(
    t: Array, value: Array, derivative: Array, robot: Robot, names: tuple[str, str]
) -> None:
    """Raise TrajectoryError if a derivative has another unit or belongs to another joint.

    The mean derivative over each interval is compared with the slope of the values.

    Parameters
    ----------
    t : (n,)
        Instants, s.
    value, derivative : (n, 4)
        Values and their derivatives.
    robot : Robot
    names : (str, str)
        Names of the values and of the derivatives for messages.
    """
    if len(t) <= FEW:
        return
    intervals = np.unique(np.linspace(0, len(t) - 2, ENOUGH).astype(int))
    slopes = (value[intervals + 1] - value[intervals]) / (t[intervals + 1] - t[intervals])[:, None]
    means = (derivative[intervals + 1] + derivative[intervals]) / 2
    for i, joint in enumerate(robot.joints):
        if not slopes[:, i].any():
            continue
        factor, residual = _compare(slopes[:, i], means[:, i])
        # Between sparse points on a curve the mean of two velocities differs from the slope.
        if _same(factor, residual) or (residual < ALIKE and 1 / UNLIKE < factor < UNLIKE):
            continue
        for k, neighbour in enumerate(robot.joints):
            if _same(*_compare(slopes[:, i], means[:, k])):
                raise TrajectoryError(
                    f"the {names[1]} given for joint {neighbour.name} are those of joint "
                    f"{joint.name}: swapped columns?"
                )
        if residual < ALIKE:
            sides = (("", factor), (f" in the {names[0]}", 1 / factor))
            hints = (
                f": {text}{side}?"
                for scale, text in FACTORS
                for side, ratio in sides
                if 1 / UNLIKE < ratio / scale < UNLIKE
            )
            hint = next(hints, "")
            raise TrajectoryError(
                f"the {names[1]} of joint {joint.name} are {factor:.4g} times the slope of its "
                f"{names[0]}{hint}"
            )


def _same(factor: float, residual: float) -> bool:
    return residual < ALIKE and abs(factor - 1) < ALIKE


def _compare(slope: Array, mean: Array) -> tuple[float, float]:
    """Return the mean derivative as a multiple of the slope, and the relative residual."""
    size = float(np.linalg.norm(mean))
    if size == 0.0:
        return 0.0, 1.0
    factor = float(slope @ mean) / float(slope @ slope)
    return factor, float(np.linalg.norm(mean - factor * slope)) / size
