"""A section of the document: lines of Markdown and the figures they show."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


NOTHING = "–"
WIDTH = 120
COMMAND = "ssm-planner reproduce"


@dataclass(frozen=True, eq=False)
class Section:
    """title: of the heading. also: commands that show a part of the section by themselves."""

    title: str
    lines: Sequence[str]
    figures: Mapping[str, Figure] = field(default_factory=dict)
    """By file name without its ending; the lines show them by `picture`."""
    also: Sequence[str] = ()

    def markdown(self) -> list[str]:
        alone = "".join(f", `{command}`" for command in self.also)
        made = f"Made by `{COMMAND}`." + (f" Parts of it alone: {alone[2:]}." if alone else "")
        return [f"## {self.title}", "", *text(made), *self.lines]


def text(paragraph: str) -> list[str]:
    """A paragraph in lines of WIDTH, commands unbroken, and an empty line."""
    joined = re.sub("`[^`]*`", lambda code: code.group().replace(" ", "\0"), paragraph)
    lines = textwrap.wrap(joined, WIDTH, break_long_words=False, break_on_hyphens=False)
    return [*(line.replace("\0", " ") for line in lines), ""]


def table(head: Sequence[str], rows: Sequence[Sequence[str]], words: Sequence[int] = ()) -> list[str]:
    """A Markdown table and an empty line; the first column and those of `words` to the left, the others to the right."""
    marks = ["---" if i == 0 or i in words else "---:" for i in range(len(head))]
    return ["| " + " | ".join(cells) + " |" for cells in (head, marks, *rows)] + [""]


def picture(name: str, caption: str) -> list[str]:
    """The figure, linked to its PDF, with its caption."""
    return [f"[![{caption}]({name}.png)]({name}.pdf)", "", *text(f"*{caption}.*")]


def number(value: float, digits: int = 3) -> str:
    """Significant digits; what is zero but for rounding is 0."""
    return "0" if abs(value) < 1e-12 else minus(f"{value:.{digits}g}")


def signed(value: float, decimals: int, unit: str = "") -> str:
    """A difference with its sign; 0 where it vanishes at these decimals."""
    shown = f"{value:+.{decimals}f}"
    return minus(shown if float(shown) else f"{0:.{decimals}f}") + unit


def percent(value: float, decimals: int = 1) -> str:
    """A relative difference."""
    return signed(100.0 * value, decimals, " %")


def minus(shown: str) -> str:
    """The number with a minus sign instead of a hyphen."""
    return shown.replace("-", "−")
