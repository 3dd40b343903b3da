"""Verify motions that begin or end at speed, against closed forms and the Jacobian of the task."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.planner import plan_motion
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TASK_COORDINATES, TaskRange
from ssm_planner.problem.motion import Dwell, Free, Joints, Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array
from ssm_planner.verification.check import check

WithJerk = Callable[[Robot, float, float], Robot]

WAY = {"roll": 0.2, "tilt": -0.5, "depth": 0.008}
START = {"roll": 0.0, "tilt": -1.6, "spin": 0.0, "depth": 0.004}
JOINTS = (0.3, -0.2, 0.5, -0.015)


def straight(problem: Problem, **changes: Any) -> Problem:
    """Return a problem with one straight motion over WAY."""
    motion = (Straight(**{name: START[name] + way for name, way in WAY.items()}),)
    return dataclasses.replace(
        problem, start=Task(**START), motion=motion, **{"objective": "time", **changes}
    )


def free(problem: Problem, **changes: Any) -> Problem:
    """Return a problem with one free motion of all joints."""
    motion, start = (Free(Joints(JOINTS)),), Joints((-0.5, 0.6, 0.0, 0.0))
    limits = (TaskRange("depth", 0.0, 0.03),)
    return dataclasses.replace(
        problem, start=start, motion=motion, limits=limits, **{"objective": "time", **changes}
    )


def along(share: float) -> dict[str, float]:
    """Return rates of `share` times WAY per second."""
    return {name: share * way for name, way in WAY.items()}


def end_rates(result: Plan) -> tuple[Array, Array]:
    """Return the rates of the task coordinates at both ends, (4,) each, by the Jacobian."""
    assert result.passed
    mechanism = Mechanism.from_geometry(result.problem.robot.geometry)
    trajectory = result.trajectory
    ends = (
        trajectory.sample(trajectory.breaks[:1]),
        trajectory.sample(trajectory.breaks[-1:], side="left"),
    )
    first, last = (task_rates(mechanism, s.q, s.qd)[0] for s in ends)
    return first, last


def as_array(rates: dict[str, float]) -> Array:
    """Return the rates as an array in the order of the task coordinates, (4,)."""
    return np.array([rates.get(name, 0.0) for name in TASK_COORDINATES])


@pytest.mark.parametrize("jerk", [False, True])
def test_a_straight_motion_meets_its_rates_and_is_faster(
    tilt_insert: Problem, with_jerk: WithJerk, jerk: bool
) -> None:
    if jerk:
        tilt_insert = dataclasses.replace(
            tilt_insert, robot=with_jerk(tilt_insert.robot, 35.0, 1.0)
        )
    durations = [plan(straight(tilt_insert)).duration]
    for start, end in ((0.3, 0.0), (0.3, 0.2)):
        result = plan(straight(tilt_insert, start_rate=along(start), end_rate=along(end)))
        first, last = end_rates(result)
        assert first == pytest.approx(as_array(along(start)), abs=1e-9)
        assert last == pytest.approx(as_array(along(end)), abs=1e-9)
        durations.append(result.duration)
    assert durations[0] > durations[1] + 0.02 > durations[2] + 0.03


@pytest.mark.parametrize("objective", ["time", "time then heat"])
def test_a_free_motion_meets_them_too(tilt_insert: Problem, objective: str) -> None:
    rate = {"depth": 0.008}
    result = plan(free(tilt_insert, start_rate=rate, end_rate=rate, objective=objective))
    first, last = end_rates(result)
    assert first == pytest.approx(as_array(rate), abs=1e-9)
    assert last == pytest.approx(as_array(rate), abs=1e-9)
    assert result.duration <= 1.001 * plan(free(tilt_insert)).duration


@pytest.mark.parametrize("end", ["start_rate", "end_rate"])
def test_the_first_motion_at_speed_keeps_the_jerk_limits(
    tilt_insert: Problem, with_jerk: WithJerk, end: str
) -> None:
    """The acceleration is 0 at an end at speed, and its rise beside this end is limited too."""
    robot = with_jerk(tilt_insert.robot, 35.0, 1.0)
    rates = {"roll": 0.2, "tilt": -0.2, "depth": 0.004}
    problem = free(tilt_insert, robot=robot, planner="fast", **{end: rates})
    motion = plan_motion(dataclasses.replace(problem, start=Joints((-0.5, 0.6, 0.0, -0.005))))
    assert motion.trajectory is not None
    assert motion.phases[0].motion.solver == "structured"
    assert check(motion.trajectory, robot, problem.task_limits).passed


def test_one_joint_alone_gains_what_the_closed_form_says(tilt_insert: Problem) -> None:
    """A start at the speed v saves the time v/a of the acceleration.

    The joint needs the time v²/(2 a v_max) for the distance of this acceleration at cruising speed.
    """
    alone = (Free(Joints((-0.5, 0.6, 0.0, -0.015))),)
    problem = dataclasses.replace(free(tilt_insert), motion=alone)
    speed, joint = 0.008, tilt_insert.robot.joints[3]
    moving = plan(dataclasses.replace(problem, start_rate={"depth": speed})).duration
    gain = speed / joint.acceleration - speed**2 / (2 * joint.acceleration * joint.velocity)
    assert moving == pytest.approx(plan(problem).duration - gain, rel=5e-4)


def test_rates_hold_at_the_two_ends_of_all_and_rest_between(tilt_insert: Problem) -> None:
    problem = straight(tilt_insert, start_rate=along(0.3), end_rate={"depth": 0.01})
    insert = Straight(**{"depth": 0.02}, name="insert")
    result = plan(dataclasses.replace(problem, motion=(*problem.motion, insert)))
    first, last = end_rates(result)
    assert first == pytest.approx(as_array(along(0.3)), abs=1e-9)
    assert last == pytest.approx(as_array({"depth": 0.01}), abs=1e-9)
    border = result.trajectory.sample(np.array([result.phases[0].duration]))
    assert np.abs(border.qd).max() < 1e-9


def test_a_rate_too_high_is_a_reason(tilt_insert: Problem) -> None:
    fast = plan(free(tilt_insert, start_rate={"depth": 0.03}))
    assert (fast.status, fast.reason.constraint, fast.reason.joint) == (
        "infeasible",
        "velocity",
        "insertion",
    )
    assert (fast.reason.required, fast.reason.available) == pytest.approx((0.03, 0.02))


def test_an_end_too_near_to_stop_at_is_a_reason(tilt_insert: Problem) -> None:
    """A stop from 15 mm/s within 0.5 mm requires v²/(2 d) = 225 mm/s²."""
    near = (Straight(**{"depth": 0.0045}, name="insert"),)
    result = plan(
        dataclasses.replace(straight(tilt_insert), motion=near, start_rate={"depth": 0.015})
    )
    assert (result.status, result.reason.constraint, result.reason.joint) == (
        "infeasible",
        "acceleration",
        "insertion",
    )
    assert (result.reason.required, result.reason.available) == pytest.approx((0.225, 0.1))
    assert "instead of 100 mm/s²: tried" in result.reason.relaxation


@pytest.mark.parametrize(
    "rates",
    [{"start_rate": {"tilt": 0.3}}, {"end_rate": {"spin": 0.1}}, {"start_rate": along(-0.2)}],
)
def test_a_rate_off_the_line_of_a_straight_motion_is_bad_input(
    tilt_insert: Problem, rates: dict[str, dict[str, float]]
) -> None:
    (key,) = rates
    with pytest.raises(ProblemError, match=f"{key}: this speed leads away from the line"):
        plan(straight(tilt_insert, **rates))


def test_a_dwell_has_no_speed(tilt_insert: Problem) -> None:
    problem = straight(tilt_insert)
    dwell = Dwell(0.2)
    with pytest.raises(ProblemError, match="end_rate: a dwell has no speed"):
        plan(
            dataclasses.replace(problem, motion=(*problem.motion, dwell), end_rate={"depth": 0.01})
        )
