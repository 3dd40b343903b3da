"""Run `ssm-planner size PLAN`.

The command computes what a motion requires of motors and gears, and assesses candidate motors.
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
    print_result_with_page,
    progress_reporter,
    write_results,
)
from ssm_planner.errors import ProblemError, TrajectoryError
from ssm_planner.progress import Step
from ssm_planner.typing import Files, JsonObject

if TYPE_CHECKING:
    from ssm_planner.sizing import Conditions, DutyCycle, Sizing


def run_size(options: Namespace) -> int:
    """Size the motors and gears of a motion, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 1 if a motor or gear does not suffice, and 0 otherwise.
    """
    progress = progress_reporter(f"reading {options.plan}")
    from ssm_planner.reporting import sizing_lines, sizing_verdict_lines, what_if_lines
    from ssm_planner.sizing.size import size

    duty = read_duty(options.plan, options.robot)
    conditions = _conditions_from_options(options, duty)
    if options.catalogue is not None:
        return _run_selection(options, duty, conditions)
    candidates = read_candidates(options.motor, duty)
    progress(Step("judging motors"))
    sizing = size(duty, candidates, conditions, options.payload)
    document: JsonObject = {"motion": duty.name, **sizing.to_dict(), "notes": list(duty.notes)}
    lines: list[object] = [duty.name, *duty.notes, "", *sizing_lines(sizing)]
    if options.what_if:
        from ssm_planner.sizing import largest_payload, shortest_duration

        progress(Step("what if"))
        motors = selected_motors(sizing)
        payload = largest_payload(duty, motors, conditions, options.payload)
        duration = shortest_duration(duty, motors, conditions, options.payload)
        document["what_if"] = {
            "largest_payload": payload.to_dict(),
            "shortest_duration": duration.to_dict(),
        }
        lines += ["", "What if"]
        lines += [f"  {line}" for line in what_if_lines(payload, duration)]

    def write(folder: Path) -> Files:
        """Write the figures of the sizing into a folder, and return their paths."""
        from ssm_planner.reporting import write_sizing_figures

        return write_sizing_figures(sizing, folder)

    document["files"] = write_results(options.output, "sizing", document, write)
    progress(Step("done"))
    files = document["files"].values()
    lines += [f"file: {path}" for path in files] + sizing_verdict_lines(sizing)
    print_result_with_page(options, "sizing", document, lines, files)
    return FAILED if sizing.adequate is False else OK


MAX_PAIRS = 10
"""Largest number of pairs of motor and gear that the output lists for each joint."""


def _run_selection(options: Namespace, duty: "DutyCycle", conditions: "Conditions") -> int:
    """Judge all pairs of motors and gears of catalogues, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.
    duty : DutyCycle
        Motion for which the motors are selected.
    conditions : Conditions
        Operating conditions of the motors.

    Returns
    -------
    int
        Exit status: 1 if no pair suffices for a joint, and 0 otherwise.

    Raises
    ------
    ProblemError
        If a catalogue is invalid, or if an option is not allowed.
    """
    from ssm_planner.loading import CatalogueEntry, drives_with_gears, read_gearheads, read_motors
    from ssm_planner.reporting import VERDICT_LABELS, selection_lines
    from ssm_planner.sizing import select_motors

    if options.motor or options.what_if:
        raise ProblemError(
            "not allowed with --catalogue",
            key="--motor" if options.motor else "--what-if",
            allowed="--catalogue, with --gears, --rank and conditions",
        )
    motors = read_motors(options.catalogue)
    gears: dict[str, list[CatalogueEntry[ssm.Drive]]] = {}
    for joint in duty.robot.joints:
        if joint.drive is not None:
            stroke = joint.position[1] - joint.position[0]
            gears[joint.name] = []
            for path in options.gears:
                gears[joint.name] += drives_with_gears(path, joint.drive, stroke)
    gearheads = [gearhead for path in options.gearheads for gearhead in read_gearheads(path)]
    progress_reporter(f"judging {len(motors)} motors")
    joints = select_motors(duty, motors, gears, conditions, options.payload, gearheads=gearheads)
    # The best pair of a joint gives its answer: 1 (suffices), 0 (not known) or −1 (does not). The
    # smallest answer of all joints counts.
    smallest_answer = min((int(joint.adequate.max()) for joint in joints), default=0)
    adequate = {1: True, 0: None, -1: False}[smallest_answer]
    notes = list(duty.notes)
    if options.gears:
        notes.append("gears without friction get the friction of the joint's present drive")
    notes += [
        f"motor {motor.label}: placeholder figures ({', '.join(motor.of.placeholders)}), so its "
        "answer is not known"
        for motor in motors
        if motor.of.placeholder
    ]
    if any(gearhead.of.placeholder for gearhead in gearheads):
        notes.append("gearheads with placeholder figures: the answer of their chains is not known")
    document: JsonObject = {
        "motion": duty.name,
        "adequate": adequate,
        "confidence": conditions.confidence,
        "selection": [joint.to_dict(options.rank or "mass", MAX_PAIRS) for joint in joints],
        "notes": notes,
    }
    document["files"] = write_results(options.output, "selection", document, lambda folder: {})
    lines: list[object] = [duty.name, *document["notes"], *selection_lines(document["selection"])]
    lines += [f"file: {path}" for path in document["files"].values()]
    lines.append(f"every joint has a suitable motor: {VERDICT_LABELS[adequate]}")
    print_result_with_page(options, "selection", document, lines, document["files"].values())
    return FAILED if adequate is False else OK


def read_duty(path: Path, robot_file: Path | None = None) -> "DutyCycle":
    """Read the duty cycle for which motors are sized.

    Parameters
    ----------
    path : Path
        plan.json, motorisation file, or any trajectory file if `robot_file` is given.
    robot_file : Path, optional
        File of the robot that performs a trajectory.

    Returns
    -------
    DutyCycle
        Motions, robot, pause and remarks.

    Raises
    ------
    TrajectoryError
        If the trajectory cannot be read, or if no file contains a robot.
    ProblemError
        If the motorisation or robot file is invalid.
    """
    from ssm_planner.sizing import DutyCycle, pause_after_motion

    if robot_file is not None:
        from ssm_planner.formats import read_trajectory
        from ssm_planner.loading import load_robot

        robot = load_robot(robot_file)
        reading = read_trajectory(path, robot)
        notes = reading.notes
        if reading.resolution is not None:
            notes += (f"{path} has no accelerations at some points, so inertia is incomplete",)
        return DutyCycle(str(path), robot, ((reading.trajectory, None),), notes)
    if path.suffix.lower() in (".yaml", ".yml"):
        from ssm_planner.loading import load_motorisation

        return DutyCycle.of_motorisation(load_motorisation(path))
    if path.suffix.lower() not in ("", ".json"):
        raise TrajectoryError(f"{path}: this file does not contain a robot; pass --robot ROBOT")

    plan = ssm.load_plan(path)
    duty = DutyCycle.of_trajectory(plan.motion, plan.robot, str(path))
    if plan.certificate is None:
        reason = plan.uncertified_reason or "the plan has no certificate"
        duty = replace(duty, notes=duty.notes + (f"not certified: {reason}",))
    return replace(duty, pause=pause_after_motion(plan.problem))


def read_candidates(texts: Sequence[str], duty: "DutyCycle") -> dict[str, list[ssm.Motor]]:
    """Load the candidate motors that the option --motor names.

    Parameters
    ----------
    texts : sequence of str
        Values `[JOINT=]FILE` of the option. A file without a joint applies to all driven joints
        that the motion moves.
    duty : DutyCycle
        Motion for which the motors are sized.

    Returns
    -------
    dict
        Candidate motors by joint.

    Raises
    ------
    ProblemError
        If a joint is unknown or a file is invalid.
    """
    from ssm_planner.problem import JOINTS

    moving = {joint for _, joint in duty.runs}  # None stands for all joints.
    driven = [joint.name for joint in duty.robot.joints if joint.drive is not None]
    defaults = [name for name in driven if None in moving or name in moving]
    candidates: dict[str, list[ssm.Motor]] = {}
    for text in texts:
        joint, equals, file = text.partition("=")
        if equals and "/" not in joint and not Path(text).exists():
            if joint not in JOINTS:
                raise ProblemError(
                    "unknown joint", key="--motor", value=text, allowed=", ".join(JOINTS)
                )
            names = [joint]
        else:
            names = defaults
            file = text
        motor = ssm.load_motor(file)
        for name in names:
            candidates.setdefault(name, []).append(motor)
    return candidates


def selected_motors(sizing: "Sizing") -> dict[str, ssm.Motor]:
    """Return the smallest adequate motor of each joint.

    Parameters
    ----------
    sizing : Sizing
        Verdicts on the candidate motors of each joint.

    Returns
    -------
    dict of Motor
        Motors by joint. If no candidate of a joint is adequate, its largest candidate is used.
        Joints without candidates are left out.
    """
    return {
        joint.load.joint: (joint.smallest or joint.candidates[-1]).motor
        for joint in sizing.joints
        if joint.candidates
    }


def _conditions_from_options(options: Namespace, duty: "DutyCycle") -> "Conditions":
    """Return the operating conditions that the options state.

    Without the option --pause, the duty cycle determines the pause.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.
    duty : DutyCycle
        Motion whose pause applies without the option --pause.

    Returns
    -------
    Conditions
        Ambient temperature, supply, pause and confidence of the sizing.
    """
    from ssm_planner.sizing import REFERENCE_TEMPERATURE, Conditions

    return Conditions(
        ambient=REFERENCE_TEMPERATURE if options.ambient is None else options.ambient,
        supply_voltage=options.supply,
        current_limit=options.current_limit,
        pause=duty.pause if options.pause is None else options.pause,
        confidence=options.confidence,
        draws=options.draws,
        spread=options.spread,
    )
