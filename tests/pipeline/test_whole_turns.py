"""Verify the notes of a plan about a start that differs by a whole turn and about wide ranges."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ssm_planner.pipeline.run import plan
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TaskRange
from ssm_planner.problem.motion import Straight, Task
from ssm_planner.problem.problem import Problem


def test_a_start_a_whole_turn_away_is_said(tilt_insert: Problem) -> None:
    start = Task(roll=0.0, tilt=np.radians(-113), spin=np.radians(15), depth=0.0)
    far = replace(
        tilt_insert,
        start=start,
        limits=(),
        motion=(Straight(spin=np.radians(365), name="spin"),),
        objective="time",
    )
    result = plan(far)
    assert result.passed
    assert any(
        "joint spin starts at -345 deg, a whole turn from 15 deg" in note for note in result.notes
    )
    near = plan(replace(far, motion=(Straight(spin=np.radians(30), name="spin"),)))
    assert not any("whole turn" in note for note in near.notes)


def test_a_range_wider_than_the_robots_is_said(tilt_insert: Problem) -> None:
    wide = replace(
        tilt_insert,
        limits=(TaskRange("tilt", np.radians(-170), np.radians(-81)),),
        motion=(Straight(depth=2e-3),),
    )
    result = plan(wide)
    said = "range of tilt of -170 deg to -81 deg asked for: the robot allows -139 deg to -81 deg, which holds"
    assert result.passed
    assert said in result.notes
    assert said in Plan.from_json(result.to_json().encode(), Path("plan.json")).notes
    assert not any(
        "range of tilt" in note for note in plan(replace(tilt_insert, motion=wide.motion)).notes
    )
