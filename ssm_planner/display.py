"""Numbers as people read them, and templates filled in: the same for terminal, pages, figures and the paper."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

NOTHING = "–"
"""In the place of a value that is not known or does not exist."""


PRINTED = 100
"""Columns of text that goes to no terminal."""


def columns() -> int:
    """Width of the terminal, or what COLUMNS says."""
    return max(40, shutil.get_terminal_size((PRINTED, 24)).columns)


def minus(text: str) -> str:
    """Text with minus signs instead of hyphens."""
    return text.replace("-", "−")


def number(value: float | None, digits: int = 3) -> str:
    """Significant digits; what is zero but for rounding is 0."""
    if value is None:
        return NOTHING
    return "0" if abs(value) < 1e-12 else minus(f"{value:.{digits}g}")


def fixed(value: float | None, decimals: int) -> str:
    """A number of so many decimals, without a negative zero."""
    if value is None:
        return NOTHING
    return minus(f"{round(value, decimals) + 0.0:.{decimals}f}")


def signed(value: float | None, decimals: int) -> str:
    """A difference with its sign; 0 where it vanishes at these decimals."""
    shown = fixed(value, decimals)
    return f"+{shown}" if value is not None and round(value, decimals) > 0 else shown


def percent(share: float | None, decimals: int = 1) -> str:
    """A margin or a relative difference with its sign."""
    return NOTHING if share is None else f"{signed(100.0 * share, decimals)} %"


def words(name: str) -> str:
    """The name of a field or key as words."""
    return name.replace("_", " ")


def environment(package: str, escape: bool, **filters: Callable[..., Any]) -> Environment:
    """Jinja2 with the templates/ of a package and these filters: a name that a template misses raises UndefinedError.

    escape: every value is escaped, as XML and HTML need it.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader(package),
        autoescape=escape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(number=number, fixed=fixed, signed=signed, percent=percent, **filters)
    return made


def filled(templates: Environment, template: str, /, **values: Any) -> str:
    """A template filled in, with one line end at its end."""
    return templates.get_template(template).render(values).rstrip("\n") + "\n"
