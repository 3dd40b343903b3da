"""A trajectory out of points, joined as joint_trajectory_controller joins them, and the faults of points.

Between two points the motion is a straight line where positions are given alone, a cubic with velocities, a quintic with
velocities and accelerations (ros2_controllers, joint_trajectory_controller, trajectory representation).

Signs that numbers are not what their column says: degrees as radians, millimetres as metres, swapped columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import BLOCK, DEGREE, Trajectory, quintics
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.certificate import LimitCheck

LONG = 1_000_000
"""Points beyond which pieces are made when they are asked for, block by block."""

Flags = NDArray[np.bool_]


class Blocks(Protocol):
    """A table that stays in a file, or is worked out: what is asked for comes into memory."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, chosen: Indices | slice, /) -> Array: ...


Table = Array | Blocks


@dataclass(frozen=True, eq=False)
class Points:
    """n points of a joint motion, in the order of the robot's joints; rad, m, s. Tables (n, 4), in memory or in a file."""

    t: Array
    q: Table
    qd: Table | None = None
    qdd: Table | None = None
    has_qd: Flags | None = None
    """(n,): the point has velocities; None: all have, where qd is given."""
    has_qdd: Flags | None = None
    resolution: Array | None = None
    """(4,): largest rounding error of the positions; None: not known to be rounded."""
    place: Callable[[int], str] = "point {}".format
    """How messages name a point."""


@dataclass(frozen=True, eq=False)
class Reading:
    """A trajectory as a file gives it, and what was made of the file."""

    trajectory: Trajectory
    interpolation: str
    resolution: Array | None
    """For `check`: None where every piece is smooth."""
    notes: tuple[str, ...] = ()
    checks: tuple[LimitCheck, ...] = ()
    """What the file says beside the trajectory, judged."""
    start_rate: Mapping[str, float] = field(default_factory=dict)
    """Rates of task coordinates that the file declares at the start, by name in TASK; 0 where not named."""
    end_rate: Mapping[str, float] = field(default_factory=dict)

    def ends_on(self, limits: TaskLimits) -> TaskLimits:
        """The limits with the rates at both ends that the file declares, where these declare none themselves."""
        start = limits.start_rate if limits.start_rate != {} else self.start_rate
        end = limits.end_rate if limits.end_rate != {} else self.end_rate
        return replace(limits, start_rate=start, end_rate=end)


def join_points(points: Points, robot: Robot, notes: tuple[str, ...] = ()) -> Reading:
    """The trajectory through points. Raises TrajectoryError where they are no trajectory of this robot."""
    check_points(points, robot)
    n = len(points.t)
    none = np.zeros(n, dtype=bool)
    velocity = none if points.qd is None else ~none if points.has_qd is None else points.has_qd
    acceleration = (
        none if points.qdd is None else ~none if points.has_qdd is None else points.has_qdd
    )
    cubic = velocity[:-1] & velocity[1:]
    quintic = cubic & acceleration[:-1] & acceleration[1:]
    pieces = PiecesOfPoints(points, cubic, quintic)
    coefficients = (
        cast("Array", pieces) if n > LONG else pieces[:]
    )  # an array as far as a trajectory needs one
    trajectory = Trajectory(points.t, coefficients, ())
    straight = not cubic.all()
    resolution = None
    if straight:
        resolution = np.zeros(4) if points.resolution is None else points.resolution
    return Reading(trajectory, describe(cubic, quintic), resolution, notes)


def describe(cubic: Flags, quintic: Flags) -> str:
    """The interpolation in words, from the pieces that are at least cubic and those that are quintic."""
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
    """Faults that make points no trajectory: too few, NaN, times that do not increase, wrong units, swapped columns."""
    t, n = points.t, len(points.t)
    if n < 2:
        raise TrajectoryError(f"{points.place(0)}: {n} point; a trajectory needs at least two")
    named = (
        ("time", t),
        ("position", points.q),
        ("velocity", points.qd),
        ("acceleration", points.qdd),
    )
    for name, values in named:
        for first in range(0, n, BLOCK):
            finite = np.isfinite(values[first : first + BLOCK] if values is not None else 0.0)
            if not finite.all():
                k = first + int(np.argwhere(~finite)[0][0])
                raise TrajectoryError(f"{points.place(k)}: {name} is not a finite number")
    back = np.flatnonzero(t[1:] <= t[:-1])
    if len(back):
        k = int(back[0]) + 1
        fault = "the same time twice" if t[k] == t[k - 1] else "time goes back"
        raise TrajectoryError(f"{points.place(k)}: {fault}: {t[k]:.12g} s after {t[k - 1]:.12g} s")
    for first in range(0, n, BLOCK):
        check_magnitudes(points.q[first : first + BLOCK], robot, points.place, first)
    if points.qd is not None and points.has_qd is None:
        check_derivatives(t, points.q, points.qd, robot, ("positions", "velocities"))
        if points.qdd is not None and points.has_qdd is None:
            check_derivatives(t, points.qd, points.qdd, robot, ("velocities", "accelerations"))


@dataclass(frozen=True, eq=False)
class PiecesOfPoints:
    """Coefficients (n − 1, 6, 4) of the pieces between n points, made where they are asked for."""

    points: Points
    cubic: Flags
    """(n − 1,)"""
    quintic: Flags

    @property
    def shape(self) -> tuple[int, ...]:
        return len(self.points.t) - 1, DEGREE + 1, 4

    def __getitem__(self, chosen: Indices | slice, /) -> Array:
        if not isinstance(chosen, slice):
            return self._made(chosen, chosen + 1, self.cubic[chosen], self.quintic[chosen])
        first, end, _ = chosen.indices(self.shape[0])
        out = np.empty((max(end - first, 0), *self.shape[1:]))
        for start in range(first, end, BLOCK):
            here = slice(start, min(start + BLOCK, end))
            ahead = slice(here.start + 1, here.stop + 1)
            out[start - first : here.stop - first] = self._made(
                here, ahead, self.cubic[here], self.quintic[here]
            )
        return out

    def _made(
        self, here: Indices | slice, ahead: Indices | slice, cubic: Flags, quintic: Flags
    ) -> Array:
        points = self.points
        length = points.t[ahead] - points.t[here]
        h, q0, q1 = length[:, None], points.q[here], points.q[ahead]
        if points.qd is not None and points.qdd is not None and quintic.all():
            return quintics(
                length,
                (q0, points.qd[here], points.qdd[here]),
                (q1, points.qd[ahead], points.qdd[ahead]),
            )
        out = np.zeros((len(h), DEGREE + 1, 4))
        out[:, 0], out[:, 1] = q0, (q1 - q0) / h
        if points.qd is not None and cubic.any():
            v0, v1 = points.qd[here], points.qd[ahead]
            slope = (q1 - q0) / h
            parts = (q0, v0, (3 * slope - 2 * v0 - v1) / h, (v0 + v1 - 2 * slope) / h**2)
            for k, part in enumerate(parts):
                out[:, k] = np.where(cubic[:, None], part, out[:, k])
            if points.qdd is not None and quintic.any():
                whole = quintics(length, (q0, v0, points.qdd[here]), (q1, v1, points.qdd[ahead]))
                out[quintic] = whole[quintic]
        return out


LARGEST_ANGLE = 8 * math.pi
"""rad: four turns; more are degrees."""
LARGEST_STROKE = 1.0
"""m; more are millimetres."""
FEW = 20
"""Intervals below which slopes are not compared with derivatives: points may rest in between."""
ENOUGH = 20_000
"""Intervals that are compared."""
ALIKE = 0.05
"""Residual and deviation of the factor, relative, up to which two columns are one the multiple of the other."""
UNLIKE = 2.0
"""Factor beyond which velocities that are a multiple of the slopes are of another unit."""
FACTORS = (
    (180 / math.pi, "degrees where radians are meant"),
    (1000.0, "millimetres where metres are meant"),
)


def check_magnitudes(q: Array, robot: Robot, place: Callable[[int], str], first: int) -> None:
    """Refuse positions q (n, 4) that no joint of its kind has. Raises TrajectoryError naming the point, from `first` on."""
    for i, joint in enumerate(robot.joints):
        revolute = joint.kind == "revolute"
        k = int(np.argmax(np.abs(q[:, i])))
        value = float(q[k, i])
        if abs(value) > (LARGEST_ANGLE if revolute else LARGEST_STROKE):
            unit, meant = ("rad", "degrees") if revolute else ("m", "millimetres")
            raise TrajectoryError(
                f"{place(first + k)}: position of joint {joint.name} = {value:.6g} {unit}: more than this kind of joint has; "
                f"are these {meant}, or are columns swapped?"
            )


def check_derivatives(
    t: Array, value: Table, derivative: Table, robot: Robot, names: tuple[str, str]
) -> None:
    """Derivatives that are not those of the values (n, 4): another unit, or another joint's. Raises TrajectoryError."""
    if len(t) <= FEW:
        return
    some = np.unique(np.linspace(0, len(t) - 2, min(len(t) - 1, ENOUGH)).astype(int))
    slopes = (value[some + 1] - value[some]) / (t[some + 1] - t[some])[:, None]
    means = (derivative[some + 1] + derivative[some]) / 2
    for i, joint in enumerate(robot.joints):
        if not slopes[:, i].any():
            continue
        factor, residual = _compare(slopes[:, i], means[:, i])
        # of few points on a curve the mean of two velocities is not quite the slope between them
        if _same(factor, residual) or (residual < ALIKE and 1 / UNLIKE < factor < UNLIKE):
            continue
        for k, other in enumerate(robot.joints):
            if _same(*_compare(slopes[:, i], means[:, k])):
                raise TrajectoryError(
                    f"the {names[1]} given for joint {other.name} are those of joint {joint.name}: swapped columns?"
                )
        if residual < ALIKE:
            hint = next(
                (f": {text}?" for known, text in FACTORS if 1 / UNLIKE < factor / known < UNLIKE),
                "",
            )
            hint = hint or next(
                (
                    f": {text} in the {names[0]}?"
                    for k, text in FACTORS
                    if 1 / UNLIKE < factor * k < UNLIKE
                ),
                "",
            )
            raise TrajectoryError(
                f"the {names[1]} of joint {joint.name} are {factor:.4g} times the slope of its {names[0]}{hint}"
            )


def _same(factor: float, residual: float) -> bool:
    return residual < ALIKE and abs(factor - 1) < ALIKE


def _compare(slope: Array, mean: Array) -> tuple[float, float]:
    """(factor, relative residual) of the mean derivative over each interval as a multiple of the slope."""
    size = float(np.linalg.norm(mean))
    if size == 0.0:
        return 0.0, 1.0
    factor = float(slope @ mean) / float(slope @ slope)
    return factor, float(np.linalg.norm(mean - factor * slope)) / size
