"""Fit a friction law to a torque–velocity map.

The map contains one point, mean speed and mean torque, for each recording at constant speed.
`fit_map` is the main function. It reduces the weight of outliers, fits every friction law, and
selects one of them by cross-validation: each fit is judged by its errors on recordings that the fit
has not used. Cross-validation also decides whether a constant load is added to the payload. The
parameters have 95 % intervals of the posterior, which the modules `posterior` and `sampling`
compute.

Some words have a fixed meaning in this module. A model (`MapModel`) is one friction law with the
data and with the names of the parameters that are fitted. Its coordinates z (k,) are the scaled
logarithms of the k parameters, as the module `posterior` defines them. A parameter set contains one
value for each parameter of a law.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import (
    RANDOM_SEED,
    friction_coefficient,
    nut_contact_force,
    output_effort,
    required_friction,
)
from ssm_planner.errors import RecordingError
from ssm_planner.identification.parameters import (
    CHANGE,
    MAP_PARAMETERS,
    SESSION_CHANGE_PARAMETERS,
    drive_with_parameters,
    map_torque,
    parameter_names,
    smallest_locking_mu,
)
from ssm_planner.identification.posterior import (
    MapModel,
    cross_validation_errors,
    data_correlation,
    most_likely,
    prior_pull,
    simplest_model,
)
from ssm_planner.identification.recordings import largest_magnitude, rms
from ssm_planner.identification.sampling import (
    LARGEST_WEIGHT,
    PosteriorSample,
    sample_posterior,
    weighted_interval,
)
from ssm_planner.identification.session import session_progress
from ssm_planner.identification.torque_map import TorqueMap, find_outliers
from ssm_planner.problem import CONFIDENCE, FRICTION_LAWS, LAW_COLUMN, LOAD_OFFSET, Drive, Posterior
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.typing import Array, Arrays, Numbers, frozen, record

POSTERIOR_DRAWS = 1000
"""Number of equally likely parameter sets in a posterior."""
LARGEST_PRIOR_PULL = 0.2
"""Largest prior pull of a parameter that counts as determined by the data, see `prior_pull`."""
SMALLEST_LAW_PROBABILITY = 0.01
"""Smallest probability with which a law is part of the posterior."""
LARGEST_TORQUE_RATIO = 1.5
"""Ratio of measured to expected torque above which another drive is suspected."""
LARGEST_RELATIVE_ERROR = 0.2
"""RMS error, divided by the mean |torque|, above which another drive is suspected."""
WEIGHT_COLUMN = "weight"
"""Name of the column of weights in a table of parameter sets."""
_DIRECTIONS = ("forwards", "backwards")
_STRIBECK = ("mu_stribeck", "stribeck_speed")
_INITIAL_SCATTER = 0.1
"""Guess of the scatter of the mean torque between recordings, before the fit.

It is a share of the standard deviation of the torque in one recording.
"""


FittedModels = list[tuple[MapModel, Array]]
"""Models, each with the most likely coordinates z (k,) of its k parameters."""
PossibleLaws = list[tuple[PosteriorSample, float]]
"""Posterior sample and probability of each friction law."""


@frozen
class Estimate:
    """Value of a parameter with its 95 % interval.

    If the user fixed the parameter, both ends of the interval equal the value.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Estimate(value=0.13, low=0.11, high=0.15).separable
    True
    """

    value: float
    """Most likely value, in SI units."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""
    fixed: bool = False
    """True if the user fixed the parameter."""
    separable: bool = True
    """False if the data do not determine the parameter, so that its interval depends on the prior.
    """
    at_bound: bool = False
    """True if the value is the smallest with which the drive is self-locking."""


@record
class MapFit:
    """Result of `fit_map`: the chosen friction law and its parameters.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> fit = ssm.identify("rig3_worm").fit  # doctest: +SKIP
    >>> fit.law, fit.nrmsd  # doctest: +SKIP
    """

    law: str
    """Name of the friction law with the smallest error, one of `FRICTION_LAWS`."""
    drive: Drive
    """Drive with the identified friction, its posterior, and the load offset of its rig."""
    load: float
    """Constant effort on the output including the load offset, N·m or N."""
    estimates: dict[str, Estimate]
    """Estimate of each parameter, by name."""
    correlation_names: tuple[str, ...]
    """Names of the parameters in the rows and columns of `correlation`."""
    correlation: Array
    """Correlation (parameters, parameters) of the logarithms of the parameters.

    It follows from the data without the prior.
    """
    inseparable: tuple[tuple[str, ...], ...]
    """Groups of parameters that the data determine only together."""
    combinations: dict[str, Estimate]
    """Motor torque of slow motion by direction, N·m.

    The data determine this combination of the parameters well.
    """
    predicted: Array
    """Torque of each point of the map, (points,), N·m."""
    nrmsd: float
    """RMS error over all points including outliers, divided by the range of the torque."""
    outliers: tuple[tuple[str, float, float], ...]
    """Name of the recording, distance from its neighbours (N·m) and weight in the fit of each
    outlier.
    """
    criterion: dict[str, float]
    """RMS error of each plausible law on recordings that the fit has not used, N·m."""
    law_shares: dict[str, float]
    """Probability of each law: the share of the posterior's parameter sets that have this law."""
    notes: tuple[str, ...] = ()
    """Remarks on implausible results, as sentences."""


def fit_map(
    drive: Drive,
    data: TorqueMap,
    load: float,
    *,
    law: str = "auto",
    fixed: Numbers | None = None,
    reference: Numbers | None = None,
    free: Sequence[str] = (),
    progress: Progress = silent,
) -> MapFit:
    """Fit the parameters of a friction law to a torque–velocity map.

    Parameters
    ----------
    drive : Drive
        Drive whose friction is fitted.
    data : TorqueMap
        Points of the map.
    load : float
        Constant effort that the drive exerts on the payload, N·m or N. It is negative if the
        payload drives forwards. A constant offset is fitted in addition if this reduces the error
        on recordings that the fit has not used.
    law : str
        One of `FRICTION_LAWS`, or `auto` for the simplest law whose error on recordings
        that the fit has not used is close to the smallest.
    fixed : Mapping, optional
        Parameters that are not fitted, with their values by name, in SI units.
    reference : Mapping, optional
        Expected values by name, in SI units. They become the centres of the prior.
    free : sequence of str
        Parameters that are fitted in addition to those of the law: "b_ov" (viscous friction of the
        output), "preload" (of a nut), or both.
    progress : callable
        Function that is called with a `Step` before each law is fitted.

    Returns
    -------
    MapFit
        Identified drive, estimates, errors and remarks.

    Raises
    ------
    RecordingError
        If all recordings move in one direction, or if there are too few points for the parameters.
    """
    # The viscous friction of the output is 0 unless the user fits or fixes it.
    constants = {"b_ov": 0.0} | dict(fixed or {})
    fixed = {name: value for name, value in constants.items() if name not in free}
    _check_fixed(fixed, free)
    _check_directions(data)
    outliers = find_outliers(data.w, data.tau)
    weight = np.ones(len(data.w))
    for outlier in outliers:
        weight[outlier.index] = outlier.weight
    scatter = _INITIAL_SCATTER * float(np.median(data.tau_deviation))
    smallest_scatter = 1e-6 * float(np.ptp(data.tau))
    unfitted_model = MapModel(
        drive=drive,
        law=law,
        names=(),
        fixed=fixed,
        reference=dict(reference or {}),
        w=data.w,
        tau=data.tau,
        weight=weight,
        friction=data.friction,
        elapsed=session_progress(data.times),
        load=load + fixed.get(LOAD_OFFSET, 0.0),
        scatter=max(scatter, smallest_scatter),
    )
    models = _candidate_models(unfitted_model, free)
    fitted: FittedModels = []
    for k, model in enumerate(models):
        progress(Step(f"fitting the {model.law.replace('_', ' ')} law", k, len(models) + 1))
        fitted.append((model, most_likely(model)))
    progress(Step("computing the confidence intervals", len(models), len(models) + 1))
    determined = _determined_models(fitted)
    probabilities = _sample_laws(fitted)
    (model, z), criterion = _choose_model(determined, probabilities)
    fit = _build_map_fit(model, z, data, _possible_laws(probabilities, model.law))
    outlier_rows = tuple(
        (data.names[outlier.index], outlier.distance, outlier.weight) for outlier in outliers
    )
    return replace(fit, outliers=outlier_rows, criterion=criterion)


def _candidate_models(prototype: MapModel, free: Sequence[str]) -> list[MapModel]:
    """Build the models that are compared: each friction law with and without additional terms.

    The additional terms are a constant load offset, and a change of friction during the session.
    Each law gives a model without additional terms, one with the offset, one with the change, and
    one with both.

    Parameters
    ----------
    prototype : MapModel
        Model with the data of the map. Its law is one of `FRICTION_LAWS`, or `auto` for all laws.
    free : sequence of str
        Names of the parameters that are fitted in addition to those of the law.

    Returns
    -------
    list of MapModel
        Models, ordered by law. The last model of each law has all parameters. The offset is omitted
        if the user fixed it, and the change is omitted if too few recordings have dates.
    """
    additions: list[tuple[str, ...]] = [()]
    if LOAD_OFFSET not in prototype.fixed:
        additions.append((LOAD_OFFSET,))
    if np.isfinite(prototype.elapsed).any():
        additions += [names + SESSION_CHANGE_PARAMETERS for names in additions]
    laws = FRICTION_LAWS if prototype.law == "auto" else (prototype.law,)
    models = []
    for law in laws:
        fixed = dict(prototype.fixed)
        if law == "coulomb":
            for name in _STRIBECK:
                fixed.pop(name, None)
        names = tuple(name for name in parameter_names(law) + tuple(free) if name not in fixed)
        drive = drive_with_parameters(prototype.drive, law, {})
        model = replace(prototype, drive=drive, law=law, names=names, fixed=fixed)
        models += [replace(model, names=names + addition) for addition in additions]
    return models


def _choose_model(
    determined: FittedModels, probabilities: PossibleLaws
) -> tuple[tuple[MapModel, Array], dict[str, float]]:
    """Select the simplest model that predicts well the recordings that its fit has not used.

    The choice is among the models of the Coulomb law, which has the fewest parameters, if its
    probability exceeds 5 %. Otherwise, it is among the models of the Stribeck laws.
    Cross-validation alone would often take a change of friction during the session for a Stribeck
    term.

    Parameters
    ----------
    determined : list of (MapModel, (k,) array)
        Models with the most likely coordinates of their parameters.
    probabilities : list of (PosteriorSample, float)
        Posterior sample and probability of each law.

    Returns
    -------
    chosen : (MapModel, (k,) array)
        The selected entry of `determined`.
    criterion : dict
        RMS error in the cross-validation by name of the law (N·m). It is that of the selected model
        for its law, and that of the best model for each other law.
    """
    # The confidence level is 95 %, so a law is plausible if its probability exceeds 5 %.
    laws = {
        law_sample.model.law
        for law_sample, probability in probabilities
        if probability > 1 - CONFIDENCE
    }
    is_coulomb = "coulomb" in laws
    plausible = [(model, z) for model, z in determined if (model.law == "coulomb") == is_coulomb]
    determined = plausible or determined
    models = [model for model, _ in determined]
    errors = [cross_validation_errors(model, z) for model, z in determined]
    rms_errors = [rms(error) for error in errors]
    criterion: dict[str, float] = {}
    for model, rms_error in zip(models, rms_errors, strict=True):
        criterion[model.law] = min(rms_error, criterion.get(model.law, math.inf))
    index = simplest_model(models, errors)
    criterion[models[index].law] = rms_errors[index]
    return determined[index], criterion


def _check_fixed(fixed: Numbers, free: Sequence[str]) -> None:
    """Raise an error if the user names an unknown parameter or fixes one at an invalid value.

    Parameters
    ----------
    fixed : Mapping
        Values by name of the parameter. They must be finite and, except the load offset, ≥ 0.
    free : sequence of str
        Names of the parameters that are fitted in addition to those of the law.

    Raises
    ------
    RecordingError
        If a name is unknown or a value is invalid.
    """
    names = (*MAP_PARAMETERS, LOAD_OFFSET)
    for name in free:
        if name not in names:
            raise RecordingError(f"cannot free {name!r}; parameters: {', '.join(names)}")
    for name, value in fixed.items():
        allowed = name in names and math.isfinite(value)
        if not allowed or (value < 0.0 and name != LOAD_OFFSET):
            raise RecordingError(
                f"cannot fix {name!r} at {value!r}; parameters: {', '.join(names)}"
            )


def _check_directions(data: TorqueMap) -> None:
    """Raise an error if all recordings move in one direction.

    Friction changes its sign with the direction and the load does not, so only recordings of both
    directions separate the two.

    Parameters
    ----------
    data : TorqueMap
        Points of the map.

    Raises
    ------
    RecordingError
        If all speeds have the same sign.
    """
    if not (np.any(data.w > 0) and np.any(data.w < 0)):
        side = "positive" if np.any(data.w > 0) else "negative"
        raise RecordingError(
            f"all {len(data.w)} recordings move in the {side} direction; friction and load can be "
            "told apart only with recordings of both directions"
        )


def _determined_models(fitted: FittedModels) -> FittedModels:
    """Return the models that have fewer parameters than the map has points.

    Parameters
    ----------
    fitted : list of (MapModel, (k,) array)
        Models with the most likely coordinates of their parameters.

    Returns
    -------
    list of (MapModel, (k,) array)
        The remaining entries of `fitted`.

    Raises
    ------
    RecordingError
        If no model remains.
    """
    points = len(fitted[0][0].w)
    determined = [(model, z) for model, z in fitted if points > len(model.names)]
    if not determined:
        need = min(len(model.names) for model, _ in fitted) + 1
        raise RecordingError(
            f"{points} points cannot determine {need - 1} parameters: record at least {need} "
            "speeds, or fix known parameters"
        )
    return determined


def _sample_laws(fitted: FittedModels) -> PossibleLaws:
    """Sample the posterior of each friction law, and compute the probabilities of the laws.

    Only the model of each law with all parameters is sampled. Cross-validation may later select a
    model without a load offset or without a change during the session. The offset and the change
    remain uncertain even then, and the intervals must include this uncertainty.

    The laws are equally likely before the fit, so their probabilities are in proportion to their
    evidence, that is, to the probability density of the data under each law.

    Parameters
    ----------
    fitted : list of (MapModel, (k,) array)
        Models with the most likely coordinates of their parameters. For each law, the model with
        all parameters is the last.

    Returns
    -------
    list of (PosteriorSample, float)
        Posterior sample and probability of each law. The probabilities have the sum 1.
    """
    models = {model.law: (model, z) for model, z in fitted}
    samples = [sample_posterior(model, z) for model, z in models.values()]
    evidence = np.array([law_sample.log_evidence for law_sample in samples])
    probability = np.exp(evidence - np.logaddexp.reduce(evidence))
    return list(zip(samples, probability.tolist(), strict=True))


def _possible_laws(probabilities: PossibleLaws, chosen: str) -> PossibleLaws:
    """Return the laws that become part of the posterior, with their probabilities.

    These are the laws whose probability is at least `SMALLEST_LAW_PROBABILITY`, and the selected
    law, which is given at least this probability. A law may have more parameters than the map has
    points, because the prior bounds its parameters.

    Parameters
    ----------
    probabilities : list of (PosteriorSample, float)
        Posterior sample and probability of each law.
    chosen : str
        Name of the selected law.

    Returns
    -------
    list of (PosteriorSample, float)
        Posterior sample and probability of each possible law. The probabilities have the sum 1.
    """
    possible = [
        (law_sample, max(share, SMALLEST_LAW_PROBABILITY))
        for law_sample, share in probabilities
        if share >= SMALLEST_LAW_PROBABILITY or law_sample.model.law == chosen
    ]
    total = sum(share for _, share in possible)
    return [(law_sample, share / total) for law_sample, share in possible]


def _pool_parameter_sets(possible: PossibleLaws, slow: Array) -> Arrays:
    """Combine the weighted parameter sets of all possible laws in one table.

    Every second set contains the friction at the beginning of the session, and the others that at
    its end. The table therefore includes a change of friction during the session.

    Parameters
    ----------
    possible : list of (PosteriorSample, float)
        Posterior sample and probability of each possible law.
    slow : (2,) array
        A small positive and a small negative motor speed (rad/s), at which torques are computed.

    Returns
    -------
    dict of (sets,) arrays
        One column for each parameter in SI units. The columns `forwards` and `backwards` contain
        the torques at the slow speeds (N·m), and `WEIGHT_COLUMN` the weights. If several laws are
        possible, `LAW_COLUMN` contains the index of the law in `FRICTION_LAWS`. NaN marks a
        parameter that the law of a set does not have, except the Stribeck friction of the Coulomb
        law, which is 0.
    """
    tables: list[Arrays] = []
    for law_sample, probability in possible:
        model = law_sample.model
        z, weight = law_sample.ordered
        z = model.at_ends(z)
        table = {name: column[:, 0] for name, column in model.parameters(z).items()}
        if len(possible) > 1:
            constants = {"mu_stribeck": 0.0} if model.law == "coulomb" else model.fixed
            for name in _STRIBECK:
                if name in constants:
                    table[name] = np.full(len(z), float(constants[name]))
            table[LAW_COLUMN] = np.full(len(z), float(FRICTION_LAWS.index(model.law)))
        table |= dict(zip(_DIRECTIONS, model.torque(z, slow).T, strict=True))
        table[WEIGHT_COLUMN] = probability * weight
        tables.append(table)
    pooled = {}
    for name in dict.fromkeys(name for table in tables for name in table):
        columns = [table.get(name, np.full_like(table[WEIGHT_COLUMN], np.nan)) for table in tables]
        pooled[name] = np.concatenate(columns)
    return pooled


def _draw_sets(pooled: Arrays) -> Arrays:
    """Draw equally likely parameter sets from weighted ones.

    The number of drawn sets is `POSTERIOR_DRAWS`.

    The method is systematic resampling: sets are picked at equal steps of the cumulative weight, so
    a set is drawn in proportion to its weight. A parameter set of the Coulomb law has no Stribeck
    speed, but the drive file needs a number. Such a set receives the Stribeck speed of a set of
    another law, and the Coulomb law ignores this number.

    Parameters
    ----------
    pooled : dict of (sets,) arrays
        Weighted parameter sets of all possible laws: one column for each parameter, and the
        weights. NaN marks a parameter that the law of a set does not have.

    Returns
    -------
    dict of (POSTERIOR_DRAWS,) arrays
        Columns of the drawn sets by name, in random order of the sets. The weights, the torques of
        slow motion, and the parameters of the change during the session are omitted.
    """
    cumulative = np.cumsum(pooled[WEIGHT_COLUMN])
    steps = (np.arange(POSTERIOR_DRAWS) + 0.5) / POSTERIOR_DRAWS
    indices = np.searchsorted(cumulative, steps * cumulative[-1])
    indices = np.random.default_rng(RANDOM_SEED).permutation(indices)
    omitted = _DIRECTIONS + SESSION_CHANGE_PARAMETERS + (WEIGHT_COLUMN,)
    last_names = [name for name in (LOAD_OFFSET, LAW_COLUMN) if name in pooled]
    names = [name for name in pooled if name not in omitted and name not in last_names]
    columns = {name: pooled[name][indices] for name in names + last_names}
    for column in columns.values():
        missing = np.isnan(column)
        # The present values are repeated in their order as often as necessary.
        column[missing] = np.resize(column[~missing], missing.sum())
    return columns


def _build_map_fit(model: MapModel, z: Array, data: TorqueMap, possible: PossibleLaws) -> MapFit:
    """Compute estimates, posterior, errors and remarks for the selected model.

    Parameters
    ----------
    model : MapModel
        The selected model.
    z : (k,) array
        Most likely coordinates of its parameters.
    data : TorqueMap
        Points of the map.
    possible : list of (PosteriorSample, float)
        Posterior sample and probability of each possible law.

    Returns
    -------
    MapFit
        Result of `fit_map`, still without the fields `outliers` and `criterion`.
    """
    predicted = model.torque(z[None])[0]
    # The torque of very slow motion contains almost no viscous friction.
    slow = 1e-3 * float(np.abs(model.w).min()) * np.array([1.0, -1.0])
    pooled = _pool_parameter_sets(possible, slow)
    posterior = _build_posterior(model, predicted, data, possible, _draw_sets(pooled))
    values = {LOAD_OFFSET: model.fixed.get(LOAD_OFFSET, 0.0)}
    for name, value in model.parameters(z[None]).items():
        values[name] = float(value[0, 0])
    separable = _separable_parameters(possible)
    estimates = {}
    for name in posterior.names + SESSION_CHANGE_PARAMETERS:
        if name in values:
            estimate = _interval_estimate(values[name], pooled, name)
            estimates[name] = replace(estimate, separable=name in separable)
    if values.get("mu", math.inf) <= smallest_locking_mu(model.drive) * (1 + 1e-9):
        estimates["mu"] = replace(estimates["mu"], at_bound=True)
    for name, number in model.fixed.items():
        estimates[name] = Estimate(number, number, number, fixed=True)
    inseparable_names = tuple(name for name in model.names if name not in separable)
    offset = values.pop(LOAD_OFFSET)
    drive = _identified_drive(model, values, posterior, offset)
    slow_torques = model.torque(z[None], slow)[0].tolist()
    notes = [
        *_plausibility_notes(model, drive, predicted, offset),
        *_estimate_notes(estimates, possible),
    ]
    return MapFit(
        law=model.law,
        drive=drive,
        load=model.total_load(offset),
        estimates=estimates,
        correlation_names=model.names,
        correlation=data_correlation(model, z),
        inseparable=(inseparable_names,) if inseparable_names else (),
        combinations={
            direction: _interval_estimate(torque, pooled, direction)
            for direction, torque in zip(_DIRECTIONS, slow_torques, strict=True)
        },
        predicted=predicted,
        nrmsd=float(rms(model.tau - predicted) / np.ptp(model.tau)),
        outliers=(),
        criterion={},
        law_shares=posterior.law_shares(model.law),
        notes=tuple(notes),
    )


def _separable_parameters(possible: PossibleLaws) -> set[str]:
    """Return the names of the parameters that the data determine under every possible law.

    The data determine a parameter if its prior pull is below `LARGEST_PRIOR_PULL`. The prior pull
    says how far the posterior mean follows a shift of the prior, see `prior_pull`.

    Parameters
    ----------
    possible : list of (PosteriorSample, float)
        Posterior sample and probability of each possible law.

    Returns
    -------
    set of str
        Names of the parameters.
    """
    names_by_law = []
    for law_sample, _ in possible:
        pulls = zip(law_sample.model.names, prior_pull(law_sample.covariance), strict=True)
        names_by_law.append({name for name, pull in pulls if pull < LARGEST_PRIOR_PULL})
    return set.intersection(*names_by_law)


def _build_posterior(
    model: MapModel, predicted: Array, data: TorqueMap, possible: PossibleLaws, columns: Arrays
) -> Posterior:
    """Build the posterior that the drive file contains, with numbers of six digits as in the file.

    Parameters
    ----------
    model : MapModel
        The selected model. Only its points without outliers become part of the posterior.
    predicted : (points,) array
        Torque of the model at the points of the map (N·m).
    data : TorqueMap
        Points of the map, from which ripple and noise of the torque are taken.
    possible : list of (PosteriorSample, float)
        Posterior sample and probability of each possible law.
    columns : dict of (draws,) arrays
        Equally likely parameter sets, one column for each parameter.

    Returns
    -------
    Posterior
        Parameter sets, scatter between recordings, and errors of the model at its points.
    """
    is_regular = model.weight == 1.0
    expected_scatters = [probability * law_sample.scatter for law_sample, probability in possible]
    variance, common = np.sum(expected_scatters, axis=0)
    scatter, common = _round_to_six_digits(np.array([math.sqrt(variance), common]))
    return Posterior(
        names=tuple(columns),
        draws=np.transpose([_round_to_six_digits(column) for column in columns.values()]),
        scatter=scatter,
        common=common,
        speeds=_round_to_six_digits(model.w[is_regular]),
        departures=_round_to_six_digits((model.tau - predicted)[is_regular]),
        forwards=data.spread(1),
        backwards=data.spread(-1),
    )


def _round_to_six_digits(values: Array) -> tuple[float, ...]:
    """Round values to six significant digits, as the drive file states them.

    Parameters
    ----------
    values : (n,) array
        Values of any unit.

    Returns
    -------
    tuple of n floats
        The rounded values.
    """
    return tuple(float(f"{value:.6g}") for value in values)


def _interval_estimate(value: float, pooled: Arrays, name: str) -> Estimate:
    """Return an estimate with the 95 % interval of one column of the pooled parameter sets.

    Parameters
    ----------
    value : float
        Most likely value. The interval is widened to contain it.
    pooled : dict of (sets,) arrays
        Columns of `_pool_parameter_sets`. Sets in which the column is NaN are omitted.
    name : str
        Name of the column.

    Returns
    -------
    Estimate
        The value with its interval.
    """
    is_present = np.isfinite(pooled[name])
    low, high = weighted_interval(pooled[name][is_present], pooled[WEIGHT_COLUMN][is_present])
    return Estimate(value, min(low, value), max(high, value))


def _estimate_notes(estimates: dict[str, Estimate], possible: PossibleLaws) -> Iterator[str]:
    """Yield notes on self-locking, on a change of friction, and on unreliable intervals.

    Intervals are unreliable if one of the sampled parameter sets has more than `LARGEST_WEIGHT` of
    the whole weight, because few sets then represent the posterior.

    Parameters
    ----------
    estimates : dict
        Estimates by name of the parameter.
    possible : list of (PosteriorSample, float)
        Posterior sample and probability of each possible law.

    Yields
    ------
    str
        One sentence for each finding.
    """
    if "mu" in estimates and estimates["mu"].at_bound:
        yield (
            "the fit prefers a mu that is too small for self-locking: the value is the smallest mu "
            "that locks, and the interval contains smaller ones"
        )
    if CHANGE in estimates:
        low, high = np.expm1([estimates[CHANGE].low, estimates[CHANGE].high])
        yield (
            f"friction changed by {low:.0%} to {high:.0%} during the session: the values are those "
            "in its middle, and the intervals include its beginning and its end"
        )
    weight = max(probability * law_sample.largest_weight for law_sample, probability in possible)
    if weight > LARGEST_WEIGHT:
        yield (
            f"the 95 % intervals are not reliable: one of the sampled parameter sets has "
            f"{weight:.1%} of the probability; are direction and payload of the rig right?"
        )


def _plausibility_notes(
    model: MapModel, drive: Drive, predicted: Array, offset: float
) -> Iterator[str]:
    """Yield notes on results that suggest wrong recordings or a wrong description of the rig.

    They concern a load opposite to the payload, a preload too small to keep both half nuts in
    contact, a torque far from that of the expected friction, and a large error of the fitted law.

    Parameters
    ----------
    model : MapModel
        The selected model.
    drive : Drive
        Drive with the identified friction.
    predicted : (points,) array
        Torque of the fitted law at the points of the map (N·m).
    offset : float
        Constant load in addition to the payload (N·m or N).

    Yields
    ------
    str
        One sentence for each finding.
    """
    if model.load * (model.load + offset) < 0.0:
        yield (
            f"the identified load, {model.load + offset:.3g}, is opposite to the payload's "
            f"{model.load:.3g}: are direction and payload of the rig right?"
        )
    effort = output_effort(drive, model.load, model.w / drive.ratio, 0.0)
    losses = int(np.sum(nut_contact_force(drive, effort, 0.0) <= 0.0))
    if losses:
        yield (
            f"the preload does not keep both half nuts in contact at {losses} points: the law does "
            "not hold there"
        )
    size = float(np.mean(np.abs(model.tau)))
    if set(parameter_names("coulomb")) <= set(model.reference):
        expected = drive_with_parameters(model.drive, "coulomb", model.reference)
        ratio = size / float(np.mean(np.abs(map_torque(expected, model.w, model.load))))
        if not 1 / LARGEST_TORQUE_RATIO < ratio < LARGEST_TORQUE_RATIO:
            yield (
                f"the mean torque is {ratio:.2g} times that of the expected friction: are these "
                "recordings of this drive?"
            )
    error = rms(model.tau - predicted) / size
    if error > LARGEST_RELATIVE_ERROR:
        yield (
            f"the error of the law is {error:.0%} of the mean torque: are these recordings of this "
            "drive, with this payload and direction?"
        )


def _identified_drive(
    model: MapModel, values: Numbers, posterior: Posterior, offset: float
) -> Drive:
    """Return the drive with its identified friction, and with the load offset of its test rig.

    Parameters
    ----------
    model : MapModel
        The selected model.
    values : Mapping
        Fitted parameters by name, in SI units.
    posterior : Posterior
        Uncertainty of the parameters.
    offset : float
        Constant load in addition to the payload (N·m or N).

    Returns
    -------
    Drive
        The drive. Its static friction coefficient is the limit of the kinetic one at zero speed,
        because a torque–velocity map does not show breakaway.
    """
    drive = drive_with_parameters(model.drive, model.law, {**model.fixed, **values})
    friction = replace(
        required_friction(drive),
        mu_static=float(friction_coefficient(required_friction(drive), 0.0)),
        identified_speed=largest_magnitude(model.w),
        covariance=None,
        posterior=posterior,
    )
    rig = None if drive.rig is None else replace(drive.rig, load_offset=offset)
    return replace(drive, friction=friction, rig=rig)
