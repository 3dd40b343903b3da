"""Measure the growth of times with the mesh, the number of phases and the instants of the check."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import casadi
import numpy as np

from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.motion import Straight
from ssm_planner.problem.problem import Problem
from ssm_planner.verification.check import check
from tests.benchmarks.cases import FREE_WEAK, Change, free_problem, straight_problem
from tests.benchmarks.measuring import Spread, in_turns, short, timed
from tests.benchmarks.motions import meshed
from tests.benchmarks.section import Section

MESHES = (25, 50, 100, 200, 400)
PHASES = (1, 2, 4, 8, 16)
RATES = (1e3, 1e4, 1e5, 1e6)


def run(quick: bool) -> Section:
    section = Section("Growth")
    meshes, rounds = (MESHES[:3], 1) if quick else (MESHES, 3)
    section.say(
        "**With the mesh.** The same motion by Ipopt alone with other numbers of elements; *per iteration* is the time "
        "within Ipopt, linear algebra and derivatives, over its iterations."
    )
    for name, problem in (
        ("straight, motors × 0.35", straight_problem(Change(), FREE_WEAK)),
        ("free, motors × 0.35", free_problem(Change(), FREE_WEAK)),
    ):
        _meshes(section, name, dataclasses.replace(problem, planner="ipopt"), meshes, rounds)
    _phases(section, PHASES[:3] if quick else PHASES, 1 if quick else 3)
    _instants(section, RATES[:3] if quick else RATES, 1 if quick else 3)
    return section


def _meshes(
    section: Section, name: str, problem: Problem, meshes: tuple[int, ...], rounds: int
) -> None:
    plans: dict[int, list[float]] = {count: [] for count in meshes}
    item: dict[int, list[float]] = {count: [] for count in meshes}
    last: dict[int, tuple[int, float]] = {}
    for k in range(rounds + 1):
        for count in meshes:
            with meshed(count, count), solver_account() as account:
                seconds, planned = timed(lambda: plan_motion(problem))
            if planned.trajectory is None:
                raise RuntimeError(f"{name}, {count} elements: {planned.reason}")
            last[count] = account.iterations, planned.trajectory.duration
            if k:  # the first round builds the programs
                plans[count].append(seconds)
                item[count].append(account.seconds / max(account.iterations, 1))
    per_element = {
        count: Spread.of([seconds / count for seconds in item[count]]) for count in meshes
    }
    rows = []
    for count in meshes:
        iterations, duration = last[count]
        times = (
            Spread.of(plans[count]).seconds(),
            str(iterations),
            Spread.of(item[count]).seconds(),
        )
        relative = per_element[count].over(per_element[meshes[0]]).text()
        rows.append(
            [str(count), *times, per_element[count].seconds(), relative, f"{duration:.5f} s"]
        )
    section.say(f"{name[0].upper()}{name[1:]}:")
    head = (
        "elements asked for",
        "plan",
        "iterations",
        "per iteration",
        "and element",
        f"÷ that of {meshes[0]}",
        "duration",
    )
    section.table(head, rows)
    growth = per_element[meshes[-1]].over(per_element[meshes[0]])
    section.asked(
        f"time per iteration and element, N = {meshes[-1]} over N = {meshes[0]}, {name}",
        "≤ 1 (linear)",
        growth.text(),
        growth.median <= 1,
    )


def _phases(section: Section, counts: tuple[int, ...], rounds: int) -> None:
    section.say(
        "**With the number of phases.** Tilting and inserting to and fro; the second and later plans of a process."
    )
    rows = []
    for count in counts:
        problem = phases(count)
        plan_motion(problem)
        plans = [timed(lambda problem=problem: plan_motion(problem))[0] for _ in range(rounds)]  # type: ignore[misc]
        rows.append(
            [
                str(count),
                Spread.of(plans).seconds(),
                Spread.of([s / count for s in plans]).seconds(),
            ]
        )
    section.table(("phases", "plan", "per phase"), rows)


def _instants(section: Section, rates: tuple[float, ...], rounds: int) -> None:
    section.say(
        "**The check with its instants.** The shipped motion looked at more and more often."
    )
    problem = straight_problem(Change())
    trajectory = plan_motion(problem).trajectory
    assert trajectory is not None
    ways: dict[str, Any] = {
        f"{rate:g}": lambda _, rate=rate: check(trajectory, problem.robot, rate=rate).instants
        for rate in rates
    }
    times, instants = in_turns(ways, rounds)
    rows = [
        [
            f"{float(rate):.0f} Hz",
            f"{instants[rate][0]:,}".replace(",", " "),
            spread.seconds(),
            f"{short(1e6 * spread.median / instants[rate][0])} µs",
        ]
        for rate, spread in times.items()
    ]
    section.table(("rate of the first look", "instants", "check", "per instant"), rows)


def phases(count: int) -> Problem:
    """Return a problem with `count` straight motions."""
    problem = straight_problem(Change())
    targets = (
        {"tilt": np.radians(-120.0)},
        {"depth": 0.01},
        {"tilt": np.radians(-90.0)},
        {"depth": 0.0},
    )
    motions = [Straight(**targets[k % 4], name="straight") for k in range(count)]
    return dataclasses.replace(problem, motion=tuple(motions))


@dataclasses.dataclass
class Account:
    """Total time in s within solvers, and their iterations."""

    seconds: float = 0.0
    iterations: int = 0


@contextmanager
def solver_account() -> Iterator[Account]:
    """Measure every call of a CasADi function whose statistics name iterations."""
    account, last = Account(), [0.0]
    call, stats = casadi.Function.__call__, casadi.Function.stats

    def timed_call(self: Any, *arguments: Any, **named: Any) -> Any:
        start = time.perf_counter()
        try:
            return call(self, *arguments, **named)
        finally:
            last[0] = time.perf_counter() - start

    def counted_stats(self: Any, *arguments: Any) -> Any:
        result = stats(self, *arguments)
        if "iter_count" in result:
            account.seconds += last[0]
            account.iterations += int(result["iter_count"])
            last[0] = 0.0
        return result

    casadi.Function.__call__, casadi.Function.stats = timed_call, counted_stats
    try:
        yield account
    finally:
        casadi.Function.__call__, casadi.Function.stats = call, stats
