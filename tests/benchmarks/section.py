"""What a part of the benchmark found, as plain data, and how it is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from tests.benchmarks.measuring import Spread, short


@dataclass(frozen=True)
class Figure:
    """A number that the project has to reach, beside what was found."""

    what: str
    asked: str
    found: str
    reached: bool


@dataclass
class Section:
    """Paragraphs and tables in order; cannot: (who, why) for those that cannot do the task."""

    title: str
    blocks: list[dict[str, Any]] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    cannot: list[tuple[str, str]] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    """Sentences: who is better at what, and by how much."""

    def say(self, text: str) -> None:
        self.blocks.append({"text": text})

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        self.blocks.append({"head": list(head), "rows": [list(row) for row in rows]})

    def asked(self, what: str, asked: str, found: str, reached: bool) -> None:
        self.figures.append(Figure(what, asked, found, bool(reached)))

    def faster(self, who: str, what: str, ratio: Spread) -> None:
        """Note a loss where the other's time over ours is below one."""
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
    """A table in Markdown."""
    return [f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows)]
