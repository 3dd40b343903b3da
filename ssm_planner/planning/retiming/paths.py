"""Paths q(s), 0 ≤ s ≤ 1, that TOPP-RA times.

They are straight in task coordinates, splines, polylines, curves of the tip, or the paths of
motions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import call
from ssm_planner.kinematics import (
    Mechanism,
    joints_from_task_symbolic,
    roll_of_tip,
    task_of_tip_symbolic,
)
from ssm_planner.planning.tolerances import ROUNDING, SAME, SAMPLES
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask, record

if TYPE_CHECKING:  # It loads slowly, and few paths are splines.
    from scipy.interpolate import CubicSpline

FEW, MANY = 1000, 20_000
"""Smallest and largest number of grid intervals of TOPP-RA."""
PER_POINT = 8
"""Grid intervals for each point of a spline."""
CORNER = np.radians(30)
"""Angle between two sides of a polyline, in joints scaled by their velocities, above which it is no
smooth curve.
"""
BESIDE = 1e-4
"""Distance of a grid point from the break beside it, as a share of the piece."""


@record
class PathSamples:
    """q and its derivatives with respect to s, (n, 4) each, at s (n,)."""

    s: Array
    q: Array
    dq: Array
    ddq: Array


class JointPath(ABC):
    """A path q(s), 0 ≤ s ≤ 1.

    A new kind of path is a frozen dataclass with a field `mechanism` and the methods `sample` and
    `directions`.
    """

    mechanism: Mechanism

    @abstractmethod
    def sample(self, s: Array) -> PathSamples:
        """Return the joints and their first two derivatives with respect to s, at s (n,)."""

    @property
    @abstractmethod
    def directions(self) -> tuple[Array, Array]:
        """Reversals of the joints.

        These are knots s_k (m + 1,) from 0 to 1, and the signs of q'(s) between them, (m, 4), 0 for
        a joint that stands.
        """

    @cached_property
    def overview(self) -> PathSamples:
        """Samples at SAMPLES evenly spaced values of s."""
        return self.sample(np.linspace(0.0, 1.0, SAMPLES))

    @property
    def breaks(self) -> Array:
        """Values of s between which the path is smooth, (k + 1,).

        All of them are knots of `directions`.
        """
        return np.array([0.0, 1.0])

    @property
    def intervals(self) -> int:
        """Number of grid intervals for TOPP-RA."""
        return FEW

    def speed_at(self, s: float, qd: Array) -> float:
        """Return ṡ at s for joint velocities qd (4,) along the path."""
        if not qd.any():
            return 0.0
        slope = self.sample(np.array([s])).dq[0]
        return float(slope @ qd / (slope @ slope))

    def turning_point(self, joint: int, low: float, high: float) -> float:
        """Return the root of q'(s) of one joint between two points with different signs."""
        return sign_change(lambda s: np.asarray(self.sample(s).dq[:, joint]), low, high)

    def smooth_directions(self, watched: tuple[int, ...]) -> tuple[Array, Array]:
        """Return `directions` of a path that is smooth between its breaks, of `watched` joints."""
        s = np.unique(
            np.concatenate([np.linspace(a, b, SAMPLES) for a, b in pairwise(self.breaks)])
        )
        dq = self.sample(s).dq
        rests = np.abs(dq) <= ROUNDING
        moving = ~rests.all(axis=0) & np.isin(np.arange(4), watched)
        # A joint that rests on one piece and moves on the next starts at a break, which is a knot.
        turns = (np.signbit(dq[1:]) != np.signbit(dq[:-1])) & ~(rests[1:] & rests[:-1])
        roots = (
            round(self.turning_point(int(i), s[k], s[k + 1]), 12)
            for k, i in np.argwhere(turns & moving)
        )
        knots = with_knots(self.breaks, roots)
        middle = self.sample((knots[1:] + knots[:-1]) / 2).dq
        return knots, np.where(np.abs(middle) > ROUNDING, np.sign(middle), 0.0) * moving

    def starts(self, samples: PathSamples) -> Mask:
        """Return where joints start from rest if the motion does, (n, 4). This is at s = 0."""
        return np.tile((samples.s == 0.0)[:, None], 4)


class ClosedPath(JointPath):
    """A smooth path in closed form, by CasADi, on one branch of the inverse kinematics.

    It is differentiable while the tilt stays away from the workspace boundary (paper, eq. 9).
    """

    branch: int
    first: Array
    """Joints at s = 0, (4,). They determine the whole turns of the revolute joints."""
    watched: tuple[int, ...]
    """Joints whose reversals matter, because they have a drive."""

    @abstractmethod
    def _derivatives(self, s: Array) -> tuple[Array, ...]:
        """Return the joints up to whole turns, and q' and q'', at s (n,), (n, 4) each."""

    def sample(self, s: Array) -> PathSamples:
        """Return q, q' and q'' at s (n,)."""
        s = np.asarray(s, dtype=float)
        q, dq, ddq = self._derivatives(s)
        return PathSamples(s, q + self._turns, dq, ddq)

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Reversals of the joints: knots (m + 1,), and the signs of q' between them, (m, 4)."""
        return self.smooth_directions(self.watched)

    @cached_property
    def _turns(self) -> Array:
        """Whole turns (1, 4) between the closed form and the joints."""
        q = self._derivatives(np.zeros(1))[0]
        turns = 2 * np.pi * np.round((self.first - q) / (2 * np.pi))
        turns[:, 3] = 0.0
        return turns


@record
class StraightPath(ClosedPath):
    """The joints along task(s) = start + s (end − start), on one inverse-kinematics branch."""

    mechanism: Mechanism
    start: Array
    """Task coordinates (roll, tilt, spin, depth), (4,)."""
    end: Array
    branch: int
    first: Array
    watched: tuple[int, ...] = (0, 1, 2, 3)

    def _derivatives(self, s: Array) -> tuple[Array, ...]:
        function = _line(self.mechanism, self.branch)
        return _evaluated(function, s, [*self.start, *(self.end - self.start)])


@lru_cache(maxsize=16)
def _line(mechanism: Mechanism, branch: int) -> ca.Function:
    """Return a Function of s and of start and displacement: the joints and their derivatives."""
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", 8)
    task = parameters[:4] + s * parameters[4:]
    joints = joints_from_task_symbolic(mechanism, task, branch)
    return _with_derivatives(joints, s, parameters)


def _with_derivatives(joints: ca.SX, s: ca.SX, parameters: ca.SX) -> ca.Function:
    """Return a Function of s and parameters: joints and their first two derivatives."""
    slope: Any = ca.jacobian(joints, s)
    return ca.Function("path", [s, parameters], ca.cse([joints, slope, ca.jacobian(slope, s)]))


def _evaluated(function: ca.Function, s: Array, parameters: list[float]) -> tuple[Array, ...]:
    """Return the values of a Function of s and parameters at s (n,)."""
    return call(function, s[:, None], np.tile(parameters, (len(s), 1)))


@record
class TipPath(ClosedPath):
    """The joints for a tip on p(s) = fixed + s line + cos(s angle) u + sin(s angle) v.

    This is a line (u = v = 0) or an arc (line = 0), away from the remote centre and from the axis
    of joint 1. The tip moves evenly in s, and the spin is proportional to s.
    """

    mechanism: Mechanism
    terms: Array
    """fixed, line, u and v, (4, 3), m."""
    angle: float
    spins: tuple[float, float]
    """Spins at both ends, rad."""
    branch: int
    first: Array
    watched: tuple[int, ...] = (0, 1, 2, 3)

    def tips(self, s: Array) -> Array:
        """Return the tip at s (n,), (n, 3)."""
        turn = self.angle * s
        return np.asarray(
            np.column_stack([np.ones_like(s), s, np.cos(turn), np.sin(turn)]) @ self.terms
        )

    def _derivatives(self, s: Array) -> tuple[Array, ...]:
        function = _tip_curve(self.mechanism, self.branch)
        parameters = [*self.terms.ravel(), self.angle, *self.spins, self._middle_roll]
        return _evaluated(function, s, parameters)

    @cached_property
    def _middle_roll(self) -> float:
        """Roll in the middle of the path.

        Rolls are counted from it, so that none jumps by a turn.
        """
        return roll_of_tip(self.mechanism, self.tips(np.array([0.5]))[0])


@lru_cache(maxsize=16)
def _tip_curve(mechanism: Mechanism, branch: int) -> ca.Function:
    """Return a Function of s and of the data of a TipPath: its joints and their derivatives.

    The data are the rows of its terms, the angle, the spins, and the roll from which rolls are
    counted.
    """
    s, parameters = ca.SX.sym("s"), ca.SX.sym("given", 16)
    terms = ca.reshape(parameters[:12], 3, 4)
    angle = parameters[12]
    spin = parameters[13] + s * (parameters[14] - parameters[13])
    roll = parameters[15]
    tip = terms @ ca.vertcat(1, s, ca.cos(s * angle), ca.sin(s * angle))
    task = task_of_tip_symbolic(mechanism, tip, roll, spin)
    joints = joints_from_task_symbolic(mechanism, task, branch)
    return _with_derivatives(joints, s, parameters)


def sign_change(function: Callable[[Array], Array], low: float, high: float) -> float:
    """Return the root between two points where a function of s (n,) has different signs."""
    for _ in range(5):  # The last interval is 1e-13 of the first.
        s = np.linspace(low, high, SAMPLES)
        values = function(s)
        roots = np.flatnonzero(np.signbit(values[1:]) != np.signbit(values[:-1]))
        if not len(roots):  # The root is within rounding of one of the ends.
            return low if abs(values[0]) < abs(values[-1]) else high
        low, high = s[roots[0]], s[roots[0] + 1]
    return float(low + high) / 2


def with_knots(knots: Array, others: Iterable[float]) -> Array:
    """Return knots (k,) and all of `others` that are further than SAME from them, (m,).

    Joints that reverse together thus give one knot.
    """
    for knot in sorted(others):
        if np.abs(knots - knot).min() > SAME:
            knots = np.append(knots, knot)
    return np.sort(knots)


@record
class MotionPath(JointPath):
    """The path of a motion, q(s) with s = t / duration.

    It consists of the polynomials of the motion, so the motion itself has ṡ = 1 / duration. Where
    joints rest, q' is zero and ṡ is not. ṡ at the ends is therefore that of the motion.
    """

    mechanism: Mechanism
    trajectory: Trajectory
    knots: Array
    """Values of s between which no joint reverses, (k + 1,)."""
    signs: Array
    """Directions of the joints between the knots, (k, 4)."""

    @property
    def directions(self) -> tuple[Array, Array]:
        """Knots and signs."""
        return self.knots, self.signs

    def grid(self, points: int) -> Array:
        """Return about `points` values of s from 0 to 1.

        One lies close to each side of every break, where q'' jumps, and the others between the
        breaks.
        """
        breaks = self.trajectory.breaks / self.trajectory.duration
        between = max(points - 2 * (len(breaks) - 1), 0)
        grid = [0.0]
        for start, end in pairwise(breaks):
            count = max(round((end - start) * between), 1)
            shares = np.linspace(BESIDE, 1 - BESIDE, count + 1)
            grid.extend(start + (end - start) * shares)
        return np.append(grid, 1.0)

    def sample(self, s: Array) -> PathSamples:
        """Return q, q' and q'' at s (n,)."""
        s = np.asarray(s, dtype=float)
        duration = self.trajectory.duration
        samples = self.trajectory.sample(np.clip(s, 0.0, 1.0) * duration)
        dq, ddq = samples.qd * duration, samples.qdd * duration**2
        still = ~self.signs.any(axis=0)
        dq[:, still] = ddq[:, still] = 0.0
        return PathSamples(s, samples.q, dq, ddq)

    def starts(self, samples: PathSamples) -> Mask:
        """Return where joints start, (n, 4): at s = 0, and behind a knot at which they reverse."""
        return joint_starts(samples, *self.directions, moving=True)


def joint_starts(
    samples: PathSamples, knots: Array, directions: Array, *, moving: bool = False
) -> Mask:
    """Return at which samples (n,) joints begin to move at a knot, (n, 4).

    If `moving` is true, ṡ is not zero at s = 0, and joints start there only if q' is zero.
    """
    starts = np.zeros((len(samples.s), 4), dtype=bool)
    previous = np.zeros(4)
    for knot, signs in zip(knots[:-1], directions, strict=True):
        k = min(int(np.searchsorted(samples.s, knot)), len(samples.s) - 1)
        begins = (signs != 0.0) & (signs != previous)
        starts[k] = begins & (not moving or knot > 0 or samples.dq[k] == 0.0)
        previous = signs
    return starts


@record
class SplinePath(JointPath):
    """The natural cubic spline through points (k + 1, 4).

    No two consecutive points may be equal. s is the distance along the straight lines between the
    points, with joints divided by their `scale` (4,), as a share of the whole distance.
    """

    mechanism: Mechanism
    points: Array
    scale: Array
    pieces: bool = False
    """True if optimal control must know the breaks between the cubic pieces, where q''' jumps."""

    @property
    def breaks(self) -> Array:
        """Values of s between which the path is smooth."""
        return self.nodes if self.pieces else super().breaks

    @cached_property
    def nodes(self) -> Array:
        """Values of s at the points, (k + 1,)."""
        distance = np.cumsum(np.linalg.norm(np.diff(self.points, axis=0) / self.scale, axis=1))
        return np.append(0.0, distance / distance[-1])

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.nodes, self.points, axis=0, bc_type="natural")

    @property
    def intervals(self) -> int:
        """Number of grid intervals for TOPP-RA."""
        return int(np.clip(PER_POINT * len(self.points), FEW, MANY))

    def sample(self, s: Array) -> PathSamples:
        """Return q, q' and q'' at s (n,)."""
        s = np.asarray(s, dtype=float)
        q, dq, ddq = (self._spline(s, order) for order in range(3))
        still = np.ptp(self.points, axis=0) < ROUNDING
        dq[:, still] = ddq[:, still] = 0.0
        return PathSamples(s, q, dq, ddq)

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Reversals of the joints: knots (m + 1,), and the signs of q' between them, (m, 4)."""
        moving = np.flatnonzero(np.ptp(self.points, axis=0) >= ROUNDING)
        roots = self._spline.derivative().roots(extrapolate=False)
        reversals = np.concatenate([roots[i] for i in moving])
        knots = with_knots(self.breaks, reversals[np.isfinite(reversals)])
        return knots, np.sign(self.sample((knots[1:] + knots[:-1]) / 2).dq)

    @property
    def off_lines(self) -> Array:
        """Largest distance of each joint from the lines between the points, (4,), rad and m."""
        count = len(self.points) - 1
        share = np.linspace(0.0, 1.0, PER_POINT * count + 1)
        s = np.interp(share, np.linspace(0.0, 1.0, count + 1), self.nodes)
        lines = PolylinePath(self.mechanism, self.points).sample(share)
        return np.asarray(np.abs(self.sample(s).q - lines.q).max(axis=0))


def smooth_runs(points: Array, scale: Array) -> list[Array]:
    """Split points (n, 4) where they turn by more than CORNER, because a curve cannot pass there.

    Split points belong to both parts. Points that are less than SAME apart count once, because
    their directions are noise. `scale` (4,) is that of `SplinePath`.
    """
    scaled = points / scale
    apart = [0]
    for k in range(1, len(scaled)):
        if np.linalg.norm(scaled[k] - scaled[apart[-1]]) > SAME:
            apart.append(k)
    if len(apart) > 1:  # The motion ends at the last point itself.
        apart[-1] = len(points) - 1
    points = points[apart]
    steps = np.diff(scaled[apart], axis=0)
    unit = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", unit[1:], unit[:-1])
    cuts = [0, *(np.flatnonzero(cosine < np.cos(CORNER)) + 1).tolist(), len(points) - 1]
    return [points[a : b + 1] for a, b in pairwise(cuts) if b > a]


@record
class PolylinePath(JointPath):
    """Straight lines in joint space through points (k + 1, 4), each over the same share of s."""

    mechanism: Mechanism
    points: Array

    @property
    def directions(self) -> tuple[Array, Array]:
        """Knots at the points, and signs of the displacements."""
        return np.linspace(0.0, 1.0, len(self.points)), np.sign(np.diff(self.points, axis=0))

    def sample(self, s: Array) -> PathSamples:
        """Return q, q' and q'' at s (n,)."""
        s = np.asarray(s, dtype=float)
        count = len(self.points) - 1
        index = np.clip((s * count).astype(int), 0, count - 1)
        displacement = np.diff(self.points, axis=0)[index]
        q = self.points[index] + (s * count - index)[:, None] * displacement
        return PathSamples(s, q, count * displacement, 0 * displacement)
