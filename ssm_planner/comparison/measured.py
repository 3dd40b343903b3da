"""Read recordings of an executed motion in SI units, with the signs of the joints."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ssm_planner.errors import RecordingError
from ssm_planner.formats import QUADRATURE
from ssm_planner.identification import parse_table, quantum, read_recording, read_text
from ssm_planner.problem import Joint, Robot
from ssm_planner.typing import Array, Files, record
from ssm_planner.units import TIMES

POSITION = ("position actual value", "position demand value", "position")
"""Names of columns that contain a position, the preferred one first."""
INCREMENTS = ("inc", "qc", "counts", "increments", "")
"""Names of the unit of a position column."""


@record
class Measured:
    """The recording of one motor in SI units. Arrays are (samples,).

    Values are positive in the positive direction of the joint.
    """

    joint: str
    name: str
    """Name of the recording."""
    time: Array
    """Time in the file, s. All recordings share one clock."""
    w: Array
    """Motor speed, rad/s."""
    tau: Array
    """Motor torque, N·m."""
    q: Array | None = None
    """Joint position, rad or m. None if it was not recorded."""
    speed_resolution: float = 0.0
    torque_resolution: float = 0.0
    position_resolution: float = 0.0
    repairs: tuple[str, ...] = ()
    """Remarks on faults of the file that were corrected."""


def read_measured(
    path: Path, robot: Robot, joint: str, counts_per_turn: int | None = None
) -> Measured:
    """Read the recording of one axis.

    Parameters
    ----------
    path
        Recorder export, or CSV with named columns.
    robot
        Robot that performed the motion.
    joint
        Name of the joint.
    counts_per_turn
        Increments per motor turn of a position channel. The default follows from the motor file.

    Returns
    -------
    Measured
        The recording in SI units, with the signs of the joint.

    Raises
    ------
    RecordingError
        If the file is invalid, or if the joint lacks a drive.
    """
    axis = next(axis for axis in robot.joints if axis.name == joint)
    if axis.drive is None:
        raise RecordingError(
            f"{path}: the robot file states no drive for joint {joint}, so its motor is unknown"
        )
    nominal = None if axis.motor is None else axis.motor.nominal_torque
    recording = read_recording(path, nominal_torque=nominal, direction=axis.motor_direction)
    time = recording.begin + recording.time
    q, resolution = _recorded_position(path, axis, time, counts_per_turn)
    return Measured(
        joint,
        recording.name,
        time,
        recording.w,
        recording.tau,
        q=q,
        speed_resolution=recording.quantum,
        torque_resolution=quantum(recording.tau, 12),
        position_resolution=resolution,
        repairs=recording.repairs,
    )


def _recorded_position(
    path: Path, joint: Joint, time: Array, counts_per_turn: int | None
) -> tuple[Array | None, float]:
    """Read the joint position (samples,) at the instants `time`, and the size of an increment.

    Both are in rad or m. The result is (None, 0.0) if no channel contains the position. Raises
    RecordingError if the unit or the number of increments per turn is unknown.
    """
    table = parse_table(read_text(path), path)
    names = [name.strip().lower() for name in table.names]
    units = [unit.strip().lower() for unit in table.units]
    column = next((names.index(name) for name in POSITION if name in names), None)
    clock = next((k for k, name in enumerate(names) if name in ("", "time", "t")), 0)
    if column is None or joint.drive is None:
        return None, 0.0
    if units[column] not in INCREMENTS:
        raise RecordingError(
            f"{path}: position column has unit {table.units[column]!r}; allowed: increments (inc, "
            "qc)"
        )
    counts = counts_per_turn or _encoder_counts(joint)
    if counts is None:
        raise RecordingError(
            f"{path}: its position channel is in increments, and the motor of joint {joint.name} "
            "has no encoder_counts or a placeholder: give --counts-per-turn"
        )
    recorded_time = table.values[:, clock] * TIMES.get(units[clock], 1.0)
    increment = 2 * np.pi / counts / joint.drive.ratio
    position = table.values[:, column] * joint.motor_direction * increment
    finite = np.isfinite(recorded_time) & np.isfinite(position)
    return np.interp(time, recorded_time[finite], position[finite]), increment


def _encoder_counts(joint: Joint) -> int | None:
    """Return the increments per motor turn that the motor file states, or None."""
    motor = joint.motor
    if motor is None or not motor.encoder_known or motor.encoder_counts is None:
        return None
    return QUADRATURE * motor.encoder_counts


def assign(texts: Sequence[str], robot: Robot) -> list[tuple[str, Path]]:
    """Assign recordings to joints, and return pairs of joint and file.

    Parameters
    ----------
    texts
        `JOINT=FILE`, or only the file if its name contains the name or the number of a joint.
    robot
        Robot with the names of the joints.

    Raises
    ------
    RecordingError
        If the joint of a recording is unknown, or if a joint has two recordings.
    """
    names = [joint.name for joint in robot.joints]
    assignments: Files = {}
    for text in texts:
        joint, separator, file = text.partition("=")
        if not separator:
            joint = _joint_in(Path(text).stem.lower(), names)
            file = text
        if joint not in names:
            raise RecordingError(
                f"{text}: of which joint? write JOINT=FILE with one of {', '.join(names)}"
            )
        if joint in assignments:
            raise RecordingError(f"{text}: a second recording of joint {joint}")
        assignments[joint] = Path(file)
    return list(assignments.items())


def _joint_in(stem: str, names: list[str]) -> str:
    """Return the joint that the name of a file contains, or "" if it is not unique."""
    matches = [name for name in names if name in stem]
    numbers = re.findall(r"(?:axis|joint|motor|j)[ _-]?([1-4])(?!\d)", stem)
    matches += [names[int(number) - 1] for number in numbers]
    return matches[0] if len(set(matches)) == 1 else ""
