"""A drive's recording as the motion of one joint's motor, position included where it was recorded.

`ssm-planner compare PLAN RECORDING...`: an executed motion against its plan.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.cli.output import FAILED, OK, print_json, progress_reporter
from ssm_planner.comparison import Measured
from ssm_planner.errors import RecordingError
from ssm_planner.formats.epos4_setup import QUADRATURE
from ssm_planner.identification.recorder_csv import parse_table
from ssm_planner.identification.recordings import read_recording
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.typing import Array

if TYPE_CHECKING:
    from ssm_planner.comparison import AxisComparison
    from ssm_planner.problem.robot import Robot


POSITION = ("position actual value", "position demand value", "position")
INCREMENTS = ("inc", "qc", "counts", "increments", "")
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


def read_measured(path: Path, robot: Robot, joint: str, counts_per_turn: int | None = None) -> Measured:
    """One recording in SI units and the joint's positive direction. Raises RecordingError."""
    axis = next(each for each in robot.joints if each.name == joint)
    if axis.drive is None:
        raise RecordingError(f"{path}: joint {joint} has no drive in the robot file, so nothing is known of its motor")
    nominal = None if axis.motor is None else axis.motor.nominal_torque
    recording = read_recording(path, nominal_torque=nominal, direction=axis.motor_direction)
    steps = np.diff(np.unique(np.round(recording.tau, 12)))
    return Measured(
        joint,
        recording.name,
        time=recording.time,
        w=recording.w,
        tau=recording.tau,
        q=_position(path, axis, recording.time, counts_per_turn),
        speed_resolution=recording.quantum,
        torque_resolution=float(steps.min()) if len(steps) else 0.0,
        repairs=recording.repairs,
    )


def _position(path: Path, joint: Joint, time: Array, counts_per_turn: int | None) -> Array | None:
    """Joint position at the recording's times from a channel in increments, if there is one."""
    table = parse_table(path.read_text(encoding="utf-8", errors="replace").lstrip("\ufeff"), path)
    names = [name.strip().lower() for name in table.names]
    column = next((names.index(name) for name in POSITION if name in names), None)
    clock = next((k for k, name in enumerate(names) if name in ("", "time", "t")), 0)
    if column is None or joint.drive is None:
        return None
    if table.units[column].strip().lower() not in INCREMENTS:
        raise RecordingError(f"{path}: position column has unit {table.units[column]!r}; allowed: increments (inc, qc)")
    counts = counts_per_turn
    if counts is None and joint.motor is not None and joint.motor.encoder_counts is not None:
        counts = QUADRATURE * joint.motor.encoder_counts
    if counts is None:
        raise RecordingError(
            f"{path}: its position channel is in increments, and the motor of joint {joint.name} has no encoder_counts: "
            "give --counts-per-turn"
        )
    raw = table.values[:, clock] * TIMES.get(table.units[clock].strip().lower(), 1.0)
    position = table.values[:, column] * joint.motor_direction * 2 * np.pi / counts / joint.drive.ratio
    known = np.isfinite(raw) & np.isfinite(position)
    return np.interp(time, raw[known] - raw[known][0], position[known])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("plan", type=Path, help="plan.json")
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="[JOINT=]RECORDING",
        help="EPOS recorder exports or CSV, one for each axis; the joint is taken from the file's name where not given",
    )
    parser.add_argument(
        "--counts-per-turn", type=int, metavar="N", help="increments per motor turn of a position channel"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(options: argparse.Namespace) -> int:
    progress = progress_reporter()
    progress(f"reading {options.plan}")
    from ssm_planner.comparison import compare
    from ssm_planner.plans import load_plan

    plan = load_plan(options.plan)
    axes = []
    for joint, path in assign(options.recordings, plan.robot):
        progress(f"comparing joint {joint}")
        measured = read_measured(path, plan.robot, joint, options.counts_per_turn)
        axes.append(compare(plan.motion, plan.robot, plan.certificate, measured))
    progress("done")
    held = all(axis.held for axis in axes)
    if options.json:
        document = {"plan": str(options.plan), "held": held, "axes": [axis.to_dict() for axis in axes]}
        print_json(document)
    else:
        print("\n".join(compare_lines(axes)))
    return OK if held else FAILED


def assign(words: list[str], robot: Robot) -> list[tuple[str, Path]]:
    """(joint, file) of every `JOINT=FILE`, or of files whose names hold a joint's name or its number.

    Raises RecordingError.
    """
    names = [joint.name for joint in robot.joints]
    found: list[tuple[str, Path]] = []
    for word in words:
        joint, given, file = word.partition("=")
        if not given:
            joint, file = _joint_in(Path(word).stem.lower(), names), word
        if joint not in names:
            raise RecordingError(f"{word}: of which joint? write JOINT=FILE with one of {', '.join(names)}")
        if joint in (other for other, _ in found):
            raise RecordingError(f"{word}: a second recording of joint {joint}")
        found.append((joint, Path(file)))
    return found


def compare_lines(axes: list[AxisComparison]) -> list[str]:
    """Errors of every axis, then its limits in reality beside the planned margins."""
    from ssm_planner.cli.output import shown_unit
    from ssm_planner.reporting.text import text_table

    header = ("axis", "recording", "begins at s", "correlation", "NRMSD position", "speed", "torque")
    rows = [
        (
            axis.joint,
            axis.recording,
            f"{axis.alignment.delay:.4f}",
            f"{axis.alignment.correlation:.4f}",
            *(_share(axis.differences[name].nrmsd) for name in ("position", "speed", "torque")),
        )
        for axis in axes
    ]
    lines = [*text_table(header, rows), ""]
    rows = []
    for axis in axes:
        for limit in axis.limits:
            unit, scale = shown_unit(limit.unit, limit.name)
            planned = "–" if limit.planned_margin is None else f"{100 * limit.planned_margin:+.2f} %"
            values = (f"{scale * limit.measured:.5g}", f"{scale * limit.limit:.5g}", unit)
            verdict = "held" if limit.held else "EXCEEDED"
            rows.append((limit.name, axis.joint, *values, planned, f"{100 * limit.margin:+.2f} %", verdict))
    lines += text_table(("limit", "joint", "measured", "limit", "unit", "margin planned", "measured", ""), rows)
    notes = [f"note: {axis.joint}: {note}" for axis in axes for note in axis.notes]
    held = all(axis.held for axis in axes)
    return [*lines, "", *notes, f"margins: {'held in reality' if held else 'NOT held in reality'}"]


def _share(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"


def _joint_in(stem: str, names: list[str]) -> str:
    chosen = [name for name in names if name in stem]
    numbers = re.findall(r"(?:axis|joint|motor|j)[ _-]?([1-4])(?!\d)", stem)
    chosen += [names[int(number) - 1] for number in numbers]
    return chosen[0] if len(set(chosen)) == 1 else ""
