"""Friction from a torque–velocity map: outliers, fit, 95 % intervals, correlations, choice of the law."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.transmission import nut_contact, output_effort
from ssm_planner.errors import RecordingError
from ssm_planner.identification.estimation import (
    Estimate,
    MapProblem,
    Solution,
    covariance,
    inseparable_groups,
    intervals_of,
    nearest_to_reference,
    separable_of,
    solve,
)
from ssm_planner.identification.parameters import (
    ALL,
    LAWS,
    TYPICAL_MU,
    bounds,
    first_guess,
    names_of,
    rest_coefficient,
    with_parameters,
)
from ssm_planner.identification.torque_map import Outlier, TorqueMap, find_outliers
from ssm_planner.problem.drive import Drive
from ssm_planner.typing import Array

_STRIBECK_STARTS = (0.01, 0.05, 0.2, 0.6)
"""Starting Stribeck speeds as shares of the fastest speed: the cost has several valleys along it."""


@dataclass(frozen=True, eq=False)
class MapFit:
    """Result of `fit_map`: numbers of one law on one map."""

    law: str
    drive: Drive
    """The drive with the identified friction."""
    estimates: dict[str, Estimate]
    correlation_names: tuple[str, ...]
    correlation: Array
    inseparable: tuple[tuple[str, ...], ...]
    """Groups of parameters that the data give only together."""
    predicted: Array
    """(points,) N·m."""
    nrmsd: float
    """Over all points, outliers included."""
    outliers: tuple[tuple[str, float, float], ...]
    """(recording, distance from its neighbours in N·m, weight in the fit) of points that stand apart."""
    criterion: dict[str, float]
    """AICc of every law tried."""
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
) -> MapFit:
    """Fit friction parameters to a torque–velocity map.

    load: constant effort that the drive exerts on the payload, N·m or N (negative: the payload drives forwards).
    law: one of LAWS, or `auto`: the law with the lowest AICc. fixed: known values by name. reference: values believed
    to a factor of about two, which decide only what the data leave open. free: parameters fitted beyond the law's own
    (`b_ov`, `preload`).
    Raises RecordingError where the map cannot support the fit: one direction only, or fewer points than parameters.
    """
    fixed = {"b_ov": 0.0} | dict(fixed or {})
    for name in free:
        fixed.pop(name, None)
    for name, value in fixed.items():
        if name not in ALL or not (math.isfinite(value) and value >= 0.0):
            raise RecordingError(f"cannot fix {name!r} at {value!r}; parameters: {', '.join(ALL)}")
    _check_directions(data)
    outliers = find_outliers(data.w, data.tau)
    weight = np.ones(len(data.w))
    for outlier in outliers:
        weight[outlier.index] = outlier.weight
    laws = LAWS if law == "auto" else (law,)
    problems = {
        name: _problem(drive, data, weight, load, law=name, fixed=fixed, reference=reference or {}, free=free)
        for name in laws
    }
    problems = _with_enough_points(problems, len(data.w), law)
    solutions = {name: _best_of_starts(problem) for name, problem in problems.items()}
    criterion = {name: _aicc(s.cost, len(data.w), len(problems[name].names)) for name, s in solutions.items()}
    chosen = min(criterion, key=lambda name: criterion[name])
    believed = {"mu": TYPICAL_MU} | dict(reference or {})
    return _report(problems[chosen], solutions[chosen], believed, data, outliers=outliers, criterion=criterion)


def _check_directions(data: TorqueMap) -> None:
    if not (np.any(data.w > 0) and np.any(data.w < 0)):
        side = "positive" if np.any(data.w > 0) else "negative"
        raise RecordingError(
            f"all {len(data.w)} recordings move in the {side} direction; friction and load can be told apart only with "
            "recordings of both directions"
        )


def _problem(
    drive: Drive,
    data: TorqueMap,
    weight: Array,
    load: float,
    *,
    law: str,
    fixed: Mapping[str, float],
    reference: Mapping[str, float],
    free: Sequence[str],
) -> MapProblem:
    names = tuple(n for n in (*names_of(law), *free) if n not in fixed)
    limits = bounds(drive, data.w, data.tau)
    guess = first_guess(drive, data.w, data.tau, load, {k: v for k, v in reference.items() if v})
    scale = np.array([guess[n] if guess[n] > 0 else 0.1 * limits[n][1] for n in names])
    return MapProblem(
        drive=drive,
        law=law,
        w=data.w,
        tau=data.tau,
        weight=weight,
        load=load,
        names=names,
        fixed={k: v for k, v in fixed.items() if law != "coulomb" or k not in ("mu_stribeck", "stribeck_speed")},
        scale=scale,
        lower=np.array([limits[n][0] for n in names]) / scale,
        upper=np.array([limits[n][1] for n in names]) / scale,
        anchor=np.array([guess[n] for n in names]) / scale,
        trust=np.zeros(len(names)),
    )


def _with_enough_points(problems: dict[str, MapProblem], points: int, law: str) -> dict[str, MapProblem]:
    enough = {name: p for name, p in problems.items() if points > len(p.names) + (2 if law == "auto" else 0)}
    if not enough:
        need = min(len(p.names) for p in problems.values()) + 1
        raise RecordingError(
            f"{points} points cannot determine {need - 1} parameters: record at least {need} speeds, "
            "or fix known parameters"
        )
    return enough


def _starts(problem: MapProblem) -> list[Array]:
    start = problem.anchor.copy()
    if "stribeck_speed" not in problem.names:
        return [start]
    k = problem.names.index("stribeck_speed")
    fastest = np.abs(problem.w).max()
    starts = []
    for share in _STRIBECK_STARTS:
        q = start.copy()
        q[k] = share * fastest / problem.scale[k]
        starts.append(q)
    return starts


def _best_of_starts(problem: MapProblem) -> Solution:
    return min((solve(problem, q) for q in _starts(problem)), key=lambda s: s.cost)


def _aicc(cost: float, points: int, parameters: int) -> float:
    k = parameters + 1
    return points * math.log(max(cost, 1e-300) / points) + 2 * k + 2 * k * (k + 1) / max(points - k - 1, 1)


def _report(
    problem: MapProblem,
    best: Solution,
    believed: Mapping[str, float],
    data: TorqueMap,
    *,
    outliers: list[Outlier],
    criterion: dict[str, float],
) -> MapFit:
    points, names = len(problem.w), problem.names
    variance = best.cost / (points - len(names))
    jacobian = problem.jacobian(best.q)
    intervals = intervals_of(problem, best, covariance(jacobian, variance))
    separable = separable_of(jacobian[:points], best.q, intervals)
    chosen = nearest_to_reference(problem, best, believed, separable, variance)
    jacobian = problem.jacobian(chosen.q)
    cov = covariance(jacobian, variance)
    sigma = np.sqrt(np.diag(cov))
    correlation = cov / np.outer(sigma, sigma)
    values = {n: float(v) for n, v in zip(names, chosen.q * problem.scale, strict=True)}
    low, high = np.minimum(intervals[0], chosen.q), np.maximum(intervals[1], chosen.q)
    edge = np.minimum(chosen.q - problem.lower, problem.upper - chosen.q) < 1e-6 * (problem.upper - problem.lower)
    estimates = {
        n: Estimate(
            value=values[n],
            low=low[k] * problem.scale[k],
            high=high[k] * problem.scale[k],
            separable=separable[k],
            at_bound=edge[k],
        )
        for k, n in enumerate(names)
    }
    estimates |= {n: Estimate(v, v, v, fixed=True) for n, v in problem.fixed.items()}
    predicted = problem.torque(chosen.q)
    drive = _identified(problem, values, cov * np.outer(problem.scale, problem.scale))
    return MapFit(
        law=problem.law,
        drive=drive,
        estimates=estimates,
        correlation_names=names,
        correlation=correlation,
        inseparable=inseparable_groups(correlation, names, separable),
        predicted=predicted,
        nrmsd=float(np.sqrt(np.mean((problem.tau - predicted) ** 2)) / np.ptp(problem.tau)),
        outliers=tuple((data.names[o.index], o.distance, o.weight) for o in outliers),
        criterion=criterion,
        notes=_notes(problem, drive),
    )


def _notes(problem: MapProblem, drive: Drive) -> tuple[str, ...]:
    effort = output_effort(drive, problem.load, problem.w / drive.ratio, 0.0)
    lost = int(np.sum(nut_contact(drive, effort, 0.0) <= 0.0))
    if not lost:
        return ()
    return (f"the preload does not keep both half nuts in contact at {lost} points: the law does not hold there",)


def _identified(problem: MapProblem, values: Mapping[str, float], cov: Array) -> Drive:
    drive = with_parameters(problem.drive, problem.law, {**problem.fixed, **values})
    table = {a: {b: float(cov[i, j]) for j, b in enumerate(problem.names)} for i, a in enumerate(problem.names)}
    friction = replace(
        friction_of(drive),
        mu_static=rest_coefficient(drive),
        identified_speed=float(np.abs(problem.w).max()),
        covariance=table,
    )
    return replace(drive, friction=friction)
