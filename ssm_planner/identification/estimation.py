"""Bounded weighted least squares of a map's parameters, and what they are worth.

Intervals from the likelihood profile; which parameters the data determine; the choice among equally good fits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.identification.parameters import map_torque, with_parameters
from ssm_planner.problem.drive import Drive
from ssm_planner.typing import Array

CONFIDENCE = 0.95
COLLINEAR = 100.0
"""Variance inflation beyond which the data do not separate a parameter from the others."""

LINKED = 0.98
"""Correlation from which two parameters count as given only together."""

REFERENCE_SPREAD = 1.0
"""Relative standard deviation with which a reference value is believed where the data decide nothing."""

_STEP = 1e-6
_GAUGE = 1e-6
"""Pull towards the anchors, in torque ranges per unit of q: enough to choose among equally good solutions, no more."""


@dataclass(frozen=True)
class Estimate:
    """One parameter: value and 95 % interval; low = high = value where it was given instead of fitted."""

    value: float
    low: float
    high: float
    fixed: bool = False
    separable: bool = True
    """False: the data alone do not determine it; the interval is what bounds and reference values leave."""
    at_bound: bool = False


@dataclass(frozen=True, eq=False)
class MapProblem:
    """Residuals of a map over the free parameters q = θ / scale, in units of the torque range."""

    drive: Drive
    law: str
    w: Array
    tau: Array
    weight: Array
    """(points,) factor of each residual: 1, less for outliers."""
    load: float
    names: tuple[str, ...]
    fixed: Mapping[str, float]
    scale: Array
    lower: Array
    upper: Array
    anchor: Array
    """Reference values (or first guesses) that directions without data are drawn to, in q."""
    trust: Array
    """(parameters,) additional pull of each anchor, in torque ranges per unit of q."""

    @property
    def torque_range(self) -> float:
        return float(np.ptp(self.tau))

    def torque(self, q: Array) -> Array:
        """Model torque (..., points) for parameter sets (..., parameters)."""
        theta = np.moveaxis(np.asarray(q) * self.scale, -1, 0)[..., None]
        values: dict[str, float] = dict(self.fixed)
        values |= dict(zip(self.names, theta, strict=True))
        return map_torque(with_parameters(self.drive, self.law, values), self.w, self.load)

    def residual(self, q: Array) -> Array:
        """(..., points + parameters): misfit over the torque range, then the pull of the anchors."""
        misfit = self.weight * (self.torque(q) - self.tau) / self.torque_range
        pull = (_GAUGE + self.trust) * (q - self.anchor)
        return np.concatenate([misfit, pull], axis=-1)

    def jacobian(self, q: Array) -> Array:
        """(points + parameters, parameters) by differences within the bounds, all columns in one evaluation."""
        step = _STEP * np.maximum(np.abs(q), 1e-2)
        step = np.where(q + step > self.upper, -step, step)
        sets = np.concatenate([q[None], q + np.diag(step)])
        values = self.residual(sets)
        return ((values[1:] - values[0]) / step[:, None]).T


@dataclass(frozen=True, eq=False)
class Solution:
    """A minimum of a MapProblem."""

    q: Array
    """(parameters,)."""
    cost: float
    """Weighted sum of squares, residuals in units of the torque range."""
    residual: Array
    """(points,)."""


def solve(problem: MapProblem, q0: Array, held: tuple[int, float] | None = None) -> Solution:
    """Minimise the cost from q0; `held` = (index, value) keeps one parameter at a value."""
    from scipy.optimize import least_squares

    q = np.clip(np.array(q0, dtype=float), problem.lower, problem.upper)
    free = np.ones(len(q), dtype=bool)
    if held is not None:
        q[held[0]] = held[1]
        free[held[0]] = False
    points = len(problem.w)
    if free.any():

        def full(part: Array) -> Array:
            whole = q.copy()
            whole[free] = part
            return whole

        def misfit(part: Array) -> Array:
            return problem.residual(full(part))

        def slope(part: Array) -> Array:
            return problem.jacobian(full(part))[:, free]

        low, high = problem.lower[free], problem.upper[free]
        inside = np.clip(q[free], low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        found = least_squares(
            misfit,
            inside,
            jac=slope,
            bounds=(low, high),
            xtol=1e-10,
            ftol=1e-10,
            gtol=1e-12,
            max_nfev=200,
        )
        q = full(found.x)
    residual = problem.residual(q)
    return Solution(q, float(np.sum(residual**2)), residual[:points])


def profile_interval(
    problem: MapProblem, best: Solution, index: int, rise: float, deviation: float
) -> tuple[float, float]:
    """Interval of q[index] where the cost, minimised over all others, stays below best.cost·(1 + rise), within bounds.

    deviation: first guess of the half width in q.
    """
    ends = []
    for sign in (-1.0, 1.0):
        edge = problem.lower[index] if sign < 0 else problem.upper[index]
        ends.append(_profile_end(problem, best, index, rise=rise, step=sign * deviation, edge=edge))
    return ends[0], ends[1]


def _profile_end(problem: MapProblem, best: Solution, index: int, *, rise: float, step: float, edge: float) -> float:
    """Secant search for the root of √(cost rise) along the profile, which is a straight line for a linear model."""
    target = math.sqrt(best.cost * rise)
    centre, reach = best.q[index], abs(edge - best.q[index])
    sign = math.copysign(1.0, step)
    if reach <= 1e-12 * max(1.0, abs(centre)):
        return float(edge)

    q = best.q

    def height(distance: float) -> float:
        nonlocal q
        start = q if abs(q[index] - centre) > 0 else best.q
        found = solve(problem, start, (index, centre + sign * distance))
        q = found.q
        return math.sqrt(max(found.cost - best.cost, 0.0)) - target

    inner, inner_height = 0.0, -target
    outer = min(max(abs(step), 1e-6 * reach), reach)
    for _ in range(40):
        outer_height = height(outer)
        if outer_height >= 0:
            break
        if outer >= reach:
            return float(edge)
        inner, inner_height = outer, outer_height
        slope = (outer_height + target) / outer
        outer = min(reach, max(1.2 * outer, min(5.0 * outer, target / slope * 1.02 if slope > 0 else 5.0 * outer)))
    for _ in range(20):
        if outer_height <= 0.01 * target or outer - inner <= 1e-3 * outer:
            break
        middle = inner + (outer - inner) * -inner_height / (outer_height - inner_height)
        middle = min(max(middle, inner + 0.05 * (outer - inner)), outer - 0.05 * (outer - inner))
        h = height(middle)
        if h < 0:
            inner, inner_height = middle, h
            if h > -0.01 * target:
                outer = middle
                break
        else:
            outer, outer_height = middle, h
    return float(centre + sign * outer)


def covariance(jacobian: Array, variance: float) -> Array:
    """(parameters, parameters) variance·(JᵀJ)⁺, with directions that nothing determines left large, not infinite."""
    _, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    s = np.maximum(s, 1e-10 * s.max())
    return (vt.T / s**2 * variance) @ vt


def groups(correlation: Array, names: Sequence[str], threshold: float) -> list[tuple[str, ...]]:
    """Sets of parameters linked by correlations (parameters, parameters) beyond the threshold."""
    left, found = set(range(len(names))), []
    while left:
        group, frontier = set(), {left.pop()}
        while frontier:
            k = frontier.pop()
            group.add(k)
            near = {j for j in left if abs(correlation[k, j]) > threshold}
            left -= near
            frontier |= near
        if len(group) > 1:
            found.append(tuple(names[k] for k in sorted(group)))
    return found


def intervals_of(problem: MapProblem, best: Solution, cov: Array) -> tuple[Array, Array]:
    """(parameters,) ends in q of the likelihood-profile intervals: exact for a linear model, cut at the bounds."""
    from scipy.stats import t as student

    dof = len(problem.w) - len(problem.names)
    quantile = float(student.ppf(0.5 + CONFIDENCE / 2, dof))
    ends = []
    for k in range(len(problem.names)):
        guess = min(quantile * float(np.sqrt(cov[k, k])), 0.25 * float(problem.upper[k] - problem.lower[k]))
        ends.append(profile_interval(problem, best, k, quantile**2 / dof, guess))
    return np.array([e[0] for e in ends]), np.array([e[1] for e in ends])


def separable_of(jacobian: Array, q: Array, intervals: tuple[Array, Array]) -> list[bool]:
    """Whether the data determine each parameter: it is not collinear with the others, or precise all the same.

    jacobian: (points, parameters); q and the ends of the intervals: (parameters,).
    """
    size = np.sum(jacobian**2, axis=0)
    inflation = np.diag(covariance(jacobian, 1.0)) * size
    precise = intervals[1] - intervals[0] < 0.5 * np.abs(q)
    return [bool(v) for v in (size > 0) & ((inflation < COLLINEAR) | precise)]


def nearest_to_reference(
    problem: MapProblem, best: Solution, believed: Mapping[str, float], separable: list[bool], variance: float
) -> Solution:
    """Among nearly equally good fits, the one near the reference values of what the data leave open."""
    trust, anchor = np.zeros(len(problem.names)), problem.anchor.copy()
    for k, name in enumerate(problem.names):
        if not separable[k] and believed.get(name):
            anchor[k] = believed[name] / problem.scale[k]
            trust[k] = np.sqrt(variance) / (REFERENCE_SPREAD * anchor[k])
    if not trust.any():
        return best
    drawn = replace(problem, trust=trust, anchor=anchor)
    starts = (best.q, np.where(trust > 0, anchor, best.q))
    return min((solve(drawn, q) for q in starts), key=lambda s: s.cost)


def inseparable_groups(
    correlation: Array, names: tuple[str, ...], separable: list[bool]
) -> tuple[tuple[str, ...], ...]:
    """Groups of parameters that the data determine only together; those linked to no single other one form the last.

    correlation: (parameters, parameters).
    """
    alone = [name for name, known in zip(names, separable, strict=True) if not known]
    found = [g for g in groups(correlation, names, LINKED) if any(name in alone for name in g)]
    rest = tuple(name for name in alone if not any(name in g for g in found))
    return tuple(found) + ((rest,) if rest else ())
