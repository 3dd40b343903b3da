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
    part_quantity,
    progress_reporter,
    share,
    show,
)
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step
from ssm_planner.typing import JsonObject, Keywords

if TYPE_CHECKING:
    from ssm_planner.formats import Reading
    from ssm_planner.problem import Robot, TaskLimits

PLAN_FILE = "plan.json"
STATUS = {"kept": OK, "violated": FAILED, "not judged": UNJUDGED}
PROVEN_STATUS = {"PROVEN": OK, "REFUTED": FAILED, "OPEN": UNJUDGED}
"""Exit status of each verdict of a proof."""


def run_check(options: Namespace) -> int:
    """Check a trajectory, print its certificate, and return the exit status."""
    progress = progress_reporter(f"reading {options.trajectory}")
    document: JsonObject
    from ssm_planner.verification import with_task

    _check_proof_options(options)
    if options.key is not None and (fault := _signature_fault(options.trajectory, options.key)):
        refused = {"passed": False, "verdict": "violated", "reason": fault, "limits": []}
        document = {"trajectory": options.trajectory, **refused}
        show(options.json, document, lambda: [f"check: FAILED: {fault}"])
        return FAILED
    reading, robot, limits = read(options.trajectory, options.robot, options.problem)
    problem = ssm.load_problem(options.problem) if options.problem else None
    if options.tip_speed:
        limits = ssm.TipSpeed(options.tip_speed).on(limits)
    limits = reading.ends_on(_declared(options, limits))
    progress(Step("checking"))
    document = {
        "trajectory": options.trajectory,
        "robot": robot.name,
        "notes": list(reading.notes),
    }
    if options.speed is not None:
        return _check_speeds(options, reading, robot, limits, document)
    certificate = reading.check(robot, limits)
    if problem is not None:
        certificate = with_task(certificate, reading.trajectory, replace(problem, robot=robot))
    certificate = _allowing(certificate, options.allow_unjudged or "")
    document |= certificate.to_dict()
    if not options.proof:
        progress(Step("done"))
        show(options.json, document, lambda: certificate_lines(certificate, reading.notes, robot))
        return STATUS[certificate.verdict]
    progress(Step("proving"))
    proofs = ssm.prove(options.trajectory, options.checker)
    progress(Step("done"))
    document["proof"] = [proof.to_dict() for proof in proofs]
    show(
        options.json,
        document,
        lambda: [*certificate_lines(certificate, reading.notes, robot), "", *proof_lines(proofs)],
    )
    verdicts = {STATUS[certificate.verdict], *(PROVEN_STATUS[proof.verdict] for proof in proofs)}
    return next(status for status in (FAILED, UNJUDGED, OK) if status in verdicts)


def _check_proof_options(options: Namespace) -> None:
    """Raise ProblemError if an option contradicts --proof, or if --checker is given without it.

    The proof uses the robot, the limits and the speed of a plan.json.
    """
    if not options.proof:
        if options.checker is not None:
            raise ProblemError("--checker needs --proof", key="--checker")
        return
    others = ("robot", "problem", "tip_speed", "start_rate", "end_rate", "speed")
    given = [f"--{name.replace('_', '-')}" for name in others if getattr(options, name)]
    if given:
        raise ProblemError(
            "the proof uses the robot, the limits and the speed of the plan.json",
            key="--proof",
            allowed=f"without {', '.join(given)}",
        )


def proof_lines(proofs: Sequence[ssm.Proof]) -> list[str]:
    """Return a table of the bounds of all limits, and the verdict, as lines of text."""
    from ssm_planner.reporting import proof_table

    counts = {name: sum(proof.verdict == name for proof in proofs) for name in PROVEN_STATUS}
    words = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    return [*proof_table(proofs).lines(), "", f"proof for all times: {words}"]


def _signature_fault(folder: Path, key: Path) -> str | None:
    """Return the reason why a folder is not an export that was signed with a key, or None."""
    from ssm_planner.formats import read_manifest, signature_fault

    try:
        return signature_fault(folder, read_manifest(folder), key)
    except ssm.TrajectoryError as error:
        return str(error)


def _allowing(certificate: ssm.Certificate, text: str) -> ssm.Certificate:
    """Return the certificate with the limits that may remain unjudged (option --allow-unjudged).

    `text` contains their names, separated by commas. Raises ProblemError for an unknown name.
    """
    from ssm_planner.verification import DYNAMIC

    names = [name.strip() for name in text.split(",") if name.strip()]
    known = {*DYNAMIC, *(limit.name for limit in certificate.limits)}
    known.update(limit.name for limit in certificate.unjudged)
    for name in names:
        if not any(f" {limit}".endswith(f" {name}") for limit in known):
            raise ProblemError(
                "unknown limit",
                key="--allow-unjudged",
                value=name,
                allowed=", ".join(sorted(known)),
            )
    return certificate.allowing(*names)


def _check_speeds(
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

    Raises
    ------
    ProblemError
        If the option --speed or the trajectory does not permit such a check.
    """
    from ssm_planner.verification import check_slower, check_speeds

    if reading.resolution is not None:
        raise ProblemError(
            "the trajectory has straight segments", key="--speed", allowed="smooth motions"
        )
    slowest, dots, fastest = options.speed.partition("..")
    speed, lines = share(slowest), []
    if dots:
        if share(fastest) != 1.0:
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
    heading = f"at {100 * speed:.4g} % of the speed{remark}:"
    show(
        options.json,
        document,
        lambda: [*lines, heading, *certificate_lines(certificate, reading.notes, robot)],
    )
    return STATUS[certificate.verdict]


def speed_lines(speeds: ssm.SpeedRange) -> list[str]:
    """Return a table of the speeds at which each limit is nearest, as lines of text.

    It contains the limits that a slower motion may violate.
    """
    from ssm_planner.display import number
    from ssm_planner.reporting import Table, limit_cells

    rows = []
    for result in speeds.worst:
        name, joint, *values = limit_cells(result.found)
        rows.append((name, joint, number(100 * result.speed, 4), *values))
    header = "limit, joint, worst at % of the speed, worst, limit, unit, margin"
    return [
        f"every speed from {100 * speeds.slowest:.4g} % to 100 %",
        "",
        *Table(header, rows, (2, 3, 4, 6)).lines(),
        "",
    ]


def read(
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
        if robot is None:
            notes.append(
                "robot and limits are those of the plan; --robot or --problem selects others"
            )
        else:
            notes += plan.limit_differences(robot)
        reading = Reading(plan.motion, "quintic polynomial pieces", None, tuple(notes))
        # The plan declares the rates at both ends.
        declared = {name: getattr(plan.limits, name) for name in ("start_rate", "end_rate")}
        limits = plan.limits if limits is None else replace(limits, **declared)
        return reading, robot or plan.robot, limits if robot is None else limits.within(robot)
    sampled = path.name == "trajectory.csv" and (path.parent / PLAN_FILE).is_file()
    advice = (
        f"it samples the plan beside it: use `ssm-planner check {path.parent}`; a table that keeps "
        f"the limits between its rows: `ssm-planner export {path.parent} --to csv`"
    )
    if robot is None:
        reason = "no such file or folder"
        if path.exists():
            reason = (
                "the file does not name a robot: give --robot ROBOT.yaml or --problem PROBLEM.yaml"
            )
        raise ssm.TrajectoryError(f"{path}: {reason}{f'; {advice}' if sampled else ''}")
    limits = ssm.TaskLimits(robot.limits) if limits is None else limits.within(robot)
    reading = read_trajectory(path, robot)
    if sampled:
        reading = replace(reading, notes=(advice, *reading.notes))
    return reading, robot, limits


def _declared(options: Namespace, limits: "TaskLimits") -> "TaskLimits":
    """Return the limits with the rates at both ends that the options declare.

    Raises ProblemError if a rate is invalid.
    """
    changes: Keywords = {}
    for end in ("start", "end"):
        if (text := getattr(options, f"{end}_rate")) is not None:
            changes[f"{end}_rate"] = _rates(f"--{end}-rate", text)
    return replace(limits, **changes)


def _rates(option: str, text: str) -> dict[str, float] | None:
    """Parse the value of the option --start-rate or --end-rate.

    Returns
    -------
    dict or None
        Rates in rad/s or m/s by task coordinate. None if the option permits any rate.

    Raises
    ------
    ProblemError
        If the text is invalid.
    """
    from ssm_planner.problem import TASK

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


def certificate_lines(
    certificate: ssm.Certificate, notes: tuple[str, ...], robot: "Robot"
) -> list[str]:
    """Return a certificate as lines of text: a table of the limits, remarks and the verdict.

    The limit with the smallest margin is first. Each row of the table states the worst value, the
    bound, the margin, the joint and the time.
    """
    from ssm_planner.reporting import limits_table
    from ssm_planner.verification import subjects

    count, broken = len(certificate.limits), len(certificate.violations)
    verdict = f"PASSED: {count} limits kept"
    unjudged = subjects(certificate.unjudged)
    if unjudged:
        names = ",".join(dict.fromkeys(line.name for line in certificate.unjudged))
        verdict = f"NOT JUDGED: no limit exceeded, but see above (--allow-unjudged {names!r})"
    if broken:
        verdict = f"FAILED: {broken} of {count} limits exceeded"
    return [
        f"robot {robot.name}; {certificate.interpolation}; {certificate.instants} instants and "
        "exact extremes",
        "",
        *limits_table(certificate.limits).lines(),
        "",
        *(f"note: {note}" for note in notes),
        *(f"not checked: {name}" for name in certificate.unchecked),
        *(f"not judged: {subject}: {reason}" for subject, reason in unjudged),
        f"check: {verdict}",
    ]
