"""The few figures of a motion by which motors and gears are judged, and their band where friction is uncertain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import Literal

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.spread import LINEAR_DRAWS, SEED, FrictionSpread, drawn
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import (
    REFERENCE_TEMPERATURE,
    figure,
    missing,
    required_voltage,
    resistance,
    torque_constant,
)
from ssm_planner.typing import Array, Indices

DemandName = Literal[
    "peak_torque", "rms_torque", "peak_voltage", "peak_effort", "continuous_effort"
]
DEMANDS: tuple[DemandName, ...] = (
    "peak_torque",
    "rms_torque",
    "peak_voltage",
    "peak_effort",
    "continuous_effort",
)
ELECTRICAL = ("torque_constant", "terminal_resistance", "max_winding_temperature")
"""What the voltage check needs of a motor file."""
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
        continuous_effort=np.broadcast_to(
            np.cbrt((effort * effort * effort) @ in_motion / share), (len(torque),)
        ),
    )


def _voltage(torque: Array, load: JointLoad, drive: Drive, motor: Motor | None) -> Array:
    """The larger need of a cold motor (more back-EMF) and a hot one (more resistance, more current)."""
    if motor is None or missing(motor, *ELECTRICAL):
        return np.full(len(torque), np.nan)
    hottest = figure(motor, "max_winding_temperature")
    speed = load.speed(drive)
    cold, hot = (
        required_voltage(torque, speed, motor, at).max(axis=1)
        for at in (REFERENCE_TEMPERATURE, hottest)
    )
    return np.maximum(cold, hot)


def linear_band(
    load: JointLoad, drive: Drive, spread: FrictionSpread, motor: Motor | None = None
) -> Band:
    """The band by secants over ±1 σ of every uncertain parameter, about the corners of the stated ranges.

    The sets of a posterior are few enough for the exact law: they are taken as they are.
    """
    if spread.posterior is not None:
        return monte_carlo(load, drive, spread, len(spread.posterior.draws), motor)
    nominal, corners = demands(load, drive, motor), _at_corners(load, drive, spread, motor)
    moved = spread.deviations(LINEAR_DRAWS) @ _secants(load, drive, spread, motor)
    worst, best = np.maximum(corners.max(axis=0) + moved, 0.0), corners.min(axis=0) + moved
    return Band(nominal, Demands.of(worst), _lowest(best, load, drive, spread, motor), spread.known)


def _at_corners(
    load: JointLoad, drive: Drive, spread: FrictionSpread, motor: Motor | None
) -> Array:
    """(corners, 5)"""
    return np.concatenate(
        [demands(load, drawn(drive, corner), motor).array() for corner in spread.corners()]
    )


def _lowest(
    best: Array, load: JointLoad, drive: Drive, spread: FrictionSpread, motor: Motor | None
) -> Demands:
    """Demands (draws, 5) of the best corner, lowered to what no inertia within its range falls below.

    Peaks and RMS are convex in the inertia J: between its ends they are at least their mean less (J₂ − J₁)/2 · |ẇ|.
    """
    low, high = spread.inertia or (0.0, 0.0)
    wd = np.abs(load.acceleration(drive))
    peak, rms = ((high - low) / 2 * value for value in (float(wd.max()), float(load.rms(wd))))
    return Demands.of(np.maximum(best - [peak, rms, peak * volts_per_torque(motor), 0.0, 0.0], 0.0))


def volts_per_torque(motor: Motor | None) -> float:
    """R/k of the hot motor, V/(N·m): of what is added to its torque; NaN where figures are missing."""
    if motor is None or missing(motor, *ELECTRICAL):
        return np.nan
    hottest = figure(motor, "max_winding_temperature")
    return resistance(motor, hottest) / torque_constant(motor, hottest)


def _secants(load: JointLoad, drive: Drive, spread: FrictionSpread, motor: Motor | None) -> Array:
    """d(demands)/d(parameters), (k, 5)."""
    slopes = np.zeros((len(spread.names), len(DEMANDS)))
    for i, (name, mean, sigma) in enumerate(
        zip(spread.names, spread.mean, spread.sigma, strict=True)
    ):
        if sigma == 0:
            continue
        low = max(mean - sigma, 0.0)
        above, below = (
            demands(load, drawn(drive, {name: at}), motor).array()[0] for at in (mean + sigma, low)
        )
        slopes[i] = (above - below) / (mean + sigma - low)
    return slopes


def monte_carlo(
    load: JointLoad, drive: Drive, spread: FrictionSpread, count: int, motor: Motor | None = None
) -> Band:
    """The band by `count` draws of the identified parameters, each evaluated by the exact law."""
    nominal, at_corners = demands(load, drive, motor), _at_corners(load, drive, spread, motor)
    if not spread.names:
        worst, best = at_corners.max(axis=0, keepdims=True), at_corners.min(axis=0, keepdims=True)
        return Band(
            nominal, Demands.of(worst), _lowest(best, load, drive, spread, motor), spread.known
        )
    corners = spread.corners()
    few = thinned(load, drive)
    deviations = spread.deviations(count)
    ends = [
        {int(extreme(np.nan_to_num(column))) for column in at_corners.T}
        for extreme in (np.argmax, np.argmin)
    ]
    tables = {
        i: _drawn_demands(
            few, drive, spread=spread, deviations=deviations, corner=corners[i], motor=motor
        )
        for i in sorted(ends[0] | ends[1])
    }
    high, low = (
        reduce(take, (tables[i] for i in of))
        for take, of in zip((np.maximum, np.minimum), ends, strict=True)
    )
    smooth = Demands.of(high)
    ripple = _with_ripple(smooth, load, drive, motor)
    return Band(
        nominal,
        ripple,
        _lowest(low, load, drive, spread, motor),
        True,
        None if ripple is smooth else smooth,
    )


def _with_ripple(smooth: Demands, load: JointLoad, drive: Drive, motor: Motor | None) -> Demands:
    """Demands whose peaks include what the torque of screw or worm departs from its mean (draws,).

    Ripple is that of the recordings, larger in proportion where the torque is larger than there.
    """
    posterior = friction_of(drive).posterior
    torque = load.torque(drive)
    ripple = (
        None
        if posterior is None
        else posterior.ripple(1 if torque[np.argmax(np.abs(torque))] >= 0 else -1)
    )
    if ripple is None:
        return smooth
    beyond = ripple.draw_peak(np.random.default_rng(SEED), len(smooth.peak_torque))
    beyond *= np.maximum(smooth.peak_torque / float(np.median(ripple.torque)), 1.0)
    voltage = smooth.peak_voltage + beyond * volts_per_torque(motor)
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
    most = np.array(
        [np.argmax(np.abs(each)) for each in (torque, load.effort(drive), load.qd)]
        + [len(torque) - 1]
    )
    keep: Indices = np.unique(np.concatenate([every, jump, jump + 1, turn, turn + 1, peaks, most]))
    return load.at(keep)
