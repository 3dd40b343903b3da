"""Format numbers and templates for the terminal, pages, figures and the paper."""

import shutil
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

MISSING_VALUE = "–"
"""Text for a missing value."""


DEFAULT_TEXT_WIDTH = 100
"""Width of text that is not printed on a terminal, in characters."""


def terminal_width() -> int:
    """Return the width of the terminal in characters, or the value of the variable COLUMNS."""
    return max(40, shutil.get_terminal_size((DEFAULT_TEXT_WIDTH, 24)).columns)


def use_minus_signs(text: str) -> str:
    """Replace the hyphens in the text of a number by minus signs (U+2212)."""
    return text.replace("-", "−")


def format_number(value: float | None, digits: int = 3) -> str:
    """Format a number with significant digits.

    Parameters
    ----------
    value : float or None
        Number. Magnitudes below 1e-12 become 0, and None becomes `MISSING_VALUE`.
    digits : int
        Number of significant digits.

    Returns
    -------
    str
        Number with a minus sign (U+2212) instead of a hyphen.
    """
    if value is None:
        return MISSING_VALUE
    return "0" if abs(value) < 1e-12 else use_minus_signs(f"{value:.{digits}g}")


def format_fixed(value: float | None, decimals: int) -> str:
    """Format a number with fixed decimals.

    Parameters
    ----------
    value : float or None
        Number. A result of −0 becomes 0, and None becomes `MISSING_VALUE`.
    decimals : int
        Number of digits after the decimal point.

    Returns
    -------
    str
        Number with a minus sign (U+2212) instead of a hyphen.
    """
    if value is None:
        return MISSING_VALUE
    return use_minus_signs(f"{round(value, decimals) + 0.0:.{decimals}f}")


def format_signed(value: float | None, decimals: int) -> str:
    """Format a difference with its sign and fixed decimals.

    Parameters
    ----------
    value : float or None
        Difference. A rounded 0 has no sign, and None becomes `MISSING_VALUE`.
    decimals : int
        Number of digits after the decimal point.
    """
    text = format_fixed(value, decimals)
    return f"+{text}" if value is not None and round(value, decimals) > 0 else text


def format_percent(share: float | None, decimals: int = 1) -> str:
    """Format a fraction, such as a margin or a relative difference, in percent with its sign.

    Parameters
    ----------
    share : float or None
        Fraction. 0.05 becomes "+5.0 %", and None becomes `MISSING_VALUE`.
    decimals : int
        Number of digits after the decimal point.
    """
    return MISSING_VALUE if share is None else f"{format_signed(100.0 * share, decimals)} %"


def plain_words(name: str) -> str:
    """Replace the underscores in the name of a field or key by spaces."""
    return name.replace("_", " ")


def jinja_environment(package: str, escape: bool, **filters: Callable[..., Any]) -> "Environment":
    """Return a Jinja2 environment with the templates of a package.

    Parameters
    ----------
    package : str
        Package that contains the folder `templates`.
    escape : bool
        True to escape values for XML and HTML.
    **filters : callable
        Filters of the templates, in addition to those of this module.

    Returns
    -------
    Environment
        A template that uses a missing name raises UndefinedError.
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
        number=format_number,
        fixed=format_fixed,
        signed=format_signed,
        percent=format_percent,
        **filters,
    )
    return result


def render_template(templates: "Environment", template: str, /, **values: Any) -> str:
    """Fill in a Jinja2 template, and return the text with exactly one newline at its end.

    Parameters
    ----------
    templates : Environment
        Result of `jinja_environment`.
    template : str
        File name of the template.
    **values
        Values of the names in the template.
    """
    return templates.get_template(template).render(values).rstrip("\n") + "\n"
