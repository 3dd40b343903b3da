"""A start that leaves its whole turns open, and is found where nobody would look for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.pipeline.run import plan
from ssm_planner.problem.motion import Straight, Task
from ssm_planner.problem.problem import Problem


def test_a_start_a_whole_turn_away_is_said(tilt_insert: Problem) -> None:
    start = Task(roll=0.0, tilt=np.radians(-113), spin=np.radians(15), depth=0.0)
    far = replace(
        tilt_insert, start=start, limits=(), motion=(Straight(spin=np.radians(365), name="spin"),), objective="time"
    )
    made = plan(far)
    assert made.passed
    assert any("joint spin starts at -345 deg, a whole turn from 15 deg" in note for note in made.notes)
    near = plan(replace(far, motion=(Straight(spin=np.radians(30), name="spin"),)))
    assert not any("whole turn" in note for note in near.notes)
