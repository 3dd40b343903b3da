"""What a motion requires of each motor: torque, speed, power and energy, and what the torque is spent on.

Without friction the torque law of dynamics/transmission.py is linear in load and acceleration, so it divides into parts;
friction is the rest: tau = tau_lossless(inertia) + tau_lossless(load) + bearings + (mesh with friction − mesh without).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.value import unchecked
from ssm_planner.sizing.joint_load import RATE, JointLoad, joint_loads
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array


@dataclass(frozen=True, eq=False)
class MotorRequirement:
    """Required motor-side figures of one driven joint over one motion; t, speed, acceleration, torque (n,), SI."""

    joint: str
    motor: Motor | None
    peak_torque: float
    rms_torque: float
    mean_torque: float
    peak_speed: float
    peak_acceleration: float
    t: Array
    speed: Array
    torque: Array
    acceleration: Array
    peak_power: float
    """Largest mechanical power out of the motor, W."""
    mean_power: float
    """Mean mechanical power, W; what the load gives back counts as negative."""
    energy: float
    """Mechanical energy out of the motor, J; nothing that the load gives back is used."""
    returned_energy: float
    """Mechanical energy that the load puts into the motor, J, ≥ 0."""
    joule_power: float | None
    """Mean heat in the winding at 25 °C, W; None where the motor file lacks torque constant or resistance."""
    joule_energy: float | None
    """J."""
    split: TorqueBreakdown

    @property
    def placeholder(self) -> bool:
        """No motor is given, or its figures stand in for unknown ones."""
        return self.motor is None or self.motor.placeholder

    def to_dict(self) -> dict[str, Any]:
        """An entry of `motors` in what `plan --json` prints; SI."""
        return {
            "joint": self.joint,
            "motor": None if self.motor is None else self.motor.name,
            "peak_torque": self.peak_torque,
            "rms_torque": self.rms_torque,
            "mean_torque": self.mean_torque,
            "peak_speed": self.peak_speed,
            "peak_acceleration": self.peak_acceleration,
            "peak_power": self.peak_power,
            "mean_power": self.mean_power,
            "energy": self.energy,
            "returned_energy": self.returned_energy,
            "joule_power": self.joule_power,
            "joule_energy": self.joule_energy,
            "split": self.split.to_dict(),
            "placeholder": self.placeholder,
        }


def motor_requirements(
    trajectory: Trajectory, robot: Robot, rate: float = RATE
) -> tuple[MotorRequirement, ...]:
    """Requirements of every driven joint, by the exact friction law, static friction at starts included.

    Sampled at `rate` (Hz) and at both sides of every break and turn, so that jumps of torque count where they are.
    """
    return tuple(motor_requirement(load) for load in joint_loads(trajectory, robot, rate))


def motor_requirement(load: JointLoad) -> MotorRequirement:
    """Requirement of one driven joint with the drive and motor of the robot."""
    torque, speed, acceleration = load.torque(), load.speed(), load.acceleration()
    power = torque * speed
    rms = float(load.rms(torque))
    joule = joule_power(load.motor, rms)
    return MotorRequirement(
        joint=load.joint,
        motor=load.motor,
        peak_torque=float(np.abs(torque).max()),
        rms_torque=rms,
        mean_torque=float(load.weight @ torque),
        peak_speed=float(np.abs(speed).max()),
        peak_acceleration=float(np.abs(acceleration).max()),
        t=load.t,
        speed=speed,
        torque=torque,
        acceleration=acceleration,
        peak_power=float(max(power.max(), 0.0)),
        mean_power=float(load.weight @ power),
        energy=float(load.weight @ np.maximum(power, 0.0)) * load.duration,
        returned_energy=float(load.weight @ np.maximum(-power, 0.0)) * load.duration,
        joule_power=joule,
        joule_energy=None if joule is None else joule * load.duration,
        split=torque_split(load),
    )


def joule_power(motor: Motor | None, rms_torque: float) -> float | None:
    """Mean heat R·(tau_rms/k)² in the winding at 25 °C, W; None where the motor lacks k or R."""
    if motor is None or motor.torque_constant is None or motor.terminal_resistance is None:
        return None
    return motor.terminal_resistance * (rms_torque / motor.torque_constant) ** 2


@dataclass(frozen=True, eq=False)
class TorqueBreakdown:
    """Parts of the motor torque (n,), N·m; their sum is the torque."""

    input_inertia: Array
    """Accelerating the motor shaft with all that turns on it."""
    output_inertia: Array
    """Accelerating the bodies and the output side of the drive."""
    load: Array
    """Gravity, Coriolis and centrifugal effort."""
    mesh_friction: Array
    """Sliding in the mesh: what the mesh takes beyond a mesh without friction. At rest it holds the load."""
    bearing_friction: Array
    """Bearings of the input side, and those of the output side carried through a mesh without friction."""
    at_peak: dict[str, float]
    """The parts at the instant of the largest torque, N·m."""
    rms: dict[str, float]
    """RMS of each part over the motion, N·m."""

    def parts(self) -> Iterator[tuple[str, Array]]:
        """Name and part (n,), N·m."""
        for name in PARTS:
            yield name, getattr(self, name)

    def to_dict(self) -> dict[str, dict[str, float]]:
        """By part: its value at the largest torque and its RMS, N·m."""
        return {name: {"at_peak": self.at_peak[name], "rms": self.rms[name]} for name in PARTS}


PARTS = ("input_inertia", "output_inertia", "load", "mesh_friction", "bearing_friction")


def torque_split(load: JointLoad, drive: Drive | None = None) -> TorqueBreakdown:
    """The parts of the motor torque of a joint, with its own drive or another one."""
    drive = drive or load.drive
    moving, zero = load.direction != 0, np.zeros_like(load.t)
    lossless, rough = _without_friction(drive), _with_bearings_only(drive)
    w, wd, way = load.speed(drive), load.acceleration(drive), np.where(moving, load.direction, 1.0)
    carried = output_effort(lossless, load.inertia, zero, load.qdd, way)
    rubbing = output_effort(drive, zero, load.qd, zero, load.direction)
    # an antibacklash nut accelerates with wd, so its lossless preload (which cancels) and inertia come with the input
    input_inertia = motor_torque(lossless, zero, zero, wd, direction=way)
    output_inertia = _mesh(lossless, carried, way)
    held = _mesh(lossless, load.velocity + load.gravity, way)
    bearing = np.where(moving, motor_torque(rough, rubbing, w, zero, direction=way), 0.0)
    total = load.torque(drive)
    effort = load.effort(drive)
    without = np.where(
        moving, motor_torque(rough, effort, w, wd, direction=way), _mesh(lossless, effort, way)
    )
    parts = {
        "input_inertia": input_inertia,
        "output_inertia": output_inertia,
        "load": held,
        "mesh_friction": total - without,
        "bearing_friction": bearing,
    }
    peak = int(np.argmax(np.abs(total)))
    return TorqueBreakdown(
        **parts,
        at_peak={name: float(part[peak]) for name, part in parts.items()},
        rms={name: float(load.rms(part)) for name, part in parts.items()},
    )


def _mesh(lossless: Drive, effort: Array, direction: Array) -> Array:
    zero = np.zeros_like(effort)
    return motor_torque(lossless, effort, zero, zero, direction=direction)


def _without_friction(drive: Drive) -> Drive:
    return _with_bearings_only(drive, b_c=0.0, b_v=0.0, b_oc=0.0, b_ov=0.0)


def _with_bearings_only(drive: Drive, **bearings: float) -> Drive:
    """Without losses in the mesh; of a drive with efficiencies γ is 1/ratio then."""
    friction = unchecked(friction_of(drive), mu=0.0, mu_static=0.0, mu_stribeck=0.0, **bearings)
    return unchecked(
        drive, friction=friction, gamma=drive.gamma if drive.threaded else 1.0 / drive.ratio
    )
