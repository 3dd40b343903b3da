"""Breakaway, growth of friction at rest and frictional memory from start–stop recordings."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.identification.fit import Estimate
from ssm_planner.identification.prediction import Motion, departure, predict_torque
from ssm_planner.identification.recordings import Recording
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.posterior import CONFIDENCE
from ssm_planner.representation import ShortRepr
from ssm_planner.typing import Array

PARAMETERS = ("mu_static", "dwell_constant", "memory")

UPPER = np.array([0.3, 20.0, 0.5])
"""Largest rise of mu_static above mu, dwell constant in s, memory in s."""

_GRID = (
    (0.0, 0.01, 0.02, 0.04, 0.07, 0.1, 0.15),
    (0.0, 0.1, 0.3, 1.0, 3.0),
    (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4),
)
_STEPS = np.array([1e-3, 1e-2, 2e-3])
_SUBSETS: tuple[tuple[int, ...], ...] = ((), (0,), (2,), (0, 2), (0, 1), (0, 1, 2))


@dataclass(frozen=True, eq=False)
class DynamicFit(ShortRepr):
    """Result of `fit_dynamic`."""

    drive: Drive
    estimates: dict[str, Estimate]
    """Those that the recordings support; the others keep the map's values and are marked fixed."""
    before: tuple[float, ...]
    """NRMSD of each recording with the map's friction alone."""
    after: tuple[float, ...]
    notes: tuple[str, ...] = ()


class _Problem:
    """Residuals of recordings over θ = (mu_static − mu, dwell constant, memory), each in units of its torque range."""

    def __init__(
        self, drive: Drive, recordings: Sequence[Recording], load: float, load_inertia: float
    ) -> None:
        self.drive, self.recordings, self.load, self.load_inertia = (
            drive,
            recordings,
            load,
            load_inertia,
        )
        self.motions = [Motion.of(r.time, r.w) for r in recordings]
        self.measured = [
            r.tau - departure(drive, m, load) for r, m in zip(recordings, self.motions, strict=True)
        ]
        """What is left for the law, N·m."""
        base = friction_of(drive)
        self.default = np.array([base.mu_static - base.mu, base.dwell_constant or 0.0, base.memory])

    def model(self, theta: Array) -> Drive:
        base = friction_of(self.drive)
        rise, dwell, memory = (float(v) for v in theta)
        friction = replace(
            base, mu_static=base.mu + rise, dwell_constant=dwell or None, memory=memory
        )
        return replace(self.drive, friction=friction)

    def residual(self, theta: Array) -> Array:
        drive = self.model(theta)
        pairs = zip(self.motions, self.measured, self.recordings, strict=True)
        return np.concatenate(
            [
                (predict_torque(drive, m, self.load, self.load_inertia) - tau) / np.ptp(r.tau)
                for m, tau, r in pairs
            ]
        )

    def cost(self, theta: Array) -> float:
        return float(np.sum(self.residual(theta) ** 2))

    def nrmsd(self, theta: Array) -> tuple[float, ...]:
        parts = np.split(self.residual(theta), np.cumsum([len(tau) for tau in self.measured])[:-1])
        return tuple(float(np.sqrt(np.mean(part**2))) for part in parts)


def fit_dynamic(
    drive: Drive, recordings: Sequence[Recording], load: float, load_inertia: float = 0.0
) -> DynamicFit:
    """Fit mu_static, dwell_constant (s) and memory (s) to start–stop recordings, the map's parameters kept.

    Of the subsets of the three, the one with the lowest Akaike criterion is taken, counting as samples only what the
    autocorrelation of the residuals leaves independent. 95 % intervals are asymptotic.
    """
    problem = _Problem(drive, recordings, load, load_inertia)
    starts = {subset: _best_of_grid(problem, subset) for subset in _SUBSETS}
    independent = _independent(problem.residual(starts[(0, 1, 2)]))
    criterion = {
        s: independent * math.log(problem.cost(theta)) + 2 * len(s) for s, theta in starts.items()
    }
    subset = min(criterion, key=lambda s: criterion[s])
    theta = _polished(problem, starts[subset], subset)
    left = [PARAMETERS[k] for k in range(3) if k not in subset]
    gain = criterion[()] - criterion[subset]
    notes = [
        f"start–stop recordings: {' and '.join(PARAMETERS[k] for k in subset)} identified (Akaike gain {gain:.1f})"
    ]
    if not subset:
        notes = []
    if left:
        notes.append(
            f"start–stop recordings show no more of {' and '.join(left)} than chance: kept as the map gives them"
        )
    return DynamicFit(
        drive=problem.model(theta),
        estimates=_estimates(problem, theta, subset, independent),
        before=problem.nrmsd(problem.default),
        after=problem.nrmsd(theta),
        notes=tuple(notes),
    )


def _best_of_grid(problem: _Problem, subset: tuple[int, ...]) -> Array:
    axes = [values if k in subset else (problem.default[k],) for k, values in enumerate(_GRID)]
    points = [problem.default, *(np.array(point) for point in itertools.product(*axes))]
    return min(points, key=problem.cost)


def _polished(problem: _Problem, theta: Array, subset: tuple[int, ...]) -> Array:
    from scipy.optimize import least_squares

    if not subset:
        return theta
    free = list(subset)

    def full(part: Array) -> Array:
        whole = theta.copy()
        whole[free] = part
        return whole

    def misfit(part: Array) -> Array:
        return problem.residual(full(part))

    found = least_squares(
        misfit,
        np.clip(theta[free], 1e-6, UPPER[free] - 1e-6),
        bounds=(0.0, UPPER[free]),
        x_scale=(0.1 * UPPER)[free],
        diff_step=np.full(len(free), 1e-3),
    )
    return min((theta, full(found.x)), key=problem.cost)


def _independent(residual: Array) -> float:
    """Number of independent samples among residuals with their lag-one autocorrelation."""
    centred = residual - residual.mean()
    rho = float(np.sum(centred[1:] * centred[:-1]) / max(float(np.sum(centred**2)), 1e-300))
    rho = min(max(rho, 0.0), 0.99)
    return len(residual) * (1.0 - rho) / (1.0 + rho)


def _estimates(
    problem: _Problem, theta: Array, subset: tuple[int, ...], independent: float
) -> dict[str, Estimate]:
    from scipy.stats import norm

    mu = friction_of(problem.drive).mu
    offset = np.array([mu, 0.0, 0.0])
    half = np.zeros(3)
    if subset:
        value = problem.residual(theta)
        columns = []
        for k in subset:
            low, high = theta.copy(), theta.copy()
            low[k], high[k] = max(theta[k] - _STEPS[k], 0.0), theta[k] + _STEPS[k]
            columns.append((problem.residual(high) - problem.residual(low)) / (high[k] - low[k]))
        jacobian = np.stack(columns, axis=1)
        variance = float(value @ value) / max(independent - len(subset), 1.0)
        information = jacobian.T @ jacobian / variance * (independent / len(value))
        cov = np.linalg.pinv(information + np.diag(1e-9 / UPPER[list(subset)] ** 2))
        half[list(subset)] = float(norm.ppf(0.5 + CONFIDENCE / 2)) * np.sqrt(
            np.maximum(np.diag(cov), 0.0)
        )
    estimates = {}
    for k, name in enumerate(PARAMETERS):
        low, high = (
            np.clip([theta[k] - half[k], theta[k] + half[k]], 0.0, max(UPPER[k], theta[k]))
            + offset[k]
        )
        estimates[name] = Estimate(
            value=float(theta[k] + offset[k]),
            low=float(low),
            high=float(high),
            fixed=k not in subset,
            separable=bool(half[k] < 0.5 * UPPER[k]),
            at_bound=bool(k in subset and min(theta[k], UPPER[k] - theta[k]) < 1e-5 * UPPER[k]),
        )
    return estimates
