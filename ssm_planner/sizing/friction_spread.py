"""How far the friction of a drive may be from its stated values, as values to evaluate the law with.

Two kinds of not knowing: the covariance of an identification, which is statistics, and stated ranges (lubrication,
temperature, wear), of which every corner must be mastered. A parameter with a stated range leaves the covariance.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.errors import ProblemError
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.value import unchecked
from ssm_planner.typing import Array, Range

VARIABLE = ("mu", "mu_static", "mu_stribeck", "stribeck_speed", "b_c", "b_v", "b_oc", "b_ov", "preload")
"""What a covariance may speak of."""
SPREAD = ("mu", "b_c", "b_v", "b_oc", "b_ov")
"""What a stated relative spread applies to."""
SEED = 20_210_521


@dataclass(frozen=True, eq=False)
class FrictionSpread:
    """names (k,) with means (k,) and covariance (k, k), SI; ranges: intervals of other parameters."""

    names: tuple[str, ...] = ()
    mean: Array = field(default_factory=lambda: np.zeros(0))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    ranges: Mapping[str, Range] = field(default_factory=dict)

    @property
    def known(self) -> bool:
        """Something is known of how far the friction may be off."""
        return bool(self.names or self.ranges)

    @property
    def sigma(self) -> Array:
        """Standard deviations (k,)."""
        return np.sqrt(np.diag(self.covariance))

    def corners(self) -> tuple[dict[str, float], ...]:
        """Every combination of the ends of the ranges; one empty one without ranges."""
        names = list(self.ranges)
        return tuple(dict(zip(names, ends, strict=True)) for ends in itertools.product(*self.ranges.values()))

    def deviations(self, count: int) -> Array:
        """Draws of the identified parameters less their means, (count, k), always the same; none below zero."""
        if not self.names:
            return np.zeros((count, 0))
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        normal = np.random.default_rng(SEED).standard_normal((count, len(self.names)))
        return np.maximum(normal @ root.T, -self.mean)

    def values(self, deviations: Array) -> dict[str, Array]:
        """Parameters by name, (count,) each, for deviations (count, k) from the means."""
        return {name: self.mean[i] + deviations[:, i] for i, name in enumerate(self.names)}

    def lowest_mu(self, drive: Drive, confidence: float) -> float:
        """Smallest plausible kinetic coefficient: the least of file, ranges and lower quantile."""
        friction = friction_of(drive)
        lowest = friction.mu if friction.mu_lowest is None else friction.mu_lowest
        if "mu" in self.ranges:
            lowest = min(lowest, self.ranges["mu"][0])
        if "mu" in self.names:
            from statistics import NormalDist

            i = self.names.index("mu")
            lowest = min(lowest, self.mean[i] - NormalDist().inv_cdf(confidence) * self.sigma[i])
        return float(max(lowest, 0.0))


def spread_of(drive: Drive, relative: float | None = None) -> FrictionSpread:
    """What the drive file says of its friction's uncertainty; `relative`: range of what it says nothing of.

    Raises ProblemError where the covariance is none.
    """
    friction = friction_of(drive)
    ranges = dict(drive.friction_ranges)
    table = {name: row for name, row in (friction.covariance or {}).items() if name not in ranges}
    if relative is not None:
        values = {name: float(getattr(friction, name)) for name in SPREAD if name not in (*ranges, *table)}
        ranges |= {
            name: (value * (1 - relative), value * (1 + relative)) for name, value in values.items() if value > 0
        }
    names = tuple(table)
    unknown = [name for name in names if name not in VARIABLE]
    if unknown:
        raise _not_one(drive, f"{unknown[0]} is not a parameter", allowed=", ".join(VARIABLE))
    try:
        covariance = np.array([[table[a][b] for b in names] for a in names]).reshape(len(names), len(names))
    except KeyError as error:
        raise _not_one(drive, f"it lacks the entry of {error.args[0]} in a row") from None
    _check(drive, names, covariance)
    mean = np.array([_value(drive, name) for name in names])
    return FrictionSpread(names, mean, covariance, ranges)


def drawn(drive: Drive, values: Mapping[str, Any]) -> Drive:
    """The drive with friction parameters (and preload) replaced; arrays (count, 1) stand for many drives at once.

    The static coefficient keeps its ratio to the coefficient in motion unless it is among the values.
    """
    friction: dict[str, Any] = {name: value for name, value in values.items() if name != "preload"}
    given = friction_of(drive)
    moving = given.mu + given.mu_stribeck
    if "mu_static" not in friction and moving > 0 and {"mu", "mu_stribeck"} & set(friction):
        now = friction.get("mu", given.mu) + friction.get("mu_stribeck", given.mu_stribeck)
        friction["mu_static"] = given.mu_static / moving * now
    preload: Any = values.get("preload", drive.preload)
    return unchecked(drive, friction=unchecked(given, **friction), preload=preload)


def _value(drive: Drive, name: str) -> float:
    value = drive.preload if name == "preload" else getattr(friction_of(drive), name)
    if value is None:
        raise _not_one(drive, f"the friction has no {name}")
    return float(value)


def _check(drive: Drive, names: tuple[str, ...], covariance: Array) -> None:
    if not names:
        return
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if np.any(np.diag(covariance) < 0) or not np.all(np.isfinite(covariance)):
        raise _not_one(drive, "a variance is negative or not finite")
    scaled = covariance / np.outer(np.where(sigma > 0, sigma, 1.0), np.where(sigma > 0, sigma, 1.0))
    if np.abs(scaled - scaled.T).max() > 1e-4:
        raise _not_one(drive, "not symmetric")
    if np.linalg.eigvalsh((scaled + scaled.T) / 2).min() < -1e-3:
        raise _not_one(drive, "not positive semidefinite: no random quantity has it")


def _not_one(drive: Drive, reason: str, allowed: str | None = None) -> ProblemError:
    return ProblemError(f"not a covariance: {reason}", file=drive.file, key="friction.covariance", allowed=allowed)
