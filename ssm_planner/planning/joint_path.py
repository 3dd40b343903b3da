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
    def directions(self) -> tuple[Array, Array]: ...

    def sample(self, s: Array) -> PathSamples: ...

    def tip_slope(self, samples: PathSamples) -> Array: ...


@dataclass(frozen=True, eq=False)
class TravelledPath:
    """The path of a motion whose joints each move one way; s is the mean share of the way that the joints have done.

    A cubic spline through points of the motion, so that its re-timing is a cross-check to about 1e-3, not exact.
    """

    mechanism: Mechanism
    spline: Any
    sign: Array

    @classmethod
    def of(cls, mechanism: Mechanism, trajectory: Trajectory, delta: Array) -> TravelledPath:
        """delta (4,): the way of each joint, 0 for those that stand."""
        from scipy.interpolate import CubicSpline

        moving = np.flatnonzero(delta)
        dense = np.linspace(0.0, trajectory.duration, 20 * POINTS)

        def share(t: Array) -> Array:
            q = trajectory.sample(t, side="left").q
            return np.asarray(((q - trajectory.coefficients[0, 0])[:, moving] / delta[moving]).mean(axis=1))

        t = np.interp(np.linspace(0.0, 1.0, POINTS + 1), share(dense), dense)
        s = share(t)
        s[0], s[-1] = 0.0, 1.0
        return cls(mechanism, CubicSpline(s, trajectory.sample(t, side="left").q), np.sign(delta))

    @property
    def directions(self) -> tuple[Array, Array]:
        return np.array([0.0, 1.0]), self.sign[None, :]

    def sample(self, s: Array) -> PathSamples:
        s = np.asarray(s, dtype=float)
        q, dq, ddq, dddq = (self.spline(s, k) for k in range(4))
        dq[:, self.sign == 0] = ddq[:, self.sign == 0] = 0.0
        return PathSamples(s, q, dq, ddq, dddq)

    def tip_slope(self, samples: PathSamples) -> Array:
        return tip_velocity(self.mechanism, samples.q, samples.dq)


@dataclass(frozen=True, eq=False)
class StepPath:
    """The straight line in joint space between two configurations (4,)."""

    mechanism: Mechanism
    first: Array
    last: Array

    @property
    def directions(self) -> tuple[Array, Array]:
        return np.array([0.0, 1.0]), np.sign(self.last - self.first)[None, :]

    def sample(self, s: Array) -> PathSamples:
        s = np.asarray(s, dtype=float)
        way = np.tile(self.last - self.first, (len(s), 1))
        return PathSamples(s, self.first + s[:, None] * way, way, 0 * way, 0 * way)

    def tip_slope(self, samples: PathSamples) -> Array:
        return tip_velocity(self.mechanism, samples.q, samples.dq)
