"""A trajectory out of points, joined as joint_trajectory_controller joins them, and the faults of points.

Between two points the motion is a straight line where positions are given alone, a cubic with velocities, a quintic with
velocities and accelerations (ros2_controllers, joint_trajectory_controller, trajectory representation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssm_planner.errors import TrajectoryError
from ssm_planner.model.trajectory import DEGREE, Phase, Trajectory, hermite
from ssm_planner.problem.values import Array, Robot
from ssm_planner.verify.consistency import check_derivatives, check_magnitudes

BLOCK = 65_536
"""Pieces made at a time: temporaries stay small."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Points:
    """n points of a joint motion, in the order of the robot's joints; rad, m, s."""

    t: Array
    q: Array
    qd: Array | None = None
    qdd: Array | None = None
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


def join_points(points: Points, robot: Robot, notes: tuple[str, ...] = ()) -> Reading:
    """The trajectory through points. Raises TrajectoryError where they are no trajectory of this robot."""
    check_points(points, robot)
    n = len(points.t)
    none = np.zeros(n, dtype=bool)
    velocity = none if points.qd is None else ~none if points.has_qd is None else points.has_qd
    acceleration = none if points.qdd is None else ~none if points.has_qdd is None else points.has_qdd
    cubic = velocity[:-1] & velocity[1:]
    quintic = cubic & acceleration[:-1] & acceleration[1:]
    coefficients = np.empty((n - 1, DEGREE + 1, 4))
    for start in range(0, n - 1, BLOCK):
        block = slice(start, min(start + BLOCK, n - 1))
        coefficients[block] = _pieces(points, block, cubic[block], quintic[block])
    trajectory = Trajectory(points.t, coefficients, (Phase("points", float(points.t[0]), float(points.t[-1])),))
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
    return "mixed between points: " + ", ".join(f"{int(flags.sum())} {name}" for name, flags in counts if flags.any())


def check_points(points: Points, robot: Robot) -> None:
    """Faults that make points no trajectory: too few, NaN, times that do not increase, wrong units, swapped columns."""
    t, n = points.t, len(points.t)
    if n < 2:
        raise TrajectoryError(f"{points.place(0)}: {n} point; a trajectory needs at least two")
    for name, values in (("time", t), ("position", points.q), ("velocity", points.qd), ("acceleration", points.qdd)):
        if values is not None and not np.isfinite(values).all():
            k = int(np.argwhere(~np.isfinite(values))[0][0])
            raise TrajectoryError(f"{points.place(k)}: {name} is not a finite number")
    back = np.flatnonzero(np.diff(t) <= 0)
    if len(back):
        k = int(back[0]) + 1
        fault = "the same time twice" if t[k] == t[k - 1] else "time goes back"
        raise TrajectoryError(f"{points.place(k)}: {fault}: {t[k]:.12g} s after {t[k - 1]:.12g} s")
    check_magnitudes(points.q, robot, points.place)
    if points.qd is not None and points.has_qd is None:
        check_derivatives(t, points.q, points.qd, robot, ("positions", "velocities"))
        if points.qdd is not None and points.has_qdd is None:
            check_derivatives(t, points.qd, points.qdd, robot, ("velocities", "accelerations"))


def _pieces(points: Points, block: slice, cubic: Flags, quintic: Flags) -> Array:
    """Coefficients (m, 6, 4) of the pieces of one block."""
    ahead = slice(block.start + 1, block.stop + 1)
    breaks = points.t[block.start : block.stop + 1]
    h = np.diff(breaks)[:, None]
    q0, q1 = points.q[block], points.q[ahead]
    if points.qd is not None and points.qdd is not None and quintic.all():
        start, end = ((points.q[b], points.qd[b], points.qdd[b]) for b in (block, ahead))
        return hermite(breaks, start, end)
    out = np.zeros((len(h), DEGREE + 1, 4))
    out[:, 0], out[:, 1] = q0, (q1 - q0) / h
    if points.qd is not None and cubic.any():
        v0, v1 = points.qd[block], points.qd[ahead]
        slope = (q1 - q0) / h
        parts = (q0, v0, (3 * slope - 2 * v0 - v1) / h, (v0 + v1 - 2 * slope) / h**2)
        for k, part in enumerate(parts):
            out[:, k] = np.where(cubic[:, None], part, out[:, k])
        if points.qdd is not None and quintic.any():
            whole = hermite(breaks, (q0, v0, points.qdd[block]), (q1, v1, points.qdd[ahead]))
            out[quintic] = whole[quintic]
    return out
