"""The posterior of a drive's friction by importance sampling at deterministic points.

It shares the density with `ssm_planner.identification.posterior`, but not the sampler: b_c and b_v,
which enter the torque linearly, come from truncated t-distributions, and the other coordinates from
the prior and a mixture of t-distributions that adapts to the posterior in four rounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ssm_planner.identification.posterior import (
    DEGREES,
    SHARES,
    MapModel,
    correlation,
    covariance_near,
    most_likely,
)
from ssm_planner.typing import Array

COMPONENTS = (1, 2, 4, 8)
"""Number of mixture components after each round of adaptation."""
ADAPTING = 2**12
"""Number of points in a round of adaptation."""
POINTS = 2**17
"""Number of points in the final round: intervals of two shifts then agree within 3 %."""
WIDENING = 0.01
"""Part of the whole covariance that is added to the covariance of each component."""
FEWEST = 100
"""Number of points in a round, at least, to which the components adapt."""
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class WeightedSets:
    """Parameter sets z (sets, k) of one law with the logarithms of their weights (sets,)."""

    z: Array
    log_weight: Array

    @cached_property
    def weight(self) -> Array:
        """Weights (sets,) with the sum 1."""
        return np.asarray(np.exp(self.log_weight - np.logaddexp.reduce(self.log_weight)))

    def interval(self, column: int) -> tuple[float, float]:
        """Return the ends between which a coordinate lies with 95 % probability."""
        order = np.argsort(self.z[:, column])
        reached = np.cumsum(self.weight[order])
        low, high = np.searchsorted(reached, [0.025, 0.975])
        return float(self.z[order[low], column]), float(self.z[order[high], column])


def sample(model: MapModel, shift: float = 0.5) -> WeightedSets:
    """Return parameter sets of a law with weights that represent its posterior."""
    curved = np.flatnonzero(~_linear(model))
    z = most_likely(model)
    covariance = covariance_near(model, z)[np.ix_(curved, curved)]
    mixture = [(z[curved], np.asarray(np.linalg.cholesky(covariance)))]
    for count in COMPONENTS:
        trial = _weighted(model, mixture, _sequence(ADAPTING, len(z), shift))
        weight = trial.weight.reshape(len(SHARES), -1).sum(axis=0)
        mixture = _components(trial.z[: len(weight), curved], weight, count)
    return _weighted(model, mixture, _sequence(POINTS, len(z), shift))


def _linear(model: MapModel) -> Array:
    return np.array([name in ("b_c", "b_v") for name in model.names], dtype=bool)


def _sequence(count: int, dimensions: int, shift: float) -> Array:
    """Return evenly distributed points (count, dimensions) in the unit cube.

    They are an additive recurrence whose step has the powers of 1/φ as coordinates, with
    φ^(dimensions + 1) = φ + 1 (M. Roberts, The unreasonable effectiveness of quasirandom sequences,
    2018).
    """
    phi = 2.0
    for _ in range(60):
        phi = (1 + phi) ** (1 / (dimensions + 1))
    steps = phi ** -np.arange(1.0, dimensions + 1)
    return np.asarray((shift + np.arange(1, count + 1)[:, None] * steps) % 1.0)


def _whiteners(model: MapModel) -> list[tuple[Array, float]]:
    """Return W (points, points) with W Wᵀ = R_c⁻¹ and ln p(c) |R_c|^(−1/2) for each share c."""
    related, one = correlation(model.w, model.w), np.eye(len(model.w))
    roots = [np.linalg.cholesky((1 - share) * one + share * related) for share in SHARES]
    return [
        (np.linalg.inv(root).T, math.log(p) - float(np.log(np.diag(root)).sum()))
        for p, root in zip(SHARES.values(), roots, strict=True)
    ]


def _weighted(model: MapModel, mixture: list[tuple[Array, Array]], u: Array) -> WeightedSets:
    """Return the sample at points u (points, k) of the unit cube, with one set for each share.

    The points take turns among the prior and the components (mean, Cholesky factor of the
    covariance) of the mixture. The components have t-distributions of two degrees of freedom, whose
    quantiles have a closed form.
    """
    from scipy.special import ndtri, stdtr, stdtrit

    linear_mask, floor = _linear(model), DEGREES * model.scatter**2
    degrees_of_square = len(model.w) + DEGREES
    own, inner = u[:, ~linear_mask], np.arange(len(u)) % (len(mixture) + 1)
    y, quantile = ndtri(own), (2 * own - 1) / np.sqrt(2 * own * (1 - own))
    for k, (mean, root) in enumerate(mixture):
        y[inner == k] = mean + quantile[inner == k] @ root.T
    densities = [_log_normal(y)] + [
        np.sum(_log_t((y - mean) @ np.linalg.inv(root).T, 2.0) - np.log(np.diag(root)), axis=1)
        for mean, root in mixture
    ]
    z = np.full(u.shape, -np.inf)
    z[:, ~linear_mask] = y
    linear = np.flatnonzero(linear_mask)
    slopes = {"b_c": np.sign(model.w), "b_v": model.w}
    columns = np.array([slopes[model.names[i]] * model.weight for i in linear])
    residual, samples = model.residual(z), []
    centre, spread = model.prior
    for whitener, log in _whiteners(model):
        q, r = np.linalg.qr((columns.reshape(-1, len(model.w)) @ whitener).T)
        sets, x = z.copy(), np.zeros((len(z), len(linear)))
        with np.errstate(all="ignore"):
            error = residual @ whitener
            best, log_proposal = -error @ q, np.logaddexp.reduce(densities, axis=0)
            square = np.sum((error + best @ q.T) ** 2, axis=1) + floor
            for j in reversed(range(len(linear))):
                # x_j > 0 is t-distributed about its regression on the later ones.
                i, degrees = linear[j], len(model.w) + DEGREES - 1 - j
                scale = np.sqrt(square / degrees) / abs(r[j, j])
                middle = (best[:, j] - x[:, j + 1 :] @ r[j, j + 1 :]) / r[j, j]
                positive = stdtr(degrees, middle / scale)
                t = stdtrit(degrees, np.maximum(u[:, i] * positive, TINY))
                x[:, j] = np.maximum(middle - scale * t, TINY)
                sets[:, i] = (np.log(x[:, j]) - centre[i]) / spread[i]
                jacobian = spread[i] * x[:, j] / (scale * positive)
                log_proposal += _log_t(t, degrees) + np.log(jacobian)
                square = square * (1 + t * t / degrees)
            density = log + -0.5 * degrees_of_square * np.log(square) + _log_normal(sets)
            log_weight = density - log_proposal + math.log(len(densities) / len(u))
        # Sets at which the law overflows have no weight. Their other values must be finite.
        lost = ~np.isfinite(log_weight)
        sets[lost], log_weight[lost] = 0.0, -np.inf
        samples.append((sets, log_weight))
    return WeightedSets(*map(np.concatenate, zip(*samples, strict=True)))


def _components(y: Array, weight: Array, count: int) -> list[tuple[Array, Array]]:
    """Return `count` components (mean, Cholesky factor) that follow the points y (points, d).

    They divide the points into slabs of equal weight (points,) along the longest principal axis.
    The largest weights are clipped, so that FEWEST points or more count.
    """
    weight = np.minimum(weight, max(np.sort(weight)[-FEWEST], TINY))
    mean, covariance = _moments(y, weight)
    order = np.argsort((y - mean) @ np.linalg.eigh(covariance)[1][:, -1:].sum(axis=1))
    share = np.cumsum(weight[order]) / weight.sum()
    slabs = np.split(order, np.searchsorted(share, np.arange(1, count) / count))
    moments = (_moments(y[slab], weight[slab]) for slab in slabs)
    return [(m, np.asarray(np.linalg.cholesky(c + WIDENING * covariance))) for m, c in moments]


def _moments(values: Array, weight: Array) -> tuple[Array, Array]:
    """Return the mean (k,) and the covariance (k, k) of values (sets, k) with weights (sets,)."""
    mean = weight @ values / weight.sum()
    apart = values - mean
    return mean, (apart.T * weight) @ apart / weight.sum()


def _log_normal(z: Array) -> Array:
    """Return the logarithm of the standard normal density, (sets,), at z (sets, k)."""
    return -0.5 * np.sum(z * z + math.log(2 * math.pi), axis=1)


def _log_t(x: Array, degrees: float) -> Array:
    """Return the logarithm of Student's density at x, with its shape."""
    half = 0.5 * (degrees + 1)
    constant = math.lgamma(half) - math.lgamma(0.5 * degrees) - 0.5 * math.log(degrees * math.pi)
    return np.asarray(constant - half * np.log1p(x * x / degrees))
