"""Tables of text on the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

SHOWN = {"rad": ("deg", 180 / math.pi), "m": ("mm", 1e3), "N·m": ("mN·m", 1e3)}
"""Units that people read more easily, with the factor from SI."""


def shown_unit(unit: str, name: str = "") -> tuple[str, float]:
    """(unit to show, factor) of an SI unit such as rad/s; name: of the limit, for motors turn in rpm."""
    if name == "motor speed":
        return "rpm", 30 / math.pi
    base, slash, per = unit.partition("/")
    name, scale = SHOWN.get(base, (base, 1.0))
    return name + slash + per, scale


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table: the first column to the left, the others to the right."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        rest = (cell.rjust(width) for cell, width in zip(cells[1:], widths[1:], strict=True))
        return "  ".join([cells[0].ljust(widths[0]), *rest]).rstrip()

    return [line(header), "  ".join("-" * width for width in widths), *(line(row) for row in rows)]
