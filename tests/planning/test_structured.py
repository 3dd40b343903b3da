"""The structured solver in place of Ipopt: the same optimum on the same mesh, Ipopt where it gives up, and what is said."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from random_problems import random_problem

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.ocp import refinement
from ssm_planner.planning.ocp.nlp import InitialPoint, NlpSolution
from ssm_planner.planning.ocp.structured import solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked
from ssm_planner.reporting.text import verdicts

SAME = 1e-6
"""Share of the duration within which both solvers agree."""
Solve = tuple[Any, Any, Any, InitialPoint, NlpSolution]


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> list[Solve]:
    """What the structured solver was asked, and its answers."""
    found: list[Solve] = []

    def noted(structure: Any, element: Any, data: Any, start: InitialPoint) -> NlpSolution:
        solution = solve_structured(structure, element, data, start)
        found.append((structure, element, data, start, solution))
        return solution

    monkeypatch.setattr(refinement, "solve_structured", noted)
    return found


def fast(problem: Problem) -> Problem:
    return unchecked(problem, planner="fast")


def agree(solves: list[Solve]) -> int:
    """How many of the solves converged; those are Ipopt's optimum of the same program, or shorter."""
    converged = 0
    for structure, element, data, start, own in solves:
        if not own.solved:
            continue
        converged += 1
        ipopt = Transcription.of(structure, element).solve(data, InitialPoint(start.x))
        if ipopt.solved and element.aim == "time":
            assert own.times.sum() <= (1 + SAME) * ipopt.times.sum()
    return converged


@pytest.mark.parametrize(
    ("name", "jerk"),
    [("tilt_insert", None), ("tilt_insert", 35.0), ("waypoints", None), ("waypoints", 35.0), ("laser_scan", None)],
)
def test_shipped_problems(name: str, jerk: float | None, solves: list[Solve], with_jerk: Any) -> None:
    problem = dataclasses.replace(load_problem(f"problems/{name}.yaml"), objective="time")
    if jerk is not None:
        problem = unchecked(problem, robot=with_jerk(problem.robot, jerk, jerk / 10))
    planned = plan_motion(fast(problem))
    assert planned.status == "solved"
    assert {phase.motion.solver for phase in planned.phases} <= {"structured", ""}
    assert agree(solves) == len(solves)


@pytest.mark.parametrize("seed", range(12))
def test_random_problems(seed: int, solves: list[Solve], tilt_insert: Problem) -> None:
    try:
        problem = random_problem(tilt_insert, 100 + seed, most=1)
    except ProblemError:
        pytest.skip("no problem")
    plan_motion(fast(problem))
    agree(solves)


def test_what_it_plans_is_certified_and_says_who_solved_it(tilt_insert: Problem) -> None:
    ours, ipopts = (plan(dataclasses.replace(tilt_insert, planner=planner)) for planner in ("fast", "optimal"))
    assert ours.certificate is not None
    assert ours.certificate.passed
    assert ours.duration == pytest.approx(ipopts.duration, rel=SAME)
    assert [phase.solver for phase in ours.phases] == ["structured"] * len(ours.phases)
    assert any(line.split() == ["solver", "structured"] for line in verdicts(ours))
    assert not any(line.startswith("solver") for line in verdicts(ipopts))


def test_ipopt_solves_where_it_does_not_converge(tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    def gives_up(structure: Any, element: Any, data: Any, start: InitialPoint) -> NlpSolution:
        solution = solve_structured(structure, element, data, start)
        return dataclasses.replace(solution, message="Structured_Solver_Not_Converged")

    monkeypatch.setattr(refinement, "solve_structured", gives_up)
    found = plan(fast(tilt_insert))
    assert found.certificate is not None
    assert found.certificate.passed
    assert {phase.solver for phase in found.phases} == {"Ipopt"}
    assert any(line.split() == ["solver", "Ipopt"] for line in verdicts(found))


def test_same_bits_in_any_order(tilt_insert: Problem) -> None:
    other = load_problem("problems/waypoints.yaml")
    first = plan_motion(fast(tilt_insert)).trajectory
    plan_motion(fast(other))
    again = plan_motion(fast(tilt_insert)).trajectory
    assert first is not None
    assert again is not None
    assert np.asarray(first.coefficients).tobytes() == np.asarray(again.coefficients).tobytes()
