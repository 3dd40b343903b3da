"""Verify the bound on the RMS torque with which the planner refuses a motor early.

No motion has a smaller RMS torque, however slow it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning import phase_planner
from ssm_planner.planning.motor_strength import check_thermal_bound
from ssm_planner.problem.motion import Dwell
from ssm_planner.problem.problem import Problem
from ssm_planner.sizing.size import size_motion


def tilting(nominal: float = 1e-4, **changes: object) -> Problem:
    """Return the tilt of the shipped problem with another nominal torque of joint 1, in N m."""
    problem = load_problem("problems/tilt_insert.yaml")
    first, *others = problem.robot.joints
    joints = (replace(first, motor=replace(first.motor, nominal_torque=nominal)), *others)
    return replace(
        problem, motion=problem.motion[:1], robot=replace(problem.robot, joints=joints), **changes
    )


@pytest.mark.parametrize("pause", [0.0, 5.0])
@pytest.mark.parametrize("duration", [None, 4.0, 30.0, 300.0])
def test_no_motion_has_less_than_the_bound(duration, pause):
    bound = check_thermal_bound(tilting(duty=pause)).required
    strong = tilting(36e-3, duty=pause)
    output = plan(replace(strong, motion=(replace(strong.motion[0], duration=duration),)))
    result = size_motion(output.trajectory, output.problem.robot).verdicts[0].requirement.rms_torque
    result *= np.sqrt(output.duration / (output.duration + pause))
    assert 0.3 * result < bound <= result if pause == 0 else bound <= result


def test_what_is_refused_early_costs_no_planning_and_what_may_stand_or_rest_is_not_refused(
    monkeypatch: pytest.MonkeyPatch,
):
    """The bound refuses a motor before any phase is solved, unless it may rest long enough."""
    solves = []
    monkeypatch.setattr(phase_planner, "retime", lambda *_, **__: solves.append("retime"))
    monkeypatch.setattr(phase_planner, "solve_straight", lambda *_, **__: solves.append("straight"))
    result = plan(tilting(8e-3), relaxations=False)
    monkeypatch.undo()
    assert solves == []
    assert result.status == "infeasible"
    assert result.reason.limit.key == ("continuous torque", "roll")
    assert "however slowly" in result.reason.message
    assert check_thermal_bound(tilting(8e-3, duty=None)) is None  # The motion does not repeat.
    complete = tilting(8e-3)
    rested = replace(complete, motion=(*complete.motion, Dwell(60.0, "rest")))
    assert check_thermal_bound(rested) is None
    insertion = load_problem("problems/tilt_insert.yaml").motion[1]
    assert (
        check_thermal_bound(replace(complete, motion=(*complete.motion, insertion))) is None
    )  # The insertion may be as slow as necessary.
    assert (
        check_thermal_bound(
            replace(complete, motion=(*complete.motion, replace(insertion, duration=0.5)))
        )
        is not None
    )
