"""`ssm-planner retime FILE --robot ROBOT`: the path of anybody's trajectory, as fast as the robot's limits allow."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.cli.shared import (
    FAILED,
    OK,
    output_arguments,
    progress_reporter,
    rate_argument,
    show,
)
from ssm_planner.errors import ProblemError

if TYPE_CHECKING:
    from ssm_planner.formats.points import Reading
    from ssm_planner.problem.problem import Problem
    from ssm_planner.problem.robot import Robot
    from ssm_planner.typing import Array

BETWEEN = 4
"""Points taken of each smooth piece of a file."""
MOST = 20_000
"""Points of a path."""


def retime_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "path",
        type=Path,
        help="CSV (columns named with units), JointTrajectory (YAML or rosbag2), or folder of an export",
    )
    parser.add_argument("--robot", type=Path, help="robot file; needed unless --problem is given")
    parser.add_argument(
        "--problem", type=Path, help="problem file: its limits of the task, and its robot"
    )
    parser.add_argument(
        "--rate", type=rate_argument, metavar="HZ", help="rows per second of trajectory.csv"
    )
    output_arguments(parser, "result folder (default: results/<name of the file>_retimed)")


def run_retime(options: argparse.Namespace) -> int:
    progress = progress_reporter()
    progress(f"reading {options.path}")
    from ssm_planner.formats.read import read_trajectory
    from ssm_planner.loading.load import load_problem, load_robot
    from ssm_planner.pipeline.run import plan_to_folder
    from ssm_planner.publishing import file_name
    from ssm_planner.reporting.text import summary_lines

    if (options.robot is None) == (options.problem is None):
        raise ProblemError(
            "whose joints are these?", key="--robot", allowed="either --robot or --problem"
        )
    base = None if options.problem is None else load_problem(options.problem)
    robot = load_robot(options.robot) if base is None else base.robot
    reading = read_trajectory(options.path, robot)
    problem, off_lines = retimed_problem(reading, robot, base, f"{options.path.stem}_retimed")
    folder = options.output or Path("results") / file_name(problem.name)
    result, files = plan_to_folder(problem, folder, progress, rate=options.rate)
    progress("done")
    before = reading.trajectory.duration
    runs = (
        f"{len(problem.motion)} smooth runs, at rest between them"
        if len(problem.motion) > 1
        else "one smooth curve"
    )
    away = f"{np.degrees(off_lines[:3].max()):.3g} deg and {1e3 * off_lines[3]:.3g} mm from the lines between its points"
    lines = [
        f"the path       {runs}, at most {away}",
        f"in the file    {before:.4f} s, {reading.interpolation}",
        "",
    ]
    document = {**result.summary(), "files": {name: str(path) for name, path in files.items()}}
    document |= {
        "runs": len(problem.motion),
        "off_lines": off_lines.tolist(),
        "duration_in_file": before,
    }
    shown = [*lines, *summary_lines(result), *(("", f"Results: {folder}") if files else ())]
    show(options.json, document, lambda: shown)
    return OK if result.passed else FAILED


def retimed_problem(
    reading: Reading, robot: Robot, base: Problem | None, name: str
) -> tuple[Problem, Array]:
    """A problem along the path of a trajectory, and how far its curves go from the lines between the points, (4,).

    base: the problem whose limits of the task hold. Raises ProblemError for a path that goes nowhere or has too many points.
    """
    from ssm_planner.kinematics.mechanism import Mechanism
    from ssm_planner.planning.retiming.paths import SplinePath, smooth_runs
    from ssm_planner.problem.motion import Follow, Joints
    from ssm_planner.problem.problem import Problem

    trajectory, scale = reading.trajectory, np.array([joint.velocity for joint in robot.joints])
    count = 1 if reading.resolution is not None else BETWEEN
    if count * len(trajectory.breaks) > MOST:
        raise ProblemError(
            f"{len(trajectory.breaks)} points", key="path", allowed=f"at most {MOST // count}"
        )
    share = np.arange(count) / count
    times = (trajectory.breaks[:-1, None] + share * np.diff(trajectory.breaks)[:, None]).ravel()
    runs = smooth_runs(trajectory.sample(np.append(times, trajectory.breaks[-1])).q, scale)
    if not runs:
        raise ProblemError("this path goes nowhere", key="path")
    mechanism = Mechanism.from_geometry(robot.geometry)
    away = np.max([SplinePath(mechanism, run, scale).off_lines for run in runs], axis=0)
    points = [[Joints((a, b, c, d)) for a, b, c, d in run.tolist()] for run in runs]
    motion = tuple(
        Follow(run[-1], tuple(run[1:-1]), f"path {k}") for k, run in enumerate(points, 1)
    )
    start = points[0][0]
    problem = replace(
        base or Problem(robot, start, motion),
        name=name,
        start=start,
        motion=motion,
        planner="toppra",
        objective="time",
        duration=None,
        start_rate={},
        end_rate={},
    )
    return problem, away
