"""Verify that each random problem ends in a passed certificate or a named reason.

The program tests/benchmarks/fuzz_plans.py plans more problems and examines unsolved ones again.
EVERY_CASE=1 plans four times as many problems.
"""

from __future__ import annotations

import pytest

from ssm_planner.pipeline.run import plan
from ssm_planner.problem.problem import Problem
from tests.support.cases import drawn
from tests.support.random_problems import faults, random_problem

MISSIONS = [*drawn(1, range(2000, 2004)), 30022, 30083, 30436, 30582]


@pytest.mark.parametrize("seed", drawn(9, range(1000, 1036)))
def test_a_certificate_or_a_named_reason(tilt_insert: Problem, seed: int) -> None:
    problem = random_problem(tilt_insert, seed, most=1)
    assert faults(problem, plan(problem)) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", MISSIONS)
def test_random_problems_with_several_motions_are_planned_without_faults(
    tilt_insert: Problem, seed: int
) -> None:
    problem = random_problem(tilt_insert, seed)
    assert faults(problem, plan(problem)) == []
