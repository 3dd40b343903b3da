"""Catalogues of motors and gears: a CSV with units in cells or headings, or a folder of YAML files."""

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
from ssm_planner.units import BadQuantity, quantity

T = TypeVar("T", Motor, Drive)

LARGEST_CATALOGUE = 10_000
"""Entries."""
MOTOR_COLUMNS = {"weight": "mass", "chart_max_torque": "max_torque"}
"""Columns of motor tables in the words of motor files; the chart's end is no rating, and its source says so."""
BESIDE = {"mass": "mass", "length": "length"}
"""Kinds of the columns that a catalogue may have beside what motor and drive files know."""
WORM_COLUMNS = {"geometry.wheel_diameter", "geometry.worm_diameter", "geometry.ratio"}
NAMES = {"name", "order_number"}
"""Columns of text, though it may be digits."""
FITTED = ("free_length", "ends")
"""Ratings that are of the robot, not of the screw chosen."""


@dataclass(frozen=True)
class Row:
    """A row as it is written, by column, and its line."""

    label: str
    cells: Mapping[str, Any]
    line: int


@dataclass(frozen=True)
class Part(Generic[T]):
    """An entry of a catalogue. mass (kg) and length (m): None where they are not stated."""

    label: str
    of: T
    mass: float | None = None
    length: float | None = None


def entries(path: Path, gear: bool = False) -> dict[str, Any]:
    """What the entries of a catalogue say in the words of motor or drive files, by name. Raises ProblemError."""
    file = catalogue_file(path)
    if file.is_dir():
        return _counted(file, {each.stem: read(each).value for each in sorted(file.glob("*.yaml"))})
    rows = rows_of(file)
    if gear:
        return {
            row.label: {key: cell for key, cell in row.cells.items() if key not in BESIDE}
            for row in rows
        }
    return {row.label: _motor(row, file.name) for row in rows}


def stated_beside(path: Path) -> dict[str, dict[str, float]]:
    """Mass (kg) and length (m) of the entries of a CSV, as far as they are stated, by name. Raises ProblemError."""
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
    """The motors of a catalogue. Raises ProblemError."""
    file = catalogue_file(path)
    if file.is_dir():
        found = {each.stem: motor_from(read(each)) for each in sorted(file.glob("*.yaml"))}
        return [Part(label, motor, motor.mass) for label, motor in _counted(file, found).items()]
    parts = []
    for row in rows_of(file):
        motor = motor_from(_section(file, row, _motor(row, file.name)))
        parts.append(Part(row.label, motor, motor.mass, _beside(file, row, "length")))
    return parts


def gears_of(path: Path, own: Drive) -> list[Part[Drive]]:
    """The gears of a catalogue that are of the kind of a joint's own drive, in the place of its gear.

    A row keeps the friction and the inertias of the own drive that it does not state, and no rating of its gear; a YAML file
    is a drive of its own. Raises ProblemError.
    """
    file = catalogue_file(path)
    if file.is_dir():
        found = {each.stem: read(each) for each in sorted(file.glob("*.yaml"))}
        kinds = {
            label: section.value.get("kind") for label, section in _counted(file, found).items()
        }
        return [
            Part(label, drive_from(found[label]))
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
    """The file or folder, or the shipped catalogue of this name. Raises ProblemError."""
    shipped = shipped_folder() / "catalogues" / path.name
    with suppress(OSError, ValueError):  # such as a name that is too long: there is no such file
        if path.exists():
            return path
        for file in (shipped, shipped.with_name(f"{path.name}.csv")):
            if file.is_file():
                return file
    raise ProblemError(
        f"the file {path} does not exist", allowed="a CSV file or a folder of YAML files"
    )


def rows_of(file: Path) -> list[Row]:
    """The rows of a CSV, each with a name or order number of its own. Raises ProblemError."""
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
        raise ProblemError("two columns of one name", file=file, line=1)
    rows: dict[str, Row] = {}
    for cells in _cells(reader, file):
        if not cells:
            continue
        if len(cells) != len(headings):
            raise ProblemError(
                f"{len(cells)} cells", file=file, line=reader.line_num, allowed=f"{len(headings)}"
            )
        written = zip(headings, (cell.strip() for cell in cells), strict=True)
        row: dict[str, Any] = {
            name: cell if name in NAMES else _value(f"{cell} {unit}".rstrip())
            for (name, unit), cell in written
            if cell
        }
        label = str(row.pop("order_number", None) or row.get("name", ""))
        if label in rows or not label:
            reason = f"{label!r} stands twice" if label else "no name"
            raise ProblemError(reason, file=file, line=reader.line_num)
        rows[label] = Row(label, row, reader.line_num)
    return list(_counted(file, rows).values())


C = TypeVar("C")


def _counted(file: Path, found: dict[str, C]) -> dict[str, C]:
    if not 0 < len(found) <= LARGEST_CATALOGUE:
        raise ProblemError(f"{len(found)} entries", file=file, allowed=f"1 to {LARGEST_CATALOGUE}")
    return found


def _cells(reader: Any, file: Path) -> Iterator[list[str]]:
    try:
        yield from reader
    except csv.Error as error:
        raise ProblemError(f"not a table: {error}", file=file, line=reader.line_num) from None


def _value(text: str) -> str | float:
    """A number where the cell is one, else its text."""
    try:
        return float(text)
    except ValueError:
        return text


def _heading(cell: str) -> tuple[str, str]:
    """Name and unit of a column: `rotor_inertia [g*cm^2]`."""
    name, _, unit = cell.strip().partition("[")
    return name.strip(), unit.rstrip("] ")


def _motor(row: Row, file: str) -> dict[str, Any]:
    """A motor file of a row; what motor files do not know is left out."""
    cells = dict(row.cells)
    source = cells.pop("source", f"{file}, {row.label}")
    name = str(cells.pop("name", ""))
    entry: dict[str, Any] = {
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
    """The own drive with the gear of a row."""
    friction, slides = friction_of(own), own.slides
    effort, inertia = ("N", "kg") if slides else ("N*m", "kg*m^2")
    said: dict[str, Any] = {
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
        "self_locking": "not required",  # that is a check of the gear, not a fault of the file
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
