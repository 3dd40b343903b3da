"""Robots as frozen values: geometry, bodies, joints. SI floats and radians, arrays read-only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from ssm_planner.problem.drive import Drive
from ssm_planner.problem.limits import (
    ContinuousTorque,
    JointAcceleration,
    JointJerk,
    JointPosition,
    JointVelocity,
    Limit,
    Limited,
    MotorSpeed,
    MotorTorque,
    NutContact,
    SelfLocking,
    task_limits,
)
from ssm_planner.problem.motor import Motor
from ssm_planner.typing import Array, Range

L = TypeVar("L", bound=Limit)

JOINTS = ("roll", "tilt", "spin", "insertion")
"""Names by which limits and results speak of joints 1 to 4."""


def frozen(value: object, shape: tuple[int, ...]) -> Array:
    """A read-only float array of the given shape."""
    array = np.array(value, dtype=float).reshape(shape)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Geometry:
    """Axes of the mechanism in the base frame at q = 0 (paper, eq. 1); unit vectors, shape (3,)."""

    omega1: Array
    omega2: Array
    omega3: Array
    tool_home: Array
    """R_0, (3, 3), base ← tool at q = 0; its z column is omega3."""
    insertion_sign: int = -1
    """depth = insertion_sign · θ4."""


@dataclass(frozen=True, eq=False)
class Body:
    """Inertial data of one moving body, in its own frame at the RCM."""

    name: str
    mass: float
    com: Array
    """Centre of mass in the body frame, m, (3,)."""
    inertia: Array
    """Inertia tensor about the body frame's origin, kg·m², (3, 3), products with the tensor's sign (−∫xy dm)."""
    frame: Array
    """Rotation base ← body at q = 0, (3, 3)."""


@dataclass(frozen=True)
class Joint:
    """Limits and actuation of one joint; rad or m and their time derivatives."""

    name: str
    kind: Literal["revolute", "prismatic"]
    position: Range
    velocity: float
    acceleration: float
    jerk: float | None = None
    drive: Drive | None = None
    motor: Motor | None = None
    motor_direction: Literal[-1, 1] = 1
    """Sense in which the motor's controller counts when the joint moves forward."""

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Everything that limits this joint, its motor and its drive."""
        name, drive, motor, slides = self.name, self.drive, self.motor, self.kind == "prismatic"
        found: list[Limit] = [
            JointPosition(name, *self.position, slides),
            JointVelocity(name, self.velocity, slides),
            JointAcceleration(name, self.acceleration, slides),
        ]
        if self.jerk is not None:
            found.append(JointJerk(name, self.jerk, slides))
        if drive is not None and motor is not None:
            found += [MotorSpeed(name, motor.max_speed), MotorTorque(name, motor.max_torque)]
            found.append(ContinuousTorque(name, motor.nominal_torque))
        if drive is not None and drive.kind == "antibacklash_screw":
            found.append(NutContact(name))
        if drive is not None and drive.self_locking and drive.friction is not None:
            friction = drive.friction
            found.append(SelfLocking(name, friction.mu if friction.mu_lowest is None else friction.mu_lowest))
        return tuple(found)

    def limit(self, kind: type[L]) -> L:
        """The limit of one kind. Raises KeyError where there is none."""
        for limit in self.limits:
            if isinstance(limit, kind):
                return limit
        raise KeyError(kind.__name__)


@dataclass(frozen=True, eq=False)
class Robot(Limited):
    name: str
    geometry: Geometry
    bodies: tuple[Body, Body, Body, Body]
    joints: tuple[Joint, Joint, Joint, Joint]
    gravity: Array
    """Acceleration of gravity in the base frame, m/s², (3,)."""
    limits: tuple[Limit, ...] = ()
    """Ranges of task coordinates that the robot itself declares."""
    file: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", task_limits(self.limits))
