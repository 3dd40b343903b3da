"""Verify motions over very small distances, which are planned like any other motion.

A motion over no distance is skipped, and a problem without any other motion is refused.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.lower_bound import rest_to_rest
from ssm_planner.plans import Plan
from ssm_planner.problem.motion import Free, Straight, Task
from ssm_planner.problem.problem import Problem

START = {"roll": -0.2, "tilt": -1.7, "spin": 0.0, "depth": 0.004}


def inserting(problem: Problem, kind: Any, depth: float) -> Problem:
    """Return a problem with one insertion by `depth`, in m."""
    goal = Task(depth=START["depth"] + depth)
    motion = (Free(goal) if kind == "free" else Straight(**goal.set_coordinates),)
    return dataclasses.replace(problem, start=Task(**START), motion=motion, objective="time")


@pytest.mark.parametrize("kind", ["straight", "free"])
@pytest.mark.parametrize("depth", [2e-9, 1e-6, 1e-3])
def test_a_tiny_move_takes_the_time_of_the_closed_form(
    tilt_insert: Problem, kind: str, depth: float
) -> None:
    joint = tilt_insert.robot.joints[3]
    result = plan(inserting(tilt_insert, kind, depth))
    assert result.passed
    assert result.duration == pytest.approx(
        rest_to_rest(depth, joint.velocity, joint.acceleration).duration, rel=1e-3
    )


@pytest.mark.parametrize("kind", ["straight", "free"])
@pytest.mark.parametrize("first", [True, False])
def test_a_move_to_where_the_robot_is_takes_no_time_and_is_said(
    tilt_insert: Problem, kind: str, first: bool
) -> None:
    """A motion to the present position takes no time, and a note states that it is skipped."""
    alone, still = inserting(tilt_insert, kind, 1e-3), inserting(tilt_insert, kind, 0.0)
    again = dataclasses.replace(inserting(tilt_insert, kind, 1e-3).motion[0], name="again")
    motion = (
        (dataclasses.replace(still.motion[0], name="again"), *alone.motion)
        if first
        else (*alone.motion, again)
    )
    result, expected = plan(dataclasses.replace(alone, motion=motion)), plan(alone)
    assert result.passed
    assert result.duration == expected.duration
    assert result.lower_bound == expected.lower_bound
    assert [phase.duration == 0 for phase in result.phases] == [first, not first]
    assert any(note.startswith("skipped") and "again" in note for note in result.notes)
    assert Plan.from_json(result.to_json().encode(), Path("plan.json")).notes == result.notes


def test_a_move_to_where_the_robot_is_lasts_as_long_as_asked_for(tilt_insert: Problem) -> None:
    still = dataclasses.replace(inserting(tilt_insert, "straight", 0.0).motion[0], duration=0.5)
    alone = inserting(tilt_insert, "straight", 1e-3)
    result = plan(
        dataclasses.replace(
            alone, motion=(*alone.motion, dataclasses.replace(still, depth=START["depth"] + 1e-3))
        )
    )
    assert result.passed
    assert result.phases[1].duration == 0.5
    assert np.all(result.motion.sample(result.duration - 0.25).qd == 0)


@pytest.mark.parametrize("kind", ["straight", "free"])
@pytest.mark.parametrize("depth", [0.0, 1e-10])
def test_nothing_is_refused(tilt_insert: Problem, kind: str, depth: float) -> None:
    """A problem whose only motion has length zero is refused."""
    with pytest.raises(ProblemError, match="has length zero"):
        plan(inserting(tilt_insert, kind, depth))
