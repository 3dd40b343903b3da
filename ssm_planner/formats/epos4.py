"""Write and read streams of setpoints for maxon EPOS4 drives (CiA 402).

The streams contain positions, velocities or torques for the cyclic synchronous modes. The export
also writes the setup objects of the drives. Streams of positions can be read as a trajectory.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ssm_planner.display import number
from ssm_planner.dynamics import RigidBody, directions, motor_motion
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.csv import data_rows, layout_of
from ssm_planner.formats.epos4_offsets import Offsets, offset_checks
from ssm_planner.formats.epos4_setup import (
    INT16,
    INT32,
    MODES,
    NOT_VERIFIED,
    Axis,
    CountsPerTurn,
    axes_of,
    encoder_notes,
    homing,
    pdo_mapping,
    require_range,
    setup_objects,
    sync_setup,
)
from ssm_planner.formats.points import Points, Reading, join_points
from ssm_planner.formats.spline_points import REST, at_times
from ssm_planner.formats.trajectory_csv import Heading
from ssm_planner.plans import Plan
from ssm_planner.problem import JOINTS, Joint, Robot
from ssm_planner.typing import Array, JsonObject
from ssm_planner.units import display_unit, rpm
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.ends import end_velocities

LARGEST_PERIOD = 100
"""Largest interpolation period, ms (object 0x60C2)."""

Stream = dict[str, Array]
"""Integer values (n,) by name of the column."""


def export_epos4(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float = 1000.0,
    mode: str = "csp",
    counts_per_turn: CountsPerTurn = None,
) -> JsonObject:
    """Write one stream per driven joint and objects.csv, and return the entries of the manifest.

    In mode csp, every driven joint also gets a file with the columns `time` and `position`.

    Parameters
    ----------
    plan : Plan
    certificate : Certificate
        Certificate of the plan.
    folder : Path
    suffix : str
        Text that marks unverified files, before the extension.
    rate : float
        Setpoints per second, Hz. The period must be an integer from 1 to 100 ms.
    mode : str
        csp (position), csv (velocity) or cst (torque).
    counts_per_turn : int or mapping from joint to int, optional
        Increments per motor turn, see `axes_of`.

    Raises
    ------
    ExportError
        If the mode or the rate is not allowed, an encoder resolution is missing, or a number does
        not fit its object.
    """
    if mode not in MODES:
        raise ExportError(f"unknown mode {mode!r} (allowed: {', '.join(MODES)})")
    period = period_ms(rate)
    axes = axes_of(plan.robot, counts_per_turn)
    t, stretch = setpoint_times(plan, period)
    motion = _motion(plan, t, stretch)
    streams = _streams(axes, motion, mode)
    entries: JsonObject = {}
    rows: list[dict[str, str]] = []
    for i, joint in enumerate(plan.robot.joints):
        name = f"{joint.name}{suffix}.csv"
        axis = axes.get(joint.name)
        if axis is None:
            write_table(
                folder / name,
                {TIME: t, f"position_{joint.unit}": motion["q"][:, i]},
                ("%.3f", "%.17g"),
            )
            entries[joint.name] = {
                "file": name,
                "note": "no drive: the file shows the joint's motion for reference and is not a "
                "stream",
            }
            continue
        counts = axis.increments(motion["q"][:, i])
        effects = rounding_effects(counts, motion["q"][:, i], axis, period / 1000)
        write_table(folder / name, {TIME: t, **streams[joint.name]})
        if mode == "csp":
            write_table(
                folder / f"{joint.name}_time_position{suffix}.csv", {"time": t, "position": counts}
            )
        rows += setup_objects(axis, mode, period, effects)
        entries[joint.name] = {
            "file": name,
            **axis.to_dict(),
            "rounding": effects,
            "homing": homing(axis, counts[0]),
        }
    _write_objects(folder / f"objects{suffix}.csv", rows)
    return {
        "mode": mode,
        "rate_hz": 1000 / period,
        "interpolation_period_ms": period,
        "pdo": pdo_mapping(mode),
        "sync": sync_setup(period),
        "units": {
            "inc": "increments (quadcounts)",
            "mrpm": "1e-3 rpm at the motor",
            "permille": "of rated torque",
        },
        "axes": entries,
        "stretch": stretch,
        "not_verified": list(NOT_VERIFIED),
        "notes": [*_notes(plan, axes, t, entries), *_moving_notes(plan)],
    }


def setpoint_times(plan: Plan, period: int) -> tuple[Array, float]:
    """Return the instants of the setpoints, and the factor by which the motion is slowed down.

    The last setpoint is the target. A motion that does not end at rest must end exactly at a
    setpoint. Therefore, it is slowed down, which adds less than one period to its duration.

    Parameters
    ----------
    plan : Plan
    period : int
        Interval between setpoints, ms.

    Returns
    -------
    t : (n,)
        Instants since the start, s.
    stretch : float
        New duration divided by the planned duration.
    """
    count = int(np.ceil(plan.motion.duration * 1000 / period - 1e-9)) + 1
    t = np.arange(count, dtype=float) * (period / 1000)
    moving = bool(np.abs(end_velocities(plan.motion)[1]).max() > REST)
    return t, float(t[-1]) / plan.motion.duration if moving else 1.0


def setpoints(plan: Plan, axes: Mapping[str, Axis], period: int) -> dict[str, Stream]:
    """Return the streams that an export in the mode csp contains, by joint.

    `axes` contains the axes of the driven joints, and `period` is the interval between setpoints
    in ms.
    """
    return _streams(axes, _motion(plan, *setpoint_times(plan, period)), "csp")


def period_ms(rate: float) -> int:
    """Return the interpolation period for a rate in Hz, in whole ms.

    Raises ExportError if the period is not an integer from 1 to `LARGEST_PERIOD`.
    """
    period = 1000 / rate if rate > 0 else 0.0
    if not (
        np.isfinite(period)
        and 1 <= round(period) <= LARGEST_PERIOD
        and abs(period - round(period)) < 1e-9
    ):
        raise ExportError(
            f"the rate {rate:g} Hz has a period of {period:.6g} ms, but object 0x60C2 needs whole "
            f"ms from 1 to {LARGEST_PERIOD} (allowed: 1000, 500, 250, 200, 125, 100 Hz and so on)"
        )
    return round(period)


def rounding_effects(counts: Array, q: Array, axis: Axis, period: float) -> dict[str, float]:
    """Return the largest errors that result from rounding positions to increments.

    Parameters
    ----------
    counts : (n,)
        Rounded positions, increments.
    q : (n,)
        Exact joint positions, rad or m.
    axis : Axis
    period : float
        Interval between the positions, s.

    Returns
    -------
    dict[str, float]
        Errors of the joint's position, speed and acceleration, rad or m and s.
    """
    error = counts / axis.increments_per_unit - q
    return {
        "position": float(np.abs(error).max()),
        "speed": float(np.abs(np.diff(error)).max(initial=0.0)) / period,
        "acceleration": float(np.abs(np.diff(error, 2)).max(initial=0.0)) / period**2,
    }


def _moving_notes(plan: Plan) -> list[str]:
    velocities = end_velocities(plan.motion)[1]
    if np.abs(velocities).max() <= REST:
        return []
    speeds = [
        f"{joint.name} at {velocity:.4g} {joint.unit}/s"
        for joint, velocity in zip(plan.robot.joints, velocities.tolist(), strict=True)
        if abs(velocity) > REST
    ]
    return [
        f"the motion ends moving ({', '.join(speeds)}): the controller must continue the motion "
        "after the last setpoint, because no drive can stop at once"
    ]


def _motion(plan: Plan, t: Array, stretch: float) -> dict[str, Array]:
    """Return q and the speeds and torques of the motors (n, 4) at instants t (n,) since the start.

    `stretch` is the factor on the duration. Joints that end at rest hold their last position.
    """
    samples = at_times(plan, plan.motion.breaks[0] + t, stretch)
    moving = np.abs(end_velocities(plan.motion)[1]) > REST
    ended = (t >= plan.motion.duration * stretch * (1 - 1e-12))[:, None] & ~moving
    samples.qd[ended], samples.qdd[ended] = 0.0, 0.0
    direction, breakaway = directions(plan.robot, samples, 1)
    direction = np.where(ended, 0.0, direction)
    starting = breakaway.astype(bool) & ~ended
    motor = motor_motion(
        plan.robot,
        RigidBody.from_robot(plan.robot),
        samples,
        direction,
        np.asarray(starting, dtype=float),
    )
    return {"q": samples.q, "speed": motor.speed, "torque": motor.torque}


def _streams(axes: Mapping[str, Axis], motion: dict[str, Array], mode: str) -> dict[str, Stream]:
    streams = {}
    for name, axis in axes.items():
        i = JOINTS.index(name)
        speed = np.round(axis.direction * motion["speed"][:, i] / rpm * 1000)
        torque = np.round(axis.direction * motion["torque"][:, i] / axis.rated_torque * 1000)
        require_range(
            position := axis.increments(motion["q"][:, i]),
            INT32,
            name,
            "target position",
            "increments",
        )
        require_range(speed, INT32, name, "velocity", "mrpm")
        require_range(torque, INT16, name, "torque", "per mille of rated torque (INT16)")
        columns = (position, speed, torque)[3 - len(COLUMNS[mode]) :]
        streams[name] = {
            column: values + 0.0 for column, values in zip(COLUMNS[mode], columns, strict=True)
        }
    return streams


def write_table(path: Path, columns: Stream, forms: tuple[str, str] = ("%.3f", "%d")) -> None:
    """Write columns (n,) to a CSV file.

    `forms` contains the printf format of the first column, which is the time, and the format of all
    other columns.
    """
    rows = np.column_stack(list(columns.values()))
    formats = [forms[0], *(forms[1],) * (len(columns) - 1)]
    np.savetxt(path, rows, fmt=formats, delimiter=",", header=",".join(columns), comments="")


def _write_objects(path: Path, rows: list[dict[str, str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(
            file, fieldnames=["joint", "object", "name", "value", "unit", "reason", "known"]
        )
        writer.writeheader()
        writer.writerows(rows)


def _notes(plan: Plan, axes: dict[str, Axis], t: Array, entries: JsonObject) -> list[str]:
    notes = [f"{len(t)} setpoints; the last is the target, reached by {t[-1]:.3f} s"]
    travel = np.ptp(plan.motion.sample(plan.motion.breaks).q, axis=0)
    for joint, distance in zip(plan.robot.joints, travel.tolist(), strict=True):
        unit, scale = display_unit(joint.unit)
        if joint.name not in axes:
            if distance > 0:
                length = number(scale * distance, 4)
                notes.append(
                    f"joint {joint.name} has no drive and no stream, but the plan moves "
                    f"it by {length} {unit}"
                )
            continue
        if joint.motor is not None and "nominal_torque" in joint.motor.placeholders:
            notes.append(
                f"joint {joint.name}: its torque offsets use a placeholder value of the rated "
                "torque"
            )
        effects = entries[joint.name]["rounding"]
        position, speed, difference = (
            number(scale * effects[name], 2) for name in ("position", "speed", "acceleration")
        )
        notes.append(
            f"joint {joint.name}: rounding to increments moves setpoints by up to {position} "
            f"{unit}, the speed between setpoints by {speed} {unit}/s "
            f"({100 * effects['speed'] / joint.velocity:.2g} % of its limit), and the acceleration "
            f"by {difference} {unit}/s²; the errors do not accumulate"
        )
    return [*notes, *encoder_notes(axes)]


TIME = "time_s"
POSITION = "target_position_inc"
VELOCITY = "velocity_offset_mrpm"
TORQUE = "torque_offset_permille"
COLUMNS = {
    "csp": (POSITION, VELOCITY, TORQUE),
    "csv": ("target_velocity_mrpm", TORQUE),
    "cst": ("target_torque_permille",),
}
"""Columns of a stream, by mode."""
SAME = 1e-9
"""Relative tolerance for equal values in the manifest and in the robot."""


def read_epos4(folder: Path, manifest: JsonObject, names: Collection[str], robot: Robot) -> Reading:
    """Read the target positions of an export as a trajectory of straight lines.

    The velocity and torque offsets are compared with the positions. Positions of joints without a
    drive come from their reference files in rad or m.

    Parameters
    ----------
    folder : Path
    manifest : dict
    names : Collection[str]
        Files of the manifest whose content is unchanged since the export.
    robot : Robot

    Raises
    ------
    TrajectoryError
        If a stream is missing or damaged, or the robot has other drives than the manifest states.
    """
    columns = []
    resolution = np.zeros(4)
    offsets = {}
    time: Array | None = None
    for i, (joint, path, per_unit) in enumerate(read_axes(folder, manifest, names, robot)):
        if per_unit is not None:
            t, (counts, speed, torque) = read_table(path, TIME, (POSITION, VELOCITY, TORQUE))
            values = counts / per_unit
            resolution[i] = 0.5 / abs(per_unit)
            offsets[i] = _offsets(joint, speed, torque)
        else:
            t, (values,) = read_table(path, TIME, (f"position_{joint.unit}",))
        if time is not None and not np.array_equal(time, t):
            raise TrajectoryError(f"{folder}: the streams of the axes have different times")
        time = t
        columns.append(values)
    assert time is not None
    q = np.stack(columns, axis=1)
    reading = join_points(
        Points(time, q, resolution=resolution, place=f"{folder}: setpoint {{}}".format), robot
    )
    return replace(reading, checks=tuple(offset_checks(robot, time, q, resolution, offsets)))


def read_axes(
    folder: Path, manifest: JsonObject, names: Collection[str], robot: Robot
) -> Iterator[tuple[Joint, Path, float | None]]:
    """Yield every joint with its file, and its increments per rad or m (None without a drive).

    The arguments are those of `read_epos4`. Raises TrajectoryError if the manifest does not list a
    file for each joint of the robot.
    """
    axes = manifest.get("axes")
    if not isinstance(axes, dict) or set(axes) != {joint.name for joint in robot.joints}:
        raise TrajectoryError(
            f"{folder}: the manifest does not list the joints of robot {robot.name}"
        )
    for joint in robot.joints:
        axis = axes[joint.name]
        name = axis.get("file") if isinstance(axis, dict) else None
        if not isinstance(name, str) or name not in names:
            raise TrajectoryError(f"{folder}: the manifest lists no file for joint {joint.name}")
        yield (
            joint,
            folder / name,
            _per_unit(folder, joint, axis) if "increments_per_unit" in axis else None,
        )


def _per_unit(folder: Path, joint: Joint, axis: JsonObject) -> float:
    """Return the increments per rad or m of a joint.

    Raises TrajectoryError if they do not follow from the drive of the joint.
    """
    numbers = axis["increments_per_unit"]
    turn = axis.get("increments_per_motor_turn")
    if joint.drive is None or joint.motor is None:
        raise TrajectoryError(
            f"{folder}: joint {joint.name} has a stream, but the robot has no drive or no motor "
            "for it"
        )
    if type(turn) is not int or not 0 < turn <= INT32 or type(numbers) not in (int, float):
        raise TrajectoryError(
            f"{folder}: the manifest does not give the increments of joint {joint.name}"
        )
    expected = joint.motor_direction * joint.drive.ratio * turn / (2 * np.pi)
    if not math.isclose(numbers, expected, rel_tol=SAME):
        raise TrajectoryError(
            f"{folder}: joint {joint.name}: the manifest states {numbers:.9g} increments per "
            f"{joint.unit}, but the robot's drive and {turn} increments per motor turn give "
            f"{expected:.9g}"
        )
    rated = axis.get("rated_torque_Nm")
    if not isinstance(rated, (int, float)) or not math.isclose(
        rated, joint.motor.nominal_torque, rel_tol=SAME
    ):
        raise TrajectoryError(
            f"{folder}: joint {joint.name}: the rated torque differs from that of the robot's motor"
        )
    return float(numbers)


def _offsets(joint: Joint, speed: Array, torque: Array) -> Offsets:
    """Convert offsets (n,) in mrpm and per mille to the joint's side."""
    assert joint.drive is not None
    assert joint.motor is not None
    to_speed = joint.motor_direction * rpm / (1000 * joint.drive.ratio)
    to_torque = joint.motor_direction * joint.motor.nominal_torque / 1000
    return Offsets(speed * to_speed, torque * to_torque, 0.5 * abs(to_speed), 0.5 * abs(to_torque))


def read_table(path: Path, time: str, columns: Sequence[str]) -> tuple[Array, list[Array]]:
    """Read a CSV file and return its time column (n,) and the values (n,) of the columns.

    Raises TrajectoryError if a column is missing or a value is not a finite number.
    """
    layout = layout_of(path)
    selected = []
    for column in (time, *columns):
        if column not in layout.names:
            raise TrajectoryError(
                f"{path}: no column {column} (streams of the modes csv and cst hold no positions)"
            )
        selected.append(Heading(layout.names.index(column), column, 1.0))
    rows = data_rows(path, layout, selected)
    times = np.concatenate(rows.times)
    values = rows.columns(0, len(columns))[:]
    if len(times) < 2 or not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise TrajectoryError(
            f"{path}: the file has fewer than two rows or contains numbers that are not finite"
        )
    return times, list(values.T)
