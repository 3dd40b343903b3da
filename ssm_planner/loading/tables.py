"""Read tables of cells from text files, with commas, semicolons or tabs between the columns."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path

from ssm_planner.errors import ProblemError
from ssm_planner.loading.files import text_of

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?(\s*[^\d\s]\S*)?")
"""Number with a decimal comma and possibly a unit."""


def table_rows(file: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the cells of each row of a table. The headings are the first row.

    The separator is the one that occurs most often in the headings. Rows of empty cells and lines
    that begin with # are skipped. Cells may be quoted. Spaces at the ends of a cell are removed.

    Raises
    ------
    ProblemError
        If the file is not a table, if a row does not have as many cells as the headings, or if a
        cell is a number with a decimal comma.
    """
    text = text_of(file)
    heading_line = next((line for line in text.splitlines() if line.strip() and line[0] != "#"), "")
    separator = max(SEPARATORS, key=heading_line.count)
    reader = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    headings: list[str] = []
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            headings = headings or cells
            _check_row(cells, headings, separator)
            yield reader.line_num, cells
    except (csv.Error, ProblemError) as error:
        fault = (
            error if isinstance(error, ProblemError) else ProblemError(f"invalid table: {error}")
        )
        if fault.file is None:
            fault.file, fault.line = str(file), reader.line_num
        raise fault from None


def _check_row(cells: list[str], headings: list[str], separator: str) -> None:
    """Raise ProblemError if a row has a wrong number of cells or a number with a decimal comma."""
    number_format = f"a decimal point, because {SEPARATORS[separator]} separate the columns"
    if len(cells) != len(headings):
        allowed = f"{len(headings)} as in the headings; numbers have {number_format}"
        raise ProblemError(f"{len(cells)} cells", allowed=allowed)
    for name, cell in zip(headings, cells, strict=True):
        if DECIMAL_COMMA.fullmatch(cell):
            raise ProblemError(
                "a number with a decimal comma",
                key=f"column {name}",
                value=cell,
                allowed=number_format,
            )
