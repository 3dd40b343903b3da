"""The structured solver against Ipopt: the same programs from the same guesses, and whole plans with either; CPU time."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

from cases import FREE_WEAK, ROOT, Change, free_problem, straight_problem, with_limits
from measuring import Spread
from section import Section

from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.ocp import refinement
from ssm_planner.planning.ocp.compiled import function_store
from ssm_planner.planning.ocp.nlp import InitialPoint
from ssm_planner.planning.ocp.structured import solve_structured
from ssm_planner.planning.ocp.transcription import Transcription, forget_solutions
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked

ROUNDS = 7


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
    return section


def _cases(quick: bool) -> dict[str, Problem]:
    straight, free = straight_problem(Change()), free_problem(Change())
    cases = {"straight": straight, "free, weak motors": free_problem(Change(), FREE_WEAK)}
    if quick:
        return cases
    cases["free, jerk limits"] = unchecked(free, robot=with_limits(free.robot, jerk=35.0))
    for name in ("waypoints", "eye_approach", "laser_scan"):
        cases[name] = dataclasses.replace(load_problem(ROOT / f"problems/{name}.yaml"), objective="time")
    return cases


def _row(name: str, problem: Problem, rounds: int) -> list[str]:
    problems = {planner: unchecked(problem, planner=planner) for planner in ("ipopt", "optimal", "fast")}
    asked: list[tuple[Any, ...]] = []
    with patch.object(refinement, "solve_structured", lambda *given: asked.append(given) or solve_structured(*given)):
        plan_motion(problems["fast"])
    for each in problems.values():
        plan(each)
    function_store.compile_all()
    plans = _times({planner: lambda each=each: plan(each) for planner, each in problems.items()}, rounds)
    ways = [each.seconds() for each in plans.values()]
    ways.append(", ".join(plans["ipopt"].over(plans[planner]).times() for planner in ("optimal", "fast")))
    if not asked:
        return [name, *["–"] * 5, *ways]
    structure, element, data, start = asked[0]
    program, guess = Transcription.of(structure, element), InitialPoint(start.x)
    solvers = {
        "ipopt": lambda: program.solve(data, guess),
        "fast": lambda: solve_structured(structure, element, data, guess),
    }
    found = {planner: solver() for planner, solver in solvers.items()}
    solves = _times(solvers, rounds)
    difference = found["fast"].times.sum() / found["ipopt"].times.sum() - 1
    return [
        name,
        solves["ipopt"].seconds(),
        solves["fast"].seconds(),
        solves["ipopt"].over(solves["fast"]).times(),
        f"{found['ipopt'].iterations}, {found['fast'].iterations}",
        f"{difference:.1e}" if found["fast"].solved else "not converged",
        *ways,
    ]


def _times(ways: dict[str, Callable[[], Any]], rounds: int) -> dict[str, Spread]:
    """CPU seconds of every way, in turns, nothing kept from the turn before."""
    values: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            forget_solutions()
            begin = time.process_time()
            way()
            values[name].append(time.process_time() - begin)
    return {name: Spread.of(each) for name, each in values.items()}
