"""Files → values: the only way into the program."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ssm_planner.loading.controllers import controller_from
from ssm_planner.loading.drives import drive_from
from ssm_planner.loading.motors import motor_from
from ssm_planner.loading.problems import problem_from
from ssm_planner.loading.robots import robot_from
from ssm_planner.loading.shipped import find
from ssm_planner.loading.yaml_nodes import of_data, of_text, read
from ssm_planner.problem.controller import Controller
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot


def load_problem(name: str | Path) -> Problem:
    """The problem in a YAML file, or the shipped one of this name; every point inside its limits. Raises ProblemError."""
    return problem_from(read(find(name, "problems")))


def problem_from_dict(data: Mapping[str, Any]) -> Problem:
    """See Problem.from_dict."""
    return problem_from(of_data(data))


def problem_from_yaml(text: str) -> Problem:
    """See Problem.from_yaml."""
    return problem_from(of_text(text))


def load_robot(name: str | Path) -> Robot:
    """The robot in a YAML file, or the shipped one of this name, its drives and motors loaded. Raises ProblemError."""
    return robot_from(read(find(name, "robots")))


def load_drive(name: str | Path) -> Drive:
    """The drive in a YAML file, or the shipped one of this name. Raises ProblemError.

    Its friction is None where it is still to be identified.
    """
    return drive_from(read(find(name, "drives")))


def load_motor(name: str | Path) -> Motor:
    """The motor in a YAML file, or the shipped one of this name. Raises ProblemError."""
    return motor_from(read(find(name, "motors")))


def load_controller(name: str | Path) -> Controller:
    """The controller in a YAML file, or the shipped one of this name. Raises ProblemError."""
    return controller_from(read(find(name, "controllers")))
