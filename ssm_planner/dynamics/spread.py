"""How far the friction of a drive may be off: draws of what was identified, stated ranges, and drives with these values.

Two kinds of uncertainty: the posterior or covariance of an identification, which is statistics, and stated ranges
(lubrication, temperature, wear), of which every corner must be mastered. A parameter with a stated range leaves the former.
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
from ssm_planner.problem.posterior import LAW, LAWS, LOAD_OFFSET, Posterior
from ssm_planner.problem.value import unchecked
from ssm_planner.typing import Array, Range

LINEAR_DRAWS = 20_000
"""Of parameters that are cheap to look at."""
VARIABLE = (
    "mu",
    "mu_static",
    "mu_stribeck",
    "stribeck_speed",
    "b_c",
    "b_v",
    "b_oc",
    "b_ov",
    "preload",
)
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
    posterior: Posterior | None = None
    """Equally likely sets of the parameters, in place of mean and covariance."""
    inertia: Range | None = None
    """Of the motor shaft, kg·m², where a rotor's is not stated."""
    rotors: tuple[str, ...] = ()
    """Which rotor inertias would settle it."""

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
        ranges = {
            **self.ranges,
            **({} if self.inertia is None else {"input_inertia": self.inertia}),
        }
        return tuple(
            dict(zip(ranges, ends, strict=True)) for ends in itertools.product(*ranges.values())
        )

    def deviations(self, count: int) -> Array:
        """Draws of the uncertain parameters less their means, (count, k), always the same.

        A covariance is drawn log-normal, with these means and this covariance: friction is not negative.
        """
        if not self.names:
            return np.zeros((1, 0))
        if self.posterior is not None:
            sets = self.posterior.values(count)
            return np.column_stack([sets[name] for name in self.names]) - self.mean
        mean = np.where(self.mean > 0, self.mean, 1.0)
        spread = np.log1p(np.maximum(self.covariance / np.outer(mean, mean), -0.999))
        values, vectors = np.linalg.eigh(spread)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        normal = np.random.default_rng(SEED).standard_normal((count, len(self.names)))
        factors = np.exp(normal @ root.T - np.diag(root @ root.T) / 2)
        return np.asarray(self.mean * (factors - 1.0))

    def values(self, deviations: Array) -> dict[str, Array]:
        """Parameters by name, (count,) each, for deviations (count, k) from the means."""
        return {name: self.mean[i] + deviations[:, i] for i, name in enumerate(self.names)}

    def within(self, share: float, count: int = 1000) -> dict[str, Array]:
        """Parameters by name, (sets,) each, that span a range: the share of the draws nearest to their mean, by
        Mahalanobis distance, with every combination of the ends of the ranges. `count` draws where there is no posterior.
        """
        deviations = self.deviations(count if self.posterior is None else len(self.posterior.draws))
        if self.names:
            scaled = deviations / np.where(self.sigma > 0, self.sigma, 1.0)
            inverse = np.linalg.pinv(np.atleast_2d(np.cov(scaled, rowvar=False)), 1e-9)
            distance = np.einsum("ni,ij,nj->n", scaled, inverse, scaled)
            deviations = deviations[distance <= np.quantile(distance, share)]
        corners, values = self.corners(), self.values(deviations)
        sets = {name: np.tile(column, len(corners)) for name, column in values.items()}
        ends = {name: [corner[name] for corner in corners] for name in corners[0]}
        return sets | {name: np.repeat(column, len(deviations)) for name, column in ends.items()}

    def draws(self, name: str) -> Array:
        """(draws,) of one of `names`."""
        return self.values(self.deviations(LINEAR_DRAWS))[name]

    def mu_ends(self, drive: Drive, confidence: float) -> Range:
        """Smallest and largest plausible kinetic coefficient, each by file, ranges and quantile of the draws."""
        friction = friction_of(drive)
        lowest = friction.mu if friction.mu_lowest is None else friction.mu_lowest
        ends = [lowest, friction.mu, *self.ranges.get("mu", ())]
        if "mu" in self.names:
            ends += np.quantile(self.draws("mu"), [1 - confidence, confidence]).tolist()
        return min(ends), max(ends)


def spread_of(drive: Drive, relative: float | None = None) -> FrictionSpread:
    """What the drive file says of its friction's uncertainty; `relative`: range of what it says nothing of.

    Raises ProblemError where the covariance is none.
    """
    friction = friction_of(drive)
    ranges = dict(drive.friction_ranges)
    posterior = friction.posterior
    if posterior is not None:
        names = tuple(
            name for name in posterior.names if name != LOAD_OFFSET and name not in ranges
        )
        mean = np.array([_stated(drive, name, posterior) for name in names])
        covariance = np.cov(
            np.column_stack([posterior.column(name) for name in names]), rowvar=False
        )
        return FrictionSpread(names, mean, np.atleast_2d(covariance), ranges, posterior)
    table = {name: row for name, row in (friction.covariance or {}).items() if name not in ranges}
    if relative is not None:
        values = {
            name: float(getattr(friction, name)) for name in SPREAD if name not in (*ranges, *table)
        }
        ranges |= {
            name: (value * (1 - relative), value * (1 + relative))
            for name, value in values.items()
            if value > 0
        }
    names = tuple(table)
    unknown = [name for name in names if name not in VARIABLE]
    if unknown:
        raise _not_one(drive, f"{unknown[0]} is not a parameter", allowed=", ".join(VARIABLE))
    try:
        covariance = np.array([[table[a][b] for b in names] for a in names]).reshape(
            len(names), len(names)
        )
    except KeyError as error:
        raise _not_one(drive, f"it lacks the entry of {error.args[0]} in a row") from None
    _check(drive, names, covariance)
    mean = np.array([_value(drive, name) for name in names])
    return FrictionSpread(names, mean, covariance, ranges)


def drawn(drive: Drive, values: Mapping[str, Any]) -> Drive:
    """The drive with friction parameters (preload, input_inertia) replaced; arrays (count, 1) stand for many drives at once.

    LAW among the values is the number of the friction law.
    The static coefficient keeps its ratio to the coefficient in motion unless it is among the values.
    """
    own = {name: values[name] for name in ("preload", "input_inertia") if name in values}
    friction: dict[str, Any] = {name: value for name, value in values.items() if name not in own}
    given = friction_of(drive)
    if LAW in friction and not np.ndim(friction[LAW]):
        friction[LAW] = LAWS[int(friction[LAW])]
        if friction[LAW] == "coulomb":
            friction |= {"mu_stribeck": 0.0, "stribeck_speed": None}
    moving = given.mu + given.mu_stribeck
    if "mu_static" not in friction and moving > 0 and {"mu", "mu_stribeck"} & set(friction):
        now = friction.get("mu", given.mu) + friction.get("mu_stribeck", given.mu_stribeck)
        friction["mu_static"] = given.mu_static / moving * now
    return unchecked(drive, friction=unchecked(given, **friction), **own)


def _stated(drive: Drive, name: str, posterior: Posterior) -> float:
    """The drive's own; what its law has no use for, as the sets have it in the middle."""
    friction = friction_of(drive)
    if name == LAW:
        return float(LAWS.index(friction.law))
    unused = name == "stribeck_speed" and friction.stribeck_speed is None
    return float(np.median(posterior.column(name))) if unused else _value(drive, name)


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
    return ProblemError(
        f"not a covariance: {reason}", file=drive.file, key="friction.covariance", allowed=allowed
    )
