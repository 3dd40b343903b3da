"""Read tables of cells from text files, with commas, semicolons or tabs between the columns.

`table_rows` reads any such table, and refuses decimal commas unless the caller allows them.
`replace_decimal_commas` converts them after checking that they do not separate thousands.
"""

import csv
import io
import re
from collections.abc import Container, Iterator
from pathlib import Path

from ssm_planner.errors import ProblemError
from ssm_planner.loading.files import read_text

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
"""Characters that may separate columns, with their names for messages."""
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?(\s*[^\d\s]\S*)?")
"""Number with a decimal comma and possibly a unit."""
LEADING_NUMBER = re.compile(r"[+-]?\d*([.,])\d+([eE][+-]?\d+)?(?![\d.,])")
"""Number with a decimal comma or point at the start of a cell."""
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}(?![\deE])")
"""Number whose comma may separate thousands."""


def table_rows(file: Path, decimal_commas: bool = False) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the cells of each row of a table, beginning with its headings.

    The separator is the one that occurs most often in the headings. Rows of empty cells and lines
    that begin with # are skipped. Cells may be quoted. Spaces at the ends of a cell are removed.

    Parameters
    ----------
    file : Path
        Table to read.
    decimal_commas : bool
        True to allow numbers with decimal commas in tables with semicolons or tabs.

    Yields
    ------
    line : int
        Number of the last line of the row, from 1.
    cells : list of str
        Texts of the cells.

    Raises
    ------
    ProblemError
        If the file is not a table, if a row does not have as many cells as the headings, or if a
        cell is a number with a decimal comma that is not allowed.
    """
    text = read_text(file)
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
            _check_row(cells, headings, separator, decimal_commas and separator != ",")
            yield reader.line_num, cells
    except csv.Error as error:
        raise ProblemError(f"invalid table: {error}", file=file, line=reader.line_num) from None
    except ProblemError as fault:
        fault.file, fault.line = str(file), reader.line_num
        raise


def replace_decimal_commas(
    rows: list[tuple[int, list[str]]], texts: Container[str], file: Path
) -> None:
    """Replace the decimal commas of a table by points, except in columns of texts.

    Parameters
    ----------
    rows : list of tuples
        Line and cells of each row. The first row contains the headings. The cells are changed in
        place.
    texts : container of str
        Headings of the columns that remain unchanged.
    file : Path
        The table, for messages.

    Raises
    ------
    ProblemError
        If the table has decimal points as well, or if all its commas may separate thousands.
    """
    headings = rows[0][1]
    numbers = [
        (line, cells, k, match[1])
        for line, cells in rows[1:]
        for k, heading in enumerate(headings)
        if heading not in texts and (match := LEADING_NUMBER.match(cells[k]))
    ]
    commas = [(cells, k) for _, cells, k, sign in numbers if sign == ","]
    # A comma surely separates decimals if it cannot separate thousands.
    is_certain = any(not THOUSANDS.match(cells[k]) for cells, k in commas)
    for line, cells, k, sign in numbers if commas else ():
        if sign == "." or not is_certain:
            raise ProblemError(
                "commas and points may separate decimals or thousands",
                file=file,
                line=line,
                key=f"column {headings[k]}",
                value=cells[k],
                allowed="one decimal sign in the whole table, and no thousands separators",
            )
        cells[k] = cells[k].replace(",", ".", 1)


def _check_row(cells: list[str], headings: list[str], separator: str, commas: bool) -> None:
    """Raise ProblemError if a row has a wrong number of cells, or a forbidden decimal comma.

    Parameters
    ----------
    cells, headings : lists of str
        Texts of the cells of the row, and of the headings.
    separator : str
        Character between the columns.
    commas : bool
        True if numbers may have decimal commas.
    """
    number_format = f"a decimal point, because {SEPARATORS[separator]} separate the columns"
    if len(cells) != len(headings):
        allowed = f"{len(headings)} as in the headings; numbers have {number_format}"
        raise ProblemError(f"{len(cells)} cells", allowed=allowed)
    for name, cell in zip(headings, cells, strict=True):
        if not commas and DECIMAL_COMMA.fullmatch(cell):
            raise ProblemError(
                "a number with a decimal comma",
                key=f"column {name}",
                value=cell,
                allowed=number_format,
            )
