"""Velocities at via points, for joints that reverse beside a point.

A joint with time to spare before a point may move beyond it, or take a run-up, and pass the point
at speed. Consider the joints alone, with their velocities at the points unknown. Closed forms then
give the duration of each segment, and minimising the sum shows at which points a joint should pass
at speed where it would otherwise be at rest.
"""

from __future__ import annotations

import numpy as np

from ssm_planner.planning.lower_bound import minimum_times
from ssm_planner.planning.ocp.motion import Borders
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.tolerances import SAME
from ssm_planner.problem import Problem
from ssm_planner.typing import Array, record

PAYS = 2e-3
"""Relative saving that velocities at points must reach."""
ITERATIONS = 60
"""Largest number of iterations."""
IDLE = 5e-4
"""Relative saving below which a velocity is dropped."""


def passing_turns(problem: Problem, phase: Phase) -> Borders | None:
    """Return the reversals of joints that pass beyond a via point or take a run-up to it.

    With the displacements d_jk of the joints j in the segments k and free velocities v_jk at the
    points, the least total duration is

        min_v Σ_k max_j t(d_jk; v_j,k−1, v_jk),

    where t is the closed form of one joint (`lower_bound.minimum_times`). It is computed with fixed
    directions and with free ones. The result is None if free directions save less than a share of
    PAYS.
    """
    velocity, acceleration = np.array(
        [(joint.velocity, joint.acceleration) for joint in problem.robot.joints]
    ).T
    velocity[3] = min(velocity[3], problem.rates.get("depth", np.inf))
    displacements = np.diff(phase.points, axis=0)
    alone = _Passing(displacements, (phase.qd_start, phase.qd_end), velocity, acceleration)
    fixed_speeds = alone.minimise(np.zeros((len(displacements) - 1, 4)), may_reverse=False)
    free = alone.minimise(fixed_speeds, may_reverse=True)
    if alone.duration(free) > (1 - PAYS) * alone.duration(fixed_speeds):
        return None
    return Borders(phase.points, via_velocity=alone.without_idle(free))


@record
class _Passing:
    """Joints that pass the via points at the same instants, each limited as if it were alone."""

    displacements: Array
    """Displacements from point to point, (n, 4)."""
    ends: tuple[Array, Array]
    """q̇ at both ends, (4,) each."""
    velocity: Array
    acceleration: Array
    """Limits of velocity and acceleration, (4,) each."""

    def times(self, speeds: Array) -> Array:
        """Return the times (n, 4) of the joints in the segments for q̇ (n − 1, 4) at via points."""
        velocities = np.vstack([self.ends[0], speeds, self.ends[1]])
        return minimum_times(
            self.displacements, self.velocity, self.acceleration, (velocities[:-1], velocities[1:])
        )

    def duration(self, speeds: Array) -> float:
        """Return the total duration, s."""
        return float(self.times(speeds).max(axis=1).sum())

    def minimise(self, speeds: Array, *, may_reverse: bool) -> Array:
        """Minimise the total duration over q̇ at the via points, from `speeds` (n − 1, 4).

        If `may_reverse` is false, joints that do not continue in their direction rest at the point.
        """
        from scipy.optimize import fmin_slsqp

        n = len(self.displacements)
        limits = np.broadcast_to(self.velocity, speeds.shape)
        signs = np.sign(self.displacements)
        low, high = (
            np.where(
                may_reverse | (np.minimum(side * signs[:-1], side * signs[1:]) > 0),
                side * limits,
                0.0,
            )
            for side in (-1, 1)
        )
        unit = self.duration(speeds)

        def total(x: Array) -> float:
            return float(x[:n].sum())

        def total_slope(x: Array) -> Array:
            return np.append(np.ones(n), np.zeros(len(x) - n))

        def spare(x: Array) -> Array:
            return np.asarray(
                x[:n, None] - self.times(x[n:].reshape(-1, 4) * limits) / unit
            ).ravel()

        def spare_slope(x: Array) -> Array:
            return self._slopes(x[n:].reshape(-1, 4), unit)

        solution = fmin_slsqp(
            total,
            np.concatenate([self.times(speeds).max(axis=1) / unit, (speeds / limits).ravel()]),
            fprime=total_slope,
            bounds=[
                *[(0.0, np.inf)] * n,
                *zip((low / limits).ravel(), (high / limits).ravel(), strict=True),
            ],
            f_ieqcons=spare,
            fprime_ieqcons=spare_slope,
            iter=ITERATIONS,
            acc=SAME,
            iprint=0,
        )
        result = np.clip(solution[n:].reshape(-1, 4) * limits, low, high)
        return result if self.duration(result) < self.duration(speeds) else speeds

    def _slopes(self, shares: Array, unit: float) -> Array:
        """Return the derivatives of (T_k − t_jk) / unit, (4 n, n + 4 (n − 1)).

        They are taken with respect to T and to the velocities divided by the limits.
        """
        n = len(self.displacements)
        times = self.times(shares * self.velocity)
        slopes = np.zeros((n, 4, n + shares.size))
        slopes[np.arange(n), :, np.arange(n)] = 1.0
        # A velocity only affects the segments before and after its point, so every other one can be
        # varied at once.
        for parity in (0, 1):
            varied = shares.copy()
            varied[parity::2] += SAME
            change = (times - self.times(varied * self.velocity)) / (SAME * unit)
            for k in range(parity, n - 1, 2):
                for j in range(4):
                    slopes[[k, k + 1], j, n + 4 * k + j] = change[[k, k + 1], j]
        return slopes.reshape(4 * n, -1)

    def without_idle(self, speeds: Array) -> Array:
        """Return the velocities without those that save almost no time.

        Each velocity forces a reversal.

        The smallest ones are dropped first.
        """
        result = speeds.copy()
        cutoff = (1 + IDLE) * self.duration(speeds)
        order = np.argsort(np.abs(speeds / self.velocity), axis=None)
        for k, j in zip(*np.unravel_index(order, speeds.shape), strict=True):
            trial = result.copy()
            trial[k, j] = 0.0
            if self.duration(trial) <= cutoff:
                result = trial
        return result
