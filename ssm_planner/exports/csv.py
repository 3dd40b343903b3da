"""The trajectory as CSV, units in the header names: at a fixed rate, or at the points that keep the limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.exports.atomic import replacing
from ssm_planner.exports.epos4_axis import INT32, axes_of, fits
from ssm_planner.exports.plan_file import PlanFile
from ssm_planner.exports.points import at_times, spline_points
from ssm_planner.model.actuation import directions, motor_motion
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.task import task_from_joints
from ssm_planner.model.trajectory import Samples, Trajectory
from ssm_planner.problem.values import TASK, Array, Robot
from ssm_planner.verify.certificate import Certificate
from ssm_planner.verify.check import check
from ssm_planner.verify.readers_csv import read_csv

RATE = 1000.0
LARGEST_RATE = 100_000.0
STATES = {"q": "", "qd": "_per_s", "qdd": "_per_s2", "qddd": "_per_s3"}
MOTORS = {"angle": "rad", "speed": "rad_per_s", "torque": "Nm"}
COLUMNS = (*STATES, *MOTORS, "task")
"""Groups of columns that can be chosen."""
COUNTS = "counts"
DEFAULT = ("q", "qd", "qdd", "angle", "speed", "torque")


def trajectory_table(
    trajectory: Trajectory, robot: Robot, rate: float = RATE, columns: Sequence[str] = DEFAULT
) -> tuple[list[str], Array]:
    """Header and rows: time, and for every group of `columns` the values of the joints or motors.

    At a break the row holds what follows it; the last row is the end of the motion, whatever the rate.
    """
    samples = trajectory.uniform(rate)
    return table(samples, robot, columns, at_end=samples.t == trajectory.breaks[-1])


def table(samples: Samples, robot: Robot, columns: Sequence[str], at_end: Array) -> tuple[list[str], Array]:
    """Header and rows of samples; at_end (n,): the motion ends there, motors are seen just before."""
    header, values = ["time_s"], [samples.t]
    names = [f"{i + 1}_{'rad' if joint.kind == 'revolute' else 'm'}" for i, joint in enumerate(robot.joints)]
    for symbol, per in STATES.items():
        if symbol in columns:
            header += [f"{symbol}{name}{per}" for name in names]
            values += list(getattr(samples, symbol).T)
    if any(group in columns for group in MOTORS):
        after, before = (directions(robot, samples, side) for side in (1, -1))
        ending = at_end.astype(bool)[:, None]
        direction = np.where(ending, before[0], after[0])
        motor = motor_motion(robot, RigidBody.from_robot(robot), samples, direction, after[1].astype(bool) & ~ending)
        for group, unit in MOTORS.items():
            if group in columns:
                driven = [i for i, joint in enumerate(robot.joints) if joint.drive is not None]
                header += [f"motor{i + 1}_{group}_{unit}" for i in driven]
                values += [getattr(motor, group)[:, i] for i in driven]
    if "task" in columns:
        header += [f"task_{name}_{'m' if name == 'depth' else 'rad'}" for name in TASK]
        values += list(task_from_joints(Mechanism.from_geometry(robot.geometry), samples.q).T)
    return header, np.stack(values, axis=1)


def write_csv(
    path: Path, trajectory: Trajectory, robot: Robot, rate: float = RATE, columns: Sequence[str] = DEFAULT
) -> Path:
    """Write the table at a rate; 12 significant digits. Raises ExportError."""
    header, rows = trajectory_table(trajectory, robot, rate, columns)
    with replacing(path) as temporary:
        _write(temporary, header, rows, "%.12g")
    return path


def export_csv(
    plan: PlanFile,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float | None = None,
    columns: Sequence[str] | None = None,
    counts_per_turn: int | Mapping[str, int] | None = None,
) -> dict[str, object]:
    """Write trajectory.csv into a folder and say what the manifest shall say of it.

    rate: Hz, rows at equal distances; None: rows at the points between which cubics (or quintics) keep the limits.
    columns: groups of COLUMNS; with COUNTS among them also `time,position` files in increments, one for each driven
    joint, at the rate (default RATE), for which counts_per_turn is as in the export to epos4. Raises ExportError.
    """
    wanted = [group for group in columns or () if group != COUNTS]
    unknown = [group for group in wanted if group not in COLUMNS]
    if unknown:
        raise ExportError(f"columns {', '.join(unknown)} are not known (allowed: {', '.join((*COLUMNS, COUNTS))})")
    if rate is not None and not 0 < rate <= LARGEST_RATE:
        raise ExportError(f"a rate of {rate:g} Hz (allowed: above 0, up to {LARGEST_RATE:g} Hz)")
    notes = []
    if COUNTS in (columns or ()):
        notes.append(_write_counts(plan, folder, suffix, rate or RATE, counts_per_turn))
        if not wanted:
            return {"rate_hz": rate or RATE, "units": {"time": "s", "position": "increments"}, "notes": notes}
    path = folder / f"trajectory{suffix}.csv"
    header, rows, note = _rows(plan, certificate, rate, wanted)
    _write(path, header, rows, "%.17g")
    return {
        "trajectory": path.name,
        "rate_hz": rate,
        "units": "in the names of the columns",
        "notes": [*notes, note, *_as_read(path, plan, with_positions="q1_rad" in header)],
    }


def _rows(
    plan: PlanFile, certificate: Certificate, rate: float | None, columns: Sequence[str]
) -> tuple[list[str], Array, str]:
    """(header, rows, what they are)."""
    if rate is None:
        points = spline_points(plan, certificate, tick=None)
        default = ("q", "qd", "qdd") if points.with_acceleration else ("q", "qd")
        at_end = points.samples.t == points.samples.t[-1]
        return *table(points.samples, plan.robot, columns or default, at_end), points.note
    header, rows = trajectory_table(plan.trajectory, plan.robot, rate, columns or DEFAULT)
    return header, rows, f"{len(rows)} rows at {rate:g} Hz; the last row is the end of the motion"


def _write_counts(
    plan: PlanFile, folder: Path, suffix: str, rate: float, counts_per_turn: int | Mapping[str, int] | None
) -> str:
    """Target positions in increments, a file for each driven joint; the last row holds the target."""
    axes = axes_of(plan.robot, counts_per_turn)
    t = np.arange(int(np.ceil(plan.trajectory.duration * rate - 1e-9)) + 1) / rate
    samples = at_times(plan, plan.trajectory.breaks[0] + t)
    for i, joint in enumerate(plan.robot.joints):
        if joint.name in axes:
            counts = axes[joint.name].increments(samples.q[:, i])
            counts = fits(counts, INT32, joint.name, "target position", "increments")
            path = folder / f"{joint.name}_time_position{suffix}.csv"
            _write(path, ["time", "position"], np.column_stack([t, counts]), ("%.9g", "%d"))
    return f"time,position in increments of {', '.join(axes)}: {len(t)} rows at {rate:g} Hz"


def _as_read(path: Path, plan: PlanFile, with_positions: bool) -> list[str]:
    """What a check of the rows alone says, joined as a controller would join them."""
    if not with_positions:
        return []
    reading = read_csv(path, plan.robot)
    found = check(
        reading.trajectory,
        plan.robot,
        plan.limits,
        resolution=reading.resolution,
        interpolation=reading.interpolation,
    )
    if found.passed:
        return [f"joined by a controller, {reading.interpolation}, the rows keep every limit"]
    worst = found.worst
    return [
        f"joined by a controller, {reading.interpolation}, the rows exceed the {worst.name} limit of "
        f"{worst.joint or 'the tool'} by {-100 * worst.margin:.3g} % at {worst.time:.4f} s: equal distances do not meet "
        "the instants where the plan's acceleration jumps; without a rate the rows do"
    ]


def _write(path: Path, header: list[str], rows: Array, form: str | Sequence[str]) -> None:
    np.savetxt(path, rows, fmt=form, delimiter=",", header=",".join(header), comments="")
