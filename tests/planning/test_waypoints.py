"""Verify free motions that pass waypoints without stopping."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.planning.lower_bound import minimum_times
from ssm_planner.planning.ocp.free import solve_free
from ssm_planner.planning.planner import plan_motion
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TaskRange
from ssm_planner.problem.motion import Free, Joints, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

Weaker = Callable[[Robot, float], Robot]
WithJerk = Callable[[Robot, float, float], Robot]

FIRST, LAST = (-0.5, 0.6, 0.0, 0.0), (0.3, -0.2, 0.5, -0.015)
BETWEEN = (0.1, 0.3, 0.3, -0.004)
"""For every joint, this point is between FIRST and LAST, but it is not on the straight line."""
ASIDE = (0.1, 0.7, 0.3, 0.0)
"""At this point, joint 2 reverses, and joint 4 has not begun to move."""


def through(
    problem: Problem, *points: tuple[float, ...], first: tuple[float, ...] = FIRST
) -> Problem:
    """Return the problem with a free motion from `first` through all points to the last one."""
    *passed, goal = (Joints(point) for point in points)
    motion = (Free(goal, through=tuple(passed)),)
    return dataclasses.replace(
        problem, start=Joints(first), motion=motion, limits=(TaskRange("depth", 0.0, 0.03),)
    )


def passing(motion: Plan | Trajectory, point: tuple[float, ...]) -> tuple[float, Array]:
    """Return the time in s at which the motion passes a point, and the joint velocities then, (4,).

    The motion must pass the point at the end of one of its pieces.
    """
    if isinstance(motion, Plan):
        assert motion.passed
        motion = motion.motion
    at_breaks = motion.sample(motion.breaks)
    distance = np.abs(at_breaks.q - point).max(axis=1)
    k = int(np.argmin(distance))
    assert distance[k] <= 1e-9
    return float(at_breaks.t[k]), at_breaks.qd[k]


def unmotored(robot: Robot) -> Robot:
    """Return the robot without drives and motors."""
    return dataclasses.replace(
        robot,
        joints=tuple(dataclasses.replace(joint, drive=None, motor=None) for joint in robot.joints),
    )


@pytest.mark.parametrize("jerk", [False, True])
def test_a_point_on_the_way_is_passed_at_speed(
    tilt_insert: Problem, with_jerk: WithJerk, jerk: bool
) -> None:
    if jerk:
        tilt_insert = dataclasses.replace(
            tilt_insert, robot=with_jerk(tilt_insert.robot, 35.0, 1.0)
        )
    complete = plan(through(tilt_insert, BETWEEN, LAST))
    _, speed = passing(complete, BETWEEN)
    limit = np.array([joint.velocity for joint in tilt_insert.robot.joints])
    assert np.all(speed * np.subtract(LAST, FIRST) > 0)
    assert (np.abs(speed) / limit).max() > 0.3
    parts = plan(through(tilt_insert, BETWEEN)), plan(through(tilt_insert, LAST, first=BETWEEN))
    without = plan(through(tilt_insert, LAST))
    backoff = 1.001 * 1.0005  # This allows for the motion with the least heat and for the mesh.
    assert (
        without.duration / backoff
        <= complete.duration
        <= 0.95 * sum(part.duration for part in parts)
    )


def test_a_joint_that_turns_back_at_a_point_is_at_rest_there_and_the_others_go_on(
    tilt_insert: Problem,
) -> None:
    planned = plan_motion(through(tilt_insert, ASIDE, LAST), may_reverse=False)
    assert planned.trajectory is not None
    _, speed = passing(planned.trajectory, ASIDE)
    assert speed[[1, 3]] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.abs(speed[[0, 2]]) > 0.1)


@pytest.mark.parametrize("jerk", [False, True])
def test_a_joint_with_time_to_spare_turns_back_beyond_the_point(
    tilt_insert: Problem, with_jerk: WithJerk, jerk: bool
) -> None:
    """Joint 1 determines the time to the point, and joint 2 determines the time after it.

    Each is then as fast as it would be alone. Joint 2 passes the point at the speed that makes this
    possible, and the reference minimises over this speed.
    """
    first, point, last = (-0.5, 0.6, 0.0, 0.0), (0.3, 0.7, 0.3, 0.0), (0.35, -0.2, 0.5, 0.0)
    robot = unmotored(tilt_insert.robot)
    if jerk:
        robot = with_jerk(robot, 60.0, 2.0)
    problem = dataclasses.replace(
        through(tilt_insert, point, last, first=first), robot=robot, objective="time"
    )
    rested, result = plan_motion(problem, may_reverse=False).phases[0], plan(problem)
    assert result.passed
    _, speed = passing(result.motion, point)
    assert speed[1] < -0.1
    assert result.motion.uniform(1000.0).q[:, 1].max() > 0.71
    assert result.duration < 0.96 * rested.duration
    if not jerk:
        acceleration = [joint.acceleration for joint in robot.joints]
        velocity = [joint.velocity for joint in robot.joints]
        ways = np.diff([first, point, last], axis=0)
        alone = least_over(ways[:, :2], np.array(velocity[:2]), np.array(acceleration[:2]))
        assert result.duration == pytest.approx(alone, rel=5e-4)


def least_over(ways: Array, velocity: Array, acceleration: Array) -> float:
    """Return the least time in s that two joints need alone for two displacements, `ways` (2, 2).

    Row k of `ways` is the displacement k of both joints, which takes the time of the slower joint.
    A grid over the speeds of both joints at the point gives the minimum.
    """
    first, second = np.meshgrid(*(np.linspace(-v, v, 801) for v in velocity), indexing="ij")
    arrival = (
        minimum_times(way, v, a, (np.zeros(()), speed))
        for way, v, a, speed in zip(ways[0], velocity, acceleration, (first, second), strict=True)
    )
    onward = (
        minimum_times(way, v, a, (speed, np.zeros(())))
        for way, v, a, speed in zip(ways[1], velocity, acceleration, (first, second), strict=True)
    )
    return float((np.maximum(*arrival) + np.maximum(*onward)).min())


def test_points_are_passed_in_their_order_in_any_form(tilt_insert: Problem) -> None:
    """Points in task coordinates or tip positions are passed in order, like joint positions."""
    mechanism = Mechanism.from_geometry(tilt_insert.robot.geometry)
    middle = (-0.2, 0.5, 0.1, -0.002)
    task = task_from_joints(mechanism, np.array([middle]))[0]
    tip = tip_position(mechanism, np.array([BETWEEN]))[0]
    spin = float(task_from_joints(mechanism, np.array([BETWEEN]))[0, 2])
    problem = through(tilt_insert, middle, BETWEEN, LAST)
    points = Task(*task.tolist()), Tip(tuple(tip.tolist()), spin)
    same = dataclasses.replace(
        problem, motion=(dataclasses.replace(problem.motion[0], through=points),)
    )
    result = plan(same)
    assert 0 < passing(result, middle)[0] < passing(result, BETWEEN)[0] < result.duration
    assert result.duration == pytest.approx(plan(problem).duration, rel=1e-6)


def test_another_order_takes_another_time(tilt_insert: Problem) -> None:
    middle = (-0.2, 0.5, 0.1, -0.002)
    forth, back = (
        plan(through(tilt_insert, middle, BETWEEN, LAST)),
        plan(through(tilt_insert, BETWEEN, middle, LAST)),
    )
    assert passing(back, BETWEEN)[0] < passing(back, middle)[0]
    assert back.duration > 1.2 * forth.duration


@pytest.mark.slow
def test_the_mesh_is_fine_enough(tilt_insert: Problem, weaker: Weaker) -> None:
    """Twice as many elements shorten a motion with binding motors by less than 0.2 %."""
    problem = through(tilt_insert, ASIDE, LAST)
    problem = dataclasses.replace(problem, robot=weaker(problem.robot, 0.36), objective="time")
    phase = feasible_phases(problem)[0][0]
    coarse, fine = (solve_free(phase, count=n) for n in (40, 80))
    assert coarse.solved
    assert fine.solved
    assert abs(coarse.breaks[-1] / fine.breaks[-1] - 1) < 2e-3


def test_without_motors_time_scales_with_the_limits_and_the_way_back_takes_as_long(
    tilt_insert: Problem,
) -> None:
    """With twice the velocities and four times the accelerations, the motion takes half the time.

    The same points in reverse order take the same time.
    """
    robot = unmotored(tilt_insert.robot)
    problem = dataclasses.replace(
        through(tilt_insert, ASIDE, BETWEEN, LAST), robot=robot, objective="time"
    )
    joints = (
        dataclasses.replace(joint, velocity=2 * joint.velocity, acceleration=4 * joint.acceleration)
        for joint in robot.joints
    )
    faster = dataclasses.replace(problem, robot=dataclasses.replace(robot, joints=tuple(joints)))
    back = dataclasses.replace(
        through(tilt_insert, BETWEEN, ASIDE, FIRST, first=LAST), robot=robot, objective="time"
    )
    duration = plan(problem).duration
    assert 2 * plan(faster).duration == pytest.approx(duration, rel=1e-6)
    assert plan(back).duration == pytest.approx(duration, rel=1e-3)


def test_many_points(tilt_insert: Problem) -> None:
    """Twenty points along a straight line in joint space cost little time."""
    shares = np.linspace(0.0, 1.0, 22)[1:]
    curve = (
        np.array(FIRST)
        + np.subtract(LAST, FIRST) * (shares + 0.05 * np.sin(2 * np.pi * shares))[:, None]
    )
    result = plan(
        dataclasses.replace(through(tilt_insert, *map(tuple, curve.tolist())), objective="time")
    )
    for point in curve:
        passing(result, tuple(point))
    assert result.duration < 1.05 * plan(through(tilt_insert, LAST)).duration


def test_a_point_twice_in_a_row_is_one_point(tilt_insert: Problem) -> None:
    assert (
        plan(through(tilt_insert, BETWEEN, BETWEEN, LAST)).duration
        == plan(through(tilt_insert, BETWEEN, LAST)).duration
    )
    assert (
        plan(through(tilt_insert, LAST, LAST)).duration == plan(through(tilt_insert, LAST)).duration
    )
