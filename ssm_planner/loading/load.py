"""Files → values: the only way into the program."""

from __future__ import annotations

from pathlib import Path

from ssm_planner.loading.drives import drive_from
from ssm_planner.loading.motors import motor_from
from ssm_planner.loading.problems import problem_from
from ssm_planner.loading.robots import robot_from
from ssm_planner.loading.yaml_nodes import read
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot


def load_problem(path: str | Path) -> Problem:
    """The problem in a YAML file, its robot loaded and every point inside its limits. Raises ProblemError."""
    return problem_from(read(path))


def load_robot(path: str | Path) -> Robot:
    """The robot in a YAML file, its drives and motors loaded. Raises ProblemError."""
    return robot_from(read(path))


def load_drive(path: str | Path) -> Drive:
    """The drive in a YAML file; friction is None where it is still to be identified. Raises ProblemError."""
    return drive_from(read(path))


def load_motor(path: str | Path) -> Motor:
    """The motor in a YAML file. Raises ProblemError."""
    return motor_from(read(path))
