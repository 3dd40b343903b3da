"""The files that the document is computed from, read once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_drive, load_problem
from ssm_planner.loading.motorisation import load_motorisation
from ssm_planner.paper.published import DRIVEN, RIGS
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motorisation import Motorisation
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot


@dataclass(frozen=True, eq=False)
class Inputs:
    """Problem of Table III's motions with its robot, motorisation runs by name, rigs by name."""

    folder: Path
    problem: Problem
    motorisations: dict[str, Motorisation]
    rigs: dict[str, Drive]
    recordings: Path

    @property
    def robot(self) -> Robot:
        return self.problem.robot


def read_inputs(problems: Path, recordings: Path) -> Inputs:
    """The shipped files below `problems`; `recordings` need not exist. Raises ProblemError."""
    if not problems.is_dir():
        raise ProblemError(
            "no such folder: the document is computed from the project's problem files",
            key="--problems",
            value=str(problems),
            allowed="the project's folder problems/",
        )
    names = ("paper", "package")
    problem = load_problem(problems / "tilt_insert.yaml")
    _check(problem)
    return Inputs(
        problems,
        problem,
        {name: load_motorisation(problems / "motorisation" / f"{name}.yaml") for name in names},
        {name: load_drive(problems / "drives" / f"{name}.yaml") for name in RIGS},
        recordings,
    )


def _check(problem: Problem) -> None:
    """The tables speak of the paper's robot: joints 1, 2 and 4 driven, a tilt range declared."""
    robot = problem.robot
    for joint in robot.joints:
        if joint.name in DRIVEN and joint.drive is None:
            raise ProblemError(
                "missing: Tables II and III need its friction", file=robot.file, key=f"joints.{joint.name}.drive"
            )
    if "tilt" not in robot.ranges:
        raise ProblemError("missing: the range in which the arm works", file=robot.file, key="limits.tilt")
    if problem.start.task is None or not all(name in problem.start.task for name in ("tilt", "depth")):
        raise ProblemError("Table III's motion starts from task coordinates", file=problem.file, key="start")
