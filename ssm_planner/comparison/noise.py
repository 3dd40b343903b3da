"""Estimate the noise of a recorded channel, and find values that exceed it."""

import numpy as np

from ssm_planner.identification import runs
from ssm_planner.typing import Array, Mask

WINDOW_DURATIONS = (10e-3, 40e-3)
"""Durations of the means that are compared with limits, s."""
SIGNIFICANT_DEVIATIONS = 5.0
"""Number of standard deviations beyond which a mean is significant.

The noise of some thousand samples reaches 4.
"""
SIGNIFICANT_SAMPLE_DEVIATIONS = 8.0
"""Number of standard deviations beyond which a single sample is significant.

It is larger, because the distribution of the noise is unknown.
"""
MIN_WINDOW_SAMPLES = 4
"""Smallest number of samples in a window."""
MAX_NOISE_RATIO = 0.1
"""Ratio of noise to limit above which no verdict is possible."""
_SIGMA_PER_MEDIAN = 1 / 0.6745
"""Ratio of standard deviation to median magnitude for a normal distribution."""


def moving_means(values: Array, n: int) -> Array:
    """Return the means (samples − n + 1,) of every n consecutive values (samples,)."""
    total = np.append(0.0, np.cumsum(values))
    return (total[n:] - total[:-n]) / n


def estimate_noise(departure: Array, n: int, resolution: float) -> float:
    """Estimate the standard deviation of the noise in means of n samples.

    The estimate is the median of second differences at a distance of n samples. Slow errors and
    faults in less than half of the samples do not affect it. It is at least the rounding error.

    Parameters
    ----------
    departure : (samples,)
        Measured minus expected values.
    n : int
        Number of samples in a mean.
    resolution : float
        Resolution of the channel, in the unit of the values.
    """
    mean = moving_means(departure, n)
    rounding = resolution / np.sqrt(12.0 * n)
    if len(mean) <= 2 * n:
        return float(rounding) if n == 1 else estimate_noise(departure, 1, resolution) / np.sqrt(n)
    differences = mean[2 * n :] - 2 * mean[n:-n] + mean[: -2 * n]
    return float(max(_SIGMA_PER_MEDIAN * np.median(np.abs(differences)) / np.sqrt(6.0), rounding))


def averaging_windows(step: float) -> list[tuple[int, float]]:
    """Return the number of samples and the significance of every window.

    The first window is a single sample, and the others have the durations `WINDOW_DURATIONS`. The
    significance is the number of standard deviations beyond which a mean is significant. `step` is
    the sampling period, s.
    """
    result = [(1, SIGNIFICANT_SAMPLE_DEVIATIONS)]
    for duration in WINDOW_DURATIONS:
        result.append((max(MIN_WINDOW_SAMPLES, round(duration / step)), SIGNIFICANT_DEVIATIONS))
    return result


def longest_run(flags: Mask, time: Array) -> tuple[int, int, float]:
    """Return the first index, the last index and the duration (s) of the longest run.

    A run is a sequence of true values in `flags` (n,) at the instants `time` (n,). The result is
    (0, 0, 0.0) without a run.
    """
    candidates = [(a, b - 1, float(time[b - 1] - time[a])) for a, b in runs(flags)]
    return max(candidates, key=lambda run: run[2], default=(0, 0, 0.0))
