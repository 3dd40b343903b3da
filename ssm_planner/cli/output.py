"""What commands share: quantities as arguments, progress on stderr, JSON on stdout."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

OK, FAILED = 0, 1


def quantity_argument(kind: str) -> Callable[[str], float]:
    """An argparse type for a quantity with unit, such as `-140deg`; kind as in problem/kinds.py."""

    def convert(text: str) -> float:
        from ssm_planner.units import BadQuantity, quantity

        try:
            return quantity(text.strip(), kind)
        except BadQuantity as error:
            raise argparse.ArgumentTypeError(f"{text.strip()!r}: {error}") from error

    return convert


def progress_reporter() -> Callable[[str], None]:
    """Reports each step on stderr with the time since the start."""
    begin = time.perf_counter()

    def report(step: str) -> None:
        print(f"[{time.perf_counter() - begin:6.2f} s] {step}", file=sys.stderr, flush=True)

    return report


def show(as_json: bool, document: Any, lines: Callable[[], Iterable[str]]) -> None:
    """The result on stdout: one JSON document, or lines of text."""
    print(json.dumps(document, indent=1, allow_nan=False) if as_json else "\n".join(lines()))
