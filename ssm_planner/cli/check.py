"""Run `ssm-planner check TRAJECTORY`, which prints the certificate of any trajectory.

This module never imports the planner.
"""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import ssm_planner as ssm
from ssm_planner.cli.shared import (
    FAILED,
    OK,
    UNJUDGED,
    parse_option_quantity,
    parse_speed,
    print_result,
    progress_reporter,
)
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step
from ssm_planner.publishing import PLAN_FILE
from ssm_planner.typing import JsonObject

if TYPE_CHECKING:
    from ssm_planner.formats import Reading
    from ssm_planner.problem import Robot, TaskLimits

STATUS_OF_VERDICT = {"kept": OK, "violated": FAILED, "not judged": UNJUDGED}
"""Exit status of each verdict of a check."""
STATUS_OF_PROOF = {"PROVEN": OK, "REFUTED": FAILED, "OPEN": UNJUDGED}
"""Exit status of each verdict of a proof."""


def run_check(options: Namespace) -> int:
    """Check a trajectory, print its certificate, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0 if all limits are kept, 1 if one is violated, and 4 if one could not be
        judged.
    """
    progress = progress_reporter(f"reading {options.trajectory}")
    from ssm_planner.verification import with_task_results

    _check_proof_options(options)
    if options.key is not None:
        from ssm_planner.formats import signature_error

        fault = signature_error(options.trajectory, options.key)
        if fault is not None:
            document: JsonObject = {
                "trajectory": options.trajectory,
                "passed": False,
                "verdict": "violated",
                "reason": fault,
                "limits": [],
            }
            print_result(options, document, [f"check: FAILED: {fault}"])
            return FAILED
    reading, robot, limits = read_with_robot(options.trajectory, options.robot, options.problem)
    problem = ssm.load_problem(options.problem) if options.problem else None
    if options.tip_speed:
        limits = ssm.TipSpeed(options.tip_speed).on(limits)
    limits = reading.add_declared_rates(_with_declared_rates(options, limits))
    progress(Step("checking"))
    document = {
        "trajectory": options.trajectory,
        "robot": robot.name,
        "notes": list(reading.notes),
    }
    if options.speed is not None:
        return _run_speed_check(options, reading, robot, limits, document)
    certificate = reading.check(robot, limits)
    if problem is not None:
        certificate = with_task_results(
            certificate, reading.trajectory, replace(problem, robot=robot)
        )
    certificate = _allow_unjudged(certificate, options.allow_unjudged or "")
    document |= certificate.to_dict()
    lines = certificate_lines(certificate, reading.notes, robot)
    statuses = {STATUS_OF_VERDICT[certificate.verdict]}
    if options.proof:
        progress(Step("proving"))
        proofs = ssm.prove(options.trajectory, options.checker)
        document["proof"] = [proof.to_dict() for proof in proofs]
        lines += [""] + proof_lines(proofs)
        statuses |= {STATUS_OF_PROOF[proof.verdict] for proof in proofs}
    progress(Step("done"))
    print_result(options, document, lines)
    return next(status for status in (FAILED, UNJUDGED, OK) if status in statuses)


def _check_proof_options(options: Namespace) -> None:
    """Raise ProblemError if an option contradicts --proof.

    The proof uses the robot, the limits and the speed of a plan.json, so options that replace these
    are refused.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.
    """
    names = ("robot", "problem", "tip_speed", "start_rate", "end_rate", "speed")
    contradictions = [f"--{name.replace('_', '-')}" for name in names if getattr(options, name)]
    if options.proof and contradictions:
        raise ProblemError(
            "the proof uses the robot, the limits and the speed of the plan.json",
            key="--proof",
            allowed=f"without {', '.join(contradictions)}",
        )


def proof_lines(proofs: Sequence[ssm.Proof]) -> list[str]:
    """Return a table of the proven bounds of all limits, and the number of limits by verdict.

    Parameters
    ----------
    proofs : sequence of Proof
        Proof of each limit.

    Returns
    -------
    list of str
        Lines of text.
    """
    from ssm_planner.reporting import proof_table

    counts = dict.fromkeys(STATUS_OF_PROOF, 0)
    for proof in proofs:
        counts[proof.verdict] += 1
    verdicts = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    return proof_table(proofs).lines() + ["", f"proof for all times: {verdicts}"]


def _allow_unjudged(certificate: ssm.Certificate, text: str) -> ssm.Certificate:
    """Return a certificate in which some limits may remain unjudged.

    Parameters
    ----------
    certificate : Certificate
        Result of the check.
    text : str
        Value of the option --allow-unjudged: names of limits, or the last words of names, separated
        by commas.

    Returns
    -------
    Certificate
        Certificate whose verdict ignores that these limits could not be judged.

    Raises
    ------
    ProblemError
        If a name is unknown.
    """
    from ssm_planner.verification import ACCELERATION_DEPENDENT_LIMITS

    names = [name.strip() for name in text.split(",") if name.strip()]
    limit_names = set(ACCELERATION_DEPENDENT_LIMITS)
    limit_names |= {limit.name for limit in certificate.limits}
    limit_names |= {limit.name for limit in certificate.unjudged}
    for name in names:
        # The last words of a name stand for all names that end with them.
        if not any(f" {limit_name}".endswith(f" {name}") for limit_name in limit_names):
            raise ProblemError(
                "unknown limit",
                key="--allow-unjudged",
                value=name,
                allowed=", ".join(sorted(limit_names)),
            )
    return certificate.allowing(*names)


def _run_speed_check(
    options: Namespace,
    reading: "Reading",
    robot: "Robot",
    limits: "TaskLimits",
    document: JsonObject,
) -> int:
    """Check a motion at one lower speed or in a range of speeds, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Options of the command.
    reading : Reading
        Trajectory that was read.
    robot : Robot
        Robot that executes the motion.
    limits : TaskLimits
        Limits of the task.
    document : dict
        Beginning of the output of --json.

    Returns
    -------
    int
        Exit status: 0 if all limits are kept, 1 if one is violated, and 4 if one could not be
        judged.

    Raises
    ------
    ProblemError
        If the value of --speed is invalid, or if the trajectory consists of straight segments.
    """
    from ssm_planner.verification import check_slower, check_speeds

    if reading.resolution is not None:
        raise ProblemError(
            "the trajectory has straight segments", key="--speed", allowed="smooth motions"
        )
    low, dots, high = options.speed.partition("..")
    speed = parse_speed(low)
    lines = []
    if dots:
        if parse_speed(high) != 1.0:
            raise ProblemError(
                "the range must end at 100 %",
                key="--speed",
                value=options.speed,
                allowed="such as 1%..100%",
            )
        speeds = check_speeds(reading.trajectory, robot, limits, speed)
        speed, certificate = min(speeds.certificates, key=lambda pair: pair[1].worst.margin)
        lines = speed_lines(speeds)
        document["speeds"] = speeds.to_dict()
    else:
        certificate = check_slower(reading.trajectory, robot, limits, speed, reading.interpolation)
    document |= {"speed": speed, **certificate.to_dict()}
    remark = ", where a limit is nearest" if dots else ""
    lines.append(f"at {100 * speed:.4g} % of the speed{remark}:")
    lines += certificate_lines(certificate, reading.notes, robot)
    print_result(options, document, lines)
    return STATUS_OF_VERDICT[certificate.verdict]


def speed_lines(speeds: ssm.SpeedRange) -> list[str]:
    """Return a table that states at which speed each limit has its smallest margin.

    It contains the limits that a slower motion may violate, although the planned motion keeps them.

    Parameters
    ----------
    speeds : SpeedRange
        Results of the check at all speeds of a range.

    Returns
    -------
    list of str
        Lines of text.
    """
    from ssm_planner.display import format_number
    from ssm_planner.reporting import Table, limit_cells

    rows = []
    for result in speeds.worst:
        cells = limit_cells(result.found)
        rows.append(cells[:2] + (format_number(100 * result.speed, 4),) + cells[2:])
    header = "limit, joint, worst at % of the speed, worst, limit, unit, margin"
    table = Table(header, rows, (2, 3, 4, 6))
    heading = f"every speed from {100 * speeds.slowest:.4g} % to 100 %"
    return [heading, ""] + table.lines() + [""]


def read_with_robot(
    path: Path, robot_file: Path | None, problem_file: Path | None = None
) -> "tuple[Reading, Robot, ssm.TaskLimits]":
    """Read a trajectory file, and determine the robot and the limits for its check.

    A plan.json contains a robot and limits. A problem file overrides both. A robot file overrides
    the robot of the plan and of the problem file.

    Parameters
    ----------
    path : Path
        Trajectory file, or the folder of a plan or an export.
    robot_file, problem_file : Path, optional
        Files that override the robot, or the robot and the limits.

    Returns
    -------
    reading : Reading
        The trajectory with remarks.
    robot : Robot
        Robot that executes the motion.
    limits : TaskLimits
        Limits of the task.

    Raises
    ------
    TrajectoryError
        If the trajectory cannot be read, or if no file contains a robot.
    ProblemError
        If the robot or problem file is invalid.
    """
    from ssm_planner.formats import read_trajectory

    robot = limits = None
    if problem_file is not None:
        problem = ssm.load_problem(problem_file)
        robot, limits = problem.robot, problem.task_limits
    if robot_file is not None:
        robot = ssm.load_robot(robot_file)
    if path.suffix.lower() == ".json" or (path / PLAN_FILE).is_file():
        from ssm_planner.formats import Reading
        from ssm_planner.plans import load_plan

        plan = load_plan(path)
        notes = []
        if plan.uncertified_reason is not None:
            notes.append(f"the certificate in the file is invalid: {plan.uncertified_reason}")
        if limits is None:
            limits = plan.limits
        else:  # The plan declares the rates at both ends.
            start_rate = plan.limits.start_rate
            limits = replace(limits, start_rate=start_rate, end_rate=plan.limits.end_rate)
        if robot is None:
            robot = plan.robot
            notes.append(
                "robot and limits are those of the plan; --robot or --problem selects others"
            )
        else:
            limits = limits.within(robot)
            notes += plan.limit_differences(robot)
        reading = Reading(plan.motion, "quintic polynomial pieces", None, tuple(notes))
        return reading, robot, limits
    is_sample = path.name == "trajectory.csv" and (path.parent / PLAN_FILE).is_file()
    advice = (
        f"it samples the plan beside it: use `ssm-planner check {path.parent}`; a table that keeps "
        f"the limits between its rows: `ssm-planner export {path.parent} --to csv`"
    )
    if robot is None:
        reason = "no such file or folder"
        if path.exists():
            reason = "the file does not name a robot"
            if path.is_dir():
                reason = f"no {PLAN_FILE} in this folder"
            reason += ": give --robot ROBOT.yaml or --problem PROBLEM.yaml"
        if is_sample:
            reason += f"; {advice}"
        raise ssm.TrajectoryError(f"{path}: {reason}")
    limits = ssm.TaskLimits(robot.limits) if limits is None else limits.within(robot)
    reading = read_trajectory(path, robot)
    if is_sample:
        reading = replace(reading, notes=(advice,) + reading.notes)
    return reading, robot, limits


def _with_declared_rates(options: Namespace, limits: "TaskLimits") -> "TaskLimits":
    """Replace the rates at both ends of a motion by those of --start-rate and --end-rate.

    A rate is the velocity of a task coordinate. Without an option, the limits keep their rate.
    """
    if options.start_rate is not None:
        limits = replace(limits, start_rate=_parse_rates("--start-rate", options.start_rate))
    if options.end_rate is not None:
        limits = replace(limits, end_rate=_parse_rates("--end-rate", options.end_rate))
    return limits


def _parse_rates(option: str, text: str) -> dict[str, float] | None:
    """Parse the value of the option --start-rate or --end-rate.

    Parameters
    ----------
    option : str
        Name of the option, for messages.
    text : str
        Value of the option, such as "tilt=-10deg/s,depth=5mm/s".

    Returns
    -------
    dict or None
        Rates in rad/s or m/s by task coordinate. None if the option permits any rate.

    Raises
    ------
    ProblemError
        If the text is invalid.
    """
    from ssm_planner.problem import TASK_COORDINATES

    if text.strip() == "any":
        return None
    rates = {}
    for entry in map(str.strip, text.split(",")):
        name, _, value = entry.partition("=")
        name = name.strip()
        if name not in TASK_COORDINATES or name in rates:
            allowed = f"any, or {', '.join(TASK_COORDINATES)}"
            raise ProblemError(
                "unknown or repeated coordinate", key=option, value=entry, allowed=allowed
            )
        quantity_kind = "velocity" if name == "depth" else "angular_velocity"
        rates[name] = parse_option_quantity(option, value.strip(), quantity_kind, entry)
    return rates


def certificate_lines(
    certificate: ssm.Certificate, notes: tuple[str, ...], robot: "Robot"
) -> list[str]:
    """Format a certificate as lines of text: a table of the limits, remarks and the verdict.

    Parameters
    ----------
    certificate : Certificate
        Result of the check.
    notes : tuple of str
        Remarks on the trajectory file.
    robot : Robot
        Robot that executes the motion.

    Returns
    -------
    list of str
        Lines of text. The table begins with the limit that has the smallest margin. It states the
        worst value, the bound, the margin, the joint and the time of each limit.
    """
    from ssm_planner.reporting import limits_table
    from ssm_planner.verification import describe_unjudged

    count = len(certificate.limits)
    violation_count = len(certificate.violations)
    verdict = f"PASSED: {count} limits kept"
    if certificate.unjudged:
        names = ",".join(dict.fromkeys(limit.name for limit in certificate.unjudged))
        verdict = f"NOT JUDGED: no limit exceeded, but see above (--allow-unjudged {names!r})"
    if violation_count:
        verdict = f"FAILED: {violation_count} of {count} limits exceeded"
    lines = [
        f"robot {robot.name}; {certificate.interpolation}; {certificate.instants} instants and "
        "exact extremes",
        "",
    ]
    lines += limits_table(certificate.limits).lines() + [""]
    lines += [f"note: {note}" for note in notes]
    lines += [f"not checked: {name}" for name in certificate.unchecked]
    for subject, reason in describe_unjudged(certificate.unjudged):
        lines.append(f"not judged: {subject}: {reason}")
    lines.append(f"check: {verdict}")
    return lines
