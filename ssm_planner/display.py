"""Format numbers and templates for the terminal, pages, figures and the paper."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

NOTHING = "–"
"""Text for a missing value."""


PRINTED = 100
"""Number of columns of text that does not go to a terminal."""


def columns() -> int:
    """Return the width of the terminal, or the value of COLUMNS."""
    return max(40, shutil.get_terminal_size((PRINTED, 24)).columns)


def minus(text: str) -> str:
    """Return text with minus signs instead of hyphens."""
    return text.replace("-", "−")


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with significant digits. Rounding errors become 0."""
    if value is None:
        return NOTHING
    return "0" if abs(value) < 1e-12 else minus(f"{value:.{digits}g}")


def format_fixed(value: float | None, decimals: int) -> str:
    """Return a number with fixed decimals and without a negative zero."""
    if value is None:
        return NOTHING
    return minus(f"{round(value, decimals) + 0.0:.{decimals}f}")


def signed(value: float | None, decimals: int) -> str:
    """Return a difference with its sign, or 0 if it is 0 at this number of decimals."""
    text = format_fixed(value, decimals)
    return f"+{text}" if value is not None and round(value, decimals) > 0 else text


def percent(share: float | None, decimals: int = 1) -> str:
    """Return a margin or a relative difference in percent with its sign."""
    return NOTHING if share is None else f"{signed(100.0 * share, decimals)} %"


def plain_words(name: str) -> str:
    """Return the name of a field or key with spaces instead of underscores."""
    return name.replace("_", " ")


def environment(package: str, escape: bool, **filters: Callable[..., Any]) -> Environment:
    """Return a Jinja2 environment with the templates of a package and with these filters.

    A name that is missing in a template raises UndefinedError. If `escape` is true, values are
    escaped for XML and HTML.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    result = Environment(
        loader=PackageLoader(package),
        autoescape=escape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    result.filters.update(
        number=number, fixed=format_fixed, signed=signed, percent=percent, **filters
    )
    return result


def render_template(templates: Environment, template: str, /, **values: Any) -> str:
    """Return a rendered template that ends with one newline."""
    return templates.get_template(template).render(values).rstrip("\n") + "\n"
