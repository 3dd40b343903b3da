"""The trajectory as CSV, units in the header names: at a fixed rate, or at the points that keep the limits.

Trajectories in CSV files: a header that names joints and units, one row for each point.
"""

from __future__ import annotations

import math
import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.dynamics.motors import directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.epos4_setup import INT32, axes_of, encoder_notes, fits
from ssm_planner.formats.points import LONG, Points, Reading, Table, join_points
from ssm_planner.formats.spline_points import at_times, spline_points
from ssm_planner.formats.trajectory_csv import Heading, headings
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import BLOCK, Samples, Trajectory
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check

RATE, ROWS = 1000.0, 100_000
"""Hz; and rows beyond which a long motion is written at a tenth of it, a hundredth, …"""
LARGEST_RATE = 100_000.0
STATES = {"q": "", "qd": "_per_s", "qdd": "_per_s2", "qddd": "_per_s3"}
MOTORS = {"angle": "rad", "speed": "rad_per_s", "torque": "Nm"}
COLUMNS = (*STATES, *MOTORS, "task")
"""Groups of columns that can be chosen."""
COUNTS = "counts"
DEFAULT = ("q", "qd", "qdd", "angle", "speed", "torque")


def trajectory_table(
    trajectory: Trajectory, robot: Robot, rate: float = RATE, columns: Sequence[str] = DEFAULT
) -> tuple[list[str], Array]:
    """Header and rows (samples, columns): time, and for every group of `columns` the values of the joints or motors.

    At a break the row holds what follows it; the last row is the end of the motion, whatever the rate.
    """
    samples = trajectory.uniform(rate)
    return table(samples, robot, columns, at_end=samples.t == trajectory.breaks[-1])


def table(
    samples: Samples, robot: Robot, columns: Sequence[str], at_end: Array
) -> tuple[list[str], Array]:
    """Header and rows of samples; at_end (n,): the motion ends there, motors are seen just before."""
    header, values = ["time_s"], [samples.t]
    names = [f"{i + 1}_{joint.unit}" for i, joint in enumerate(robot.joints)]
    for symbol, per in STATES.items():
        if symbol in columns:
            header += [f"{symbol}{name}{per}" for name in names]
            values += list(getattr(samples, symbol).T)
    if any(group in columns for group in MOTORS):
        after, before = (directions(robot, samples, side) for side in (1, -1))
        ending = at_end.astype(bool)[:, None]
        direction = np.where(ending, before[0], after[0])
        motor = motor_motion(
            robot, RigidBody.from_robot(robot), samples, direction, after[1].astype(bool) & ~ending
        )
        for group, unit in MOTORS.items():
            if group in columns:
                driven = [i for i, joint in enumerate(robot.joints) if joint.drive is not None]
                header += [f"motor{i + 1}_{group}_{unit}" for i in driven]
                values += [getattr(motor, group)[:, i] for i in driven]
    if "task" in columns:
        header += [f"task_{name}_{'m' if name == 'depth' else 'rad'}" for name in TASK]
        mechanism = Mechanism.from_geometry(robot.geometry)
        header += [f"tip_{axis}_m" for axis in "xyz"]
        values += [*task_from_joints(mechanism, samples.q).T, *tip_position(mechanism, samples.q).T]
    return header, np.stack(values, axis=1)


def write_csv(
    path: Path,
    trajectory: Trajectory,
    robot: Robot,
    rate: float | None = None,
    columns: Sequence[str] = DEFAULT,
) -> Path:
    """Write the table at a rate, or at RATE as far as ROWS allow; 12 significant digits. Raises ExportError."""
    if rate is None:
        rate = RATE / 10.0 ** max(math.ceil(math.log10(trajectory.duration * RATE / ROWS)), 0)
    header, rows = trajectory_table(trajectory, robot, rate, columns)
    with replacing(path) as temporary:
        _write(temporary, header, rows, "%.12g")
    return path


def export_csv(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float | None = None,
    columns: Sequence[str] | None = None,
    counts_per_turn: int | Mapping[str, int] | None = None,
) -> dict[str, object]:
    """Write trajectory.csv into a folder and say what the manifest shall say of it.

    rate: Hz, rows at equal distances; None: rows at the points between which cubics (or quintics) keep the limits.
    columns: groups of COLUMNS; with COUNTS among them also `time,position` files in increments, one for each driven
    joint, at the rate (default RATE), for which counts_per_turn is as in the export to epos4. Raises ExportError.
    """
    wanted = [group for group in columns or () if group != COUNTS]
    unknown = [group for group in wanted if group not in COLUMNS]
    if unknown:
        raise ExportError(
            f"columns {', '.join(unknown)} are not known (allowed: {', '.join((*COLUMNS, COUNTS))})"
        )
    if rate is not None and not 0 < rate <= LARGEST_RATE:
        raise ExportError(f"a rate of {rate:g} Hz (allowed: above 0, up to {LARGEST_RATE:g} Hz)")
    notes = []
    if COUNTS in (columns or ()):
        notes += _write_counts(plan, folder, suffix, rate or RATE, counts_per_turn)
        if not wanted:
            return {
                "rate_hz": rate or RATE,
                "units": {"time": "s", "position": "increments"},
                "notes": notes,
            }
    path = folder / f"trajectory{suffix}.csv"
    header, rows, note = _rows(plan, certificate, rate, wanted)
    _write(path, header, rows, "%.17g")
    return {
        "trajectory": path.name,
        "rate_hz": rate,
        "units": "in the names of the columns",
        "notes": [*notes, note, *_as_read(path, plan, with_positions="q1_rad" in header)],
    }


def _rows(
    plan: Plan, certificate: Certificate, rate: float | None, columns: Sequence[str]
) -> tuple[list[str], Array, str]:
    """(header, rows, what they are)."""
    if rate is None:
        points = spline_points(plan, certificate, tick=None)
        default = ("q", "qd", "qdd") if points.with_acceleration else ("q", "qd")
        at_end = points.samples.t == points.samples.t[-1]
        return *table(points.samples, plan.robot, columns or default, at_end), points.note
    header, rows = trajectory_table(plan.motion, plan.robot, rate, columns or DEFAULT)
    return header, rows, f"{len(rows)} rows at {rate:g} Hz; the last row is the end of the motion"


def _write_counts(
    plan: Plan,
    folder: Path,
    suffix: str,
    rate: float,
    counts_per_turn: int | Mapping[str, int] | None,
) -> list[str]:
    """Target positions in increments, a file for each driven joint; the last row holds the target."""
    axes = axes_of(plan.robot, counts_per_turn)
    t = np.arange(int(np.ceil(plan.motion.duration * rate - 1e-9)) + 1) / rate
    samples = at_times(plan, plan.motion.breaks[0] + t)
    for i, joint in enumerate(plan.robot.joints):
        if joint.name in axes:
            counts = axes[joint.name].increments(samples.q[:, i])
            counts = fits(counts, INT32, joint.name, "target position", "increments")
            path = folder / f"{joint.name}_time_position{suffix}.csv"
            _write(path, ["time", "position"], np.column_stack([t, counts]), ("%.9g", "%d"))
    return [
        f"time,position in increments of {', '.join(axes)}: {len(t)} rows at {rate:g} Hz",
        *encoder_notes(axes),
    ]


def _as_read(path: Path, plan: Plan, with_positions: bool) -> list[str]:
    """What a check of the rows alone says, joined as a controller would join them."""
    if not with_positions:
        return []
    reading = read_csv(path, plan.robot)
    found = check(
        reading.trajectory,
        plan.robot,
        plan.limits,
        resolution=reading.resolution,
        interpolation=reading.interpolation,
    )
    if found.passed:
        return [f"joined by a controller, {reading.interpolation}, the rows keep every limit"]
    worst = found.worst
    return [
        f"joined by a controller, {reading.interpolation}, the rows exceed the {worst.name} limit of "
        f"{worst.joint or 'the tool'} by {-100 * worst.margin:.3g} % at {worst.time:.4f} s: equal distances do not meet "
        "the instants where the plan's acceleration jumps; without a rate the rows do"
    ]


def _write(path: Path, header: list[str], rows: Array, form: str | Sequence[str]) -> None:
    np.savetxt(path, rows, fmt=form, delimiter=",", header=",".join(header), comments="")


SEPARATORS = (",", ";", "\t")
LOOK = 1000
"""Rows whose digits tell how the positions were rounded."""
FINEST_DIGIT = 400
"""No float has a finer one."""


@dataclass(frozen=True)
class Layout:
    """Where the table begins and how it is separated."""

    header: int
    """Line of the header, from 0."""
    separator: str
    names: list[str]


def read_csv(path: Path, robot: Robot) -> Reading:
    """The trajectory in a CSV file. Raises TrajectoryError naming file, line and fault."""
    layout = _layout(path)
    found, ignored = headings(layout.names, robot, f"{path}:{layout.header + 1}")
    # time, then positions, velocities, accelerations
    wanted = [found[key] for key in sorted(found)]
    rows = _data_rows(path, layout, wanted)
    q = rows.columns(0)
    qd, qdd = (rows.columns(4 * order) if (order, 0) in found else None for order in (1, 2))
    resolution = None if qd is not None else _resolution(path, layout, wanted[1:])
    t = np.concatenate(rows.times)
    points = Points(
        t, q, qd, qdd, resolution=resolution, place=lambda k: f"{path}:{_line_of(path, layout, k)}"
    )
    notes = (f"columns not used: {', '.join(ignored)}",) if ignored else ()
    return join_points(points, robot, notes)


class _Rows:
    """Rows of a table, block after block: in memory, and beyond LONG of them in a temporary file."""

    def __init__(self) -> None:
        self.times: list[Array] = []
        self.blocks: list[Array] = []
        self.count = 0
        self.file: IO[bytes] | None = None

    def add(self, rows: Array) -> None:
        """Rows (m, 1 + k): time and the other columns."""
        self.times.append(rows[:, 0].copy())
        self.blocks.append(rows[:, 1:])
        self.count += len(rows)
        if self.count > LONG:
            self.file = self.file or tempfile.TemporaryFile()  # noqa: SIM115 - open as long as it is read
            for block in self.blocks:
                self.file.write(block.tobytes())
            self.blocks = [rows[:0, 1:]]

    def columns(self, first: int) -> Table:
        """Columns (n, 4) from one after the time on."""
        if self.file is None:
            return np.concatenate([block[:, first : first + 4] for block in self.blocks])
        self.file.flush()
        return _InFile(self.file, (self.count, self.blocks[0].shape[1]), first)


@dataclass(frozen=True, eq=False)
class _InFile:
    """Four columns of a table of this shape in a file, which goes away with the last of its readers."""

    file: IO[bytes]
    shape: tuple[int, ...]
    first: int

    def __getitem__(self, chosen: Indices | slice, /) -> Array:
        count, width = self.shape
        if not isinstance(chosen, slice):
            return np.concatenate([self[k : k + 1] for k in chosen.tolist()])
        first, end, _ = chosen.indices(count)
        self.file.seek(8 * width * first)
        rows: Array = np.frombuffer(self.file.read(8 * width * (end - first))).reshape(-1, width)
        return rows[:, self.first : self.first + 4].copy()


def _layout(path: Path) -> Layout:
    """The first line that is neither empty nor a comment must be the header."""
    for k, line in _lines(path):
        text = line.strip().lstrip("\ufeff")
        if not text or text.startswith("#"):
            continue
        separator = max(SEPARATORS, key=text.count)
        names = [name.strip().strip('"') for name in text.split(separator)]
        if len(names) < 2:
            raise TrajectoryError(
                f"{path}:{k + 1}: no columns (separated by a comma, semicolon or tab)"
            )
        if all(_number(name) for name in names):
            raise TrajectoryError(
                f"{path}:{k + 1}: no header: the first row must name each column with its unit, such as "
                "time_s,q1_rad,q2_rad,q3_rad,q4_m"
            )
        return Layout(k, separator, names)
    raise TrajectoryError(f"{path}: the file is empty")


def _data_rows(path: Path, layout: Layout, wanted: Sequence[Heading]) -> _Rows:
    """The wanted columns of all rows, SI."""
    columns, factors = (
        [heading.column for heading in wanted],
        [heading.factor for heading in wanted],
    )
    all_columns = sorted(columns) == list(
        range(len(layout.names))
    )  # then their number is looked at too
    read, found = _Rows(), None
    try:
        with path.open(encoding="utf-8-sig") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a block without rows
            for _ in range(layout.header + 1):
                file.readline()
            while found is None or len(found) == BLOCK:
                used = None if all_columns else columns
                found = np.loadtxt(
                    file,
                    comments=None,
                    delimiter=layout.separator,
                    usecols=used,
                    ndmin=2,
                    max_rows=BLOCK,
                )
                if len(found) and all_columns and found.shape[1] != len(columns):
                    raise ValueError("rows of another width than the header")
                if len(found):
                    read.add((found[:, columns] if all_columns else found) * factors)
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: not a text file") from error
    except ValueError as error:
        raise TrajectoryError(_fault(path, layout, str(error), read.count)) from error
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error
    except OverflowError as error:
        raise TrajectoryError(f"{path}: holds a number that no float can hold") from error
    if not read.count:
        raise TrajectoryError(f"{path}: the header is there, but no row follows it")
    width = len(layout.names)
    last = _last_line(path)
    if last and len(last.split(layout.separator)) < width:
        raise TrajectoryError(f"{path}: the last row has fewer than {width} columns: cut off")
    return read


def _fault(path: Path, layout: Layout, message: str, first: int) -> str:
    """What is wrong with the first bad row, which is not before this one."""
    width = len(layout.names)
    for k, line in islice(_data_lines(path, layout), first, None):
        fields = [field.strip() for field in line.split(layout.separator)]
        if len(fields) != width:
            return f"{path}:{k + 1}: {len(fields)} columns where the header has {width}"
        for name, field in zip(layout.names, fields, strict=True):
            if not _number(field):
                return f"{path}:{k + 1}: {name}: {field[:40]!r} is not a number"
    return f"{path}: {message}"


def _resolution(path: Path, layout: Layout, positions: list[Heading]) -> Array:
    """Half a unit of the last digit that the first rows write of each position, rad or m."""
    exponents = np.full(4, 99)
    for count, (_, line) in enumerate(_data_lines(path, layout)):
        if count == LOOK:
            break
        fields = line.split(layout.separator)
        for i, heading in enumerate(positions):
            exponents[i] = min(exponents[i], _last_digit(fields[heading.column].strip()))
    factors = np.array([heading.factor for heading in positions])
    return np.where(exponents < 99, 0.5 * 10.0**exponents, 0.0) * factors


def _last_digit(text: str) -> int:
    """Power of ten of the last digit written; 99 for a zero, which says nothing."""
    mantissa, _, exponent = text.lower().partition("e")
    if not mantissa.strip("+-0."):
        return 99
    power = int(exponent[:12] or 0) if exponent[1:12].isdecimal() or exponent.isdecimal() else 0
    return min(max(power, -FINEST_DIGIT), FINEST_DIGIT) - len(mantissa.partition(".")[2])


def _line_of(path: Path, layout: Layout, row: int) -> int:
    for count, (k, _) in enumerate(_data_lines(path, layout)):
        if count == row:
            return k + 1
    return layout.header + 2 + row


def _data_lines(path: Path, layout: Layout) -> Iterator[tuple[int, str]]:
    for k, line in _lines(path):
        if k > layout.header and line.strip():
            yield k, line.rstrip("\n")


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    try:
        with path.open(encoding="utf-8-sig", newline=None) as file:
            yield from enumerate(file)
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: not a text file") from error
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error


def _last_line(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 4096))
        lines = [
            line
            for line in file.read().decode("utf-8", errors="replace").splitlines()
            if line.strip()
        ]
    return lines[-1] if lines else ""


def _number(text: str) -> bool:
    return (
        re.fullmatch(
            r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?(nan|inf(inity)?)", text.strip(), re.I | re.A
        )
        is not None
    )
