"""Verify free motions against Ruckig, the package toppra and the time of the slowest joint."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.pipeline.run import plan
from ssm_planner.problem.limits import Limit, TaskRange, TaskRate, TipSpeed
from ssm_planner.problem.motion import Free, Joints, Point, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.verification.second_opinion import shortest_path_duration

Weaker = Callable[[Robot, float], Robot]
WithJerk = Callable[[Robot, float, float], Robot]

FIRST, LAST = (-0.5, 0.6, 0.0, 0.0), (0.3, -0.2, 0.5, -0.015)


def free(problem: Problem, first: tuple[float, ...] = FIRST, goal: Point | None = None) -> Problem:
    """Return a problem with one free motion from joint positions to a target."""
    goal = goal or Joints(LAST)
    motion = (Free(goal),)
    return dataclasses.replace(
        problem, start=Joints(first), motion=motion, limits=(TaskRange("depth", 0.0, 0.03),)
    )


def test_without_other_limits_it_takes_the_slowest_joints_time(tilt_insert: Problem) -> None:
    result = plan(free(tilt_insert))
    assert result.passed
    assert result.gap < 1e-5


@pytest.mark.parametrize("jerk", [5.0, 35.0, 500.0])
def test_jerk_limited_free_motion_against_ruckig(
    tilt_insert: Problem, jerk: float, with_jerk: WithJerk
) -> None:
    ruckig = pytest.importorskip("ruckig", reason="Ruckig is not installed")
    problem = free(
        dataclasses.replace(tilt_insert, robot=with_jerk(tilt_insert.robot, jerk, 0.1 * jerk))
    )
    result = plan(problem)
    task, reference = ruckig.InputParameter(4), ruckig.Trajectory(4)
    task.current_position, task.target_position = FIRST, LAST
    joints = problem.robot.joints
    task.max_velocity = [joint.velocity for joint in joints]
    task.max_acceleration = [joint.acceleration for joint in joints]
    task.max_jerk = [joint.jerk for joint in joints]
    ruckig.Ruckig(4).calculate(task, reference)
    assert result.passed
    assert result.duration <= 1.002 * reference.duration
    assert result.duration >= (1 - 1e-6) * reference.duration


@pytest.mark.parametrize("factor", [0.35, 0.3])
def test_motor_torque_that_binds_is_kept_and_used(
    tilt_insert: Problem, factor: float, weaker: Weaker
) -> None:
    result = plan(free(dataclasses.replace(tilt_insert, robot=weaker(tilt_insert.robot, factor))))
    assert result.passed
    torque = min(
        limit.margin for limit in result.certificate.limits if limit.name == "motor torque"
    )
    assert -1e-6 <= torque < 1e-3
    by_toppra = shortest_path_duration(
        result.motion, result.robot, result.limits, (0.0, result.duration)
    ).duration
    assert result.duration == pytest.approx(by_toppra, rel=5e-4)


def test_torque_jerk_and_tip_speed_together(
    tilt_insert: Problem, weaker: Weaker, with_jerk: WithJerk
) -> None:
    robot = weaker(with_jerk(tilt_insert.robot, 35.0, 1.0), 0.32)
    result = plan(TipSpeed(0.012).on(free(dataclasses.replace(tilt_insert, robot=robot))))
    assert result.passed


def test_every_joint_moves_one_way(tilt_insert: Problem) -> None:
    """If only the joints limit the motion, no joint reverses."""
    result = plan(free(tilt_insert))
    qd = result.trajectory.uniform(1000.0).qd
    assert np.all(qd * np.sign(np.subtract(LAST, FIRST)) >= -1e-9)


def test_a_tip_position_is_reached(tilt_insert: Problem) -> None:
    tip = (0.003, 0.002, -0.014)
    result = plan(free(tilt_insert, goal=Tip(tuple(tip), 0.3)))
    assert result.passed
    mechanism = Mechanism.from_geometry(tilt_insert.robot.geometry)
    reached = tip_position(
        mechanism, result.trajectory.sample(result.trajectory.breaks[-1:], side="left").q
    )[0]
    assert reached == pytest.approx(tip, abs=1e-9)


def test_one_joint_alone_leaves_the_others_at_rest(tilt_insert: Problem) -> None:
    result = plan(free(tilt_insert, goal=Joints((*FIRST[:3], -0.02))))
    assert result.passed
    assert np.ptp(result.trajectory.uniform(1000.0).q[:, :3], axis=0).max() == 0.0


@pytest.mark.parametrize(
    "limit", [TaskRange("spin", -np.radians(5), np.radians(5)), TaskRate("spin", np.radians(5))]
)
@pytest.mark.slow
def test_a_free_motion_is_never_longer_than_the_straight_one_nor_fails_where_that_succeeds(
    tilt_insert: Problem, limit: Limit
) -> None:
    """If no joint of the free motion reverses, spin must leave its range or exceed its rate.

    The planner then uses a motion that is at most as long as the straight one.
    """
    limits = (*tilt_insert.limits, limit)
    target = np.radians(-135)
    straight, other = (
        plan(dataclasses.replace(tilt_insert, limits=limits, objective="time", motion=(motion,)))
        for motion in (Straight(tilt=target, name="straight"), Free(Task(tilt=target), name="free"))
    )
    assert straight.passed
    assert other.passed
    assert other.duration <= (1 + 1e-5) * straight.duration


def test_a_free_motion_limited_by_joints_differs_from_a_straight_one(
    tilt_insert: Problem,
) -> None:
    """If only the joints limit it, the plan does not use the path of a straight motion."""
    result = plan(
        dataclasses.replace(
            tilt_insert, objective="time", motion=(Free(Task(tilt=-2.0, roll=0.1)),)
        )
    )
    assert result.passed
    assert result.phases[0].branch is None


@pytest.mark.parametrize("limited", [("insertion",), ("roll", "insertion"), ("tilt",)])
def test_a_jerk_limit_on_some_joints_alone_is_solved_like_one_on_all(
    tilt_insert: Problem, limited: tuple[str, ...], with_jerk: WithJerk
) -> None:
    jerky = with_jerk(tilt_insert.robot, 15.0, 1.0).joints
    joints = tuple(
        new if new.name in limited else old
        for new, old in zip(jerky, tilt_insert.robot.joints, strict=True)
    )
    to = Task(roll=np.radians(15), tilt=np.radians(-120), spin=np.radians(40), depth=0.015)
    robot = dataclasses.replace(tilt_insert.robot, joints=joints)
    result = plan(
        dataclasses.replace(tilt_insert, robot=robot, motion=(Free(to),), objective="time")
    )
    assert result.passed
    assert result.gap < 2e-3
