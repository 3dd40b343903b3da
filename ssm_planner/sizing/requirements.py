"""What a motion requires of each motor: torque, speed, power and energy, and what the torque is spent on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.joint_load import RATE, JointLoad, joint_loads
from ssm_planner.sizing.torque_breakdown import TorqueBreakdown, torque_split
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
        return self.motor is None or self.motor.placeholder

    def to_dict(self) -> dict[str, Any]:
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


def motor_requirements(trajectory: Trajectory, robot: Robot, rate: float = RATE) -> tuple[MotorRequirement, ...]:
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
