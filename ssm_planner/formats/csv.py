"""Read and write trajectories as CSV files with units in the column names.

The header names joints and units, such as q1_rad, and each row contains one point of the motion.
`export_csv` writes rows at a fixed rate or, without a rate, those points between which a controller
with cubic or quintic interpolation keeps the limits. `read_csv` reads such tables and tables of
other programs. `read_csv_export` reads a whole export folder.
"""

import math
import re
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.dynamics import MotorMotion, RigidBody, motion_directions, motor_motion
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.agreement import ExportContent, file_name_suffix, read_rate
from ssm_planner.formats.epos4_setup import (
    INT32_MAX,
    Axis,
    CountsPerTurn,
    check_integer_range,
    drive_axes,
    encoder_notes,
)
from ssm_planner.formats.points import Points, Reading, interpolate_points, large_array
from ssm_planner.formats.spline_points import TIME_ROUNDING, spline_points
from ssm_planner.formats.trajectory_csv import TableColumn, identify_columns
from ssm_planner.kinematics import Mechanism, task_from_joints, tip_position
from ssm_planner.plans import Plan
from ssm_planner.problem import JOINTS, Robot
from ssm_planner.trajectory import PIECES_PER_BLOCK, Samples, Trajectory, blocks
from ssm_planner.typing import Array, JsonObject, frozen
from ssm_planner.verification import Certificate

DEFAULT_RATE = 1000.0
"""Default rate, Hz."""
DEFAULT_RATE_ROWS = 100_000
"""Largest number of rows of a table at the default rate.

The default rate of a longer motion is divided by 10, 100 and so on.
"""
LARGEST_RATE = 100_000.0
"""Largest rate of an export, Hz."""
STATE_UNIT_SUFFIXES = {"q": "", "qd": "_per_s", "qdd": "_per_s2", "qddd": "_per_s3"}
"""Text that follows the unit of the joint in a column name, by attribute of `Samples`."""
MOTOR_UNITS = {"angle": "rad", "speed": "rad_per_s", "torque": "Nm"}
"""Unit in the column name, by motor quantity."""
COLUMN_GROUPS = (*STATE_UNIT_SUFFIXES, *MOTOR_UNITS, "task")
"""Names of the groups of columns that an export can select."""
COUNTS_GROUP = "counts"
"""Name of the additional group with positions in encoder increments, which has its own files."""
COUNTS_PER_TURN_KEY = "increments_per_motor_turn"
"""Key in a manifest of the increments per turn of a motor."""
MANIFEST_UNITS = {"time": "s", "position": "increments", "joints": "in the names of the columns"}
"""Units in a manifest."""
COLUMN_TOLERANCE = 1e-9
"""Largest difference of equal values in a column, relative to the largest value of the column."""
DEFAULT_GROUPS = ("q", "qd", "qdd", "angle", "speed", "torque")
"""Groups of columns in a table at a fixed rate: joint states, and motor angle, speed and torque."""


def motion_table(
    samples: Samples, robot: Robot, columns: Sequence[str] = DEFAULT_GROUPS
) -> tuple[list[str], Array]:
    """Return a table of a motion with its header.

    The acceleration of a plan may jump at an instant. The row of such an instant contains the motor
    torques just after the jump. Only the last row contains the motor torques just before the end.

    Parameters
    ----------
    samples : Samples
        n samples of the joint motion, such as `Trajectory.uniform` returns.
    robot : Robot
        Robot that performs the motion.
    columns : sequence of str
        Names of groups of columns. The groups q, qd, qdd and qddd are the joint positions and their
        derivatives up to the jerk. The groups angle, speed and torque belong to the motors. The
        group task contains the task coordinates and the position of the tool tip.

    Returns
    -------
    header : list of str
        Names of the columns with their units.
    rows : (n, columns) array
        Values in SI units. The first column is the time, and the other columns follow in the order
        of `COLUMN_GROUPS`.
    """
    header = ["time_s"]
    values = [samples.t]
    names = [f"{i + 1}_{joint.unit}" for i, joint in enumerate(robot.joints)]
    for symbol, per in STATE_UNIT_SUFFIXES.items():
        if symbol in columns:
            header += [f"{symbol}{name}{per}" for name in names]
            values += list(getattr(samples, symbol).T)
    if any(group in columns for group in MOTOR_UNITS):
        motor = motor_states(samples, robot)
        driven_joints = [i for i, joint in enumerate(robot.joints) if joint.drive is not None]
        for group, unit in MOTOR_UNITS.items():
            if group in columns:
                header += [f"motor{i + 1}_{group}_{unit}" for i in driven_joints]
                values += [getattr(motor, group)[:, i] for i in driven_joints]
    if "task" in columns:
        mechanism = Mechanism.from_robot(robot)
        header += ["task_roll_rad", "task_tilt_rad", "task_spin_rad", "task_depth_m"]
        values += list(task_from_joints(mechanism, samples.q).T)
        header += ["tip_x_m", "tip_y_m", "tip_z_m"]
        values += list(tip_position(mechanism, samples.q).T)
    return header, np.stack(values, axis=1)


def motor_states(samples: Samples, robot: Robot) -> MotorMotion:
    """Compute the motion and the torque of every motor with exact friction.

    Parameters
    ----------
    samples : Samples
        n samples of the joint motion.
    robot : Robot
        Robot that performs the motion.

    Returns
    -------
    MotorMotion
        Angles, speeds and torques (n, 4). Torques are those just after the instant, but just before
        it at the last instant. Values of a joint without a drive are NaN.
    """
    direction_after, breakaway = motion_directions(robot, samples, 1)
    direction_before, _ = motion_directions(robot, samples, -1)
    is_end = (samples.t == samples.t[-1])[:, None]
    direction = np.where(is_end, direction_before, direction_after)
    breaks_away = breakaway.astype(bool) & ~is_end
    return motor_motion(robot, RigidBody.from_robot(robot), samples, direction, breaks_away)


def write_csv(path: Path, trajectory: Trajectory, robot: Robot, rate: float | None = None) -> Path:
    """Write a trajectory at a fixed rate to a CSV file with 12 significant digits.

    Parameters
    ----------
    path : Path
        File to write.
    trajectory : Trajectory
        Motion that is written.
    robot : Robot
        Robot that performs the motion.
    rate : float, optional
        Rows per second, Hz. The default is `DEFAULT_RATE`, divided by 10 until the file has at most
        `DEFAULT_RATE_ROWS` rows.

    Returns
    -------
    Path
        The path of the file.
    """
    if rate is None:
        excess = trajectory.duration * DEFAULT_RATE / DEFAULT_RATE_ROWS
        rate = DEFAULT_RATE / 10.0 ** max(math.ceil(math.log10(excess)), 0)
    header, rows = motion_table(trajectory.uniform(rate), robot)
    with replacing(path) as temporary:
        _write_table(temporary, header, rows, form="%.12g")
    return path


def export_csv(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float | None = None,
    columns: Sequence[str] | None = None,
    counts_per_turn: CountsPerTurn = None,
) -> JsonObject:
    """Write trajectory.csv into an export folder, and return the entries of the manifest.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    certificate : Certificate
        Certificate of the plan.
    folder : Path
        Export folder.
    suffix : str
        Text before the extension of all file names: "" for a verified plan, or "_unverified".
    rate : float, optional
        Rows per second, Hz. By default, the rows are points of the plan that a controller can join
        by cubics or quintics without exceeding a limit.
    columns : Sequence[str], optional
        Names of groups of columns, as in `motion_table`. The additional group "counts" writes one
        file for every driven joint, with the time (s) and the position (encoder increments) at the
        given rate or `DEFAULT_RATE`.
    counts_per_turn : int or mapping from joint to int, optional
        Increments per motor turn (4 × encoder counts), for all joints or by joint. The default
        comes from the motor files.

    Returns
    -------
    dict
        Entries that this format adds to the manifest, among them notes for the user.

    Raises
    ------
    ExportError
        If a group is unknown, the rate is out of range, or an encoder resolution is missing.
    """
    columns = columns or ()
    groups = [group for group in columns if group != COUNTS_GROUP]
    unknown = [group for group in groups if group not in COLUMN_GROUPS]
    if unknown:
        raise ExportError(
            f"unknown columns {', '.join(unknown)} (allowed: "
            f"{', '.join((*COLUMN_GROUPS, COUNTS_GROUP))})"
        )
    if rate is not None and not 0 < rate <= LARGEST_RATE:
        raise ExportError(
            f"the rate {rate:g} Hz is out of range (allowed: above 0, up to {LARGEST_RATE:g} Hz)"
        )
    path = folder / f"trajectory{suffix}.csv"
    motion = plan.motion
    count_rate = rate or DEFAULT_RATE
    entries: JsonObject = {"rate_hz": count_rate, "units": MANIFEST_UNITS}
    notes = []
    if groups or COUNTS_GROUP not in columns:
        header, rows, note, stretch = _export_rows(plan, certificate, rate, groups)
        _write_table(path, header, rows)
        entries |= {"trajectory": path.name, "rate_hz": rate, "stretch": stretch}
        notes.append(note)
        if "q1_rad" in header:
            reading = read_csv(path, plan.robot)
            motion = reading.trajectory if reading.resolution is None else motion
            notes += _interpolation_notes(reading, plan)
    if COUNTS_GROUP in columns:
        axes = drive_axes(plan.robot, counts_per_turn)
        count_files = _count_files(motion, axes, count_rate, suffix)
        entries |= count_files.write(folder)
        count = int(np.ceil(motion.duration * count_rate - 1e-9)) + 1
        notes.append(
            f"time,position in increments of {', '.join(axes)}: {count} rows at {count_rate:g} Hz"
        )
        notes += encoder_notes(axes)
    return {**entries, "notes": notes}


def read_csv_export(
    folder: Path, manifest: JsonObject, names: Collection[str], robot: Robot
) -> Reading:
    """Read the table of a CSV export, and compute the content that its folder must have.

    If the table contains motor quantities or task coordinates, this function compares them with the
    joint states. The caller compares the other files with the computed content
    (`agreement.check_export_content`).

    Parameters
    ----------
    folder : Path
        Export folder.
    manifest : dict
        Content of the manifest.json of the folder.
    names : Collection[str]
        Files of the manifest whose content is unchanged since the export.
    robot : Robot
        Robot that performs the motion.

    Returns
    -------
    Reading
        Trajectory of the table, and the content that the folder must have.

    Raises
    ------
    TrajectoryError
        If the table of positions is missing, or if a file is damaged.
    """
    suffix = file_name_suffix(manifest)
    name = f"trajectory{suffix}.csv"
    if name not in names:
        raise TrajectoryError(
            f"{folder}: this export does not contain a trajectory: {name} is not in the list of "
            "files"
        )
    reading = read_csv(folder / name, robot)
    motion = reading.trajectory
    rate = DEFAULT_RATE
    if manifest.get("rate_hz") is not None:
        rate = read_rate(folder, manifest, LARGEST_RATE)
        t = motion.uniform(rate).t
        if len(t) != len(motion.breaks) or np.abs(t - motion.breaks).max() > TIME_ROUNDING:
            raise TrajectoryError(f"{folder}: the rows of {name} do not have the rate {rate:g} Hz")
    _check_derived_columns(folder / name, robot, motion)
    content = ExportContent({"trajectory": name, "units": MANIFEST_UNITS}, {name: None})
    if "axes" in manifest:
        axes = read_axes(folder, manifest, robot)
        count_files = _count_files(motion, axes, rate, suffix)
        skipped = reading.resolution is not None
        texts = dict.fromkeys(count_files.files) if skipped else count_files.files
        content = ExportContent(content.entries | count_files.entries, {**content.files, **texts})
        if skipped:
            note = "increments not compared: the table has positions alone"
            reading = replace(reading, notes=(*reading.notes, note))
    return replace(reading, content=content)


def read_axes(folder: Path, manifest: JsonObject, robot: Robot) -> dict[str, Axis]:
    """Return the drive axes of all driven joints with the encoder resolutions in a manifest.

    An axis holds the data of a drive that convert joint positions to encoder increments.

    Parameters
    ----------
    folder : Path
        Export folder, for messages.
    manifest : dict
        Content of the manifest.json of an export.
    robot : Robot
        Robot that performs the motion.

    Returns
    -------
    dict of Axis
        Axes by name of the joint.

    Raises
    ------
    TrajectoryError
        If the increments per motor turn are not positive integers.
    """
    axes = manifest.get("axes")
    counts_per_turn = {}
    for joint in robot.joints:
        entry = axes.get(joint.name) if isinstance(axes, dict) else None
        counts = entry.get(COUNTS_PER_TURN_KEY) if isinstance(entry, dict) else None
        if joint.drive is not None and (type(counts) is not int or not 0 < counts <= INT32_MAX):
            raise TrajectoryError(
                f"{folder}: the manifest does not give the increments of joint {joint.name}"
            )
        counts_per_turn[joint.name] = counts or 0  # 0 for a joint without a drive
    return drive_axes(robot, counts_per_turn)


def _check_derived_columns(path: Path, robot: Robot, motion: Trajectory) -> None:
    """Raise TrajectoryError if motor quantities or task coordinates contradict the joint states.

    The function computes these columns again from the joint states in the table. It does not
    compare values that the joint states do not determine: the motor torque of a joint at rest, all
    motor torques in a table without accelerations, and all motor speeds in a table without
    velocities.

    Parameters
    ----------
    path : Path
        CSV file with the table.
    robot : Robot
        Robot that performs the motion.
    motion : Trajectory
        Motion through the points of the table. It supplies derivatives that the table does not
        contain.
    """
    names = read_layout(path).names
    values = read_columns(path, names)
    # A name such as motor2_torque_Nm or q1_rad contains its group, here torque or q.
    pattern = re.compile(rf"(?:motor\d_)?({'|'.join(COLUMN_GROUPS)})\d?_")
    present = {match.group(1) for match in map(pattern.match, names) if match}
    groups = [group for group in COLUMN_GROUPS if group in present]
    states = [symbol for symbol in STATE_UNIT_SUFFIXES if symbol in groups]
    # After the time, each state has one column for each of the four joints. The last block contains
    # the motor and task columns.
    blocks = np.split(values[:, 1:], np.arange(4, 4 * len(states) + 1, 4), axis=1)
    samples = replace(motion.sample(values[:, 0]), **dict(zip(states, blocks, strict=False)))
    header, expected = motion_table(samples, robot, groups)
    if header != names:
        raise TrajectoryError(f"{path}: the columns are {names}, but an export has {header}")
    wrong = np.abs(values - expected) > COLUMN_TOLERANCE * np.abs(expected).max(axis=0) + 1e-12
    for i, joint in enumerate(robot.joints):
        torque = f"motor{i + 1}_torque_Nm"
        speed = f"motor{i + 1}_speed_rad_per_s"
        if torque in names:
            moving = np.abs(samples.qd[:, i]) > 1e-6 * joint.velocity
            wrong[:, names.index(torque)] &= moving & ("qdd" in groups)
        if speed in names:
            wrong[:, names.index(speed)] &= "qd" in groups
    for row, k in np.argwhere(wrong)[:1].tolist():
        raise TrajectoryError(
            f"{path}: row {row + 1}: {names[k]} is {values[row, k]:.9g}, but the joints give "
            f"{expected[row, k]:.9g}"
        )


def _export_rows(
    plan: Plan, certificate: Certificate, rate: float | None, columns: Sequence[str]
) -> tuple[list[str], Array, str, float]:
    """Return the table of an export.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    certificate : Certificate
        Certificate of the plan.
    rate : float or None
        Rows per second, Hz. None selects points of the plan that a controller can join by cubics or
        quintics without exceeding a limit.
    columns : sequence of str
        Names of groups of columns, as in `motion_table`. If it is empty, the table contains the
        positions and velocities, for quintics also the accelerations, or `DEFAULT_GROUPS` with a
        rate.

    Returns
    -------
    header : list of str
        Names of the columns with their units.
    rows : (n, columns) array
        Values in SI units.
    note : str
        Description of the rows for the manifest.
    stretch : float
        Duration of the table divided by the duration of the plan.
    """
    if rate is None:
        points = spline_points(plan, certificate, tick=None)
        default = ("q", "qd", "qdd") if points.has_accelerations else ("q", "qd")
        header, rows = motion_table(points.samples, plan.robot, columns or default)
        return header, rows, points.note, points.stretch
    header, rows = motion_table(plan.motion.uniform(rate), plan.robot, columns or DEFAULT_GROUPS)
    note = f"{len(rows)} rows at {rate:g} Hz; the last row is the end of the motion"
    return header, rows, note, 1.0


def _count_files(
    motion: Trajectory, axes: Mapping[str, Axis], rate: float, suffix: str
) -> ExportContent:
    """Return the files with the positions of every driven joint in encoder increments.

    Parameters
    ----------
    motion : Trajectory
        Motion that is exported.
    axes : mapping of str to Axis
        Axes of the driven joints.
    rate : float
        Rows per second, Hz. The last row contains the position at the end of the motion.
    suffix : str
        Text before the extension of all file names: "" for a verified plan, or "_unverified".

    Returns
    -------
    ExportContent
        One file for each axis, and an entry of the manifest with the increments per motor turn.

    Raises
    ------
    ExportError
        If a position does not fit 32 bits.
    """
    t = np.arange(int(np.ceil(motion.duration * rate - 1e-9)) + 1) / rate
    q = motion.sample(motion.breaks[0] + t, clamp=True).q
    files = {}
    for name, axis in axes.items():
        counts = axis.increments(q[:, JOINTS.index(name)])
        counts = check_integer_range(counts, INT32_MAX, name, "target position", "increments")
        columns = {"time": t, "position": counts}
        files[f"{name}_time_position{suffix}.csv"] = table_text(columns, ("%.9g", "%d"))
    entries = {name: {COUNTS_PER_TURN_KEY: axis.counts_per_turn} for name, axis in axes.items()}
    return ExportContent({"axes": entries}, files)


def table_text(
    columns: Mapping[str, Array], forms: tuple[str, str] = ("%.3f", "%d")
) -> Iterator[str]:
    """Yield the text of a CSV file in parts, so that a long table needs little memory.

    Parameters
    ----------
    columns : mapping of str to (n,) arrays
        Values by name of the column. The first column is the time.
    forms : (str, str)
        printf format of the first column, and printf format of all other columns.

    Yields
    ------
    str
        Next part of the text. The parts together are the content of the file.
    """
    yield ",".join(columns) + "\n"
    values = list(columns.values())
    formats = [forms[0]] + [forms[1]] * (len(values) - 1)
    row_format = ",".join(formats) + "\n"
    for block in blocks(len(values[0]), PIECES_PER_BLOCK):
        rows = np.column_stack([column[block] for column in values])
        yield row_format * len(rows) % tuple(rows.ravel().tolist())


def _interpolation_notes(reading: Reading, plan: Plan) -> list[str]:
    """Check the rows as a controller interpolates them, and describe the result.

    Parameters
    ----------
    reading : Reading
        Motion through the rows of the exported table.
    plan : Plan
        Plan that is exported. Its limits are checked.

    Returns
    -------
    list of one str
        Note for the manifest: the interpolation, and either the worst violation or the limits that
        the check could not judge.
    """
    certificate = reading.check(plan.robot, plan.limits)
    if not certificate.violations:
        details = reading.interpolation
        if certificate.unjudged:
            names = dict.fromkeys(limit.name for limit in certificate.unjudged)
            details += f"; not judged: {', '.join(names)}"
        return [f"the rows keep every limit in a controller that interpolates them ({details})"]
    return [
        f"in a controller that interpolates them ({reading.interpolation}), the rows exceed "
        f"{certificate.worst.excess}: rows at a fixed rate miss the instants at which the plan's "
        "acceleration jumps; export without a rate to include them"
    ]


def _write_table(path: Path, header: Sequence[str], rows: Array, form: str = "%.17g") -> None:
    """Write a table of numbers to a CSV file.

    Parameters
    ----------
    path : Path
        File to write.
    header : sequence of str
        Names of the columns.
    rows : (n, columns) array
        Values of the table.
    form : str
        printf format of all numbers. The default is exact.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        file.writelines(table_text(dict(zip(header, rows.T, strict=True)), (form, form)))


SEPARATORS = (",", ";", "\t")
"""Characters that may separate columns."""
ROUNDING_SAMPLE_ROWS = 1000
"""Number of rows at the beginning of a table that determine the rounding of its positions."""
LARGEST_EXPONENT = 400
"""Largest magnitude of a decimal exponent that is evaluated. No float has a larger exponent."""


@frozen
class TableLayout:
    """Position of the header, separator and column names of a text file with a table."""

    header: int
    """Index of the line with the header, from 0."""
    separator: str
    """Character between columns."""
    names: list[str]
    """Names of the columns."""


def read_csv(path: Path, robot: Robot) -> Reading:
    """Read a trajectory from a CSV file whose header names joints and units.

    Accepted column names are, for example, time_s, q1_rad, "roll [deg]" and
    joint1_velocity_rad_per_s. The times and the positions of all joints are required, and
    velocities and accelerations are optional.

    Parameters
    ----------
    path : Path
        File that is read.
    robot : Robot
        Robot that defines the joints of the file.

    Returns
    -------
    Reading
        The trajectory, which joins consecutive rows by straight lines if the table contains only
        positions, by cubics if it also contains velocities, and by quintics if it also contains
        accelerations.

    Raises
    ------
    TrajectoryError
        If the file is not a trajectory of this robot. The message states the file, the line and the
        reason.
    """
    layout = read_layout(path)
    columns, ignored = identify_columns(layout.names, robot, f"{path}:{layout.header + 1}")
    # The keys (derivative, joint) sort the time (−1, 0) first. The positions, velocities and
    # accelerations of the four joints follow.
    selected = [columns[key] for key in sorted(columns)]
    rows = read_rows(path, layout, selected)
    has_velocities = (1, 0) in columns
    has_accelerations = (2, 0) in columns
    points = Points(
        rows[:, 0].copy(),
        rows[:, 1:5],
        rows[:, 5:9] if has_velocities else None,
        rows[:, 9:13] if has_accelerations else None,
        resolution=None if has_velocities else _rounding_errors(path, layout, selected[1:]),
        point_name=lambda k: f"{path}:{_line_number(path, layout, k)}",
    )
    notes = (f"columns not used: {', '.join(ignored)}",) if ignored else ()
    return interpolate_points(points, robot, notes)


def read_layout(path: Path) -> TableLayout:
    """Determine the header and the separator of a table.

    The header is the first line that is not empty and not a comment. Comments begin with "#". The
    separator is the one among `SEPARATORS` that occurs most often in the header.

    Parameters
    ----------
    path : Path
        Text file with the table.

    Returns
    -------
    TableLayout
        Line of the header, separator, and names of the columns.

    Raises
    ------
    TrajectoryError
        If the file is empty, if the header has fewer than two columns, or if it contains only
        numbers.
    """
    for k, line in _lines(path):
        text = line.strip().lstrip("\ufeff")
        if not text or text.startswith("#"):
            continue
        separator = max(SEPARATORS, key=text.count)
        names = [name.strip().strip('"') for name in text.split(separator)]
        if len(names) < 2:
            raise TrajectoryError(
                f"{path}:{k + 1}: no columns found (allowed separators: comma, semicolon, tab)"
            )
        if all(_is_number(name) for name in names):
            raise TrajectoryError(
                f"{path}:{k + 1}: no header: the first row must name each column with its unit, "
                "such as time_s,q1_rad,q2_rad,q3_rad,q4_m"
            )
        return TableLayout(k, separator, names)
    raise TrajectoryError(f"{path}: the file is empty")


def read_rows(path: Path, layout: TableLayout, selected: Sequence[TableColumn]) -> Array:
    """Read selected columns of all rows of a table, and convert them to SI units.

    Parameters
    ----------
    path : Path
        File that is read.
    layout : TableLayout
        Layout of the file.
    selected : sequence of TableColumn
        k columns with their factors to SI units.

    Returns
    -------
    (n, k) array
        Values in SI units. The array of a large table is mapped to a temporary file.

    Raises
    ------
    TrajectoryError
        If a row has a wrong number of columns, or if a value is not a number.
    """
    columns = [heading.column for heading in selected]
    factors = [heading.factor for heading in selected]
    count, last_width = _row_count(path, layout)
    table = large_array((count, len(columns)))
    start = 0
    try:
        with _open_text(path) as file, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # numpy warns about empty lines.
            for _ in range(layout.header + 1):
                file.readline()
            for start in range(0, len(table), PIECES_PER_BLOCK):
                block = np.loadtxt(
                    file,
                    comments=None,
                    delimiter=layout.separator,
                    usecols=columns,
                    ndmin=2,
                    max_rows=PIECES_PER_BLOCK,
                )
                table[start : start + PIECES_PER_BLOCK] = block * factors
    except ValueError as error:
        raise TrajectoryError(_row_error(path, layout, str(error), start)) from error
    except OverflowError as error:
        raise TrajectoryError(f"{path}: a number is too large for a float") from error
    if last_width < len(layout.names):
        raise TrajectoryError(
            f"{path}: the last row has fewer than {len(layout.names)} columns: the file is "
            "incomplete"
        )
    return table


def _row_count(path: Path, layout: TableLayout) -> tuple[int, int]:
    """Count the rows of a table, and check that no row has more columns than the header.

    Parameters
    ----------
    path : Path
        File of the table.
    layout : TableLayout
        Header and separator of the table.

    Returns
    -------
    rows : int
        Number of rows.
    last_width : int
        Number of columns of the last row. If it is smaller than in the header, the file is
        incomplete.

    Raises
    ------
    TrajectoryError
        If the file does not contain rows, or if a row has surplus columns.
    """
    width = len(layout.names)
    rows, line = 0, ""
    for k, line in _data_lines(path, layout):
        rows += 1
        count = len(line.rstrip(layout.separator).split(layout.separator))
        if count > width:
            raise TrajectoryError(_column_count_error(path, k, count, width))
    if not rows:
        raise TrajectoryError(f"{path}: no row follows the header")
    return rows, len(line.split(layout.separator))


def read_columns(path: Path, names: Sequence[str]) -> Array:
    """Read the columns with given names from a table, without a conversion of units.

    Parameters
    ----------
    path : Path
        File that is read.
    names : sequence of str
        Names of k columns, as in the header.

    Returns
    -------
    (n, k) array
        Values in the units of the file.

    Raises
    ------
    TrajectoryError
        If a column is missing or a row is invalid.
    """
    layout = read_layout(path)
    for name in names:
        if name not in layout.names:
            raise TrajectoryError(
                f"{path}: no column {name} (streams of the modes csv and cst hold no positions)"
            )
    selected = [TableColumn(layout.names.index(name), name, 1.0) for name in names]
    return read_rows(path, layout, selected)


def _row_error(path: Path, layout: TableLayout, message: str, start: int) -> str:
    """Return the error message for the first invalid row of a table.

    `read_rows` calls this function after numpy has refused a block of rows, because the message of
    numpy does not state the line and the column.

    Parameters
    ----------
    path : Path
        File of the table.
    layout : TableLayout
        Header and separator of the table.
    message : str
        Message of numpy, which is used if every row seems to be valid.
    start : int
        Index of the first row to examine.

    Returns
    -------
    str
        Message with the file, the line and the fault.
    """
    width = len(layout.names)
    for k, line in islice(_data_lines(path, layout), start, None):
        fields = [field.strip() for field in line.split(layout.separator)]
        if len(fields) != width:
            return _column_count_error(path, k, len(fields), width)
        for name, field in zip(layout.names, fields, strict=True):
            if not _is_number(field):
                return f"{path}:{k + 1}: {name}: {field[:40]!r} is not a number"
    return f"{path}: {message}"


def _column_count_error(path: Path, k: int, count: int, width: int) -> str:
    """Return the error message for a row with a wrong number of columns.

    Parameters
    ----------
    path : Path
        File of the table.
    k : int
        Index of the line in the file, from 0.
    count : int
        Number of columns of the row.
    width : int
        Number of columns of the header.

    Returns
    -------
    str
        Message with the file, the line and both numbers.
    """
    return f"{path}:{k + 1}: the row has {count} columns, but the header has {width}"


def _rounding_errors(path: Path, layout: TableLayout, positions: list[TableColumn]) -> Array:
    """Estimate the largest rounding error of the positions of each joint in a table.

    The estimate is half a unit of the last digit that occurs in the first `ROUNDING_SAMPLE_ROWS`
    rows. It is needed to check a motion along straight lines between the rows, because rounding
    changes the slopes of the lines and therefore the velocities.

    Parameters
    ----------
    path : Path
        File of the table.
    layout : TableLayout
        Header and separator of the table.
    positions : list of four TableColumn
        Columns with the positions of joints 1 to 4.

    Returns
    -------
    (4,) array
        Rounding errors of the four joints, in rad for revolute joints and in m for the prismatic
        joint. The error is 0 if every value of the joint is zero.
    """
    exponents = np.full(4, 99)
    for _, line in islice(_data_lines(path, layout), ROUNDING_SAMPLE_ROWS):
        fields = line.split(layout.separator)
        for i, heading in enumerate(positions):
            exponents[i] = min(exponents[i], _last_digit_exponent(fields[heading.column].strip()))
    factors = np.array([heading.factor for heading in positions])
    return np.where(exponents < 99, 0.5 * 10.0**exponents, 0.0) * factors


def _last_digit_exponent(text: str) -> int:
    """Return the power of ten of the last digit of a decimal number.

    Parameters
    ----------
    text : str
        Decimal number, such as "1.25" or "3e-4".

    Returns
    -------
    int
        Exponent of the last digit, such as −2 for "1.25". The result for a zero is 99, which means
        unknown, because a zero does not show how the numbers of its column are rounded.
    """
    mantissa, _, exponent = text.lower().partition("e")
    if not mantissa.strip("+-0."):
        return 99
    # Twelve characters suffice for an exponent that is limited to ±LARGEST_EXPONENT.
    power = int(exponent[:12] or 0) if exponent[1:12].isdecimal() or exponent.isdecimal() else 0
    return min(max(power, -LARGEST_EXPONENT), LARGEST_EXPONENT) - len(mantissa.partition(".")[2])


def _line_number(path: Path, layout: TableLayout, row: int) -> int:
    """Return the number of the line, from 1, that contains the row with the index `row`."""
    return next(islice(_data_lines(path, layout), row, None))[0] + 1


def _data_lines(path: Path, layout: TableLayout) -> Iterator[tuple[int, str]]:
    """Yield the index, from 0, and the text of each line that contains a row of the table."""
    for k, line in _lines(path):
        if k > layout.header and line.strip():
            yield k, line.rstrip("\n")


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the index, from 0, and the text of each line of a file."""
    with _open_text(path) as file:
        yield from enumerate(file)


@contextmanager
def _open_text(path: Path) -> Iterator[TextIO]:
    """Open a text file for reading in a `with` statement.

    Parameters
    ----------
    path : Path
        File that is opened.

    Yields
    ------
    TextIO
        The open file.

    Raises
    ------
    TrajectoryError
        If the file cannot be read, or if it is not a text in UTF-8. This also applies to reading in
        the body of the statement.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            yield file
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: not a text file") from error
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error


def _is_number(text: str) -> bool:
    """Return True if a text is a decimal number, NaN or infinity."""
    pattern = r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?(nan|inf(inity)?)"
    return re.fullmatch(pattern, text.strip(), re.I | re.A) is not None
