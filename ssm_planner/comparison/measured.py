"""Recordings of the axes of an executed motion, read in SI units and the joints' positive directions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ssm_planner.errors import RecordingError
from ssm_planner.formats.epos4_setup import QUADRATURE
from ssm_planner.identification.recorder_csv import parse_table
from ssm_planner.identification.recordings import read_recording
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.typing import Array
from ssm_planner.units import TIMES

POSITION = ("position actual value", "position demand value", "position")
INCREMENTS = ("inc", "qc", "counts", "increments", "")


@dataclass(frozen=True, eq=False)
class Measured:
    """One motor over time, SI, in the joint's positive direction; arrays (samples,)."""

    joint: str
    name: str
    time: Array
    """As the file has it, s: the recordings of all axes are taken to share one clock."""
    w: Array
    tau: Array
    q: Array | None = None
    """Joint position, rad or m; None: not recorded."""
    speed_resolution: float = 0.0
    torque_resolution: float = 0.0
    position_resolution: float = 0.0
    repairs: tuple[str, ...] = ()


def read_measured(
    path: Path, robot: Robot, joint: str, counts_per_turn: int | None = None
) -> Measured:
    """One recording in SI units and the joint's positive direction. Raises RecordingError."""
    axis = next(each for each in robot.joints if each.name == joint)
    if axis.drive is None:
        raise RecordingError(
            f"{path}: joint {joint} has no drive in the robot file, so nothing is known of its motor"
        )
    nominal = None if axis.motor is None else axis.motor.nominal_torque
    recording = read_recording(path, nominal_torque=nominal, direction=axis.motor_direction)
    time = recording.begin + recording.time
    steps = np.diff(np.unique(np.round(recording.tau, 12)))
    q, resolution = _recorded_position(path, axis, time, counts_per_turn)
    return Measured(
        joint,
        recording.name,
        time=time,
        w=recording.w,
        tau=recording.tau,
        q=q,
        speed_resolution=recording.quantum,
        torque_resolution=float(steps.min()) if len(steps) else 0.0,
        position_resolution=resolution,
        repairs=recording.repairs,
    )


def _recorded_position(
    path: Path, joint: Joint, time: Array, counts_per_turn: int | None
) -> tuple[Array | None, float]:
    """(joint position at the recording's times, one increment) from a channel in increments, if there is one."""
    table = parse_table(path.read_text(encoding="utf-8", errors="replace").lstrip("\ufeff"), path)
    names = [name.strip().lower() for name in table.names]
    column = next((names.index(name) for name in POSITION if name in names), None)
    clock = next((k for k, name in enumerate(names) if name in ("", "time", "t")), 0)
    if column is None or joint.drive is None:
        return None, 0.0
    if table.units[column].strip().lower() not in INCREMENTS:
        raise RecordingError(
            f"{path}: position column has unit {table.units[column]!r}; allowed: increments (inc, qc)"
        )
    counts = counts_per_turn
    if counts is None and joint.motor is not None and joint.motor.encoder_known:
        assert joint.motor.encoder_counts is not None
        counts = QUADRATURE * joint.motor.encoder_counts
    if counts is None:
        raise RecordingError(
            f"{path}: its position channel is in increments, and the motor of joint {joint.name} has no encoder_counts "
            "or a placeholder: give --counts-per-turn"
        )
    raw = table.values[:, clock] * TIMES.get(table.units[clock].strip().lower(), 1.0)
    increment = 2 * np.pi / counts / joint.drive.ratio
    position = table.values[:, column] * joint.motor_direction * increment
    known = np.isfinite(raw) & np.isfinite(position)
    return np.interp(time, raw[known], position[known]), increment


def assign(words: Sequence[str], robot: Robot) -> list[tuple[str, Path]]:
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
            raise RecordingError(
                f"{word}: of which joint? write JOINT=FILE with one of {', '.join(names)}"
            )
        if joint in (other for other, _ in found):
            raise RecordingError(f"{word}: a second recording of joint {joint}")
        found.append((joint, Path(file)))
    return found


def _joint_in(stem: str, names: list[str]) -> str:
    chosen = [name for name in names if name in stem]
    numbers = re.findall(r"(?:axis|joint|motor|j)[ _-]?([1-4])(?!\d)", stem)
    chosen += [names[int(number) - 1] for number in numbers]
    return chosen[0] if len(set(chosen)) == 1 else ""
