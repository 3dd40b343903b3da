"""Answers kept while one problem is planned: trials of relaxations, and of other joints, ask for most of them again.

Every answer follows from its key alone, and what it took is counted each time, so keeping it changes no plan.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

MOST = 512
"""Answers at a time; the oldest go first."""
A = TypeVar("A")


class _Kept(threading.local):
    answers: dict[Hashable, Any] | None = None
    """None: nothing is kept."""


_KEPT = _Kept()


@contextmanager
def keeping() -> Iterator[None]:
    """Keep what this thread asks for meanwhile, and forget it afterwards."""
    outer, _KEPT.answers = _KEPT.answers, {}
    try:
        yield
    finally:
        _KEPT.answers = outer


def kept(key: Hashable, answer: Callable[[], A]) -> A:
    """The answer for a key, worked out unless it is kept."""
    answers = _KEPT.answers
    if answers is None:
        return answer()
    if key not in answers:
        found = answer()
        if len(answers) >= MOST:
            del answers[next(iter(answers))]
        answers[key] = found
    known: A = answers[key]
    return known


class SameObject:
    """Part of a key: an object, the same as itself alone. It lives as long as the key."""

    def __init__(self, of: object) -> None:
        self.of = of

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SameObject) and self.of is other.of

    def __hash__(self) -> int:
        return id(self.of)
