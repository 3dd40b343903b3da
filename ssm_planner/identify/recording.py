"""Recordings of one drive: EPOS recorder exports and CSV files with named columns, read with every repair stated."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ssm_planner.errors import RecordingError
from ssm_planner.identify.columns import Column, Table, find_columns, parse_table
from ssm_planner.problem.values import Array

MAX_BYTES = 64_000_000
"""Largest file read: about two hours at 1 kHz. An EPOS recorder export is some 10 kB."""

MIN_SAMPLES = 8
SPIKE_GAP = 3.0
"""A sample is a spike when its distance to all others exceeds this many times the range of all others."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Speed and torque of one motor over time, SI, in the drive's positive direction; arrays (samples,)."""

    name: str
    time: Array
    w: Array
    tau: Array
    repairs: tuple[str, ...] = ()
    """What was mended or left out, one sentence each."""
    quantum: float = 0.0
    """Resolution of the speed channel, rad/s."""
    header: dict[str, str] = field(default_factory=dict)


def read_recording(path: str | Path, *, nominal_torque: float | None = None, direction: int = 1) -> Recording:
    """Read one recording.

    nominal_torque: N·m behind a torque channel in percent or per mille. direction: sign of the recorded channels.
    Raises RecordingError naming file, line and fault where the file cannot be used.
    """
    path = Path(path)
    text = _read_text(path)
    table = parse_table(text, path)
    columns = find_columns(table, path)
    repairs = list(table.repairs)
    time, speed, torque = (_in_si(table, columns[key], path, nominal_torque) for key in ("time", "speed", "torque"))
    keep = np.isfinite(time) & np.isfinite(speed) & np.isfinite(torque)
    if not keep.all():
        bad = np.flatnonzero(~keep)
        if len(bad) > max(1, 0.05 * len(keep)):
            raise RecordingError(
                f"{path}:{table.lines[bad[0]]}: {len(bad)} of {len(keep)} samples are not finite numbers; "
                "at most 5 % may be left out"
            )
        repairs.append(f"{len(bad)} samples that are not finite left out (first: line {table.lines[bad[0]]})")
    lines = np.asarray(table.lines)[keep]
    time, speed, torque = time[keep], speed[keep], torque[keep]
    _check_time(time, lines, path)
    if len(time) < MIN_SAMPLES:
        raise RecordingError(f"{path}: {len(time)} samples; at least {MIN_SAMPLES} are needed")
    for name, channel in (("torque", torque), ("speed", speed)):
        spikes = find_spikes(channel)
        if len(spikes):
            shown = ", ".join(f"line {lines[k]}" for k in spikes[:5])
            repairs.append(f"{len(spikes)} isolated {name} samples far outside the rest left out ({shown})")
            channel[spikes] = np.nan
    keep = np.isfinite(torque) & np.isfinite(speed)
    time, speed, torque = time[keep], speed[keep], torque[keep]
    if np.ptp(torque) == 0.0 and np.any(speed != 0.0):
        raise RecordingError(
            f"{path}: torque channel {columns['torque'].name!r} is constant while the motor moves: not a measurement"
        )
    return Recording(
        name=path.name,
        time=time - time[0],
        w=direction * speed,
        tau=direction * torque,
        repairs=tuple(repairs),
        quantum=_quantum(speed),
        header=table.header,
    )


def read_recordings(
    paths: list[str | Path] | tuple[str | Path, ...], *, nominal_torque: float | None = None, direction: int = 1
) -> list[Recording]:
    """Read files and all `*.csv` and `*.txt` files below directories, sorted within each directory."""
    files: list[Path] = []
    for entry in map(Path, paths):
        if entry.is_dir():
            found = sorted(p for p in entry.rglob("*") if p.suffix.lower() in (".csv", ".txt") and p.is_file())
            if not found:
                raise RecordingError(f"{entry}: no .csv or .txt file in this directory")
            files.extend(found)
        else:
            files.append(entry)
    return [read_recording(file, nominal_torque=nominal_torque, direction=direction) for file in files]


def find_spikes(values: Array, most: float = 0.01) -> Array:
    """Indices of isolated samples whose distance to the rest exceeds SPIKE_GAP times the range of the rest.

    At most a share `most` of the samples (one, for short recordings), else they are no isolated samples: then none.
    """
    order = np.argsort(values, kind="stable")
    ranked = values[order]
    low, high = 0, len(values) - 1
    allowed = max(1, int(most * len(values)))
    for taken in range(allowed + 1):
        below, above = ranked[low + 1] - ranked[low], ranked[high] - ranked[high - 1]
        gap_low = below > SPIKE_GAP * max(ranked[high] - ranked[low + 1], 1e-12)
        gap_high = above > SPIKE_GAP * max(ranked[high - 1] - ranked[low], 1e-12)
        if not (gap_low or gap_high):
            return np.sort(np.concatenate([order[:low], order[high + 1 :]])).astype(int)
        if taken == allowed:
            break
        if gap_low:
            low += 1
        else:
            high -= 1
    return np.zeros(0, dtype=int)


def _read_text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise RecordingError(
                f"{path}: {size / 1e6:.0f} MB; recordings up to {MAX_BYTES / 1e6:.0f} MB are read, cut it into parts"
            )
        raw = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not raw.strip():
        raise RecordingError(f"{path}: the file is empty")
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError as error:
            raise RecordingError(f"{path}: not a text file") from error
    control = raw[:65536].translate(None, bytes(range(32, 256)) + b"\t\r\n\f")
    if control:
        raise RecordingError(f"{path}: not a text file (it holds control bytes)")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _in_si(table: Table, column: Column, path: Path, nominal_torque: float | None) -> Array:
    values = table.values[:, column.index]
    if column.of_nominal:
        if nominal_torque is None:
            raise RecordingError(
                f"{path}: torque is in {column.unit}, so the motor's nominal torque is needed "
                "(nominal_torque in the drive file's rig)"
            )
        return values * (column.factor * nominal_torque)
    return values * column.factor


def _check_time(time: Array, lines: Array, path: Path) -> None:
    backwards = np.flatnonzero(np.diff(time) <= 0)
    if len(backwards):
        k = backwards[0] + 1
        raise RecordingError(f"{path}:{lines[k]}: time does not increase ({time[k]:g} s after {time[k - 1]:g} s)")


def _quantum(speed: Array) -> float:
    steps = np.diff(np.unique(np.round(speed, 6)))
    return float(steps.min()) if len(steps) else 0.0
