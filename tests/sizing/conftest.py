"""Fixtures with a motion, its joint loads and a duty cycle for the tests of sizing."""

from __future__ import annotations

import pytest

from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.trajectory import Trajectory
from tests.support.sizing_cases import equipped, random_trajectory


@pytest.fixture(scope="session")
def trajectory() -> Trajectory:
    return random_trajectory(3)


@pytest.fixture(scope="session")
def loads(trajectory: Trajectory, robot: Robot) -> tuple[JointLoad, ...]:
    return joint_loads(trajectory, robot)


@pytest.fixture(scope="session")
def complete(robot: Robot) -> DutyCycle:
    """Return a duty cycle for a random motion of a robot whose files state every figure."""
    return DutyCycle.of_trajectory(random_trajectory(3), equipped(robot))
