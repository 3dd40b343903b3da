"""A simulated playback as the drive's own recorder would export it, so that `compare` and `identify` read it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.problem.robot import JOINTS
from ssm_planner.simulation.simulate import SimulationResult
from ssm_planner.typing import Array, Indices
from ssm_planner.units import SPEEDS

SAMPLING = 1e-3
"""s."""
_CHANNELS = (
    "Velocity actual value averaged",
    "Torque actual value averaged",
    "Position actual value",
)


def write_recordings(
    result: SimulationResult, folder: Path, sampling: float = SAMPLING
) -> dict[str, Path]:
    """One recording of each driven joint into a folder; their paths by joint. Raises ExportError."""
    return {
        name: write_recording(result, name, folder / f"{name}.csv", sampling)
        for name in result.axes
    }


def write_recording(
    result: SimulationResult, joint: str, path: Path, sampling: float = SAMPLING
) -> Path:
    """One joint in the layout of the EPOS recorder: ms, whole rpm, 0.1 % of the rated torque, increments.

    Speed and torque are averaged over the sampling period (s), signs are the controller's. Raises ExportError.
    """
    axis, k = result.axes[joint], JOINTS.index(joint)
    count = int(result.time[-1] / sampling) + 1
    place = np.minimum(np.arange(count) * sampling, result.time[-1])
    at = np.minimum(
        np.rint(place / (result.time[1] - result.time[0])).astype(int), len(result.time) - 1
    )
    rows = np.column_stack(
        [
            1000.0 * place,
            np.rint(axis.direction * _averaged(result.w[:, k], at) / SPEEDS["rpm"]),
            np.round(
                axis.direction * 100.0 * _averaged(result.torque[:, k], at) / axis.rated_torque, 1
            ),
            np.floor(
                axis.direction * result.motor_angle[at, k] * axis.counts_per_turn / (2.0 * np.pi)
                + 0.5
            ),
        ]
    )
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


def _averaged(values: Array, at: Indices) -> Array:
    total = np.concatenate([[0.0], np.cumsum(values)])
    step = max(1, int(np.median(np.diff(at)))) if len(at) > 1 else 1
    end = np.minimum(at + step, len(values))
    found: Array = (total[end] - total[at]) / (end - at)
    return found
