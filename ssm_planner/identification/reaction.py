"""Fit the reaction of the speed controller, which a recording contains beside the friction.

The controller answers a deviation of the speed with torque. In the recorded channels, this torque
is a short linear filter of the recorded deviation v [1]: the sum over k of h_k v(t − d_k). The
recorder averages the speed, so it shows a deviation after the controller has answered it. Some
delays d_k are therefore negative. The mean torque does not contain this reaction, and planning does
not need it.

[1] L. Ljung, System Identification: Theory for the User, 2nd ed., 1999, chapter 13 (closed loops).
"""

from collections.abc import Sequence

import numpy as np

from ssm_planner.identification.recordings import Recording, true_runs
from ssm_planner.problem import Reaction
from ssm_planner.typing import Array

FILTER_DELAYS = 0.05 * np.arange(-3.0, 4.0)
"""Delays d_k of the filter, s."""
LARGEST_DEVIATION = 0.1
"""Deviation from the usual speed of a motion, as a share of it, above which the motor starts or
stops.
"""


def fit_reaction(recordings: Sequence[Recording]) -> Reaction | None:
    """Fit the filter to steady-state recordings by least squares.

    The filter of all other recordings predicts each recording, which gives the explained shares of
    the ripple's variance. The result is None for fewer than two recordings.
    """
    if len(recordings) < 2:
        return None
    ordered = sorted(recordings, key=lambda recording: float(recording.w.mean()))
    products = np.array([_mean_products(recording) for recording in ordered])
    errors = np.array([_error_factors(products.sum(axis=0) - own) for own in products])
    remaining = np.einsum("ki,kij,kj->k", errors, products, errors)
    variance = products[:, -1, -1]
    return Reaction(
        delays=tuple(FILTER_DELAYS.tolist()),
        taps=tuple((-_error_factors(products.sum(axis=0))[:-1]).tolist()),
        speeds=tuple(float(recording.w.mean()) for recording in ordered),
        deviations=tuple(np.sqrt(variance).tolist()),
        explained=tuple(np.maximum(1 - remaining / variance, 0.0).tolist()),
    )


def _mean_products(recording: Recording) -> Array:
    """Return the mean products (delays + 1, delays + 1) of the delayed speeds and the torque."""
    delayed = delayed_signals(recording.time, recording.w - recording.w.mean())
    channels = np.column_stack([delayed, recording.tau - recording.tau.mean()])
    return channels.T @ channels / len(channels)


def _error_factors(products: Array) -> Array:
    """Return the factors (delays + 1,) of speeds and torque whose sum is the unexplained torque."""
    taps = np.linalg.lstsq(products[:-1, :-1], products[:-1, -1], rcond=1e-9)[0]
    return np.append(-taps, 1.0)


def delayed_signals(time: Array, deviation: Array, delays: Array = FILTER_DELAYS) -> Array:
    """Return a deviation (samples,) delayed by each of the delays in s, (samples, delays)."""
    return np.stack([np.interp(time - delay, time, deviation) for delay in delays], axis=1)


def speed_deviation(w: Array, direction: Array) -> Array:
    """Return the deviations from the usual speed of each motion, (samples,) in rad/s.

    They are 0 at rest, and while the motor starts or stops.

    Parameters
    ----------
    w : (samples,)
        Motor speed, rad/s.
    direction : (samples,)
        Direction of motion, ±1, or 0 at rest.
    """
    deviation = np.zeros(len(w))
    for start, stop in true_runs(direction != 0):
        usual = np.median(w[start:stop])
        difference = w[start:stop] - usual
        is_regular = np.abs(difference) <= LARGEST_DEVIATION * abs(usual)
        deviation[start:stop] = np.where(is_regular, difference, 0.0)
    return deviation
