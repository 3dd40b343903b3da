"""Run the tests of a part of the package against its mutants.

The tests are collected once and traced once. A forked child runs them against each mutant.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import itertools
import math
import os
import pickle
import random
import resource
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from tests.mutation.mutations import Mutant, mutants, swap

LONGEST, BUDGET = 6.0, 12.0
"""CPU time in s of one test with its fixtures, and of all tests for one mutant.

Longer tests find very few further mutants.
"""
MEMORY = 8 << 30


@dataclass(frozen=True)
class Room:
    """A part of the package and the tests that must kill its mutants."""

    name: str
    modules: tuple[Path, ...]
    tests: tuple[str, ...]
    root: Path


@dataclass(frozen=True)
class Outcome:
    """The result for one mutant. The killer is the failed test, or None for a survivor."""

    mutant: Mutant
    killer: str | None
    covering: int
    seconds: float


@dataclass
class Trace:
    """Lines of the part that ran, as (file, line), and the CPU time in s that the run took."""

    lines: set[tuple[str, int]] = field(default_factory=set)
    seconds: float = 0.0


def sample(room: Room, count: int, seed: int) -> list[Mutant]:
    """Draw mutants of a part. The same seed and the same sources give the same mutants."""
    files = [(path, path.relative_to(room.root).as_posix()) for path in room.modules]
    population = [mutant for path, file in files for mutant in mutants(path, file)]
    count = min(count, len(population))
    drawn = random.Random(f"{seed} {room.name}").sample(range(len(population)), count)
    return [population[k] for k in sorted(drawn)]


class Gate:
    """A pytest plugin that runs mutants instead of the usual loop over the tests."""

    def __init__(self, room: Room, drawn: list[Mutant], note: Callable[[Outcome], None]) -> None:
        self.room, self.drawn, self.note = room, drawn, note
        self.files = {str(path) for path in room.modules}
        self.stack: list[Trace] = []
        self.fixtures: dict[Any, Trace] = {}
        self.failed: str | None = None

    # These methods record which test runs which lines.

    @contextmanager
    def _traced(self, trace: Trace) -> Iterator[None]:
        self.stack.append(trace)
        start = time.process_time()
        try:
            yield
        finally:
            spent = time.process_time() - start
            self.stack.pop()
            trace.seconds += spent
            if self.stack:  # The time of a nested fixture is not counted twice.
                self.stack[-1].seconds -= spent

    def _global(self, frame: FrameType, event: str, argument: object) -> Any:
        return self._local if frame.f_code.co_filename in self.files and self.stack else None

    def _local(self, frame: FrameType, event: str, argument: object) -> Any:
        if event == "line" and self.stack:
            self.stack[-1].lines.add((frame.f_code.co_filename, frame.f_lineno))
        return self._local

    @pytest.hookimpl(hookwrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        """Record the lines that a fixture runs. Every test that uses the fixture covers them."""
        with self._traced(self.fixtures.setdefault(fixturedef, Trace()) if self.stack else Trace()):
            yield

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Remember the first failure."""
        if report.failed and self.failed is None:
            self.failed = report.nodeid

    def _trace(self, items: list[pytest.Item]) -> dict[str, Trace]:
        """Run every test of a file once and return the traces by the names of the tests.

        Tests that fail or take too long are left out.
        """

        def stop(number: int, frame: object) -> None:
            raise TimeoutError(f"{LONGEST} s of CPU")

        traces: dict[str, Trace] = {}
        signal.signal(signal.SIGPROF, stop)
        sys.settrace(self._global)
        threading.settrace(self._global)
        for item, following in zip(items, [*items[1:], None], strict=True):
            for cached in _caches(self.files):
                cached.cache_clear()
            trace, self.failed = Trace(), None
            signal.setitimer(signal.ITIMER_PROF, LONGEST)
            with self._traced(trace):
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            signal.setitimer(signal.ITIMER_PROF, 0)
            used = [self.fixtures.get(d[-1]) for d in item._fixtureinfo.name2fixturedefs.values()]  # type: ignore[attr-defined]
            for fixture in filter(None, used):
                trace.lines |= fixture.lines
                trace.seconds += fixture.seconds
            if self.failed is None and trace.seconds <= LONGEST:
                traces[item.nodeid] = trace
        sys.settrace(None)
        return traces

    def _cached(self, path: Path, items: list[pytest.Item]) -> dict[str, Trace]:
        """Trace the tests of one file, or read the traces of an earlier run of the same sources."""
        folders = path.relative_to(self.room.root).parents
        fixtures = [self.room.root / folder / "conftest.py" for folder in folders]
        texts = [path, *(f for f in fixtures if f.is_file()), *self.room.modules]
        key = hashlib.sha256(b"\0".join(text.read_bytes() for text in texts)).hexdigest()
        store = (
            self.room.root / "build/mutation" / f"{self.room.name}-{path.stem}-{key[:16]}.pickle"
        )
        if not store.is_file():
            traces, _, _ = _forked(lambda: self._trace(items))
            store.parent.mkdir(parents=True, exist_ok=True)
            store.write_bytes(pickle.dumps(traces))
        return pickle.loads(store.read_bytes()) or {}

    # These methods run one child process for each mutant.

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Trace each file in a child, then run the covering tests of each mutant in another."""
        scratch = session.config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]
        by_name = {item.nodeid: item for item in session.items}
        gc.collect()
        traces: dict[str, Trace] = {}
        for path, group in itertools.groupby(session.items, lambda item: item.path):
            traces |= self._cached(path, list(group))
        for mutant in self.drawn:
            tests = self._covering(mutant, traces)
            run = functools.partial(self._run, mutant, [by_name[n] for n in tests], traces)
            killer, usage, status = _forked(run) if tests else (None, 0.0, 0)
            if os.WIFSIGNALED(status):
                killer = f"signal {os.WTERMSIG(status)}"
            self.note(Outcome(mutant, killer, len(tests), usage))
            for entry in scratch.iterdir():
                shutil.rmtree(entry, ignore_errors=True)
        return True

    def _covering(self, mutant: Mutant, traces: dict[str, Trace]) -> list[str]:
        """Return the names of the tests that run the mutated statement.

        They are ordered roughly by CPU time, and tests of the same file stay together.
        """
        path = str(self.room.root / mutant.file)
        places = {(path, line) for line in mutant.lines}
        names = [name for name, trace in traces.items() if trace.lines & places]
        spent, chosen = 0.0, []
        for name in sorted(names, key=lambda name: _order(name, traces[name].seconds)):
            spent += traces[name].seconds
            if spent > BUDGET:
                break
            chosen.append(name)
        return chosen

    def _run(
        self, mutant: Mutant, items: list[pytest.Item], traces: dict[str, Trace]
    ) -> str | None:
        """Return the name of the first test that fails on a mutant."""
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if not swap(self.room.root / mutant.file, mutant):
            return None
        for item, following in zip(items, [*items[1:], None], strict=True):
            seconds = traces[item.nodeid].seconds
            signal.setitimer(signal.ITIMER_PROF, 5 * seconds + 2)  # for an endless loop
            signal.setitimer(signal.ITIMER_REAL, 50 * seconds + 120)  # for a deadlock
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if self.failed is not None:
                return self.failed
        return None


def _order(name: str, seconds: float) -> tuple[int, str]:
    return math.floor(math.log2(max(seconds, 1e-3))), name


def _caches(files: set[str]) -> list[Any]:
    """Return the caches of functions in the given modules.

    A cache hit would hide the lines that the function runs.
    """
    modules = [m for m in sys.modules.values() if getattr(m, "__file__", None) in files]
    values = [value for module in modules for value in vars(module).values()]
    return [value for value in values if hasattr(value, "cache_clear")]


def _forked(work: Callable[[], Any]) -> tuple[Any, float, int]:
    """Run a function in a child process. Return its result, its CPU time in s and its status."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        status = 1
        try:
            os.close(reading)
            data = pickle.dumps(work())
            with os.fdopen(writing, "wb") as stream:
                stream.write(data)
            status = 0
        finally:
            os._exit(status)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        data = stream.read()
    _, status, usage = os.wait4(child, 0)
    seconds = usage.ru_utime + usage.ru_stime
    if os.WIFEXITED(status) and os.WEXITSTATUS(status):
        raise RuntimeError("a child of the mutation gate failed")
    return pickle.loads(data) if data else None, seconds, status


def measure(room: Room, drawn: list[Mutant], note: Callable[[Outcome], None]) -> None:
    """Collect the tests of a part in this process and run them against the mutants."""
    options = ["-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:terminal"]
    options += ["-o", "addopts=--strict-markers --import-mode=importlib"]
    options += ["-o", "markers=slow: a dear test", "-m", "not slow"]
    options += ["--rootdir", str(room.root)]
    status = pytest.main([*options, *room.tests], plugins=[Gate(room, drawn, note)])
    if status:
        raise SystemExit(f"the tests of {room.name} cannot be collected: status {int(status)}")
