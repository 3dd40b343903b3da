"""Render a section of the document from its template in paper/templates."""

import math
import re
import textwrap
from collections.abc import Mapping
from dataclasses import field
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

from paper_reproduction import published
from ssm_planner.display import (
    format_fixed,
    format_number,
    format_signed,
    jinja_environment,
    render_template,
)
from ssm_planner.typing import record
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure


WIDTH = 120
"""Largest number of characters of a line in the document."""


@record
class Section:
    """Section of the document, whose text follows from a template."""

    name: str
    """Name of the template without suffix."""
    values: Mapping[str, Any]
    """Variables of the template."""
    figures: "Mapping[str, Figure]" = field(default_factory=dict)
    """Figures by file name without suffix. The template inserts them by the macro `picture`."""

    @cached_property
    def text(self) -> str:
        """Markdown of the section, which starts with the heading.

        Paragraphs are wrapped to WIDTH characters, but tables and pictures are not.
        """
        blocks = render(self.name, **self.values).rstrip().split("\n\n")
        return (
            "\n\n".join(
                block if re.match(r"[|#]|\[!", block) else wrapped(block) for block in blocks
            )
            + "\n"
        )

    @property
    def title(self) -> str:
        """Text of the heading."""
        return self.text.splitlines()[0].removeprefix("## ")

    @property
    def anchor(self) -> str:
        """Anchor of the section in links, as GitHub derives it from the heading."""
        return re.sub(r"[^\w -]", "", self.title.lower()).replace(" ", "-")


def render(name: str, **values: Any) -> str:
    """Fill in a template of Markdown, with exactly one empty line between blocks."""
    return re.sub(r"\n{2,}", "\n\n", render_template(_templates(), f"{name}.md", **values).lstrip())


def wrapped(paragraph: str) -> str:
    """Wrap a paragraph to WIDTH characters, without line breaks in code between backticks."""
    joined = re.sub(
        "`[^`]*`", lambda code: code.group().replace(" ", "\0"), " ".join(paragraph.split())
    )
    return textwrap.fill(joined, WIDTH, break_long_words=False, break_on_hyphens=False).replace(
        "\0", " "
    )


@cache
def _templates() -> "Environment":
    """Return the Jinja2 environment of the document, with filters for angles and milli-units."""
    templates = jinja_environment(
        "paper_reproduction",
        escape=False,
        milli=lambda value: format_number(1e3 * value),
        in_degrees=math.degrees,
        degrees=lambda angle, decimals=3: format_fixed(math.degrees(angle), decimals) + "°",
        degrees_more=lambda angle, decimals: format_signed(math.degrees(angle), decimals) + "°",
    )
    templates.globals.update(
        published=published, DRIVEN=published.DRIVEN, NUMBER=published.NUMBER, RPM=RPM, zip=zip
    )
    return templates
