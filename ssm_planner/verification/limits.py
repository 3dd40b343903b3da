"""Quantities that a check evaluates, and the worst value of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ssm_planner.problem import (
    TASK,
    ContinuousTorque,
    Drive,
    JointAcceleration,
    JointJerk,
    Limit,
    MotorSpeed,
    MotorTorque,
    NutContact,
    RetinaClearance,
    Robot,
    SelfLocking,
    TaskLimits,
    TaskRange,
    TaskRate,
)
from ssm_planner.typing import Array, frozen
from ssm_planner.verification.certificate import LimitCheck

JUMP = 1e-6
"""Largest jump of the position at a break, rad or m.

Jumps of velocity and acceleration are relative to their limits.
"""
DYNAMIC = tuple(
    str(kind.name)
    for kind in (JointAcceleration, JointJerk, MotorTorque, ContinuousTorque, NutContact)
)
"""Names of the limits that straight pieces leave undefined."""
JUMP_RATE = 1e-3
"""Share of a limit by which jumps of the quantity below it may add up.

Positions may jump by this share of the velocity limit per second, for example.
"""


@frozen
class Case:
    """A drive and a mass at the tip (kg) within the range that a motion must be valid for."""

    drive: Drive
    payload: float
    words: str


@frozen
class Quantity:
    """A limited quantity and how it follows from the joint motion."""

    limit: Limit
    index: int = -1
    """Index of the joint or of the task coordinate."""
    order: int | None = None
    """The quantity is `scale` times this derivative of q[index].

    It is None if the quantity is no polynomial in time.
    """
    scale: float = 1.0
    case: Case | None = None
    """Friction and payload of a motor torque if they differ from the robot's."""

    @property
    def kinked(self) -> bool:
        """True if the quantity may have a kink between two instants, which no cubic predicts."""
        return isinstance(self.limit, (MotorTorque, RetinaClearance))

    def excess(self, lowest: Array, highest: Array) -> Array:
        """Return the negative margin of values between `lowest` and `highest`.

        It is the excess over the nearer bound divided by the half width.
        """
        limit = self.limit
        return np.maximum(highest - limit.high, limit.low - lowest) / limit.half_width


@dataclass
class Worst:
    """The worst value of one quantity."""

    quantity: Quantity
    excess: float = -np.inf
    value: float = field(default=np.nan)
    time: float = 0.0

    def offer(self, excess: float, value: float, time: float) -> None:
        """Store a value if it is worse than the stored one."""
        if excess > self.excess:
            self.excess = excess
            self.value = value
            self.time = time

    def as_check(self) -> LimitCheck:
        limit, value = self.quantity.limit, self.value + 0.0  # not −0
        bound = limit.high if limit.high - value <= value - limit.low else limit.low
        if limit.low == -limit.high:
            value = abs(value)
            bound = limit.high
        return LimitCheck(
            limit.name,
            limit.joint,
            worst=value,
            limit=bound,
            margin=-self.excess,
            time=self.time,
            unit=limit.unit,
            case=None if self.quantity.case is None else self.quantity.case.words,
        )


def quantities(robot: Robot, limits: TaskLimits) -> Iterator[Quantity]:
    """Return every quantity that is limited at each instant: by joints, motors, task and eye."""
    for i, joint in enumerate(robot.joints):
        for limit in joint.limits:
            if isinstance(limit, (MotorTorque, NutContact)):
                yield Quantity(limit, i)
            elif isinstance(limit, MotorSpeed):
                yield Quantity(limit, i, 1, 1.0 if joint.drive is None else joint.drive.ratio)
            elif not isinstance(limit, (ContinuousTorque, SelfLocking)):
                yield Quantity(limit, i, limit.order)
    for kind in (TaskRange, TaskRate):
        by_coordinate = {
            limit.coordinate: limit for limit in limits.limits if isinstance(limit, kind)
        }
        for k, name in enumerate(TASK):
            if found := by_coordinate.get(name):
                polynomial = found.order, float(robot.geometry.insertion_sign)
                yield Quantity(found, k, *polynomial if name == "depth" else ())
    yield from map(Quantity, limits.speeds)
    yield from map(Quantity, () if limits.eye is None else limits.eye.limits)
