"""What recordings leave open about a drive, as values: equally likely sets of friction parameters, ripple and noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ssm_planner.problem.value import NotNegative, Positive, Shape, Value
from ssm_planner.typing import Array

CONFIDENCE = 0.95
PEAK_SPREAD, PEAK_DEGREES = 0.3, 4
"""Spread expected of the logarithm of recordings' peaks, and for how many recordings this expectation counts."""
LOAD_OFFSET = "load_offset"
"""A constant effort on the output beside the payload: of the rig, not of the drive."""
LAW = "law"
"""Column of the sets' friction laws, by their number in LAWS, where the recordings leave several possible."""
LAWS = ("coulomb", "stribeck_exponential", "stribeck_gaussian")
FRICTION_NAMES = (
    "mu",
    "mu_static",
    "mu_stribeck",
    "stribeck_speed",
    "b_c",
    "b_v",
    "b_oc",
    "b_ov",
    "preload",
)
"""Parameters of a drive that may be uncertain, by their names in Friction (and preload)."""


def interval_of(draws: Array, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Central interval of equally likely values (sets,)."""
    low, high = np.quantile(draws, [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


@dataclass(frozen=True, eq=False)
class Ripple(Value):
    """How torque departs from its mean in steady motion of one direction, N·m: an entry per recording."""

    torque: tuple[Positive, ...]
    """|mean torque| of the recording."""
    ripple: tuple[NotNegative, ...]
    """RMS of what repeats with the angle of the motor."""
    noise: tuple[NotNegative, ...]
    """RMS of the rest."""
    peak: tuple[Positive, ...]
    """Largest |torque| beyond the mean."""

    def _check(self) -> None:
        for name in ("ripple", "noise", "peak"):
            if not 0 < len(getattr(self, name)) == len(self.torque):
                raise self._wrong(
                    name,
                    "not one figure for each recording",
                    f"{len(self.torque)} figures, at least 1",
                )

    def draw(self, rng: np.random.Generator, count: int, known: float = 0.0) -> Array:
        """(count,) departures of single samples, N·m: a harmonic of unknown phase, and noise.

        known: mean square of the ripple that is foreseen, N²·m².
        """
        of = rng.integers(len(self.torque), size=count)
        phase = rng.uniform(0, 2 * np.pi, count)
        left = np.sqrt(np.maximum(np.square(self.ripple) - known, 0.0))
        repeating = np.sqrt(2.0) * left[of] * np.sin(phase)
        return np.asarray(repeating + np.array(self.noise)[of] * rng.standard_normal(count))

    def draw_peak(self, rng: np.random.Generator, count: int) -> Array:
        """(count,) largest departures of further recordings, N·m: log-normal, its mean and spread themselves uncertain."""
        logs, known = np.log(self.peak), len(self.peak) - 1 + PEAK_DEGREES
        square = (np.sum((logs - logs.mean()) ** 2) + PEAK_DEGREES * PEAK_SPREAD**2) / known
        spread = math.sqrt(square * (1 + 1 / len(logs)))
        return np.asarray(np.exp(logs.mean() + spread * rng.standard_t(known, size=count)))


@dataclass(frozen=True, eq=False)
class Harmonics(Value):
    """Torque about its mean in one direction: Σ_k cosine_k cos(order_k θ) + sine_k sin(order_k θ), θ the motor angle."""

    orders: tuple[Positive, ...]
    """Periods per turn of the motor; below 1: of the wheel."""
    cosine: tuple[float, ...]
    """N·m."""
    sine: tuple[float, ...]
    """N·m."""
    phased: bool
    """Whether the angle was recorded, so that phases hold for other recordings too; else the amplitudes alone do."""

    def _check(self) -> None:
        for name in ("cosine", "sine"):
            if len(getattr(self, name)) != len(self.orders):
                raise self._wrong(
                    name, "not one figure for each order", f"{len(self.orders)} figures"
                )

    @property
    def amplitudes(self) -> Array:
        """(orders,) N·m."""
        return np.hypot(self.cosine, self.sine)

    def torque(self, angle: Array) -> Array:
        """(samples,) N·m at motor angles (samples,), rad."""
        waves = np.outer(angle, self.orders)
        return np.asarray(
            np.cos(waves) @ np.array(self.cosine) + np.sin(waves) @ np.array(self.sine)
        )

    def turned(self, start: float) -> Harmonics:
        """The same with the angle counted from `start`, rad."""
        turned = (np.array(self.cosine) - 1j * np.array(self.sine)) * np.exp(
            1j * start * np.array(self.orders)
        )
        return Harmonics(
            self.orders, tuple(turned.real.tolist()), tuple((-turned.imag).tolist()), self.phased
        )

    def to_dict(self) -> dict[str, Any]:
        """The object that `identify --json` prints of one direction."""
        return {
            "orders": self.orders,
            "amplitudes": self.amplitudes.tolist(),
            "cosine": self.cosine,
            "sine": self.sine,
            "phased": self.phased,
        }


@dataclass(frozen=True, eq=False)
class Posterior(Value):
    """Sets of friction parameters that recordings make equally likely; SI."""

    names: tuple[str, ...]
    """Of the columns: parameters of Friction, `preload`, LOAD_OFFSET; LAW where not all sets are of the drive's law."""
    draws: Annotated[Array, Shape((-1, -1))]
    """(sets, parameters)."""
    scatter: NotNegative = 0.0
    """Of the mean torque from one recording to the next, N·m: t-distributed, since some recordings stand apart."""
    common: NotNegative = 0.0
    """Share of the scatter's variance that recordings of near speed have in common: the law's own error."""
    speeds: tuple[float, ...] = ()
    """Motor speeds of the recordings, rad/s, outliers left out."""
    departures: tuple[float, ...] = ()
    """Their mean torque beyond that of the drive's own parameters, N·m."""
    forwards: Ripple | None = None
    """Ripple and noise in positive motion."""
    backwards: Ripple | None = None
    """Ripple and noise in negative motion."""
    harmonics_forwards: Harmonics | None = None
    """What of the ripple repeats with the motor's angle in positive motion; None: not known."""
    harmonics_backwards: Harmonics | None = None
    """The same in negative motion."""

    def _check(self) -> None:
        known = (*FRICTION_NAMES, LOAD_OFFSET, LAW)
        for name in self.names:
            if name not in known:
                raise self._wrong("names", "unknown parameter", ", ".join(known), name)
        if len(self.speeds) != len(self.departures) or 0.0 in self.speeds:
            raise self._wrong(
                "departures", "not one for each moving recording", f"{len(self.speeds)} figures"
            )
        if self.common >= 1:
            raise self._wrong("common", "all of the scatter and more", "a share from 0, below 1")
        if len(set(self.names)) != len(self.names):
            raise self._wrong("names", "a parameter is named twice", "each once")
        if self.draws.shape[1] != len(self.names) or len(self.draws) < 2:
            raise self._wrong(
                "draws",
                "not one column for each name",
                "two sets of parameters or more",
                f"shape {self.draws.shape}",
            )
        for name, column in zip(self.names, self.draws.T, strict=True):
            if name != LOAD_OFFSET and column.min() < 0:
                raise self._wrong(
                    "draws", f"friction is not negative: {name}", "0 or more", float(column.min())
                )
        if LAW in self.names and not np.isin(self.column(LAW), range(len(LAWS))).all():
            allowed = ", ".join(f"{k} ({law})" for k, law in enumerate(LAWS))
            raise self._wrong("draws", "not the number of a law", allowed)

    @property
    def recordings(self) -> int:
        """How many stand behind it, as far as it tells."""
        return sum(
            len(ripple.torque) for ripple in (self.forwards, self.backwards) if ripple is not None
        )

    def column(self, name: str) -> Array:
        """(sets,) of one parameter."""
        return np.asarray(self.draws[:, self.names.index(name)])

    def interval(self, name: str, confidence: float = CONFIDENCE) -> tuple[float, float]:
        """Central interval of one parameter."""
        return interval_of(self.column(name), confidence)

    def law_shares(self, law: str) -> dict[str, float]:
        """Share of the sets of every law among them, the most first; law: the drive's."""
        if LAW not in self.names:
            return {law: 1.0}
        shares = {name: float(np.mean(self.column(LAW) == k)) for k, name in enumerate(LAWS)}
        return {
            name: share
            for name, share in sorted(shares.items(), key=lambda pair: -pair[1])
            if share
        }

    def ripple(self, direction: int) -> Ripple | None:
        """In motion of a direction (±1)."""
        return self.forwards if direction > 0 else self.backwards

    def harmonics(self, direction: int) -> Harmonics | None:
        """In motion of a direction (±1)."""
        return self.harmonics_forwards if direction > 0 else self.harmonics_backwards

    def values(self, count: int | None = None) -> Mapping[str, Array]:
        """Parameters by name, (count,) each: the sets one after the other, from the first again where there are too few."""
        rows = np.arange(len(self.draws) if count is None else count) % len(self.draws)
        return {name: self.draws[rows, i] for i, name in enumerate(self.names)}
