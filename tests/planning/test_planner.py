"""Verify plans of straight motions against the package toppra and against closed forms."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.planning.lower_bound import rest_to_rest
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TipSpeed
from ssm_planner.problem.motion import Free, Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Span
from ssm_planner.verification.second_opinion import shortest_path_duration

Weaker = Callable[[Robot, float], Robot]


def straight(problem: Problem, **task: float) -> Problem:
    """Return the problem with one straight motion to the given task coordinates, rad and m."""
    return dataclasses.replace(problem, motion=(Straight(**task, name="straight"),))


def by_toppra(plan: Plan, span: Span) -> float:
    """Return the duration in s that the package toppra finds along the path of a phase."""
    duration = shortest_path_duration(
        plan.motion, plan.robot, plan.limits, (span.start, span.end)
    ).duration
    assert duration is not None
    return duration


def assert_certified_and_as_fast_as_toppra(problem: Problem) -> None:
    """Assert that a plan passes its check and that each phase is as fast as toppra's."""
    result = plan(problem)
    assert result.status == "solved"
    assert result.certificate is not None
    assert min(limit.margin for limit in result.certificate.limits) >= -1e-6
    assert result.passed
    for phase, span in zip(result.phases, result.motion.phases, strict=True):
        assert 1 - 1e-4 <= phase.duration / by_toppra(result, span) <= 1 + 5e-4
        assert phase.duration >= phase.lower_bound * (1 - 1e-6)


def test_tilt_and_insert(tilt_insert: Problem) -> None:
    assert_certified_and_as_fast_as_toppra(tilt_insert)


@pytest.mark.parametrize("factor", [0.3, 0.285])
def test_with_motors_that_bind(tilt_insert: Problem, factor: float, weaker: Weaker) -> None:
    problem = dataclasses.replace(
        tilt_insert, robot=weaker(tilt_insert.robot, factor), motion=tilt_insert.motion[:1]
    )
    result = plan(problem)
    assert result.passed
    torque = [limit for limit in result.certificate.limits if limit.name == "motor torque"]
    assert min(limit.margin for limit in torque) < 1e-3
    assert_certified_and_as_fast_as_toppra(problem)


def test_all_coordinates_together(tilt_insert: Problem) -> None:
    target = {
        "roll": np.radians(15),
        "tilt": np.radians(-120),
        "spin": np.radians(80),
        "depth": 0.015,
    }
    assert_certified_and_as_fast_as_toppra(straight(tilt_insert, **target))


def test_a_joint_that_turns_back_on_the_way(tilt_insert: Problem) -> None:
    """Joint 1 reverses when the tool rolls and tilts, so the friction of its drive changes sign."""
    problem = straight(tilt_insert, roll=np.radians(-30), tilt=np.radians(-112))
    start = Task(**{"roll": np.radians(30), "tilt": np.radians(-86), "spin": 0.0, "depth": 0.0})
    problem = dataclasses.replace(problem, start=start)
    result = plan(problem)
    phases, _ = feasible_phases(problem)
    assert phases[0].path is not None
    assert len(phases[0].path.directions[0]) > 2
    assert result.passed
    assert_certified_and_as_fast_as_toppra(problem)


def slow(problem: Problem, speed: float, jerk: float | None = None) -> Problem:
    """Return the problem with joint speed limits of `speed` in deg/s and mm/s.

    The jerk limits are 2 `jerk` in rad/s³ and `jerk` in m/s³.
    """
    joints = tuple(
        dataclasses.replace(
            joint,
            velocity=1e-3 * speed if joint.kind == "prismatic" else np.radians(speed),
            jerk=None if jerk is None else jerk * (1.0 if joint.kind == "prismatic" else 2.0),
        )
        for joint in problem.robot.joints
    )
    return dataclasses.replace(problem, robot=dataclasses.replace(problem.robot, joints=joints))


@pytest.mark.parametrize("speed", [2.0, 10.0, 15.0])
def test_slow_motions_take_little_time_to_get_up_to_speed(
    tilt_insert: Problem, speed: float
) -> None:
    """The insertion moves one joint alone, so it takes v/a longer than at full speed throughout."""
    problem = slow(tilt_insert, speed)
    result = plan(problem)
    assert result.passed
    tilt, insert = result.phases
    assert tilt.duration <= (1 + 1e-4) * by_toppra(result, result.motion.phases[0])
    joint = problem.robot.joints[3]
    assert insert.duration == pytest.approx(
        0.02 / joint.velocity + joint.velocity / joint.acceleration, rel=1e-4
    )


def test_a_motion_whose_elements_last_microseconds_is_certified_as_it_is(
    tilt_insert: Problem,
) -> None:
    """An arc is very short if a joint is near its speed limit while its acceleration rises."""
    problem = slow(tilt_insert, 20.0, jerk=17.5)
    motion = tuple(
        Free(entry.to, name=entry.name)
        for entry in tilt_insert.motion
        if isinstance(entry, Straight)
    )
    result = plan(dataclasses.replace(problem, motion=motion))
    assert result.passed
    for phase in result.phases:
        assert phase.duration == pytest.approx(phase.lower_bound, rel=1e-5)


def test_tip_speed_is_kept(tilt_insert: Problem) -> None:
    problem = TipSpeed(0.012).on(dataclasses.replace(tilt_insert, motion=tilt_insert.motion[1:]))
    result = plan(problem)
    assert result.passed
    limit = next(limit for limit in result.certificate.limits if limit.name == "tip speed")
    assert limit.worst == pytest.approx(0.012, rel=1e-5)
    assert result.duration == pytest.approx(rest_to_rest(0.02, 0.012, 0.1).duration, rel=1e-4)


def test_a_motor_too_weak_is_named_with_what_it_needs(tilt_insert: Problem, weaker: Weaker) -> None:
    result = plan(dataclasses.replace(tilt_insert, robot=weaker(tilt_insert.robot, 0.2)))
    assert result.status == "infeasible"
    assert not result.passed
    assert result.trajectory is None
    assert result.reason.constraint == "motor torque"
    assert result.reason.joint == "roll"
    assert result.reason.required > result.reason.available
    enough = result.reason.required / tilt_insert.robot.joints[0].motor.max_torque
    assert plan(
        dataclasses.replace(tilt_insert, robot=weaker(tilt_insert.robot, 1.02 * enough))
    ).passed


def test_a_joint_range_that_no_branch_respects_is_named(tilt_insert: Problem) -> None:
    joints = list(tilt_insert.robot.joints)
    joints[1] = dataclasses.replace(joints[1], position=(-0.1, 0.1))
    problem = dataclasses.replace(
        tilt_insert, robot=dataclasses.replace(tilt_insert.robot, joints=tuple(joints))
    )
    result = plan(problem)
    assert result.status == "infeasible"
    assert (result.reason.constraint, result.reason.joint) == ("position", "tilt")


def test_a_tilt_beyond_the_mechanism_is_bad_input(tilt_insert: Problem) -> None:
    robot = dataclasses.replace(tilt_insert.robot, limits=())
    problem = straight(
        dataclasses.replace(tilt_insert, robot=robot, limits=()), tilt=np.radians(-140)
    )
    with pytest.raises(
        ProblemError, match=r"cannot reach this tilt .allowed: -139\.778 deg to -79\.778 deg"
    ):
        plan(problem)


def test_a_motion_that_goes_nowhere_is_bad_input(tilt_insert: Problem) -> None:
    with pytest.raises(ProblemError, match="has length zero"):
        plan(straight(tilt_insert, depth=0.0))
