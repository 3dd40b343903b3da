"""Write and read the table of controlled stops in an export folder.

A controlled stop brakes the robot along its path. The table contains the positions of the joints
during the stops that begin at selected instants of the motion.

`add_stops` reads the table. If the folder states velocities, the stops follow from the motion, so
the reader computes them again and compares them with the table. There are two exceptions. If the
folder states only positions, it does not determine the accelerations of the motion. The stops of a
robot with jerk limits depend on the limits of the task. In both cases, the reader checks the stops
of the table as separate motions.
"""

import io
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.agreement import ExportContent, file_name_suffix
from ssm_planner.formats.csv import read_columns
from ssm_planner.formats.points import Points, Reading, interpolate_points
from ssm_planner.problem import Robot
from ssm_planner.stopping import Stops
from ssm_planner.typing import Array, JsonObject
from ssm_planner.verification import StopMotions, quickest_stops
from ssm_planner.verification.stops import MIN_BREAK_DISTANCE

ROW_PERIOD = 1e-3
"""Time between two rows of a stop, s. Only the last interval is shorter."""
TIME_DIGIT = 1e-6
"""Value of the last digit of a time in the table, s."""
LARGEST_STOP_COUNT = 100_000
"""Largest number of instants from which the table may contain stops."""


def stop_table(
    stops: Stops | StopMotions, robot: Robot, axes: Mapping[str, Any], name: str
) -> ExportContent:
    """Return the file with all stops and its entry in the manifest.

    Parameters
    ----------
    stops : Stops or StopMotions
        The stops, which follow one after the other in the file.
    robot : Robot
        Robot that performs the motion.
    axes : mapping
        Entries of the manifest for the drive axes, by joint. Positions of these joints are written
        in increments.
    name : str
        Name of the file.

    Returns
    -------
    ExportContent
        Text of the file, and the entry "stops" of the manifest.
    """
    header, scales = _column_names(robot, axes)
    rows = [np.empty((0, len(header)))]
    for start, stop in zip(stops.time, stops.motions, strict=True):
        if stop is not None:
            t = np.append(np.arange(0.0, stop.duration, ROW_PERIOD), stop.duration)
            q = stop.sample(t).q * scales
            q = np.where(scales == 1, q, np.round(q) + 0.0)
            rows.append(np.column_stack([np.full(len(t), start), t, q]))
    text = io.StringIO()
    fmt = ["%.6f"] * 2 + ["%.12g"] * 4
    np.savetxt(text, np.vstack(rows), fmt, delimiter=",", header=",".join(header), comments="")
    entry = {
        "file": name,
        "instants": len(stops.time),
        "longest_s": float(stops.duration.max()),
        "farthest_m": float(stops.travel.max()),
    }
    return ExportContent({"stops": entry}, {name: text.getvalue()})


def _column_names(robot: Robot, axes: Mapping[str, Any]) -> tuple[list[str], Array]:
    """Return the names of the columns of the table, and the conversion factors of its positions.

    Parameters
    ----------
    robot : Robot
        Robot that performs the motion.
    axes : mapping
        Entries of the manifest for the drive axes, by joint.

    Returns
    -------
    names : list of str
        Names of the six columns: the instant at which the stop begins, the time since then, and the
        positions of the four joints with their units.
    scales : (4,) array
        Encoder increments per rad (joints 1 to 3) or per m (joint 4). The factor is 1 for a joint
        whose positions are in rad or m.
    """
    names = ["from_s", "time_s"]
    scales = []
    for joint in robot.joints:
        scale = axes.get(joint.name, {}).get("increments_per_unit")
        names.append(f"{joint.name}_{'inc' if scale else joint.unit}")
        scales.append(scale or 1.0)
    return names, np.array(scales)


def add_stops(folder: Path, manifest: JsonObject, reading: Reading, robot: Robot) -> Reading:
    """Add the controlled stops of an export folder to its motion.

    The stops that follow from the motion are computed again, so that the caller can compare the
    table with them. If the folder states only positions, or if the robot has jerk limits, the stops
    are read from the table instead.

    Parameters
    ----------
    folder : Path
        Export folder.
    manifest : dict
        Its manifest, which states whether the folder contains stops.
    reading : Reading
        The motion of the folder.
    robot : Robot
        Robot that performs the motion.

    Returns
    -------
    Reading
        The motion with the expected content of the table, or with the stops from the table. It is
        unchanged if the folder does not contain stops.

    Raises
    ------
    TrajectoryError
        If the manifest does not state the number of stops, or if the stops of the table do not
        follow the motion.
    """
    content = reading.content
    if "stops" not in manifest or content is None:
        return reading
    name = f"stops{file_name_suffix(manifest)}.csv"
    entry = manifest["stops"]
    count = entry.get("instants") if isinstance(entry, dict) else None
    if (
        type(count) is not int
        or not 0 < count <= LARGEST_STOP_COUNT
        or name not in manifest["files"]
    ):
        raise TrajectoryError(f"{folder}: the manifest does not give the number of stops")
    if reading.resolution is None and not robot.jerk_limited:
        table = stop_table(quickest_stops(reading.trajectory, robot, count), robot, {}, name)
    else:
        header, scales = _column_names(robot, content.entries.get("axes", {}))
        has_rows = (folder / name).read_bytes().strip().count(b"\n")
        rows = read_columns(folder / name, header) if has_rows else np.empty((0, len(header)))
        rows[:, 2:] /= scales
        stops = _recorded_stops(rows, count, reading, robot, path=folder / name)
        reading = replace(reading, stops=tuple(stops))
        table = ExportContent({"stops": {**entry, "file": name}}, {name: None})
    content = ExportContent(content.entries | table.entries, {**content.files, **table.files})
    return replace(reading, content=content)


def _recorded_stops(
    rows: Array, count: int, reading: Reading, robot: Robot, *, path: Path
) -> Iterator[Reading]:
    """Yield the motions of the stops in the rows of a table.

    Each row must lie on the path of the motion. The tolerance is the accuracy with which the points
    of the motion determine this path. For a robot with jerk limits, only the first row of each stop
    must lie on the path. A stop may be missing only where the robot rests.

    Parameters
    ----------
    rows : (n, 6) array
        Columns: instant at which the stop begins (s), time since then (s), positions of joints 1 to
        3 (rad), and position of joint 4 (m).
    count : int
        Number of instants from which the table must contain stops.
    reading : Reading
        Motion from which the stops begin.
    robot : Robot
        Robot that performs the motion.
    path : Path
        File of the table, for messages.

    Yields
    ------
    Reading
        Motion of one stop, with straight lines between its rows.

    Raises
    ------
    TrajectoryError
        If a stop is missing, or if it does not follow the motion.
    """
    motion = reading.trajectory
    resolution = np.zeros(4) if reading.resolution is None else reading.resolution
    interval = float(np.diff(motion.breaks).max())
    # Largest travel from rest during one interval. The chord between two points deviates from the
    # curve by at most a quarter of it, a·h²/8, where a is the acceleration and h the interval.
    change = robot.accelerations * interval**2 / 2
    slack = change / 4 + 2 * resolution + robot.velocities * TIME_DIGIT

    def positions(times: Array) -> Array:
        """Return the joint positions (n, 4) at times (n,) in s from the start of the motion."""
        return motion.positions(np.clip(motion.breaks[0] + times, *motion.breaks[[0, -1]]))

    for time in np.linspace(0.0, motion.duration, count):
        steps = np.diff(positions(time + interval * np.array([-1.0, 0.0, 1.0])), axis=0)
        is_missing = np.all(np.abs(rows[:, 0] - time) > MIN_BREAK_DISTANCE + interval)
        # Larger steps before or after the instant show that the robot moves there.
        if is_missing and np.any(np.abs(steps) > 2 * change + slack):
            raise TrajectoryError(f"{path}: no stop begins at {time:.6f} s")
    if not len(rows):
        return
    # Every stop begins with a row whose time since the beginning is 0.
    for stop in np.split(rows, np.flatnonzero(rows[1:, 1] == 0) + 1):
        t = stop[:, 1]
        q = stop[:, 2:]
        regular = np.arange(len(t)) * ROW_PERIOD
        # The stop is slower than the motion, so all its positions lie between samples of the path.
        path_positions = positions(stop[0, 0] + regular)
        tolerance = slack + np.abs(np.diff(path_positions, axis=0)).max(axis=0)
        distances = np.abs(q[:, None] - path_positions) / tolerance
        has_one_start = np.ptp(stop[:, 0]) <= 0
        is_regular = np.abs(t - regular)[:-1].max(initial=0.0) <= TIME_DIGIT
        ends_in_time = t[-1] - regular[-1] <= TIME_DIGIT
        starts_on_path = np.all(np.abs(q[0] - path_positions[0]) <= slack)
        stays_on_path = robot.jerk_limited or distances.max(axis=2).min(axis=1).max() <= 1
        if not (has_one_start and is_regular and ends_in_time and starts_on_path and stays_on_path):
            raise TrajectoryError(
                f"{path}: the stop from {stop[0, 0]} s does not follow the motion"
            )
        # A short last interval is left out, because the digits do not determine its length.
        used_rows = np.append(t[:-1] < t[-1] - ROW_PERIOD / 2, True)
        yield interpolate_points(Points(t[used_rows], q[used_rows]), robot)
