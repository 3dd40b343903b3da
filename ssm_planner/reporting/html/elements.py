"""HTML elements whose text is escaped unless it is markup already."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

VOID = {"br", "hr", "img", "input", "meta", "link"}


class Markup(str):
    """Text that is HTML already; everything else is escaped when it becomes part of an element."""

    __slots__ = ()


def tag(name: str, *children: str | None, **attributes: str | int | bool | None) -> Markup:
    """<name attributes>children</name>; `class_` and `data_x` become class and data-x, None children are left out."""
    written = "".join(_attribute(key, value) for key, value in attributes.items())
    if name in VOID:
        return Markup(f"<{name}{written}>")
    return Markup(f"<{name}{written}>{join(children)}</{name}>")


def join(children: Iterable[str | None]) -> Markup:
    """Children one after the other, escaped where they are plain text."""
    return Markup("".join(child if isinstance(child, Markup) else html.escape(child) for child in children if child))


def table(
    header: Sequence[str], rows: Iterable[Sequence[str]], *, caption: str = "", numbers: Sequence[int] = ()
) -> Markup:
    """A table in a frame that scrolls on narrow screens; numbers: columns that are set to the right."""

    def cells(kind: str, row: Sequence[str]) -> Markup:
        return join(tag(kind, cell, class_="number" if i in numbers else None) for i, cell in enumerate(row))

    head = tag(
        "thead", tag("tr", *(tag("th", t, scope="col", class_=_number(i, numbers)) for i, t in enumerate(header)))
    )
    body = tag("tbody", *(tag("tr", cells("td", row)) for row in rows))
    title = tag("caption", caption) if caption else None
    return tag("div", tag("table", title, head, body), class_="scroll")


def _number(column: int, numbers: Sequence[int]) -> str | None:
    return "number" if column in numbers else None


def _attribute(key: str, value: str | int | bool | None) -> str:
    name = key.rstrip("_").replace("_", "-")
    if value is None or value is False:
        return ""
    return f" {name}" if value is True else f' {name}="{html.escape(str(value))}"'
