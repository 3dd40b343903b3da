"""Friction from a torque–velocity map: outliers, choice of law and load by blind error, posterior, 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.transmission import nut_contact, output_effort
from ssm_planner.errors import RecordingError
from ssm_planner.identification.parameters import (
    ALL,
    LAWS,
    locking_mu,
    names_of,
    rest_coefficient,
    with_parameters,
)
from ssm_planner.identification.posterior import (
    MapModel,
    blind_errors,
    covariance_near,
    data_correlation,
    log_evidence,
    most_likely,
    prior_pull,
    sample,
    simplest,
)
from ssm_planner.identification.torque_map import TorqueMap, find_outliers
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.posterior import LOAD_OFFSET, Posterior, interval_of
from ssm_planner.typing import Array

SEPARABLE = 0.2
"""A parameter is given by the data where what was expected pulls it by less than this many standard deviations,"""
AGREED = 0.5
"""and every law that the data leave possible has it within so many of them:"""
POSSIBLE = 6.0
"""one whose evidence is no more than exp(POSSIBLE) times less than the best law's."""
_QUIET = 0.1
"""Expected scatter of a mean torque from one recording to the next, as a share of its deviation within a recording."""


@dataclass(frozen=True)
class Estimate:
    """One parameter: value and 95 % interval; low = high = value where it was given instead of fitted."""

    value: float
    low: float
    high: float
    fixed: bool = False
    separable: bool = True
    """False: the data alone do not determine it; the interval is also what is expected of drives of this kind."""
    at_bound: bool = False
    """The value, not the interval, is the least with which the drive locks itself."""


@dataclass(frozen=True, eq=False)
class MapFit:
    """Result of `fit_map`: numbers of one law on one map."""

    law: str
    drive: Drive
    """The drive with the identified friction and its posterior; its rig with the load offset found."""
    load: float
    """Constant effort on the output, load offset included, N·m or N."""
    estimates: dict[str, Estimate]
    correlation_names: tuple[str, ...]
    correlation: Array
    """(parameters, parameters) of their logarithms, as the data alone would leave them."""
    inseparable: tuple[tuple[str, ...], ...]
    """Groups of parameters that the data give only together."""
    combinations: dict[str, Estimate]
    """What the data do give of them: the torque of slow motion in either direction, N·m."""
    predicted: Array
    """(points,) N·m."""
    nrmsd: float
    """Over all points, outliers included."""
    outliers: tuple[tuple[str, float, float], ...]
    """(recording, distance from its neighbours in N·m, weight in the fit) of points that stand apart."""
    criterion: dict[str, float]
    """RMS error of every law on recordings left out, N·m."""
    notes: tuple[str, ...] = ()


def fit_map(
    drive: Drive,
    data: TorqueMap,
    load: float,
    *,
    law: str = "auto",
    fixed: Mapping[str, float] | None = None,
    reference: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> MapFit:
    """Fit friction parameters to a torque–velocity map.

    load: constant effort that the drive exerts on the payload, N·m or N (negative: the payload drives forwards); a
    constant offset of it is fitted where it pays. law: one of LAWS, or `auto`: the simplest law that predicts recordings
    left out about as well as the best. fixed: known values by name. reference: values about which parameters are
    expected. free: parameters fitted beyond the law's own (`b_ov`, `preload`).
    progress: is told each law.
    Raises RecordingError where the map cannot support the fit: one direction only, or fewer points than parameters.
    """
    fixed = {"b_ov": 0.0} | dict(fixed or {})
    for name in free:
        fixed.pop(name, None)
    for name, value in fixed.items():
        if name not in (*ALL, LOAD_OFFSET) or not math.isfinite(value) or (value < 0.0 and name != LOAD_OFFSET):
            raise RecordingError(f"cannot fix {name!r} at {value!r}; parameters: {', '.join((*ALL, LOAD_OFFSET))}")
    offsets = ((),) if LOAD_OFFSET in fixed else ((), (LOAD_OFFSET,))
    load += fixed.get(LOAD_OFFSET, 0.0)
    _check_directions(data)
    outliers = find_outliers(data.w, data.tau)
    weight = np.ones(len(data.w))
    for outlier in outliers:
        weight[outlier.index] = outlier.weight
    scatter = max(_QUIET * float(np.median(data.tau_deviation)), 1e-6 * float(np.ptp(data.tau)))
    models = [
        MapModel(
            drive=with_parameters(drive, name, {}),
            law=name,
            names=(*(n for n in (*names_of(name), *free) if n not in fixed), *offset),
            fixed={k: v for k, v in fixed.items() if name != "coulomb" or k not in ("mu_stribeck", "stribeck_speed")},
            reference=dict(reference or {}),
            w=data.w,
            tau=data.tau,
            weight=weight,
            load=load,
            scatter=scatter,
        )
        for name in (LAWS if law == "auto" else (law,))
        for offset in offsets
    ]
    models = _with_enough_points(models)
    found, errors = [], []
    for k, model in enumerate(models, 1):
        progress(f"fitting the {model.law.replace('_', ' ')} law ({k} of {len(models) + 1})")
        found.append(most_likely(model))
        errors.append(blind_errors(model, found[-1]))
    chosen = simplest(models, errors)
    blind = [float(np.sqrt(np.mean(error**2))) for error in errors]
    criterion: dict[str, float] = {}
    for model, error in zip(models, blind, strict=True):
        criterion[model.law] = min(error, criterion.get(model.law, math.inf))
    criterion[models[chosen].law] = blind[chosen]
    progress(f"drawing the confidence of the parameters ({len(models) + 1} of {len(models) + 1})")
    fit = _report(models[chosen], found[chosen], data, _others(models, found, chosen))
    apart = tuple((data.names[o.index], o.distance, o.weight) for o in outliers)
    return replace(fit, outliers=apart, criterion=criterion)


def _check_directions(data: TorqueMap) -> None:
    if not (np.any(data.w > 0) and np.any(data.w < 0)):
        side = "positive" if np.any(data.w > 0) else "negative"
        raise RecordingError(
            f"all {len(data.w)} recordings move in the {side} direction; friction and load can be told apart only with "
            "recordings of both directions"
        )


def _with_enough_points(models: list[MapModel]) -> list[MapModel]:
    points = len(models[0].w)
    enough = [model for model in models if points > len(model.names)]
    if not enough:
        need = min(len(model.names) for model in models) + 1
        raise RecordingError(
            f"{points} points cannot determine {need - 1} parameters: record at least {need} speeds, "
            "or fix known parameters"
        )
    return enough


def _others(models: list[MapModel], found: list[Array], chosen: int) -> list[tuple[MapModel, Array]]:
    """The other laws that the data leave possible, with their most likely z (k,)."""
    evidence = [log_evidence(model, z) for model, z in zip(models, found, strict=True)]
    return [
        (model, z)
        for model, z, its in zip(models, found, evidence, strict=True)
        if model.law != models[chosen].law and its > max(evidence) - POSSIBLE
    ]


def _separable(model: MapModel, z: Array, draws: Array, others: list[tuple[MapModel, Array]]) -> dict[str, bool]:
    """By name: what was expected hardly pulls the parameter of the model, most likely at z (k,), and the other laws agree.

    A law that is not the true one can leave a narrow interval beside the truth; draws (sets, k) are of the one chosen.
    """
    covariance = np.atleast_2d(np.cov(draws.T))
    separable = {name: bool(pull < SEPARABLE) for name, pull in zip(model.names, prior_pull(covariance), strict=True)}
    for other, best in others:
        pulls = dict(zip(other.names, prior_pull(covariance_near(other, best)), strict=True))
        values = other.parameters(best[None])
        for i, name in enumerate(model.names[: len(z)]):
            if name not in pulls:
                separable[name] = False
            elif name != LOAD_OFFSET:
                apart = abs(model.z_of(name, float(values[name][0, 0])) - z[i]) / np.sqrt(covariance[i, i])
                separable[name] &= bool(pulls[name] < SEPARABLE and apart < AGREED)
    return separable


def _report(model: MapModel, z: Array, data: TorqueMap, others: list[tuple[MapModel, Array]]) -> MapFit:
    """The fit of the chosen law with z (k,) most likely; others: the laws that the data leave possible besides.

    A load offset that did not pay is 0 in the fit, but not known to be: the posterior leaves it open.
    """
    open_model = model
    if LOAD_OFFSET not in (*model.names, *model.fixed):
        open_model = replace(model, names=(*model.names, LOAD_OFFSET))
    draws, scatters, shares = sample(open_model, np.append(z, [0.0] * (len(open_model.names) - len(z))))
    separable = _separable(open_model, z, draws, others)
    at_bound = "mu" in model.names and float(model.parameters(z[None])["mu"][0, 0]) < locking_mu(model.drive)
    if at_bound:
        z = most_likely(model, z, (model.names.index("mu"), model.z_of("mu", locking_mu(model.drive))))
    predicted = model.torque(z[None])[0]
    usual = model.weight == 1.0
    posterior = Posterior(
        names=open_model.names,
        draws=np.array([_six_digits(row) for row in np.column_stack(list(open_model.parameters(draws).values()))]),
        scatter=float(f"{np.median(scatters):.6g}"),
        common=float(f"{np.mean(shares):.6g}"),
        speeds=_six_digits(model.w[usual]),
        departures=_six_digits((model.tau - predicted)[usual]),
        forwards=data.spread(1),
        backwards=data.spread(-1),
    )
    values = {LOAD_OFFSET: model.fixed.get(LOAD_OFFSET, 0.0)} | {
        name: float(value[0, 0]) for name, value in model.parameters(z[None]).items()
    }
    estimates = {
        name: _estimate(value, posterior.column(name), separable=separable[name], at_bound=at_bound and name == "mu")
        for name, value in ((name, values[name]) for name in posterior.names)
    }
    estimates |= {name: Estimate(v, v, v, fixed=True) for name, v in model.fixed.items()}
    offset = values.pop(LOAD_OFFSET)
    load = model.load + (0.0 if LOAD_OFFSET in model.fixed else offset)
    drive = _identified(model, values, posterior, offset)
    slow = 1e-3 * float(np.abs(model.w).min()) * np.array([1.0, -1.0])
    at_rest = np.concatenate([model.torque(z[None], slow), open_model.torque(draws, slow)])
    together = tuple(name for name in model.names if not separable[name])
    return MapFit(
        law=model.law,
        drive=drive,
        load=load,
        estimates=estimates,
        correlation_names=model.names,
        correlation=data_correlation(model, z),
        inseparable=(together,) if together else (),
        combinations={
            name: _estimate(float(at_rest[0, i]), at_rest[1:, i]) for i, name in enumerate(("forwards", "backwards"))
        },
        predicted=predicted,
        nrmsd=float(np.sqrt(np.mean((model.tau - predicted) ** 2)) / np.ptp(model.tau)),
        outliers=(),
        criterion={},
        notes=_notes(model, drive, predicted),
    )


def _six_digits(values: Array) -> tuple[float, ...]:
    """(values,) as a drive file holds them."""
    return tuple(float(f"{value:.6g}") for value in values)


def _estimate(value: float, draws: Array, separable: bool = True, at_bound: bool = False) -> Estimate:
    """From a value and draws (sets,)."""
    low, high = interval_of(draws)
    return Estimate(value, min(low, value), high=max(high, value), separable=separable, at_bound=at_bound)


def _notes(model: MapModel, drive: Drive, predicted: Array) -> tuple[str, ...]:
    notes = []
    effort = output_effort(drive, model.load, model.w / drive.ratio, 0.0)
    lost = int(np.sum(nut_contact(drive, effort, 0.0) <= 0.0))
    if lost:
        notes.append(
            f"the preload does not keep both half nuts in contact at {lost} points: the law does not hold there"
        )
    friction = friction_of(drive)
    if friction.mu <= locking_mu(drive) * (1 + 1e-9):
        notes.append(
            "mu is most likely below the least with which the drive locks itself: the value is that least one, the interval "
            "is not cut there"
        )
    for name in ("b_c", "b_v"):
        expected, found = model.reference.get(name, 0.0), getattr(friction, name)
        if name in model.names and expected > 0 and not 1 / FOREIGN < found / expected < FOREIGN:
            notes.append(
                f"{name} is {found / expected:.2g} times what was expected: are these recordings of this drive?"
            )
    worst = float(np.sqrt(np.mean((model.tau - predicted) ** 2)))
    if worst > BAD * float(np.mean(np.abs(model.tau))):
        notes.append(
            f"the law misses the measured means by {worst / float(np.mean(np.abs(model.tau))):.0%} of the torque: are these "
            "recordings of this drive, with this payload and direction?"
        )
    return tuple(notes)


FOREIGN = 2.5
"""Factor from the expected bearing friction that points to another drive."""
BAD = 0.2
"""Misfit, as a share of the mean torque, that no drive of this kind shows."""


def _identified(model: MapModel, values: Mapping[str, float], posterior: Posterior, offset: float) -> Drive:
    drive = with_parameters(model.drive, model.law, {**model.fixed, **values})
    friction = replace(
        friction_of(drive),
        mu_static=rest_coefficient(drive),
        identified_speed=float(np.abs(model.w).max()),
        covariance=None,
        posterior=posterior,
    )
    rig = None if drive.rig is None else replace(drive.rig, load_offset=offset)
    return replace(drive, friction=friction, rig=rig)
