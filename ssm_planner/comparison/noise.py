"""Estimate the noise of a recorded channel and find values that exceed it."""

from __future__ import annotations

import numpy as np

from ssm_planner.typing import Array, Indices, Mask

WINDOWS = (10e-3, 40e-3)
"""Durations of the means that are compared with limits, s."""
CERTAIN = 5.0
"""Significant standard deviations of a mean; noise of some thousand samples reaches 4."""
CERTAIN_ALONE = 8.0
"""Significant standard deviations of a sample, because the distribution of its noise is unknown."""
LEAST = 4
"""Smallest number of samples in a window."""
_SHARE = 0.9
_TO_SIGMA = 1 / 1.6449
"""Quantile of the second differences, and the factor to a standard deviation if they are normal."""


def smoothed(values: Array, n: int) -> Array:
    """Return the means of n consecutive samples, (samples − n + 1,)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return (total[n:] - total[:-n]) / n


def noise_of(departure: Array, n: int, resolution: float) -> float:
    """Return the standard deviation of the noise of means of n samples.

    departure (samples,): measured minus expected values. The estimate is a quantile of second
    differences at a distance of n samples, so slow errors and rare faults do not count. It is at
    least the rounding error of the resolution.
    """
    mean = smoothed(departure, n) if len(departure) >= n else departure
    rounding = resolution / np.sqrt(12.0 * n)
    if len(mean) <= 2 * n:
        return float(rounding)
    differences = mean[2 * n :] - 2 * mean[n:-n] + mean[: -2 * n]
    return float(max(_TO_SIGMA * np.quantile(np.abs(differences), _SHARE) / np.sqrt(6.0), rounding))


def windows(step: float) -> list[tuple[int, float]]:
    """Return (samples, significant number of standard deviations) for a single sample and every
    window.

    step: s per sample.
    """
    return [
        (1, CERTAIN_ALONE),
        *((max(LEAST, round(length / step)), CERTAIN) for length in WINDOWS),
    ]


def worst_excess(
    values: Array, departure: Array, limit: float, step: float, resolution: float
) -> tuple[float, float, float]:
    """Return (largest |mean|, its possible noise, window in s) for the window with the largest
    excess.

    values (n,): compared with `limit`. departure (m,): measured minus expected. step: s per sample.
    resolution: of the channel, in its unit.
    """
    candidates = []
    for n, certain in windows(step):
        if len(values) >= n:
            # rounding shifts a mean by up to half a step if the noise is smaller than a step
            noise = certain * noise_of(departure, n, resolution) + resolution / 2
            maximum = float(np.abs(smoothed(values, n)).max())
            candidates.append((maximum - limit - noise, maximum, noise, n * step if n > 1 else 0.0))
    return max(candidates)[1:]


def runs(flags: Mask) -> Indices:
    """Return the (first, one past last) indices (m, 2) of every run of true values."""
    return np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).reshape(
        -1, 2
    )


def longest_run(flags: Mask, time: Array) -> tuple[int, int, float]:
    """Return (first index, last index, duration in s) of the longest run of true values; zeros if
    there is none.
    """
    stretches = [(int(a), int(b) - 1, float(time[b - 1] - time[a])) for a, b in runs(flags)]
    return max(stretches, key=lambda stretch: stretch[2], default=(0, 0, 0.0))
