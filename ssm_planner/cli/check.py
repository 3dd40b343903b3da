"""`ssm-planner check TRAJECTORY`: the certificate of any trajectory.

It never imports the planner.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ssm_planner.cli.shared import (
    FAILED,
    OK,
    output_arguments,
    part_quantity,
    progress_reporter,
    quantity_argument,
    share,
    show,
)
from ssm_planner.errors import ProblemError

if TYPE_CHECKING:
    from ssm_planner.formats.points import Reading
    from ssm_planner.problem.problem import TaskLimits
    from ssm_planner.problem.robot import Robot
    from ssm_planner.verification.certificate import Certificate
    from ssm_planner.verification.slower import SpeedRange

PLAN_FILE = "plan.json"


def check_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "trajectory",
        type=Path,
        help="plan.json, CSV (columns named with units), JointTrajectory (YAML or rosbag2), or "
        "folder of a plan or export",
    )
    parser.add_argument(
        "--robot", type=Path, help="robot file; needed unless the trajectory is a plan.json"
    )
    parser.add_argument(
        "--problem",
        type=Path,
        help="problem file with task limits, and with the robot unless --robot is given",
    )
    parser.add_argument(
        "--tip-speed", type=quantity_argument("velocity"), help="limit of the tool tip's speed"
    )
    for end in ("start", "end"):
        parser.add_argument(
            f"--{end}-rate",
            metavar="RATES",
            help=f"speeds at the {end} of the motion, such as tilt=-10deg/s,depth=5mm/s, or any; "
            "default: as the plan, the problem or the export declares, else at rest",
        )
    parser.add_argument(
        "--speed",
        metavar="PERCENT",
        help="playback speed such as 10%%, or a range of speeds such as 1%%..100%%",
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
    if options.speed is not None:
        return _check_speeds(options, reading, robot, limits)
    certificate = check(
        reading.trajectory,
        robot,
        limits,
        interpolation=reading.interpolation,
        resolution=reading.resolution,
    ).with_more(reading.checks)
    progress("done")
    document = {
        "trajectory": str(options.trajectory),
        "robot": robot.name,
        "notes": list(reading.notes),
    }
    document |= certificate.to_dict()
    show(options.json, document, lambda: certificate_lines(certificate, reading.notes, robot))
    return OK if certificate.passed else FAILED


def _check_speeds(
    options: argparse.Namespace, reading: Reading, robot: Robot, limits: TaskLimits
) -> int:
    """Check the motion at one lower speed or at all speeds of a range, and return the exit status.

    Raises ProblemError.
    """
    from ssm_planner.verification.slower import check_slower, check_speeds

    if reading.resolution is not None:
        raise ProblemError(
            "the trajectory has straight segments", key="--speed", allowed="smooth motions"
        )
    slowest, dots, fastest = options.speed.partition("..")
    document: dict[str, Any] = {
        "trajectory": str(options.trajectory),
        "robot": robot.name,
        "notes": list(reading.notes),
    }
    speed, lines = share(slowest), []
    if dots:
        if share(fastest) != 1.0:
            raise ProblemError(
                "the range must end at 100 %",
                key="--speed",
                value=options.speed,
                allowed="such as 1%..100%",
            )
        found = check_speeds(reading.trajectory, robot, limits, speed)
        certificate = min(
            (each for _, each in found.certificates), key=lambda each: each.worst.margin
        )
        speed = next(factor for factor, each in found.certificates if each is certificate)
        lines = speed_lines(found)
        document["speeds"] = found.to_dict()
    else:
        certificate = check_slower(reading.trajectory, robot, limits, speed, reading.interpolation)
    document |= {"speed": speed, **certificate.to_dict()}
    heading = f"at {100 * speed:.4g} % of the speed{', where a limit is nearest' if dots else ''}:"
    show(
        options.json,
        document,
        lambda: [*lines, heading, *certificate_lines(certificate, reading.notes, robot)],
    )
    return OK if certificate.passed else FAILED


def speed_lines(speeds: SpeedRange) -> list[str]:
    """Return text with the worst speed of every limit that a slower motion may violate."""
    from ssm_planner.display import number
    from ssm_planner.reporting.text import Table, limit_cells

    rows = []
    for each in speeds.worst:
        cells = limit_cells(each.found)
        rows.append((*cells[:2], number(100 * each.speed, 4), *cells[2:]))
    header = ("limit", "joint", "worst at % of the speed", "worst", "limit", "unit", "margin")
    return [
        f"every speed from {100 * speeds.slowest:.4g} % to 100 %",
        "",
        *Table(header, rows, (2, 3, 4, 6)).lines(),
        "",
    ]


def read(
    path: Path, robot_file: Path | None, problem_file: Path | None = None
) -> tuple[Reading, Robot, TaskLimits]:
    """Return trajectory, robot and task limits of a file.

    A plan.json contains its own robot and limits. A problem file overrides both, and a robot file
    overrides the robots of both. Raises TrajectoryError or ProblemError.
    """
    from ssm_planner.errors import TrajectoryError
    from ssm_planner.formats.read import read_trajectory
    from ssm_planner.loading.load import load_problem, load_robot
    from ssm_planner.problem.problem import TaskLimits

    problem = None if problem_file is None else load_problem(problem_file)
    robot = (
        load_robot(robot_file)
        if robot_file is not None
        else None
        if problem is None
        else problem.robot
    )
    limits = None if problem is None else problem.task_limits
    if path.suffix.lower() == ".json" or (path / PLAN_FILE).is_file():
        from ssm_planner.formats.points import Reading
        from ssm_planner.plans import load_plan

        plan = load_plan(path)
        notes = (
            []
            if plan.uncertified_reason is None
            else [f"the certificate in the file is invalid: {plan.uncertified_reason}"]
        )
        if robot is None:
            notes.append(
                "robot and limits are those of the plan; --robot or --problem selects others"
            )
        else:
            notes += plan.limit_differences(robot)
        reading = Reading(plan.motion, "quintic polynomial pieces", None, tuple(notes))
        # the plan declares the rates at both ends and the path
        own = {name: getattr(plan.limits, name) for name in ("start_rate", "end_rate", "motion")}
        limits = plan.limits if limits is None else replace(limits, **own)
        return reading, robot or plan.robot, limits if robot is None else limits.within(robot)
    beside = path.parent / PLAN_FILE
    sampled = path.name == "trajectory.csv" and beside.is_file()
    instead = (
        f"it samples the plan beside it: use `ssm-planner check {path.parent}`; a table that keeps "
        f"the limits between its rows: `ssm-planner export {path.parent} --to csv`"
    )
    if robot is None:
        reason = (
            "the file does not name a robot: give --robot ROBOT.yaml or --problem PROBLEM.yaml"
            if path.exists()
            else "no such file or folder"
        )
        raise TrajectoryError(f"{path}: {reason}{f'; {instead}' if sampled else ''}")
    limits = TaskLimits(robot.limits) if limits is None else limits.within(robot)
    reading = read_trajectory(path, robot)
    return replace(reading, notes=(instead, *reading.notes)) if sampled else reading, robot, limits


def _declared(options: argparse.Namespace, limits: TaskLimits) -> TaskLimits:
    """Return the limits with the rates at both ends that the options declare.

    Raises ProblemError.
    """
    if options.start_rate is not None:
        limits = replace(limits, start_rate=_rates("--start-rate", options.start_rate))
    if options.end_rate is not None:
        limits = replace(limits, end_rate=_rates("--end-rate", options.end_rate))
    return limits


def _rates(option: str, text: str) -> dict[str, float] | None:
    """Return rates by task coordinate, or None for any rate. Raises ProblemError."""
    from ssm_planner.problem.limits import TASK

    if text.strip() == "any":
        return None
    rates = {}
    for word in text.split(","):
        name, _, value = (part.strip() for part in word.partition("="))
        if name not in TASK:
            allowed = f"any, or {', '.join(TASK)}"
            raise ProblemError(
                "unknown task coordinate", key=option, value=word.strip(), allowed=allowed
            )
        kind = "velocity" if name == "depth" else "angular_velocity"
        rates[name] = part_quantity(option, value, kind, whole=word.strip())
    return rates


def certificate_lines(certificate: Certificate, notes: tuple[str, ...], robot: Robot) -> list[str]:
    """Return the certificate as text: the limits, worst first, and the verdict.

    Every limit has its worst value, bound, margin, joint and time.
    """
    from ssm_planner.reporting.text import limits_table

    count, broken = len(certificate.limits), len(certificate.violations)
    verdict = (
        f"FAILED: {broken} of {count} limits exceeded" if broken else f"PASSED: {count} limits kept"
    )
    how = f"robot {robot.name}; {certificate.interpolation}; {certificate.instants} instants and exact extremes"
    lines = [how, ""]
    lines += limits_table(certificate.limits).lines()
    return [
        *lines,
        "",
        *(f"note: {note}" for note in notes),
        *(f"not checked: {what}" for what in certificate.unchecked),
        f"check: {verdict}",
    ]
