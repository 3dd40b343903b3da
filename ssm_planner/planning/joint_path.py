"""Paths in joint space: the one that a free motion took, and the direct line between two configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ssm_planner.model.forward import tip_velocity
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.trajectory import Trajectory
from ssm_planner.planning.path import PathSamples
from ssm_planner.problem.values import Array

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
class TravelledPath:
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
    def of(cls, mechanism: Mechanism, trajectory: Trajectory, borders: Array, way: Array) -> TravelledPath:
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
class StepPath:
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
