"""Jumps of a trajectory at its breaks.

What a check looks at: every limited quantity with its bounds, and the worst value of each found so far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ssm_planner.kinematics.eye import LENS, RETINA, lens_limit
from ssm_planner.problem.problem import TASK, Eye, TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import LimitCheck

JUMP = 1e-6
"""Largest jump of position (rad, m), or of velocity or acceleration (share of its limit), at a break."""


ORDERS = {"position": 0, "velocity": 1, "acceleration": 2, "jerk": 3}
"""Derivative of the joint coordinate behind the quantities that are polynomials in time."""
RATES = tuple(f"{name} rate" for name in TASK[:3])
INSERTION_SPEED = "insertion speed"
"""Names of the limits on the rates of task coordinates, that of depth last."""


@dataclass(frozen=True)
class Quantity:
    """A value along the motion that must stay in [low, high]."""

    name: str
    joint: str | None
    low: float
    high: float
    unit: str
    index: int
    """Of the joint, or of the task coordinate."""
    order: int | None = None
    """Derivative of q[index] that the quantity is a multiple of; None where it is no polynomial in time."""
    scale: float = 1.0
    size: float = 1.0
    """What margins are relative to where only one end is given."""
    kinked: bool = False
    """It may turn back sharply between two instants, which a cubic does not foresee."""

    @property
    def half_width(self) -> float:
        width = self.high - self.low
        return width / 2 if np.isfinite(width) and width > 0 else self.size

    def excess(self, lowest: Array, highest: Array) -> Array:
        """−margin of values between lowest and highest: what lies beyond the nearer bound, by the half width."""
        return np.maximum(highest - self.high, self.low - lowest) / self.half_width


@dataclass
class Worst:
    """The worst value of one quantity so far."""

    quantity: Quantity
    excess: float = -np.inf
    value: float = field(default=np.nan)
    time: float = 0.0

    def offer(self, excess: float, value: float, time: float) -> None:
        """Take a value if it is worse than the one known."""
        if excess > self.excess:
            self.excess, self.value, self.time = excess, value, time

    def as_check(self) -> LimitCheck:
        quantity, value = self.quantity, self.value + 0.0  # not −0
        high_side = quantity.high - value <= value - quantity.low
        limit = quantity.high if high_side else quantity.low
        if quantity.low == -quantity.high:
            value, limit = abs(value), quantity.high
        return LimitCheck(quantity.name, quantity.joint, value, limit, -self.excess, self.time, quantity.unit)


def quantities(robot: Robot, limits: TaskLimits) -> Iterator[Quantity]:
    """Everything that the robot and the task limit."""
    yield from _of_joints(robot)
    yield from _of_task(robot, limits)
    if limits.eye is not None:
        yield from _of_eye(limits.eye)


def _of_joints(robot: Robot) -> Iterator[Quantity]:
    for i, joint in enumerate(robot.joints):
        unit = "rad" if joint.kind == "revolute" else "m"
        yield Quantity("position", joint.name, *joint.position, unit, i, 0)
        yield _symmetric("velocity", joint.name, joint.velocity, f"{unit}/s", i, 1)
        yield _symmetric("acceleration", joint.name, joint.acceleration, f"{unit}/s²", i, 2)
        if joint.jerk is not None:
            yield _symmetric("jerk", joint.name, joint.jerk, f"{unit}/s³", i, 3)
        drive, motor = joint.drive, joint.motor
        if drive is not None and motor is not None:
            yield _symmetric("motor speed", joint.name, motor.max_speed, "rad/s", i, 1, drive.ratio)
            yield _symmetric("motor torque", joint.name, motor.max_torque, "N·m", i)
        if drive is not None and drive.kind == "antibacklash_screw":
            yield Quantity("nut contact", joint.name, 0.0, np.inf, "N", i)


def _of_task(robot: Robot, limits: TaskLimits) -> Iterator[Quantity]:
    sign = float(robot.geometry.insertion_sign)
    for k, name in enumerate(TASK):
        if name == "depth" and name in limits.ranges:
            yield Quantity("depth range", None, *limits.ranges[name], "m", 3, 0, sign)
        elif name in limits.ranges:
            yield Quantity(f"{name} range", None, *limits.ranges[name], "rad", k)
    for k, name in enumerate(TASK):
        if name == "depth" and name in limits.rates:
            yield _symmetric(INSERTION_SPEED, None, limits.rates[name], "m/s", 3, 1, sign)
        elif name in limits.rates:
            yield _symmetric(RATES[k], None, limits.rates[name], "rad/s", k)
    if limits.tip_speed is not None:
        yield _symmetric("tip speed", None, limits.tip_speed, "m/s", -1)


def _of_eye(eye: Eye) -> Iterator[Quantity]:
    """Margins are relative to the radius that the retina leaves to the tip, and to the lens as enlarged by the shaft."""
    yield Quantity(RETINA, None, eye.clearance, np.inf, "m", -1, size=eye.radius - eye.clearance, kinked=True)
    if eye.lens is not None:
        least = lens_limit(eye)
        yield Quantity(LENS, None, least, np.inf, "", -1, size=least)


def _symmetric(
    name: str, joint: str | None, limit: float, unit: str, index: int, order: int | None = None, scale: float = 1.0
) -> Quantity:
    return Quantity(name, joint, -limit, limit, unit, index, order, scale)
