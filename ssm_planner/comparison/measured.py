"""Read recordings of an executed motion in SI units, with the signs of the joints."""

import re
from collections.abc import Sequence
from pathlib import Path

from ssm_planner.errors import RecordingError
from ssm_planner.identification import read_recording, smallest_step
from ssm_planner.problem import Robot
from ssm_planner.typing import Array, Files, record


@record
class AxisRecording:
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
    doubts: tuple[str, ...] = ()
    """Sentences on values of the file that are not in the channels, or differ from them."""


def read_axis_recording(
    path: Path, robot: Robot, joint: str, counts_per_turn: int | None = None
) -> AxisRecording:
    """Read the recording of one axis.

    Parameters
    ----------
    path : Path
        Recorder export, or CSV with named columns.
    robot : Robot
        Robot that performed the motion.
    joint : str
        Name of the joint.
    counts_per_turn : int, optional
        Increments per motor turn of a position channel. The default follows from the motor file.

    Returns
    -------
    AxisRecording
        The recording in SI units, with the signs of the joint.

    Raises
    ------
    RecordingError
        If the file is invalid, if the joint lacks a drive, or if the increments per turn are not
        positive.
    """
    if counts_per_turn is not None and counts_per_turn < 1:
        raise RecordingError(f"{counts_per_turn} counts per turn (allowed: 1 or more)")
    axis = next(axis for axis in robot.joints if axis.name == joint)
    if axis.drive is None:
        raise RecordingError(
            f"{path}: the robot file states no drive for joint {joint}, so its motor is unknown"
        )
    motor = axis.motor
    if counts_per_turn is None and motor and motor.encoder_known:
        counts_per_turn = motor.increments
    recording = read_recording(
        path,
        nominal_torque=None if motor is None else motor.nominal_torque,
        direction=axis.motor_direction,
        counts_per_turn=counts_per_turn,
        every_sample=True,
    )
    q = None if recording.angle is None else recording.angle / axis.drive.ratio
    return AxisRecording(
        joint,
        recording.name,
        recording.begin + recording.time,
        recording.w,
        recording.tau,
        q=q,
        speed_resolution=recording.quantum,
        torque_resolution=smallest_step(recording.tau, 12),
        position_resolution=0.0 if q is None else smallest_step(q, 12),
        repairs=tuple(text for text in recording.repairs if text not in recording.doubts),
        doubts=recording.doubts,
    )


def assign_recordings(texts: Sequence[str], robot: Robot) -> list[tuple[str, Path]]:
    """Assign recordings to joints.

    Parameters
    ----------
    texts : sequence of str
        `JOINT=FILE`, or only the file if its name contains the name or the number of a joint.
    robot : Robot
        Robot with the names of the joints.

    Returns
    -------
    list of (str, Path)
        Name of the joint and recording of each assignment.

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
            joint = _joint_in_file_name(Path(text).stem.lower(), names)
            file = text
        if joint not in names:
            raise RecordingError(
                f"{text}: the joint of this recording is unknown; write JOINT=FILE with one of "
                f"{', '.join(names)}"
            )
        if joint in assignments:
            raise RecordingError(f"{text}: a second recording of joint {joint}")
        assignments[joint] = Path(file)
    return list(assignments.items())


def _joint_in_file_name(stem: str, names: list[str]) -> str:
    """Find the joint that a file name mentions by its name or its number.

    Parameters
    ----------
    stem : str
        File name without its extension, in lower case.
    names : list of str
        Names of the four joints.

    Returns
    -------
    str
        Name of the joint, or an empty text if the file name mentions no joint or several joints.
    """
    matches = [name for name in names if name in stem]
    numbers = re.findall(r"(?:axis|joint|motor|j)[ _-]?([1-4])(?!\d)", stem)
    matches += [names[int(number) - 1] for number in numbers]
    return matches[0] if len(set(matches)) == 1 else ""
