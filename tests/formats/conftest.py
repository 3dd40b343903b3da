"""These fixtures provide the plans that the tests export."""

from __future__ import annotations

from pathlib import Path

import pytest

from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from tests.support.plans import of_task, read_back, smooth, trapezoids

LIMITS = of_task({"tilt": (-2.42, -1.4), "depth": (0.0, 0.03)})


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the plans."""
    return tmp_path_factory.mktemp("plans")


@pytest.fixture(scope="session")
def plan(folder: Path, robot: Robot) -> Plan:
    """Return a plan whose acceleration jumps, like that of time-optimal plans."""
    return read_back(folder / "plan.json", robot, trapezoids(robot), limits=LIMITS)


@pytest.fixture(scope="session")
def smooth_plan(folder: Path, robot: Robot) -> Plan:
    """Return a plan without jumps of the acceleration."""
    return read_back(folder / "smooth.json", robot, smooth(robot), limits=LIMITS)


@pytest.fixture(scope="session")
def bad_plan(folder: Path, robot: Robot) -> Plan:
    """Return a plan that exceeds its limits by 1 %, which its certificate states."""
    return read_back(folder / "bad.json", robot, trapezoids(robot, share=1.01), limits=LIMITS)
