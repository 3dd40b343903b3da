"""Trajectories in CSV files: a header that names joints and units, one row for each point."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.values import Array, Robot
from ssm_planner.verify.columns import Heading, headings
from ssm_planner.verify.interpolation import Points, Reading, join_points

SEPARATORS = (",", ";", "\t")
LOOK = 1000
"""Rows whose digits tell how the positions were rounded."""
ORDERS = ("position", "velocity", "acceleration")


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
    wanted = sorted(found.values(), key=lambda heading: heading.column)
    rows = _data_rows(path, layout, [heading.column for heading in wanted])
    place = {heading: k for k, heading in enumerate(wanted)}

    def gather(order: int) -> Array | None:
        chosen = [found.get((order, i)) for i in range(4)]
        if any(heading is None for heading in chosen):
            return None
        values: Array = rows[:, [place[heading] for heading in chosen if heading is not None]]
        values *= [heading.factor for heading in chosen if heading is not None]
        return values

    q, qd, qdd = (gather(order) for order in range(3))
    time = found[(-1, 0)]
    if q is None:
        raise TrajectoryError(f"{path}: positions of all four joints are needed")
    resolution = None if qd is not None else _resolution(path, layout, [found[(0, i)] for i in range(4)])
    t = rows[:, place[time]] * time.factor
    points = Points(t, q, qd, qdd, resolution=resolution, place=lambda k: f"{path}:{_line_of(path, layout, k)}")
    notes = (f"columns not used: {', '.join(ignored)}",) if ignored else ()
    return join_points(points, robot, notes)


def _layout(path: Path) -> Layout:
    """The first line that is neither empty nor a comment must be the header."""
    for k, line in _lines(path):
        text = line.strip().lstrip("\ufeff")
        if not text or text.startswith("#"):
            continue
        separator = max(SEPARATORS, key=text.count)
        names = [name.strip().strip('"') for name in text.split(separator)]
        if len(names) < 2:
            raise TrajectoryError(f"{path}:{k + 1}: no columns (separated by a comma, semicolon or tab)")
        if all(_number(name) for name in names):
            raise TrajectoryError(
                f"{path}:{k + 1}: no header: the first row must name each column with its unit, such as "
                "time_s,q1_rad,q2_rad,q3_rad,q4_m"
            )
        return Layout(k, separator, names)
    raise TrajectoryError(f"{path}: the file is empty")


def _data_rows(path: Path, layout: Layout, columns: list[int]) -> Array:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without rows, which is said below
            rows = np.loadtxt(
                path,
                comments=None,
                delimiter=layout.separator,
                skiprows=layout.header + 1,
                usecols=None if columns == list(range(len(layout.names))) else columns,
                ndmin=2,
                encoding="utf-8",
            )
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: not a text file") from error
    except ValueError as error:
        raise TrajectoryError(_fault(path, layout, str(error))) from error
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not len(rows):
        raise TrajectoryError(f"{path}: the header is there, but no row follows it")
    width = len(layout.names)
    last = _last_line(path)
    if last and len(last.split(layout.separator)) < width:
        raise TrajectoryError(f"{path}: the last row has fewer than {width} columns: cut off")
    return rows


def _fault(path: Path, layout: Layout, message: str) -> str:
    """What is wrong with the first bad row."""
    width = len(layout.names)
    for k, line in _data_lines(path, layout):
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
    return int(exponent or 0) - len(mantissa.partition(".")[2])


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
        lines = [line for line in file.read().decode("utf-8", errors="replace").splitlines() if line.strip()]
    return lines[-1] if lines else ""


def _number(text: str) -> bool:
    return re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf(inity)?)", text.strip(), re.I) is not None
