"""Write and read streams of setpoints for maxon EPOS4 drives (CiA 402).

A stream is a table of setpoints that a controller sends to one drive, with one row per
interpolation period. A row contains a target position (mode csp), a target velocity (csv) or a
target torque (cst), which are the cyclic synchronous modes of the drive. In the mode csp, it also
contains a velocity offset and a torque offset, and in the mode csv a torque offset. Offsets are
values that the drive may use as feed-forward. `export_epos4` writes one stream per driven joint,
and the setup objects of the drives (`epos4_setup`). `read_epos4` reads streams of positions as a
trajectory, so that the motion of the drives can be checked.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ssm_planner.display import format_number
from ssm_planner.dynamics import RigidBody, motion_directions, motor_motion
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.agreement import ExportContent, file_name_suffix
from ssm_planner.formats.csv import read_axes, read_columns, table_text
from ssm_planner.formats.epos4_offsets import Offsets, offset_checks, stream_velocities
from ssm_planner.formats.epos4_setup import (
    INT16_MAX,
    INT32_MAX,
    OPERATION_MODES,
    UNTESTED_ASSUMPTIONS,
    Axis,
    CountsPerTurn,
    check_integer_range,
    drive_axes,
    encoder_notes,
    homing_objects,
    pdo_mapping,
    rounding_bounds,
    setup_objects,
    setup_objects_csv,
    sync_setup,
)
from ssm_planner.formats.points import Points, Reading, interpolate_points
from ssm_planner.formats.spline_points import REST_SPEED, sample_slowed_plan
from ssm_planner.kinematics import Mechanism, task_rates
from ssm_planner.plans import Plan
from ssm_planner.problem import JOINTS, TASK_COORDINATES, Joint, Robot, TaskLimits
from ssm_planner.trajectory import PIECES_PER_BLOCK, blocks
from ssm_planner.typing import Array, Arrays, JsonObject, record
from ssm_planner.units import display_unit, rpm
from ssm_planner.verification import Certificate, end_velocities

LARGEST_PERIOD_MS = 100
"""Largest interpolation period that object 0x60C2 of the drive accepts, ms."""

Stream = Arrays
"""Setpoints of one drive at n instants: integers (n,) by name of the column (`STREAM_COLUMNS`)."""


def export_epos4(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float = 1000.0,
    mode: str = "csp",
    counts_per_turn: CountsPerTurn = None,
) -> JsonObject:
    """Write the setpoints of all driven joints to files, and return entries of the manifest.

    The file of a joint contains one row of setpoints per interpolation period, and objects.csv
    contains settings of all drives. In mode csp, every driven joint also gets a file with the
    columns `time` and `position`, and the setpoints of a verified plan are checked as the drives
    will interpolate them.

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
    rate : float
        Setpoints per second, Hz. The period must be an integer from 1 to 100 ms.
    mode : str
        Quantity of the setpoints: "csp" (cyclic synchronous position), "csv" (velocity) or "cst"
        (torque).
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
        If the mode or the rate is not allowed, an encoder resolution is missing, a number does not
        fit its object, or the setpoints exceed a limit that the plan keeps.
    """
    if mode not in OPERATION_MODES:
        raise ExportError(f"unknown mode {mode!r} (allowed: {', '.join(OPERATION_MODES)})")
    period = period_ms(rate)
    axes = drive_axes(plan.robot, counts_per_turn)
    points, stretch = sample_setpoints(plan, axes, mode, period)
    if mode == "csp" and certificate.passed:
        _check_acceptance(plan, points)
    entries = points.content(suffix).write(folder)
    return {
        **entries,
        "stretch": stretch,
        "not_verified": list(UNTESTED_ASSUMPTIONS),
        "notes": list(_setpoint_notes(plan, axes, points.t, entries["axes"])),
    }


@record
class Setpoints:
    """Setpoints of all joints at n equidistant instants.

    The export builds them from a plan, and the reader from the files of an export. Both derive the
    content of the folder from them (`content`), which makes the comparison of the two possible.
    """

    robot: Robot
    """Robot that performs the motion."""
    axes: Mapping[str, Axis]
    """Drives of the driven joints, by joint."""
    mode: str
    """Mode: "csp", "csv" or "cst" (cyclic synchronous position, velocity or torque)."""
    period: int
    """Interpolation period, that is, the interval between two instants, ms."""
    q: Array
    """Joint positions before rounding to increments (n, 4), rad and m."""
    streams: dict[str, Stream]
    """Streams of the driven joints, by joint."""
    limits: TaskLimits
    """Limits of the task, with the declared rates of the motion at both ends."""

    @property
    def t(self) -> Array:
        """Instants (n,), s."""
        return np.arange(float(len(self.q))) * (self.period / 1000)

    def content(self, suffix: str) -> ExportContent:
        """Return the files of the export folder and the entries of its manifest.

        Parameters
        ----------
        suffix : str
            Text before the extension of all file names: "" for a verified plan, or "_unverified".

        Returns
        -------
        ExportContent
            For each driven joint, a file with its setpoints and, in mode csp, a file with time and
            position. For each other joint, a file with its positions. Also a file with the setup
            objects of all drives, and the entries of the manifest.

        Raises
        ------
        ExportError
            If a number does not fit its object.
        """
        t = self.t
        files: dict[str, Iterable[str]] = {}
        entries: JsonObject = {}
        rows: list[dict[str, str]] = []
        for joint, q in zip(self.robot.joints, self.q.T, strict=True):
            name = f"{joint.name}{suffix}.csv"
            entries[joint.name] = {"file": name}
            axis = self.axes.get(joint.name)
            if axis is None:
                columns = {TIME_COLUMN: t, f"position_{joint.unit}": q}
                files[name] = table_text(columns, ("%.3f", "%.17g"))
                entries[joint.name]["note"] = (
                    "no drive: the file shows the joint's motion for reference and is not a stream"
                )
                continue
            files[name] = table_text({TIME_COLUMN: t, **self.streams[joint.name]})
            if self.mode == "csp":
                columns = {"time": t, "position": self.streams[joint.name][POSITION_COLUMN]}
                files[f"{joint.name}_time_position{suffix}.csv"] = table_text(columns)
            rows += setup_objects(axis, self.mode, self.period)
            entries[joint.name] |= {
                **axis.to_dict(),
                "rounding": rounding_bounds(axis, self.period),
                "homing": homing_objects(axis, axis.increments(q[:1])[0]),
            }
        files[f"objects{suffix}.csv"] = setup_objects_csv(rows)
        limits = self.limits
        if self.mode == "csp":
            q, _, offsets = self.rounded_joint_values()
            limits = replace_end_rates(limits, self.robot, q, stream_velocities(t, q, offsets))
        return ExportContent(
            {
                **limits.declared_rates,
                "mode": self.mode,
                "rate_hz": 1000 / self.period,
                "interpolation_period_ms": self.period,
                "pdo": pdo_mapping(self.mode),
                "sync": sync_setup(self.period),
                "units": {
                    "inc": "increments (quadcounts)",
                    "mrpm": "1e-3 rpm at the motor",
                    "permille": "of rated torque",
                },
                "axes": entries,
            },
            files,
        )

    def to_reading(self, point_name: str) -> Reading:
        """Return the motion that the drives perform: straight lines between the target positions.

        The velocity and torque offsets are compared with the positions. The results become checks
        of the returned motion.

        Parameters
        ----------
        point_name : str
            Template for the name of a setpoint in messages. Its field `{}` is the index of the
            setpoint.

        Returns
        -------
        Reading
            Trajectory of straight lines, and the checks of the offsets (`offset_checks`).
        """
        q, resolution, offsets = self.rounded_joint_values()
        points = Points(self.t, q, resolution=resolution, point_name=point_name.format)
        reading = interpolate_points(points, self.robot)
        checks = offset_checks(self.robot, self.t, q, resolution, offsets)
        return replace(reading, checks=tuple(checks))

    def rounded_joint_values(self) -> tuple[Array, Array, dict[int, Offsets]]:
        """Convert the integers that the drives receive back to quantities of the joints.

        The drives receive positions in encoder increments, and offsets of velocity and torque,
        which they may use as feed-forward. Rounding to integers changes all of them.

        Returns
        -------
        q : (n, 4) array
            Positions of joints 1 to 3 in rad, and of joint 4 in m. Those of joints with a drive are
            rounded to increments.
        resolution : (4,) array
            Largest rounding error of each position, rad (joints 1 to 3) or m (joint 4). It is 0 for
            a joint without a drive.
        offsets : dict of Offsets
            Velocity and torque offsets by index of the joint.
        """
        q = self.q.copy()
        resolution = np.zeros(4)
        offsets = {}
        for name, axis in self.axes.items():
            i = JOINTS.index(name)
            counts, speed, torque = self.streams[name].values()
            q[:, i] = counts / axis.increments_per_unit
            resolution[i] = 0.5 / abs(axis.increments_per_unit)
            offsets[i] = _joint_offsets(axis, speed, torque)
        return q, resolution, offsets


def setpoint_times(plan: Plan, period: int) -> tuple[Array, float]:
    """Return the instants of the setpoints, and the factor by which the motion is slowed down.

    The last setpoint is the target. A motion that does not end at rest must end exactly at a
    setpoint. Therefore, it is slowed down, which adds less than one period to its duration.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    period : int
        Interval between setpoints, ms.

    Returns
    -------
    t : (n,)
        Instants since the start, s.
    stretch : float
        New duration divided by the planned duration.
    """
    # Without the tolerance of 1e-9 periods, floating-point errors could add a setpoint.
    count = int(np.ceil(plan.motion.duration * 1000 / period - 1e-9)) + 1
    t = np.arange(count, dtype=float) * (period / 1000)
    _, end_velocity = end_velocities(plan.motion)
    if np.abs(end_velocity).max() <= REST_SPEED:
        return t, 1.0
    return t, float(t[-1]) / plan.motion.duration


def _check_acceptance(plan: Plan, points: Setpoints) -> None:
    """Raise ExportError if the command `check` would reject the setpoints of a plan.

    Rounding to increments, or straight lines between distant setpoints, can exceed a limit that the
    plan itself keeps.

    Parameters
    ----------
    plan : Plan
        Plan that is exported. Its path is part of the message.
    points : Setpoints
        Setpoints of the plan in the mode csp.

    Raises
    ------
    ExportError
        If the setpoints exceed a limit.
    """
    certificate = points.to_reading("setpoint {}").check(plan.robot, points.limits)
    if certificate.violations:
        raise ExportError(
            f"{plan.path}: `check` would reject the setpoints, which exceed "
            f"{certificate.worst.excess}: choose another rate, or an encoder with more counts per "
            "turn"
        )


def sample_setpoints(
    plan: Plan, axes: Mapping[str, Axis], mode: str, period: int
) -> tuple[Setpoints, float]:
    """Return the setpoints of a plan, and the factor by which the motion is slowed down.

    The simulation of a motor controller sends these setpoints to its model of the drives.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    axes : mapping of str to Axis
        Axes of the driven joints.
    mode : str
        Mode: "csp", "csv" or "cst".
    period : int
        Interval between setpoints, ms.

    Returns
    -------
    points : Setpoints
        Setpoints of all joints.
    stretch : float
        Factor on the duration of the plan (`setpoint_times`).

    Raises
    ------
    ExportError
        If a number does not fit its object.
    """
    t, stretch = setpoint_times(plan, period)
    motion = _sample_motors(plan, t, stretch)
    points = Setpoints(
        plan.robot,
        axes,
        mode,
        period,
        motion["q"],
        streams=_integer_streams(axes, motion, mode),
        limits=plan.limits.slower(stretch),
    )
    return points, stretch


def period_ms(rate: float) -> int:
    """Convert the rate of the setpoints to their interpolation period.

    Parameters
    ----------
    rate : float
        Setpoints per second, Hz.

    Returns
    -------
    int
        Interpolation period, ms.

    Raises
    ------
    ExportError
        If the period is not an integer from 1 to `LARGEST_PERIOD_MS`.
    """
    period = 1000 / rate if rate > 0 else 0.0
    is_integer = np.isfinite(period) and abs(period - np.rint(period)) < 1e-9
    if not is_integer or not 1 <= np.rint(period) <= LARGEST_PERIOD_MS:
        raise ExportError(
            f"the rate {rate:g} Hz has a period of {period:.6g} ms, but object 0x60C2 needs whole "
            f"ms from 1 to {LARGEST_PERIOD_MS} (allowed: 1000, 500, 250, 200, 125, 100 Hz and so "
            "on)"
        )
    return round(period)


def _sample_motors(plan: Plan, t: Array, stretch: float) -> Arrays:
    """Sample a plan at the instants of the setpoints, at the joints and at the motors.

    A joint whose motion ends at rest is held at its last position after the end.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    t : (n,) array
        Instants since the start, s.
    stretch : float
        Factor on the duration of the plan.

    Returns
    -------
    dict of (n, 4) arrays
        Joint positions "q" (rad and m), motor speeds "speed" (rad/s) and motor torques "torque"
        (N·m).
    """
    moving = np.abs(end_velocities(plan.motion)[1]) > REST_SPEED
    body = RigidBody.from_robot(plan.robot)
    motion = {name: np.empty((len(t), 4)) for name in ("q", "speed", "torque")}
    for block in blocks(len(t), PIECES_PER_BLOCK):
        samples = sample_slowed_plan(plan, plan.motion.breaks[0] + t[block], stretch)
        # Times have floating-point errors, so the end is found with a tolerance.
        is_at_end = t[block] >= plan.motion.duration * stretch * (1 - 1e-12)
        ended = is_at_end[:, None] & ~moving
        samples.qd[ended] = 0.0
        samples.qdd[ended] = 0.0
        direction, breakaway = motion_directions(plan.robot, samples, 1)
        direction[ended] = 0.0
        breakaway[ended] = 0.0
        motor = motor_motion(plan.robot, body, samples, direction, breakaway)
        motion["q"][block] = samples.q
        motion["speed"][block] = motor.speed
        motion["torque"][block] = motor.torque
    return motion


def _integer_streams(axes: Mapping[str, Axis], motion: Arrays, mode: str) -> dict[str, Stream]:
    """Convert a motion to the integer setpoints of the drives.

    Positions become increments of the encoder, speeds 1e-3 rpm at the motor, and torques per mille
    of the rated torque. All have the sign of the motor's direction of rotation.

    Parameters
    ----------
    axes : mapping of str to Axis
        Axes of the driven joints.
    motion : dict of (n, 4) arrays
        Joint positions "q" (rad and m), motor speeds "speed" (rad/s) and motor torques "torque"
        (N·m).
    mode : str
        "csp", "csv" or "cst". It determines the columns (`STREAM_COLUMNS`).

    Returns
    -------
    dict of Stream
        Columns of setpoints by joint.

    Raises
    ------
    ExportError
        If a number does not fit its object.
    """
    streams = {}
    for name, axis in axes.items():
        i = JOINTS.index(name)
        position = axis.increments(motion["q"][:, i])
        speed = np.round(axis.direction * motion["speed"][:, i] / rpm * 1000)
        torque = np.round(axis.direction * motion["torque"][:, i] / axis.rated_torque * 1000)
        values = [
            check_integer_range(position, INT32_MAX, name, "target position", "increments"),
            check_integer_range(speed, INT32_MAX, name, "velocity", "mrpm"),
            check_integer_range(
                torque, INT16_MAX, name, "torque", "per mille of rated torque (INT16)"
            ),
        ]
        # The mode csp needs all three columns, csv the last two, and cst only the last one.
        names = STREAM_COLUMNS[mode]
        streams[name] = dict(zip(names, values[-len(names) :], strict=True))
    return streams


def _setpoint_notes(
    plan: Plan, axes: dict[str, Axis], t: Array, entries: JsonObject
) -> Iterator[str]:
    """Yield the notes of the manifest on the setpoints and on each joint.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    axes : dict of Axis
        Axes of the driven joints.
    t : (n,) array
        Instants of the setpoints, s.
    entries : dict
        Entries of the manifest by joint, with the effects of rounding (`rounding_bounds`).

    Yields
    ------
    str
        Number of the setpoints. Then one note per joint: how much rounding changes its motion, or
        that it moves without a drive. Also notes on placeholder values of motors and encoders, and
        on joints that still move at the end.
    """
    yield f"{len(t)} setpoints; the last is the target, reached by {t[-1]:.3f} s"
    travel = np.ptp(plan.motion.sample(plan.motion.breaks).q, axis=0)
    for joint, distance in zip(plan.robot.joints, travel.tolist(), strict=True):
        unit, scale = display_unit(joint.unit)
        if joint.name not in axes:
            if distance > 0:
                length = format_number(scale * distance, 4)
                yield (
                    f"joint {joint.name} has no drive and no stream, but the plan moves "
                    f"it by {length} {unit}"
                )
            continue
        if joint.motor is not None and "nominal_torque" in joint.motor.placeholders:
            yield (
                f"joint {joint.name}: its torque offsets use a placeholder value of the rated "
                "torque"
            )
        effects = entries[joint.name]["rounding"]
        texts = {name: format_number(scale * effect, 2) for name, effect in effects.items()}
        yield (
            f"joint {joint.name}: rounding to increments moves setpoints by up to "
            f"{texts['position']} {unit}, the speed between setpoints by {texts['speed']} {unit}/s "
            f"({100 * effects['speed'] / joint.velocity:.2g} % of its limit), and the acceleration "
            f"by {texts['acceleration']} {unit}/s²; the errors do not accumulate"
        )
    yield from encoder_notes(axes)
    speeds = [
        f"{joint.name} at {velocity:.4g} {joint.unit}/s"
        for joint, velocity in zip(plan.robot.joints, end_velocities(plan.motion)[1], strict=True)
        if abs(velocity) > REST_SPEED
    ]
    if speeds:
        yield (
            f"the motion ends moving ({', '.join(speeds)}): the controller must continue the "
            "motion after the last setpoint, because no drive can stop at once"
        )


TIME_COLUMN = "time_s"
POSITION_COLUMN = "target_position_inc"
VELOCITY_COLUMN = "velocity_offset_mrpm"
TORQUE_COLUMN = "torque_offset_permille"
STREAM_COLUMNS = {
    "csp": (POSITION_COLUMN, VELOCITY_COLUMN, TORQUE_COLUMN),
    "csv": ("target_velocity_mrpm", TORQUE_COLUMN),
    "cst": ("target_torque_permille",),
}
"""Columns of a stream after the time, by mode."""


def read_epos4(folder: Path, manifest: JsonObject, names: Collection[str], robot: Robot) -> Reading:
    """Read the target positions of an export as a trajectory of straight lines.

    The offsets of velocity and torque, which a drive may use as feed-forward, are compared with the
    positions. Positions of joints without a drive come from their reference files in rad or m.

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
        Trajectory, checks of the offsets, and the content that the folder must have.

    Raises
    ------
    TrajectoryError
        If a stream is missing or damaged, or the robot has other drives than the manifest states.
    """
    axes, t, tables = read_joint_tables(folder, manifest, robot, TIME_COLUMN, _column_names)
    period = round(1000 * float(t[1] - t[0]))
    if not 1 <= period <= LARGEST_PERIOD_MS:
        raise TrajectoryError(
            f"{folder}: a period of {period} ms is out of range (allowed: 1 to {LARGEST_PERIOD_MS})"
        )
    points = Setpoints(
        robot=robot,
        axes=axes,
        mode="csp",
        period=period,
        q=np.stack(
            [columns[0] / increments_per_unit(axes, name) for name, columns in tables.items()],
            axis=1,
        ),
        streams={
            name: dict(zip(STREAM_COLUMNS["csp"], tables[name], strict=True)) for name in axes
        },
        limits=TaskLimits(start_rate=manifest.get("start_rate"), end_rate=manifest.get("end_rate")),
    )
    reading = points.to_reading(f"{folder}: setpoint {{}}")
    return replace(reading, content=points.content(file_name_suffix(manifest)))


def replace_end_rates(limits: TaskLimits, robot: Robot, q: Array, qd: Array) -> TaskLimits:
    """Replace the declared rates in limits by the rates of the rounded motion at both ends.

    Rates are the velocities of the task coordinates roll, tilt, spin and depth. The rows of an
    export are rounded, so their first and last velocities differ slightly from those that the
    problem declares. An end without a declared rate remains unchanged.

    Parameters
    ----------
    limits : TaskLimits
        Limits with the declared rates.
    robot : Robot
        Robot that performs the motion.
    q, qd : (n, 4) arrays
        Rounded positions and velocities: rad and rad/s for joints 1 to 3, m and m/s for joint 4.

    Returns
    -------
    TaskLimits
        The limits with the rates of the rounded motion.
    """
    rates = task_rates(Mechanism.from_robot(robot), q[[0, -1]], qd[[0, -1]]).tolist()
    if limits.start_rate:
        limits = replace(limits, start_rate=dict(zip(TASK_COORDINATES, rates[0], strict=True)))
    if limits.end_rate:
        limits = replace(limits, end_rate=dict(zip(TASK_COORDINATES, rates[1], strict=True)))
    return limits


def increments_per_unit(axes: Mapping[str, Axis], name: str) -> float:
    """Return the increments per rad or m of a joint, or 1 for a joint without a drive."""
    return axes[name].increments_per_unit if name in axes else 1.0


def _column_names(joint: Joint, driven: bool) -> tuple[str, ...]:
    """Return the names of the columns of a joint's file, without the column of the time.

    The file of a joint with a drive contains the setpoints of the mode "cyclic synchronous
    position" (csp): position, velocity offset and torque offset. The file of a joint without a
    drive contains only its position.

    Parameters
    ----------
    joint : Joint
        Joint of the file.
    driven : bool
        True if the joint has a drive.

    Returns
    -------
    tuple of str
        Three names for a joint with a drive. Otherwise "position_rad" or "position_m".
    """
    return STREAM_COLUMNS["csp"] if driven else (f"position_{joint.unit}",)


def read_joint_tables(
    folder: Path,
    manifest: JsonObject,
    robot: Robot,
    time: str,
    columns: Callable[[Joint, bool], Sequence[str]],
) -> tuple[dict[str, Axis], Array, dict[str, list[Array]]]:
    """Read the table of each joint in an export folder.

    Parameters
    ----------
    folder : Path
        Export folder.
    manifest : dict
        Content of the manifest.json of the folder.
    robot : Robot
        Robot that performs the motion.
    time : str
        Name of the column with the time.
    columns : Callable
        Function that returns the names of the other columns of a table. Its arguments are the
        joint, and whether the joint has a drive.

    Returns
    -------
    axes : dict[str, Axis]
        Axes of the driven joints with the encoders that the manifest states.
    t : (n,) array
        Times of the rows, s. They are the same in all tables.
    tables : dict[str, list of (n,) arrays]
        Columns by joint.

    Raises
    ------
    TrajectoryError
        If the manifest does not state the encoder of a joint, or if a table is damaged.
    """
    axes = read_axes(folder, manifest, robot)
    times = []
    tables = {}
    for joint in robot.joints:
        path = folder / f"{joint.name}{file_name_suffix(manifest)}.csv"
        names = [time] + list(columns(joint, joint.name in axes))
        rows = read_columns(path, names)
        if len(rows) < 2 or not np.isfinite(rows).all():
            raise TrajectoryError(
                f"{path}: the file has fewer than two rows or contains numbers that are not finite"
            )
        times.append(rows[:, 0])
        tables[joint.name] = list(rows[:, 1:].T)
        if not np.array_equal(times[-1], times[0]):
            raise TrajectoryError(f"{folder}: the tables of the axes have different times")
    return axes, times[0], tables


def _joint_offsets(axis: Axis, speed: Array, torque: Array) -> Offsets:
    """Convert the velocity and torque offsets of a drive's setpoints to quantities of the joint.

    Parameters
    ----------
    axis : Axis
        Axis of the joint.
    speed : (n,) array
        Velocity offsets, 1e-3 rpm at the motor.
    torque : (n,) array
        Torque offsets, per mille of the rated torque.

    Returns
    -------
    Offsets
        Offsets in SI units with their rounding errors, which are half a unit of the integers.
    """
    assert axis.joint.drive is not None
    to_speed = axis.direction * rpm / (1000 * axis.joint.drive.ratio)
    to_torque = axis.direction * axis.rated_torque / 1000
    return Offsets(speed * to_speed, torque * to_torque, 0.5 * abs(to_speed), 0.5 * abs(to_torque))
