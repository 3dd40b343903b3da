"""Fit the part of the torque that repeats with the angle of the motor, and with that of the wheel.

`fit_harmonics` is the main function. The torque is a sum of harmonics: sines and cosines with 1, 2
and 3 periods in one turn of the screw or worm, and in one turn of the wheel. If the recordings
contain the motor angle, all recordings in one direction are fitted together. Otherwise, the angle
is the integral of the speed from an unknown start. The harmonics of such recordings are rotated,
that is, their angle is counted from another zero, until they agree. Only their amplitudes are then
valid.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ssm_planner.identification.recordings import Recording, trapezoidal_integral
from ssm_planner.problem import Harmonics
from ssm_planner.typing import Array

FULL_TURN = 2 * np.pi
HARMONICS = 3
"""Number of harmonics of one turn of the motor, and of one turn of the wheel."""
_TRIAL_ANGLES = 720
"""Number of angles that are tried when harmonics are rotated."""
_ALIGNMENT_ITERATIONS = 5
"""Number of times that the mean harmonics are computed and the recordings are rotated to them."""


def motor_angle(recording: Recording) -> Array:
    """Return the motor angle of a recording.

    Parameters
    ----------
    recording : Recording
        Recording of the speed, with or without the angle.

    Returns
    -------
    (samples,) array
        Recorded angles (rad) or, without these, the integral of the speed from the first sample.
    """
    if recording.angle is not None:
        return recording.angle
    return trapezoidal_integral(recording.time, recording.w)


def ripple_rms(angle: Array, tau: Array) -> float:
    """Compute the RMS of the torque that repeats with the motor angle, without that of noise.

    It is √(variance of the torque − variance of the noise), or 0 if the noise is larger. The noise
    is what remains of the torque when its mean and its harmonics of the motor angle are subtracted.

    Parameters
    ----------
    angle : (samples,) array
        Motor angles (rad).
    tau : (samples,) array
        Motor torques (N·m).

    Returns
    -------
    float
        RMS (N·m). NaN if the angle spans less than two turns.
    """
    if np.ptp(angle) < 2 * FULL_TURN:
        return float("nan")
    harmonics = _fit_orders([(angle, tau)], _harmonic_orders(), phased=False)
    residual = tau - tau.mean() - harmonics.torque(angle)
    # The mean, and the sine and cosine of each harmonic, reduce the degrees of freedom.
    degrees = max(len(angle) - 2 * HARMONICS - 1, 1)
    noise_variance = float(np.sum((residual - residual.mean()) ** 2)) / degrees
    return max(float(np.var(tau)) - noise_variance, 0.0) ** 0.5


def fit_harmonics(
    recordings: Sequence[Recording], direction: int, ratio: float | None = None
) -> Harmonics | None:
    """Fit the harmonics of the torque to the steady-state recordings in one direction.

    Parameters
    ----------
    recordings : sequence of Recording
        Steady-state recordings of one drive.
    direction : int
        Sign of the motor speed of the recordings that are fitted, ±1.
    ratio : float, optional
        Gear ratio of a worm. Harmonics of its wheel are fitted if the recorded angles span one turn
        of the wheel.

    Returns
    -------
    Harmonics or None
        The harmonics. None if every recording is shorter than two turns.
    """
    series = []
    phased = True
    for recording in recordings:
        angle = motor_angle(recording)
        if recording.w.mean() * direction > 0 and np.ptp(angle) >= 2 * FULL_TURN:
            series.append((angle, recording.tau))
            phased = phased and recording.angle is not None
    if not series:
        return None
    if not phased:
        return _aligned_mean(series)
    span = np.ptp(np.concatenate([angle for angle, _ in series]))
    wheel = ratio if ratio is not None and span >= FULL_TURN * ratio else None
    return _fit_orders(series, _harmonic_orders(wheel), phased=True)


def _aligned_mean(series: Sequence[tuple[Array, Array]]) -> Harmonics:
    """Compute the mean harmonics of recordings whose angles start at unknown positions.

    The harmonics of every recording are rotated until they agree best with the mean, and the mean
    is computed again. The first mean is that of the recording with the most turns.

    Parameters
    ----------
    series : sequence of ((samples,) array, (samples,) array)
        Motor angles (rad) and torques (N·m) of each recording.

    Returns
    -------
    Harmonics
        Mean harmonics, in which recordings with more turns have more weight. Their phases are not
        valid.
    """
    single = [_fit_orders([curve], _harmonic_orders(), phased=False) for curve in series]
    turns = np.array([np.ptp(angle) for angle, _ in series])
    mean = single[int(np.argmax(turns))]
    for _ in range(_ALIGNMENT_ITERATIONS):
        starts = [-_aligning_angle(mean.coefficients, item.coefficients) for item in single]
        aligned_series = [
            item.rotated(start).coefficients for item, start in zip(single, starts, strict=True)
        ]
        average = np.average(aligned_series, axis=0, weights=turns)
        mean = Harmonics.from_coefficients(mean.orders, average, phased=False)
    return mean


def _harmonic_orders(ratio: float | None = None) -> tuple[float, ...]:
    """Return the orders of the harmonics, which are their periods in one turn of the motor.

    Parameters
    ----------
    ratio : float, optional
        Number of motor turns per turn of the wheel. None for a drive without a wheel.

    Returns
    -------
    tuple of float
        The orders 1, 2, …, `HARMONICS` of the motor. Those of the wheel precede them, and are
        1/ratio, 2/ratio, ….
    """
    motor_orders = tuple(float(k) for k in range(1, HARMONICS + 1))
    if ratio is None:
        return motor_orders
    return tuple(order / ratio for order in motor_orders) + motor_orders


def _fit_orders(
    curves: Sequence[tuple[Array, Array]], orders: tuple[float, ...], phased: bool
) -> Harmonics:
    """Fit harmonics and one mean torque for each recording by least squares.

    Parameters
    ----------
    curves : sequence of ((samples,) array, (samples,) array)
        Motor angles (rad) and torques (N·m) of each recording.
    orders : tuple of float
        Number of periods of each harmonic in one turn of the motor.
    phased : bool
        True if the angles of all recordings are counted from the same zero of the motor.

    Returns
    -------
    Harmonics
        The harmonics that all recordings have in common, without the mean torques.
    """
    # One column for the mean of each recording, then cosines and sines of all orders.
    means = np.repeat(np.eye(len(curves)), [len(tau) for _, tau in curves], axis=0)
    waves = np.outer(np.concatenate([angle for angle, _ in curves]), orders)
    columns = np.column_stack([means, np.cos(waves), np.sin(waves)])
    torque = np.concatenate([tau for _, tau in curves])
    solution = np.linalg.lstsq(columns, torque, rcond=None)[0][len(curves) :]
    cosine, sine = np.split(solution, 2)
    # a cos x + b sin x is the real part of (a − i b) exp(i x).
    return Harmonics.from_coefficients(orders, cosine - 1j * sine, phased)


def _aligning_angle(reference: Any, coefficients: Any) -> float:
    """Find the angle by which harmonics lag behind reference harmonics.

    The result φ maximises Re Σ_k conj(r_k) c_k exp(−i k φ) among `_TRIAL_ANGLES` angles, with the
    coefficients r_k of the reference and c_k of the others. If the others are rotated by −φ, they
    agree best with the reference.

    Parameters
    ----------
    reference : (orders,) array of complex
        Coefficients r_k of the orders k = 1, 2, ….
    coefficients : (orders,) array of complex
        Coefficients c_k of the same orders.

    Returns
    -------
    float
        Angle φ (rad), from 0 to 2π.
    """
    angles = np.linspace(0, FULL_TURN, _TRIAL_ANGLES, endpoint=False)
    rotated = np.exp(-1j * np.outer(angles, np.arange(1, len(reference) + 1)))
    return float(angles[np.argmax(np.real(rotated @ (np.conj(reference) * coefficients)))])
