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
    locking_mu,
    names_of,
    rest_coefficient,
    with_parameters,
)
from ssm_planner.identification.posterior import (
    DRAWS,
    SEED,
    MapModel,
    blind_errors,
    data_correlation,
    log_evidence,
    most_likely,
    prior_pull,
    sample,
    simplest,
)
from ssm_planner.identification.torque_map import TorqueMap, find_outliers
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.posterior import LAW, LAWS, LOAD_OFFSET, Posterior, interval_of
from ssm_planner.representation import ShortRepr
from ssm_planner.typing import Array, Indices

SEPARABLE = 0.2
"""A parameter is given by the data where what was expected pulls it by less than this many standard deviations by every law
that the data leave possible:"""
POSSIBLE = 0.01
"""one that is at least so likely."""
_FOR_PULLS = 250
"""Sets of a law, at least, from which it is told what the data alone decide."""
_STRIBECK = ("mu_stribeck", "stribeck_speed")
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
class MapFit(ShortRepr):
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
    law_shares: dict[str, float]
    """How likely the data leave every law, as the share of the posterior's sets."""
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
        if (
            name not in (*ALL, LOAD_OFFSET)
            or not math.isfinite(value)
            or (value < 0.0 and name != LOAD_OFFSET)
        ):
            raise RecordingError(
                f"cannot fix {name!r} at {value!r}; parameters: {', '.join((*ALL, LOAD_OFFSET))}"
            )
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
            fixed={k: v for k, v in fixed.items() if name != "coulomb" or k not in _STRIBECK},
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
    every = []
    for k, model in enumerate(models, 1):
        progress(f"fitting the {model.law.replace('_', ' ')} law ({k} of {len(models) + 1})")
        every.append((model, most_likely(model)))
    enough = _with_enough_points(every)
    errors = [blind_errors(model, z) for model, z in enough]
    chosen = simplest([model for model, _ in enough], errors)
    blind = [float(np.sqrt(np.mean(error**2))) for error in errors]
    criterion: dict[str, float] = {}
    for (model, _), error in zip(enough, blind, strict=True):
        criterion[model.law] = min(error, criterion.get(model.law, math.inf))
    criterion[enough[chosen][0].law] = blind[chosen]
    progress(f"drawing the confidence of the parameters ({len(models) + 1} of {len(models) + 1})")
    fit = _report(*enough[chosen], data, _possible(every, enough[chosen][0].law))
    apart = tuple((data.names[o.index], o.distance, o.weight) for o in outliers)
    return replace(fit, outliers=apart, criterion=criterion)


def _check_directions(data: TorqueMap) -> None:
    if not (np.any(data.w > 0) and np.any(data.w < 0)):
        side = "positive" if np.any(data.w > 0) else "negative"
        raise RecordingError(
            f"all {len(data.w)} recordings move in the {side} direction; friction and load can be told apart only with "
            "recordings of both directions"
        )


def _with_enough_points(fitted: list[tuple[MapModel, Array]]) -> list[tuple[MapModel, Array]]:
    """Those of the models, each with its most likely z (k,), that the data alone can determine. Raises RecordingError."""
    points = len(fitted[0][0].w)
    enough = [each for each in fitted if points > len(each[0].names)]
    if not enough:
        need = min(len(model.names) for model, _ in fitted) + 1
        raise RecordingError(
            f"{points} points cannot determine {need - 1} parameters: record at least {need} speeds, "
            "or fix known parameters"
        )
    return enough


@dataclass(frozen=True, eq=False)
class _Sets:
    """Equally likely sets of one law: z and values by name (sets,), scatters and shares c (sets,)."""

    model: MapModel
    z: Array
    scatters: Array
    shares: Array
    pulls: dict[str, float]
    """By name, see `prior_pull`."""

    @staticmethod
    def of(model: MapModel, z: Array, count: int) -> _Sets:
        """Drawn about the most likely z (k,)."""
        sets, scatters, shares = sample(model, z, max(count, _FOR_PULLS))
        pulls = dict(
            zip(model.names, prior_pull(np.atleast_2d(np.cov(sets.T))).tolist(), strict=True)
        )
        return _Sets(model, sets[:count], scatters[:count], shares[:count], pulls)

    @property
    def values(self) -> dict[str, Array]:
        return {name: column[:, 0] for name, column in self.model.parameters(self.z).items()}


def _possible(fitted: list[tuple[MapModel, Array]], chosen: str) -> list[_Sets]:
    """Sets of every law that the data leave possible, as many as it is likely by its evidence; of the chosen one always.

    fitted: models with most likely z (k,) each, the load offset open in the last of a law: where it did not pay it is 0 in
    the fit, but not known to be. Laws with more parameters than there are points count too: they are expected to be of
    some size.
    """
    by_law = {model.law: (model, z) for model, z in fitted}
    evidence = np.array([log_evidence(model, z) for model, z in by_law.values()])
    weight = np.exp(evidence - evidence.max())
    least = POSSIBLE * weight.sum()
    weight = np.where(weight < least, [least if law == chosen else 0.0 for law in by_law], weight)
    counts = np.diff(np.rint(DRAWS * np.cumsum([0.0, *weight]) / weight.sum()).astype(int))
    return [
        _Sets.of(model, z, count)
        for (model, z), count in zip(by_law.values(), counts.tolist(), strict=True)
        if count
    ]


def _columns(possible: list[_Sets], order: Indices) -> dict[str, Array]:
    """Values by name (sets,) over all laws, in an order (sets,); LAW among them where there are several.

    A law without a Stribeck term has none of its height; its speed, which does not count, is that of the others.
    """
    if len(possible) == 1:
        return {name: column[order] for name, column in possible[0].values.items()}
    each = [
        {
            **{n: np.full(len(s.z), v) for n, v in s.model.fixed.items() if n in _STRIBECK},
            **s.values,
        }
        for s in possible
    ]
    names = [*dict.fromkeys(name for values in each for name in values if name != LOAD_OFFSET)]
    names += [LOAD_OFFSET] if any(LOAD_OFFSET in values for values in each) else []
    columns = {}
    for name in names:
        known = np.concatenate([values[name] for values in each if name in values])
        parts = [
            values.get(
                name, np.zeros(len(s.z)) if name == "mu_stribeck" else np.resize(known, len(s.z))
            )
            for s, values in zip(possible, each, strict=True)
        ]
        columns[name] = np.concatenate(parts)[order]
    laws = [np.full(len(s.z), LAWS.index(s.model.law), dtype=float) for s in possible]
    return {**columns, LAW: np.concatenate(laws)[order]}


def _report(model: MapModel, z: Array, data: TorqueMap, possible: list[_Sets]) -> MapFit:
    """The fit of the chosen law with z (k,) most likely; possible: sets of all laws that the data leave possible."""
    order = np.random.default_rng(SEED).permutation(sum(len(sets.z) for sets in possible))
    columns = _columns(possible, order)
    pulls = [sets.pulls for sets in possible]
    separable = {name: all(pull.get(name, 1.0) < SEPARABLE for pull in pulls) for name in columns}
    at_bound = "mu" in model.names and float(model.parameters(z[None])["mu"][0, 0]) < locking_mu(
        model.drive
    )
    if at_bound:
        z = most_likely(
            model, z, (model.names.index("mu"), model.z_of("mu", locking_mu(model.drive)))
        )
    predicted = model.torque(z[None])[0]
    usual = model.weight == 1.0
    posterior = Posterior(
        names=tuple(columns),
        draws=np.array([_six_digits(row) for row in np.column_stack(list(columns.values()))]),
        scatter=float(
            f"{np.sqrt(np.mean(np.concatenate([sets.scatters for sets in possible]) ** 2)):.6g}"
        ),
        common=float(f"{np.mean(np.concatenate([sets.shares for sets in possible])):.6g}"),
        speeds=_six_digits(model.w[usual]),
        departures=_six_digits((model.tau - predicted)[usual]),
        forwards=data.spread(1),
        backwards=data.spread(-1),
    )
    values = {LOAD_OFFSET: model.fixed.get(LOAD_OFFSET, 0.0)} | {
        name: float(value[0, 0]) for name, value in model.parameters(z[None]).items()
    }
    estimates = {
        name: _estimate(
            value,
            posterior.column(name),
            separable=separable[name],
            at_bound=at_bound and name == "mu",
        )
        for name, value in ((name, values[name]) for name in posterior.names if name in values)
    }
    estimates |= {name: Estimate(v, v, v, fixed=True) for name, v in model.fixed.items()}
    offset = values.pop(LOAD_OFFSET)
    load = model.load + (0.0 if LOAD_OFFSET in model.fixed else offset)
    drive = _identified(model, values, posterior, offset)
    slow = 1e-3 * float(np.abs(model.w).min()) * np.array([1.0, -1.0])
    at_rest = np.concatenate(
        [model.torque(z[None], slow), *(sets.model.torque(sets.z, slow) for sets in possible)]
    )
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
            name: _estimate(float(at_rest[0, i]), at_rest[1:, i])
            for i, name in enumerate(("forwards", "backwards"))
        },
        predicted=predicted,
        nrmsd=float(np.sqrt(np.mean((model.tau - predicted) ** 2)) / np.ptp(model.tau)),
        outliers=(),
        criterion={},
        law_shares=posterior.law_shares(model.law),
        notes=_notes(model, drive, predicted, offset),
    )


def _six_digits(values: Array) -> tuple[float, ...]:
    """(values,) as a drive file holds them."""
    return tuple(float(f"{value:.6g}") for value in values)


def _estimate(
    value: float, draws: Array, separable: bool = True, at_bound: bool = False
) -> Estimate:
    """From a value and draws (sets,)."""
    low, high = interval_of(draws)
    return Estimate(
        value, min(low, value), high=max(high, value), separable=separable, at_bound=at_bound
    )


def _notes(model: MapModel, drive: Drive, predicted: Array, offset: float) -> tuple[str, ...]:
    notes = []
    if model.load * (model.load + offset) < 0.0:
        notes.append(
            f"the load found, {model.load + offset:.3g}, is opposite to the payload's {model.load:.3g}: are direction and "
            "payload of the rig right?"
        )
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


def _identified(
    model: MapModel, values: Mapping[str, float], posterior: Posterior, offset: float
) -> Drive:
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
