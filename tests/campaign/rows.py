"""Counters of the campaigns, and a runner of commands in this process with a watchdog."""

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
"""CPU time in s above which a case hangs."""
PATIENCE = 6
"""Clock time at which a case hangs, as a multiple of the CPU time.

The factor allows for cases that wait, and for a busy machine.
"""
EXAMPLES = 5
ROBOT = ROOT / "problems/robots/vitreoretinal.yaml"


class Row(NamedTuple):
    """One line in the table of results."""

    kind: str
    cases: int
    failures: int
    examples: tuple[str, ...]


class Hang(BaseException):
    """Exception for a case that takes longer than LONGEST."""


class Count:
    """Counter of the cases of one kind."""

    def __init__(self, kind: str) -> None:
        self.kind, self.cases, self.failures = kind, 0, 0
        self.examples: list[str] = []

    def add(self, fault: str | None) -> None:
        """Add one case. `fault` is the reason why it failed, or None."""
        self.cases += 1
        if fault is not None:
            self.failures += 1
            if len(self.examples) < EXAMPLES:
                self.examples.append(fault)

    @property
    def row(self) -> Row:
        """Return the line of the table so far."""
        return Row(self.kind, self.cases, self.failures, tuple(self.examples))


@contextlib.contextmanager
def watchdog(seconds: int = LONGEST) -> Iterator[None]:
    """Raise Hang in the block after some seconds of CPU time.

    Hang is also raised after PATIENCE times as many seconds of clock time.
    """

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
    """Return a reader of robots that reads the shipped robot only once."""
    shipped = functools.cache(lambda: read(ROBOT))

    @functools.wraps(read)
    def robot(name: str | Path) -> Any:
        return shipped() if Path(name) == ROBOT else read(name)

    return robot


def command(*words: str, seconds: int = LONGEST) -> tuple[int | None, str, str, str | None]:
    """Run a command in this process and return exit status, stdout, stderr and fault.

    The fault is a hang or the last traceback, or None.
    """
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
    """Run one task of a campaign, and return its rows and its duration in s."""
    start = time.monotonic()
    return importlib.import_module(f"{__package__}.{name}").run(
        count, seed
    ), time.monotonic() - start
