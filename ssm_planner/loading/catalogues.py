"""Catalogues of motors and gears: CSV tables with units, or folders of YAML files."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.errors import ProblemError
from ssm_planner.loading.drives import drive_from
from ssm_planner.loading.files import read, shipped_folder
from ssm_planner.loading.motors import MotorModel, motor_from
from ssm_planner.loading.yaml_nodes import Section, plain_node
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.typing import JsonObject
from ssm_planner.units import BadQuantity, quantity

T = TypeVar("T", Motor, Drive)

LARGEST_CATALOGUE = 10_000
"""Largest number of entries."""
MOTOR_COLUMNS = {"weight": "mass", "chart_max_torque": "max_torque"}
"""Columns of motor tables and the equivalent keys of motor files.

The torque at the end of a chart is not a rating, and its source states this.
"""
BESIDE = {"mass": "mass", "length": "length"}
"""Kinds of the columns that a catalogue may have in addition to the keys of motor and drive files.
"""
WORM_COLUMNS = {"geometry.wheel_diameter", "geometry.worm_diameter", "geometry.ratio"}
NAMES = {"name", "order_number"}
"""Text columns whose cells may consist of digits."""
FITTED = ("free_length", "ends")
"""Ratings that depend on the robot and not on the chosen screw."""


@dataclass(frozen=True)
class Row:
    """Row of a table with its text by column and its line."""

    label: str
    cells: Mapping[str, Any]
    line: int


@dataclass(frozen=True)
class Part(Generic[T]):
    """Entry of a catalogue. mass (kg) and length (m) are None if they are not stated."""

    label: str
    of: T
    mass: float | None = None
    length: float | None = None


def entries(path: Path, gear: bool = False) -> JsonObject:
    """Return the entries of a catalogue by name, with the keys of motor or drive files.

    Raises ProblemError.
    """
    file = catalogue_file(path)
    if file.is_dir():
        return _counted(
            file,
            {entry_file.stem: read(entry_file).value for entry_file in sorted(file.glob("*.yaml"))},
        )
    rows = rows_of(file)
    if gear:
        return {
            row.label: {key: cell for key, cell in row.cells.items() if key not in BESIDE}
            for row in rows
        }
    return {row.label: _motor(row, file.name) for row in rows}


def stated_beside(path: Path) -> dict[str, dict[str, float]]:
    """Return the stated mass (kg) and length (m) of the entries of a CSV by name.

    Raises ProblemError.
    """
    file = catalogue_file(path)
    found = (
        {}
        if file.is_dir()
        else {
            row.label: {name: _beside(file, row, name) for name in BESIDE} for row in rows_of(file)
        }
    )
    return {
        label: {name: x for name, x in said.items() if x is not None}
        for label, said in found.items()
    }


def motors_of(path: Path) -> list[Part[Motor]]:
    """Return the motors of a catalogue. Raises ProblemError."""
    file = catalogue_file(path)
    if file.is_dir():
        motors = {
            entry_file.stem: motor_from(read(entry_file))
            for entry_file in sorted(file.glob("*.yaml"))
        }
        return [Part(label, motor, motor.mass) for label, motor in _counted(file, motors).items()]
    parts = []
    for row in rows_of(file):
        motor = motor_from(_section(file, row, _motor(row, file.name)))
        parts.append(Part(row.label, motor, motor.mass, _beside(file, row, "length")))
    return parts


def gears_of(path: Path, own: Drive) -> list[Part[Drive]]:
    """Return drives in which gears of a catalogue replace the gear of a joint's drive.

    Only gears of the same kind are included. A row without friction or inertias keeps those of the
    present drive, but not the ratings of its gear. A YAML file describes a complete drive. Raises
    ProblemError.
    """
    file = catalogue_file(path)
    if file.is_dir():
        gear_files = {
            entry_file.stem: read(entry_file) for entry_file in sorted(file.glob("*.yaml"))
        }
        kinds = {
            label: section.value.get("kind")
            for label, section in _counted(file, gear_files).items()
        }
        return [
            Part(label, drive_from(gear_files[label]))
            for label, kind in kinds.items()
            if kind == own.kind
        ]
    if not own.threaded:
        return []
    return [
        Part(row.label, _geared(file, row, own), *(_beside(file, row, name) for name in BESIDE))
        for row in rows_of(file)
        if row.cells.get("kind", own.kind) == own.kind
        and bool(WORM_COLUMNS & set(row.cells)) == (own.kind == "worm")
    ]


def catalogue_file(path: Path) -> Path:
    """Return the file or folder, or the shipped catalogue of this name. Raises ProblemError."""
    shipped = shipped_folder() / "catalogues" / path.name
    with suppress(OSError, ValueError):  # a name can be too long for a file
        if path.exists():
            return path
        for file in (shipped, shipped.with_name(f"{path.name}.csv")):
            if file.is_file():
                return file
    raise ProblemError(
        f"the file {path} does not exist", allowed="a CSV file or a folder of YAML files"
    )


def rows_of(file: Path) -> list[Row]:
    """Return the rows of a CSV by unique name or order number. Raises ProblemError."""
    try:
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ProblemError(f"cannot be read: {error}", file=file) from None
    reader = csv.reader(io.StringIO(text))
    headings = [_heading(cell) for cell in next(_cells(reader, file), [])]
    names = [name for name, _ in headings]
    if not NAMES & set(names):
        raise ProblemError("no column name or order_number", file=file, line=1)
    if len(set(names)) < len(names):
        raise ProblemError("two columns have the same name", file=file, line=1)
    rows: dict[str, Row] = {}
    for cells in _cells(reader, file):
        if not cells:
            continue
        if len(cells) != len(headings):
            raise ProblemError(
                f"{len(cells)} cells", file=file, line=reader.line_num, allowed=f"{len(headings)}"
            )
        written = zip(headings, (cell.strip() for cell in cells), strict=True)
        row: JsonObject = {
            name: cell if name in NAMES else _value(f"{cell} {unit}".rstrip())
            for (name, unit), cell in written
            if cell
        }
        label = str(row.pop("order_number", None) or row.get("name", ""))
        if label in rows or not label:
            reason = f"{label!r} occurs twice" if label else "no name"
            raise ProblemError(reason, file=file, line=reader.line_num)
        rows[label] = Row(label, row, reader.line_num)
    return list(_counted(file, rows).values())


C = TypeVar("C")


def _counted(file: Path, named_entries: dict[str, C]) -> dict[str, C]:
    if not 0 < len(named_entries) <= LARGEST_CATALOGUE:
        raise ProblemError(
            f"{len(named_entries)} entries", file=file, allowed=f"1 to {LARGEST_CATALOGUE}"
        )
    return named_entries


def _cells(reader: Any, file: Path) -> Iterator[list[str]]:
    try:
        yield from reader
    except csv.Error as error:
        raise ProblemError(f"invalid table: {error}", file=file, line=reader.line_num) from None


def _value(text: str) -> str | float:
    """Return a cell as a number if it is one, otherwise as text."""
    try:
        return float(text)
    except ValueError:
        return text


def _heading(cell: str) -> tuple[str, str]:
    """Return the name and unit of a column such as `rotor_inertia [g*cm^2]`."""
    name, _, unit = cell.strip().partition("[")
    return name.strip(), unit.rstrip("] ")


def _motor(row: Row, file: str) -> JsonObject:
    """Return the motor file that a row describes, without keys that motor files do not have."""
    cells = dict(row.cells)
    source = cells.pop("source", f"{file}, {row.label}")
    name = str(cells.pop("name", ""))
    entry: JsonObject = {
        "name": name if name == row.label else f"{name} {row.label}".strip(),
        "source": source,
    }
    for column, value in cells.items():
        name = MOTOR_COLUMNS.get(column, column)
        if name in MotorModel.model_fields and name not in entry:
            entry[name] = value
    return entry


def _section(file: Path, row: Row, said: Mapping[str, Any]) -> Section:
    return Section(file, plain_node(said, line=row.line))


def _beside(file: Path, row: Row, name: str) -> float | None:
    if name not in row.cells:
        return None
    try:
        return quantity(row.cells[name], BESIDE[name])
    except BadQuantity as error:
        raise ProblemError(
            str(error), file=file, line=row.line, key=name, value=row.cells[name]
        ) from None


def _geared(file: Path, row: Row, own: Drive) -> Drive:
    """Return the present drive with the gear of a row."""
    friction, slides = friction_of(own), own.slides
    effort, inertia = ("N", "kg") if slides else ("N*m", "kg*m^2")
    said: JsonObject = {
        "name": row.label,
        "kind": own.kind,
        "source": f"{file.name}, {row.label}",
        "geometry": {"thread_angle": f"{own.dimensions['thread_angle']!r} rad"},
        "input_inertia": f"{own.input_inertia!r} kg*m^2",
        "output_inertia": f"{own.output_inertia!r} {inertia}",
        "friction": {
            "mu": friction.mu,
            "b_c": f"{friction.b_c!r} N*m",
            "b_v": f"{friction.b_v!r} N*m*s/rad",
        },
        "self_locking": "not required",  # `size` checks self-locking
    }
    said["friction"]["b_oc"] = f"{friction.b_oc!r} {effort}"
    said["friction"]["mu_static"] = friction.mu_static
    if own.kind == "antibacklash_screw":
        said |= {"preload": f"{own.preload!r} N", "second_nut_mass": f"{own.second_nut_mass!r} kg"}
    of_friction = []
    for key, cell in row.cells.items():
        if key in BESIDE:
            continue
        place, _, name = key.rpartition(".")
        (said.setdefault(place, {}) if place else said)[name] = cell
        of_friction += [name] if place == "friction" else []
    made = drive_from(_section(file, row, said))
    ratings = made.ratings
    if own.ratings is not None and ratings is not None:
        ratings = replace(
            ratings,
            **{name: getattr(ratings, name) or getattr(own.ratings, name) for name in FITTED},
        )
    with_friction = replace(
        friction, **{name: getattr(friction_of(made), name) for name in of_friction}
    )
    return replace(
        made,
        ratings=ratings,
        friction=with_friction,
        friction_ranges={
            name: ends for name, ends in own.friction_ranges.items() if name not in of_friction
        },
        self_locking=own.self_locking,
    )
