"""Results of one part of the benchmark as plain data, and their Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from tests.benchmarks.measuring import Spread, short


@dataclass(frozen=True)
class Figure:
    """A target of the project and the measured value."""

    what: str
    asked: str
    found: str
    reached: bool


@dataclass
class Section:
    """Paragraphs and tables in order.

    `cannot` holds (name, reason) of programs that cannot do the task.
    """

    title: str
    blocks: list[dict[str, Any]] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    cannot: list[tuple[str, str]] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    """Sentences that name a program which is better, the task, and the factor."""

    def say(self, text: str) -> None:
        self.blocks.append({"text": text})

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        self.blocks.append({"head": list(head), "rows": [list(row) for row in rows]})

    def asked(self, what: str, asked: str, found: str, reached: bool) -> None:
        self.figures.append(Figure(what, asked, found, bool(reached)))

    def faster(self, who: str, what: str, ratio: Spread) -> None:
        """Note that another program is faster if its time over ours is below one."""
        if ratio.median < 1:
            self.losses.append(
                f"{who}: {short(1 / ratio.median)} × faster than this planner ({what})"
            )

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Section:
        figures = [Figure(**figure) for figure in data["figures"]]
        cannot = [(who, why) for who, why in data["cannot"]]
        return cls(data["title"], data["blocks"], figures, cannot, data["losses"])

    def lines(self) -> list[str]:
        lines = [f"## {self.title}", ""]
        for block in self.blocks:
            if "text" in block:
                lines += [block["text"], ""]
            else:
                lines += [*table_lines(block["head"], block["rows"]), ""]
        if self.cannot:
            lines += ["Cannot do it:", "", *(f"* {who}: {why}" for who, why in self.cannot), ""]
        return lines


def table_lines(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    return [f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows)]
