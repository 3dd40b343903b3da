"""Estimate the noise of a recorded channel, and find values that exceed it.

`findings` compares means over several windows with the limits. Long windows contain less noise, and
short windows show short faults.
"""

import numpy as np

from ssm_planner.identification import true_runs
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
    """Compute the mean of every n consecutive values.

    Parameters
    ----------
    values : (samples,) array
        Values of a channel.
    n : int
        Number of values in a mean.

    Returns
    -------
    (samples − n + 1,) array
        Means, in the order of their first values.
    """
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

    Returns
    -------
    float
        Standard deviation in the unit of the values.

    Notes
    -----
    A second difference of three independent means with the standard deviation σ has the standard
    deviation √6 σ. Rounding to multiples of the resolution has the standard deviation resolution /
    √12.
    """
    mean = moving_means(departure, n)
    rounding = resolution / np.sqrt(12.0 * n)
    if len(mean) <= 2 * n:
        # The recording is too short for differences at this distance.
        return float(rounding) if n == 1 else estimate_noise(departure, 1, resolution) / np.sqrt(n)
    differences = mean[2 * n :] - 2 * mean[n:-n] + mean[: -2 * n]
    sigma = _SIGMA_PER_MEDIAN * np.median(np.abs(differences)) / np.sqrt(6.0)
    return float(max(sigma, rounding))


def averaging_windows(step: float) -> list[tuple[int, float]]:
    """Return the windows over which measured values are averaged.

    The first window is a single sample, and the others have the durations `WINDOW_DURATIONS`.

    Parameters
    ----------
    step : float
        Sampling period, s.

    Returns
    -------
    list of (int, float)
        Number of samples of each window, and number of standard deviations beyond which a mean over
        this window is significant.
    """
    result = [(1, SIGNIFICANT_SAMPLE_DEVIATIONS)]
    for duration in WINDOW_DURATIONS:
        result.append((max(MIN_WINDOW_SAMPLES, round(duration / step)), SIGNIFICANT_DEVIATIONS))
    return result


def longest_run(flags: Mask, time: Array) -> tuple[int, int, float]:
    """Find the longest run, that is, the longest sequence of consecutive true values.

    Parameters
    ----------
    flags : (n,) array of bool
        The values.
    time : (n,) array
        Instants of the values, s.

    Returns
    -------
    first, last : int
        Indices of the first and the last value of the run.
    duration : float
        Duration of the run, s. All three results are 0 if no value is true.
    """
    longest = (0, 0, -1.0)
    for first, stop in true_runs(flags):
        duration = float(time[stop - 1] - time[first])
        if duration > longest[2]:
            longest = (first, stop - 1, duration)
    return longest if flags.any() else (0, 0, 0.0)
