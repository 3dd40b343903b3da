"""toppra without what it imports for plots, splines and solvers that are not used here.

`import toppra` loads matplotlib.pyplot, scipy.interpolate and scipy.sparse, which takes longer than to plan. Its TOPPRA class
with the Seidel solver calls nothing of them. While toppra is imported they are stand-ins whose names load the real module
when they are called or looked into, so that the rest of toppra works as ever.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import Any

UNUSED = ("matplotlib", "matplotlib.pyplot", "scipy.interpolate", "scipy.sparse")


@cache
def load_toppra() -> None:
    """Import toppra, silent but for critical faults; whoever imports from it afterwards finds it loaded."""
    with _standing_in(UNUSED):
        package = importlib.import_module("toppra")
    package.setup_logging("CRITICAL")


@contextmanager
def _standing_in(names: tuple[str, ...]) -> Iterator[None]:
    """Stand-ins for those modules of the names, parents first, that are not loaded yet."""
    absent = [] if "toppra" in sys.modules else [name for name in names if name not in sys.modules]
    for name in absent:
        parent, _, child = name.rpartition(".")
        sys.modules[name] = _Module(name)
        if parent in absent:
            setattr(sys.modules[parent], child, sys.modules[name])
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]


class _Module(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Name(self.__name__, name)


class _Name:
    """A function or class of a module that is not loaded until this is used."""

    def __init__(self, module: str, name: str) -> None:
        self._where = module, name

    def _real(self) -> Any:
        module, name = self._where
        return getattr(importlib.import_module(module), name)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self._real()(*arguments, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real(), name)
