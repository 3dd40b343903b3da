"""Read catalogues of motors, gears and gearheads.

A catalogue is a CSV table with units in its headings, or a folder of YAML files. Each row is
converted to the content of a motor or drive file and then read like such a file, so that the same
checks apply. The sizing of motors and the studies of robots select from the entries.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Generic, TypeVar

from ssm_planner.dynamics import required_friction
from ssm_planner.errors import ProblemError
from ssm_planner.loading.drives import drive_from, gearhead_from
from ssm_planner.loading.files import read_section, shipped_folder
from ssm_planner.loading.motors import MotorModel, motor_from
from ssm_planner.loading.schema import POSITIVE, locate_errors, quantity_reader
from ssm_planner.loading.tables import replace_decimal_commas, table_rows
from ssm_planner.loading.yaml_nodes import Section, node_from_data
from ssm_planner.problem import (
    TRANSMISSIONS,
    Drive,
    Friction,
    Gearhead,
    Motor,
    Transmission,
    field_hints,
    get_attributes,
)
from ssm_planner.typing import JsonObject, frozen
from ssm_planner.units import BadQuantity, split_heading

T = TypeVar("T", Motor, Drive, Gearhead)

LARGEST_CATALOGUE = 10_000
"""Largest number of entries."""
MOTOR_COLUMNS = {"weight": "mass", "chart_max_torque": "max_torque"}
"""Keys in motor files, by name of the column, for columns of motor tables with other names.

`chart_max_torque` is the torque at the end of a chart, which is not a rating. Its source states
this.
"""
SIZE_COLUMNS = {"mass": "mass", "length": "length"}
"""Kinds of quantities of the columns with the mass and the length of an entry.

The kinds are keys of `units.QUANTITY_KINDS`.
"""
TEXT_COLUMNS = {"name", "order_number"}
"""Columns that contain texts even if their cells consist of digits."""
ROBOT_RATINGS = ("free_length", "ends")
"""Ratings of a screw that depend on its installation in the robot.

Unless a catalogue states them, they are taken from the robot's present screw.
"""


@frozen
class CatalogueRow:
    """Row of a CSV catalogue.

    Attributes
    ----------
    file : Path
        The table.
    label : str
        Order number or, without one, name of the entry.
    cells : dict
        Text or number of each cell that is not empty, by heading. Texts of quantities contain the
        unit.
    line : int
        Line of the row, for messages.
    """

    file: Path
    label: str
    cells: JsonObject
    line: int

    @property
    def default_source(self) -> str:
        """Source of the figures in a row without the column `source`."""
        return f"{self.file.name}, {self.label}"


@frozen
class CatalogueEntry(Generic[T]):
    """Entry of a catalogue: a motor, a drive or a gearhead.

    Attributes
    ----------
    label : str
        Name of the entry.
    of : Motor, Drive or Gearhead
        The motor, drive or gearhead.
    mass, length : float or None
        Mass (kg) and length (m). None if the catalogue does not state them.
    """

    label: str
    of: T
    mass: float | None = None
    length: float | None = None


def read_catalogue(path: Path, gear: bool = False) -> JsonObject:
    """Read a catalogue without building the motors or drives.

    Parameters
    ----------
    path : Path
        CSV table or folder of YAML files, or the name of a shipped catalogue.
    gear : bool
        True for a catalogue of gears, and False for a catalogue of motors.

    Returns
    -------
    dict of dict
        Content of each entry by its name. It has the keys of a drive file or of a motor file.

    Raises
    ------
    ProblemError
        If the catalogue is missing or invalid.
    """
    sections = _sections(path, _gear_content if gear else _motor_content)
    return {label: section.value for label, section in sections.items()}


def catalogue_sizes(path: Path) -> dict[str, dict[str, float]]:
    """Return the masses and lengths of the entries of a CSV catalogue.

    Parameters
    ----------
    path : Path
        CSV table or folder of YAML files, or the name of a shipped catalogue.

    Returns
    -------
    dict of dict
        Mass (kg) and length (m) by name of the entry and name of the column. A value that the row
        does not state is absent. The result is empty for a folder of YAML files.

    Raises
    ------
    ProblemError
        If the catalogue is invalid.
    """
    file = find_catalogue(path)
    return {
        row.label: {
            name: value
            for name in SIZE_COLUMNS
            if (value := _mass_or_length(row, name)) is not None
        }
        for row in (() if file.is_dir() else read_rows(file))
    }


def read_motors(path: Path) -> list[CatalogueEntry[Motor]]:
    """Read the motors of a catalogue.

    Parameters
    ----------
    path : Path
        CSV table or folder of YAML files, or the name of a shipped catalogue.

    Returns
    -------
    list of CatalogueEntry
        Motors in the order of the catalogue.

    Raises
    ------
    ProblemError
        If the catalogue is missing or invalid.
    """
    sections = _sections(path, _motor_content)
    motors = {label: motor_from(section) for label, section in sections.items()}
    sizes = catalogue_sizes(path)
    return [
        CatalogueEntry(label, motor, motor.mass, sizes.get(label, {}).get("length"))
        for label, motor in motors.items()
    ]


def drives_with_gears(path: Path, drive: Drive, travel: float = 0.0) -> list[CatalogueEntry[Drive]]:
    """Read the gears of a catalogue, and return a drive with each of them.

    A row of a CSV table replaces the gear of the joint's present drive. Friction and inertias that
    the row does not state are taken from the present drive, and of its ratings only those in
    `ROBOT_RATINGS`. Rows with another kind of gear are ignored. A YAML file describes a complete
    drive, but the present drive decides whether the joint must be self-locking.

    Parameters
    ----------
    path : Path
        CSV table or folder of YAML files, or the name of a shipped catalogue.
    drive : Drive
        Present drive of the joint.
    travel : float
        Travel of the joint, rad or m.

    Returns
    -------
    list of CatalogueEntry
        Drives with the gears of the catalogue. Empty for a CSV table if the present drive lacks a
        thread.

    Raises
    ------
    ProblemError
        If the catalogue is missing or invalid, or if a screw is shorter than the travel.
    """
    file = find_catalogue(path)
    if file.is_dir():
        return [
            CatalogueEntry(label, _drive_for_joint(section, drive, travel))
            for label, section in _sections(file, _gear_content).items()
            if section.value.get("kind") == drive.kind
        ]
    rows = read_rows(file)
    for row in rows:
        with locate_errors(_section(row, row.cells)):
            TRANSMISSIONS.find(row.cells.get("kind", drive.kind), "Drive.kind")
    if not drive.threaded:
        return []
    return [
        CatalogueEntry(
            row.label,
            _replace_gear(row, drive, travel),
            *(_mass_or_length(row, name) for name in SIZE_COLUMNS),
        )
        for row in rows
        if row.cells.get("kind", drive.kind) == drive.kind
        and _has_dimensions_of(row, drive.transmission)
    ]


def read_gearheads(path: Path) -> list[CatalogueEntry[Gearhead]]:
    """Read the gearheads of a catalogue, which must state the inertia of each gearhead.

    Parameters
    ----------
    path : Path
        CSV table or folder of YAML files, or the name of a shipped catalogue.

    Returns
    -------
    list of CatalogueEntry
        Gearheads in the order of the catalogue.

    Raises
    ------
    ProblemError
        If the catalogue is missing or invalid.
    """
    entries = []
    for label, section in _sections(path, _gearhead_content).items():
        gearhead = gearhead_from(section)
        if gearhead.inertia is None:
            raise section.error(
                "missing", "inertia", allowed="the inertia at the input", show=False
            )
        entries.append(CatalogueEntry(label, gearhead, gearhead.mass, gearhead.length))
    return entries


def _nest_keys(cells: JsonObject, values: JsonObject) -> JsonObject:
    """Add cells of a table to a mapping of values.

    A cell with the heading `part.name` becomes the key `name` of the inner mapping `part`.

    Parameters
    ----------
    cells : dict
        Cells by heading.
    values : dict
        Mapping that is extended. Its entries are replaced by cells with the same key.

    Returns
    -------
    dict
        The mapping `values`.
    """
    for key, cell in cells.items():
        prefix, _, name = key.rpartition(".")
        (values.setdefault(prefix, {}) if prefix else values)[name] = cell
    return values


def _has_dimensions_of(row: CatalogueRow, kind: type[Transmission]) -> bool:
    """Return True if the columns of a row are dimensions of one kind of drive.

    A distinctive dimension occurs in only one kind of drive.

    Parameters
    ----------
    row : CatalogueRow
        Row of a catalogue of gears.
    kind : type
        Subclass of Transmission. A kind with distinctive dimensions requires at least one of them.
        Any other kind requires a row without the distinctive dimensions of other kinds.
    """
    columns = {name.removeprefix("geometry.") for name in row.cells if "geometry." in name}
    if kind.distinctive:
        return bool(kind.distinctive & columns)
    return not any(other.distinctive & columns for other in TRANSMISSIONS.values())


def find_catalogue(path: Path) -> Path:
    """Return the file or folder of a catalogue.

    Parameters
    ----------
    path : Path
        Path of the catalogue, or its name if it is shipped with the package.

    Returns
    -------
    Path
        CSV table or folder of YAML files.

    Raises
    ------
    ProblemError
        If the catalogue does not exist.
    """
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


def read_rows(file: Path) -> list[CatalogueRow]:
    """Read the rows of a CSV catalogue.

    Each row must have a unique name or order number. Numbers of tables with semicolons or tabs may
    have decimal commas.

    Parameters
    ----------
    file : Path
        CSV table with headings such as "nominal_voltage [V]".

    Returns
    -------
    list of CatalogueRow
        Rows in the order of the table.

    Raises
    ------
    ProblemError
        If the table is invalid.
    """
    table = list(table_rows(file, decimal_commas=True))
    if not table:
        raise ProblemError("no headings", file=file, line=1)
    replace_decimal_commas(table, {*TEXT_COLUMNS, "source"}, file)
    line, cells = table[0]
    headings = list(map(split_heading, cells))
    names = [name for name, _ in headings]
    if not TEXT_COLUMNS & set(names):
        raise ProblemError("no column name or order_number", file=file, line=line)
    if len(set(names)) < len(names):
        raise ProblemError("two columns have the same name", file=file, line=line)
    rows: dict[str, CatalogueRow] = {}
    for line, cells in table[1:]:
        row: JsonObject = {
            name: cell if name in TEXT_COLUMNS else number_or_text(f"{cell} {unit}".rstrip())
            for (name, unit), cell in zip(headings, cells, strict=True)
            if cell
        }
        label = str(row.pop("order_number", None) or row.get("name", ""))
        if label in rows or not label or not label.isprintable():
            reason = (
                f"{label!r} occurs twice" if label in rows else f"{label!r} is not a printable name"
            )
            raise ProblemError(reason, file=file, line=line)
        rows[label] = CatalogueRow(file, label, row, line)
    return list(_check_count(file, rows).values())


def _sections(path: Path, content: Callable[[CatalogueRow], JsonObject]) -> dict[str, Section]:
    """Read a catalogue, and return the section of each entry by its name.

    Parameters
    ----------
    path : Path
        CSV table or folder of YAML files, or the name of a shipped catalogue.
    content : callable
        Function that converts a row of a table to the content of a file.

    Returns
    -------
    dict of Section
        Sections by name of the entry. In a folder, it is the stem of the file name. In a table, it
        is the order number or, without one, the name.

    Raises
    ------
    ProblemError
        If the catalogue is missing or invalid.
    """
    file = find_catalogue(path)
    if file.is_dir():
        return _check_count(
            file, {entry.stem: read_section(entry) for entry in sorted(file.glob("*.yaml"))}
        )
    return {row.label: _section(row, content(row)) for row in read_rows(file)}


C = TypeVar("C")


def _check_count(file: Path, named_entries: dict[str, C]) -> dict[str, C]:
    """Return the entries of a catalogue unchanged if their number is permitted.

    Parameters
    ----------
    file : Path
        The catalogue, for messages.
    named_entries : dict
        Entries by name.

    Raises
    ------
    ProblemError
        If the catalogue is empty or has more than `LARGEST_CATALOGUE` entries.
    """
    if not 0 < len(named_entries) <= LARGEST_CATALOGUE:
        raise ProblemError(
            f"{len(named_entries)} entries", file=file, allowed=f"1 to {LARGEST_CATALOGUE}"
        )
    return named_entries


def number_or_text(text: str) -> str | float:
    """Return a text as a number if it is one, and unchanged otherwise."""
    try:
        return float(text)
    except ValueError:
        return text


def _motor_content(row: CatalogueRow) -> JsonObject:
    """Convert a row of a table to the content of a motor file.

    Parameters
    ----------
    row : CatalogueRow
        Row of the catalogue. Columns that are not keys of motor files are ignored.

    Returns
    -------
    dict
        Values by key of a motor file.

    Raises
    ------
    ProblemError
        If two columns state the same figure.
    """
    cells = dict(row.cells)
    source = cells.pop("source", row.default_source)
    name = str(cells.pop("name", ""))
    entry: JsonObject = {
        "name": name if name == row.label else f"{name} {row.label}".strip(),
        "source": source,
    }
    for column, value in cells.items():
        name = MOTOR_COLUMNS.get(column, column)
        if name in entry:
            raise ProblemError(
                f"two columns state {name}", file=row.file, line=row.line, key=column
            )
        if name in MotorModel.model_fields:
            entry[name] = value
    return entry


def _gear_content(row: CatalogueRow) -> JsonObject:
    """Return the columns of a row that are keys of a drive file."""
    return {key: cell for key, cell in row.cells.items() if key not in SIZE_COLUMNS}


def _gearhead_content(row: CatalogueRow) -> JsonObject:
    """Convert a row to the content of a gear stage in a drive file."""
    return _nest_keys(row.cells, {"name": row.label, "source": row.default_source})


def _section(row: CatalogueRow, values: JsonObject) -> Section:
    """Return the values of a row as a section, so that messages refer to the line of the row."""
    return Section(row.file, node_from_data(values, line=row.line))


def _mass_or_length(row: CatalogueRow, name: str) -> float | None:
    """Return the mass or the length that a row of a catalogue states.

    Parameters
    ----------
    row : CatalogueRow
        Row of the catalogue.
    name : str
        "mass" or "length".

    Returns
    -------
    float or None
        Mass in kg or length in m. None if the row does not state it.

    Raises
    ------
    ProblemError
        If the unit is wrong or the value is not positive.
    """
    if name not in row.cells:
        return None
    try:
        return quantity_reader(SIZE_COLUMNS[name], POSITIVE).read(row.cells[name])
    except BadQuantity as error:
        raise ProblemError(
            str(error), file=row.file, line=row.line, key=name, value=row.cells[name]
        ) from None


def _drive_for_joint(section: Section, drive: Drive, travel: float) -> Drive:
    """Build the drive that a YAML file of a catalogue describes, for use at a joint.

    Parameters
    ----------
    section : Section
        Content of the file.
    drive : Drive
        Present drive of the joint, which decides whether the new drive must be self-locking.
    travel : float
        Travel of the joint, rad or m.

    Raises
    ------
    ProblemError
        If the travel exceeds the length of a screw.
    """
    result = drive_from(section)
    with locate_errors(section):
        result.check_travel(travel)
    return replace(result, self_locking=drive.self_locking)


def _replace_gear(row: CatalogueRow, drive: Drive, travel: float) -> Drive:
    """Replace the gear of a drive by the gear in a row of a catalogue.

    The row determines the geometry and the ratings. Inertias, coefficients of friction and the
    ratings in `ROBOT_RATINGS` that the row does not state are those of the given drive.

    Parameters
    ----------
    row : CatalogueRow
        Row of a catalogue of gears.
    drive : Drive
        Present drive of the joint, which has a thread.
    travel : float
        Travel of the joint, rad or m.

    Returns
    -------
    Drive
        The given drive with the gear of the row.

    Raises
    ------
    ProblemError
        If a value is invalid, or if a screw is shorter than the travel.
    """
    friction = required_friction(drive)
    inertia = "kg" if drive.slides else "kg*m^2"
    values: JsonObject = {
        "name": row.label,
        "kind": drive.kind,
        "source": row.default_source,
        "geometry": {"thread_angle": f"{drive.dimensions['thread_angle']!r} rad"},
        "input_inertia": f"{drive.input_inertia!r} kg*m^2",
        "output_inertia": f"{drive.output_inertia!r} {inertia}",
        "friction": {
            "mu": friction.mu,
            "mu_static": friction.mu_static,
            "b_c": "0 N*m",  # required in drive files, and replaced below
            "b_v": "0 N*m*s/rad",
        },
        "self_locking": "not required",  # `size` checks self-locking
    }
    if drive.two_nuts:
        values |= {
            "preload": f"{drive.preload!r} N",
            "second_nut_mass": f"{drive.second_nut_mass!r} kg",
        }
    cells = _gear_content(row)
    stated = {key.rpartition(".")[2] for key in cells}
    stated_friction = [name for name in field_hints(Friction) if f"friction.{name}" in cells]
    section = _section(row, _nest_keys(cells, values))
    result = _drive_for_joint(section, drive, travel)
    ratings = result.ratings
    with locate_errors(section):
        if drive.ratings is not None and ratings is not None:
            ratings = replace(
                ratings,
                **{
                    name: getattr(ratings, name) or getattr(drive.ratings, name)
                    for name in ROBOT_RATINGS
                },
            )
        return replace(
            result,
            ratings=ratings,
            friction=replace(
                friction, **get_attributes(required_friction(result), stated_friction)
            ),
            friction_ranges={
                name: ends
                for name, ends in drive.friction_ranges.items()
                if name not in stated_friction
            },
            placeholders=tuple(name for name in drive.placeholders if name not in stated),
        )
