"""What a motion requires of each motor: torque and speed over time, their peaks, and the RMS torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.model.actuation import directions, motor_motion
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.trajectory import Trajectory
from ssm_planner.problem.values import Array, Motor, Robot

RATE = 2000.0


@dataclass(frozen=True, eq=False)
class MotorRequirement:
    """Required motor-side figures of one driven joint; t, speed, torque (n,) are the envelope over the motion."""

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
            "placeholder": self.placeholder,
        }


def motor_requirements(trajectory: Trajectory, robot: Robot, rate: float = RATE) -> tuple[MotorRequirement, ...]:
    """Requirements of every driven joint, by the exact friction law, static friction at starts included.

    Sampled at `rate` and at both sides of every break, so that jumps of torque are integrated exactly where they are.
    """
    lengths = np.diff(trajectory.breaks)
    counts = np.maximum(np.ceil(lengths * rate).astype(int), 2) + 1
    piece = np.repeat(np.arange(len(lengths)), counts)
    local = np.concatenate([np.linspace(0.0, length, count) for length, count in zip(lengths, counts, strict=True)])
    samples = trajectory.sample_pieces(piece, local)
    body = RigidBody.from_robot(robot)
    after, before = (motor_motion(robot, body, samples, *directions(robot, samples, side)) for side in (1, -1))
    starts = local == 0.0
    torque = np.where(starts[:, None], after.torque, before.torque)
    result = []
    for i, joint in enumerate(robot.joints):
        if joint.drive is None:
            continue
        tau, t = torque[:, i], samples.t
        result.append(
            MotorRequirement(
                joint.name,
                joint.motor,
                float(np.abs(tau).max()),
                float(np.sqrt(np.trapezoid(tau**2, t) / trajectory.duration)),
                float(np.trapezoid(tau, t) / trajectory.duration),
                float(np.abs(after.speed[:, i]).max()),
                float(np.abs(after.acceleration[:, i]).max()),
                t,
                after.speed[:, i],
                tau,
            )
        )
    return tuple(result)
