"""What repeats of the torque with the angle of the screw or worm, and of its wheel: harmonics by direction of motion.

Where the angle is recorded, all recordings of a direction are fitted together. Where it is not, the angle is the integral of
the speed from an unknown start: the recordings' harmonics are turned onto each other, which leaves their amplitudes known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ssm_planner.identification.recordings import Recording
from ssm_planner.problem.posterior import Harmonics
from ssm_planner.typing import Array

TURN = 2 * np.pi
HARMONICS = 3
"""Of a turn, by which torque is taken to repeat."""
_STARTS = 720
_ROUNDS = 5


def travelled(recording: Recording) -> Array:
    """(samples,) motor angle, rad: as recorded, else the integral of the speed."""
    if recording.angle is not None:
        return recording.angle
    steps = np.diff(recording.time) * (recording.w[1:] + recording.w[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def ripple_of(angle: Array, tau: Array) -> float:
    """RMS of the harmonics of the angle in torque (samples,), N·m, less what noise would show of them; NaN: < 2 turns."""
    if np.ptp(angle) < 2 * TURN:
        return float("nan")
    left = tau - tau.mean() - _fitted([(angle, tau)], _orders(None), phased=False).torque(angle)
    noise = float(np.sum((left - left.mean()) ** 2)) / max(len(angle) - 2 * HARMONICS - 1, 1)
    return max(float(np.var(tau)) - noise, 0.0) ** 0.5


def fit_harmonics(
    recordings: Sequence[Recording], direction: int, ratio: float | None = None
) -> Harmonics | None:
    """Of the steady-state recordings in a direction (±1); None where none of them turns twice.

    ratio: of a worm's wheel, whose harmonics are fitted too where the recorded angles span a turn of it.
    """
    here = [
        r for r in recordings if r.w.mean() * direction > 0 and np.ptp(travelled(r)) >= 2 * TURN
    ]
    if not here:
        return None
    parts = [(travelled(r), r.tau) for r in here]
    if all(r.angle is not None for r in here):
        angles = np.concatenate([angle for angle, _ in parts])
        wheel = ratio if ratio is not None and np.ptp(angles) >= TURN * ratio else None
        return _fitted(parts, _orders(wheel), phased=True)
    each = [_fitted([part], _orders(None), phased=False) for part in parts]
    turns = np.array([np.ptp(angle) for angle, _ in parts])
    mean = each[int(np.argmax(turns))]
    for _ in range(_ROUNDS):
        turned = [_complex(one.rotated(-_start(_complex(mean), _complex(one)))) for one in each]
        common = np.average(turned, axis=0, weights=turns)
        mean = Harmonics(
            mean.orders, tuple(common.real.tolist()), tuple((-common.imag).tolist()), phased=False
        )
    return mean


def _orders(ratio: float | None) -> tuple[float, ...]:
    motor = tuple(float(k) for k in range(1, HARMONICS + 1))
    return motor if ratio is None else (*(k / ratio for k in motor), *motor)


def _waves(angle: Array, orders: Sequence[float]) -> Array:
    waves = np.outer(angle, orders)
    return np.concatenate([np.cos(waves), np.sin(waves)], axis=1)


def _complex(harmonics: Harmonics) -> Any:
    """c_k with the torque Re Σ c_k exp(i order_k θ)."""
    return np.array(harmonics.cosine) - 1j * np.array(harmonics.sine)


def _fitted(
    parts: Sequence[tuple[Array, Array]], orders: tuple[float, ...], phased: bool
) -> Harmonics:
    """By least squares over (angle, torque) of recordings, each with a mean of its own."""
    means = np.repeat(np.eye(len(parts)), [len(tau) for _, tau in parts], axis=0)
    columns = np.column_stack(
        [means, np.concatenate([_waves(angle, orders) for angle, _ in parts])]
    )
    found = np.linalg.lstsq(columns, np.concatenate([tau for _, tau in parts]), rcond=None)[0][
        len(parts) :
    ]
    return Harmonics(
        orders, tuple(found[: len(orders)].tolist()), tuple(found[len(orders) :].tolist()), phased
    )


def _start(reference: Any, found: Any) -> float:
    """By which angle the reference is turned where `found` (orders,) begins; whole orders 1, 2, …"""
    angles = np.linspace(0, TURN, _STARTS, endpoint=False)
    turned = np.exp(-1j * np.outer(angles, np.arange(1, len(reference) + 1)))
    return float(angles[np.argmax(np.real(turned @ (np.conj(reference) * found)))])
