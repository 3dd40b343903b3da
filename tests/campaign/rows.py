"""What a campaign counts, and how commands are run in this process: captured, with a watchdog."""

from __future__ import annotations

import contextlib
import functools
import importlib
import io
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple
from unittest.mock import patch

from tests.support.paths import ROOT

LONGEST = 10
"""s of the processor: what takes longer hangs."""
PATIENCE = 6
"""Times as much on the clock, for what only waits; the machine may be busy otherwise."""
EXAMPLES = 5
ROBOT = ROOT / "problems/robots/vitreoretinal.yaml"


class Row(NamedTuple):
    """One line of the table of results."""

    kind: str
    cases: int
    failures: int
    examples: tuple[str, ...]


class Hang(BaseException):
    """Something took longer than LONGEST."""


class Count:
    """Counts the cases of one kind."""

    def __init__(self, kind: str) -> None:
        self.kind, self.cases, self.failures = kind, 0, 0
        self.examples: list[str] = []

    def add(self, fault: str | None) -> None:
        """One more case; fault: why it failed."""
        self.cases += 1
        if fault is not None:
            self.failures += 1
            if len(self.examples) < EXAMPLES:
                self.examples.append(fault)

    @property
    def row(self) -> Row:
        """The line so far."""
        return Row(self.kind, self.cases, self.failures, tuple(self.examples))


@contextlib.contextmanager
def watchdog(seconds: int = LONGEST) -> Iterator[None]:
    """Raises Hang in the block after some seconds of the processor, or PATIENCE times as many on the clock."""

    def bark(number: int, frame: FrameType | None) -> None:
        raise Hang

    timers = {
        signal.SIGPROF: (signal.ITIMER_PROF, 1),
        signal.SIGALRM: (signal.ITIMER_REAL, PATIENCE),
    }
    before = {number: signal.signal(number, bark) for number in timers}
    for timer, times in timers.values():
        signal.setitimer(timer, times * seconds)
    try:
        yield
    finally:
        for number, (timer, _) in timers.items():
            signal.setitimer(timer, 0)
            signal.signal(number, before[number])


@functools.cache
def _read_once(read: Callable[[str | Path], Any]) -> Callable[[str | Path], Any]:
    """A reader of robots that reads the shipped one once for all of the commands."""
    shipped = functools.cache(lambda: read(ROBOT))

    @functools.wraps(read)
    def robot(name: str | Path) -> Any:
        return shipped() if Path(name) == ROBOT else read(name)

    return robot


def command(*words: str, seconds: int = LONGEST) -> tuple[int | None, str, str, str | None]:
    """(exit status, stdout, stderr, fault) of a command run in this process; fault: a hang, or its last traceback."""
    from ssm_planner.cli import main
    from ssm_planner.loading import load

    once = patch.object(load, "load_robot", _read_once(load.load_robot))
    out, err = io.StringIO(), io.StringIO()
    fault, status = None, None
    with once, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            with watchdog(seconds):
                status = main(list(words))
        except SystemExit as stop:
            status = int(stop.code or 0)
        except Hang:
            fault = f"hangs over {seconds} s"
        except BaseException as error:  # noqa: BLE001 - any is a finding
            last = traceback.extract_tb(error.__traceback__)[-1]
            fault = f"{type(error).__name__}: {str(error)[:100]} ({Path(last.filename).name}:{last.lineno})"
    return status, out.getvalue(), err.getvalue(), fault


def one(name: str, count: int, seed: int) -> tuple[list[Row], float]:
    """A slice, and the seconds that it took."""
    begin = time.monotonic()
    return importlib.import_module(f"{__package__}.{name}").run(
        count, seed
    ), time.monotonic() - begin
