"""Verify motions with a motor that is too weak to move its joint together with all others.

The planner moves this joint after other joints have reduced its load.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ssm_planner.dynamics import RigidBody
from ssm_planner.dynamics.friction import breakaway_coefficient, friction_coefficient
from ssm_planner.dynamics.transmission import breakaway_torque, required_friction
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.problem.motion import Free, Joints, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array


def needed(robot: Robot, start: Array, end: Array) -> Array:
    """Return the torques in N m at which the motors just start and just arrive, (4,)."""
    gravity = RigidBody.from_robot(robot).gravity_load(np.stack([start, end]))
    result = np.zeros(4)
    for i, joint in enumerate(robot.joints):
        sign = np.sign(end[i] - start[i])
        if joint.drive is None or sign == 0:
            continue
        friction = required_friction(joint.drive)
        coefficients = breakaway_coefficient(friction), friction_coefficient(friction, 0.0)
        for load, mu in zip(gravity[:, i], coefficients, strict=True):
            torque = breakaway_torque(joint.drive, np.array([load]), sign, np.asarray(mu))
            result[i] = max(result[i], float(np.abs(torque)[0]))
    return result


def weak_problem(tilt_insert: Problem, seed: int) -> tuple[Problem, Array]:
    """Return a problem with a motor too weak for a direct motion, and joint positions (4,).

    The motions to these joint positions and from them are both possible.
    """
    rng = np.random.default_rng(seed)
    start, end = (
        Task(
            roll=rng.uniform(-0.45, 0.45),
            tilt=rng.uniform(-2.35, -1.5),
            spin=rng.uniform(-1, 1),
            depth=rng.uniform(0.002, 0.028),
        )
        for _ in range(2)
    )
    problem = replace(
        tilt_insert, start=start, motion=(Free(end),), objective="time", planner="fast", eye=None
    )
    (phase,), _ = feasible_phases(problem)
    q0, q1 = phase.points
    at_once = needed(problem.robot, q0, q1)
    best: tuple[float, int, Array] = (1.0, 0, q0)
    for moved in list(product((False, True), repeat=4))[1:-1]:
        between = np.where(moved, q1, q0)
        halves = needed(problem.robot, q0, between), needed(problem.robot, between, q1)
        pair = np.maximum(*halves)
        shares = np.divide(pair, at_once, out=np.ones(4), where=at_once > 0)
        i = int(shares.argmin())
        if shares[i] < best[0]:
            best = float(shares[i]), i, between
    share, i, between = best
    torque = (0.3 * share + 0.7) * at_once[i]
    joints = list(problem.robot.joints)
    motor = joints[i].motor
    assert motor is not None
    weak = replace(motor, max_torque=torque, nominal_torque=min(torque, motor.nominal_torque))
    joints[i] = replace(joints[i], motor=weak)
    robot = replace(problem.robot, joints=(joints[0], joints[1], joints[2], joints[3]))
    return replace(problem, robot=robot, duty=None), between


@pytest.mark.parametrize("seed", [0, 1, 4, 5, 6, 7, 10, 13, 24])
def test_one_motion_is_certified_if_two_are(tilt_insert: Problem, seed: int) -> None:
    """The planner finds one certified motion if the same motion in two parts is possible."""
    problem, between = weak_problem(tilt_insert, seed)
    (phase,), _ = feasible_phases(problem)
    q0, q1 = phase.points
    available = [0.0 if j.motor is None else j.motor.max_torque for j in problem.robot.joints]
    assert (needed(problem.robot, q0, q1) > available).any()
    single = plan(problem, relaxations=False)
    assert single.passed, single.reason
    assert [phase.name for phase in single.phases] == ["free, in turn"]
    halves = (Free(Joints.from_array(between)), Free(Joints.from_array(q1)))
    pair = plan(replace(problem, start=Joints.from_array(q0), motion=halves), relaxations=False)
    assert pair.passed, pair.reason
    assert single.duration < 2 * pair.duration


def test_a_motor_too_weak_in_every_order_is_named(tilt_insert: Problem) -> None:
    problem, _ = weak_problem(tilt_insert, 0)
    joints = list(problem.robot.joints)
    (phase,), _ = feasible_phases(problem)
    weakest = 0.5 * needed(problem.robot, *phase.points)[1]
    motor = replace(joints[1].motor, max_torque=weakest, nominal_torque=weakest)
    joints[1] = replace(joints[1], motor=motor)
    result = plan(
        replace(problem, robot=replace(problem.robot, joints=tuple(joints))), relaxations=False
    )
    assert result.reason is not None
    assert (result.reason.constraint, result.reason.joint) == ("motor torque", "tilt")
