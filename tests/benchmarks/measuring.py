"""Times of several programs for the same task, and their text.

The programs run in turns, so that all of them see the same state of the machine.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Spread:
    """Repeated measurements of the same quantity."""

    values: tuple[float, ...]

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        return cls(tuple(float(value) for value in values))

    @property
    def median(self) -> float:
        return statistics.median(self.values)

    def over(self, other: Spread) -> Spread:
        """Return the ratio to another series, round by round."""
        return Spread(tuple(a / b for a, b in zip(self.values, other.values, strict=True)))

    def seconds(self) -> str:
        """Return median and range in a suitable unit of time."""
        for unit, scale in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)):
            if self.median * scale >= 1 or unit == "µs":
                break
        return self.text(unit, scale)

    def times(self) -> str:
        return f"{self.text('×')}"

    def text(self, unit: str = "", scale: float = 1.0) -> str:
        """Return the median and, for more than one value, the range."""
        gap = " " if unit else ""
        middle = f"{short(self.median * scale)}{gap}{unit}"
        if len(self.values) == 1:
            return middle
        return f"{middle} ({short(min(self.values) * scale)}–{short(max(self.values) * scale)})"


def short(value: float) -> str:
    """Return the number with three significant digits, if possible without an exponent."""
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        digits = 3 if abs(value) < 100 else len(f"{abs(value):.0f}")
        text = f"{value:.{digits}g}"
        return text if "e" not in text else f"{value:.0f}"
    return f"{value:.2g}"


def timed(function: Callable[[], T]) -> tuple[float, T]:
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result


def in_turns(
    ways: Mapping[str, Callable[[int], T]], rounds: int, first: int = 0
) -> tuple[dict[str, Spread], dict[str, list[T]]]:
    """Run every function once per round with the round's number; return times and results."""
    times: dict[str, list[float]] = {name: [] for name in ways}
    results: dict[str, list[T]] = {name: [] for name in ways}
    for i in range(first, first + rounds):
        for name, way in ways.items():
            seconds, result = timed(lambda way=way, i=i: way(i))  # type: ignore[misc]
            times[name].append(seconds)
            results[name].append(result)
    return {name: Spread.of(values) for name, values in times.items()}, results
