"""Element functions in C, where there is a compiler: the same numbers about ten times faster than interpreted.

For an element model that has taken long, in the background: see codegen/library.py.
"""

from __future__ import annotations

import os
import subprocess
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca

from ssm_planner.codegen import library
from ssm_planner.codegen.library import Source, cache, filled_cache
from ssm_planner.planning.ocp.element import ElementFunctions, ElementModel, element_functions

KEPT = 24
"""Models in memory: those used last."""


def source_of(element: ElementFunctions, folder: Path) -> Source:
    """Element functions as C."""
    generator = ca.CodeGenerator("element.c")
    for function in element.by_name().values():
        generator.add(function)
    return Source.of(generator.dump(), folder, ca.CasadiMeta.version())


def load(element: ElementFunctions, path: Path) -> ElementFunctions:
    """The same functions from a library. Raises OSError or RuntimeError where it cannot be used."""
    os.utime(path)  # of the libraries, the last used are kept
    names = element.by_name().items()
    return replace(element, **{name: ca.external(function.name(), str(path)) for name, function in names})


class FunctionStore:
    """The functions of the element models in use, compiled where that is done already."""

    def __init__(self) -> None:
        self._entries: dict[ElementModel, _Entry] = {}
        """Last used last."""
        self._running: subprocess.Popen[bytes] | None = None

    def functions(self, element: ElementModel) -> ElementFunctions:
        """The functions of an element model; a new value once they are compiled."""
        entry = self._entries.pop(element, None)
        if entry is None:
            entry = _Entry(element_functions(element))
            entry.load_from(filled_cache())
        self._entries[element] = entry
        while len(self._entries) > KEPT:
            del self._entries[next(iter(self._entries))]
        if not entry.compiled and entry.seconds > library.LONG:
            self._compile(entry)
        return entry.functions

    def note_time(self, element: ElementModel, seconds: float) -> None:
        """Note how long the functions of a model have been evaluated."""
        if element in self._entries:
            self._entries[element].seconds += seconds

    def compile_all(self) -> None:
        """Compile the functions of all models in use, one after the other, and load them; nothing without a compiler."""
        for entry in self._entries.values():
            for _ in range(2):
                self.wait()
                self._compile(entry)

    def wait(self) -> None:
        """Wait for the library that is being made."""
        if self._running is not None:
            self._running.wait()

    def _compile(self, entry: _Entry) -> None:
        """Load the library, or begin to make it where no other is being made; once, for a compiler may fail."""
        entry.load_from(cache())
        idle = self._running is None or self._running.poll() is not None
        if entry.source is not None and not entry.compiled and not entry.tried and idle:
            entry.tried = True
            with suppress(OSError):  # a full disk, a folder that became read-only: it stays interpreted
                self._running = entry.source.compile()


@dataclass
class _Entry:
    functions: ElementFunctions
    seconds: float = 0.0
    tried: bool = False
    compiled: bool = False
    source: Source | None = None

    def load_from(self, folder: Path | None) -> None:
        """Take the functions from the folder's library, where it is there."""
        if folder is None or self.compiled:
            return
        self.source = self.source or source_of(self.functions, folder)
        found = self.source.library()
        if found is not None:
            with suppress(OSError, RuntimeError):  # taken away meanwhile: it stays interpreted
                self.functions, self.compiled = load(self.functions, found), True


function_store = FunctionStore()
