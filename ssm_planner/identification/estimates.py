"""What a fit is worth: intervals, which parameters the data determine, and the choice among equally good fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.identification import least_squares as ls
from ssm_planner.typing import Array

CONFIDENCE = 0.95
COLLINEAR = 100.0
"""Variance inflation beyond which the data do not separate a parameter from the others."""

LINKED = 0.98
"""Correlation from which two parameters count as given only together."""

REFERENCE_SPREAD = 1.0
"""Relative standard deviation with which a reference value is believed where the data decide nothing."""


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


def intervals_of(problem: ls.MapProblem, best: ls.Solution, cov: Array) -> tuple[Array, Array]:
    """(parameters,) ends in q of the likelihood-profile intervals: exact for a linear model, cut at the bounds."""
    from scipy.stats import t as student

    dof = len(problem.w) - len(problem.names)
    quantile = float(student.ppf(0.5 + CONFIDENCE / 2, dof))
    ends = []
    for k in range(len(problem.names)):
        guess = min(quantile * float(np.sqrt(cov[k, k])), 0.25 * float(problem.upper[k] - problem.lower[k]))
        ends.append(ls.profile_interval(problem, best, k, quantile**2 / dof, guess))
    return np.array([e[0] for e in ends]), np.array([e[1] for e in ends])


def separable_of(jacobian: Array, q: Array, intervals: tuple[Array, Array]) -> list[bool]:
    """Whether the data determine each parameter: it is not collinear with the others, or precise all the same."""
    size = np.sum(jacobian**2, axis=0)
    inflation = np.diag(ls.covariance(jacobian, 1.0)) * size
    precise = intervals[1] - intervals[0] < 0.5 * np.abs(q)
    return [bool(v) for v in (size > 0) & ((inflation < COLLINEAR) | precise)]


def nearest_to_reference(
    problem: ls.MapProblem, best: ls.Solution, believed: Mapping[str, float], separable: list[bool], variance: float
) -> ls.Solution:
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
    return min((ls.solve(drawn, q) for q in starts), key=lambda s: s.cost)


def inseparable_groups(
    correlation: Array, names: tuple[str, ...], separable: list[bool]
) -> tuple[tuple[str, ...], ...]:
    """Groups of parameters that only together are determined; those linked to no single other one form the last."""
    alone = [name for name, known in zip(names, separable, strict=True) if not known]
    found = [g for g in ls.groups(correlation, names, LINKED) if any(name in alone for name in g)]
    rest = tuple(name for name in alone if not any(name in g for g in found))
    return tuple(found) + ((rest,) if rest else ())
