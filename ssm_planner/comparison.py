"""A plan against recordings of its execution, axis by axis: time alignment, errors, and what became of the margins."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.dynamics.motors import directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import RecordingError
from ssm_planner.formats.epos4_setup import QUADRATURE
from ssm_planner.formats.points import Flags
from ssm_planner.identification.recorder_csv import parse_table
from ssm_planner.identification.recordings import read_recording
from ssm_planner.problem.limits import JointLimit, JointPosition, JointVelocity, MotorSpeed, MotorTorque
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

SAMPLES = 4000
DELAYS = 400
"""Delays tried at each of the zooms."""
FINEST = 1e-5
"""s."""


@dataclass(frozen=True)
class Alignment:
    """delay: time of the recording at which the motion begins, s; correlation of the two speeds there."""

    delay: float
    correlation: float
    reversed_correlation: float
    """The best correlation with the recording's sign reversed."""


def align(planned_time: Array, planned: Array, time: Array, measured: Array) -> Alignment:
    """Alignment of a measured speed with a planned one (from time 0, at rest before and after); arrays of samples."""
    step = max(1, len(time) // SAMPLES)
    t, w = time[::step], measured[::step]
    duration = float(planned_time[-1])
    if not planned.any() or not w.any():
        still = float(not planned.any() and np.abs(measured).max(initial=0.0) == 0.0)
        return Alignment(float(time[0]), still, 0.0)
    best, other = _search(planned_time, planned, t, w, duration), _search(planned_time, planned, t, -w, duration)
    return Alignment(best[0], best[1], other[1])


def _search(planned_time: Array, planned: Array, t: Array, w: Array, duration: float) -> tuple[float, float]:
    """(delay, correlation): zooming grids over the squared difference."""
    low, high = float(t[0]) - duration, float(t[-1])
    # the first grid is finer than the features of the motion
    count = int(np.clip((high - low) / (duration / 100), DELAYS, 20 * DELAYS))
    delay = low
    while high - low > FINEST:
        delays = np.linspace(low, high, count)
        cost = [float(np.sum((w - _at(planned_time, planned, t - each)) ** 2)) for each in delays]
        delay = float(delays[int(np.argmin(cost))])
        around = 2 * (high - low) / (count - 1)
        low, high, count = delay - around, delay + around, 41
    shifted = _at(planned_time, planned, t - delay)
    size = float(np.linalg.norm(shifted) * np.linalg.norm(w))
    return delay, float(shifted @ w) / size if size > 0 else 0.0


def _at(planned_time: Array, planned: Array, t: Array) -> Array:
    return np.interp(t, planned_time, planned, left=0.0, right=0.0)


PLAN_RATE = 2000.0
ALIKE = 0.8
"""Correlation of the speeds below which a recording is not taken for one of this motion."""


@dataclass(frozen=True, eq=False)
class Measured:
    """One motor over time, SI, in the joint's positive direction; arrays (samples,)."""

    joint: str
    name: str
    time: Array
    w: Array
    tau: Array
    q: Array | None = None
    """Joint position, rad or m; None: not recorded."""
    speed_resolution: float = 0.0
    torque_resolution: float = 0.0
    repairs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Difference:
    """Planned minus measured over the samples within the motion; nrmsd = rms / (max − min of the measured)."""

    rms: float
    largest: float
    nrmsd: float | None
    """None where the measured value does not change."""


@dataclass(frozen=True)
class Kept:
    """One limit in reality beside the plan's margin; measured values within their resolution of the limit keep it."""

    name: str
    limit: float
    planned_margin: float | None
    measured: float
    margin: float
    held: bool
    unit: str


@dataclass(frozen=True, eq=False)
class AxisComparison:
    """What one recording says of one axis."""

    joint: str
    recording: str
    alignment: Alignment
    covered: float
    """Share of the motion that the recording holds."""
    differences: dict[str, Difference]
    """By position, speed (motor), torque (motor)."""
    limits: tuple[Kept, ...]
    notes: tuple[str, ...] = field(default_factory=tuple)

    @property
    def held(self) -> bool:
        """Every limit was kept within the resolution of the measurement."""
        return all(limit.held for limit in self.limits)

    def to_dict(self) -> dict[str, Any]:
        """An entry of `axes` in what `compare --json` prints; SI."""
        return {
            "joint": self.joint,
            "recording": self.recording,
            "delay": self.alignment.delay,
            "correlation": self.alignment.correlation,
            "covered": self.covered,
            "nrmsd": {name: each.nrmsd for name, each in self.differences.items()},
            "rms": {name: each.rms for name, each in self.differences.items()},
            "largest": {name: each.largest for name, each in self.differences.items()},
            "limits": [vars(limit) for limit in self.limits],
            "held": self.held,
            "notes": list(self.notes),
        }


def compare(
    trajectory: Trajectory, robot: Robot, certificate: Certificate | None, measured: Measured
) -> AxisComparison:
    """Compare a planned motion with a recording of one of its axes. Raises RecordingError where they do not match."""
    names = [joint.name for joint in robot.joints]
    i = names.index(measured.joint)
    drive = robot.joints[i].drive
    if drive is None:
        raise RecordingError(f"{measured.name}: joint {measured.joint} has no drive in the robot file")
    planned = _planned(trajectory, robot, i)
    alignment = align(planned["time"], planned["speed"], measured.time, measured.w)
    _refuse_other_motion(alignment, measured)
    t = measured.time - alignment.delay
    inside = (t >= 0) & (t <= trajectory.duration)
    covered = float(min(t[-1], trajectory.duration) - max(t[0], 0.0)) / trajectory.duration
    if covered <= 0 or np.count_nonzero(inside) < 3:
        raise RecordingError(f"{measured.name}: holds nothing of the motion")
    t = t[inside]
    q, notes = _position(measured, drive.ratio, t, inside, planned)
    channels = {"position": q[inside], "speed": measured.w[inside], "torque": measured.tau[inside]}
    differences = {
        name: _difference(np.interp(t, planned["time"], planned[name]), values) for name, values in channels.items()
    }
    if covered < 0.99:
        notes.append(f"the recording holds {100 * covered:.0f} % of the motion")
    limits = _limits(robot, i, certificate, measured, q)
    return AxisComparison(
        measured.joint,
        measured.name,
        alignment=alignment,
        covered=covered,
        differences=differences,
        limits=limits,
        notes=(*measured.repairs, *notes),
    )


def _planned(trajectory: Trajectory, robot: Robot, i: int) -> dict[str, Array]:
    """Position, motor speed and motor torque of axis i at PLAN_RATE; time from 0."""
    samples = trajectory.uniform(PLAN_RATE)
    direction, breakaway = directions(robot, samples, 1)
    motor = motor_motion(robot, RigidBody.from_robot(robot), samples, direction, breakaway)
    return {
        "time": samples.t - trajectory.breaks[0],
        "position": samples.q[:, i],
        "speed": motor.speed[:, i],
        "torque": motor.torque[:, i],
    }


def _refuse_other_motion(alignment: Alignment, measured: Measured) -> None:
    if alignment.correlation >= ALIKE:
        return
    hint = "is it another joint's or another motion's?"
    if alignment.reversed_correlation > max(ALIKE, alignment.correlation):
        hint = "reversed it is; motor_direction of the joint in the robot file, or the recording's sign, is wrong"
    raise RecordingError(
        f"{measured.name}: its speed is not the planned one of joint {measured.joint} (correlation "
        f"{alignment.correlation:.2f}, at least {ALIKE:g} needed): {hint}"
    )


def _position(
    measured: Measured, ratio: float, t: Array, inside: Flags, planned: dict[str, Array]
) -> tuple[Array, list[str]]:
    """Measured joint position, or the integral of the measured speed that starts where the plan does."""
    if measured.q is not None:
        return measured.q, []
    step = np.diff(measured.time) * (measured.w[1:] + measured.w[:-1]) / 2
    q = np.concatenate([[0.0], np.cumsum(step)]) / ratio
    first = int(np.argmax(inside))
    q += np.interp(t[0], planned["time"], planned["position"]) - q[first]
    return q, ["no position channel: position is the integral of the measured speed, from the planned start"]


def _difference(planned: Array, measured: Array) -> Difference:
    error = planned - measured
    rms, spread = float(np.sqrt(np.mean(error**2))), float(np.ptp(measured))
    return Difference(rms, float(np.abs(error).max()), rms / spread if spread > 0 else None)


def _limits(robot: Robot, i: int, certificate: Certificate | None, measured: Measured, q: Array) -> tuple[Kept, ...]:
    joint = robot.joints[i]
    stated = {c.name: c.margin for c in certificate.limits if c.joint == joint.name} if certificate is not None else {}
    ratio = joint.drive.ratio if joint.drive is not None else 1.0
    unit = "rad" if joint.kind == "revolute" else "m"
    speed, torque = float(np.abs(measured.w).max()), float(np.abs(measured.tau).max())
    low, high = joint.position
    nearer = float(q.max()) if high - q.max() <= q.min() - low else float(q.min())
    half = (high - low) / 2
    # the integral of a speed drifts: a millionth of the range is not a violation
    rows = [
        (
            JointPosition.name,
            high if nearer == q.max() else low,
            nearer,
            min(high - q.max(), q.min() - low) / half,
            1e-3,
            unit,
        )
    ]
    rows.append(_row(joint.limit(JointVelocity), speed / ratio, measured.speed_resolution / ratio))
    if joint.motor is not None:
        rows.append(_row(joint.limit(MotorSpeed), speed, measured.speed_resolution))
        rows.append(_row(joint.limit(MotorTorque), torque, measured.torque_resolution))
    return tuple(
        Kept(
            name,
            limit,
            planned_margin=stated.get(name),
            measured=worst,
            margin=float(margin),
            held=bool(margin >= -allowance),
            unit=per,
        )
        for name, limit, worst, margin, allowance, per in rows
    )


def _row(limit: JointLimit, worst: float, resolution: float) -> tuple[str, float, float, float, float, str]:
    largest = limit.largest
    return limit.name, largest, worst, 1 - worst / largest, resolution / largest, limit.unit


POSITION = ("position actual value", "position demand value", "position")
INCREMENTS = ("inc", "qc", "counts", "increments", "")
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


def read_measured(path: Path, robot: Robot, joint: str, counts_per_turn: int | None = None) -> Measured:
    """One recording in SI units and the joint's positive direction. Raises RecordingError."""
    axis = next(each for each in robot.joints if each.name == joint)
    if axis.drive is None:
        raise RecordingError(f"{path}: joint {joint} has no drive in the robot file, so nothing is known of its motor")
    nominal = None if axis.motor is None else axis.motor.nominal_torque
    recording = read_recording(path, nominal_torque=nominal, direction=axis.motor_direction)
    steps = np.diff(np.unique(np.round(recording.tau, 12)))
    return Measured(
        joint,
        recording.name,
        time=recording.time,
        w=recording.w,
        tau=recording.tau,
        q=_recorded_position(path, axis, recording.time, counts_per_turn),
        speed_resolution=recording.quantum,
        torque_resolution=float(steps.min()) if len(steps) else 0.0,
        repairs=recording.repairs,
    )


def _recorded_position(path: Path, joint: Joint, time: Array, counts_per_turn: int | None) -> Array | None:
    """Joint position at the recording's times from a channel in increments, if there is one."""
    table = parse_table(path.read_text(encoding="utf-8", errors="replace").lstrip("\ufeff"), path)
    names = [name.strip().lower() for name in table.names]
    column = next((names.index(name) for name in POSITION if name in names), None)
    clock = next((k for k, name in enumerate(names) if name in ("", "time", "t")), 0)
    if column is None or joint.drive is None:
        return None
    if table.units[column].strip().lower() not in INCREMENTS:
        raise RecordingError(f"{path}: position column has unit {table.units[column]!r}; allowed: increments (inc, qc)")
    counts = counts_per_turn
    if counts is None and joint.motor is not None and joint.motor.encoder_counts is not None:
        counts = QUADRATURE * joint.motor.encoder_counts
    if counts is None:
        raise RecordingError(
            f"{path}: its position channel is in increments, and the motor of joint {joint.name} has no encoder_counts: "
            "give --counts-per-turn"
        )
    raw = table.values[:, clock] * TIMES.get(table.units[clock].strip().lower(), 1.0)
    position = table.values[:, column] * joint.motor_direction * 2 * np.pi / counts / joint.drive.ratio
    known = np.isfinite(raw) & np.isfinite(position)
    return np.interp(time, raw[known] - raw[known][0], position[known])


def assign(words: Sequence[str], robot: Robot) -> list[tuple[str, Path]]:
    """(joint, file) of every `JOINT=FILE`, or of files whose names hold a joint's name or its number.

    Raises RecordingError.
    """
    names = [joint.name for joint in robot.joints]
    found: list[tuple[str, Path]] = []
    for word in words:
        joint, given, file = word.partition("=")
        if not given:
            joint, file = _joint_in(Path(word).stem.lower(), names), word
        if joint not in names:
            raise RecordingError(f"{word}: of which joint? write JOINT=FILE with one of {', '.join(names)}")
        if joint in (other for other, _ in found):
            raise RecordingError(f"{word}: a second recording of joint {joint}")
        found.append((joint, Path(file)))
    return found


def _joint_in(stem: str, names: list[str]) -> str:
    chosen = [name for name in names if name in stem]
    numbers = re.findall(r"(?:axis|joint|motor|j)[ _-]?([1-4])(?!\d)", stem)
    chosen += [names[int(number) - 1] for number in numbers]
    return chosen[0] if len(set(chosen)) == 1 else ""
