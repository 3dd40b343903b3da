"""Read recordings of a drive: exports of the EPOS recorder, and CSV files with named columns.

`read_recordings` reads files and folders, and `read_recording` one file. The names of the channels
select the columns, see the module `recorder_csv`. Every repair of a file is stated in the
recording, as are signs of a faulty measurement. The last functions of this module are small tools
for sampled signals, which the other modules use.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import field
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from ssm_planner.dynamics import STANDSTILL_SPEED
from ssm_planner.errors import ProblemError, RecordingError
from ssm_planner.identification.recorder_csv import (
    LARGEST_OMITTED_SHARE,
    NUMBER,
    Column,
    Table,
    find_columns,
    parse_table,
)
from ssm_planner.loading.files import read_file_bytes
from ssm_planner.typing import Array, Indices, Mask, record

MAX_BYTES = 32_000_000
"""Largest file: more than half an hour at 1 kHz. An export of the EPOS recorder has about 10 kB."""

MIN_SAMPLES = 8
"""Smallest number of samples of a recording."""
SUSPICIOUS_COUNT = 8
"""Smallest number of samples with a constant torque that is suspicious.

The samples are those at the largest torque, or equal ones in a row.
"""
PEAK_BAND = 0.01
PEAK_EXCESS = 4
"""Width of a band below the largest |torque|, as a share of the range of |torque|.

The torque seems to be limited if this band contains more than PEAK_EXCESS times as many samples as
the next band of this width.
"""
RUN_RATIO = 3
"""Smallest ratio of the longest to the second longest run of equal torques in a stopped channel.

A channel with a coarse resolution also has runs of equal torques, but their lengths differ less.
"""
UNSUSTAINABLE_TORQUE_RATIO = 2.0
"""Ratio of mean |torque| to nominal torque above which no motor can work continuously."""
PASSAGE_LENGTH = 8
REPEATED_SHARE = 0.5
"""Number of samples in a passage, and share of the passages that a repetition has in common.

Recordings are compared by their passages, that is, by short sequences of consecutive samples.
"""
SPIKE_GAP = 3.0
"""Distance of a spike from its neighbours, in units of the range of the other samples."""


@record
class Recording:
    """Speed and torque of one motor over time, in the drive's positive direction.

    Arrays have the shape (samples,) and SI units.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> time = np.arange(4) * 1e-3
    >>> ssm.Recording("run 1", time, w=np.full(4, 100.0), tau=np.full(4, 2e-3)).tau.tolist()
    [0.002, 0.002, 0.002, 0.002]
    """

    name: str
    """Name in results, usually that of the file."""
    time: Array
    """Time since the first sample, s."""
    w: Array
    """Motor speed, rad/s."""
    tau: Array
    """Motor torque, N·m."""
    repairs: tuple[str, ...] = ()
    """Repairs of the file and omitted samples, one sentence each."""
    quantum: float = 0.0
    """Resolution of the speed channel, rad/s."""
    header: dict[str, str] = field(default_factory=dict)
    """Texts of the lines above the table, by their label."""
    angle: Array | None = None
    """Motor angle in rad, or None without a position channel."""
    begin: float = 0.0
    """Time of the first sample in the file, s. The array `time` begins with 0."""
    doubts: tuple[str, ...] = ()
    """Sentences on values of the file that are not in the channels, or differ from them."""

    @property
    def date(self) -> float:
        """Time of the recording in s since 1970, from its header. NaN without a valid date."""
        text = self.header.get("date", "")[: len("2020-07-06 15:29:47")]
        try:
            # The drive states no time zone. UTC makes differences the same on every computer.
            return datetime.fromisoformat(text).replace(tzinfo=timezone.utc).timestamp()
        except ValueError:
            return math.nan


def read_recording(
    path: str | Path,
    *,
    nominal_torque: float | None = None,
    direction: int = 1,
    name: str | None = None,
    counts_per_turn: int | None = 4096,
    every_sample: bool = False,
) -> Recording:
    """Read a recording of the speed and torque of a motor from a file.

    Parameters
    ----------
    path : str or Path
        Export of the EPOS recorder, or CSV with named columns.
    nominal_torque : float, optional
        Nominal torque of the motor in N·m, to which a torque in percent or per mille refers.
    direction : int
        Sign of the recorded channels, ±1.
    name : str, optional
        Name in results. The default is the name of the file.
    counts_per_turn : int, optional
        Increments per motor turn, to which a position in increments refers. None if unknown. The
        default is that of an encoder with 1024 lines.
    every_sample : bool
        True keeps samples of speed and torque that are far from the others.

    Returns
    -------
    Recording
        The channels in SI units, with remarks on repairs.

    Raises
    ------
    RecordingError
        If the file cannot be used. The message states file, line and fault.
    """
    path = Path(path)
    table = parse_table(read_text(path), path)
    columns = find_columns(table, path)
    turns_per_count = None if counts_per_turn is None else 1 / counts_per_turn
    references = {"torque": nominal_torque, "position": turns_per_count}
    channels = np.zeros((4, len(table.lines)))
    for k, quantity in enumerate(("time", "speed", "torque", "position")):
        if quantity in columns:  # the position may be missing
            channels[k] = _column_in_si(table, columns[quantity], path, quantity, references)
    channels, lines, repairs = _finite_samples(channels, table, path)
    doubts = table.doubts + repairs
    if not every_sample:
        repairs += _remove_spikes(channels, lines)
    time, speed, torque, angle = channels[:, np.isfinite(channels).all(axis=0)]
    if np.ptp(torque) == 0.0 and np.any(speed != 0.0):
        raise RecordingError(
            f"{path}: torque channel {columns['torque'].name!r} is constant while the motor moves: "
            "not a measurement"
        )
    is_moving = np.abs(speed) > STANDSTILL_SPEED
    repairs += _torque_remarks(torque, columns["torque"], nominal_torque, is_moving)
    repairs += _time_remarks(time, table.header)
    return Recording(
        name=name or path.name,
        time=time - time[0],
        w=direction * speed,
        tau=direction * torque,
        repairs=tuple(table.repairs + repairs),
        quantum=smallest_step(speed, 6),
        header=table.header,
        angle=direction * angle if "position" in columns else None,
        begin=float(time[0]),
        doubts=tuple(doubts),
    )


def _finite_samples(channels: Array, table: Table, path: Path) -> tuple[Array, Indices, list[str]]:
    """Remove the samples in which a channel is not a finite number, and check the others.

    Parameters
    ----------
    channels : (4, samples) array
        Time, speed, torque and position in SI units.
    table : Table
        Table of the file, with the line number of each sample.
    path : Path
        The file, for messages.

    Returns
    -------
    channels : (4, finite samples) array
        The remaining samples.
    lines : (finite samples,) array of int
        Their line numbers.
    remarks : list of str
        A remark on the removed samples, if there are any.

    Raises
    ------
    RecordingError
        If too many samples are removed, if too few remain, if a value is too large for a
        measurement, or if the time does not increase.
    """
    finite = np.isfinite(channels).all(axis=0)
    bad_lines = [table.lines[k] for k in np.flatnonzero(~finite)]
    count = len(table.lines)
    if len(bad_lines) > max(1, LARGEST_OMITTED_SHARE * count):
        raise RecordingError(
            f"{path}:{bad_lines[0]}: {len(bad_lines)} of {count} samples are not finite numbers; "
            f"at most {100 * LARGEST_OMITTED_SHARE:.0f} % may be left out"
        )
    lines = np.asarray(table.lines)[finite]
    channels = channels[:, finite]
    # Times since 1970 are below 1e10 s, and all other values are smaller.
    huge = np.abs(channels).max(axis=0) > 1e12
    if huge.any():
        raise RecordingError(f"{path}:{lines[huge][0]}: a value is too large for a measurement")
    time = channels[0]
    increases = np.diff(time) > 0
    if not increases.all():
        k = int(np.argmin(increases))
        raise RecordingError(
            f"{path}:{lines[k + 1]}: time does not increase ({time[k + 1]:g} s after {time[k]:g} s)"
        )
    if len(lines) < MIN_SAMPLES:
        raise RecordingError(f"{path}: {len(lines)} samples; at least {MIN_SAMPLES} are needed")
    remarks = []
    if bad_lines:
        remarks = [
            f"{len(bad_lines)} samples that are not finite left out (first: line {bad_lines[0]})"
        ]
    return channels, lines, remarks


def _remove_spikes(channels: Array, lines: Indices) -> list[str]:
    """Replace spikes of torque and speed by NaN.

    Parameters
    ----------
    channels : (4, samples) array
        Time, speed, torque and position, which are changed.
    lines : (samples,) array of int
        Line number of each sample.

    Returns
    -------
    list of str
        A remark on each channel with spikes.
    """
    remarks = []
    for quantity, channel in (("torque", channels[2]), ("speed", channels[1])):
        spikes = find_spikes(channel)
        if len(spikes):
            listing = ", ".join(f"line {lines[k]}" for k in spikes[:5])
            remarks.append(
                f"{len(spikes)} isolated {quantity} samples far outside the rest left out "
                f"({listing})"
            )
            channel[spikes] = np.nan
    return remarks


def read_recordings(
    paths: Sequence[str | Path], *, nominal_torque: float | None = None, direction: int = 1
) -> list[Recording]:
    """Read recordings from files, and from all tables in directories.

    The tables are the files `*.csv` and `*.txt` below each directory.

    Parameters
    ----------
    paths : sequence of str or Path
        Files and directories. Files of a directory are sorted and named by their path within it.
    nominal_torque : float, optional
        Nominal torque of the motor in N·m, to which a torque in percent or per mille refers.
    direction : int
        Sign of the recorded channels, ±1.

    Returns
    -------
    list of Recording
        One recording for each file.

    Raises
    ------
    RecordingError
        If a file cannot be used, or if a directory does not contain such files.
    """
    files: list[tuple[Path, str]] = []
    for entry in map(Path, paths):
        if entry.is_dir():
            tables = sorted(
                file
                for file in entry.rglob("*")
                if file.suffix.lower() in (".csv", ".txt") and file.is_file()
            )
            if not tables:
                raise RecordingError(f"{entry}: no .csv or .txt file in this directory")
            files.extend((file, file.relative_to(entry).as_posix()) for file in tables)
        else:
            files.append((entry, entry.name))
    return [
        read_recording(file, nominal_torque=nominal_torque, direction=direction, name=name)
        for file, name in files
    ]


def find_spikes(values: Array) -> Indices:
    """Find isolated samples that are far from all others.

    A sample is isolated if it differs from the median of itself and its two neighbours by more than
    `SPIKE_GAP` times the range of the values. The range is computed without the outermost values,
    which are 1 % of the samples on each side, and at least one.

    Parameters
    ----------
    values : (samples,) array
        Values of one channel.

    Returns
    -------
    (spikes,) array of int
        Indices of the isolated samples.
    """
    from scipy.ndimage import median_filter  # It takes long to import.

    outermost = max(1, len(values) // 100)
    inner = np.sort(values)[outermost:-outermost]
    height = np.abs(values - median_filter(values, 3, mode="mirror"))
    return np.flatnonzero(height > SPIKE_GAP * max(float(np.ptp(inner)), 1e-12))


def read_text(path: Path) -> str:
    """Read the text of a recording, which may be encoded in UTF-8, UTF-16 or Windows-1252.

    Parameters
    ----------
    path : Path
        File of at most `MAX_BYTES` bytes.

    Returns
    -------
    str
        Text of the file.

    Raises
    ------
    RecordingError
        If the file is too large, empty, not readable or not a text file.
    """
    try:
        raw = read_file_bytes(path, MAX_BYTES)
    except ProblemError as error:
        raise RecordingError(str(error)) from None
    if not raw.strip():
        raise RecordingError(f"{path}: the file is empty")
    # UTF-16 text begins with a byte order mark.
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError as error:
            raise RecordingError(f"{path}: not a text file") from error
    # Text contains no control characters except tabs, line feeds, returns and form feeds.
    control = raw[:65536].translate(None, bytes(range(32, 256)) + b"\t\r\n\f")
    if control:
        raise RecordingError(f"{path}: not a text file (it holds control bytes)")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _column_in_si(
    table: Table, column: Column, path: Path, quantity: str, references: dict[str, float | None]
) -> Array:
    """Convert a column of a table to SI units.

    Parameters
    ----------
    table : Table
        Table of the file.
    column : Column
        Column that is converted.
    path : Path
        The file, for messages.
    quantity : str
        Quantity of the column: `time`, `speed`, `torque` or `position`.
    references : dict
        Nominal torque of the motor (N·m) for the key `torque`, and turns per increment for the key
        `position`. They multiply columns with a relative unit, such as %. None if unknown.

    Returns
    -------
    (samples,) array
        Values in SI units.

    Raises
    ------
    RecordingError
        If the unit is relative to an unknown value.
    """
    reference = references[quantity] if column.relative else 1.0
    if reference is None:
        needed = (
            "the increments per motor turn are needed, but encoder_counts is missing from the motor "
            "file or a placeholder: give --counts-per-turn"
        )
        if quantity == "torque":
            needed = "the motor's nominal torque is needed (nominal_torque in the drive file's rig)"
        raise RecordingError(f"{path}: {quantity} is in {column.unit}, so {needed}")
    return table.values[:, column.index] * (column.factor * reference)


def _time_remarks(time: Array, header: dict[str, str]) -> Iterator[str]:
    """Yield remarks on a wrong unit of the time, and on missing samples.

    The unit seems wrong if the median distance of the samples is less than half or more than twice
    the sampling period in the header. Samples are missing where the distance is a multiple of the
    median. They are mentioned if they exceed `LARGEST_OMITTED_SHARE`.

    Parameters
    ----------
    time : (samples,) array
        Times (s).
    header : dict
        Texts above the table by label. `sampling period` is in ms.

    Yields
    ------
    str
        One sentence for each finding.
    """
    period = header.get("sampling period", "")
    steps = 1e3 * np.diff(time)
    step = float(np.median(steps))
    if NUMBER.fullmatch(period) and float(period) > 0 and not 0.5 < step / float(period) < 2.0:
        yield (
            f"samples lie {step:.3g} ms apart, the header says {period}: is the unit of time right?"
        )
    missing = int(np.sum(np.round(steps / step) - 1))
    if missing > LARGEST_OMITTED_SHARE * len(time):
        yield f"about {missing} samples are missing between the {len(time)} samples of the file"


def _torque_remarks(
    torque: Array, column: Column, nominal_torque: float | None, moving: Mask
) -> Iterator[str]:
    """Yield remarks on a torque channel that seems to be limited, stopped, or in a wrong unit.

    A limited torque has many samples at its largest value and few just below it. A stopped channel
    has one run of equal values that is much longer than all others.

    Parameters
    ----------
    torque : (samples,) array
        Motor torques (N·m).
    column : Column
        Column of the torque in the file, with its unit.
    nominal_torque : float, optional
        Nominal torque of the motor (N·m).
    moving : (samples,) array of bool
        True for the samples in motion.

    Yields
    ------
    str
        One sentence for each finding.
    """
    size = np.abs(torque)
    distance_to_peak = (size.max() - size[moving]) / max(float(np.ptp(size)), 1e-300)
    count_at_peak = np.sum(distance_to_peak < PEAK_BAND)
    count_below_peak = np.sum(distance_to_peak < 2 * PEAK_BAND) - count_at_peak
    repeats = (np.diff(torque) == 0.0) & moving[1:] & moving[:-1]
    run_lengths = [stop - start + 1 for start, stop in true_runs(repeats)]
    second_run, longest_run = sorted([1, 1] + run_lengths)[-2:]
    if count_at_peak >= SUSPICIOUS_COUNT and count_at_peak > PEAK_EXCESS * count_below_peak:
        yield (
            f"torque stays at its largest value in {count_at_peak} samples: limited by the drive, "
            "or stuck?"
        )
    elif longest_run >= max(SUSPICIOUS_COUNT, RUN_RATIO * second_run):
        yield f"torque does not change for {longest_run} samples in a row: did the channel stop?"
    if column.relative and column.factor == 0.01 and nominal_torque is not None:
        yield from _percent_remarks(torque / nominal_torque, column.unit)


def _percent_remarks(share: Array, unit: str) -> Iterator[str]:
    """Yield a remark if a torque that is labelled % seems to be in ‰.

    This is so if all values are whole numbers and some exceed 100 %, or if the mean
    |torque| is more than a motor can sustain.

    Parameters
    ----------
    share : (samples,) array
        Motor torques, divided by the nominal torque.
    unit : str
        Unit in the file.

    Yields
    ------
    str
        The remark.
    """
    percent = 100 * share
    size = np.abs(share)
    is_whole = bool(np.all(np.abs(percent - np.round(percent)) < 1e-6)) and size.max() > 1.0
    if is_whole or np.mean(size) > UNSUSTAINABLE_TORQUE_RATIO:
        remark = ", in whole numbers" if is_whole else ""
        yield (
            f"torque reaches {np.abs(percent).max():.0f} % of the nominal torque{remark}: are the "
            f"values ‰, labelled {unit}?"
        )


def remove_repetitions(recordings: list[Recording]) -> tuple[list[Recording], list[str]]:
    """Remove recordings that repeat another one, so that no measurement counts twice.

    A recording is a repetition if another one that is at least as long contains more than
    `REPEATED_SHARE` of its passages. A passage consists of `PASSAGE_LENGTH` consecutive samples of
    speed and torque, rounded to 1e-6 rad/s and 1e-9 N·m. A shorter recording is one passage.

    Parameters
    ----------
    recordings : list of Recording
        Recordings, of which the first one of equal length is kept.

    Returns
    -------
    recordings : list of Recording
        The remaining recordings in their order.
    remarks : list of str
        A sentence on each removed recording.
    """
    originals: list[tuple[str, set[int]]] = []
    remarks: dict[int, str] = {}
    for recording in sorted(recordings, key=lambda item: -len(item.w)):
        samples = np.column_stack([recording.w / 1e-6, recording.tau / 1e-9])
        rounded = np.round(samples).astype(np.int64)
        starts = range(max(len(rounded) - PASSAGE_LENGTH, 0) + 1)
        passages = {hash(rounded[k : k + PASSAGE_LENGTH].tobytes()) for k in starts}
        minimum = REPEATED_SHARE * len(passages)
        sources = [name for name, earlier in originals if len(passages & earlier) > minimum]
        if sources:
            text = f"{recording.name}: the same samples as {sources[0]}, counted once"
            remarks[id(recording)] = text
        else:
            originals.append((recording.name, passages))
    remaining = [item for item in recordings if id(item) not in remarks]
    return remaining, [remarks[id(item)] for item in recordings if id(item) in remarks]


def true_runs(mask: Mask) -> list[list[int]]:
    """Find the runs of consecutive True values in a mask.

    Parameters
    ----------
    mask : (samples,) array of bool
        The mask.

    Returns
    -------
    list of [int, int]
        Index of the first value of each run, and one past the index of its last value.
    """
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(int))
    return np.flatnonzero(edges).reshape(-1, 2).tolist()


def trapezoidal_integral(time: Array, rate: Array) -> Array:
    """Integrate a rate over time by the trapezoidal rule.

    Parameters
    ----------
    time : (samples,) array
        Increasing times (s).
    rate : (samples,) array
        Rates, for example speeds (rad/s).

    Returns
    -------
    (samples,) array
        Integrals from the first sample to each sample, for example angles (rad).
    """
    return np.append(0.0, np.cumsum(np.diff(time) * (rate[1:] + rate[:-1]) / 2))


def rms(values: Array) -> float:
    """Compute the root mean square of values.

    Parameters
    ----------
    values : (n,) array
        Values of any unit.

    Returns
    -------
    float
        Root mean square in the same unit.
    """
    return math.sqrt(np.mean(values**2))


def largest_magnitude(values: Array) -> float:
    """Find the largest magnitude of values.

    Parameters
    ----------
    values : (n,) array
        Values of any unit.

    Returns
    -------
    float
        Largest magnitude in the same unit.
    """
    return float(np.abs(values).max())


def smallest_step(values: Array, decimals: int) -> float:
    """Find the smallest difference between distinct values, which is the resolution of a channel.

    Parameters
    ----------
    values : (samples,) array
        Values of the channel.
    decimals : int
        Number of decimals to which the values are rounded first.

    Returns
    -------
    float
        Smallest nonzero difference in the unit of the values. 0 if all values are equal.
    """
    steps = np.diff(np.unique(np.round(values, decimals)))
    return float(steps.min()) if len(steps) else 0.0
