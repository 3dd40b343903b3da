"""A section of the document: a Markdown template of paper/templates, the values it shows and its figures."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

from ssm_planner.paper import published
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure


NOTHING = "–"
WIDTH = 120


@dataclass(frozen=True, eq=False)
class Section:
    """name: of the template. figures: by file name without its ending; the template shows them by `picture`."""

    name: str
    values: Mapping[str, Any]
    figures: Mapping[str, Figure] = field(default_factory=dict)

    @cached_property
    def text(self) -> str:
        """Markdown that starts with the heading; paragraphs in lines of WIDTH, tables and pictures as they are."""
        blocks = render(self.name, **self.values).rstrip().split("\n\n")
        return "\n\n".join(block if re.match(r"[|#]|\[!", block) else wrapped(block) for block in blocks) + "\n"

    @property
    def title(self) -> str:
        return self.text.splitlines()[0].removeprefix("## ")

    @property
    def anchor(self) -> str:
        """As GitHub makes it of a heading."""
        return re.sub(r"[^\w -]", "", self.title.lower()).replace(" ", "-")


def render(name: str, **values: Any) -> str:
    """A template filled in, with one empty line between its blocks."""
    text = _environment().get_template(f"{name}.md").render(values).strip()
    return re.sub(r"\n{2,}", "\n\n", text) + "\n"


def wrapped(paragraph: str) -> str:
    """A paragraph in lines of WIDTH, commands unbroken."""
    joined = re.sub("`[^`]*`", lambda code: code.group().replace(" ", "\0"), " ".join(paragraph.split()))
    return textwrap.fill(joined, WIDTH, break_long_words=False, break_on_hyphens=False).replace("\0", " ")


def number(value: float, digits: int = 3) -> str:
    """Significant digits; what is zero but for rounding is 0."""
    return "0" if abs(value) < 1e-12 else minus(f"{value:.{digits}g}")


def fixed(value: float, decimals: int) -> str:
    """A number of so many decimals."""
    return minus(f"{value:.{decimals}f}")


def signed(value: float, decimals: int) -> str:
    """A difference with its sign; 0 where it vanishes at these decimals."""
    shown = f"{value:+.{decimals}f}"
    return minus(shown if float(shown) else f"{0:.{decimals}f}")


def percent(value: float, decimals: int = 1) -> str:
    """A relative difference."""
    return f"{signed(100.0 * value, decimals)} %"


def minus(shown: str) -> str:
    """The number with a minus sign instead of a hyphen."""
    return shown.replace("-", "−")


@cache
def _environment() -> Environment:
    """Jinja2 with the templates; a name that a template misses raises UndefinedError."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("ssm_planner.paper"), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    made.filters.update(
        number=number,
        milli=lambda value: number(1e3 * value),
        fixed=fixed,
        signed=signed,
        percent=percent,
        in_degrees=math.degrees,
        degrees=lambda angle, decimals=3: fixed(math.degrees(angle), decimals) + "°",
        degrees_more=lambda angle, decimals: signed(math.degrees(angle), decimals) + "°",
    )
    made.globals.update(published=published, DRIVEN=published.DRIVEN, NUMBER=published.NUMBER, RPM=RPM, zip=zip)
    return made
