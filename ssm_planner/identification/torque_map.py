"""Compute torque–velocity maps: mean speed and mean torque of each steady-state recording.

`compute_torque_map` computes a map from recordings, and `read_torque_map` reads one from a table of
these figures. The package contains the maps of the three test rigs of the paper as such a table.
`recording_kind` decides which recordings are steady, and `find_outliers` finds points that do not
fit their neighbours.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from ssm_planner.dynamics import STANDSTILL_SPEED
from ssm_planner.errors import RecordingError
from ssm_planner.identification.harmonics import motor_angle, ripple_rms
from ssm_planner.identification.recordings import Recording, true_runs
from ssm_planner.loading import table_rows
from ssm_planner.problem import Ripple
from ssm_planner.typing import Array, Mask, frozen, record

TABLE_HEADER = (
    "rig",
    "recording",
    "velocity_rad_s",
    "torque_N_m",
    "velocity_deviation_rad_s",
    "torque_deviation_N_m",
    "torque_ripple_N_m",
    "torque_peak_N_m",
    "samples",
    "date_s",
)
"""Columns of a table of maps. Signs refer to the drive's positive direction.

The last column, the time since 1970, may be missing.
"""

REST_TIME = 0.3
"""Shortest time at zero speed that counts as rest, s.

Shorter intervals are motion below the resolution of the speed.
"""
REST_SAMPLES = 6
"""Smallest number of samples at zero speed that count as rest."""

NOISE_SPEED_SHARE = 0.05
"""Share of the usual speed below which a motion of fewer than `REST_SAMPLES` samples is noise.

The usual speed is the 90 % quantile of the speeds of a recording.
"""

OUTLIER_SCORE = 5.0
"""Smallest distance of an outlier from the line through its neighbours, in standard deviations.

A robust estimate of the standard deviation is used.
"""

SMALLEST_DEVIATION = 0.005
"""Smallest assumed standard deviation of a torque in the search for outliers.

It is a share of the torque range. A smaller one would make outliers of regular points, because a
map is curved and its points are compared with lines.
"""

LARGEST_DRIFT = 0.2
"""Relative change of speed from the first to the last third of a recording above which the motion
is not steady.
"""

_FULL_WEIGHT_DISTANCE = 3.0
"""Distance from the line in standard deviations above which a point loses weight."""
_FEWEST_POINTS = 5
"""Smallest number of points in a direction in which outliers are sought."""

TABLE_NAME = "rig_figures.csv"
"""Name of the table in the folder of the drive files. A rig has the name of its drive file."""


@record
class TorqueMap:
    """Points of a torque–velocity map, sorted by speed.

    Arrays have the shape (points,) and SI units at the motor.

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
    """Names of the recordings."""
    w: Array
    """Mean speed."""
    tau: Array
    """Mean torque."""
    w_deviation: Array
    """Standard deviation of the speed."""
    tau_deviation: Array
    """Standard deviation of the torque."""
    samples: Array
    """Number of samples."""
    repairs: tuple[str, ...] = ()
    """Repairs of the files, as sentences."""
    ripple: Array | None = None
    """RMS of the torque that repeats with the motor angle. NaN for a recording below two turns."""
    peak: Array | None = None
    """Largest |torque| minus |mean torque|."""
    dates: Array | None = None
    """Time of each recording, s. NaN without a date."""

    @property
    def times(self) -> Array:
        """Time of each recording, (points,) in s. NaN without a date."""
        return np.full(len(self.w), np.nan) if self.dates is None else self.dates

    @property
    def friction(self) -> Array:
        """Part of the torque that is due to friction, (points,) in N·m.

        It is half the difference between the torques at a speed and at the opposite speed, because
        a constant load is the same in both directions. The torque at the opposite speed is
        interpolated between the points of the other direction.
        """
        opposite = np.empty(len(self.w))
        for side in (self.w > 0, self.w < 0):
            # Negated speeds of the other direction are in increasing order after reversal.
            mirrored_w = -self.w[~side][::-1]
            mirrored_tau = self.tau[~side][::-1]
            opposite[side] = np.interp(self.w[side], mirrored_w, mirrored_tau)
        return (self.tau - opposite) / 2

    def spread(self, sign: int) -> Ripple | None:
        """Return the ripple and the noise of the torque in one direction.

        The standard deviation of the torque in a recording is divided into the part that repeats
        with the motor angle (ripple) and the rest (noise). The ripple of a recording shorter than
        two turns is unknown. The median ratio of ripple to standard deviation of the other
        recordings is used for it.

        Parameters
        ----------
        sign : int
            Sign of the motor speed, ±1.

        Returns
        -------
        Ripple or None
            Torques, ripple, noise and peaks of the points in this direction. None if the map lacks
            them, has no point in this direction, or has a point without any deviation of the
            torque.
        """
        side = np.sign(self.w) == sign
        deviation = self.tau_deviation[side]
        if self.ripple is None or self.peak is None or not side.any() or not np.all(deviation > 0):
            return None
        share = self.ripple[side] / deviation
        is_known = np.isfinite(share)
        typical = float(np.median(share[is_known])) if is_known.any() else 0.0
        ripple = deviation * np.where(is_known, share, typical)
        return Ripple(
            torque=tuple(np.maximum(np.abs(self.tau[side]), 1e-12)),
            ripple=tuple(ripple),
            noise=tuple(np.sqrt(np.maximum(deviation**2 - ripple**2, 0.0))),
            peak=tuple(np.maximum(self.peak[side], 1e-12)),
        )


def rest_mask(time: Array, w: Array) -> Mask:
    """Find the samples in which the motor rests.

    Zero speed for a short time is motion below the resolution of the speed channel, and does not
    count as rest, unless the direction of motion changes there. A few samples at very low speed are
    noise, and count as rest.

    Parameters
    ----------
    time : (samples,) array
        Times (s).
    w : (samples,) array
        Motor speeds (rad/s).

    Returns
    -------
    (samples,) array of bool
        True at rest.
    """
    is_still = np.abs(w) <= STANDSTILL_SPEED
    noise_speed = 0.0
    if not is_still.all():
        noise_speed = NOISE_SPEED_SHARE * float(np.quantile(np.abs(w[~is_still]), 0.9))
    for start, stop in true_runs(~is_still):
        if stop - start < REST_SAMPLES and np.max(np.abs(w[start:stop])) < noise_speed:
            is_still[start:stop] = True
    is_at_rest = np.zeros(len(w), bool)
    for start, stop in true_runs(is_still):
        is_long = stop - start >= REST_SAMPLES and time[stop - 1] - time[start] >= REST_TIME
        at_end = start == 0 or stop == len(w)
        is_reversal = not at_end and w[start - 1] * w[stop] < 0
        is_at_rest[start:stop] = is_long or is_reversal
    return is_at_rest


def recording_kind(recording: Recording) -> Literal["steady", "start_stop"]:
    """Decide whether a recording has a constant speed or starts and stops.

    A recording has starts and stops if each direction has more than 5 % of the sum of all |speeds|,
    or if the motor rests almost without torque in more than 5 % of the samples.

    Parameters
    ----------
    recording : Recording
        Recording of speed and torque.

    Returns
    -------
    {"steady", "start_stop"}
        Kind of the recording.

    Raises
    ------
    RecordingError
        If the motor never moves.
    """
    forward = np.sum(recording.w[recording.w > 0])
    backward = -np.sum(recording.w[recording.w < 0])
    if forward + backward == 0.0:
        raise RecordingError(f"{recording.name}: the motor never moves")
    # A steady recording may contain single samples of the wrong sign, because of noise.
    if min(forward, backward) > 0.05 * (forward + backward):
        return "start_stop"
    # A motor that stands still under load belongs to a motion below the resolution of the speed.
    unloaded = np.abs(recording.tau) < 0.1 * np.quantile(np.abs(recording.tau), 0.95)
    is_at_rest = rest_mask(recording.time, recording.w) & unloaded
    return "start_stop" if np.mean(is_at_rest) > 0.05 else "steady"


def compute_torque_map(recordings: Sequence[Recording]) -> TorqueMap:
    """Compute the torque–velocity map of steady-state recordings.

    Recordings with a noisy or drifting speed are kept, with a remark in `repairs`.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings at constant speed, in any order.

    Returns
    -------
    TorqueMap
        One point for each recording, (points,) arrays sorted by speed.

    Raises
    ------
    RecordingError
        If the motor would produce energy in both directions, so that the sign of the torque or of
        the speed must be wrong.
    """
    order = sorted(recordings, key=lambda recording: float(recording.w.mean()))
    repairs = [f"{recording.name}: {repair}" for recording in order for repair in recording.repairs]
    for recording in order:
        repairs += [f"{recording.name}: {remark}" for remark in _speed_remarks(recording.w)]
    rows = [
        [
            recording.w.mean(),
            recording.tau.mean(),
            recording.w.std(),
            recording.tau.std(),
            ripple_rms(motor_angle(recording), recording.tau),
            np.abs(recording.tau).max() - abs(recording.tau.mean()),
            len(recording.w),
            recording.date,
        ]
        for recording in order
    ]
    data = _from_rows([recording.name for recording in order], rows)
    # A constant load gives back the energy that it takes, and friction takes energy.
    if len(np.unique(np.sign(data.w))) == 2 and np.all(data.friction * data.w < 0):
        raise RecordingError(
            "the torque opposes the speed in both directions, so the motor would produce energy: "
            "the sign of the torque or of the speed is wrong in all recordings"
        )
    return replace(data, repairs=tuple(repairs))


def _speed_remarks(w: Array) -> list[str]:
    """Return remarks on a recorded speed (rad/s) that is noisy or drifts."""
    remarks = []
    size = abs(w.mean())
    deviation = w.std()
    if deviation > size:
        remarks.append(f"speed noisier than its mean ({deviation:.3g} > {size:.3g} rad/s), kept")
    third = len(w) // 3
    initial = float(w[:third].mean())
    final = float(w[-third:].mean())
    tolerance = max(LARGEST_DRIFT * size, OUTLIER_SCORE * deviation / np.sqrt(third))
    if abs(final - initial) > tolerance:
        remarks.append(
            f"speed goes from {initial:.3g} to {final:.3g} rad/s, its mean is taken: not steady"
        )
    return remarks


def _from_rows(names: list[str], rows: list[list[float]]) -> TorqueMap:
    """Build a map from rows of numbers, sorted by speed.

    Parameters
    ----------
    names : list of str
        Name of the recording of each row.
    rows : list of list of float
        Numbers in the order of `TABLE_HEADER` without its first two columns, rig and recording. The
        last number, the date, may be missing in all rows.

    Returns
    -------
    TorqueMap
        One point for each row.
    """
    table = np.array(rows)
    order = np.argsort(table[:, 0], kind="stable")
    columns = ("w", "tau", "w_deviation", "tau_deviation", "ripple", "peak", "samples", "dates")
    return TorqueMap(
        names=tuple(names[k] for k in order),
        **dict(zip(columns, np.ascontiguousarray(table[order].T), strict=False)),
    )


def read_torque_map(path: str | Path, rig: str) -> TorqueMap:
    """Read the torque–velocity map of one test rig from a table.

    Parameters
    ----------
    path : str or Path
        CSV file with the columns `TABLE_HEADER`. Lines that start with # are comments.
    rig : str
        Name of the rig, which selects the rows.

    Returns
    -------
    TorqueMap
        One point for each row of the rig.

    Raises
    ------
    RecordingError
        If the table does not contain the rig, has other columns or has invalid numbers. The message
        states file, line and fault.
    ProblemError
        If the file is not a table.
    """
    path = Path(path)
    lines = table_rows(path)
    if tuple(next(lines)[1]) not in (TABLE_HEADER, TABLE_HEADER[:-1]):
        raise RecordingError(f"{path}: the first line must be {','.join(TABLE_HEADER)}")
    rigs = set()
    names = []
    rows = []
    for line, (row_rig, name, *numbers) in lines:
        rigs.add(row_rig)
        if row_rig == rig:
            names.append(name)
            rows.append(_parse_row(numbers, f"{path}:{line}"))
    if not rows:
        raise RecordingError(
            f"{path}: no figures of {rig!r}; rigs in the table: {', '.join(sorted(rigs)) or 'none'}"
        )
    return _from_rows(names, rows)


def _parse_row(fields: list[str], location: str) -> list[float]:
    """Convert the fields of one row to numbers.

    Parameters
    ----------
    fields : list of str
        Fields in the order of `TABLE_HEADER` without its first two columns.
    location : str
        File and line, for messages.

    Returns
    -------
    list of float
        One number for each field.

    Raises
    ------
    RecordingError
        If a field is not a finite number. Only the ripple and the date may be NaN.
    """
    try:
        row = [float(field) for field in fields]
    except ValueError as error:
        raise RecordingError(f"{location}: {error}") from error
    # The fifth figure is the ripple, which needs two turns of the motor.
    if not np.all(np.isfinite([*row[:4], *row[5:7]])):
        raise RecordingError(f"{location}: {len(TABLE_HEADER)} finite columns are needed")
    return row


@frozen
class Outlier:
    """Point of a torque–velocity map that is far from the line through its neighbours."""

    index: int
    """Index of the point in the map."""
    distance: float
    """Measured torque minus the torque on the line through the neighbours, N·m."""
    weight: float
    """Factor below 1 by which the residual is multiplied in a fit."""


def find_outliers(w: Array, tau: Array) -> list[Outlier]:
    """Find isolated points of a torque–velocity map.

    Each point is compared with the line through its two nearest neighbours in the same direction.
    The friction law is not needed, so a law that fits badly does not cause outliers. The worst
    outlier is removed before the next one is sought. At most a quarter of the points are removed,
    and none in a direction with fewer than five points.

    Parameters
    ----------
    w : (points,) array
        Mean motor speeds (rad/s), in increasing order.
    tau : (points,) array
        Mean motor torques (N·m).

    Returns
    -------
    list of Outlier
        Outliers in the order of their indices.
    """
    mask = np.ones(len(w), bool)
    outliers: list[Outlier] = []
    for _ in range(len(w) // 4):
        score, distance, deviation = _outlier_scores(w, tau, mask)
        index = int(np.argmax(np.abs(score)))
        if not np.abs(score[index]) > OUTLIER_SCORE:
            break
        mask[index] = False
        weight = _FULL_WEIGHT_DISTANCE * deviation / max(abs(distance[index]), 1e-300)
        outliers.append(Outlier(index, float(distance[index]), float(min(1.0, weight))))
    return sorted(outliers, key=lambda outlier: outlier.index)


def _outlier_scores(w: Array, tau: Array, mask: Mask) -> tuple[Array, Array, float]:
    """Compare each point of a map with the line through its neighbours in the same direction.

    The distance from this line contains the errors of three torques. If these have the standard
    deviation σ, the distance has the standard deviation σ √(1 + (1 − a)² + a²), where a is the
    position of the point between its left (0) and its right neighbour (1). The position of an
    outermost point is outside this range, because both of its neighbours are on one side. A robust
    estimate of σ follows from the median of all distances.

    Parameters
    ----------
    w, tau : (points,) array
        Mean motor speeds (rad/s, in increasing order) and torques (N·m).
    mask : (points,) array of bool
        Mask of the points that are compared.

    Returns
    -------
    score : (points,) array
        Distance from the line, divided by its expected standard deviation. 0 for points that are
        not compared.
    distance : (points,) array
        Measured torque minus that on the line (N·m).
    deviation : float
        Robust standard deviation σ of one torque (N·m).
    """
    distance = np.full(len(w), np.nan)
    spread = np.ones(len(w))
    for sign in (-1.0, 1.0):
        points = np.flatnonzero(mask & (np.sign(w) == sign))
        count = len(points)
        if count < _FEWEST_POINTS:
            continue
        # An outermost point is compared with the line through the two points nearest to it.
        lower = points[[1, *range(count - 2), count - 3]]
        upper = points[[2, *range(2, count), count - 2]]
        width = w[upper] - w[lower]
        share = np.full(count, 0.5)  # position between two points of the same speed
        np.divide(w[points] - w[lower], width, out=share, where=width != 0)
        distance[points] = tau[points] - (1 - share) * tau[lower] - share * tau[upper]
        spread[points] = np.sqrt(1.0 + (1 - share) ** 2 + share**2)
    finite = np.isfinite(distance)
    if not finite.any():
        return np.zeros(len(w)), np.zeros(len(w)), 0.0
    # The median magnitude of a normal variable is 1/1.4826 times its standard deviation.
    deviation = 1.4826 * float(np.median(np.abs(distance[finite] / spread[finite])))
    deviation = max(deviation, SMALLEST_DEVIATION * float(np.ptp(tau)), 1e-300)
    distance = np.nan_to_num(distance)
    return distance / (spread * deviation), distance, deviation
