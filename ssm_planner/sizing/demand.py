"""The few figures of a motion by which motors and gears are judged, and their band where friction is uncertain.

Two kinds of uncertainty: the covariance of an identification, which is statistics, and stated ranges (lubrication,
temperature, wear), of which every corner must be mastered. A parameter with a stated range leaves the covariance.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any, Literal

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.errors import ProblemError
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.posterior import LOAD_OFFSET, Posterior
from ssm_planner.problem.value import unchecked
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import (
    REFERENCE_TEMPERATURE,
    figure,
    missing,
    required_voltage,
    resistance,
    torque_constant,
)
from ssm_planner.typing import Array, Indices, Range

DemandName = Literal["peak_torque", "rms_torque", "peak_voltage", "peak_effort", "continuous_effort"]
DEMANDS: tuple[DemandName, ...] = ("peak_torque", "rms_torque", "peak_voltage", "peak_effort", "continuous_effort")
ELECTRICAL = ("torque_constant", "terminal_resistance", "max_winding_temperature")
"""What the voltage check needs of a motor file."""
LINEAR_DRAWS = 20_000
SHARE = 500
"""Instants of a motion that a Monte Carlo looks at, beside those where torque jumps or peaks."""
BLOCK = 120_000
"""Torques evaluated at once, so that the arrays stay in the cache."""


@dataclass(frozen=True, eq=False)
class Demands:
    """Figures over one motion, without pause: each a number or (draws,); N·m, V, and N·m or N of output effort."""

    peak_torque: Array
    rms_torque: Array
    peak_voltage: Array
    """NaN where the motor lacks the figures."""
    peak_effort: Array
    """|F| that the mesh carries."""
    continuous_effort: Array
    """Root mean cube of |F| over the time in motion, by which wear counts."""

    def array(self) -> Array:
        """(draws, 5) in the order of DEMANDS."""
        return np.stack([np.atleast_1d(getattr(self, name)) for name in DEMANDS], axis=1)

    @classmethod
    def of(cls, table: Array) -> Demands:
        """Of a table (draws, demands) with a column for each of DEMANDS."""
        return cls(*(table[:, i] for i in range(len(DEMANDS))))


@dataclass(frozen=True, eq=False)
class Band:
    """Demands at the stated friction, and as drawn: at the worst and at the best corner of the stated ranges."""

    nominal: Demands
    worst: Demands
    best: Demands
    known: bool
    """False: nothing is known of the friction's uncertainty, it is taken as stated."""
    smooth: Demands | None = None
    """`worst` without the ripple of the drive, where its peaks include one."""

    def high(self, name: DemandName, confidence: float) -> float:
        """What the demand stays below with this confidence."""
        return float(np.quantile(getattr(self.worst, name), confidence, method="inverted_cdf"))

    def low(self, name: DemandName, confidence: float) -> float:
        """What the demand stays above with this confidence."""
        return float(np.quantile(getattr(self.best, name), 1 - confidence, method="inverted_cdf"))

    def at(self, name: DemandName) -> float:
        """At the stated friction."""
        return float(getattr(self.nominal, name)[0])


def demands(load: JointLoad, drive: Drive, motor: Motor | None = None) -> Demands:
    """Figures of one motion with one drive, whose friction may hold columns (draws, 1) for many draws at once."""
    torque, effort = np.atleast_2d(load.torque(drive)), np.atleast_2d(np.abs(load.effort(drive)))
    in_motion = load.weight * (load.direction != 0)
    share = max(float(in_motion.sum()), 1e-300)
    return Demands(
        peak_torque=np.maximum(torque.max(axis=1), -torque.min(axis=1)),
        rms_torque=load.rms(torque),
        peak_voltage=_voltage(torque, load, drive, motor),
        peak_effort=np.broadcast_to(effort.max(axis=1), (len(torque),)),
        continuous_effort=np.broadcast_to(np.cbrt((effort * effort * effort) @ in_motion / share), (len(torque),)),
    )


def _voltage(torque: Array, load: JointLoad, drive: Drive, motor: Motor | None) -> Array:
    """The larger need of a cold motor (more back-EMF) and a hot one (more resistance, more current)."""
    if motor is None or missing(motor, *ELECTRICAL):
        return np.full(len(torque), np.nan)
    hottest = figure(motor, "max_winding_temperature")
    speed = load.speed(drive)
    cold, hot = (required_voltage(torque, speed, motor, at).max(axis=1) for at in (REFERENCE_TEMPERATURE, hottest))
    return np.maximum(cold, hot)


def linear_band(load: JointLoad, drive: Drive, spread: FrictionSpread, motor: Motor | None = None) -> Band:
    """The band by secants over ±1 σ of every uncertain parameter, about the corners of the stated ranges.

    The sets of a posterior are few enough for the exact law: they are taken as they are.
    """
    if spread.posterior is not None:
        return monte_carlo(load, drive, spread, len(spread.posterior.draws), motor)
    nominal, corners = demands(load, drive, motor), _at_corners(load, drive, spread, motor)
    moved = spread.deviations(LINEAR_DRAWS) @ _secants(load, drive, spread, motor)
    worst, best = np.maximum(corners.max(axis=0) + moved, 0.0), corners.min(axis=0) + moved
    return Band(nominal, Demands.of(worst), _lowest(best, load, drive, spread, motor), spread.known)


def _at_corners(load: JointLoad, drive: Drive, spread: FrictionSpread, motor: Motor | None) -> Array:
    """(corners, 5)"""
    return np.concatenate([demands(load, drawn(drive, corner), motor).array() for corner in spread.corners()])


def _lowest(best: Array, load: JointLoad, drive: Drive, spread: FrictionSpread, motor: Motor | None) -> Demands:
    """Demands (draws, 5) of the best corner, lowered to what no inertia within its range falls below.

    Peaks and RMS are convex in the inertia J: between its ends they are at least their mean less (J₂ − J₁)/2 · |ẇ|.
    """
    low, high = spread.inertia or (0.0, 0.0)
    wd = np.abs(load.acceleration(drive))
    peak, rms = ((high - low) / 2 * value for value in (float(wd.max()), float(load.rms(wd))))
    return Demands.of(np.maximum(best - [peak, rms, peak * _volts_per_torque(motor), 0.0, 0.0], 0.0))


def _volts_per_torque(motor: Motor | None) -> float:
    """R/k of the hot motor, V/(N·m): of what is added to its torque; NaN where figures are missing."""
    if motor is None or missing(motor, *ELECTRICAL):
        return np.nan
    hottest = figure(motor, "max_winding_temperature")
    return resistance(motor, hottest) / torque_constant(motor, hottest)


def _secants(load: JointLoad, drive: Drive, spread: FrictionSpread, motor: Motor | None) -> Array:
    """d(demands)/d(parameters), (k, 5)."""
    slopes = np.zeros((len(spread.names), len(DEMANDS)))
    for i, (name, mean, sigma) in enumerate(zip(spread.names, spread.mean, spread.sigma, strict=True)):
        if sigma == 0:
            continue
        low = max(mean - sigma, 0.0)
        above, below = (demands(load, drawn(drive, {name: at}), motor).array()[0] for at in (mean + sigma, low))
        slopes[i] = (above - below) / (mean + sigma - low)
    return slopes


def monte_carlo(load: JointLoad, drive: Drive, spread: FrictionSpread, count: int, motor: Motor | None = None) -> Band:
    """The band by `count` draws of the identified parameters, each evaluated by the exact law."""
    nominal, at_corners = demands(load, drive, motor), _at_corners(load, drive, spread, motor)
    if not spread.names:
        worst, best = at_corners.max(axis=0, keepdims=True), at_corners.min(axis=0, keepdims=True)
        return Band(nominal, Demands.of(worst), _lowest(best, load, drive, spread, motor), spread.known)
    corners = spread.corners()
    few = thinned(load, drive)
    deviations = spread.deviations(count)
    ends = [{int(extreme(np.nan_to_num(column))) for column in at_corners.T} for extreme in (np.argmax, np.argmin)]
    tables = {
        i: _drawn_demands(few, drive, spread=spread, deviations=deviations, corner=corners[i], motor=motor)
        for i in sorted(ends[0] | ends[1])
    }
    high, low = (reduce(take, (tables[i] for i in of)) for take, of in zip((np.maximum, np.minimum), ends, strict=True))
    smooth = Demands.of(high)
    ripple = _with_ripple(smooth, load, drive, motor)
    return Band(nominal, ripple, _lowest(low, load, drive, spread, motor), True, None if ripple is smooth else smooth)


def _with_ripple(smooth: Demands, load: JointLoad, drive: Drive, motor: Motor | None) -> Demands:
    """Demands whose peaks include what the torque of screw or worm departs from its mean (draws,).

    Ripple is that of the recordings, larger in proportion where the torque is larger than there.
    """
    posterior = friction_of(drive).posterior
    torque = load.torque(drive)
    ripple = None if posterior is None else posterior.ripple(1 if torque[np.argmax(np.abs(torque))] >= 0 else -1)
    if ripple is None:
        return smooth
    beyond = ripple.draw_peak(np.random.default_rng(SEED), len(smooth.peak_torque))
    beyond *= np.maximum(smooth.peak_torque / float(np.median(ripple.torque)), 1.0)
    voltage = smooth.peak_voltage + beyond * _volts_per_torque(motor)
    return replace(smooth, peak_torque=smooth.peak_torque + beyond, peak_voltage=voltage)


def _drawn_demands(
    load: JointLoad,
    drive: Drive,
    spread: FrictionSpread,
    deviations: Array,
    corner: dict[str, float],
    motor: Motor | None,
) -> Array:
    """(draws, 5) at one corner of the ranges."""
    moving = np.flatnonzero(load.direction != 0)
    standing = np.flatnonzero(load.direction == 0)
    # a standing drive that locks itself needs no torque whatever its friction, and carries the same effort
    idle = len(standing) > 0 and len(moving) > 0 and not np.any(load.torque(drive)[standing])
    part = replace(load.at(moving), weight=load.weight[moving]) if idle else load
    values = spread.values(deviations)
    step = max(BLOCK // len(part.t), 1)
    tables = []
    for start in range(0, len(deviations), step):
        block = {name: value[start : start + step, None] for name, value in values.items()}
        tables.append(demands(part, drawn(drive, {**block, **corner}), motor).array())
    table = np.concatenate(tables)
    if idle:
        k = DEMANDS.index("peak_effort")
        table[:, k] = np.maximum(table[:, k], np.abs(load.effort(drive)[standing]).max())
    return table


def thinned(load: JointLoad, drive: Drive) -> JointLoad:
    """The load at about SHARE evenly spread instants and wherever torque jumps, turns or peaks."""
    torque = load.torque(drive)
    size = np.abs(torque)
    step = np.diff(torque)
    jump = np.flatnonzero((np.diff(load.t) == 0) & (np.abs(step) > 1e-6 * size.max()))
    turn = np.flatnonzero(np.diff(load.direction) != 0)
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
    peaks = peaks[np.argsort(size[peaks])[-20:]]
    every = np.arange(0, len(torque), max(len(torque) // SHARE, 1))
    most = np.array([np.argmax(np.abs(each)) for each in (torque, load.effort(drive), load.qd)] + [len(torque) - 1])
    keep: Indices = np.unique(np.concatenate([every, jump, jump + 1, turn, turn + 1, peaks, most]))
    return load.at(keep)


VARIABLE = ("mu", "mu_static", "mu_stribeck", "stribeck_speed", "b_c", "b_v", "b_oc", "b_ov", "preload")
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
        ranges = {**self.ranges, **({} if self.inertia is None else {"input_inertia": self.inertia})}
        return tuple(dict(zip(ranges, ends, strict=True)) for ends in itertools.product(*ranges.values()))

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
        names = tuple(name for name in posterior.names if name != LOAD_OFFSET and name not in ranges)
        mean = np.array([_value(drive, name) for name in names])
        covariance = np.cov(np.column_stack([posterior.column(name) for name in names]), rowvar=False)
        return FrictionSpread(names, mean, np.atleast_2d(covariance), ranges, posterior)
    table = {name: row for name, row in (friction.covariance or {}).items() if name not in ranges}
    if relative is not None:
        values = {name: float(getattr(friction, name)) for name in SPREAD if name not in (*ranges, *table)}
        ranges |= {
            name: (value * (1 - relative), value * (1 + relative)) for name, value in values.items() if value > 0
        }
    names = tuple(table)
    unknown = [name for name in names if name not in VARIABLE]
    if unknown:
        raise _not_one(drive, f"{unknown[0]} is not a parameter", allowed=", ".join(VARIABLE))
    try:
        covariance = np.array([[table[a][b] for b in names] for a in names]).reshape(len(names), len(names))
    except KeyError as error:
        raise _not_one(drive, f"it lacks the entry of {error.args[0]} in a row") from None
    _check(drive, names, covariance)
    mean = np.array([_value(drive, name) for name in names])
    return FrictionSpread(names, mean, covariance, ranges)


def drawn(drive: Drive, values: Mapping[str, Any]) -> Drive:
    """The drive with friction parameters (preload, input_inertia) replaced; arrays (count, 1) stand for many drives at once.

    The static coefficient keeps its ratio to the coefficient in motion unless it is among the values.
    """
    own = {name: values[name] for name in ("preload", "input_inertia") if name in values}
    friction: dict[str, Any] = {name: value for name, value in values.items() if name not in own}
    given = friction_of(drive)
    moving = given.mu + given.mu_stribeck
    if "mu_static" not in friction and moving > 0 and {"mu", "mu_stribeck"} & set(friction):
        now = friction.get("mu", given.mu) + friction.get("mu_stribeck", given.mu_stribeck)
        friction["mu_static"] = given.mu_static / moving * now
    return unchecked(drive, friction=unchecked(given, **friction), **own)


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
    return ProblemError(f"not a covariance: {reason}", file=drive.file, key="friction.covariance", allowed=allowed)
