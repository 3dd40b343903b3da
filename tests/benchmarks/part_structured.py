"""Measure CPU times of the structured solver.

It is compared with Ipopt, Opti and rockit on the same programs, within whole plans, and on meshes
of different sizes.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.ocp import refinement
from ssm_planner.planning.ocp.structured import solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked_copy
from tests.benchmarks.cases import (
    FREE_WEAK,
    ROOT,
    Change,
    free_problem,
    straight_problem,
    with_limits,
)
from tests.benchmarks.measuring import Spread
from tests.benchmarks.motions import meshed
from tests.benchmarks.part_same_problem import (
    MOTIONS,
    OPTI_EXPANDED,
    ROCKIT_EXPANDED,
    make,
    problems,
)
from tests.benchmarks.section import Section

ROUNDS = 7
PEERS = (OPTI_EXPANDED, ROCKIT_EXPANDED)
FASTER, GROWTH = 30.0, 1.2
"""Smallest speed-up over a peer, and largest growth of the time per iteration and element."""
MESHES = (25, 100, 400, 1600)
STEPS = 10
"""Number of iterations whose time is measured on every mesh."""


def run(quick: bool) -> Section:
    section = Section("The structured solver against Ipopt")
    section.say(
        "CPU time of the fastest motion's first program (*solve*: same structure, element functions, guess; in turns) and of "
        "the whole plan with its certificate (`planner: ipopt`, and how many times faster `optimal` and `fast` are). "
        "*Difference*: of the duration on the same mesh."
    )
    rows = [_row(name, problem, 1 if quick else ROUNDS) for name, problem in _cases(quick).items()]
    head = (
        "motion",
        "Ipopt",
        "structured",
        "÷",
        "iterations",
        "difference",
        "plan, Ipopt",
        "confirmed",
        "structured",
        "÷",
    )
    section.table(head, rows)
    _against_peers(section, MOTIONS[:1] if quick else MOTIONS, 2 if quick else ROUNDS)
    _by_mesh(section, MESHES[:2] if quick else MESHES)
    return section


class _AskedError(Exception):
    """Exception that carries the arguments of the first call of the structured solver."""


def _asked(problem: Problem) -> tuple[Any, ...]:
    """Return the arguments of the first call of the structured solver for a problem."""

    def ask(*given: Any, **_: Any) -> None:
        raise _AskedError(*given)

    with patch.object(refinement, "solve_structured", ask):
        try:
            plan_motion(unchecked_copy(problem, planner="fast"))
        except _AskedError as asked:
            return asked.args
    raise RuntimeError("the structured solver was not asked")


def _against_peers(section: Section, motions: tuple[str, ...], rounds: int) -> None:
    """Compare one solve of each program from its first guess.

    Rows, mesh and tolerance are the same. The times include setting the parameters.
    """
    section.say(
        "One solve with other numbers than the last, from the first guess; iterations in brackets."
    )
    rows = []
    for motion in motions:
        cases = [_asked(problem) for problem in problems(motion)]
        ways: dict[str, Any] = {
            "structured": lambda k, cases=cases: solve_structured(*cases[k]).iterations
        }
        for name in PEERS:
            try:
                way = make(name, motion)
                way.solve(0)
            except ModuleNotFoundError as error:
                section.cannot.append((f"{name}, {motion}", str(error)))
                continue
            ways[name] = lambda k, way=way: way.solve(k)[1]
        spent: dict[str, list[float]] = {name: [] for name in ways}
        iterations: dict[str, list[float]] = {name: [] for name in ways}
        for k in range(1, rounds + 1):
            for name, solve in ways.items():
                start = time.process_time()
                iterations[name].append(solve(k % len(cases)))
                spent[name].append(time.process_time() - start)
        times = {name: Spread.of(values) for name, values in spent.items()}
        for name, spread in times.items():
            ratio = spread.over(times["structured"])
            counts = Spread.of(iterations[name])
            rows.append([motion, name, f"{spread.seconds()} [{counts.text()}]", ratio.times()])
            if name in PEERS:
                words = f"one structured solve, {motion}: times faster than {name}"
                section.asked(words, f"≥ {FASTER:g}", ratio.text(), ratio.median >= FASTER)
    section.table(("motion", "by", "one solve", "÷ structured"), rows)


def _by_mesh(section: Section, meshes: tuple[int, ...]) -> None:
    """Measure the time per iteration and element on meshes of different sizes."""
    section.say(
        f"CPU time of the first {STEPS} iterations of the straight motion, by iteration and element."
    )
    rows, costs = [], []
    for count in meshes:
        with meshed(count, count):
            given = _asked(straight_problem(Change()))
        spent = {}
        for steps in (0, STEPS):
            spent[steps] = min(
                _times(
                    {
                        "": lambda given=given, steps=steps: solve_structured(
                            *given, iterations=steps
                        )
                    },
                    5,
                )[""].values
            )
        n = given[0].elements
        costs.append((spent[STEPS] - spent[0]) / STEPS / n)
        rows.append([str(n), f"{1e6 * costs[-1]:.2f} µs", f"{costs[-1] / costs[0]:.2f}"])
    section.table(("elements", "an iteration and element", "÷ the smallest mesh's"), rows)
    growth = max(costs) / costs[0]
    section.asked(
        "structured solver, time per iteration and element, by mesh",
        f"≤ {GROWTH:g}",
        f"{growth:.2f}",
        growth <= GROWTH,
    )


def _cases(quick: bool) -> dict[str, Problem]:
    straight, free = straight_problem(Change()), free_problem(Change())
    cases = {"straight": straight, "free, weak motors": free_problem(Change(), FREE_WEAK)}
    if quick:
        return cases
    cases["free, jerk limits"] = unchecked_copy(free, robot=with_limits(free.robot, jerk=35.0))
    for name in ("waypoints", "eye_approach", "laser_scan"):
        cases[name] = dataclasses.replace(
            load_problem(ROOT / f"problems/{name}.yaml"), objective="time"
        )
    return cases


def _row(name: str, problem: Problem, rounds: int) -> list[str]:
    problems = {
        planner: unchecked_copy(problem, planner=planner)
        for planner in ("ipopt", "optimal", "fast")
    }
    calls: list[tuple[Any, dict[str, Any]]] = []

    def ask(*given: Any, **named: Any) -> Any:
        calls.append((given, named))
        return solve_structured(*given, **named)

    with patch.object(refinement, "solve_structured", ask):
        plan_motion(problems["fast"])
    for each in problems.values():
        plan(each)
    plans = _times(
        {planner: lambda each=each: plan(each) for planner, each in problems.items()}, rounds
    )
    ways = [each.seconds() for each in plans.values()]
    ways.append(
        ", ".join(plans["ipopt"].over(plans[planner]).times() for planner in ("optimal", "fast"))
    )
    if not calls:
        return [name, *["–"] * 5, *ways]
    (structure, element, data, start), named = calls[0]
    program = Transcription.build(structure, element)
    solvers = {
        "ipopt": lambda: program.solve(data, start),
        "fast": lambda: solve_structured(structure, element, data, start, **named),
    }
    result = {planner: solver() for planner, solver in solvers.items()}
    solves = _times(solvers, rounds)
    difference = result["fast"].duration / result["ipopt"].duration - 1
    return [
        name,
        solves["ipopt"].seconds(),
        solves["fast"].seconds(),
        solves["ipopt"].over(solves["fast"]).times(),
        f"{result['ipopt'].iterations}, {result['fast'].iterations}",
        f"{difference:.1e}" if result["fast"].solved else "not converged",
        *ways,
    ]


def _times(ways: dict[str, Callable[[], Any]], rounds: int) -> dict[str, Spread]:
    """Return the CPU times in s of every function. The functions run in turns."""
    values: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            start = time.process_time()
            way()
            values[name].append(time.process_time() - start)
    return {name: Spread.of(item) for name, item in values.items()}
