"""Compute torque–velocity maps: mean speed and mean torque of each steady-state recording.

The package contains the maps of the three rigs as a table of figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from ssm_planner.dynamics import STANDSTILL
from ssm_planner.errors import RecordingError
from ssm_planner.identification.harmonics import ripple_rms, travelled
from ssm_planner.identification.recordings import Recording
from ssm_planner.loading import table_rows
from ssm_planner.problem import Ripple
from ssm_planner.representation import ShortRepr
from ssm_planner.typing import Array, Mask, frozen, record

FIGURES_HEADER = (
    "rig",
    "recording",
    "velocity_rad_s",
    "torque_N_m",
    "velocity_deviation_rad_s",
    "torque_deviation_N_m",
    "torque_ripple_N_m",
    "torque_peak_N_m",
    "samples",
)
"""Columns of a table of figures. Signs refer to the drive's positive direction."""

REST_TIME = 0.3
REST_SAMPLES = 6
"""Smallest number of samples at zero speed that count as rest. REST_TIME is the shortest time, s.

Shorter intervals are motion below the resolution of the speed.
"""

FLICKER = 0.05
"""Share of the usual speed below which a motion of fewer than REST_SAMPLES samples is noise."""

BEYOND = 5.0
"""Distance of an outlier from the line through its neighbours, in robust standard deviations."""

LEAST = 0.005
"""Smallest standard deviation as a share of the torque range, because a map is curved."""

DRIFT = 0.2
"""Relative change of speed from the first to the last third of a recording above which the motion
is not steady.
"""

_KEEP = 3.0
_FEWEST = 5

TABLE = "rig_figures.csv"
"""Name of the table in the folder of the drive files. A rig has the name of its drive file."""


@record
class TorqueMap(ShortRepr):
    """Points of a map, sorted by speed. Arrays have the shape (points,) and SI units at the motor.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> w = np.array([-100.0, 100.0])
    >>> data = ssm.TorqueMap(
    ...     ("a", "b"), w, 1e-5 * w, np.full(2, 0.1), np.full(2, 1e-4), samples=np.full(2, 500)
    ... )
    >>> data.tau.tolist()
    [-0.001, 0.001]
    """

    names: tuple[str, ...]
    w: Array
    tau: Array
    w_deviation: Array
    tau_deviation: Array
    """RMS of the torque minus its mean."""
    samples: Array
    repairs: tuple[str, ...] = ()
    ripple: Array | None = None
    """RMS of the torque that repeats with the motor angle. NaN for less than two turns."""
    peak: Array | None = None
    """Largest |torque| minus |mean torque|."""

    def spread(self, sign: int) -> Ripple | None:
        """Return ripple and noise in one direction (±1), or None if data are missing."""
        side = np.sign(self.w) == sign
        if (
            self.ripple is None
            or self.peak is None
            or not side.any()
            or not np.all(self.tau_deviation[side] > 0)
        ):
            return None
        deviation, share = self.tau_deviation[side], self.ripple[side] / self.tau_deviation[side]
        typical = float(np.median(share[np.isfinite(share)])) if np.isfinite(share).any() else 0.0
        ripple = deviation * np.where(np.isfinite(share), share, typical)
        return Ripple(
            torque=tuple(np.maximum(np.abs(self.tau[side]), 1e-12)),
            ripple=tuple(ripple),
            noise=tuple(np.sqrt(np.maximum(deviation**2 - ripple**2, 0.0))),
            peak=tuple(np.maximum(self.peak[side], 1e-12)),
        )


def rest_mask(time: Array, w: Array) -> Mask:
    """Return a mask (samples,) of rest, from times (s) and motor speeds (rad/s), (samples,).

    Motion below the resolution of the speed does not count as rest. Short motions at very low speed
    are flicker of the speed channel and count as rest.
    """
    is_still = np.abs(w) <= STANDSTILL
    fast = FLICKER * float(np.quantile(np.abs(w[~is_still]), 0.9)) if not is_still.all() else 0.0
    for start, stop in runs(~is_still):
        if stop - start < REST_SAMPLES and np.max(np.abs(w[start:stop])) < fast:
            is_still[start:stop] = True
    rest = np.zeros(len(w), dtype=bool)
    for start, stop in runs(is_still):
        lasts = stop - start >= REST_SAMPLES and time[stop - 1] - time[start] >= REST_TIME
        at_end = start == 0 or stop == len(w)
        turns = not at_end and w[start - 1] * w[stop] < 0
        rest[start:stop] = lasts or turns
    return rest


def runs(mask: Mask) -> list[list[int]]:
    """Return the first index, and the last index plus 1, of each run of True in `mask`.

    The mask has the shape (samples,).
    """
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(int))
    return np.flatnonzero(edges).reshape(-1, 2).tolist()


def kind_of(recording: Recording) -> Literal["steady", "start_stop"]:
    """Return the kind of a recording: steady motion in one direction, or starts and stops.

    Raises RecordingError if the motor never moves.
    """
    forward = np.sum(recording.w[recording.w > 0])
    backward = -np.sum(recording.w[recording.w < 0])
    if forward + backward == 0.0:
        raise RecordingError(f"{recording.name}: the motor never moves")
    if min(forward, backward) > 0.05 * (forward + backward):
        return "start_stop"
    unloaded = np.abs(recording.tau) < 0.1 * np.quantile(np.abs(recording.tau), 0.95)
    is_at_rest = rest_mask(recording.time, recording.w) & unloaded
    return "start_stop" if np.mean(is_at_rest) > 0.05 else "steady"


def torque_map(recordings: Sequence[Recording]) -> TorqueMap:
    """Compute the map of steady-state recordings."""
    order = sorted(recordings, key=lambda recording: float(recording.w.mean()))
    repairs = [f"{r.name}: {repair}" for r in order for repair in r.repairs]
    for r in order:
        if r.w.std() > abs(r.w.mean()):
            repairs.append(
                f"{r.name}: speed noisier than its mean ({r.w.std():.3g} > "
                f"{abs(r.w.mean()):.3g} rad/s), kept"
            )
        third = len(r.w) // 3
        initial, final = float(r.w[:third].mean()), float(r.w[-third:].mean())
        if abs(final - initial) > max(DRIFT * abs(r.w.mean()), BEYOND * r.w.std() / np.sqrt(third)):
            repairs.append(
                f"{r.name}: speed goes from {initial:.3g} to {final:.3g} rad/s, its mean is taken: "
                "not steady"
            )
    rows = [
        [
            r.w.mean(),
            r.tau.mean(),
            r.w.std(),
            r.tau.std(),
            ripple_rms(travelled(r), r.tau),
            np.abs(r.tau).max() - abs(r.tau.mean()),
            len(r.w),
        ]
        for r in order
    ]
    return replace(_from_rows([r.name for r in order], rows), repairs=tuple(repairs))


def _from_rows(names: list[str], rows: list[list[float]]) -> TorqueMap:
    """Build a map from rows of numbers in the order of FIGURES_HEADER."""
    table = np.array(rows)
    order = np.argsort(table[:, 0], kind="stable")
    columns = ("w", "tau", "w_deviation", "tau_deviation", "ripple", "peak", "samples")
    return TorqueMap(
        names=tuple(names[k] for k in order),
        **dict(zip(columns, np.ascontiguousarray(table[order].T), strict=True)),
    )


def read_figures(path: str | Path, rig: str) -> TorqueMap:
    """Read the map of one rig from a table of figures.

    Parameters
    ----------
    path : str or Path
        CSV file with the columns FIGURES_HEADER. Lines that start with # are comments.
    rig : str
        Name of the rig.

    Raises
    ------
    RecordingError
        If the table does not contain the rig, has other columns or has invalid figures. The message
        states file, line and fault.
    ProblemError
        If the file is not a table.
    """
    path = Path(path)
    lines = table_rows(path)
    if tuple(next(lines)[1]) != FIGURES_HEADER:
        raise RecordingError(f"{path}: the first line must be {','.join(FIGURES_HEADER)}")
    tables: dict[str, list[tuple[str, list[float]]]] = {}
    for line, fields in lines:
        rows = tables.setdefault(fields[0], [])
        if fields[0] == rig:
            rows.append((fields[1], _parse_figures(fields[2:], f"{path}:{line}")))
    if rig not in tables:
        raise RecordingError(
            f"{path}: no figures of {rig!r}; rigs in the table: "
            f"{', '.join(sorted(tables)) or 'none'}"
        )
    names, figures = zip(*tables[rig], strict=True)
    return _from_rows(list(names), list(figures))


def _parse_figures(fields: list[str], location: str) -> list[float]:
    """Convert the figures of one row to numbers. The ripple may be NaN. Raises RecordingError."""
    try:
        row = [float(field) for field in fields]
    except ValueError as error:
        raise RecordingError(f"{location}: {error}") from error
    # The fifth figure is the ripple, which needs two turns of the motor.
    if not np.all(np.isfinite([*row[:4], *row[5:]])):
        raise RecordingError(f"{location}: {len(FIGURES_HEADER)} finite columns are needed")
    return row


@frozen
class Outlier:
    """A point of a map that is far from its neighbours."""

    index: int
    distance: float
    """Measured torque minus the torque on the line through the neighbours, N·m."""
    weight: float
    """Factor of the residual in a fit, below 1."""


def find_outliers(w: Array, tau: Array) -> list[Outlier]:
    """Return isolated points of a torque–velocity map with speeds and torques (points,).

    Each point is compared with the line through its two nearest neighbours in the same direction.
    A bad friction law therefore does not cause outliers. A direction needs five points.
    """
    mask = np.ones(len(w), dtype=bool)
    outliers: list[Outlier] = []
    for _ in range(len(w) // 4):
        score, distance, deviation = _scores(w, tau, mask)
        index = int(np.argmax(np.abs(score)))
        if not np.abs(score[index]) > BEYOND:
            break
        mask[index] = False
        weight = _KEEP * deviation / max(abs(distance[index]), 1e-300)
        outliers.append(Outlier(index, float(distance[index]), float(min(1.0, weight))))
    return sorted(outliers, key=lambda outlier: outlier.index)


def _scores(w: Array, tau: Array, mask: Mask) -> tuple[Array, Array, float]:
    """Compare each point of a map with the line through its neighbours.

    The mask `mask` (points,) selects the compared points. The results are the distance divided by
    its expected deviation (points,), the distance in N·m (points,), and the deviation of a torque
    in N·m.
    """
    distance, spread = np.full(len(w), np.nan), np.ones(len(w))
    for sign in (-1.0, 1.0):
        side = np.flatnonzero(mask & (np.sign(w) == sign))
        count = len(side)
        if count < _FEWEST:
            continue
        # An outermost point is compared with the line through the two points nearest to it.
        a = side[[1, *range(count - 2), count - 3]]
        b = side[[2, *range(2, count), count - 2]]
        gap = w[b] - w[a]
        share = np.where(gap == 0, 0.5, (w[side] - w[a]) / np.where(gap == 0, 1.0, gap))
        distance[side] = tau[side] - (1 - share) * tau[a] - share * tau[b]
        spread[side] = np.sqrt(1.0 + (1 - share) ** 2 + share**2)
    finite = np.isfinite(distance)
    if not finite.any():
        return np.zeros(len(w)), np.zeros(len(w)), 0.0
    deviation = 1.4826 * float(np.median(np.abs(distance[finite] / spread[finite])))
    deviation = max(deviation, LEAST * float(np.ptp(tau)), 1e-300)
    distance = np.nan_to_num(distance)
    return distance / (spread * deviation), distance, deviation
