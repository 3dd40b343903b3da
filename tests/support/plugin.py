"""Pytest plugin with rules for every test: CPU budget, listed skips, Ctrl-C and random order.

Options that this module adds:

    --cpu-budget SECONDS  fail a phase of a test without the mark `slow` that needs more CPU time
    --cpu-report FILE     write the CPU time of every test and of the collection as JSON
    --cases COUNT         run at most COUNT cases of each parametrised test, which DRAW selects
    --listed-skips        fail a skip whose reason is not in tests/support/skips.py
    --shuffle SEED        run the files, and the tests of each file, in random order
"""

from __future__ import annotations

import gc
import json
import os
import random
import resource
import signal
import time
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from ssm_planner.cli import GARBAGE_THRESHOLD
from tests.support.cases import drawn
from tests.support.skips import is_listed

SHOWN = 10
REFERENCE = 0.10
"""CPU time in s of `yardstick` on the idle core for which the budget is meant."""
PATIENCE = 2.0
"""Factor by which a test may exceed the scaled budget.

The factor allows for caches, because the test that fills a cache takes longer.
"""
CPU = "cpu"
PHASE = pytest.StashKey[tuple[float, float, float]]()


def clocks() -> tuple[float, float, float]:
    """Return the CPU times of this process and of its ended children, and the clock time, in s."""
    own, children = (
        sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own, children, time.monotonic()


def cpu() -> float:
    """Return the CPU time in s of this process and of its children that have ended."""
    return sum(clocks()[:2])


def cpu_since(begin: tuple[float, float, float]) -> float:
    """Return the CPU time in s of a phase that began at the given clocks.

    A child that an earlier test left counts when it ends. The children of this phase cannot have
    used more than all cores for its duration.
    """
    own, children, elapsed = (now - then for now, then in zip(clocks(), begin, strict=True))
    return own + min(children, elapsed * (os.cpu_count() or 1))


def yardstick() -> float:
    """Return the CPU time in s that this machine takes for a fixed loop at this moment."""
    start, total = cpu(), 0
    for k in range(1_000_000):
        total += k * k % 7
    return cpu() - start


class Budget:
    """CPU budget of the tests.

    A slower or busy machine takes more CPU time for the same test. When a test exceeds the budget,
    the yardstick is measured at once and scales the budget. A test fails only if it exceeds the
    scaled budget by the factor PATIENCE.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def excess(self, spent: float) -> str:
        """Return why the CPU time spent in s is too much, or an empty string."""
        if spent <= self.seconds:
            return ""
        allowed = self.seconds * PATIENCE * max(1.0, yardstick() / REFERENCE)
        return "" if spent <= allowed else f"needs {spent:.1f} s of CPU; at most {allowed:.1f} s"


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("project rules")
    group.addoption("--cpu-budget", type=float, metavar="SECONDS")
    group.addoption("--cpu-report", metavar="FILE")
    group.addoption("--cases", type=int, metavar="COUNT")
    group.addoption("--listed-skips", action="store_true")
    group.addoption("--shuffle", type=int, metavar="SEED")


def pytest_configure(config: pytest.Config) -> None:
    # nohup and background shells ignore SIGINT, and children inherit this. A test that interrupts a
    # child needs the ordinary handler.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # As for the commands: the objects of modules and of thousands of tests are never garbage. To
    # search them so often for unreachable cycles took a tenth of the CPU time of all tests.
    gc.set_threshold(GARBAGE_THRESHOLD)
    config.pluginmanager.register(Rules(config), "project rules")


class Rules:
    """Hooks that apply the rules in one pytest session."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        seconds = config.getoption("--cpu-budget")
        self.budget = None if seconds is None else Budget(seconds)
        self.spent: dict[str, float] = defaultdict(float)
        self.collection: list[float] = []

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        count = self.config.getoption("--cases")
        if count is not None:
            self.keep_some_cases(items, count)
        seed = self.config.getoption("--shuffle")
        if seed is None:
            return
        draw = random.Random(seed)
        files: dict[Path, list[pytest.Item]] = defaultdict(list)
        for item in items:
            files[item.path].append(item)
        groups = list(files.values())
        draw.shuffle(groups)
        for group in groups:
            draw.shuffle(group)
        items[:] = [item for group in groups for item in group]

    def keep_some_cases(self, items: list[pytest.Item], count: int) -> None:
        """Keep at most `count` cases of every test. They depend on DRAW and on the test's name."""
        cases: dict[str, list[pytest.Item]] = defaultdict(list)
        for item in items:
            cases[item.nodeid.partition("[")[0]].append(item)
        kept = {
            item
            for name, group in cases.items()
            for item in drawn(min(count, len(group)), group, name)
        }
        self.config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = [item for item in items if item in kept]

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Generator[None, Any, Any]:
        item.stash[PHASE] = clocks()
        return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, Any, Any]:
        item.stash[PHASE] = clocks()
        return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> Generator[None, Any, Any]:
        item.stash[PHASE] = clocks()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        spent = cpu_since(item.stash[PHASE])
        # Pytest gives the same list to every report of an item. Each report gets a copy.
        report.user_properties = [*report.user_properties, (CPU, spent)]
        problem = ""
        if report.skipped and not hasattr(report, "wasxfail"):
            problem = self.unlisted(report.longrepr)
        elif report.passed and self.budget is not None and not item.get_closest_marker("slow"):
            problem = self.budget.excess(spent)
        if problem:
            report.outcome, report.longrepr = "failed", problem
        return report

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self) -> Generator[None, pytest.CollectReport, Any]:
        report = yield
        if report.skipped and (problem := self.unlisted(report.longrepr)):
            report.outcome, report.longrepr = "failed", problem
        return report

    def unlisted(self, skipped: Any) -> str:
        """Return what is wrong with a skip (file, line, reason), or an empty string."""
        reason = skipped[2] if isinstance(skipped, tuple) else str(skipped)
        if not self.config.getoption("--listed-skips") or is_listed(reason):
            return ""
        return f"{reason!r} is not in tests/support/skips.py"

    def pytest_collection_finish(self) -> None:
        self.collection.append(cpu())
        if hasattr(self.config, "workeroutput"):
            self.config.workeroutput["collection"] = cpu()

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        self.collection.append(getattr(node, "workeroutput", {}).get("collection", 0.0))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.spent[report.nodeid] += sum(
            value for name, value in report.user_properties if name == CPU
        )

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if not self.spent:
            return
        dearest = sorted(self.spent.items(), key=lambda pair: -pair[1])
        terminalreporter.write_line(
            f"CPU: {sum(self.spent.values()):.0f} s in {len(self.spent)} tests, "
            f"at most {max(self.collection, default=0.0):.0f} s for a collection; "
            f"the dearest test, {dearest[0][0]}, took {dearest[0][1]:.1f} s"
        )
        if path := self.config.getoption("--cpu-report"):
            document = {"collection": self.collection, "tests": dict(dearest)}
            Path(path).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
