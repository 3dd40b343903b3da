"""Cache of results while one problem is planned.

Relaxations and alternative joints ask for many results again. Every result follows from its key
alone. A cached result adds no work.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

A = TypeVar("A")


class _Cache(threading.local):
    """Results of one thread."""

    answers: dict[Hashable, Any] | None = None
    """None outside of `cache_scope`: nothing is cached."""


_CACHE = _Cache()


@contextmanager
def cache_scope() -> Iterator[None]:
    """Cache results of this thread inside the context, and drop them at its end."""
    outer, _CACHE.answers = _CACHE.answers, {}
    try:
        yield
    finally:
        _CACHE.answers = outer


def cached(key: Hashable, compute: Callable[[], A]) -> A:
    """Return the cached result of a key, or compute and cache it."""
    answers = _CACHE.answers
    if answers is None:
        return compute()
    if key not in answers:
        answers[key] = compute()
    value: A = answers[key]
    return value


class IdentityKey:
    """Part of a key that compares an object by identity, and keeps it alive."""

    def __init__(self, target: object) -> None:
        self.target = target

    def __eq__(self, other: object) -> bool:
        return isinstance(other, IdentityKey) and self.target is other.target

    def __hash__(self) -> int:
        return id(self.target)
