"""Motions over next to nothing are planned like any other, and nothing at all is refused."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.lower_bound import rest_to_rest
from ssm_planner.problem.motion import Free, Straight, Task
from ssm_planner.problem.problem import Problem

START = {"roll": -0.2, "tilt": -1.7, "spin": 0.0, "depth": 0.004}


def inserting(problem: Problem, kind: Any, depth: float) -> Problem:
    goal = Task(depth=START["depth"] + depth)
    motion = (Free(goal) if kind == "free" else Straight(**goal.given),)
    return dataclasses.replace(problem, start=Task(**START), motion=motion, objective="time")


@pytest.mark.parametrize("kind", ["straight", "free"])
@pytest.mark.parametrize("depth", [2e-9, 1e-6, 1e-3])
def test_as_long_as_the_closed_form_says(tilt_insert: Problem, kind: str, depth: float) -> None:
    joint = tilt_insert.robot.joints[3]
    result = plan(inserting(tilt_insert, kind, depth))
    assert result.passed
    assert result.duration == pytest.approx(rest_to_rest(depth, joint.velocity, joint.acceleration).duration, rel=1e-3)


@pytest.mark.parametrize("kind", ["straight", "free"])
@pytest.mark.parametrize("depth", [0.0, 1e-10])
def test_nothing_is_refused(tilt_insert: Problem, kind: str, depth: float) -> None:
    with pytest.raises(ProblemError, match="goes nowhere"):
        plan(inserting(tilt_insert, kind, depth))
