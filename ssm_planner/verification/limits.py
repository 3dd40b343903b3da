"""The quantities that a check evaluates, and the worst value of each.

A `LimitedQuantity` pairs a limit with a rule that computes the limited value from the joint motion.
A `WorstValue` collects the worst value of one quantity while the check goes through the motion.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ssm_planner.problem import (
    TASK_COORDINATES,
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

JUMP_TOLERANCE = 1e-6
"""Largest jump of the position at a break, rad or m.

Jumps of velocity and acceleration are relative to their limits.
"""
ACCELERATION_DEPENDENT_LIMITS = tuple(
    str(limit_type.name)
    for limit_type in (JointAcceleration, JointJerk, MotorTorque, ContinuousTorque, NutContact)
)
"""Names of the limits that depend on the acceleration. Linear pieces leave them undefined."""
JUMP_DRIFT_RATE = 1e-3
"""Share of a limit by which jumps of the quantity below it may add up.

Positions may jump by this share of the velocity limit per second, for example.
"""


@frozen
class WorstCase:
    """A drive and a payload within the range that a motion must be valid for.

    Attributes
    ----------
    drive : Drive
        The drive with the friction parameters of the case.
    payload : float
        Mass at the tip, kg.
    description : str
        Friction and payload as a text for the result.
    """

    drive: Drive
    payload: float
    description: str


@frozen
class LimitedQuantity:
    """A limited quantity and the rule that computes it from the joint motion.

    The value is `scale` · d^order q[index]/dt^order if `order` is given. `sampled_extremes`
    computes all other quantities.
    """

    limit: Limit
    index: int = -1
    """Index of the joint or of the task coordinate."""
    order: int | None = None
    """Derivative of q[index] by time. None if the quantity is not a polynomial in time."""
    scale: float = 1.0
    """Factor on the derivative, such as the gear ratio for a motor speed."""
    case: WorstCase | None = None
    """Friction and payload of a motor torque if they differ from the robot's."""

    @property
    def has_kinks(self) -> bool:
        """True if the quantity may have a kink between two instants, which no cubic predicts."""
        return isinstance(self.limit, (MotorTorque, RetinaClearance))

    def excess(self, lowest: Array, highest: Array) -> Array:
        """Return the excess over the nearer bound, divided by the half width of the limit.

        It is the negative margin of a quantity whose values lie between `lowest` and `highest`.
        Both arrays and the result have the same shape.
        """
        limit = self.limit
        return np.maximum(highest - limit.high, limit.low - lowest) / limit.half_width


@dataclass
class WorstValue:
    """The worst value of one quantity.

    Attributes
    ----------
    quantity : Quantity
        Quantity whose values are compared.
    excess : float
        Relative excess of the value over its bound, which is the negative margin.
    value : float
        The value, in SI units.
    time : float
        Its time, s.
    """

    quantity: LimitedQuantity
    excess: float = -np.inf
    value: float = np.nan
    time: float = 0.0

    def update(self, excess: float, value: float, time: float) -> None:
        """Store a value with its excess and time if it is worse than the stored value."""
        if excess > self.excess:
            self.excess = excess
            self.value = value
            self.time = time

    def to_limit_check(self) -> LimitCheck:
        """Return the result of the limit.

        A limit with symmetric bounds reports the magnitude. Other limits report the value and the
        bound that is nearer to it.
        """
        limit, value = self.quantity.limit, self.value + 0.0  # turns −0 into 0
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
            case=None if self.quantity.case is None else self.quantity.case.description,
        )


def limited_quantities(robot: Robot, limits: TaskLimits) -> Iterator[LimitedQuantity]:
    """Yield every quantity that is limited at each instant.

    The limits come from the joints, the motors, the task and the eye. Continuous torque and
    self-locking are left out, because they do not concern a single instant.

    Parameters
    ----------
    robot : Robot
        The robot with the limits of its joints and motors.
    limits : TaskLimits
        Limits of task coordinates, their rates, the speeds of the tool and the eye.

    Yields
    ------
    Quantity
    """
    for i, joint in enumerate(robot.joints):
        for limit in joint.limits:
            if isinstance(limit, (MotorTorque, NutContact)):
                yield LimitedQuantity(limit, i)
            elif isinstance(limit, MotorSpeed):
                yield LimitedQuantity(
                    limit, i, 1, 1.0 if joint.drive is None else joint.drive.ratio
                )
            elif not isinstance(limit, (ContinuousTorque, SelfLocking)):
                yield LimitedQuantity(limit, i, limit.order)
    for limit_type in (TaskRange, TaskRate):
        by_coordinate = {
            limit.coordinate: limit for limit in limits.limits if isinstance(limit, limit_type)
        }
        for k, name in enumerate(TASK_COORDINATES):
            task_limit = by_coordinate.get(name)
            if task_limit is not None and name == "depth":
                yield LimitedQuantity(
                    task_limit, 3, task_limit.order, float(robot.geometry.insertion_sign)
                )
            elif task_limit is not None:
                yield LimitedQuantity(task_limit, k)
    yield from map(LimitedQuantity, limits.speeds)
    yield from map(LimitedQuantity, () if limits.eye is None else limits.eye.limits)
