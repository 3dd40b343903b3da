"""Read paths from tables of points.

A table contains joint positions, task coordinates, or tip positions and spin. Its headings state
the units. `path_from` reads the table that the motion `path` of a problem file names.
`locate_table_errors` adds the line of the table to later errors about its points.
"""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from ssm_planner.errors import ProblemError
from ssm_planner.loading.tables import table_rows
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem import TASK_COORDINATES, Follow, Joints, Motion, Point, Task, Tip
from ssm_planner.units import ANGLES, LENGTHS, split_heading

MAX_POINTS = 20_000
"""Largest number of points in a table."""
JOINT_COLUMNS = ("q1", "q2", "q3", "q4")
"""Names of the columns with joint positions."""
TIP_COLUMNS = ("x", "y", "z")
"""Names of the columns with the position of the tip."""
COORDINATE_COLUMNS = (*JOINT_COLUMNS, *TASK_COORDINATES, *TIP_COLUMNS)
"""Names of all columns with coordinates."""
IGNORED_COLUMNS = re.compile(r"t|time.*|qd+\d|motor\d_.*")
"""Columns of trajectories that a path does not need."""
COLUMN_FORMS = (
    "q1, q2, q3, q4; or any of roll, tilt, spin, depth; or x, y, z and spin: each with its "
    "unit, such as 'tilt [deg]'"
)
"""Description of the sets of columns that a table may have, for messages."""


def path_from(section: Section, name: str, line: int | None) -> Follow:
    """Read the table that a key names, and build the motion through its points.

    Parameters
    ----------
    section : Section
        Section that contains the file name of the table, which is relative to the section's file.
    name : str
        Name of the motion.
    line : int or None
        Line of the motion for messages.

    Returns
    -------
    Follow
        Motion through the points of the table.

    Raises
    ------
    ProblemError
        If the table is missing or invalid.
    """
    file = Path(section.value) if section.file is None else section.file.parent / section.value
    if not file.is_file():
        reason = "is not a file" if file.exists() else "does not exist"
        raise section.error(
            f"the file {file} {reason}", allowed="a CSV file, named relative to this one"
        )
    rows = table_rows(file)
    columns = _identify_columns(*next(rows), file)
    points: list[Point] = []
    for row, cells in rows:
        points.append(_build_point(_row_values(cells, columns, (file, row)), row))
        if len(points) > MAX_POINTS:
            raise ProblemError(
                "too many points", file=file, line=row, allowed=f"at most {MAX_POINTS}"
            )
    if len(points) < 2:
        raise ProblemError(
            "a path needs more than one point" if points else "no point",
            file=file,
            allowed="at least two",
        )
    return Follow(points[-1], tuple(points[:-1]), name, curve="samples", file=str(file), line=line)


def _identify_columns(line: int, names: list[str], file: Path) -> Mapping[str, tuple[int, float]]:
    """Determine which columns of a table contain the coordinates of its points.

    The coordinates are joint positions, task coordinates, or tip position and spin.

    Parameters
    ----------
    line : int
        Line of the headings.
    names : list of str
        Headings, such as `tilt [deg]`.
    file : Path
        The table, for messages.

    Returns
    -------
    mapping of (int, float)
        Index of the column and factor to SI units, by coordinate such as "q1" or "tilt".

    Raises
    ------
    ProblemError
        If the headings do not describe exactly one kind of coordinates.
    """

    def refused(reason: str, key: str | None = None, allowed: str = COLUMN_FORMS) -> ProblemError:
        """Build an error with the line of the headings. `key` is the faulty heading."""
        return ProblemError(reason, file=file, line=line, key=key, allowed=allowed)

    columns: dict[str, tuple[int, float]] = {}
    for column, name in enumerate(names):
        label, unit = split_heading(name)
        # Prefixes are removed: "task_tilt" becomes "tilt", and "joint_1" and "joint1" become "q1".
        label = re.sub(
            r"^(task|tip|joint)[_ ]",
            lambda match: "q" if match[1] == "joint" else "",
            label.strip().lower(),
        )
        label = re.sub(r"^joint(?=\d$)", "q", label)
        if IGNORED_COLUMNS.fullmatch(label):
            continue
        if label not in COORDINATE_COLUMNS:
            raise refused("unknown coordinate", name)
        units = LENGTHS if label in ("depth", "q4", *TIP_COLUMNS) else ANGLES
        if unit not in units:
            raise refused(f"unknown unit {unit!r}" if unit else "no unit", name, ", ".join(units))
        if label in columns:
            raise refused(f"{label} occurs twice", name)
        columns[label] = column, units[unit]
    names_found = set(columns)
    if names_found & set(JOINT_COLUMNS):
        form: tuple[str, ...] = JOINT_COLUMNS
    elif names_found & set(TIP_COLUMNS) and not set(TASK_COORDINATES) <= names_found:
        form = (*TIP_COLUMNS, "spin")
        if unexpected := sorted(names_found - set(form)):
            raise refused("redundant: the tip determines it", unexpected[0])
    else:
        form = tuple(name for name in TASK_COORDINATES if name in names_found)
    if missing := [name for name in form if name not in names_found]:
        raise refused(f"missing column {', '.join(missing)}")
    if not form:
        raise refused("no coordinates")
    return {name: columns[name] for name in form}


def _row_values(
    cells: list[str], columns: Mapping[str, tuple[int, float]], location: tuple[Path, int]
) -> Mapping[str, float]:
    """Convert the cells of a row to values in SI units.

    Parameters
    ----------
    cells : list of str
        Texts of the row.
    columns : Mapping
        Index of the column and factor to SI units of each coordinate.
    location : (Path, int)
        File and line of the row for messages.

    Returns
    -------
    Mapping of float
        Value of each coordinate, rad or m.

    Raises
    ------
    ProblemError
        If a cell is not a finite number.
    """
    values: dict[str, float] = {}
    for name, (column, factor) in columns.items():
        cell = cells[column]
        try:
            values[name] = float(cell) * factor
        except ValueError:
            values[name] = math.nan
        if not math.isfinite(values[name]):
            raise ProblemError(
                "not a finite number" if cell else "no value",
                file=location[0],
                line=location[1],
                key=f"column {name}",
                value=cell or None,
            )
    return values


def _build_point(values: Mapping[str, float], line: int) -> Point:
    """Build a point from the coordinates in a row of a table.

    Parameters
    ----------
    values : mapping of float
        Coordinates in SI units by name of the column.
    line : int
        Line of the point in the table.

    Returns
    -------
    Joints, Tip or Task
        Point in joint positions, tip position and spin, or task coordinates.
    """
    if "q1" in values:
        return Joints((values["q1"], values["q2"], values["q3"], values["q4"]), line)
    if "x" in values:
        return Tip((values["x"], values["y"], values["z"]), values["spin"], line)
    return Task(**values, line=line)


@contextmanager
def locate_table_errors(motion: tuple[Motion, ...]) -> Iterator[None]:
    """Name the table, the line and the column in errors that concern a point of a table.

    The problem checks its points after the table has been read. Its errors name a point such as
    Problem.motion[0].through[7]. This context manager translates them. Other errors are raised
    unchanged.

    Parameters
    ----------
    motion : tuple of Motion
        Motions of the problem.
    """
    try:
        yield
    except ProblemError as error:
        match = re.fullmatch(
            r"Problem\.motion\[(\d+)\]\.(?:to|through\[(\d+)\])\.(.*)", error.key or ""
        )
        entry = motion[int(match[1])] if match else None
        if match is None or not isinstance(entry, Follow) or entry.file is None:
            raise
        point = entry.to if match[2] is None else entry.through[int(match[2])]
        joint = re.fullmatch(r"values\[(\d)\]", match[3])
        column = (
            JOINT_COLUMNS[int(joint[1])]
            if joint
            else {"position": ", ".join(TIP_COLUMNS)}.get(match[3], match[3])
        )
        raise ProblemError(
            error.reason,
            file=entry.file,
            line=point.line,
            key=f"column {column}",
            value=error.value,
            allowed=error.allowed,
        ) from None
