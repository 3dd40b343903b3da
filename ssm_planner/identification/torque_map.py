"""The torque–velocity map: one point, mean speed and mean torque, per steady-state recording."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ssm_planner.dynamics.friction import STANDSTILL
from ssm_planner.errors import RecordingError
from ssm_planner.identification.recordings import Recording
from ssm_planner.typing import Array

FIGURES_HEADER = (
    "rig",
    "recording",
    "velocity_rad_s",
    "torque_N_m",
    "velocity_deviation_rad_s",
    "torque_deviation_N_m",
    "samples",
)
"""Columns of a table of figures; speed and torque at the motor, in the drive's positive direction."""

REST_TIME = 0.3
REST_SAMPLES = 6
"""Readings of zero speed that last this long (s and samples) are rest; shorter ones, motion below the resolution."""

FLICKER = 0.05
"""Motions shorter than REST_SAMPLES and slower than this share of the usual speed are noise of the channel."""


@dataclass(frozen=True, eq=False)
class TorqueMap:
    """Points of a map, arrays (points,), sorted by speed; SI at the motor."""

    names: tuple[str, ...]
    w: Array
    tau: Array
    w_deviation: Array
    tau_deviation: Array
    samples: Array
    repairs: tuple[str, ...] = ()


def rest_mask(time: Array, w: Array) -> Array:
    """(samples,) of bool: True where the drive stands, not merely turns too slowly for the speed channel.

    Flickers of the speed channel, brief motions far slower than the recording's others, count as standing.
    """
    still = np.abs(w) <= STANDSTILL
    fast = FLICKER * float(np.quantile(np.abs(w[~still]), 0.9)) if not still.all() else 0.0
    for start, stop in _runs(~still):
        if stop - start < REST_SAMPLES and np.max(np.abs(w[start:stop])) < fast:
            still[start:stop] = True
    rest = np.zeros(len(w), dtype=bool)
    for start, stop in _runs(still):
        long = stop - start >= REST_SAMPLES and time[stop - 1] - time[start] >= REST_TIME
        at_end = start == 0 or stop == len(w)
        turns = not at_end and w[start - 1] * w[stop] < 0
        rest[start:stop] = long or turns
    return rest


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """(first, one past last) of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def kind_of(recording: Recording) -> Literal["steady", "start_stop"]:
    """Steady motion in one direction, or starts, stops and reversals; RecordingError where nothing moves."""
    forward = np.sum(recording.w[recording.w > 0])
    backward = -np.sum(recording.w[recording.w < 0])
    if forward + backward == 0.0:
        raise RecordingError(f"{recording.name}: the motor never moves")
    if min(forward, backward) > 0.05 * (forward + backward):
        return "start_stop"
    unloaded = np.abs(recording.tau) < 0.1 * np.quantile(np.abs(recording.tau), 0.95)
    standing = rest_mask(recording.time, recording.w) & unloaded
    return "start_stop" if np.mean(standing) > 0.05 else "steady"


def torque_map(recordings: Sequence[Recording]) -> TorqueMap:
    """Means of steady-state recordings, sorted by speed."""
    order = sorted(recordings, key=lambda recording: float(recording.w.mean()))
    repairs = [f"{r.name}: {repair}" for r in order for repair in r.repairs]
    for r in order:
        if r.w.std() > abs(r.w.mean()):
            repairs.append(
                f"{r.name}: speed noisier than its mean ({r.w.std():.3g} > {abs(r.w.mean()):.3g} rad/s), kept"
            )
    return TorqueMap(
        names=tuple(r.name for r in order),
        w=np.array([r.w.mean() for r in order]),
        tau=np.array([r.tau.mean() for r in order]),
        w_deviation=np.array([r.w.std() for r in order]),
        tau_deviation=np.array([r.tau.std() for r in order]),
        samples=np.array([len(r.w) for r in order], dtype=float),
        repairs=tuple(repairs),
    )


def write_figures(path: str | Path, maps: dict[str, TorqueMap], source: str) -> None:
    """Write a table of figures, one map per rig name; `source` becomes its comment lines."""
    with Path(path).open("w", newline="", encoding="utf-8") as stream:
        for line in source.splitlines():
            stream.write(f"# {line}\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(FIGURES_HEADER)
        for rig, m in maps.items():
            for k, name in enumerate(m.names):
                numbers = (m.w[k], m.tau[k], m.w_deviation[k], m.tau_deviation[k])
                writer.writerow([rig, name, *(f"{v:.9g}" for v in numbers), int(m.samples[k])])


def read_figures(path: str | Path, rig: str) -> TorqueMap:
    """The map of one rig from a table written by `write_figures`; RecordingError naming file, line and fault."""
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: the table of figures cannot be read ({error})") from error
    numbered = [(k + 1, line) for k, line in enumerate(lines) if line.strip() and not line.startswith("#")]
    if not numbered or tuple(numbered[0][1].split(",")) != FIGURES_HEADER:
        raise RecordingError(f"{path}: the first line must be {','.join(FIGURES_HEADER)}")
    names, rows, rigs = [], [], []
    for number, line in numbered[1:]:
        fields = next(csv.reader([line]))
        rigs.append(fields[0])
        if fields[0] != rig:
            continue
        try:
            row = [float(field) for field in fields[2:]]
        except ValueError as error:
            raise RecordingError(f"{path}:{number}: {error}") from error
        if len(row) != len(FIGURES_HEADER) - 2 or not np.all(np.isfinite(row)):
            raise RecordingError(f"{path}:{number}: {len(FIGURES_HEADER)} finite columns are needed")
        names.append(fields[1])
        rows.append(row)
    if not rows:
        raise RecordingError(
            f"{path}: no figures of {rig!r}; rigs in the table: {', '.join(sorted(set(rigs))) or 'none'}"
        )
    table = np.array(rows)
    order = np.argsort(table[:, 0], kind="stable")
    table = table[order]
    w, tau, w_deviation, tau_deviation, samples = np.ascontiguousarray(table.T)
    return TorqueMap(tuple(names[k] for k in order), w, tau, w_deviation, tau_deviation, samples)
