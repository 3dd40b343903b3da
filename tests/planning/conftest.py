"""Provide fixtures that change a robot."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest

from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.problem.value import unchecked_copy

Weaker = Callable[[Robot, float], Robot]
WithJerk = Callable[[Robot, float, float], Robot]


@pytest.fixture(scope="session")
def weaker() -> Weaker:
    """Return a function that scales the largest torque of every motor of a robot."""

    def motor(original: Motor, factor: float) -> Motor:
        return unchecked_copy(original, max_torque=factor * original.max_torque)

    def joint(original: Joint, factor: float) -> Joint:
        if original.motor is None:
            return original
        return dataclasses.replace(original, motor=motor(original.motor, factor))

    return lambda robot, factor: dataclasses.replace(
        robot, joints=tuple(joint(j, factor) for j in robot.joints)
    )


@pytest.fixture(scope="session")
def with_jerk() -> WithJerk:
    """Return a function that adds jerk limits to revolute (rad/s³) and prismatic joints (m/s³)."""

    def make(robot: Robot, revolute: float, prismatic: float) -> Robot:
        jerks = {"revolute": revolute, "prismatic": prismatic}
        joints = tuple(dataclasses.replace(joint, jerk=jerks[joint.kind]) for joint in robot.joints)
        return dataclasses.replace(robot, joints=joints)

    return make
