"""The quantities that a check evaluates, and the worst value of each.

A `LimitedQuantity` contains a limit and the rule that computes the limited value from the joint
motion. A `WorstValue` stores the worst value of one quantity while the check goes through the
motion piece by piece.
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
"""Largest permitted jump at a break between two polynomial pieces.

For the position, it is a jump in rad or m. For velocity and acceleration, it is a multiple of the
limit of the joint.
"""
ACCELERATION_DEPENDENT_LIMITS = tuple(
    str(limit_type.name)
    for limit_type in (JointAcceleration, JointJerk, MotorTorque, ContinuousTorque, NutContact)
)
"""Names of the limits on quantities that depend on the acceleration.

A motion with linear pieces does not define these quantities.
"""
JUMP_DRIFT_RATE = 1e-3
"""Largest rate at which jumps may add up, as a share of the limit of the next derivative.

For example, all jumps of the position within one second may add up to this share of the velocity
limit times one second, plus the tolerance of a single jump.
"""


@frozen
class WorstCase:
    """A combination of friction and payload that the motion must be valid for.

    The module `cases` selects the combinations with the largest motor torques.

    Attributes
    ----------
    drive : Drive
        The drive with the friction parameters of this combination.
    payload : float
        Mass at the tip, kg.
    description : str
        Friction and payload in words, for the certificate.
    """

    drive: Drive
    payload: float
    description: str


@frozen
class LimitedQuantity:
    """A limited quantity and the rule that computes it from the joint motion q(t).

    If `order` is given, the value is `scale` · d^order q[index]/dt^order, which is a polynomial in
    time. All other quantities, such as motor torques, are computed by `sampled_extremes`.
    """

    limit: Limit
    index: int = -1
    """Index of the joint or of the task coordinate. −1 for a limit of the tool."""
    order: int | None = None
    """Derivative of q[index] by time. None if the quantity is not a polynomial in time."""
    scale: float = 1.0
    """Factor on the derivative, such as the gear ratio for a motor speed."""
    case: WorstCase | None = None
    """Friction and payload of a motor torque if they differ from the robot's."""

    @property
    def has_kinks(self) -> bool:
        """True if the slope of the quantity may jump between two sampling instants.

        A cubic through sampled values does not predict such a kink. A motor torque has one where
        the load changes its side, and the clearance from the retina may have one, too.
        """
        return isinstance(self.limit, (MotorTorque, RetinaClearance))

    def excess(self, lowest: Array, highest: Array) -> Array:
        """Return the relative excess of values over the limit, which is the negative margin.

        Parameters
        ----------
        lowest, highest : arrays of the same shape
            Lower and upper bounds of the quantity. Both are the same array for exact values.

        Returns
        -------
        array of the same shape
            Distance beyond the nearer end of the permitted range, divided by half the width of the
            range. It is negative within the range.
        """
        limit = self.limit
        return np.maximum(highest - limit.high, limit.low - lowest) / limit.half_width


@dataclass
class WorstValue:
    """The worst value of one quantity that the check has found so far.

    Attributes
    ----------
    quantity : LimitedQuantity
        Quantity whose values are compared.
    excess : float
        Relative excess of the value over its bound, which is the negative margin.
    value : float
        The worst value, in SI units.
    time : float
        Time of the worst value, s.
    """

    quantity: LimitedQuantity
    excess: float = -np.inf
    value: float = np.nan
    time: float = 0.0

    def update(self, excess: float, value: float, time: float) -> None:
        """Store a value if it is worse than the stored value.

        Parameters
        ----------
        excess : float
            Relative excess of the value over its limit (see `LimitedQuantity.excess`).
        value : float
            The value, in SI units.
        time : float
            Time of the value, s.
        """
        if excess > self.excess:
            self.excess = excess
            self.value = value
            self.time = time

    def to_limit_check(self) -> LimitCheck:
        """Convert the worst value into the result of its limit.

        Returns
        -------
        LimitCheck
            If the permitted range is symmetric about 0, the result contains the magnitude of the
            value and the upper end of the range. Otherwise, it contains the value and the nearer
            end.
        """
        limit = self.quantity.limit
        case = self.quantity.case
        value = self.value + 0.0  # turns −0 into 0
        if limit.low == -limit.high:
            value = abs(value)
        # NaN counts as being near the lower end of a range.
        is_near_high = limit.high - value <= value - limit.low
        bound = limit.high if is_near_high or limit.low == -limit.high else limit.low
        return LimitCheck(
            limit.name,
            limit.joint,
            worst=value,
            limit=bound,
            margin=-self.excess,
            time=self.time,
            unit=limit.unit,
            case=None if case is None else case.description,
        )


def limited_quantities(robot: Robot, limits: TaskLimits) -> Iterator[LimitedQuantity]:
    """Yield every quantity that a limit bounds at each instant of a motion.

    The limits are those of the joints, the motors, the task and the eye. The limits on continuous
    torque and self-locking do not concern single instants, so they are not included.

    Parameters
    ----------
    robot : Robot
        The robot with the limits of its joints and motors.
    limits : TaskLimits
        Limits of task coordinates, their rates, the speeds of the tool and the eye.

    Yields
    ------
    LimitedQuantity
        A limit with the rule that computes the limited value.
    """
    for i, joint in enumerate(robot.joints):
        for limit in joint.limits:
            if isinstance(limit, (MotorTorque, NutContact)):
                yield LimitedQuantity(limit, i)
            elif isinstance(limit, MotorSpeed):
                ratio = 1.0 if joint.drive is None else joint.drive.ratio
                yield LimitedQuantity(limit, i, order=1, scale=ratio)
            elif not isinstance(limit, (ContinuousTorque, SelfLocking)):
                yield LimitedQuantity(limit, i, limit.order)
    for limit_type in (TaskRange, TaskRate):
        by_coordinate = {
            limit.coordinate: limit for limit in limits.limits if isinstance(limit, limit_type)
        }
        for k, name in enumerate(TASK_COORDINATES):
            task_limit = by_coordinate.get(name)
            if task_limit is None:
                continue
            if name == "depth":
                # The depth is the position of joint 4, except for its sign.
                sign = float(robot.geometry.insertion_sign)
                yield LimitedQuantity(task_limit, 3, order=task_limit.order, scale=sign)
            else:
                yield LimitedQuantity(task_limit, k)
    yield from map(LimitedQuantity, limits.speeds)
    if limits.eye is not None:
        yield from map(LimitedQuantity, limits.eye.limits)
