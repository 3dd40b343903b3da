"""Read tables of numbers from text files: exports of the EPOS recorder, and CSV with named columns.

`parse_table` reads the text of a file, and `find_columns` selects the columns of time, speed,
torque and position. The module `recordings` calls both. Numbers may have decimal commas or
thousands separators. In this module, a mark is a point or a comma in a number. Every repair of a
file is noted.
"""

import csv
import itertools
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ssm_planner.errors import RecordingError
from ssm_planner.typing import Array, frozen
from ssm_planner.units import SPEEDS, TIMES

NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
"""Numbers with a decimal point."""
_OTHER_MARK = {".": ",", ",": "."}
_WITH_THOUSANDS = {
    mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}(\{other}\d{{3}})+(\{mark}\d*)?([eE][+-]?\d+)?")
    for mark, other in _OTHER_MARK.items()
}
"""Numbers with thousands separators, by the decimal mark."""
_AMBIGUOUS = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")
"""Numbers with one mark that can separate decimals or thousands."""
_INTEGER = re.compile(r"[+-]?\d+")
"""Numbers without a mark."""
_WITH_MARKS = re.compile(r"[+-]?[\d.,]*\d[\d.,]*([eE][+-]?\d+)?")
"""Numbers with any points and commas."""
_BLANKS = re.compile("(?<=\\d)['\u2019\u00a0\u2009\u202f ](?=\\d{3})")
"""Apostrophes and blanks that separate thousands."""
_EDIT_REMARK = re.compile(r"([^,]+),,?\s*was\s+([+-]?[\d.]+)", re.IGNORECASE)


class RepairNotes:
    """Notes on the repairs of one file. Equal repairs of several lines become one note.

    Parameters
    ----------
    path : Path
        The file, for messages.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.doubts: list[str] = []
        self.counted: dict[str, list[int]] = {}

    def add(self, text: str) -> None:
        """Add a note on a value that is not used as the file states it.

        Parameters
        ----------
        text : str
            The note as a sentence.
        """
        self.doubts.append(text)

    def count(self, text: str, line: int) -> None:
        """Add a note on one line, which is counted together with equal notes on other lines.

        Parameters
        ----------
        text : str
            The note, as it continues after the number of lines.
        line : int
            Index of the line, from 0.
        """
        self.counted.setdefault(text, []).append(line + 1)

    def number(self, text: str, line: int, mark: str) -> float:
        """Convert a field to a number, and note every repair.

        Parameters
        ----------
        text : str
            Text of the field. An empty field and words such as `nan` become NaN.
        line : int
            Index of the line, from 0.
        mark : str
            Decimal mark of the column, "." or ",", or "" if the marks of the column are ambiguous.

        Returns
        -------
        float
            The number.

        Raises
        ------
        RecordingError
            If the field is not a number, or if its mark may separate decimals or thousands.
        """
        text = _remove_quotes(text)
        if text.lower() in ("", "nan", "inf", "-inf", "+inf", "null", "none", "#n/a"):
            return math.nan
        if _AMBIGUOUS.fullmatch(text) and not mark:
            raise RecordingError(
                f"{self.path}:{line + 1}: {text!r} may have decimals or thousands: write numbers "
                "without thousands separators"
            )
        joined = _BLANKS.sub("", text)
        if mark and _WITH_THOUSANDS[mark].fullmatch(joined):
            joined = joined.replace(_OTHER_MARK[mark], "")
        pointed = joined.replace(",", ".")
        if not NUMBER.fullmatch(pointed):
            return self._number_with_text(text, line)
        if joined != text:
            self.count("numbers with thousands separators read without them", line)
        if pointed != joined:
            self.count("numbers with a decimal comma read as such", line)
        return float(pointed)

    def _number_with_text(self, text: str, line: int) -> float:
        """Return the number in a field that also contains a remark.

        A field such as `1.2, was 1.5` states that the number was edited, and the original number is
        used. Any other text after a number and a comma is ignored. Both repairs are noted.

        Parameters
        ----------
        text : str
            Text of the field without quotes.
        line : int
            Index of the line, from 0.

        Returns
        -------
        float
            The number.

        Raises
        ------
        RecordingError
            If the field contains no number.
        """
        edited = _EDIT_REMARK.fullmatch(text)
        if edited:
            value, original = edited.groups()
            value = value.strip()
            self.add(
                f"line {line + 1}: edited value {value} restored to {original}, which the file "
                "states it was"
            )
            return float(original)
        head, _, tail = text.partition(",")
        if tail and not tail.lstrip()[:1].isdigit() and NUMBER.fullmatch(head.strip()):
            self.add(
                f"line {line + 1}: text after the number {head.strip()} ignored ({text[:40]!r})"
            )
            return float(head)
        raise RecordingError(f"{self.path}:{line + 1}: {text[:40]!r} is not a number")

    def texts(self) -> list[str]:
        """Return all notes as sentences.

        Returns
        -------
        list of str
            Notes on single values, and then notes on several lines with their number.
        """
        counted_notes = [
            f"{len(lines)} {text} (first: line {lines[0]})" for text, lines in self.counted.items()
        ]
        return self.doubts + counted_notes


COLUMN_UNITS: dict[str, dict[str, float]] = {
    "time": {**TIMES, "sec": 1.0},
    "speed": {**SPEEDS, "rads": 1.0, "radps": 1.0},
    "position": {
        "rad": 1.0,
        "deg": math.pi / 180,
        "turns": 2 * math.pi,
        **dict.fromkeys(("inc", "qc", "counts", "increments"), 2 * math.pi),
    },
    "torque": {
        "%": 0.01,
        "percent": 0.01,
        "pct": 0.01,
        "‰": 0.001,
        "permille": 0.001,
        "n*m": 1.0,
        "nm": 1.0,
        "mn*m": 1e-3,
        "mnm": 1e-3,
    },
}
"""Factors to SI by quantity and unit in lower case.

The torque in % or ‰ is relative to the nominal torque of the motor. Increments are relative to the
number of increments per turn.
"""
_RELATIVE_UNITS = ("%", "percent", "pct", "‰", "permille", "inc", "qc", "counts", "increments")

COLUMN_NAMES = {
    # The EPOS recorder leaves the name of the time column empty.
    "time": ("time", "t", "timestamp", ""),
    "speed": (
        "velocity actual value averaged",
        "velocity actual value",
        "velocity",
        "speed",
        "w",
        "omega",
    ),
    "position": ("position actual value", "position", "angle"),
    "torque": ("torque actual value averaged", "torque actual value", "torque", "tau"),
}
"""Accepted column names in the order of preference."""

LARGEST_OMITTED_SHARE = 0.05
"""Largest share of samples that may be left out because they are not numbers."""
LONGEST_LINE = 100_000
"""Longest line, characters."""

_UNIT_IN_NAME = re.compile(r"^(.*?)\s*[\[(](.*?)[\])]\s*$")


@dataclass
class Table:
    """Table of numbers that was read from a file."""

    names: list[str]
    """Names of the columns."""
    units: list[str]
    """Units of the columns. An empty text means that the file states none."""
    values: Array
    """Numbers (samples, columns). A field without a finite number is NaN."""
    lines: list[int]
    """Line number of each sample."""
    repairs: list[str]
    """Notes on repairs, as sentences."""
    header: dict[str, str] = field(default_factory=dict)
    """Texts of the lines above the table, by their label in lower case."""
    doubts: list[str] = field(default_factory=list)
    """Sentences on values of the file that are not in the table, or differ from it."""


@frozen
class Column:
    """Column of a table, with the factor that converts it to SI units."""

    index: int
    """Index of the column, from 0."""
    name: str
    """Name in the file."""
    unit: str
    """Unit in the file."""
    factor: float
    """Factor from the unit of the file to SI units."""
    relative: bool
    """True if the unit is relative to the nominal torque or to the increments per turn."""


def parse_table(text: str, path: Path) -> Table:
    """Split the text of a file into header, names and units of the columns, and samples.

    Parameters
    ----------
    text : str
        Text of the file. A line of units may follow the line of names.
    path : Path
        The file, for messages.

    Returns
    -------
    Table
        Numbers (samples, columns) in the units of the file, with notes on repairs.

    Raises
    ------
    RecordingError
        If the text is not a table.
    """
    lines = text.splitlines()
    for k, line in enumerate(lines):
        if len(line) > LONGEST_LINE:
            raise RecordingError(
                f"{path}:{k + 1}: a line of {len(line)} characters is too long for a table"
            )
    separator, heading_line = _find_heading(lines, path)
    header: dict[str, str] = {}
    for line in lines[:heading_line]:
        key, _, value = _strip_commas(line).replace('"', "").partition(separator)
        header[key.strip().rstrip(":").lower()] = value.strip()
    names = [name.strip().strip('"') for name in _split_fields(lines[heading_line], separator)]
    start = heading_line + 1
    units = [""] * len(names)
    if start < len(lines):
        unit_fields = [field.strip().strip('"') for field in _split_fields(lines[start], separator)]
        if unit_fields and not _matching_fields(_WITH_MARKS, unit_fields):
            units = unit_fields
            start += 1
    columns = itertools.zip_longest(names, units, fillvalue="")
    names, units = map(list, zip(*columns, strict=True))
    notes = RepairNotes(path)
    values, numbers = _read_samples(lines, start, len(names), separator, notes)
    stated_count = header.get("recorded samples", "")
    if stated_count.isdigit() and int(stated_count) != len(numbers):
        notes.add(f"the header promises {stated_count} samples, {len(numbers)} were found")
    return Table(
        names,
        units,
        values=values,
        lines=numbers,
        repairs=notes.texts(),
        header=header,
        doubts=notes.doubts,
    )


def find_columns(table: Table, path: Path) -> dict[str, Column]:
    """Find the columns of time, speed, torque and position.

    If several columns contain a quantity, the first name in `COLUMN_NAMES` is preferred. The others
    are stated in the doubts of the table.

    Parameters
    ----------
    table : Table
        Table of the file, whose `doubts` are extended.
    path : Path
        The file, for messages.

    Returns
    -------
    dict of Column
        Columns by quantity: `time`, `speed`, `torque` and, if there is one, `position`.

    Raises
    ------
    RecordingError
        If a required column is missing or its unit is unknown.
    """
    headings = list(map(_split_heading, table.names, table.units))
    columns: dict[str, Column] = {}
    for quantity, accepted in COLUMN_NAMES.items():
        matches: list[int] = []
        for accepted_name in accepted:
            matches += [k for k, (name, _) in enumerate(headings) if name == accepted_name]
        if matches:
            index = matches[0]
            _, unit = headings[index]
            columns[quantity] = _build_column(table, path, quantity, index, unit=unit)
            for other in matches[1:]:
                if table.names[other]:
                    table.doubts.append(
                        f"the {quantity} is read from column {table.names[index]!r}, "
                        f"not from {table.names[other]!r}"
                    )
        elif quantity != "position":
            raise RecordingError(
                f"{path}: no {quantity} column among "
                f"{list(filter(None, table.names))}; "
                f"accepted names: {', '.join(filter(None, accepted))}"
            )
    return columns


def _build_column(table: Table, path: Path, quantity: str, index: int, *, unit: str) -> Column:
    """Return the column of a quantity with its factor to SI units.

    Parameters
    ----------
    table : Table
        Table of the file.
    path : Path
        The file, for messages.
    quantity : str
        Quantity, a key of `COLUMN_UNITS`.
    index : int
        Index of the column, from 0.
    unit : str
        Unit in the file, in upper or lower case.

    Returns
    -------
    Column
        The column.

    Raises
    ------
    RecordingError
        If the unit is unknown.
    """
    name = table.names[index]
    allowed = COLUMN_UNITS[quantity]
    key = unit.lower()
    if key not in allowed:
        unit_text = f"unit {unit!r}" if unit else "no unit"
        raise RecordingError(
            f"{path}: {quantity} column {name!r} has {unit_text}; allowed: {', '.join(allowed)}"
        )
    return Column(index, name, unit, allowed[key], relative=key in _RELATIVE_UNITS)


def _find_heading(lines: list[str], path: Path) -> tuple[str, int]:
    """Find the line with the names of the columns, and the character that separates them.

    Such a line has at least two fields. One of them begins with a word for speed or torque, and the
    first one does not begin with `trigger`.

    Parameters
    ----------
    lines : list of str
        Lines of the file, of which the first 200 are searched.
    path : Path
        The file, for messages.

    Returns
    -------
    separator : str
        Semicolon, tab or comma.
    index : int
        Index of the line, from 0.

    Raises
    ------
    RecordingError
        If there is no such line.
    """
    prefixes = ("velocity", "speed", "torque", "tau", "omega")
    for separator, (k, line) in itertools.product((";", "\t", ","), enumerate(lines[:200])):
        fields = [field.strip().strip('"').lower() for field in _split_fields(line, separator)]
        has_channel = any(field.startswith(prefixes) for field in fields)
        if len(fields) >= 2 and has_channel and not fields[0].startswith("trigger"):
            return separator, k
    raise RecordingError(
        f"{path}: no line of channel names found (a velocity and a torque column are needed, "
        "separated by ; tab or ,); the file is not an EPOS recorder export or a CSV with named "
        "columns"
    )


def _split_heading(name: str, unit: str) -> tuple[str, str]:
    """Split the heading of a column into the name and the unit of its quantity.

    The result is ("velocity", "rpm") for `velocity` with the unit `rpm`, for `Velocity [rpm]` and
    for `velocity_rpm`.

    Parameters
    ----------
    name : str
        Name in the file, which may contain the unit in brackets or after an underscore.
    unit : str
        Unit in the line of units. Empty if the file states none.

    Returns
    -------
    name, unit : str
        Name in lower case with spaces, and unit as in the file.
    """
    match = _UNIT_IN_NAME.match(name)
    if match and not unit:
        name, unit = match.groups()
    name = name.strip().lower()
    stem, _, suffix = name.rpartition("_")
    if stem and not unit and any(suffix in units for units in COLUMN_UNITS.values()):
        name = stem
        unit = suffix
    return name.replace("_", " "), unit.strip()


def _strip_commas(line: str) -> str:
    """Remove commas and blanks at the end of a line.

    Spreadsheet programs add them to fill empty columns.

    Parameters
    ----------
    line : str
        Line of the file.

    Returns
    -------
    str
        The line without them.
    """
    return line.rstrip().rstrip(",").rstrip()


def _split_fields(line: str, separator: str) -> list[str]:
    """Split a line into its fields, without empty fields at the end.

    Commas in quotes do not separate fields. If commas do not separate fields at all, those at the
    end of the line are removed first, because spreadsheets add them.

    Parameters
    ----------
    line : str
        Line of the file.
    separator : str
        Character that separates the fields.

    Returns
    -------
    list of str
        Fields, with the spaces around them.
    """
    if separator == ",":
        fields: list[str] = next(csv.reader([line.rstrip()]), [])
    else:
        fields = _strip_commas(line).split(separator)
    while fields and not fields[-1].strip():
        fields.pop()
    return fields


def _remove_quotes(text: str) -> str:
    """Remove blanks and quotes around a field, and replace Unicode minus signs by hyphens.

    Parameters
    ----------
    text : str
        Text of the field.

    Returns
    -------
    str
        The field without them.
    """
    return text.strip().strip('"').strip().replace("\u2212", "-")


def _matching_fields(pattern: re.Pattern[str], fields: Iterable[str]) -> list[str]:
    """Select the fields that match a pattern from beginning to end.

    Parameters
    ----------
    pattern : re.Pattern
        The pattern.
    fields : iterable of str
        Texts of the fields.

    Returns
    -------
    list of str
        The matching fields in their order.
    """
    return [field for field in fields if pattern.fullmatch(field)]


def _decimal_marks(rows: list[list[str]], width: int) -> list[str]:
    """Find the decimal mark of each column.

    A column has the mark of those numbers that can be read in only one way. If all its numbers are
    ambiguous, such as 1,024, the mark is guessed from the whole numbers of the column and from the
    other columns.

    Parameters
    ----------
    rows : list of list of str
        Fields of each sample.
    width : int
        Number of columns.

    Returns
    -------
    list of str
        Decimal mark of each column, "." or ",". It is "" for a column that remains ambiguous or
        contradicts itself.
    """
    columns = []
    for k in range(width):
        columns.append([_BLANKS.sub("", _remove_quotes(row[k])) for row in rows])
    certain_marks = [_certain_marks(fields) for fields in columns]
    table_marks = set().union(*certain_marks)
    if not table_marks:
        numbers = _matching_fields(_WITH_MARKS, itertools.chain.from_iterable(columns))
        table_marks = set("".join(numbers)) & set(".,")
    decimal_marks = []
    for fields, marks in zip(columns, certain_marks, strict=True):
        if not marks:
            decimal_marks.append(_guess_mark(fields, table_marks))
        else:
            # Two marks contradict each other.
            decimal_marks.append(marks.pop() if len(marks) == 1 else "")
    return decimal_marks


def _certain_marks(fields: list[str]) -> set[str]:
    """Find the decimal marks of the numbers in a column that can be read in only one way.

    The last mark of such a number separates its decimals. If this mark occurs twice, it separates
    thousands, and the other mark separates decimals.

    Parameters
    ----------
    fields : list of str
        Texts of the column.

    Returns
    -------
    set of str
        Subset of "." and ",". It has two elements if the numbers contradict each other.
    """
    marks = set()
    for number in _matching_fields(_WITH_MARKS, fields):
        last_mark = max(map(number.rfind, ".,"))
        if last_mark >= 0 and not _AMBIGUOUS.fullmatch(number):
            mark = number[last_mark]
            # A mark that occurs more than once separates thousands.
            marks.add(_OTHER_MARK[mark] if number.count(mark) > 1 else mark)
    return marks


def _guess_mark(fields: list[str], table_marks: set[str]) -> str:
    """Guess the decimal mark of a column in which every number with a mark is ambiguous.

    A number is ambiguous if its mark may separate decimals or thousands, such as 1,024. Whole
    numbers in the column decide by their size, and otherwise the rest of the table decides.

    Parameters
    ----------
    fields : list of str
        Texts of the column.
    table_marks : set of str
        Decimal marks that are certain in any column. If none is certain, all marks in the table.

    Returns
    -------
    str
        Probable decimal mark, "." or ",", or "" if it cannot be guessed.
    """
    marks_in_fields = set("".join(_matching_fields(_AMBIGUOUS, fields))) & set(".,")
    if len(marks_in_fields) != 1:
        return "" if marks_in_fields else "."
    (mark,) = marks_in_fields
    integers = [abs(int(field)) for field in _matching_fields(_INTEGER, fields)]
    if integers:
        # After 992, the text 1,024 is 1024. After 1024, the text 1,125 is 1.125.
        decimal = max(integers) >= 1000 or (mark == "." and "," not in table_marks)
        return mark if decimal else _OTHER_MARK[mark]
    return mark if table_marks == {mark} else ""


def _read_samples(
    lines: list[str], start: int, width: int, separator: str, notes: RepairNotes
) -> tuple[Array, list[int]]:
    """Read the samples of a table.

    If all fields are plain numbers, they are converted at once. Otherwise, the decimal mark of each
    column is found, and the fields are converted one by one with notes on every repair.

    Parameters
    ----------
    lines : list of str
        Lines of the file.
    start : int
        Index of the first line with a sample.
    width : int
        Number of columns.
    separator : str
        Character that separates the columns.
    notes : RepairNotes
        Notes, which are extended.

    Returns
    -------
    values : (samples, width) array
        Numbers in the units of the file. Missing ones are NaN.
    numbers : list of int
        Line number of each sample, from 1.

    Raises
    ------
    RecordingError
        If the table is empty, or if many lines of a comma-separated file have more than `width`
        fields. Their numbers then seem to have decimal commas.
    """
    rows, numbers, too_long = _split_rows(lines, start, width, separator, notes)
    if not rows:
        raise RecordingError(f"{notes.path}: no sample follows the header")
    if separator == "," and len(too_long) > max(1, LARGEST_OMITTED_SHARE * len(rows)):
        raise RecordingError(
            f"{notes.path}:{too_long[0]}: more fields than the {width} columns that the "
            "header names: where the comma separates columns, numbers with a decimal comma must be "
            "quoted"
        )
    if too_long:
        treatment = "left out" if separator == "," else "the rest ignored"
        notes.add(
            f"{len(too_long)} lines with more than {width} columns (first: line {too_long[0]}): "
            f"{treatment}"
        )
    try:
        return np.array(rows, dtype=float), numbers
    except ValueError:
        marks = _decimal_marks(rows, width)
    values = np.empty((len(rows), width))
    for k, (line_number, row) in enumerate(zip(numbers, rows, strict=True)):
        for j, mark in enumerate(marks):
            values[k, j] = notes.number(row[j], line_number - 1, mark)
    return values, numbers


def _split_rows(
    lines: list[str], start: int, width: int, separator: str, notes: RepairNotes
) -> tuple[list[list[str]], list[int], list[int]]:
    """Split the lines of all samples into fields.

    A line with too few fields is filled with empty ones, except an incomplete last line, which is
    left out. A line with too many fields is cut or, if the comma separates columns, becomes empty:
    its numbers may have decimal commas.

    Parameters
    ----------
    lines : list of str
        Lines of the file.
    start : int
        Index of the first line with a sample.
    width : int
        Number of columns.
    separator : str
        Character that separates the columns.
    notes : RepairNotes
        Notes, to which those on blank lines, commas at the end of lines and an incomplete last line
        are added.

    Returns
    -------
    rows : list of list of str
        Fields of each sample, `width` each.
    numbers : list of int
        Line number of each sample, from 1.
    too_long : list of int
        Numbers of the lines with too many fields.
    """
    rows: list[list[str]] = []
    numbers = []
    too_long = []
    filled_lines = [k for k in range(start, len(lines)) if lines[k].strip(" \t\r,;")]
    stop = max(filled_lines, default=start - 1)
    for k, line in enumerate(lines[start : stop + 1], start):
        fields = _split_fields(line, separator)
        if not fields:
            notes.count("blank lines skipped", k)
            continue
        if separator != "," and line.rstrip().endswith(","):
            notes.count("lines with commas added at their end read without them", k)
        if len(fields) > width:
            too_long.append(k + 1)
            # A number with a decimal comma is split into two fields.
            fields = [] if separator == "," else fields
        elif len(fields) < width and k == stop:
            notes.add(f"the last line ({k + 1}) is cut off and left out")
            continue
        rows.append((fields + [""] * width)[:width])
        numbers.append(k + 1)
    return rows, numbers, too_long
