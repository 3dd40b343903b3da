"""Paths q(s), 0 ≤ s ≤ 1, that TOPP-RA times: straight in task coordinates, splines, those of motions, polylines."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import call
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import joints_from_task_symbolic, roll_of_tip, task_of_tip_symbolic
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask

if TYPE_CHECKING:  # it loads slowly, and few paths are splines
    from scipy.interpolate import CubicSpline

FEW, MANY = 1000, 20_000
"""Grid intervals of TOPP-RA, at least and at most."""
PER_POINT = 8
"""Of these, for each point of a spline."""
CORNER = np.radians(30)
"""Turn of a polyline, in joints by their velocities, beyond which it is no sample of a smooth curve."""
STILL = 1e-9
"""A joint whose q'(s) stays below this (rad or m per whole path) does not move along the path."""
OVERVIEW = 201
LOOKS = 401
"""Points among which turning points of a straight path are looked for."""
PARTS, DIGITS = 200, 5
"""Into so many parts the interval of a turning point is cut, so often: to 1e-14."""
APART = 1e-6
"""Least distance in s of two knots."""
BESIDE = 1e-4
"""Distance of a grid point from the break beside it, as a share of the piece."""


@dataclass(frozen=True, eq=False)
class PathSamples:
    """q and its derivatives by s, each (n, 4), at s (n,)."""

    s: Array
    q: Array
    dq: Array
    ddq: Array


class JointPath(ABC):
    """A path q(s), 0 ≤ s ≤ 1.

    A new kind of path is a frozen dataclass with a field `mechanism`, `sample` and `directions`.
    """

    mechanism: Mechanism

    @abstractmethod
    def sample(self, s: Array) -> PathSamples:
        """Joints and their first two derivatives by s, at s (n,)."""

    @property
    @abstractmethod
    def directions(self) -> tuple[Array, Array]:
        """Where joints turn back: knots s_k (m + 1,) from 0 to 1, and the sign of q'(s) between them, (m, 4); 0: stands."""

    @cached_property
    def overview(self) -> PathSamples:
        """At OVERVIEW even places from end to end."""
        return self.sample(np.linspace(0.0, 1.0, OVERVIEW))

    @property
    def breaks(self) -> Array:
        """s between which the path is smooth, (k + 1,), all of them knots of `directions`."""
        return np.array([0.0, 1.0])

    @property
    def intervals(self) -> int:
        """Grid intervals that it asks of TOPP-RA."""
        return FEW

    def speed_at(self, s: float, qd: Array) -> float:
        """ṡ at s at which the joints move at qd (4,), which must lie along the path."""
        if not qd.any():
            return 0.0
        slope = self.sample(np.array([s])).dq[0]
        return float(slope @ qd / (slope @ slope))

    def starts(self, samples: PathSamples) -> Mask:
        """At which of the samples (n,) joints start from rest if the motion along the path does, (n, 4): at s = 0."""
        return np.tile((samples.s == 0.0)[:, None], 4)


class ClosedPath(JointPath):
    """Joints in closed form, by CasADi: smooth, on one branch of the inverse kinematics.

    Differentiable while the tilt stays away from the workspace boundary (paper, eq. 9).
    """

    branch: int
    first: Array
    """Joints at s = 0, (4,): they fix the whole turns of the revolute joints."""
    watched: tuple[int, ...]
    """Joints whose turning points matter: those with a drive."""

    @abstractmethod
    def _derivatives(self, s: Array, order: int = 2) -> tuple[Array, ...]:
        """The joints at s (n,), up to whole turns, and their derivatives by s up to an order, (n, 4) each."""

    def sample(self, s: Array) -> PathSamples:
        s = np.asarray(s, dtype=float)
        q, dq, ddq = self._derivatives(s)
        return PathSamples(s, q + self._turns, dq, ddq)

    def third_derivative(self, s: Array) -> Array:
        """d³q/ds³ at s (n,): (n, 4)."""
        return self._derivatives(np.asarray(s, dtype=float), order=3)[3]

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        s = np.linspace(0.0, 1.0, LOOKS)
        dq = self.sample(s).dq
        moving = (np.abs(dq).max(axis=0) > STILL) & np.isin(np.arange(4), self.watched)
        turns = np.signbit(dq[1:]) != np.signbit(dq[:-1])
        found = (
            round(self._turning_point(int(i), s[k], s[k + 1]), 12)
            for k, i in np.argwhere(turns & moving)
        )
        knots = with_knots(np.array([0.0, 1.0]), found)
        return knots, np.sign(self.sample((knots[1:] + knots[:-1]) / 2).dq) * moving

    def _turning_point(self, joint: int, low: float, high: float) -> float:
        """The root of q'(s) of one joint between two points where its signs differ."""
        for _ in range(DIGITS):
            s = np.linspace(low, high, PARTS + 1)
            slope = self.sample(s).dq[:, joint]
            turns = np.flatnonzero(np.signbit(slope[1:]) != np.signbit(slope[:-1]))
            if not len(turns):  # within rounding of one of the ends
                return low if abs(slope[0]) < abs(slope[-1]) else high
            low, high = s[turns[0]], s[turns[0] + 1]
        return float(low + high) / 2

    @cached_property
    def _turns(self) -> Array:
        """Whole turns (1, 4) from the closed form, which is continuous along the path, to the joints at its start."""
        q = self._derivatives(np.zeros(1))[0]
        turns = 2 * np.pi * np.round((self.first - q) / (2 * np.pi))
        turns[:, 3] = 0.0
        return turns


@dataclass(frozen=True, eq=False)
class StraightPath(ClosedPath):
    """The joints along task(s) = start + s (end − start) on one branch of the closed-form inverse kinematics."""

    mechanism: Mechanism
    start: Array
    """Task coordinates (roll, tilt, spin, depth), (4,)."""
    end: Array
    branch: int
    first: Array
    watched: tuple[int, ...] = (0, 1, 2, 3)

    def _derivatives(self, s: Array, order: int = 2) -> tuple[Array, ...]:
        function = _line(self.mechanism, self.branch, order)
        ends = (np.tile(task, (len(s), 1)) for task in (self.start, self.end - self.start))
        return call(function, s[:, None], *ends)


@lru_cache(maxsize=16)
def _line(mechanism: Mechanism, branch: int, order: int) -> ca.Function:
    """(s, start, way): the joints and their derivatives by s along a line in task coordinates."""
    s, start, way = ca.SX.sym("s"), ca.SX.sym("start", 4), ca.SX.sym("way", 4)
    joints = joints_from_task_symbolic(mechanism, start + s * way, branch)
    return ca.Function("path", [s, start, way], _with_derivatives(joints, s, order))


def _with_derivatives(joints: ca.SX, s: ca.SX, order: int) -> Any:
    values: Any = [joints]
    for _ in range(order):
        values.append(ca.jacobian(values[-1], s))
    return ca.cse(values)


@dataclass(frozen=True, eq=False)
class TipPath(ClosedPath):
    """The joints with which the tip follows p(s) = fixed + s way + cos(s angle) u + sin(s angle) v, at even speed in s.

    A line (u = v = 0) or an arc (way = 0) away from the remote centre and from the axis of joint 1, spin in proportion to s.
    """

    mechanism: Mechanism
    terms: Array
    """fixed, way, u, v, (4, 3), m."""
    angle: float
    spins: tuple[float, float]
    """At both ends."""
    branch: int
    first: Array
    watched: tuple[int, ...] = (0, 1, 2, 3)

    @property
    def length(self) -> float:
        """Of the tip's way, m: its speed is this times ṡ."""
        return float(
            np.linalg.norm(self.terms[1]) + abs(self.angle) * np.linalg.norm(self.terms[2])
        )

    def tips(self, s: Array) -> Array:
        """The tip at s (n,), (n, 3)."""
        turn = self.angle * s
        return np.asarray(
            np.column_stack([np.ones_like(s), s, np.cos(turn), np.sin(turn)]) @ self.terms
        )

    def _derivatives(self, s: Array, order: int = 2) -> tuple[Array, ...]:
        function = _tip_curve(self.mechanism, self.branch, order)
        given = [*self.terms.ravel(), self.angle, *self.spins, self._middle_roll]
        return call(function, s[:, None], np.tile(given, (len(s), 1)))

    @cached_property
    def _middle_roll(self) -> float:
        """Roll in the middle of the path, from which rolls are counted so that none jumps by a turn."""
        return roll_of_tip(self.mechanism, self.tips(np.array([0.5]))[0])


@lru_cache(maxsize=16)
def _tip_curve(mechanism: Mechanism, branch: int, order: int) -> ca.Function:
    """(s, terms by rows, angle, spins, roll from which rolls are counted): the joints of a TipPath, and derivatives by s."""
    s, given = ca.SX.sym("s"), ca.SX.sym("given", 16)
    terms, angle, spin, roll = (
        ca.reshape(given[:12], 3, 4),
        given[12],
        given[13] + s * (given[14] - given[13]),
        given[15],
    )
    tip = terms @ ca.vertcat(1, s, ca.cos(s * angle), ca.sin(s * angle))
    task = task_of_tip_symbolic(mechanism, tip, roll, spin)
    return ca.Function(
        "tip_path",
        [s, given],
        _with_derivatives(joints_from_task_symbolic(mechanism, task, branch), s, order),
    )


def with_knots(knots: Array, more: Iterable[float]) -> Array:
    """Knots (k,), with those of more that are APART from all others, (m,): joints that turn together do so once."""
    for knot in sorted(more):
        if np.abs(knots - knot).min() > APART:
            knots = np.append(knots, knot)
    return np.sort(knots)


@dataclass(frozen=True, eq=False)
class MotionPath(JointPath):
    """The path that a motion took, q(s) with s = t / duration: its polynomials, so the motion itself is ṡ = 1 / duration.

    Where joints rest, q' is zero and ṡ is not: the speed at the ends is that of the motion.
    """

    mechanism: Mechanism
    trajectory: Trajectory
    knots: Array
    """Values of s between which no joint turns back, (k + 1,)."""
    signs: Array
    """Directions of the joints between the knots, (k, 4)."""

    @property
    def directions(self) -> tuple[Array, Array]:
        return self.knots, self.signs

    def grid(self, points: int) -> Array:
        """About so many values of s from 0 to 1: one close to each side of every break, where q'' jumps, others between."""
        breaks = self.trajectory.breaks / self.trajectory.duration
        shares = np.diff(breaks)
        between = np.maximum(np.round(shares * max(points - 2 * len(shares), 0)).astype(int), 1)
        of = np.repeat(np.arange(len(shares)), between + 1)
        part = np.arange(len(of)) - np.repeat(np.cumsum(between + 1) - between - 1, between + 1)
        inside = BESIDE + (1 - 2 * BESIDE) * part / between[of]
        return np.concatenate([[0.0], breaks[of] + inside * shares[of], [1.0]])

    def sample(self, s: Array) -> PathSamples:
        s = np.asarray(s, dtype=float)
        duration = self.trajectory.duration
        found = self.trajectory.sample(np.clip(s, 0.0, 1.0) * duration)
        dq, ddq = found.qd * duration, found.qdd * duration**2
        still = ~self.signs.any(axis=0)
        dq[:, still] = ddq[:, still] = 0.0
        return PathSamples(s, found.q, dq, ddq)

    def starts(self, samples: PathSamples) -> Mask:
        """Where the motion starts a joint: at s = 0, and behind a knot at which it turns back."""
        return begun(samples, *self.directions, fixed=True)


def begun(samples: PathSamples, knots: Array, directions: Array, *, fixed: bool = False) -> Mask:
    """At which of the samples (n,) joints begin to move at a knot, (n, 4); fixed: ṡ is not zero at s = 0 for that."""
    found = np.zeros((len(samples.s), 4), dtype=bool)
    before = np.zeros(4)
    for knot, signs in zip(knots[:-1], directions, strict=True):
        k = min(int(np.searchsorted(samples.s, knot)), len(samples.s) - 1)
        found[k] = (signs != before) & (not fixed or knot > 0 or samples.dq[k] == 0.0)
        before = signs
    return found


@dataclass(frozen=True, eq=False)
class Chain(JointPath):
    """Several paths, the k-th of them over 2 k ≤ s ≤ 2 k + 1: what is worked out at one point of a path is so for all."""

    mechanism: Mechanism
    paths: tuple[JointPath, ...]

    @staticmethod
    def grid(own: Array, count: int) -> Array:
        """The same grid (n,) on each of `count` paths, (count n,)."""
        return np.asarray((2 * np.arange(count)[:, None] + own).ravel())

    def sample(self, s: Array) -> PathSamples:
        found = [path.sample(part) for path, part in zip(self.paths, self._parts(s), strict=True)]
        q, dq, ddq = (
            np.concatenate([getattr(each, name) for each in found]) for name in ("q", "dq", "ddq")
        )
        return PathSamples(s, q, dq, ddq)

    @property
    def directions(self) -> tuple[Array, Array]:
        each = [path.directions for path in self.paths]
        knots = np.concatenate([2 * k + knots for k, (knots, _) in enumerate(each)])
        # from the end of a path to the start of the next as before
        return knots, np.concatenate([np.vstack([signs, signs[-1:]]) for _, signs in each])[:-1]

    def starts(self, samples: PathSamples) -> Mask:
        parts = self._parts(samples.s)
        cuts = np.cumsum([len(part) for part in parts])[:-1]
        of = zip(
            *(np.split(each, cuts) for each in (samples.q, samples.dq, samples.ddq)), strict=True
        )
        found = [
            path.starts(PathSamples(s, *at))
            for path, s, at in zip(self.paths, parts, of, strict=True)
        ]
        return np.concatenate(found)

    def _parts(self, s: Array) -> list[Array]:
        """Of each path its own s, of s in order."""
        cuts = np.searchsorted(s, 2 * np.arange(1, len(self.paths)) - 0.5)
        return [part - 2 * k for k, part in enumerate(np.split(s, cuts))]


@dataclass(frozen=True, eq=False)
class SplinePath(JointPath):
    """The natural cubic spline through points (k + 1, 4) of which no two in a row are the same.

    s is the way from point to point along straight lines, joints measured by their `scale` (4,), over all of it.
    """

    mechanism: Mechanism
    points: Array
    scale: Array
    pieces: bool = False
    """Its pieces are told apart: optimal control needs to know where q''' jumps."""

    @property
    def breaks(self) -> Array:
        return self.nodes if self.pieces else super().breaks

    @cached_property
    def nodes(self) -> Array:
        """s of the points, (k + 1,)."""
        way = np.cumsum(np.linalg.norm(np.diff(self.points, axis=0) / self.scale, axis=1))
        return np.append(0.0, way / way[-1])

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.nodes, self.points, axis=0, bc_type="natural")

    @property
    def intervals(self) -> int:
        return int(np.clip(PER_POINT * len(self.points), FEW, MANY))

    def sample(self, s: Array) -> PathSamples:
        s = np.asarray(s, dtype=float)
        q, dq, ddq = (self._spline(s, order) for order in range(3))
        still = np.ptp(self.points, axis=0) < STILL
        dq[:, still] = ddq[:, still] = 0.0
        return PathSamples(s, q, dq, ddq)

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        slope = self._spline.derivative()
        moving = np.flatnonzero(np.ptp(self.points, axis=0) >= STILL)
        roots = np.concatenate([np.zeros(0), *(slope.roots(extrapolate=False)[i] for i in moving)])
        knots = np.unique(np.round(roots[np.isfinite(roots)], 12))
        knots = np.array([0.0, *knots[(knots > 1e-6) & (knots < 1 - 1e-6)], 1.0])
        knots = with_knots(self.nodes, knots[1:-1]) if self.pieces else knots
        return knots, np.sign(self.sample((knots[1:] + knots[:-1]) / 2).dq)

    @property
    def off_lines(self) -> Array:
        """How far the curve goes from the straight lines between its points at most, (4,), rad and m."""
        share = np.linspace(0.0, 1.0, PER_POINT, endpoint=False)
        s = (self.nodes[:-1, None] + share * np.diff(self.nodes)[:, None]).ravel()
        lines = np.column_stack([np.interp(s, self.nodes, self.points[:, i]) for i in range(4)])
        return np.asarray(np.abs(self.sample(s).q - lines).max(axis=0))


def smooth_runs(points: Array, scale: Array) -> list[Array]:
    """Points (n, 4) cut where they turn by more than CORNER, the cut points in both parts; a curve cannot pass there.

    Points where nothing moves count once. scale (4,): of the joints, as in SplinePath.
    """
    steps = np.diff(points / scale, axis=0)
    length = np.linalg.norm(steps, axis=1)
    points, steps = points[np.append(True, length > STILL)], steps[length > STILL]
    unit = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", unit[1:], unit[:-1])
    cuts = [0, *(np.flatnonzero(cosine < np.cos(CORNER)) + 1).tolist(), len(points) - 1]
    return [points[a : b + 1] for a, b in pairwise(cuts) if b > a]


@dataclass(frozen=True, eq=False)
class PolylinePath(JointPath):
    """The straight lines in joint space from point to point (k + 1, 4), each over the same share of s."""

    mechanism: Mechanism
    points: Array

    @property
    def directions(self) -> tuple[Array, Array]:
        return np.linspace(0.0, 1.0, len(self.points)), np.sign(np.diff(self.points, axis=0))

    def sample(self, s: Array) -> PathSamples:
        s = np.asarray(s, dtype=float)
        count = len(self.points) - 1
        piece = np.clip((s * count).astype(int), 0, count - 1)
        way = np.diff(self.points, axis=0)[piece]
        q = self.points[piece] + (s * count - piece)[:, None] * way
        return PathSamples(s, q, count * way, 0 * way)
