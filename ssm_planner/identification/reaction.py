"""Fit the reaction of the speed controller, which a recording contains beside the friction.

The controller answers a deviation of the speed from its usual value with torque. In the recorded
channels, this torque is a short linear filter of the deviation v [1]:

    τ(t) = Σ_k h_k v(t − d_k),

with the delays d_k (`FILTER_DELAYS`) and the taps h_k, which `fit_reaction` fits. The recorder
averages the speed, so it shows a deviation after the controller has answered it. Some delays d_k
are therefore negative. The mean torque does not contain this reaction, and planning does not need
it. It explains a part of the ripple when recorded torque is predicted.

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
"""Largest deviation of the speed that the controller is assumed to answer.

It is a share of the usual speed of the motion. Larger deviations are starts and stops.
"""


def fit_reaction(recordings: Sequence[Recording]) -> Reaction | None:
    """Fit the filter of the speed controller to steady-state recordings by least squares.

    The filter that is returned is fitted to all recordings together. In addition, a filter that is
    fitted to all other recordings predicts each recording. This shows which share of the variance
    of its torque the filter explains, and thus at which speeds the filter can be trusted.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings at constant speed.

    Returns
    -------
    Reaction or None
        Filter and explained shares. None for fewer than two recordings.
    """
    if len(recordings) < 2:
        return None
    ordered = sorted(recordings, key=lambda recording: float(recording.w.mean()))
    products = np.array([_mean_products(recording) for recording in ordered])
    errors = np.array([_error_factors(products.sum(axis=0) - product) for product in products])
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
    """Compute the mean products of all pairs of channels, from which filters are fitted.

    The channels are the deviations of the speed with each delay, and, in the last place, the
    deviation of the torque. The products of several recordings can be added to fit one filter to
    all of them.

    Parameters
    ----------
    recording : Recording
        Recording at constant speed.

    Returns
    -------
    (delays + 1, delays + 1) array
        Mean products of the channels (rad²/s², N·m·rad/s or N²·m²).
    """
    delayed = delayed_signals(recording.time, recording.w - recording.w.mean())
    channels = np.column_stack([delayed, recording.tau - recording.tau.mean()])
    return channels.T @ channels / len(channels)


def _error_factors(products: Array) -> Array:
    """Fit the taps of the filter, and return the factors of its error.

    The error is the torque minus the filtered speed. It is the sum of the channels of
    `_mean_products` multiplied by these factors.

    Parameters
    ----------
    products : (delays + 1, delays + 1) array
        Mean products of the channels.

    Returns
    -------
    (delays + 1,) array
        Negative taps −h_k (N·m·s/rad), and the factor 1 of the torque.
    """
    taps = np.linalg.lstsq(products[:-1, :-1], products[:-1, -1], rcond=1e-9)[0]
    return np.append(-taps, 1.0)


def delayed_signals(time: Array, deviation: Array, delays: Array = FILTER_DELAYS) -> Array:
    """Delay a signal by several times, with linear interpolation between samples.

    Parameters
    ----------
    time : (samples,) array
        Increasing times (s).
    deviation : (samples,) array
        Values of the signal. Its first and last values continue before and after it.
    delays : (delays,) array
        Delays (s), positive or negative.

    Returns
    -------
    (samples, delays) array
        Delayed signals in the unit of the signal.
    """
    return np.stack([np.interp(time - delay, time, deviation) for delay in delays], axis=1)


def speed_deviation(w: Array, direction: Array) -> Array:
    """Compute how far the speed is from its usual value during each motion.

    A motion is a sequence of samples without a rest. Its usual speed is the median of its speeds.

    Parameters
    ----------
    w : (samples,) array
        Motor speeds (rad/s).
    direction : (samples,) array
        Direction of motion, ±1, or 0 at rest.

    Returns
    -------
    (samples,) array
        Deviations (rad/s). They are 0 at rest, and where they exceed the share `LARGEST_DEVIATION`
        of the usual speed, because the motor then starts or stops.
    """
    deviation = np.zeros(len(w))
    for start, stop in true_runs(direction != 0):
        usual = np.median(w[start:stop])
        difference = w[start:stop] - usual
        is_regular = np.abs(difference) <= LARGEST_DEVIATION * abs(usual)
        deviation[start:stop] = np.where(is_regular, difference, 0.0)
    return deviation
