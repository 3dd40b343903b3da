"""A drive's recording as the motion of one joint's motor, position included where it was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ssm_planner.errors import RecordingError
from ssm_planner.exports.epos4_axis import QUADRATURE
from ssm_planner.identification.columns import parse_table
from ssm_planner.identification.recording import read_recording
from ssm_planner.problem.values import Array, Joint, Robot
from ssm_planner.verify.compare import Measured

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
        recording.time,
        recording.w,
        recording.tau,
        _position(path, axis, recording.time, counts_per_turn),
        recording.quantum,
        float(steps.min()) if len(steps) else 0.0,
        recording.repairs,
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
