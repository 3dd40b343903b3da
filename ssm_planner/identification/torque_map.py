"""The torque–velocity map: one point, mean speed and mean torque, per steady-state recording; and its outliers.

The maps of the three rigs ship as a table of figures. Regenerate it, from the project's folder, with

    python -m ssm_planner.identification.torque_map problems/drives/rig_figures.csv \\
        problems/drives/rig1_lead_screw.yaml=RECORDINGS/drive1_lead_screw/steady_state …
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ssm_planner.dynamics.friction import STANDSTILL
from ssm_planner.errors import RecordingError, SsmPlannerError
from ssm_planner.identification.harmonics import ripple_of, travelled
from ssm_planner.identification.recordings import Recording, read_recordings
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.posterior import Ripple
from ssm_planner.representation import ShortRepr
from ssm_planner.typing import Array

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
"""Columns of a table of figures; speed and torque at the motor, in the drive's positive direction."""

REST_TIME = 0.3
REST_SAMPLES = 6
"""Readings of zero speed that last this long (s and samples) are rest; shorter ones, motion below the resolution."""

FLICKER = 0.05
"""Motions shorter than REST_SAMPLES and slower than this share of the usual speed are noise of the channel."""

BEYOND = 5.0
"""Robust standard deviations between a point and its neighbours' line that make it an outlier."""

LEAST = 0.005
"""Least deviation assumed, as a share of the torque range: what a bend of the map looks like between its points."""

DRIFT = 0.2
"""Change of speed from the first third of a recording to the last, as a share of its mean, that steady motion never has."""

_KEEP = 3.0
_FEWEST = 5

TABLE = "rig_figures.csv"
"""Name of the table, beside the drive files; its rigs are named by the files' stems."""

SOURCE = """Mean motor speed and torque of steady-state recordings of three rigs, in each rig's positive direction.
Computed by ssm_planner.identification.torque_map from the maxon EPOS4 recordings in the public repository
RViMLab/TRO2021-Dynamic-Modelling (MIT licence, copyright its authors), made for "Friction-Inclusive Modeling of
Sliding Contact Transmission Systems in Robotics", IEEE Transactions on Robotics 37(4), 2021."""


@dataclass(frozen=True, eq=False)
class TorqueMap(ShortRepr):
    """Points of a map, arrays (points,), sorted by speed; SI at the motor."""

    names: tuple[str, ...]
    w: Array
    tau: Array
    w_deviation: Array
    tau_deviation: Array
    """RMS of torque − mean."""
    samples: Array
    repairs: tuple[str, ...] = ()
    ripple: Array | None = None
    """RMS of the part of the torque that repeats with the motor's angle; NaN where it turns less than twice."""
    peak: Array | None = None
    """Largest |torque| less |mean torque|."""

    def spread(self, sign: int) -> Ripple | None:
        """Ripple and noise of the recordings in one direction (±1); None where they are not known."""
        here = np.sign(self.w) == sign
        if (
            self.ripple is None
            or self.peak is None
            or not here.any()
            or not np.all(self.tau_deviation[here] > 0)
        ):
            return None
        deviation, share = self.tau_deviation[here], self.ripple[here] / self.tau_deviation[here]
        usual = float(np.median(share[np.isfinite(share)])) if np.isfinite(share).any() else 0.0
        ripple = deviation * np.where(np.isfinite(share), share, usual)
        return Ripple(
            torque=tuple(np.maximum(np.abs(self.tau[here]), 1e-12)),
            ripple=tuple(ripple),
            noise=tuple(np.sqrt(np.maximum(deviation**2 - ripple**2, 0.0))),
            peak=tuple(np.maximum(self.peak[here], 1e-12)),
        )


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
        third = len(r.w) // 3
        first, last = float(r.w[:third].mean()), float(r.w[-third:].mean())
        if abs(last - first) > max(DRIFT * abs(r.w.mean()), BEYOND * r.w.std() / np.sqrt(third)):
            repairs.append(
                f"{r.name}: speed goes from {first:.3g} to {last:.3g} rad/s, its mean is taken: not steady"
            )
    return TorqueMap(
        names=tuple(r.name for r in order),
        w=np.array([r.w.mean() for r in order]),
        tau=np.array([r.tau.mean() for r in order]),
        w_deviation=np.array([r.w.std() for r in order]),
        tau_deviation=np.array([r.tau.std() for r in order]),
        samples=np.array([len(r.w) for r in order], dtype=float),
        repairs=tuple(repairs),
        ripple=np.array([ripple_of(travelled(r), r.tau) for r in order]),
        peak=np.array([np.abs(r.tau).max() - abs(r.tau.mean()) for r in order]),
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
                assert m.ripple is not None
                assert m.peak is not None
                numbers = (
                    m.w[k],
                    m.tau[k],
                    m.w_deviation[k],
                    m.tau_deviation[k],
                    m.ripple[k],
                    m.peak[k],
                )
                writer.writerow([rig, name, *(f"{v:.9g}" for v in numbers), int(m.samples[k])])


def read_figures(path: str | Path, rig: str) -> TorqueMap:
    """The map of one rig from a table written by `write_figures`; RecordingError naming file, line and fault."""
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: the table of figures cannot be read ({error})") from error
    numbered = [
        (k + 1, line) for k, line in enumerate(lines) if line.strip() and not line.startswith("#")
    ]
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
        if len(row) != len(FIGURES_HEADER) - 2 or not np.all(np.isfinite([*row[:4], *row[5:]])):
            raise RecordingError(
                f"{path}:{number}: {len(FIGURES_HEADER)} finite columns are needed"
            )
        names.append(fields[1])
        rows.append(row)
    if not rows:
        raise RecordingError(
            f"{path}: no figures of {rig!r}; rigs in the table: {', '.join(sorted(set(rigs))) or 'none'}"
        )
    table = np.array(rows)
    order = np.argsort(table[:, 0], kind="stable")
    table = table[order]
    columns = ("w", "tau", "w_deviation", "tau_deviation", "ripple", "peak", "samples")
    return TorqueMap(
        names=tuple(names[k] for k in order),
        **dict(zip(columns, np.ascontiguousarray(table.T), strict=True)),
    )


@dataclass(frozen=True)
class Outlier:
    """A point of a map that stands apart from its neighbours."""

    index: int
    distance: float
    """Measured torque − torque on the line through its neighbours, N·m."""
    weight: float
    """Factor of its residual in a fit, < 1."""


def find_outliers(w: Array, tau: Array) -> list[Outlier]:
    """Isolated points of a torque–velocity map sorted by speed (points,).

    Every point is compared with the line through its two nearest neighbours of the same direction. A law that fits
    badly makes no outliers, since neighbours then deviate alike. Fewer than five points in a direction show nothing.
    """
    left = np.ones(len(w), dtype=bool)
    found: list[Outlier] = []
    for _ in range(len(w) // 4):
        score, distance, deviation = _scores(w, tau, left)
        worst = int(np.argmax(np.abs(score)))
        if not np.abs(score[worst]) > BEYOND:
            break
        left[worst] = False
        weight = _KEEP * deviation / max(abs(distance[worst]), 1e-300)
        found.append(Outlier(worst, float(distance[worst]), float(min(1.0, weight))))
    return sorted(found, key=lambda outlier: outlier.index)


def _scores(w: Array, tau: Array, left: Array) -> tuple[Array, Array, float]:
    """Distance of every point left from its neighbours' line, over its expected deviation; and torque deviation."""
    distance, spread = np.full(len(w), np.nan), np.ones(len(w))
    for sign in (-1.0, 1.0):
        side = np.flatnonzero(left & (np.sign(w) == sign))
        if len(side) < _FEWEST:
            continue
        for place, k in enumerate(side):
            a, b = _neighbours(side, place)
            share = 0.5 if w[a] == w[b] else (w[k] - w[a]) / (w[b] - w[a])
            distance[k] = tau[k] - (1 - share) * tau[a] - share * tau[b]
            spread[k] = np.sqrt(1.0 + (1 - share) ** 2 + share**2)
    known = np.isfinite(distance)
    if not known.any():
        return np.zeros(len(w)), np.zeros(len(w)), 0.0
    deviation = 1.4826 * float(np.median(np.abs(distance[known] / spread[known])))
    deviation = max(deviation, LEAST * float(np.ptp(tau)), 1e-300)
    score = np.where(known, distance / (spread * deviation), 0.0)
    return score, np.where(known, distance, 0.0), deviation


def _neighbours(side: NDArray[np.intp], place: int) -> tuple[int, int]:
    if place == 0:
        return int(side[1]), int(side[2])
    if place == len(side) - 1:
        return int(side[-3]), int(side[-2])
    return int(side[place - 1]), int(side[place + 1])


def rig_map(drive_path: str | Path, recordings: str | Path) -> TorqueMap:
    """The torque–velocity map of a rig from a folder of its recordings; start–stop recordings are left aside."""
    rig = load_drive(drive_path).rig
    nominal, direction = (None, 1) if rig is None else (rig.motor_nominal_torque, rig.direction)
    found = read_recordings([recordings], nominal_torque=nominal, direction=direction)
    return torque_map([recording for recording in found if kind_of(recording) == "steady"])


def main(arguments: list[str]) -> int:
    """Write the table: OUTPUT DRIVE=RECORDINGS …"""
    if len(arguments) < 2 or any("=" not in pair for pair in arguments[1:]):
        print(
            "usage: python -m ssm_planner.identification.torque_map OUTPUT DRIVE=RECORDINGS ...",
            file=sys.stderr,
        )
        return 2
    try:
        pairs = [pair.split("=", 1) for pair in arguments[1:]]
        maps = {Path(drive).stem: rig_map(drive, recordings) for drive, recordings in pairs}
    except SsmPlannerError as error:
        print(error, file=sys.stderr)
        return 2
    write_figures(arguments[0], maps, SOURCE)
    for rig, points in maps.items():
        print(f"{rig}: {len(points.w)} recordings", *points.repairs, sep="\n  ", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
