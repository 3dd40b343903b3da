"""Setpoint streams and setup objects for maxon EPOS4 drives (CiA 402): cyclic position, velocity or torque.

Streams of setpoints that the export for EPOS4 drives wrote, back as a joint trajectory.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.dynamics.motors import directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.epos4_setup import INT16, INT32, MODES, Axis, axes_of, fits, setup_objects
from ssm_planner.formats.points import Points, Reading, join_points
from ssm_planner.formats.spline_points import at_times
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

LARGEST_PERIOD = 100
"""ms; object 0x60C2."""
RPM = 60 / (2 * np.pi)

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
    count = int(np.ceil(plan.motion.duration * 1000 / period - 1e-9)) + 1
    t: Array = np.arange(count, dtype=float) * (period / 1000)
    motion = _motion(plan, t)
    listed: dict[str, Any] = {}
    rows: list[dict[str, str]] = []
    for i, joint in enumerate(plan.robot.joints):
        name = f"{joint.name}{suffix}.csv"
        axis = axes.get(joint.name)
        if axis is None:
            _write(folder / name, t, {f"position_{'rad' if joint.kind == 'revolute' else 'm'}": motion["q"][:, i]})
            listed[joint.name] = {"file": name, "note": "no drive: its motion for reference, not a stream"}
            continue
        counts = fits(axis.increments(motion["q"][:, i]), INT32, joint.name, "target position", "increments")
        effects = rounding_effects(counts, motion["q"][:, i], axis, period / 1000)
        _write(folder / name, t, _stream(mode, axis, counts, motion, i))
        if mode == "csp":
            _write(folder / f"{joint.name}_time_position{suffix}.csv", t, {"position": counts}, time="time")
        rows += setup_objects(axis, mode, period, effects)
        listed[joint.name] = {"file": name, **axis.to_dict(), "rounding": effects}
    _write_objects(folder / f"objects{suffix}.csv", rows)
    return {
        "mode": mode,
        "rate_hz": 1000 / period,
        "interpolation_period_ms": period,
        "units": {"inc": "increments (quadcounts)", "mrpm": "1e-3 rpm at the motor", "permille": "of rated torque"},
        "axes": listed,
        "notes": [*_notes(plan, axes, t), *_rounding_notes(plan, listed)],
    }


def period_ms(rate: float) -> int:
    """Interpolation period of a rate in Hz, whole ms. Raises ExportError."""
    period = 1000 / rate if rate > 0 else 0.0
    if not (np.isfinite(period) and 1 <= round(period) <= LARGEST_PERIOD and abs(period - round(period)) < 1e-9):
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


def _motion(plan: Plan, t: Array) -> dict[str, Array]:
    """q and the motors' speed and torque (n, 4) at times t after the start; at the end the drives hold."""
    samples = at_times(plan, plan.motion.breaks[0] + t)
    ended = (t >= plan.motion.duration * (1 - 1e-12))[:, None]
    samples.qd[ended[:, 0]], samples.qdd[ended[:, 0]] = 0.0, 0.0
    direction, breakaway = directions(plan.robot, samples, 1)
    direction, starting = np.where(ended, 0.0, direction), breakaway.astype(bool) & ~ended
    motor = motor_motion(
        plan.robot, RigidBody.from_robot(plan.robot), samples, direction, np.asarray(starting, dtype=float)
    )
    return {"q": samples.q, "speed": motor.speed, "torque": motor.torque}


def _stream(mode: str, axis: Axis, counts: Array, motion: dict[str, Array], i: int) -> Stream:
    speed = axis.direction * motion["speed"][:, i] * RPM * 1000
    torque = axis.direction * motion["torque"][:, i] / axis.rated_torque * 1000
    speed = fits(np.round(speed), INT32, axis.name, "velocity", "mrpm")
    torque = fits(np.round(torque), INT16, axis.name, "torque", "per mille of rated torque (INT16)")
    if mode == "csp":
        return {
            "target_position_inc": counts,
            "velocity_offset_mrpm": speed,
            "torque_offset_permille": torque,
        }
    if mode == "csv":
        return {"target_velocity_mrpm": speed, "torque_offset_permille": torque}
    return {"target_torque_permille": torque}


def _write(path: Path, t: Array, columns: Stream, time: str = "time_s") -> None:
    header = ",".join([time, *columns])
    forms = ["%.3f", *("%.17g" if name.startswith("position_") else "%d" for name in columns)]
    np.savetxt(path, np.column_stack([t, *columns.values()]), fmt=forms, delimiter=",", header=header, comments="")


def _write_objects(path: Path, rows: list[dict[str, str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=["joint", "object", "name", "value", "unit", "reason"])
        writer.writeheader()
        writer.writerows(rows)


def _notes(plan: Plan, axes: dict[str, Axis], t: Array) -> list[str]:
    notes = [f"{len(t)} setpoints; the last is the target, reached by {t[-1]:.3f} s"]
    for i, joint in enumerate(plan.robot.joints):
        travel = float(np.ptp(plan.motion.sample(plan.motion.breaks).q[:, i]))
        if joint.name not in axes and travel > 0:
            unit = "rad" if joint.kind == "revolute" else "m"
            notes.append(
                f"joint {joint.name} has no drive and is not streamed, though the plan moves it by {travel:.4g} {unit}"
            )
        elif joint.motor is not None and "nominal_torque" in joint.motor.placeholders:
            notes.append(f"joint {joint.name}: the rated torque behind its torque offsets is a placeholder figure")
    return notes


def _rounding_notes(plan: Plan, listed: dict[str, Any]) -> list[str]:
    notes = []
    for joint in plan.robot.joints:
        effects = listed[joint.name].get("rounding")
        if effects is not None:
            unit = "rad" if joint.kind == "revolute" else "m"
            notes.append(
                f"joint {joint.name}: rounding to increments moves setpoints by up to {effects['position']:.2g} {unit}, "
                f"the speed between two by {effects['speed']:.2g} {unit}/s ({100 * effects['speed'] / joint.velocity:.2g} % "
                f"of its limit), its difference by {effects['acceleration']:.2g} {unit}/s²; it does not add up"
            )
    return notes


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
