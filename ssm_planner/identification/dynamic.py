"""Fit breakaway, growth of friction at rest and frictional memory to start–stop recordings.

These effects do not appear at constant speed, so a torque–velocity map cannot show them.
`fit_dynamic` is the main function, and `identify` calls it after the fit of the map.

The parameter vector θ (3,) contains the excess of the static over the sliding friction coefficient
(dimensionless), the time constant of the growth at rest in s, and the delay of friction behind the
speed in s. They become the friction parameters mu_static − mu, dwell_constant and memory.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import required_friction
from ssm_planner.identification.fit import Estimate
from ssm_planner.identification.prediction import (
    RecordedMotion,
    controller_reaction,
    law_correction,
    predict_torque,
)
from ssm_planner.identification.reaction import speed_deviation
from ssm_planner.identification.recordings import Recording, rms
from ssm_planner.problem import CONFIDENCE, Drive
from ssm_planner.typing import Array, record

PARAMETERS = ("mu_static", "dwell_constant", "memory")
"""Names of the fitted parameters in drive files, in the order of θ."""

UPPER_BOUNDS = np.array([0.3, 20.0, 0.5])
"""Upper bounds of θ: excess of the friction coefficient, and two times in s."""

_GRID_VALUES = (
    (0.0, 0.01, 0.02, 0.04, 0.07, 0.1, 0.15),
    (0.0, 0.1, 0.3, 1.0, 3.0),
    (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4),
)
"""Values of each parameter θ_i that are tried before the search."""
_PARAMETER_SUBSETS: tuple[tuple[int, ...], ...] = ((), (0,), (2,), (0, 2), (0, 1), (0, 1, 2))
"""Indices of the parameters that are fitted together. Growth at rest needs static friction."""


@record
class DynamicFit:
    """Result of `fit_dynamic`: the drive with the parameters of start–stop motion.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.identify("drive.yaml", ["start_stop.csv"])  # doctest: +SKIP
    >>> result.dynamic.estimates["dwell_constant"].value  # doctest: +SKIP
    """

    drive: Drive
    """Drive with the fitted parameters."""
    estimates: dict[str, Estimate]
    """Estimates by name.

    Parameters that the recordings do not determine keep the values that they had before the fit.
    """
    before: tuple[float, ...]
    """Relative error (`nrmsd`) of each recording with the friction of the torque–velocity map."""
    after: tuple[float, ...]
    """Relative error (`nrmsd`) of each recording with the fitted friction."""
    notes: tuple[str, ...] = ()
    """Remarks on the fit, as sentences."""


class _LeastSquaresProblem:
    """Least-squares problem of the start–stop recordings.

    The residuals of a recording are the errors of its predicted torque, divided by the range of its
    measured torque. The cost is the sum of the squared residuals of all recordings. The correction
    of the friction law and the reaction of the speed controller do not depend on θ, so they are
    subtracted from the measured torque once.

    Parameters
    ----------
    drive : Drive
        Drive with the friction of the torque–velocity map.
    recordings : sequence of Recording
        Start–stop recordings.
    load : float
        Constant effort on the output (N·m or N).
    load_inertia : float
        Inertia of the payload at the output (kg·m² or kg).
    """

    def __init__(
        self, drive: Drive, recordings: Sequence[Recording], load: float, load_inertia: float
    ) -> None:
        self.drive = drive
        self.recordings = recordings
        self.load = load
        self.load_inertia = load_inertia
        self.motions = [RecordedMotion.from_speed(item.time, item.w) for item in recordings]
        self.measured: list[Array] = []
        """Torque (samples,) of each recording that the friction law must explain, N·m."""
        for recording, motion in zip(recordings, self.motions, strict=True):
            deviation = speed_deviation(recording.w, motion.direction)
            reaction = controller_reaction(drive, motion, deviation)
            correction = law_correction(drive, motion, load)
            self.measured.append(recording.tau - correction - reaction)
        base = required_friction(drive)
        self.default = np.array([base.mu_static - base.mu, base.dwell_constant or 0.0, base.memory])

    def model(self, theta: Array) -> Drive:
        """Build the drive with given parameters of start–stop motion.

        Parameters
        ----------
        theta : (3,) array
            mu_static − mu (dimensionless), dwell_constant in s and memory in s. A dwell constant of
            0 means that friction does not grow at rest.

        Returns
        -------
        Drive
            Drive whose other parameters are unchanged.
        """
        base = required_friction(self.drive)
        rise, dwell, memory = theta.tolist()
        friction = replace(
            base, mu_static=base.mu + rise, dwell_constant=dwell or None, memory=memory
        )
        return replace(self.drive, friction=friction)

    def residuals(self, theta: Array) -> list[Array]:
        """Compute the errors of the predicted torque of each recording.

        Parameters
        ----------
        theta : (3,) array
            Parameters θ.

        Returns
        -------
        list of (samples,) arrays
            Predicted minus measured torque, divided by the range of the measured torque.
        """
        drive = self.model(theta)
        residuals = []
        for recording, motion, measured in zip(
            self.recordings, self.motions, self.measured, strict=True
        ):
            predicted = predict_torque(drive, motion, self.load, self.load_inertia)
            residuals.append((predicted - measured) / np.ptp(recording.tau))
        return residuals

    def residual(self, theta: Array) -> Array:
        """Compute the residuals of all recordings in one array.

        Parameters
        ----------
        theta : (3,) array
            Parameters θ.

        Returns
        -------
        (all samples,) array
            Residuals of one recording after the other.
        """
        return np.concatenate(self.residuals(theta))

    def cost(self, theta: Array) -> float:
        """Compute the sum of the squared residuals.

        Parameters
        ----------
        theta : (3,) array
            Parameters θ.

        Returns
        -------
        float
            Cost (dimensionless).
        """
        return float(np.sum(self.residual(theta) ** 2))

    def nrmsd(self, theta: Array) -> tuple[float, ...]:
        """Compute the relative error of each recording, that is, the RMS of its residuals.

        Parameters
        ----------
        theta : (3,) array
            Parameters θ.

        Returns
        -------
        tuple of float
            One error (dimensionless) for each recording.
        """
        return tuple(map(rms, self.residuals(theta)))


def fit_dynamic(
    drive: Drive, recordings: Sequence[Recording], load: float, load_inertia: float = 0.0
) -> DynamicFit:
    """Fit up to three parameters of friction to start–stop recordings.

    The parameters are the static friction, its growth while the joint rests, and the frictional
    memory, which is the delay of friction behind the velocity. The Akaike criterion selects which
    of them are fitted. The parameters of the torque–velocity map do not change.

    Parameters
    ----------
    drive : Drive
        Drive with the friction of the map.
    recordings : sequence of Recording
        Start–stop recordings.
    load : float
        Constant effort on the output (N·m or N).
    load_inertia : float
        Inertia of the payload at the output (kg·m² or kg).

    Returns
    -------
    DynamicFit
        Drive with the fitted parameters, their estimates and the errors before and after the fit.

    Notes
    -----
    The selected parameters have the smallest N ln(cost) + 2 k, where the cost is the sum of squared
    residuals, and k is the number of fitted parameters. The criterion is evaluated at the best
    points of a grid. N is the number of independent samples. It is smaller than the number of
    samples, because the residuals of neighbouring samples are correlated. The 95 % intervals are
    asymptotic, that is, they follow from a linearised model.
    """
    problem = _LeastSquaresProblem(drive, recordings, load, load_inertia)
    starts = {subset: _best_grid_point(problem, subset) for subset in _PARAMETER_SUBSETS}
    # The residuals of the model with all three parameters are closest to pure noise.
    independent = _independent_samples(problem.residual(starts[(0, 1, 2)]))
    criterion = {}
    for subset, theta in starts.items():
        criterion[subset] = independent * math.log(problem.cost(theta)) + 2 * len(subset)
    subset = min(criterion, key=criterion.__getitem__)
    theta, jacobian = _minimise_cost(problem, starts[subset], list(subset))
    undetermined = [PARAMETERS[k] for k in range(3) if k not in subset]
    gain = criterion[()] - criterion[subset]
    notes = []
    if subset:
        fitted = " and ".join(PARAMETERS[k] for k in subset)
        notes.append(f"start–stop recordings: {fitted} identified (Akaike gain {gain:.1f})")
    if undetermined:
        notes.append(
            f"start–stop recordings do not determine {' and '.join(undetermined)}: kept as in the "
            "map"
        )
    return DynamicFit(
        drive=problem.model(theta),
        estimates=_estimates(problem, theta, list(subset), jacobian, independent),
        before=problem.nrmsd(problem.default),
        after=problem.nrmsd(theta),
        notes=tuple(notes),
    )


def _best_grid_point(problem: _LeastSquaresProblem, subset: tuple[int, ...]) -> Array:
    """Find the point with the smallest cost among a grid and the parameters of the drive.

    The search of `_minimise_cost` starts at this point.

    Parameters
    ----------
    problem : _LeastSquaresProblem
        Least-squares problem.
    subset : tuple of int
        Indices in θ of the parameters that vary. The others keep the values of the drive.

    Returns
    -------
    (3,) array
        Parameters θ of the best point.
    """
    axes: list[Sequence[float]] = list(_GRID_VALUES)
    for k in range(3):
        if k not in subset:
            axes[k] = (problem.default[k],)
    grid = list(map(np.array, itertools.product(*axes)))
    return min([problem.default] + grid, key=problem.cost)


def _minimise_cost(
    problem: _LeastSquaresProblem, theta: Array, free: list[int]
) -> tuple[Array, Array]:
    """Minimise the cost over some of the parameters by a bounded least-squares search.

    Parameters
    ----------
    problem : _LeastSquaresProblem
        Least-squares problem.
    theta : (3,) array
        Parameters θ at which the search starts.
    free : list of int
        Indices in θ of the parameters that vary.

    Returns
    -------
    theta : (3,) array
        Parameters with the smallest cost. They are those of the start if the search does not
        improve them.
    jacobian : (all samples, free) array
        Derivatives of the residuals with respect to the free parameters, at the end of the search.
    """
    from scipy.optimize import least_squares  # SciPy's optimisers take long to import.

    if not free:
        return theta, np.zeros((len(problem.residual(theta)), 0))

    def completed(free_values: Array) -> Array:
        """Return all parameters (3,) with the given values of the free ones."""
        values = theta.copy()
        values[free] = free_values
        return values

    def misfit(free_values: Array) -> Array:
        """Return the residuals (all samples,) for the given values of the free parameters."""
        return problem.residual(completed(free_values))

    solution = least_squares(
        misfit,
        np.clip(theta[free], 1e-6, UPPER_BOUNDS[free] - 1e-6),
        bounds=(0.0, UPPER_BOUNDS[free]),
        x_scale=(0.1 * UPPER_BOUNDS)[free],
        diff_step=np.full(len(free), 1e-3),
    )
    return min((theta, completed(solution.x)), key=problem.cost), np.asarray(solution.jac)


def _independent_samples(residual: Array) -> float:
    """Compute the number of independent samples to which correlated residuals correspond.

    It is N (1 − ρ) / (1 + ρ), with the number N of samples and the correlation ρ between
    neighbours, which is limited to 0 … 0.99. This is the formula for an autoregressive process of
    first order.

    Parameters
    ----------
    residual : (samples,) array
        Residuals in the order of time.

    Returns
    -------
    float
        Number of independent samples.
    """
    centred = residual - residual.mean()
    rho = float(np.sum(centred[1:] * centred[:-1]) / max(float(np.sum(centred**2)), 1e-300))
    rho = min(max(rho, 0.0), 0.99)
    return len(residual) * (1.0 - rho) / (1.0 + rho)


def _estimates(
    problem: _LeastSquaresProblem,
    theta: Array,
    free: list[int],
    jacobian: Array,
    independent: float,
) -> dict[str, Estimate]:
    """Return the estimates of the three parameters, with asymptotic 95 % intervals.

    The covariance of the parameters is the inverse of their Fisher information, which is reduced by
    the ratio of independent to all samples.

    Parameters
    ----------
    problem : _LeastSquaresProblem
        Least-squares problem.
    theta : (3,) array
        Fitted parameters θ.
    free : list of int
        Indices in θ of the fitted parameters. The others have an interval of length 0.
    jacobian : (all samples, free) array
        Derivatives of the residuals with respect to the fitted parameters.
    independent : float
        Number of independent samples.

    Returns
    -------
    dict
        Estimates by name of the parameter in the drive file (`mu_static`, `dwell_constant`,
        `memory`).
    """
    from scipy.special import ndtri  # It takes long to import.

    half = np.zeros(3)
    if free:
        value = problem.residual(theta)
        variance = float(value @ value) / max(independent - len(free), 1.0)
        information = jacobian.T @ jacobian / variance * (independent / len(value))
        # The small diagonal keeps the matrix regular if the residuals ignore a parameter.
        covariance = np.linalg.pinv(information + np.diag(1e-9 / UPPER_BOUNDS[free] ** 2))
        quantile = float(ndtri(0.5 + CONFIDENCE / 2))
        half[free] = quantile * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    offset = np.array([required_friction(problem.drive).mu, 0.0, 0.0])
    largest = np.maximum(UPPER_BOUNDS, theta)
    low = np.clip(theta - half, 0.0, largest) + offset
    high = np.clip(theta + half, 0.0, largest) + offset
    to_bound = np.minimum(theta, UPPER_BOUNDS - theta)
    return {
        name: Estimate(
            value=float(theta[k] + offset[k]),
            low=float(low[k]),
            high=float(high[k]),
            fixed=k not in free,
            separable=bool(half[k] < 0.5 * UPPER_BOUNDS[k]),
            at_bound=bool(k in free and to_bound[k] < 1e-5 * UPPER_BOUNDS[k]),
        )
        for k, name in enumerate(PARAMETERS)
    }
