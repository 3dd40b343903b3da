"""Sample the posterior of a drive's friction by importance sampling at deterministic points.

`sample_posterior` is the main function, and `fit_map` calls it for every friction law. The module
`posterior` defines the posterior and its symbols.

The bearing friction b_c and b_v enter the torque linearly. Given the other parameters, their
posterior is a truncated t-distribution, which is sampled exactly. The other parameters are called
curved. They are drawn from a mixture of the prior and of t-distributions [1], which adapts to the
posterior in rounds [2]. A weight corrects the difference between the density of the mixture and the
posterior at each parameter set. The sum of the weights is the evidence of the friction law, that
is, the probability density of the data under this law, up to a constant factor.

[1] T. Hesterberg, Weighted average importance sampling and defensive mixture distributions,
Technometrics 37, 1995.
[2] O. Cappé, R. Douc, A. Guillin, J.-M. Marin, C. P. Robert, Adaptive importance sampling in
general mixture classes, Stat. Comput. 18, 2008.
[3] M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018.
[4] L. Martino, V. Elvira, F. Louzada, Effective sample size for importance sampling based on
discrepancy measures, Signal Process. 131, 2017.
"""

import math
from functools import cached_property

import numpy as np

from ssm_planner.identification.posterior import (
    SCATTER_PRIOR_WEIGHT,
    SHARED_FRACTIONS,
    MapModel,
    approximate_covariance,
)
from ssm_planner.problem import CONFIDENCE
from ssm_planner.typing import Array, Indices, Range, record

ADAPTATION_POINTS = (2**12, 2**12, 2**12, 2**13, 2**14)
"""Number of points in each round of adaptation.

The number of t-distributions in the mixture doubles from round to round.
"""
FINAL_POINTS = 2**17
"""Number of points in the final round.

Intervals of two samples with different starts of the sequence then agree within 3 %.
"""
POINTS_PER_BLOCK = 2**13
"""Number of points that are evaluated at once, which bounds the memory."""
COVARIANCE_WIDENING = 0.1
"""Share of the total covariance that is added to the covariance of each t-distribution."""
UNCLIPPED_WEIGHTS = 100
"""Number of points with the largest weights. These weights are clipped to the smallest of them."""
LARGEST_WEIGHT = 5e-3
"""Largest weight of one point in a reliable sample, as a share of the sum of all weights.

Above it, 1000 draws would contain the set more than five times.
"""
SMALLEST_POSITIVE = 1e-300
"""Smallest value of numbers that must stay positive."""

Mixture = list[tuple[Array, Array]]
"""Centre (d,) and scale (d, d) of each t-distribution in a mixture.

The scale is the Cholesky factor of the covariance that the distribution represents. The d
coordinates are those of all parameters except b_c and b_v.
"""


@record
class PosteriorSample:
    """Weighted parameter sets of one friction law, which represent its posterior.

    Each point of the quasirandom sequence gives one set for each fraction c of `SHARED_FRACTIONS`.
    The first axis of the arrays belongs to these fractions. Its length is called `shares`.
    """

    model: MapModel
    """Friction law with the data."""
    z: Array
    """Coordinates of the parameters, (shares, points, k)."""
    log_weight: Array
    """Logarithms of the weights, (shares, points)."""
    square: Array
    """Sum of squared errors ν s₀² + eᵀ R_c⁻¹ e, (shares, points) in N²·m²."""

    @cached_property
    def log_evidence(self) -> float:
        """Logarithm of the evidence p(τ) of the law, without a constant that all laws share."""
        return float(np.logaddexp.reduce(self.log_weight, axis=None))

    @cached_property
    def weight(self) -> Array:
        """Weights (shares, points) with the sum 1."""
        return np.exp(self.log_weight - self.log_evidence)

    @property
    def flat(self) -> tuple[Array, Array]:
        """Coordinates (sets, k) and weights (sets,) of all parameter sets."""
        return self.z.reshape(self.weight.size, -1), self.weight.ravel()

    @property
    def largest_weight(self) -> float:
        """Largest weight of a point. Its inverse is an effective sample size [4]."""
        return float(self.weight.sum(axis=0).max())

    @cached_property
    def covariance(self) -> Array:
        """Covariance (k, k) of the coordinates z."""
        z, weight = self.flat
        _, covariance = _weighted_moments(z, weight)
        return covariance

    @property
    def scatter(self) -> Array:
        """Expected values (2,) of the squared scatter s² in N²·m² and of its shared fraction c."""
        degrees = len(self.model.w) + SCATTER_PRIOR_WEIGHT - 2
        variance = np.sum(self.weight * self.square) / degrees
        return np.array([variance, self.weight.sum(axis=1) @ list(SHARED_FRACTIONS)])

    @property
    def ordered(self) -> tuple[Array, Array]:
        """Parameter sets and their weights, sorted along the longest principal axis.

        The coordinates have the shape (sets, k), with one row for each set of k parameters. The
        weights have the shape (sets,). Systematic resampling draws sets at equal steps of the summed
        weight, so in this order the drawn sets cover the whole distribution.
        """
        z, weight = self.flat
        order = _principal_order(z, weight)
        return z[order], weight[order]


def sample_posterior(model: MapModel, z: Array, shift: float = 0.5) -> PosteriorSample:
    """Sample the posterior of a friction law.

    Rounds with `ADAPTATION_POINTS` points adapt the mixture to the posterior. The result contains
    the points of the final round only.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    z : (k,) array
        Most likely coordinates of the k parameters, at which the adaptation starts.
    shift : float
        Start of the quasirandom sequence in [0, 1). It changes the result only within the accuracy
        of the sample.

    Returns
    -------
    PosteriorSample
        Weighted parameter sets.
    """
    curved = np.flatnonzero(~model.linear)
    covariance = approximate_covariance(model, z)[np.ix_(curved, curved)]
    mixture = [(z[curved], np.asarray(np.linalg.cholesky(covariance)))]
    for divisions, points in enumerate(ADAPTATION_POINTS):
        trial = _sample_mixture(model, mixture, points, shift)
        weight = trial.weight.sum(axis=0)
        # Clipping makes sure that the components follow more than a few points.
        weight = np.minimum(weight, max(np.sort(weight)[-UNCLIPPED_WEIGHTS], SMALLEST_POSITIVE))
        mixture = _fit_mixture(trial.z[0][:, curved], weight, divisions)
    return _sample_mixture(model, mixture, FINAL_POINTS, shift)


def weighted_interval(values: Array, weight: Array) -> Range:
    """Return the central 95 % interval of weighted values.

    Parameters
    ----------
    values : (sets,) array
        Values of one quantity.
    weight : (sets,) array
        Weights ≥ 0, whose sum is arbitrary.

    Returns
    -------
    low, high : float
        Ends of the interval, in the unit of the values.
    """
    order = np.argsort(values)
    cumulative = np.cumsum(weight[order])
    tail = (1 - CONFIDENCE) / 2
    low, high = np.searchsorted(cumulative, np.array([tail, 1 - tail]) * cumulative[-1])
    return float(values[order[low]]), float(values[order[high]])


def _sample_mixture(model: MapModel, mixture: Mixture, count: int, shift: float) -> PosteriorSample:
    """Draw points from a mixture, and weight them such that they represent the posterior.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    mixture : Mixture
        t-distributions of all parameters except b_c and b_v.
    count : int
        Number of points.
    shift : float
        Start of the quasirandom sequence in [0, 1).

    Returns
    -------
    PosteriorSample
        Weighted parameter sets.
    """
    blocks = np.split(np.arange(count), range(POINTS_PER_BLOCK, count, POINTS_PER_BLOCK))
    samples = [_draw_weighted_sets(model, mixture, block, shift) for block in blocks]
    z, log_weight, square = np.split(np.concatenate(samples, axis=1), [-2, -1], axis=2)
    return PosteriorSample(model, z, log_weight[..., 0] - math.log(count), square[..., 0])


def _quasirandom_points(index: Indices, dimensions: int, shift: float) -> Array:
    """Return evenly distributed points in the unit cube.

    They form an additive recurrence [3]: point i is the fractional part of shift + (i + 1) · step.
    The entries of the vector `step` are φ⁻¹, φ⁻², …, where φ is the root of φ^(dimensions + 1) = φ
    + 1.

    Parameters
    ----------
    index : (points,) array of int
        Indices i of the points.
    dimensions : int
        Number of dimensions of the cube.
    shift : float
        Start of the sequence in [0, 1).

    Returns
    -------
    (points, dimensions) array
        Points in [0, 1).
    """
    phi = 2.0
    for _ in range(60):  # The fixed-point iteration converges to rounding.
        phi = (1 + phi) ** (1 / (dimensions + 1))
    steps = phi ** -np.arange(1.0, dimensions + 1)
    return (shift + (index[:, None] + 1) * steps) % 1.0


def _draw_weighted_sets(model: MapModel, mixture: Mixture, index: Indices, shift: float) -> Array:
    """Draw parameter sets from a mixture, and weight them such that they represent the posterior.

    The points belong in turn to the prior and to each t-distribution of the mixture. These
    have two degrees of freedom, because their quantiles then have a closed form. The weight of a
    set is the ratio of the posterior to the density with which the set was drawn.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    mixture : Mixture
        t-distributions of all parameters except b_c and b_v.
    index : (points,) array of int
        Indices of the points in the quasirandom sequence.
    shift : float
        Start of the sequence in [0, 1).

    Returns
    -------
    (shares, points, k + 2) array
        The fields `z` (k columns), `log_weight` and `square` of a `PosteriorSample` side by side.
        The weights are not yet divided by the number of points.
    """
    from scipy.special import ndtri  # It takes long to import.

    u = _quasirandom_points(index, len(model.names), shift)
    curved = u[:, ~model.linear]
    # Quantiles of the normal distribution, and of Student's t with two degrees of freedom
    y = ndtri(curved)
    quantile = (2 * curved - 1) / np.sqrt(2 * curved * (1 - curved))
    # Points with the last remainder belong to the prior.
    component = index % (len(mixture) + 1)
    for k, (mean, root) in enumerate(mixture):
        y[component == k] = mean + quantile[component == k] @ root.T
    densities = [_log_normal(y)]
    for mean, root in mixture:
        t = (y - mean) @ np.linalg.inv(root).T
        densities.append(np.sum(_log_t(t, 2.0) - np.log(np.diag(root)), axis=1))
    log_proposal = np.logaddexp.reduce(densities, axis=0) - math.log(len(densities))
    z = np.full(u.shape, -np.inf)
    z[:, ~model.linear] = y
    with np.errstate(all="ignore"):
        residual = model.residual(z)
        shares = [_draw_bearing_friction(model, z, residual, u, *pair) for pair in model.whiteners]
    sets = np.array(shares)
    sets[..., -2] -= log_proposal
    # Sets at which the law overflows get the weight 0. Their other values must be finite.
    is_invalid = ~np.isfinite(sets[..., -2])
    sets[is_invalid] = 0.0
    sets[is_invalid, -2] = -np.inf
    return sets


def _draw_bearing_friction(
    model: MapModel, z: Array, residual: Array, u: Array, whitener: Array, log_probability: float
) -> Array:
    """Draw the bearing friction b_c and b_v of every point, given its other parameters.

    The torque is linear in x = (b_c, b_v). The whitened slopes are decomposed into Q R, so the sum
    of squared errors is a constant plus |R x − best_fit|². Backward substitution draws b_v first
    and then b_c given b_v, each from a t-distribution that is truncated to positive values.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    z : (points, k) array
        Coordinates of the parameters. Those of b_c and b_v are replaced.
    residual : (points, recordings) array
        Weighted error of the torque without bearing friction (N·m).
    u : (points, k) array
        Quantiles in [0, 1) that determine the draw.
    whitener : (recordings, recordings) array
        Matrix of `MapModel.whiteners` that makes the errors of the recordings independent.
    log_probability : float
        Logarithm of p(c) |R_c|^(−1/2), which belongs to the whitener.

    Returns
    -------
    (points, k + 2) array
        Columns: z with the drawn b_c and b_v (k columns), the logarithm of the ratio between the
        posterior and the density of the draw, and the sum of squared errors (N²·m²).
    """
    from scipy.special import stdtr, stdtrit  # It takes long to import.

    degrees = len(model.w) + SCATTER_PRIOR_WEIGHT
    linear = np.flatnonzero(model.linear)
    centre, spread = model.prior
    q, r = np.linalg.qr((_bearing_slopes(model) @ whitener).T)
    z = z.copy()
    x = np.zeros((len(z), len(linear)))
    error = residual @ whitener
    best_fit = -error @ q
    log_density = np.zeros(len(z))
    square = np.sum((error + best_fit @ q.T) ** 2, axis=1) + model.floor
    for j in reversed(range(len(linear))):
        # Given x_{j+1}, …, the positive x_j is t-distributed about its regression on them.
        i = linear[j]
        freedom = degrees - 1 - j
        scale = np.sqrt(square / freedom) / abs(r[j, j])
        middle = (best_fit[:, j] - x[:, j + 1 :] @ r[j, j + 1 :]) / r[j, j]
        positive = stdtr(freedom, middle / scale)
        t = stdtrit(freedom, np.maximum(u[:, i] * positive, SMALLEST_POSITIVE))
        x[:, j] = np.maximum(middle - scale * t, SMALLEST_POSITIVE)
        z[:, i] = (np.log(x[:, j]) - centre[i]) / spread[i]
        log_density += _log_t(t, freedom) + np.log(spread[i] * x[:, j] / (scale * positive))
        square = square * (1 + t * t / freedom)
    log_posterior = log_probability - 0.5 * degrees * np.log(square) + _log_normal(z)
    return np.column_stack([z, log_posterior - log_density, square])


def _bearing_slopes(model: MapModel) -> Array:
    """Compute the weighted derivatives of the torque with respect to b_c and b_v.

    The derivatives are the sign of the motor speed and the motor speed itself.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.

    Returns
    -------
    (linear parameters, recordings) array
        One row for each of b_c and b_v that the user did not fix.
    """
    slopes = {"b_c": np.sign(model.w), "b_v": model.w}
    rows = [slopes[name] * model.weight for name in model.names if name in slopes]
    return np.reshape(rows, (-1, len(model.w)))


def _fit_mixture(y: Array, weight: Array, divisions: int) -> Mixture:
    """Approximate weighted points by several normal distributions.

    Their number is 2^divisions.

    The points are repeatedly divided into two groups of equal weight across their longest principal
    axis, and each group gives one distribution. The mixture can therefore represent a curved ridge.

    Parameters
    ----------
    y : (points, d) array
        Coordinates of the points.
    weight : (points,) array
        Weights of the points.
    divisions : int
        Number of times that every group is divided.

    Returns
    -------
    Mixture
        Mean and Cholesky factor of the widened covariance of each distribution.
    """
    groups = [np.arange(len(y))]
    for _ in range(divisions):
        groups = [half for group in groups for half in _halve_group(group, y, weight)]
    _, total_covariance = _weighted_moments(y, weight)
    widening = COVARIANCE_WIDENING * total_covariance
    mixture = []
    for group in groups:
        mean, covariance = _weighted_moments(y[group], weight[group])
        mixture.append((mean, np.asarray(np.linalg.cholesky(covariance + widening))))
    return mixture


def _halve_group(group: Indices, y: Array, weight: Array) -> list[Indices]:
    """Divide a group of points into two groups of equal weight across its longest principal axis.

    Parameters
    ----------
    group : (members,) array of int
        Indices of the points of the group.
    y : (points, d) array
        Coordinates of all points.
    weight : (points,) array
        Weights of all points.

    Returns
    -------
    list of two arrays of int
        Indices of the points of both groups.
    """
    group = group[_principal_order(y[group], weight[group])]
    cumulative = np.cumsum(weight[group])
    return np.split(group, [np.searchsorted(cumulative, cumulative[-1] / 2, side="right")])


def _principal_order(y: Array, weight: Array) -> Indices:
    """Sort points along their longest principal axis.

    The axis is the eigenvector of the covariance of the points that has the largest eigenvalue.

    Parameters
    ----------
    y : (points, d) array
        Coordinates of the points.
    weight : (points,) array
        Weights of the points.

    Returns
    -------
    (points,) array of int
        Indices of the points in this order.
    """
    _, covariance = _weighted_moments(y, weight)
    _, axes = np.linalg.eigh(covariance)  # in the order of increasing eigenvalues
    # The sum over one column is the last axis, or 0 without coordinates.
    return np.argsort(y @ axes[:, -1:].sum(axis=1))


def _weighted_moments(values: Array, weight: Array) -> tuple[Array, Array]:
    """Compute the mean and the covariance of weighted values.

    Parameters
    ----------
    values : (sets, d) array
        Values of d quantities.
    weight : (sets,) array
        Weights ≥ 0, whose sum is arbitrary.

    Returns
    -------
    mean : (d,) array
        Weighted mean.
    covariance : (d, d) array
        Weighted covariance.
    """
    mean = weight @ values / weight.sum()
    deviation = values - mean
    return mean, (deviation.T * weight) @ deviation / weight.sum()


def _log_normal(z: Array) -> Array:
    """Compute the logarithm of the density of the standard normal distribution.

    Parameters
    ----------
    z : (sets, d) array
        Points in d dimensions.

    Returns
    -------
    (sets,) array
        Logarithms of the densities.
    """
    return -0.5 * np.sum(z * z + math.log(2 * math.pi), axis=1)


def _log_t(x: Array, degrees: float) -> Array:
    """Compute the logarithm of the density of Student's t-distribution.

    Parameters
    ----------
    x : array
        Values, of any shape.
    degrees : float
        Degrees of freedom.

    Returns
    -------
    array of the same shape
        Logarithms of the densities.
    """
    half = 0.5 * (degrees + 1)
    constant = math.lgamma(half) - math.lgamma(0.5 * degrees) - 0.5 * math.log(degrees * math.pi)
    return constant - half * np.log1p(x * x / degrees)
