"""Streams of setpoints that the export for EPOS4 drives wrote, back as a joint trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.values import Array, Robot
from ssm_planner.verify.interpolation import Points, Reading, join_points

POSITION = "target_position_inc"


def read_epos4(folder: Path, manifest: dict[str, Any], robot: Robot) -> Reading:
    """Target positions in increments as joint positions, joined by straight lines. Raises TrajectoryError.

    Joints without a drive come from their reference file, in rad or m.
    """
    axes = manifest.get("axes")
    if not isinstance(axes, dict) or set(axes) != {joint.name for joint in robot.joints}:
        raise TrajectoryError(f"{folder}: the manifest does not list the joints of robot {robot.name}")
    columns, resolution = [], np.zeros(4)
    time: Array | None = None
    for i, joint in enumerate(robot.joints):
        axis = axes[joint.name]
        per_unit = axis.get("increments_per_unit")
        name = "position_rad" if joint.kind == "revolute" else "position_m"
        t, values = _read_stream(folder / str(axis.get("file")), name if per_unit is None else POSITION)
        if per_unit is not None:
            values = values / float(per_unit)
            resolution[i] = 0.5 / abs(float(per_unit))
        if time is not None and not np.array_equal(time, t):
            raise TrajectoryError(f"{folder}: the streams of the axes do not have the same times")
        time = t
        columns.append(values)
    if time is None:
        raise TrajectoryError(f"{folder}: no streams")
    return join_points(Points(time, np.stack(columns, axis=1), resolution=resolution), robot)


def _read_stream(path: Path, column: str) -> tuple[Array, Array]:
    try:
        with path.open(encoding="utf-8") as file:
            names = file.readline().strip().split(",")
        if column not in names:
            raise TrajectoryError(f"{path}: no column {column} (streams of the modes csv and cst hold no positions)")
        rows = np.loadtxt(path, delimiter=",", skiprows=1, usecols=[0, names.index(column)], ndmin=2)
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    return rows[:, 0], rows[:, 1]
