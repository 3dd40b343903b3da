"""Straight motions as paths q(s), 0 ≤ s ≤ 1: a line in task coordinates through the closed-form inverse kinematics."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.model.forward import tip_velocity
from ssm_planner.model.functions import call
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.symbolic import joints_from_task_symbolic
from ssm_planner.problem.values import Array

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
