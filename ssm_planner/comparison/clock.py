"""The clock of recordings: where on their time axis a planned motion begins, and how fast their time runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ssm_planner.typing import Array

SAMPLES = 4000
DELAYS = 400
"""Delays tried at each of the zooms."""
FINEST = 1e-5
"""s."""
FAR = 0.3
"""Share of the planned peak speed: samples farther from the plan say nothing of the clock."""
FASTEST = 0.05
"""Largest difference of two clocks' rates that is looked for."""
FOLLOWS = 0.05
"""Share by which the size of an axis's speed may differ from the plan's where it tells of the clock."""
ALIKE = 0.98
"""Correlation of the speeds of an axis that tells of the clock."""
ENDS = 0.05
"""Share of the planned peak speed: after the last sample beyond it a motion has ended."""
CERTAIN = 5.0
"""Standard deviations."""


@dataclass(frozen=True)
class Alignment:
    """One axis on its own; delay: time of the recording at which the motion begins, s; correlation of the speeds there."""

    delay: float
    correlation: float
    reversed_correlation: float
    """The best correlation with the recording's sign reversed."""
    rate: float = 1.0
    """Planned time that passes in one second of the recording."""
    rate_error: float = np.inf
    """Standard deviation of the rate."""
    delay_error: float = np.inf
    """Standard deviation of the delay, s."""
    size: float = 1.0
    """Measured speed over planned speed."""
    agreement: float = 0.0
    """Correlation up to where the measured motion ends: a motor that stops on its way agrees with its plan until then."""


@dataclass(frozen=True)
class Clock:
    """Of all recordings together: planned time = rate · (time of the recordings − delay)."""

    delay: float
    rate: float
    """1 unless the recordings' clock is certainly another: then what was estimated."""
    estimated_rate: float
    rate_error: float
    """Standard deviation."""
    slower: bool
    """The speeds are smaller by the rate too: the motion was played slower, and the clock is right."""

    def planned(self, time: Array) -> Array:
        """Planned times (n,) of the recordings' times (n,), s from the motion's start."""
        return self.rate * (time - self.delay)


def align(planned_time: Array, planned: Array, time: Array, measured: Array) -> Alignment:
    """Alignment of a measured speed with a planned one (from time 0, at rest before and after); arrays of samples."""
    step = max(1, len(time) // SAMPLES)
    t, w = time[::step], measured[::step]
    if not planned.any() or not w.any():
        still = float(not planned.any() and np.abs(measured).max(initial=0.0) == 0.0)
        return Alignment(float(time[0]), still, 0.0)
    moves = np.flatnonzero(np.abs(w) > ENDS * np.abs(planned).max())
    end = int(moves[-1]) + 2 if len(moves) else len(w)
    best, other = (_search(planned_time, planned, t[:end], sign * w[:end]) for sign in (1, -1))
    delay, rate, size, errors = _refined(best[0], planned_time, planned, t[:end], w[:end])
    expected = at(planned_time, planned, rate * (t - delay))
    return Alignment(
        delay,
        correlation=correlation(expected, w),
        reversed_correlation=other[1],
        rate=rate,
        rate_error=errors[1],
        delay_error=errors[0],
        size=size,
        agreement=correlation(expected[:end], w[:end]),
    )


def clock_of(axes: Sequence[Alignment], drift: float) -> Clock:
    """One clock from the alignments of every axis: axes whose speed is much as planned tell of it, of several the median.

    drift: share by which the rate must be off, beyond its uncertainty, to count.
    """
    good = [
        a
        for a in axes
        if a.agreement >= ALIKE and abs(a.size - 1) <= FOLLOWS and np.isfinite(a.rate_error)
    ]
    told = good or [max(axes, key=lambda axis: axis.agreement)]
    weights = np.array([1 / axis.rate_error**2 for axis in good])
    rate, error = 1.0, np.inf
    if good:
        rate = float(np.median([axis.rate for axis in good]))
        error = float(1 / np.sqrt(weights.sum()))
        if np.ptp([axis.rate for axis in good]) <= CERTAIN * max(axis.rate_error for axis in good):
            rate = float(np.average([axis.rate for axis in good], weights=weights))
    certain = abs(rate - 1) > drift + CERTAIN * error
    size = float(np.median([axis.size for axis in told]))
    slower = certain and abs(size - rate) < abs(size - 1)
    delay = float(np.median([axis.delay for axis in told]))
    return Clock(delay, rate if certain and not slower else 1.0, rate, error, slower)


def at(planned_time: Array, planned: Array, t: Array) -> Array:
    """A planned speed at times t (n,); at rest before and after."""
    return np.interp(t, planned_time, planned, left=0.0, right=0.0)


def _search(planned_time: Array, planned: Array, t: Array, w: Array) -> tuple[float, float]:
    """(delay, correlation): zooming grids over the squared difference, where it is not far."""
    duration = float(planned_time[-1])
    low, high = float(t[0]) - duration, float(t[-1])
    far = FAR * float(np.abs(planned).max())
    # the first grid is finer than the features of the motion
    count = int(np.clip((high - low) / (duration / 100), DELAYS, 20 * DELAYS))
    delay = low
    while high - low > FINEST:
        delays = np.linspace(low, high, count)
        apart = (np.abs(w - at(planned_time, planned, t - each)) for each in delays)
        cost = [float(np.sum(np.minimum(each, far) ** 2)) for each in apart]
        delay = float(delays[int(np.argmin(cost))])
        around = 2 * (high - low) / (count - 1)
        low, high, count = delay - around, delay + around, 41
    return delay, correlation(at(planned_time, planned, t - delay), w)


def correlation(first: Array, second: Array) -> float:
    """Of two speeds (n,); 0 where one of them is nowhere but 0."""
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(first @ second) / size if size > 0 else 0.0


def _refined(
    begin: float, planned_time: Array, planned: Array, t: Array, w: Array
) -> tuple[float, float, float, tuple[float, float]]:
    """(delay, rate, size, errors of delay and rate) by Gauss–Newton steps on the samples that are not far from the plan;
    where they tell nothing the delay that it began with, and infinite errors."""
    unknown = begin, 1.0, 1.0, (np.inf, np.inf)
    slope, far = np.gradient(planned, planned_time), FAR * float(np.abs(planned).max())
    duration = float(planned_time[-1])
    # the place of the samples' middle hardly depends on the rate
    middle = float(np.clip(np.mean(t) - begin, 0.0, duration))
    centre, rate, size = begin + middle, 1.0, 1.0
    for _ in range(12):
        s = rate * (t - centre) + middle
        p, dp = at(planned_time, planned, s), size * at(planned_time, slope, s)
        residual = w - size * p
        near = (np.abs(residual) < far) & ((p != 0) | (dp != 0))
        jacobian = np.stack([-rate * dp, dp * (t - centre), p], axis=1)[near]
        normal = jacobian.T @ jacobian
        if near.sum() < 8 or np.linalg.cond(normal) > 1e14:
            return unknown
        change = np.linalg.solve(normal, jacobian.T @ residual[near])
        rate = float(np.clip(rate + change[1], 1 - FASTEST, 1 + FASTEST))
        centre, size = centre + float(change[0]), size + float(change[2])
    errors = np.sqrt(np.diag(np.linalg.inv(normal)) * float(np.mean(residual[near] ** 2)))
    delay = centre - middle / rate
    better = np.sum((w - size * at(planned_time, planned, rate * (t - delay))) ** 2)
    if (
        not better <= np.sum((w - at(planned_time, planned, t - begin)) ** 2)
        or abs(delay - begin) > 0.1 * duration
    ):
        return unknown
    return delay, rate, size, (float(errors[0]), float(errors[1]))
