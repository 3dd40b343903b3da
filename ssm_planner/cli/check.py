"""`ssm-planner check TRAJECTORY`: the certificate of anybody's trajectory. It never imports the planner."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ssm_planner.cli.shared import (
    FAILED,
    OK,
    output_arguments,
    part_quantity,
    progress_reporter,
    quantity_argument,
    show,
)
from ssm_planner.errors import ProblemError

if TYPE_CHECKING:
    from ssm_planner.formats.points import Reading
    from ssm_planner.problem.problem import TaskLimits
    from ssm_planner.problem.robot import Robot
    from ssm_planner.verification.certificate import Certificate


def check_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "trajectory",
        type=Path,
        help="plan.json, a CSV (columns named with units), a JointTrajectory (YAML or rosbag2), or an export folder",
    )
    parser.add_argument("--robot", type=Path, help="robot file; needed unless the trajectory is a plan.json")
    parser.add_argument(
        "--problem", type=Path, help="problem file: its limits of the task, and its robot unless --robot is given"
    )
    parser.add_argument("--tip-speed", type=quantity_argument("velocity"), help="limit of the tool tip's speed")
    for end in ("start", "end"):
        parser.add_argument(
            f"--{end}-rate",
            metavar="RATES",
            help=f"speeds that the motion {end}s with, such as tilt=-10deg/s,depth=5mm/s, or any; default: as the plan, "
            "the problem or the export declares, else at rest",
        )
    output_arguments(parser)


def run_check(options: argparse.Namespace) -> int:
    progress = progress_reporter()
    progress(f"reading {options.trajectory}")
    from ssm_planner.problem.limits import TipSpeed
    from ssm_planner.verification.check import check

    reading, robot, limits = read(options.trajectory, options.robot, options.problem)
    if options.tip_speed:
        limits = TipSpeed(options.tip_speed).on(limits)
    limits = reading.ends_on(_declared(options, limits))
    progress("checking")
    certificate = check(
        reading.trajectory,
        robot,
        limits,
        interpolation=reading.interpolation,
        resolution=reading.resolution,
    ).with_more(reading.checks)
    progress("done")
    document = {"trajectory": str(options.trajectory), "robot": robot.name, "notes": list(reading.notes)}
    document |= certificate.to_dict()
    show(options.json, document, lambda: certificate_lines(certificate, reading.notes, robot))
    return OK if certificate.passed else FAILED


def read(path: Path, robot_file: Path | None, problem_file: Path | None = None) -> tuple[Reading, Robot, TaskLimits]:
    """(trajectory, robot, limits of the task) of a file.

    A plan.json brings its own robot and limits; those of a problem file come first, a robot file before both. Raises
    TrajectoryError or ProblemError.
    """
    from ssm_planner.errors import TrajectoryError
    from ssm_planner.formats.read import read_trajectory
    from ssm_planner.loading.load import load_problem, load_robot
    from ssm_planner.problem.problem import TaskLimits

    problem = None if problem_file is None else load_problem(problem_file)
    robot = load_robot(robot_file) if robot_file is not None else None if problem is None else problem.robot
    limits = None if problem is None else problem.task_limits
    if path.suffix.lower() == ".json":
        from ssm_planner.formats.points import Reading
        from ssm_planner.plans import load_plan

        plan = load_plan(path)
        notes = [] if plan.doubt is None else [f"the certificate in the file does not hold: {plan.doubt}"]
        if robot is None:
            notes.append("robot and limits are the plan's own: give --robot or --problem to hold it against others")
        else:
            notes += plan.limits_unlike(robot)
        reading = Reading(plan.motion, "quintic polynomial pieces", None, tuple(notes))
        # the rates at both ends are the plan's to declare
        start, end = plan.limits.start_rate, plan.limits.end_rate
        limits = plan.limits if limits is None else replace(limits, start_rate=start, end_rate=end)
        return reading, robot or plan.robot, limits if robot is None else limits.within(robot)
    if robot is None:
        raise TrajectoryError(
            f"{path}: does not say which robot it is for: give --robot ROBOT.yaml or --problem PROBLEM.yaml"
        )
    limits = TaskLimits(robot.limits) if limits is None else limits.within(robot)
    return read_trajectory(path, robot), robot, limits


def _declared(options: argparse.Namespace, limits: TaskLimits) -> TaskLimits:
    """The limits with the rates at both ends that the caller declares. Raises ProblemError."""
    if options.start_rate is not None:
        limits = replace(limits, start_rate=_rates("--start-rate", options.start_rate))
    if options.end_rate is not None:
        limits = replace(limits, end_rate=_rates("--end-rate", options.end_rate))
    return limits


def _rates(option: str, text: str) -> dict[str, float] | None:
    """Rates by task coordinate; None for any. Raises ProblemError."""
    from ssm_planner.problem.limits import TASK

    if text.strip() == "any":
        return None
    rates = {}
    for word in text.split(","):
        name, _, value = (part.strip() for part in word.partition("="))
        if name not in TASK:
            allowed = f"any, or {', '.join(TASK)}"
            raise ProblemError("no task coordinate", key=option, value=word.strip(), allowed=allowed)
        kind = "velocity" if name == "depth" else "angular_velocity"
        rates[name] = part_quantity(option, value, kind, whole=word.strip())
    return rates


def certificate_lines(certificate: Certificate, notes: tuple[str, ...], robot: Robot) -> list[str]:
    """The certificate as text: worst value, limit, margin, joint and time of every limit, worst first."""
    from ssm_planner.reporting.text import limits_table

    lines = [f"robot {robot.name}; {certificate.interpolation}; {certificate.instants} instants and exact extremes", ""]
    lines += limits_table(certificate.limits).lines()
    lines += ["", *(f"note: {note}" for note in notes), *(f"not checked: {what}" for what in certificate.unchecked)]
    verdict = "PASSED" if certificate.passed else f"FAILED: {len(certificate.violations)} limits exceeded"
    return [*lines, f"check: {verdict}"]
