"""Fit the reaction of the speed controller, which a recording contains beside the friction.

The controller answers a deviation of the speed with torque. In the recorded channels, this torque is a
short linear filter of the recorded deviation v [1]: the sum over k of h_k v(t − d_k). The recorder
averages the speed, so it shows a deviation after the controller has answered it. Some delays d_k are
therefore negative. The mean torque does not contain this reaction, and planning does not need it.

[1] L. Ljung, System Identification: Theory for the User, 2nd ed., 1999, chapter 13 (closed loops).
"""

from collections.abc import Sequence

import numpy as np

from ssm_planner.identification.recordings import Recording, runs
from ssm_planner.problem import Reaction
from ssm_planner.typing import Array

DELAYS = 0.05 * np.arange(-3.0, 4.0)
"""Delays d_k of the filter, s."""
LARGEST_DEVIATION = 0.1
"""Deviation from the usual speed of a motion, as a share of it, above which the motor starts or stops.
"""


def fit_reaction(recordings: Sequence[Recording]) -> Reaction | None:
    """Fit the filter to steady-state recordings by least squares.

    The filter of all other recordings predicts each recording, which gives the explained shares of
    the ripple's variance. The result is None for fewer than two recordings.
    """
    if len(recordings) < 2:
        return None
    ordered = sorted(recordings, key=lambda recording: float(recording.w.mean()))
    squares, products, variances = [], [], []
    for recording in ordered:
        columns = shifted(recording.time, recording.w - recording.w.mean())
        torque = recording.tau - recording.tau.mean()
        squares.append(columns.T @ columns / len(torque))
        products.append(columns.T @ torque / len(torque))
        variances.append(torque @ torque / len(torque))
    square, product = np.sum(squares, axis=0), np.sum(products, axis=0)
    explained = []
    for own_square, own_product, variance in zip(squares, products, variances, strict=True):
        taps = _solution(square - own_square, product - own_product)
        explained.append((2 * taps @ own_product - taps @ own_square @ taps) / variance)
    return Reaction(
        delays=tuple(DELAYS.tolist()),
        taps=tuple(_solution(square, product).tolist()),
        speeds=tuple(float(recording.w.mean()) for recording in ordered),
        deviations=tuple(np.sqrt(variances).tolist()),
        explained=tuple(np.maximum(explained, 0.0).tolist()),
    )


def _solution(square: Array, product: Array) -> Array:
    """Return the taps (delays,) of the normal equations, with the smallest norm if several solve them."""
    return np.asarray(np.linalg.lstsq(square, product, rcond=1e-9)[0])


def shifted(time: Array, deviation: Array, delays: Array = DELAYS) -> Array:
    """Return a deviation (samples,) delayed by each of the delays in s, (samples, delays)."""
    return np.stack([np.interp(time - delay, time, deviation) for delay in delays], axis=1)


def deviation_of(w: Array, direction: Array) -> Array:
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
    for start, stop in runs(direction != 0):
        usual = np.median(w[start:stop])
        difference = w[start:stop] - usual
        is_regular = np.abs(difference) <= LARGEST_DEVIATION * abs(usual)
        deviation[start:stop] = np.where(is_regular, difference, 0.0)
    return deviation
