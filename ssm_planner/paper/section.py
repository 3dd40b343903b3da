"""Render a section of the document from its template in paper/templates."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping
from dataclasses import field
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

from ssm_planner.display import environment, format_fixed, number, render_template, signed
from ssm_planner.paper import published
from ssm_planner.typing import record
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure


WIDTH = 120


@record
class Section:
    """Section of the document.

    `name` is the name of the template, and `values` are its variables. `figures` contains the
    figures by file name without suffix. The template shows a figure by `picture`.
    """

    name: str
    values: Mapping[str, Any]
    figures: Mapping[str, Figure] = field(default_factory=dict)

    @cached_property
    def text(self) -> str:
        """Markdown of the section, which starts with the heading.

        Paragraphs are wrapped to WIDTH. Tables and pictures are not changed.
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
        """Heading without its marks."""
        return self.text.splitlines()[0].removeprefix("## ")

    @property
    def anchor(self) -> str:
        """Anchor that GitHub derives from the heading."""
        return re.sub(r"[^\w -]", "", self.title.lower()).replace(" ", "-")


def render(name: str, **values: Any) -> str:
    """Fill in a template, with one empty line between blocks."""
    return re.sub(r"\n{2,}", "\n\n", render_template(_templates(), f"{name}.md", **values).lstrip())


def wrapped(paragraph: str) -> str:
    """Wrap a paragraph to WIDTH. Commands are not broken."""
    joined = re.sub(
        "`[^`]*`", lambda code: code.group().replace(" ", "\0"), " ".join(paragraph.split())
    )
    return textwrap.fill(joined, WIDTH, break_long_words=False, break_on_hyphens=False).replace(
        "\0", " "
    )


@cache
def _templates() -> Environment:
    """Return the environment of the document's templates."""
    templates = environment(
        "ssm_planner.paper",
        escape=False,
        milli=lambda value: number(1e3 * value),
        in_degrees=math.degrees,
        degrees=lambda angle, decimals=3: format_fixed(math.degrees(angle), decimals) + "°",
        degrees_more=lambda angle, decimals: signed(math.degrees(angle), decimals) + "°",
    )
    templates.globals.update(
        published=published, DRIVEN=published.DRIVEN, NUMBER=published.NUMBER, RPM=RPM, zip=zip
    )
    return templates
