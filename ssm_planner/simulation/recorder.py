"""Write a simulated motion in the format of the recorder of the drives (EPOS Studio).

The commands `compare` and `identify` read these files, so both can be tested without hardware.
"""

from pathlib import Path

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.problem import JOINTS
from ssm_planner.simulation.simulate import SimulationResult
from ssm_planner.typing import Array, Files, Indices
from ssm_planner.units import SPEEDS

SAMPLING_PERIOD = 1e-3
"""Default sampling period, s."""
_CHANNELS = (
    "Velocity actual value averaged",
    "Torque actual value averaged",
    "Position actual value",
)


def write_recordings(
    result: SimulationResult, folder: Path, sampling: float = SAMPLING_PERIOD
) -> Files:
    """Write one recording for each driven joint into a folder.

    Parameters
    ----------
    result : SimulationResult
        Simulated playback.
    folder : Path
        Folder of the recordings. Each file has the name of its joint.
    sampling : float
        Sampling period, s.

    Returns
    -------
    dict of Path
        Paths of the files by joint.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    return {
        name: write_recording(result, name, folder / f"{name}.csv", sampling)
        for name in result.axes
    }


def write_recording(
    result: SimulationResult, joint: str, path: Path, sampling: float = SAMPLING_PERIOD
) -> Path:
    """Write the recording of one joint in the layout of the recorder of an EPOS controller.

    The columns are the time in ms, the speed in rpm, the torque in % of the rated torque, and the
    position in increments of the encoder, with the signs of the controller. Speed and torque are
    averaged over each sampling period.

    Parameters
    ----------
    result : SimulationResult
        Simulated playback.
    joint : str
        Name of a joint with a drive.
    path : Path
        File that is written.
    sampling : float
        Sampling period, s.

    Returns
    -------
    Path
        The path of the file.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    axis = result.axes[joint]
    k = JOINTS.index(joint)
    count = int(result.time[-1] / sampling) + 1
    times = np.minimum(np.arange(count) * sampling, result.time[-1])
    step = result.time[1] - result.time[0]
    indices = np.minimum(np.rint(times / step).astype(int), len(result.time) - 1)
    speed = axis.direction * _period_means(result.w[:, k], indices) / SPEEDS["rpm"]
    mean_torque = _period_means(result.torque[:, k], indices)
    torque = axis.direction * 100.0 * mean_torque / axis.rated_torque
    turns = axis.direction * result.motor_angle[indices, k] / (2.0 * np.pi)
    increments = np.floor(turns * axis.counts_per_turn + 0.5)
    rows = np.column_stack([1000.0 * times, np.rint(speed), np.round(torque, 1), increments])
    header = [
        "Firmware Version:;simulated",
        f"Max. samples:;{count}",
        f"Recorded samples:;{count}",
        f"Sampling period:;{1000.0 * sampling:.3f}",
        ";" + ";".join(_CHANNELS),
        "ms;rpm;%;inc",
    ]
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write("\n".join(header) + "\n")
        np.savetxt(file, rows, fmt=("%.3f", "%d", "%.1f", "%d"), delimiter=";")
    return path


def _period_means(values: Array, indices: Indices) -> Array:
    """Compute the mean of a quantity over each sampling period.

    Parameters
    ----------
    values : (n,) array
        Values at all simulated instants.
    indices : (k,) array of int
        Index of the first instant of each sampling period.

    Returns
    -------
    (k,) array
        Mean over each period, in the unit of the values.
    """
    total = np.append(0.0, np.cumsum(values))
    step = max(1, int(np.median(np.diff(indices)))) if len(indices) > 1 else 1
    end = np.minimum(indices + step, len(values))
    return (total[end] - total[indices]) / (end - indices)
