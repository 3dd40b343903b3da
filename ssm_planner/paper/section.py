"""A section of the document: a Markdown template of paper/templates, the values it shows and its figures."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

from ssm_planner.display import environment, filled, fixed, number, signed
from ssm_planner.paper import published
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure


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
        return (
            "\n\n".join(
                block if re.match(r"[|#]|\[!", block) else wrapped(block) for block in blocks
            )
            + "\n"
        )

    @property
    def title(self) -> str:
        return self.text.splitlines()[0].removeprefix("## ")

    @property
    def anchor(self) -> str:
        """As GitHub makes it of a heading."""
        return re.sub(r"[^\w -]", "", self.title.lower()).replace(" ", "-")


def render(name: str, **values: Any) -> str:
    """A template filled in, with one empty line between its blocks."""
    return re.sub(r"\n{2,}", "\n\n", filled(_templates(), f"{name}.md", **values).lstrip())


def wrapped(paragraph: str) -> str:
    """A paragraph in lines of WIDTH, commands unbroken."""
    joined = re.sub(
        "`[^`]*`", lambda code: code.group().replace(" ", "\0"), " ".join(paragraph.split())
    )
    return textwrap.fill(joined, WIDTH, break_long_words=False, break_on_hyphens=False).replace(
        "\0", " "
    )


@cache
def _templates() -> Environment:
    """The document's templates."""
    made = environment(
        "ssm_planner.paper",
        escape=False,
        milli=lambda value: number(1e3 * value),
        in_degrees=math.degrees,
        degrees=lambda angle, decimals=3: fixed(math.degrees(angle), decimals) + "°",
        degrees_more=lambda angle, decimals: signed(math.degrees(angle), decimals) + "°",
    )
    made.globals.update(
        published=published, DRIVEN=published.DRIVEN, NUMBER=published.NUMBER, RPM=RPM, zip=zip
    )
    return made
