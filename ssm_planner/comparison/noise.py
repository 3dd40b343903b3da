"""Noise of a recorded channel, estimated from itself, and what stands out of it."""

from __future__ import annotations

import numpy as np

from ssm_planner.formats.points import Flags
from ssm_planner.typing import Array, Indices

WINDOWS = (10e-3, 40e-3)
"""s: values are averaged over these before they are held against a limit."""
CERTAIN = 5.0
"""Standard deviations by which an averaged value stands out; some thousand samples of noise reach 4."""
CERTAIN_ALONE = 8.0
"""Of a single sample, whose noise has no known distribution."""
LEAST = 4
"""Samples in the shortest window."""
_SHARE, _TO_SIGMA = 0.9, 1 / 1.6449
"""Of the second differences, and the standard deviation of a normal distribution over their quantile."""


def smoothed(values: Array, n: int) -> Array:
    """Means of n samples in turn, (samples − n + 1,)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray((total[n:] - total[:-n]) / n)


def noise_of(departure: Array, n: int, resolution: float) -> float:
    """Standard deviation of the noise of means of n samples.

    departure (samples,): measured minus expected. From second differences at a distance of n samples, by a quantile of
    them, so that neither slow errors nor rare faults count; no less than rounding to the resolution gives.
    """
    mean = smoothed(departure, n) if len(departure) >= n else departure
    least = resolution / np.sqrt(12.0 * n)
    if len(mean) <= 2 * n:
        return float(least)
    second = mean[2 * n :] - 2 * mean[n:-n] + mean[: -2 * n]
    return float(max(_TO_SIGMA * np.quantile(np.abs(second), _SHARE) / np.sqrt(6.0), least))


def windows(step: float) -> list[tuple[int, float]]:
    """(samples, standard deviations that stand out) of a single sample and of every window; step: s per sample."""
    return [
        (1, CERTAIN_ALONE),
        *((max(LEAST, round(length / step)), CERTAIN) for length in WINDOWS),
    ]


def worst_excess(
    values: Array, departure: Array, limit: float, step: float, resolution: float
) -> tuple[float, float, float]:
    """(largest |mean|, what noise may add to it, window in s) of the window in which values (n,) exceed the limit most."""
    found = []
    for n, certain in windows(step):
        if len(values) >= n:
            # where noise is less than a step of the channel, rounding moves a mean by up to half a step
            noise = certain * noise_of(departure, n, resolution) + resolution / 2
            largest = float(np.abs(smoothed(values, n)).max())
            found.append((largest - limit - noise, largest, noise, n * step if n > 1 else 0.0))
    return max(found)[1:]


def runs(flags: Flags) -> Indices:
    """(first, one past last) of every stretch of true (m, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).reshape(
        -1, 2
    )


def longest(flags: Flags, time: Array) -> tuple[int, int, float]:
    """(first, last, s) of the longest stretch of true; 0 s where there is none."""
    stretches = [(int(a), int(b) - 1, float(time[b - 1] - time[a])) for a, b in runs(flags)]
    return max(stretches, key=lambda each: each[2], default=(0, 0, 0.0))
