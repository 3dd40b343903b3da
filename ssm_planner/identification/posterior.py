"""Compute the posterior of a drive's friction from a torque–velocity map.

The torque law τ(w; θ) depends on the motor speed w and on parameters θ_i. The mean torque of
recording k at the mean speed w_k is τ(w_k; θ) + e_k. The errors e (n,) are normally distributed
with the covariance s² R_c, where s is called the scatter. A fraction c of the scatter is an error
of the law, which recordings at similar speeds share [1]. The rest belongs to single recordings:

    R_c = (1 − c) I + c K,   K_kl = exp(−|ln w_k / w_l| / L) in one direction, 0 between both

The priors are ln θ_i ~ N(ln c_i, d_i²), wide enough for drives of this kind, and N(0, d²) for a
constant load in addition to the payload. The scatter s has a guess s₀ with the weight of ν
recordings, and c is one of `SHARED_FRACTIONS`. If s and c are integrated out, the posterior is

    p(θ | τ) ∝ p(θ) · Σ_c p(c) |R_c|^(−1/2) (ν s₀² + eᵀ R_c⁻¹ e)^(−(n + ν)/2).

Friction may change during the session, for example by warming up. Its logarithm changes by δ from
the beginning (t = 0) to the end (t = 1), in proportion to 1 − exp(−t / T), where δ has the prior
N(0, d²). If the speeds are in random order, the data determine δ. Otherwise δ widens the intervals
of the parameters with which it can be confused.

The functions use the coordinates z_i = (ln θ_i − ln c_i) / d_i, whose prior is standard normal.
Parameters only have to be positive, so intervals do not end at a bound. The module `sampling`
samples this posterior.

[1] M. C. Kennedy, A. O'Hagan, Bayesian calibration of computer models, J. R. Stat. Soc. B 63, 2001.
"""

import math
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ssm_planner.dynamics import RANDOM_SEED, mesh_coefficients
from ssm_planner.identification.parameters import (
    CHANGE,
    FRICTION_PARAMETERS,
    TYPICAL_MU,
    WARM_UP,
    drive_with_parameters,
    map_torque,
    smallest_locking_mu,
)
from ssm_planner.problem import LOAD_OFFSET, Drive, Posterior
from ssm_planner.typing import Array, Arrays, Indices, Keywords, Mask, Numbers, record

PRIOR_DEVIATIONS = {
    "b_c": 1.0,
    "b_v": 1.5,
    "mu": 0.5,
    "b_oc": 1.5,
    "b_ov": 1.5,
    "preload": 0.5,
    "mu_stribeck": 1.0,
    "stribeck_speed": 1.2,
    CHANGE: 0.12,
    WARM_UP: 1.0,
}
"""Prior standard deviations d_i of ln θ_i by name of the parameter, and of δ (`CHANGE`)."""
LOAD_PRIOR_DEVIATION = 0.3
"""Prior standard deviation of the constant load in addition to the payload.

It is a share of the larger of two efforts: that of the payload, and that which would cause the
measured friction.
"""
SCATTER_PRIOR_WEIGHT = 2.0
"""Weight ν of the guess s₀ of the scatter, as a number of recordings."""
SHARED_FRACTIONS = {0.0: 0.5, 0.5: 0.25, 0.8: 0.25}
"""Possible fractions c of the scatter that recordings share, with their prior probabilities."""
CROSS_VALIDATION_FOLDS = 6
"""Number of parts into which cross-validation divides the recordings."""
CLEAR_IMPROVEMENT = 0.5
"""Number of standard errors by which a model with more parameters must predict better."""
CORRELATION_LENGTH = 2.0
"""Difference L of ln |w| over which the correlation of the law's errors falls to 1/e."""
SMALLEST_SPEED = 0.1
"""Lower bound of motor speeds in K, rad/s. It is about 1 rpm, the resolution of recorders."""
SCATTER_DEGREES = 3.0
"""Degrees of freedom of the t-distribution from which the scatter of a new recording is drawn.

A normal distribution would be too narrow, because some recordings are outliers.
"""
_NORMAL_PRIOR_NAMES = (LOAD_OFFSET, CHANGE)
"""Parameters that have a normal prior, and may be negative."""
NEGLIGIBLE_ERROR = 1e-5
"""Share of the torque range below which errors are neglected.

It is also the weight of the almost flat prior in `data_correlation`.
"""


@record
class MapModel:
    """One friction law with the data of one torque–velocity map.

    It computes the torque, the errors and the posterior density for many parameter sets at once.
    The arrays `w`, `tau` and `weight` have the shape (points,) and SI units, with one point for
    each recording.
    """

    drive: Drive
    """Drive whose friction is fitted."""
    law: str
    """Name of the friction law."""
    names: tuple[str, ...]
    """Names of the k parameters, in the order of the coordinates z."""
    fixed: Numbers
    """Values of parameters that are not fitted, by name."""
    reference: Numbers
    """Expected values of parameters by name, which are the centres of the prior."""
    w: Array
    """Mean motor speeds, rad/s."""
    tau: Array
    """Mean motor torques, N·m."""
    weight: Array
    """Factors of the residuals: 1, or less for outliers."""
    friction: Array
    """Part of the mean torques that is due to friction, (points,) N·m."""
    elapsed: Array
    """Time of the recordings as a share of the session, (points,). NaN without a date."""
    load: float
    """Effort on the output including a fixed offset, N·m or N."""
    scatter: float
    """Guess s₀ of the scatter between recordings, N·m."""

    @cached_property
    def prior(self) -> tuple[Array, Array]:
        """Prior centres and standard deviations of the parameters, (k,) each.

        They refer to ln θ_i, except those of the load offset and of the change δ, which refer to
        the value itself. A parameter with an expected value in `reference` has its centre there.
        The other centres are rough guesses: half of the mean torque of the map is attributed to
        friction, and a share of this friction to each coefficient.
        """
        friction = 0.5 * float(np.mean(np.abs(self.tau)))
        top_speed = float(np.abs(self.w).max())
        effort = friction / float(mesh_coefficients(self.drive, TYPICAL_MU)[0])
        # One standard deviation of the prior is a factor of 1.6 to 4.5 (`PRIOR_DEVIATIONS`), so the
        # guesses only have to be of the right order.
        centre = {
            "b_c": 0.5 * friction,
            "b_v": 0.2 * friction / top_speed,
            "mu": TYPICAL_MU,
            "b_oc": 0.2 * effort,
            "b_ov": 0.2 * effort * self.drive.ratio / top_speed,
            "preload": self.drive.preload or effort,
            "mu_stribeck": 0.03,
            "stribeck_speed": 0.05 * top_speed,
            WARM_UP: 0.4,
        }
        for name, value in self.reference.items():
            if name in centre and value > 0:
                centre[name] = value
        load_deviation = LOAD_PRIOR_DEVIATION * max(abs(self.load), effort)
        deviation = PRIOR_DEVIATIONS | {LOAD_OFFSET: load_deviation}
        # The logarithm of the default 1 is 0, which is the centre of a normal prior.
        centres = [math.log(centre.get(name, 1.0)) for name in self.names]
        return np.array(centres), np.array([deviation[name] for name in self.names])

    @cached_property
    def linear(self) -> Mask:
        """Mask (k,) of the parameters b_c and b_v, in which the torque is linear."""
        return np.array([name in ("b_c", "b_v") for name in self.names], bool)

    @property
    def floor(self) -> float:
        """Contribution ν s₀² of the guessed scatter s₀ to the sum of squared errors, N²·m²."""
        return SCATTER_PRIOR_WEIGHT * self.scatter**2

    def parameters(self, z: Array) -> Arrays:
        """Convert coordinates to parameters in SI units.

        Parameters
        ----------
        z : (sets, k) array
            Coordinates. Each row is one parameter set.

        Returns
        -------
        dict of (sets, 1) arrays
            Values of each parameter by name.
        """
        centre, deviation = self.prior
        values = centre + z * deviation
        parameters = {}
        for i, name in enumerate(self.names):
            column = values[:, [i]]
            parameters[name] = column if name in _NORMAL_PRIOR_NAMES else np.exp(column)
        return parameters

    def torque(self, z: Array, w: Array | None = None) -> Array:
        """Compute the motor torque at constant speed for parameter sets.

        Parameters
        ----------
        z : (sets, k) array
            Coordinates of the parameters.
        w : (points,) array, optional
            Motor speeds (rad/s), at which friction is that in the middle of the session. The
            default is the speeds of the map, at which friction is that at the time of each
            recording.

        Returns
        -------
        (sets, points) array
            Motor torques (N·m).
        """
        values: Keywords = {**self.fixed, **self.parameters(z)}
        load = self.total_load(values.pop(LOAD_OFFSET, 0.0))
        drive = drive_with_parameters(self.drive, self.law, values)
        torque = map_torque(drive, self.w if w is None else w, load)
        if w is None:
            torque = torque - self.friction * np.expm1(-self.change(z, self.elapsed))
        return np.broadcast_to(torque, (len(z), np.shape(torque)[-1]))

    def change(self, z: Array, elapsed: Array) -> Array:
        """Compute how much ln friction differs from its value in the middle of the session.

        With the time t as a share of the session, the change δ over the whole session, and the time
        constant T, the difference is

            δ · [(1 − exp(−t/T)) − (1 − exp(−0.5/T))] / (1 − exp(−1/T)).

        Parameters
        ----------
        z : (sets, k) array
            Coordinates of the parameters.
        elapsed : (times,) array
            Times t, from 0 at the beginning of the session to 1 at its end. NaN if unknown.

        Returns
        -------
        (sets, times) array
            Differences (dimensionless). They are 0 at unknown times, and for a model without a
            change.
        """
        values = self.parameters(z)
        if CHANGE not in values:
            return np.zeros((len(z), len(elapsed)))
        rate = 1 / values[WARM_UP]
        progress = np.expm1(-elapsed * rate) - np.expm1(-0.5 * rate)
        return np.nan_to_num(values[CHANGE] * progress / np.expm1(-rate))

    def at_ends(self, z: Array) -> Array:
        """Replace friction in the middle of the session by that at its beginning or its end.

        The coordinates describe the friction in the middle of the session. Intervals of the
        resulting sets include the change of friction during the session.

        Parameters
        ----------
        z : (sets, k) array
            Coordinates of the parameters.

        Returns
        -------
        (sets, k) array
            Coordinates with the friction at the beginning (rows 0, 2, …) and at the end (rows 1, 3,
            …).
        """
        changes = self.change(z, np.array([0.0, 1.0]))
        log_factor = np.where(np.arange(len(z)) % 2, changes[:, 1], changes[:, 0])
        is_friction = np.array([name in FRICTION_PARAMETERS for name in self.names])
        return z + np.outer(log_factor, is_friction / self.prior[1])

    def total_load(self, offset: Any) -> Any:
        """Return the effort on the output of the drive with a load offset.

        Parameters
        ----------
        offset : float or array
            Constant load in addition to the payload (N·m or N). It is ignored if the user fixed the
            offset, because `load` then already includes it.

        Returns
        -------
        float or array with the shape of offset
            Effort (N·m or N).
        """
        return self.load if LOAD_OFFSET in self.fixed else self.load + offset

    def residual(self, z: Array) -> Array:
        """Compute the weighted torque errors of parameter sets.

        Parameters
        ----------
        z : (sets, k) array
            Coordinates of the parameters.

        Returns
        -------
        (sets, points) array
            Torque of the model minus measured torque, multiplied by the weight of each point (N·m).
        """
        return (self.torque(z) - self.tau) * self.weight

    @cached_property
    def whiteners(self) -> list[tuple[Array, float]]:
        """Whitening matrix and log-probability for each fraction c of `SHARED_FRACTIONS`.

        The matrix W (points, points) satisfies W Wᵀ = R_c⁻¹, so the products Wᵀ e are uncorrelated
        for errors e with the correlation R_c, and |Wᵀ e|² is eᵀ R_c⁻¹ e. The log-probability is the
        logarithm of p(c) |R_c|^(−1/2), where p(c) is the prior probability of the fraction.
        """
        correlations = error_correlation(self.w, self.w)
        identity = np.eye(len(self.w))
        whiteners = []
        for fraction, probability in SHARED_FRACTIONS.items():
            # R_c = L Lᵀ, so the matrix is L⁻ᵀ, and |R_c|^(1/2) is the product of the diagonal of L.
            root = np.linalg.cholesky((1 - fraction) * identity + fraction * correlations)
            log_probability = math.log(probability) - float(np.log(np.diag(root)).sum())
            whiteners.append((np.linalg.inv(root).T, log_probability))
        return whiteners

    def log_posterior(self, z: Array) -> Array:
        """Compute the logarithm of the posterior density, up to a constant.

        The density p(θ | τ) is that in the docstring of this module, in which the scatter s and its
        shared fraction c are integrated out. The coordinates z have a standard normal prior.

        Parameters
        ----------
        z : (sets, k) array
            Coordinates of the parameters.

        Returns
        -------
        (sets,) array
            Logarithms. They are −inf for a set at which the friction law overflows.
        """
        with np.errstate(all="ignore"):
            error = self.residual(z)
            exponent = 0.5 * (len(self.w) + SCATTER_PRIOR_WEIGHT)
            terms = []
            for whitener, log_probability in self.whiteners:
                square = np.sum((error @ whitener) ** 2, axis=1) + self.floor
                terms.append(log_probability - exponent * np.log(square))
            value = np.logaddexp.reduce(terms, axis=0) - 0.5 * np.sum(z * z, axis=1)
        return np.where(np.isfinite(value), value, -np.inf)

    def without(self, points: Indices) -> "MapModel":
        """Return the model without some points of the map, for cross-validation.

        The prior remains that of all points, although its centres may depend on the points.

        Parameters
        ----------
        points : (removed,) array of int
            Indices of the points that are left out.

        Returns
        -------
        MapModel
            Model with the other points.
        """
        remaining = np.setdiff1d(np.arange(len(self.w)), points)
        arrays = ("w", "tau", "weight", "friction", "elapsed")
        model = replace(self, **{name: getattr(self, name)[remaining] for name in arrays})
        model.__dict__["prior"] = self.prior
        return model


def most_likely(
    model: MapModel, start: Array | None = None, pinned: tuple[int, float] | None = None
) -> Array:
    """Find the coordinates at which the posterior density is largest.

    The search alternates between a least-squares fit with a fixed scatter s and an update of s. If
    the friction coefficient of a self-locking drive becomes too small for self-locking, the other
    parameters are fitted again with the smallest permitted coefficient.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    start : (k,) array, optional
        Coordinates at which the search starts. By default, it starts at the prior centre and at
        three random points, and the best result is returned.
    pinned : (int, float), optional
        Index and value of a coordinate that does not change.

    Returns
    -------
    (k,) array
        Most likely coordinates.
    """
    k = len(model.names)
    rng = np.random.default_rng(RANDOM_SEED)
    # Random starts are within about one standard deviation of the prior. The first guess of the
    # scatter is 2 % of the torque range, and a few alternations are enough.
    starts = np.concatenate([np.zeros((1, k)), 0.7 * rng.standard_normal((3, k))])
    alternations = 3
    if start is not None:
        starts = np.array([start], float)
        alternations = 2
    free = np.ones(k, dtype=bool)
    if pinned is not None:
        free[pinned[0]] = False
        starts[:, pinned[0]] = pinned[1]
    optima = []
    for z in starts:
        scatter = 0.02 * float(np.ptp(model.tau))
        if start is not None:
            scatter = _most_likely_scatter(model, z)
        for _ in range(alternations):
            if free.any():
                z = _least_squares(model, z, free, scatter)
            scatter = _most_likely_scatter(model, z)
        optima.append(z)
    densities = [float(model.log_posterior(z[None])[0]) for z in optima]
    optimum = optima[int(np.argmax(densities))]
    smallest = smallest_locking_mu(model.drive)
    if pinned is None and "mu" in model.names and model.parameters(optimum[None])["mu"] < smallest:
        i = model.names.index("mu")
        centre, spread = model.prior
        bound = (math.log(smallest) - float(centre[i])) / float(spread[i])
        return most_likely(model, optimum, (i, bound))
    return optimum


def _most_likely_scatter(model: MapModel, z: Array) -> float:
    """Compute the most likely scatter of the mean torque between recordings.

    It is s = √((|e|² + ν s₀²) / (n + ν)), with the errors e of n recordings and the guess s₀ with
    the weight of ν recordings. The correlation of the errors is neglected.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    z : (k,) array
        Coordinates of the parameters.

    Returns
    -------
    float
        Scatter s (N·m), at least 1e-9 of the range of the torque.
    """
    square = float(np.sum(model.residual(z[None]) ** 2)) + model.floor
    scatter = math.sqrt(square / (len(model.w) + SCATTER_PRIOR_WEIGHT))
    return max(scatter, 1e-9 * float(np.ptp(model.tau)))


def _least_squares(model: MapModel, z: Array, free: Array, scatter: float) -> Array:
    """Find the coordinates with the largest posterior density for a given scatter.

    The sum |e(z) / s|² + |z|² of the squared residuals and of the squared free coordinates is
    minimised by the method of Levenberg and Marquardt. The second term is the standard normal
    prior. The correlation of the errors e is neglected.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    z : (k,) array
        Coordinates at which the search starts.
    free : (k,) array of bool
        Mask of the coordinates that may change.
    scatter : float
        Scatter s, by which the torque errors are divided (N·m).

    Returns
    -------
    (k,) array
        Coordinates at the minimum.
    """
    from scipy.optimize import least_squares  # SciPy's optimisers take long to import.

    step = 1e-6  # of the difference quotients, small beside the prior deviation of 1

    def completed(values: Array) -> Array:
        """Return all coordinates (k,) with the given values of the free ones."""
        coordinates = z.copy()
        coordinates[free] = values
        return coordinates

    def misfit(values: Array) -> Array:
        """Return the residuals of the points, followed by those of the prior."""
        return np.concatenate([model.residual(completed(values)[None])[0] / scatter, values])

    def jacobian(values: Array) -> Array:
        """Return the derivatives (residuals, free) of the misfit with respect to the values."""
        steps = step * np.eye(len(z))[free]
        sets = np.concatenate([completed(values)[None], completed(values) + steps])
        residuals = model.residual(sets) / scatter
        slopes = (residuals[1:] - residuals[0]) / step
        return np.concatenate([slopes.T, np.eye(len(values))])

    solution = least_squares(
        misfit, z[free], jac=jacobian, method="lm", xtol=1e-9, ftol=1e-9, max_nfev=60
    )
    return completed(solution.x)


def cross_validation_errors(model: MapModel, z: Array) -> Array:
    """Compute the errors of a model on recordings that its fit has not used.

    The recordings are divided into `CROSS_VALIDATION_FOLDS` parts (folds), each of which covers
    the whole range of speeds. A fit to the other folds predicts the recordings of each fold.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    z : (k,) array
        Coordinates at which the fits start.

    Returns
    -------
    (points,) array
        Weighted errors of the predicted torque (N·m).
    """
    rng = np.random.default_rng(RANDOM_SEED)
    count = len(model.w)
    folds = min(CROSS_VALIDATION_FOLDS, count)
    fold = np.empty(count, int)
    # Each block of neighbouring speeds gives at most one recording to each fold.
    for block in np.array_split(np.argsort(model.w), math.ceil(count / folds)):
        fold[block] = rng.permutation(folds)[: len(block)]
    errors = np.zeros(count)
    for k in range(folds):
        test = np.flatnonzero(fold == k)
        if len(test):
            optimum = most_likely(model.without(test), z)
            errors[test] = model.residual(optimum[None])[0, test]
    return errors


def simplest_model(models: list[MapModel], errors: list[Array]) -> int:
    """Select the model with the fewest parameters that predicts about as well as the best one.

    A model predicts about as well if the mean of its squared errors exceeds that of the best model
    by at most `CLEAR_IMPROVEMENT` standard errors of this difference.

    Parameters
    ----------
    models : list of MapModel
        Models of the same data.
    errors : list of (points,) arrays
        Errors of each model in the cross-validation (N·m).

    Returns
    -------
    int
        Index of the selected model.
    """
    best_model = int(np.argmin([np.mean(error**2) for error in errors]))
    parameter_counts = [len(model.names) for model in models]
    for i in np.argsort(parameter_counts, kind="stable").tolist():
        excess = errors[i] ** 2 - errors[best_model] ** 2
        allowed = CLEAR_IMPROVEMENT * np.std(excess) / math.sqrt(len(excess))
        if np.mean(excess) <= allowed + (NEGLIGIBLE_ERROR * np.ptp(models[i].tau)) ** 2:
            return i
    return best_model


def _fisher_information(model: MapModel, z: Array) -> Array:
    """Compute the Fisher information of the data, without that of the prior.

    It is J Jᵀ / s², with the derivatives J of the torque errors with respect to the coordinates and
    the most likely scatter s. The correlation of the errors is neglected.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    z : (k,) array
        Coordinates at which the derivatives are computed.

    Returns
    -------
    (k, k) array
        Information (dimensionless).
    """
    # The derivatives are forward differences with a step of 1e-5 prior standard deviations.
    sets = np.concatenate([z[None], z + 1e-5 * np.eye(len(z))])
    values = model.residual(sets) / _most_likely_scatter(model, z)
    jacobian = (values[1:] - values[0]) / 1e-5
    return jacobian @ jacobian.T


def approximate_covariance(model: MapModel, z: Array) -> Array:
    """Compute the covariance of a normal approximation of the posterior.

    It is the inverse of the sum of the Fisher information and the identity matrix. The latter is
    the information of the standard normal prior.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    z : (k,) array
        Coordinates at which the law is linearised, usually the most likely ones.

    Returns
    -------
    (k, k) array
        Covariance of the coordinates.
    """
    return np.asarray(np.linalg.inv(_fisher_information(model, z) + np.eye(len(z))))


def data_correlation(model: MapModel, z: Array) -> Array:
    """Compute the correlation of the parameters that the data alone imply.

    It is computed with an almost flat prior, which only keeps the matrix invertible.

    Parameters
    ----------
    model : MapModel
        Friction law with the data.
    z : (k,) array
        Coordinates at which the law is linearised.

    Returns
    -------
    (k, k) array
        Correlations of the coordinates. An entry near ±1 means that the data determine two
        parameters only together.
    """
    covariance = np.linalg.inv(_fisher_information(model, z) + NEGLIGIBLE_ERROR * np.eye(len(z)))
    deviation = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviation, deviation)


def _log_speed(w: Array) -> Array:
    """Compute the logarithm of the magnitudes of motor speeds.

    Parameters
    ----------
    w : (n,) array
        Motor speeds (rad/s). Magnitudes below `SMALLEST_SPEED` are replaced by it.

    Returns
    -------
    (n,) array
        Natural logarithms.
    """
    return np.log(np.maximum(np.abs(w), SMALLEST_SPEED))


def _log_distance(v: Array, w: Array) -> Array:
    """Compute the logarithmic distance |ln v − ln w| between the magnitudes of motor speeds.

    Magnitudes below `SMALLEST_SPEED` are replaced by it.

    Parameters
    ----------
    v : (samples,) array
        Motor speeds (rad/s).
    w : (recordings,) array
        Motor speeds of recordings (rad/s).

    Returns
    -------
    (samples, recordings) array
        Distances (dimensionless). They are infinite between speeds of different directions.
    """
    distance = np.abs(_log_speed(v)[:, None] - _log_speed(w))
    return np.where(np.sign(v)[:, None] == np.sign(w), distance, np.inf)


def error_correlation(v: Array, w: Array) -> Array:
    """Compute the correlations between errors of the friction law at motor speeds.

    The correlation of speeds v and w in one direction is exp(−|ln v / w| / L), with the correlation
    length L = `CORRELATION_LENGTH`. It is 0 between directions.

    Parameters
    ----------
    v : (samples,) array
        Motor speeds (rad/s).
    w : (recordings,) array
        Motor speeds of recordings (rad/s).

    Returns
    -------
    (samples, recordings) array
        Correlations (dimensionless), called K in the docstring of this module.
    """
    return np.exp(-_log_distance(v, w) / CORRELATION_LENGTH)


def predict_law_error(posterior: Posterior, w: Array) -> tuple[Array, Array]:
    """Interpolate the error of the friction law between the speeds of the recordings.

    The interpolation is a regression with the correlations K of `error_correlation` (kriging). With
    the shared fraction c, the factors are A = c K(w, w_k) R_c⁻¹, where w_k are the speeds of the
    recordings. The factor √(1 − Σ A c K(w, w_k)) describes the scatter that remains. It is
    multiplied by 1 + d with the logarithmic distance d to the nearest recorded speed, because no
    recording tests the law there. In a direction without recordings, d is 1.

    Parameters
    ----------
    posterior : Posterior
        Posterior with the speeds of the recordings.
    w : (samples,) array
        Motor speeds at which the error is predicted (rad/s).

    Returns
    -------
    factors : (samples, recordings) array
        Factors A. The predicted error is their product with the errors at the recordings.
    remaining : (samples,) array
        Factors by which the scatter s is multiplied to obtain the standard deviation of the error.
    """
    speeds = np.array(posterior.speeds)
    common = posterior.common
    if not len(speeds):
        return np.zeros((len(w), 0)), np.ones(len(w))
    shared_covariance = common * error_correlation(w, speeds)
    covariance = common * error_correlation(speeds, speeds) + (1 - common) * np.eye(len(speeds))
    factors = np.linalg.solve(covariance, shared_covariance.T).T
    remaining_share = np.sqrt(np.maximum(1.0 - np.sum(factors * shared_covariance, axis=1), 0.0))
    # A direction without recordings counts as a distance of 1.
    distance_to_recorded = np.nan_to_num(_log_distance(w, speeds).min(axis=1), posinf=1.0)
    return np.asarray(factors), remaining_share * (1.0 + distance_to_recorded)


def extrapolation_distance(posterior: Posterior, w: Array) -> Array:
    """Compute how far motor speeds are outside the range of the recordings.

    The distance is |ln(w / w_k)| to the nearest recorded speed w_k in the same direction, and 0
    within the range of the recorded speeds.

    Parameters
    ----------
    posterior : Posterior
        Posterior with the speeds of the recordings.
    w : (samples,) array
        Motor speeds (rad/s).

    Returns
    -------
    (samples,) array
        Distances (dimensionless). They are 1 in a direction without recordings.
    """
    speeds = np.array(posterior.speeds)
    same_direction = np.sign(w)[:, None] == np.sign(speeds)
    logs = _log_speed(w)
    recorded = np.log(np.abs(speeds))
    distance_below = np.where(same_direction, recorded, np.inf).min(axis=1) - logs
    distance_above = logs - np.where(same_direction, recorded, -np.inf).max(axis=1)
    distance = np.maximum(np.maximum(distance_below, distance_above), 0.0)
    # A direction without recordings counts as a distance of 1.
    return np.nan_to_num(distance, posinf=1.0)


def prior_pull(covariance: Array) -> Array:
    """Compute how strongly the prior influences the result for each parameter.

    If the prior means of the coordinates z moved by a vector of length 1, that is, by one standard
    deviation of the prior, the posterior mean of z_i in a linear model would move by at most the
    norm of row i of the posterior covariance. The pull is this norm, divided by the posterior
    standard deviation of z_i. It is small for a parameter that the data alone determine.

    Parameters
    ----------
    covariance : (k, k) array
        Posterior covariance of the coordinates z.

    Returns
    -------
    (k,) array
        Pulls (dimensionless), in posterior standard deviations.
    """
    return np.linalg.norm(covariance, axis=1) / np.sqrt(np.diag(covariance))
