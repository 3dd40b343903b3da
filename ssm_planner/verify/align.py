"""When in a recording a planned motion happens: the delay at which the two speeds differ least."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.problem.values import Array

SAMPLES = 4000
DELAYS = 400
"""Delays tried at each of the zooms."""
FINEST = 1e-5
"""s."""


@dataclass(frozen=True)
class Alignment:
    """delay: time of the recording at which the motion begins, s; correlation of the two speeds there."""

    delay: float
    correlation: float
    reversed_correlation: float
    """The best correlation with the recording's sign reversed."""


def align(planned_time: Array, planned: Array, time: Array, measured: Array) -> Alignment:
    """Alignment of a measured speed with a planned one (from time 0, at rest before and after); arrays of samples."""
    step = max(1, len(time) // SAMPLES)
    t, w = time[::step], measured[::step]
    duration = float(planned_time[-1])
    if not planned.any() or not w.any():
        still = float(not planned.any() and np.abs(measured).max(initial=0.0) == 0.0)
        return Alignment(float(time[0]), still, 0.0)
    best, other = _search(planned_time, planned, t, w, duration), _search(planned_time, planned, t, -w, duration)
    return Alignment(best[0], best[1], other[1])


def _search(planned_time: Array, planned: Array, t: Array, w: Array, duration: float) -> tuple[float, float]:
    """(delay, correlation): zooming grids over the squared difference."""
    low, high = float(t[0]) - duration, float(t[-1])
    # coarser than the motion's own features the first grid must not be
    count = int(np.clip((high - low) / (duration / 100), DELAYS, 20 * DELAYS))
    delay = low
    while high - low > FINEST:
        delays = np.linspace(low, high, count)
        cost = [float(np.sum((w - _at(planned_time, planned, t - each)) ** 2)) for each in delays]
        delay = float(delays[int(np.argmin(cost))])
        around = 2 * (high - low) / (count - 1)
        low, high, count = delay - around, delay + around, 41
    shifted = _at(planned_time, planned, t - delay)
    size = float(np.linalg.norm(shifted) * np.linalg.norm(w))
    return delay, float(shifted @ w) / size if size > 0 else 0.0


def _at(planned_time: Array, planned: Array, t: Array) -> Array:
    return np.interp(t, planned_time, planned, left=0.0, right=0.0)
