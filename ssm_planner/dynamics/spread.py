"""Describe the uncertainty of the friction of a drive.

There are two kinds of uncertainty. The posterior or covariance of an identification is statistical.
A stated range (lubrication, temperature, wear) is a requirement: a motion must be possible at every
corner of the ranges, that is, at every combination of their ends. A parameter with a stated range
is removed from the statistics. The main entry, `friction_spread`, reads both from a drive.
"""

import itertools
from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import required_friction
from ssm_planner.errors import ProblemError
from ssm_planner.problem import (
    FRICTION_LAWS,
    LAW_COLUMN,
    LOAD_OFFSET,
    UNCERTAIN_PARAMETERS,
    Drive,
    Posterior,
    unchecked_copy,
)
from ssm_planner.typing import Array, Arrays, Range, record

LINEARISED_DRAWS = 20_000
"""Number of draws for quantities that are cheap to evaluate."""
SPREAD_PARAMETERS = ("mu", "b_c", "b_v", "b_oc", "b_ov")
"""Parameters to which a stated relative range applies: friction coefficient and bearing friction.
"""
RANDOM_SEED = 20_210_521
"""Seed of the random numbers. With a fixed seed, equal calls give equal results."""


@record
class FrictionSpread:
    """Distribution of the friction parameters of a drive, in SI units.

    A parameter has a statistical distribution (`names`), a stated range (`ranges`), or a certain
    value.
    """

    names: tuple[str, ...] = ()
    """Names of the k parameters that have a statistical distribution."""
    mean: Array = field(default_factory=lambda: np.zeros(0))
    """Means (k,) of the parameters `names`."""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Covariance (k, k) of the parameters `names`."""
    ranges: Mapping[str, Range] = field(default_factory=dict)
    """Smallest and largest value of each parameter with a stated range."""
    posterior: Posterior | None = None
    """Equally likely sets of parameter values, from which draws are taken if they are known."""
    inertia: Range | None = None
    """Range of the input inertia of the drive if the inertia of a rotor is not stated, kg·m²."""
    rotors: tuple[str, ...] = ()
    """Descriptions of the rotor inertias that the motor files do not state."""

    @property
    def is_stated(self) -> bool:
        """True if the drive file states any uncertainty of its friction."""
        return bool(self.names or self.ranges)

    @property
    def sigma(self) -> Array:
        """Standard deviations (k,) of the parameters `names`."""
        return np.sqrt(np.diag(self.covariance))

    def corners(self) -> tuple[dict[str, float], ...]:
        """Return all combinations of the ends of the ranges, including that of the inertia.

        Returns
        -------
        tuple of dict
            Values by parameter for each combination. Without ranges, there is one empty
            combination.
        """
        ranges = dict(self.ranges)
        if self.inertia is not None:
            ranges["input_inertia"] = self.inertia
        combinations = itertools.product(*ranges.values())
        return tuple(dict(zip(ranges, ends, strict=True)) for ends in combinations)

    def deviations(self, count: int) -> Array:
        """Draw deviations of the uncertain parameters from their means.

        Equal calls give equal draws. With a posterior, the draws are its sets of values, which are
        repeated cyclically if more are needed. With a covariance, the draws follow a log-normal
        distribution with the same means and covariance, because friction is not negative.

        Parameters
        ----------
        count : int
            Number of draws.

        Returns
        -------
        (count, k) array
            Deviations in the order of `names`. The shape is (1, 0) if no parameter has a
            distribution.
        """
        if not self.names:
            return np.zeros((1, 0))
        if self.posterior is not None:
            sets = self.posterior.values(count)
            return np.column_stack([sets[name] for name in self.names]) - self.mean
        mean = np.where(self.mean > 0, self.mean, 1.0)
        # The logarithms of log-normal quantities have the covariance ln(1 + C_ij / (m_i m_j)). The
        # lower bound keeps the logarithm finite.
        spread = np.log1p(np.maximum(self.covariance / np.outer(mean, mean), -0.999))
        values, vectors = np.linalg.eigh(spread)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        normal = np.random.default_rng(RANDOM_SEED).standard_normal((count, len(self.names)))
        factors = np.exp(normal @ root.T - np.diag(root @ root.T) / 2)
        return self.mean * (factors - 1.0)

    def values(self, deviations: Array) -> Arrays:
        """Return the values of the uncertain parameters for given deviations from their means.

        Parameters
        ----------
        deviations : (count, k) array
            Deviations in the order of `names`.

        Returns
        -------
        dict of (count,) arrays
            Values by parameter.
        """
        return {name: self.mean[i] + deviations[:, i] for i, name in enumerate(self.names)}

    def within(self, share: float) -> Arrays:
        """Return sets of parameter values that represent a confidence region.

        The draws are sorted by their distance from the mean, scaled by their covariance
        (Mahalanobis distance). The nearest ones are combined with all combinations of the ends of
        the ranges. Without a posterior, 1000 draws are made.

        Parameters
        ----------
        share : float
            Fraction of the draws that the region contains, from 0 to 1.

        Returns
        -------
        dict of (sets,) arrays
            Values by parameter.
        """
        count = 1000 if self.posterior is None else len(self.posterior.draws)
        deviations = self.deviations(count)
        if self.names:
            scaled = deviations / np.where(self.sigma > 0, self.sigma, 1.0)
            covariance = np.atleast_2d(np.cov(scaled, rowvar=False))
            precision = np.linalg.pinv(covariance, 1e-9)
            squared_distances = np.einsum("ni,ij,nj->n", scaled, precision, scaled)
            nearest = squared_distances <= np.quantile(squared_distances, share)
            deviations = deviations[nearest]
        corners = self.corners()
        sets = {}
        for name, column in self.values(deviations).items():
            sets[name] = np.tile(column, len(corners))
        for name in corners[0]:
            sets[name] = np.repeat([corner[name] for corner in corners], len(deviations))
        return sets

    def draws(self, name: str) -> Array:
        """Draw random values of one uncertain parameter.

        Parameters
        ----------
        name : str
            Name of the parameter, one of `names`.

        Returns
        -------
        (draws,) array
            `LINEARISED_DRAWS` values, in SI units.
        """
        return self.values(self.deviations(LINEARISED_DRAWS))[name]

    def mu_ends(self, drive: Drive, confidence: float) -> Range:
        """Return the smallest and the largest plausible kinetic friction coefficient.

        They are the extremes of the stated values `mu` and `mu_lowest`, of the stated range, and of
        the quantiles of the draws.

        Parameters
        ----------
        drive : Drive
            Drive with its friction.
        confidence : float
            The draws contribute the quantiles 1 − confidence and confidence.

        Returns
        -------
        lowest, highest : float
            Friction coefficients.
        """
        friction = required_friction(drive)
        lowest = friction.mu if friction.mu_lowest is None else friction.mu_lowest
        ends = [lowest, friction.mu]
        ends += self.ranges.get("mu", ())
        if "mu" in self.names:
            ends += np.quantile(self.draws("mu"), [1 - confidence, confidence]).tolist()
        return min(ends), max(ends)


def friction_spread(drive: Drive, relative: float | None = None) -> FrictionSpread:
    """Return the uncertainty of the friction that a drive file states.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    relative : float, optional
        Relative range of all parameters of `SPREAD_PARAMETERS` whose uncertainty the file
        does not state.

    Returns
    -------
    FrictionSpread
        Ranges, and a posterior or a mean with a covariance.

    Raises
    ------
    ProblemError
        If the covariance is not valid.
    """
    friction = required_friction(drive)
    if friction.posterior is not None:
        return _posterior_spread(drive, friction.posterior)
    ranges = dict(drive.friction_ranges)
    table = {name: row for name, row in (friction.covariance or {}).items() if name not in ranges}
    if relative is not None:
        for name in SPREAD_PARAMETERS:
            value = float(getattr(friction, name))
            if value > 0 and name not in ranges and name not in table:
                ranges[name] = (value * (1 - relative), value * (1 + relative))
    covariance = _covariance(drive, table)
    mean = np.array([_parameter_value(drive, name) for name in table])
    return FrictionSpread(tuple(table), mean, covariance, ranges)


def _posterior_spread(drive: Drive, posterior: Posterior) -> FrictionSpread:
    """Compute the uncertainty that the posterior of an identification describes.

    Parameters with a stated range are removed from the posterior. The offset of the load is not a
    friction parameter and is removed as well. The means are the values in the drive file, and the
    covariance is that of the sets of the posterior.

    Parameters
    ----------
    drive : Drive
        Drive with its friction and stated ranges.
    posterior : Posterior
        Equally likely sets of parameter values.

    Returns
    -------
    FrictionSpread
        Stated ranges, and statistics of the other parameters.
    """
    ranges = dict(drive.friction_ranges)
    names = tuple(name for name in posterior.names if name != LOAD_OFFSET and name not in ranges)
    mean = np.array([_nominal_value(drive, name, posterior) for name in names])
    columns = np.column_stack([posterior.column(name) for name in names])
    covariance = np.atleast_2d(np.cov(columns, rowvar=False))
    return FrictionSpread(names, mean, covariance, ranges, posterior)


def _covariance(drive: Drive, table: Mapping[str, Mapping[str, float]]) -> Array:
    """Convert the covariance of a drive file to a matrix and check it.

    Parameters
    ----------
    drive : Drive
        Drive with its file, which an error names.
    table : mapping of mapping of float
        One row for each of k parameters, with the covariances by parameter.

    Returns
    -------
    (k, k) array
        Covariance in the order of the rows.

    Raises
    ------
    ProblemError
        If a parameter is unknown, an entry is missing, or the matrix is not a covariance.
    """
    names = tuple(table)
    unknown = [name for name in names if name not in UNCERTAIN_PARAMETERS]
    if unknown:
        raise _covariance_error(
            drive, f"{unknown[0]} is not a parameter", allowed=", ".join(UNCERTAIN_PARAMETERS)
        )
    covariance = np.empty((len(names), len(names)))
    for i, row in enumerate(table.values()):
        for j, name in enumerate(names):
            if name not in row:
                raise _covariance_error(drive, f"it lacks the entry of {name} in a row")
            covariance[i, j] = row[name]
    _check_covariance(drive, names, covariance)
    return covariance


def drive_with_values(drive: Drive, values: Mapping[str, Any]) -> Drive:
    """Return the drive with other friction parameters, preload or input inertia.

    The static friction coefficient keeps its ratio to the kinetic one unless it is among the
    values.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    values : mapping
        Values by parameter. Arrays (count, 1) represent many drives at once. The value of
        `LAW_COLUMN` is the index of the friction law in `FRICTION_LAWS`.

    Returns
    -------
    Drive
        Drive whose values are not checked.
    """
    drive_values = {name: values[name] for name in ("preload", "input_inertia") if name in values}
    friction = {name: value for name, value in values.items() if name not in drive_values}
    nominal = required_friction(drive)
    if LAW_COLUMN in friction and not np.ndim(friction[LAW_COLUMN]):
        friction[LAW_COLUMN] = FRICTION_LAWS[int(friction[LAW_COLUMN])]
        if friction[LAW_COLUMN] == "coulomb":
            friction |= {"mu_stribeck": 0.0, "stribeck_speed": None}
    nominal_mu = nominal.mu + nominal.mu_stribeck
    has_new_mu = "mu" in friction or "mu_stribeck" in friction
    if "mu_static" not in friction and nominal_mu > 0 and has_new_mu:
        mu = friction.get("mu", nominal.mu) + friction.get("mu_stribeck", nominal.mu_stribeck)
        friction["mu_static"] = nominal.mu_static / nominal_mu * mu
    return unchecked_copy(drive, friction=unchecked_copy(nominal, **friction), **drive_values)


def _nominal_value(drive: Drive, name: str, posterior: Posterior) -> float:
    """Return the value of an uncertain parameter in the drive file.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    name : str
        Name of the parameter. The value of `LAW_COLUMN` is the index of the friction law.
    posterior : Posterior
        Equally likely sets of parameter values.

    Returns
    -------
    float
        Value in SI units. If the friction law uses no Stribeck speed, the drive file does not state
        one, and the result is the median of the posterior.
    """
    friction = required_friction(drive)
    if name == LAW_COLUMN:
        return float(FRICTION_LAWS.index(friction.law))
    if name == "stribeck_speed" and friction.stribeck_speed is None:
        return float(np.median(posterior.column(name)))
    return _parameter_value(drive, name)


def _parameter_value(drive: Drive, name: str) -> float:
    """Return the preload or a friction parameter of a drive.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    name : str
        "preload", or the name of a friction parameter.

    Returns
    -------
    float
        Value in SI units.

    Raises
    ------
    ProblemError
        If the drive file does not state the parameter.
    """
    value = drive.preload if name == "preload" else getattr(required_friction(drive), name)
    if value is None:
        raise _covariance_error(drive, f"the friction lacks {name}")
    return float(value)


def _check_covariance(drive: Drive, names: tuple[str, ...], covariance: Array) -> None:
    """Raise an error unless a matrix is a covariance.

    A covariance is finite and symmetric. Its variances and eigenvalues are not negative.
    Symmetry and eigenvalues are tested after the matrix has been scaled to unit variances, so that
    the units of the parameters do not matter. The tolerances cover the rounding of the numbers in a
    file.

    Parameters
    ----------
    drive : Drive
        Drive with its file, which the error names.
    names : tuple of str
        Names of the k parameters.
    covariance : (k, k) array
        The matrix.

    Raises
    ------
    ProblemError
        If the matrix is not a covariance.
    """
    if not names:
        return
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if np.any(np.diag(covariance) < 0) or not np.all(np.isfinite(covariance)):
        raise _covariance_error(drive, "a variance is negative or not finite")
    unit = np.where(sigma > 0, sigma, 1.0)
    scaled = covariance / np.outer(unit, unit)
    if np.abs(scaled - scaled.T).max() > 1e-4:
        raise _covariance_error(drive, "not symmetric")
    if np.linalg.eigvalsh((scaled + scaled.T) / 2).min() < -1e-3:
        raise _covariance_error(drive, "not positive semidefinite: no random quantity has it")


def _covariance_error(drive: Drive, reason: str, allowed: str | None = None) -> ProblemError:
    """Build the error for an invalid covariance.

    Parameters
    ----------
    drive : Drive
        Drive with its file, which the error names.
    reason : str
        Reason why the covariance is invalid.
    allowed : str, optional
        Description of the permitted values.

    Returns
    -------
    ProblemError
        The error, which the caller raises.
    """
    return ProblemError(
        f"not a covariance: {reason}", file=drive.file, key="friction.covariance", allowed=allowed
    )
