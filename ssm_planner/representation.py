"""Represent values as short texts, as HTML tables in notebooks, and as data frames."""

import dataclasses
import reprlib
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from ssm_planner.errors import SsmPlannerError

LONGEST_TEXT = 400
"""Largest number of characters of the text of a value."""
LONGEST_FIELD = 60
"""Largest number of characters of the text of one field."""


def short_repr(value: object) -> str:
    """Return a short text of a dataclass, with its fields and their abbreviated values.

    An array with more than four values is represented by its shape, and a long text of a field by
    the type of its value. The decorators in `typing` use this function as the `__repr__` of their
    classes.

    Parameters
    ----------
    value : object
        Instance of a dataclass.

    Returns
    -------
    str
        Text of at most `LONGEST_TEXT` characters.
    """
    cls: Any = type(value)
    fields_text = [
        f"{field.name}={_abbreviated(getattr(value, field.name))}"
        for field in dataclasses.fields(cls)
    ]
    text = f"{cls.__name__}({', '.join(fields_text)})"
    return text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 2] + "…)"


def _abbreviated(value: object) -> str:
    """Format the value of a field as a short text."""
    if isinstance(value, np.ndarray):
        return f"<array {value.shape}>" if value.size > 4 else repr(value.tolist())
    text = repr(value) if dataclasses.is_dataclass(value) else reprlib.repr(value)
    return text if len(text) <= LONGEST_FIELD else f"<{type(value).__name__}>"


def html_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return an HTML table with a row of headings and one row for each mapping.

    Parameters
    ----------
    rows : sequence of mapping
        Values by heading. All mappings have the same keys in the same order.

    Returns
    -------
    str
        HTML. The table is empty without rows.
    """
    headings = list(rows[0]) if rows else []
    lines = [_html_row(headings)] if rows else []
    lines += [_html_row(list(row.values())) for row in rows]
    return f"<table>{''.join(lines)}</table>"


def _html_row(values: Sequence[Any]) -> str:
    """Return a row of an HTML table. Numbers have six significant digits."""
    texts = [f"{value:.6g}" if isinstance(value, float) else str(value) for value in values]
    cells = [f"<td>{escape(text)}</td>" for text in texts]
    return f"<tr>{''.join(cells)}</tr>"


def data_frame(columns: Any) -> Any:
    """Build a pandas DataFrame.

    Parameters
    ----------
    columns : mapping
        Values of each column by its name.

    Raises
    ------
    SsmPlannerError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise SsmPlannerError("needs pandas: python3 -m pip install pandas") from None
    return pandas.DataFrame(columns)
