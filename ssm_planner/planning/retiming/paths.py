"""Straight motions as paths q(s), 0 ≤ s ≤ 1: a line in task coordinates through the closed-form inverse kinematics.

Paths in joint space: the one that a free motion took, and the direct line between two configurations.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ssm_planner.codegen.functions import call
from ssm_planner.kinematics.forward import tip_velocity
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import joints_from_task_symbolic
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

STILL = 1e-9
"""A joint whose q'(s) stays below this (rad or m per whole path) does not move along the path."""


@dataclass(frozen=True, eq=False)
class PathSamples:
    """q and its derivatives by s, each (n, 4)."""

    s: Array
    q: Array
    dq: Array
    ddq: Array


@dataclass(frozen=True, eq=False)
class StraightPath:
    """The joints along task(s) = start + s (end − start) on one IK branch.

    start, end: task coordinates (roll, tilt, spin, depth), (4,). first: the joints at s = 0, (4,), which fix the turn of
    the revolute joints. Differentiable while the tilt stays away from the workspace boundary (paper, eq. 9).
    """

    mechanism: Mechanism
    start: Array
    end: Array
    branch: int
    first: Array
    watched: tuple[int, ...] = (0, 1, 2, 3)
    """Joints whose turning points matter: those with a drive."""
    grid: int = 400

    def task(self, s: Array) -> Array:
        return self.start + np.asarray(s)[:, None] * (self.end - self.start)

    def sample(self, s: Array) -> PathSamples:
        """Path and derivatives at s (n,), revolute joints continuous from `first`."""
        s = np.asarray(s, dtype=float)
        q, dq, ddq = self._derivatives(s)
        return PathSamples(s, q + self._turns, dq, ddq)

    def third_derivative(self, s: Array) -> Array:
        """Of the joints by s, at s (n,): (n, 4)."""
        return self._derivatives(np.asarray(s, dtype=float), order=3)[3]

    def speed_at(self, s: float, qd: Array) -> float:
        """ṡ at s at which the joints move at qd (4,), which must lie along the path."""
        slope = self.sample(np.array([s])).dq[0]
        return float(slope @ qd / (slope @ slope))

    def tip_slope(self, samples: PathSamples) -> Array:
        """dp/ds of the tool tip, m, (n, 3)."""
        return tip_velocity(self.mechanism, samples.q, samples.dq)

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Where watched joints turn back: knots s_k (m + 1,) and the sign of q'(s) between them, (m, 4), else 0."""
        s = np.linspace(0.0, 1.0, self.grid + 1)
        dq = self.sample(s).dq
        moving = np.abs(dq).max(axis=0) > STILL
        moving &= np.isin(np.arange(4), self.watched)
        knots = [0.0]
        for joint in np.flatnonzero(moving):
            crossing = np.flatnonzero(np.signbit(dq[1:, joint]) != np.signbit(dq[:-1, joint]))
            knots.extend(self._turning_point(int(joint), s[i], s[i + 1]) for i in crossing)
        knots = sorted({round(k, 12) for k in knots if 1e-6 < k < 1 - 1e-6} | {0.0, 1.0})
        middle = (np.array(knots[1:]) + np.array(knots[:-1])) / 2
        return np.array(knots), np.sign(self.sample(middle).dq) * moving

    def _turning_point(self, joint: int, low: float, high: float) -> float:
        from scipy.optimize import brentq

        def slope(s: float) -> float:
            return float(self.sample(np.array([s])).dq[0, joint])

        if slope(low) * slope(high) > 0:
            return low if abs(slope(low)) < abs(slope(high)) else high
        return float(brentq(slope, low, high, xtol=1e-14))

    @cached_property
    def _turns(self) -> Array:
        """Whole turns from the closed form, which is continuous along the path, to the joints at its start."""
        q = self._derivatives(np.zeros(1))[0]
        turns = 2 * np.pi * np.round((self.first - q) / (2 * np.pi))
        turns[:, 3] = 0.0
        return turns

    def _derivatives(self, s: Array, order: int = 2) -> tuple[Array, ...]:
        """The joints at s (n,) and their derivatives by s up to an order; revolute joints up to whole turns."""
        function = _line(pickle.dumps(self.mechanism), self.branch, order)
        ends = (np.tile(task, (len(s), 1)) for task in (self.start, self.end - self.start))
        return call(function, s[:, None], *ends)


@lru_cache(maxsize=16)
def _line(mechanism: bytes, branch: int, order: int) -> ca.Function:
    """(s, start, way): the joints and their derivatives by s along a line in task coordinates."""
    s, start, way = ca.SX.sym("s"), ca.SX.sym("start", 4), ca.SX.sym("way", 4)
    values: Any = [joints_from_task_symbolic(pickle.loads(mechanism), start + s * way, branch)]
    for _ in range(order):
        values.append(ca.jacobian(values[-1], s))
    return ca.Function("path", [s, start, way], ca.cse(values))


POINTS = 600


class JointPath(Protocol):
    """What TOPP-RA needs of a path q(s), 0 ≤ s ≤ 1."""

    @property
    def mechanism(self) -> Mechanism: ...

    @property
    def directions(self) -> tuple[Array, Array]: ...

    def sample(self, s: Array) -> PathSamples: ...

    def tip_slope(self, samples: PathSamples) -> Array: ...


@dataclass(frozen=True, eq=False)
class SplinePath:
    """The path of a motion whose joints turn back only at given instants; s is the mean share of their ways gone.

    A cubic spline through points of the motion, so that its re-timing is a cross-check to about 1e-3, not exact.
    """

    mechanism: Mechanism
    spline: Any
    knots: Array
    signs: Array
    unit: Array
    """By joint, (4,): s = Σ |way_j| / unit_j."""

    @classmethod
    def of(cls, mechanism: Mechanism, trajectory: Trajectory, borders: Array, way: Array) -> SplinePath:
        """borders (k + 1,): instants between which no joint turns back; way (k, 4): of each joint, 0 for those that stand."""
        from scipy.interpolate import CubicSpline

        unit = np.abs(way).max(axis=0)
        moving = np.flatnonzero(unit)
        dense = np.unique(np.concatenate([np.linspace(0.0, trajectory.duration, 20 * POINTS), borders]))
        q = trajectory.sample(dense, side="left").q[:, moving] / unit[moving]
        gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q, axis=0)).sum(axis=1))])
        knots = np.interp(borders, dense, gone) / gone[-1]
        grid = np.unique(np.concatenate([np.linspace(0.0, 1.0, POINTS + 1), knots]))
        t = np.interp(grid * gone[-1], gone, dense)
        s = np.interp(t, dense, gone) / gone[-1]
        s[0], s[-1], knots[0], knots[-1] = 0.0, 1.0, 0.0, 1.0
        distinct = np.concatenate([[True], np.diff(s) > 1e-9])
        distinct[-1] = True
        spline = CubicSpline(s[distinct], trajectory.sample(t[distinct], side="left").q)
        return cls(mechanism, spline, knots, np.sign(way), np.where(unit > 0, unit, np.inf) * gone[-1])

    @property
    def directions(self) -> tuple[Array, Array]:
        return self.knots, self.signs

    def sample(self, s: Array) -> PathSamples:
        s = np.asarray(s, dtype=float)
        q, dq, ddq = (self.spline(s, k) for k in range(3))
        still = ~np.any(self.signs != 0, axis=0)
        dq[:, still] = ddq[:, still] = 0.0
        return PathSamples(s, q, dq, ddq)

    def speed(self, qd: Array) -> float:
        """ṡ at which the joints move at qd (4,)."""
        return float((np.abs(qd) / self.unit).sum())

    def tip_slope(self, samples: PathSamples) -> Array:
        return tip_velocity(self.mechanism, samples.q, samples.dq)


@dataclass(frozen=True, eq=False)
class PolylinePath:
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

    def tip_slope(self, samples: PathSamples) -> Array:
        return tip_velocity(self.mechanism, samples.q, samples.dq)
