"""Setpoint streams and setup objects for maxon EPOS4 drives (CiA 402): cyclic position, velocity or torque.

Streams of setpoints that the export for EPOS4 drives wrote, back as a joint trajectory.
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.display import number
from ssm_planner.dynamics.motors import directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.epos4_offsets import Offsets, offset_checks
from ssm_planner.formats.epos4_setup import (
    INT16,
    INT32,
    MODES,
    NOT_VERIFIED,
    Axis,
    axes_of,
    encoder_notes,
    fits,
    homing,
    pdo_mapping,
    setup_objects,
    sync_setup,
)
from ssm_planner.formats.points import Points, Reading, join_points
from ssm_planner.formats.spline_points import REST, at_times
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import JOINTS, Joint, Robot
from ssm_planner.typing import Array
from ssm_planner.units import rpm, shown
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.ends import end_velocities

LARGEST_PERIOD = 100
"""ms; object 0x60C2."""

Stream = dict[str, Array]
"""Whole numbers by column name."""


def export_epos4(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float = 1000.0,
    mode: str = "csp",
    counts_per_turn: int | Mapping[str, int] | None = None,
) -> dict[str, Any]:
    """Write one stream per driven joint, its `time,position` form, and objects.csv; returns what the manifest says.

    rate: setpoints per second, of which one interpolation period must be 1 to 100 whole ms. mode: csp, csv or cst.
    counts_per_turn: increments per motor turn (4 × encoder counts) where the motor files give none, one for all joints
    or by joint. Raises ExportError: missing figures, a period that is not whole, numbers that do not fit their object.
    """
    if mode not in MODES:
        raise ExportError(f"mode {mode!r} (allowed: {', '.join(MODES)})")
    period = period_ms(rate)
    axes = axes_of(plan.robot, counts_per_turn)
    t, stretch = setpoint_times(plan, period)
    motion = _motion(plan, t, stretch)
    streams = _streams(axes, motion, mode)
    listed: dict[str, Any] = {}
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
            listed[joint.name] = {
                "file": name,
                "note": "no drive: its motion for reference, not a stream",
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
        listed[joint.name] = {
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
        "axes": listed,
        "stretch": stretch,
        "not_verified": list(NOT_VERIFIED),
        "notes": [*_notes(plan, axes, t, listed), *_moving_notes(plan)],
    }


def setpoint_times(plan: Plan, period: int) -> tuple[Array, float]:
    """When setpoints are sent, s from the start, (n,), period in ms, and the factor by which the motion is slower.

    The last one is the target. What ends moving must end at a setpoint: the whole of it is slower by less than one period.
    """
    count = int(np.ceil(plan.motion.duration * 1000 / period - 1e-9)) + 1
    t: Array = np.arange(count, dtype=float) * (period / 1000)
    moving = bool(np.abs(end_velocities(plan.motion)[1]).max() > REST)
    return t, float(t[-1]) / plan.motion.duration if moving else 1.0


def setpoints(
    plan: Plan, axes: Mapping[str, Axis], period: int, mode: str = "csp"
) -> dict[str, Stream]:
    """What the export writes for every driven joint, by joint: columns (n,) of whole numbers by name. period: ms."""
    return _streams(axes, _motion(plan, *setpoint_times(plan, period)), mode)


def period_ms(rate: float) -> int:
    """Interpolation period of a rate in Hz, whole ms. Raises ExportError."""
    period = 1000 / rate if rate > 0 else 0.0
    if not (
        np.isfinite(period)
        and 1 <= round(period) <= LARGEST_PERIOD
        and abs(period - round(period)) < 1e-9
    ):
        raise ExportError(
            f"a rate of {rate:g} Hz is a period of {period:.6g} ms: object 0x60C2 takes whole ms from 1 to {LARGEST_PERIOD} "
            "(allowed: 1000, 500, 250, 200, 125, 100 Hz and so on)"
        )
    return round(period)


def rounding_effects(counts: Array, q: Array, axis: Axis, period: float) -> dict[str, float]:
    """Largest effect of rounding positions q (n,) to increments (n,) on position, speed and acceleration; rad or m, s."""
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
        f"the motion ends moving ({', '.join(speeds)}): the setpoint after the last must carry it on, as no drive can stop "
        "at once"
    ]


def _motion(plan: Plan, t: Array, stretch: float) -> dict[str, Array]:
    """q and the motors' speed and torque (n, 4) at times t after the start; where the motion ends at rest they hold."""
    samples = at_times(plan, plan.motion.breaks[0] + t, stretch)
    moving = np.abs(end_velocities(plan.motion)[1]) > REST
    ended = (t >= plan.motion.duration * stretch * (1 - 1e-12))[:, None] & ~moving
    samples.qd[ended], samples.qdd[ended] = 0.0, 0.0
    direction, breakaway = directions(plan.robot, samples, 1)
    direction, starting = np.where(ended, 0.0, direction), breakaway.astype(bool) & ~ended
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
        fits(
            position := axis.increments(motion["q"][:, i]),
            INT32,
            name,
            "target position",
            "increments",
        )
        fits(speed, INT32, name, "velocity", "mrpm")
        fits(torque, INT16, name, "torque", "per mille of rated torque (INT16)")
        columns = (position, speed, torque)[3 - len(COLUMNS[mode]) :]
        streams[name] = {
            column: values + 0.0 for column, values in zip(COLUMNS[mode], columns, strict=True)
        }
    return streams


def write_table(path: Path, columns: Stream, forms: tuple[str, str] = ("%.3f", "%d")) -> None:
    """Columns (n,) by name as a CSV file; forms: of the first, which is the time, and of the others."""
    rows = np.column_stack(list(columns.values()))
    every = [forms[0], *(forms[1],) * (len(columns) - 1)]
    np.savetxt(path, rows, fmt=every, delimiter=",", header=",".join(columns), comments="")


def _write_objects(path: Path, rows: list[dict[str, str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(
            file, fieldnames=["joint", "object", "name", "value", "unit", "reason", "known"]
        )
        writer.writeheader()
        writer.writerows(rows)


def _notes(plan: Plan, axes: dict[str, Axis], t: Array, listed: dict[str, Any]) -> list[str]:
    notes = [f"{len(t)} setpoints; the last is the target, reached by {t[-1]:.3f} s"]
    travel = np.ptp(plan.motion.sample(plan.motion.breaks).q, axis=0)
    for joint, way in zip(plan.robot.joints, travel.tolist(), strict=True):
        unit, scale = shown(joint.unit)
        if joint.name not in axes:
            if way > 0:
                far = number(scale * way, 4)
                notes.append(
                    f"joint {joint.name} has no drive and is not streamed, though the plan moves it by {far} {unit}"
                )
            continue
        if joint.motor is not None and "nominal_torque" in joint.motor.placeholders:
            notes.append(
                f"joint {joint.name}: the rated torque behind its torque offsets is a placeholder figure"
            )
        effects = listed[joint.name]["rounding"]
        position, speed, difference = (
            number(scale * effects[name], 2) for name in ("position", "speed", "acceleration")
        )
        notes.append(
            f"joint {joint.name}: rounding to increments moves setpoints by up to {position} {unit}, "
            f"the speed between two by {speed} {unit}/s ({100 * effects['speed'] / joint.velocity:.2g} % "
            f"of its limit), its difference by {difference} {unit}/s²; it does not add up"
        )
    return [*notes, *encoder_notes(axes)]


TIME, POSITION, VELOCITY, TORQUE = (
    "time_s",
    "target_position_inc",
    "velocity_offset_mrpm",
    "torque_offset_permille",
)
COLUMNS = {
    "csp": (POSITION, VELOCITY, TORQUE),
    "csv": ("target_velocity_mrpm", TORQUE),
    "cst": ("target_torque_permille",),
}
"""Of the streams, by mode."""
SAME = 1e-9
"""Relative: figures of the manifest and of the robot that are the same."""


def read_epos4(
    folder: Path, manifest: dict[str, Any], listed: Collection[str], robot: Robot
) -> Reading:
    """Target positions in increments as joint positions, joined by straight lines, and what their offsets show.

    Joints without a drive come from their reference file, in rad or m. listed: files of the manifest whose content is
    known to be as exported. Raises TrajectoryError.
    """
    columns, resolution, offsets = [], np.zeros(4), {}
    time: Array | None = None
    for i, (joint, path, per_unit) in enumerate(read_axes(folder, manifest, listed, robot)):
        if per_unit is not None:
            t, (counts, speed, torque) = read_table(path, TIME, (POSITION, VELOCITY, TORQUE))
            values = counts / per_unit
            resolution[i] = 0.5 / abs(per_unit)
            offsets[i] = _offsets(joint, speed, torque)
        else:
            t, (values,) = read_table(path, TIME, (f"position_{joint.unit}",))
        if time is not None and not np.array_equal(time, t):
            raise TrajectoryError(f"{folder}: the streams of the axes do not have the same times")
        time = t
        columns.append(values)
    if time is None:
        raise TrajectoryError(f"{folder}: no streams")
    q = np.stack(columns, axis=1)
    reading = join_points(
        Points(time, q, resolution=resolution, place=f"{folder}: setpoint {{}}".format), robot
    )
    return replace(reading, checks=tuple(offset_checks(robot, time, q, resolution, offsets)))


def read_axes(
    folder: Path, manifest: dict[str, Any], listed: Collection[str], robot: Robot
) -> Iterator[tuple[Joint, Path, float | None]]:
    """Of every joint its file among those listed, and its increments per rad or m if it has a drive.

    Raises TrajectoryError.
    """
    axes = manifest.get("axes")
    if not isinstance(axes, dict) or set(axes) != {joint.name for joint in robot.joints}:
        raise TrajectoryError(
            f"{folder}: the manifest does not list the joints of robot {robot.name}"
        )
    for joint in robot.joints:
        axis = axes[joint.name]
        name = axis.get("file") if isinstance(axis, dict) else None
        if not isinstance(name, str) or name not in listed:
            raise TrajectoryError(f"{folder}: the manifest lists no file for joint {joint.name}")
        yield (
            joint,
            folder / name,
            _per_unit(folder, joint, axis) if "increments_per_unit" in axis else None,
        )


def _per_unit(folder: Path, joint: Joint, axis: dict[str, Any]) -> float:
    """Increments per rad or m of a joint, which follow from its drive. Raises TrajectoryError."""
    stated, turn = axis["increments_per_unit"], axis.get("increments_per_motor_turn")
    if joint.drive is None or joint.motor is None:
        raise TrajectoryError(
            f"{folder}: joint {joint.name} of the robot has no drive or no motor, but a stream"
        )
    if type(turn) is not int or not 0 < turn <= INT32 or type(stated) not in (int, float):
        raise TrajectoryError(
            f"{folder}: increments of joint {joint.name} are not given by the manifest"
        )
    expected = joint.motor_direction * joint.drive.ratio * turn / (2 * np.pi)
    if not abs(stated - expected) <= SAME * abs(expected):
        raise TrajectoryError(
            f"{folder}: joint {joint.name}: {stated:.9g} increments per {joint.unit} where "
            f"the robot's drive and {turn} increments per motor turn make {expected:.9g}"
        )
    rated = axis.get("rated_torque_Nm")
    if not isinstance(rated, (int, float)) or not abs(
        rated - joint.motor.nominal_torque
    ) <= SAME * abs(rated):
        raise TrajectoryError(
            f"{folder}: joint {joint.name}: the rated torque is not that of the robot's motor"
        )
    return float(stated)


def _offsets(joint: Joint, speed: Array, torque: Array) -> Offsets:
    """Offsets (n,) in mrpm and per mille on the joint's side."""
    if joint.drive is None or joint.motor is None:
        raise TrajectoryError(f"joint {joint.name} of the robot has no drive or no motor")
    to_speed = joint.motor_direction * rpm / (1000 * joint.drive.ratio)
    to_torque = joint.motor_direction * joint.motor.nominal_torque / 1000
    return Offsets(speed * to_speed, torque * to_torque, 0.5 * abs(to_speed), 0.5 * abs(to_torque))


def read_table(path: Path, time: str, columns: Sequence[str]) -> tuple[Array, list[Array]]:
    """(first column (n,), which is `time`, values (n,) of each of the columns) of a file. Raises TrajectoryError."""
    try:
        with path.open(encoding="utf-8") as file:
            names = file.readline().strip().split(",")
        for column in (time, *columns):
            if column not in names:
                raise TrajectoryError(
                    f"{path}: no column {column} (streams of the modes csv and cst hold no positions)"
                )
        wanted = [names.index(column) for column in (time, *columns)]
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", UserWarning
            )  # of a file without rows, which is said below
            rows = np.loadtxt(
                path, delimiter=",", skiprows=1, usecols=wanted, ndmin=2, encoding="utf-8"
            )
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, OverflowError) as error:
        raise TrajectoryError(f"{path}: {error}") from error
    if len(rows) < 2 or not np.isfinite(rows).all():
        raise TrajectoryError(f"{path}: fewer than two rows, or numbers that are not finite")
    return rows[:, 0], list(rows[:, 1:].T)
