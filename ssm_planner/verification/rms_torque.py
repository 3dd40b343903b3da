"""Root mean square of the motor torques over a motion, from the instants that the check looks at anyway.

What a motor may give for all time is a limit of its heat, which goes with the square of the torque. A start from rest
is an instant without duration: static friction there counts as a peak, not as heat.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ssm_planner.problem.limits import ContinuousTorque, MotorTorque
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import LimitCheck
from ssm_planner.verification.limits import Quantity
from ssm_planner.verification.pieces import Flags

FOUR_EIGHTHS = np.array([1.0, 3.0, 3.0, 1.0]) / 8
"""Weights of four instants at equal distances: exact for cubics (Simpson's 3/8 rule)."""
WITHOUT_FIRST = np.array([0.0, 3.0, 0.0, 1.0]) / 4
"""The same without the first instant: exact for parabolas (Radau's rule of two points)."""


class RmsTorques:
    """∫ τ² dt of every motor torque among k quantities, stretch after stretch."""

    def __init__(self, quantities: Sequence[Quantity]) -> None:
        self.columns = [k for k, quantity in enumerate(quantities) if isinstance(quantity.limit, MotorTorque)]
        self.joints = [quantities[k].index for k in self.columns]
        self.integrals = np.zeros(len(self.columns))

    def add_intervals(self, values: Array, starting: Flags, duration: Array) -> None:
        """n intervals with values (4, n, k) at four instants and durations (n,).

        starting (n, 4): the joint starts there, so that its torque at the first instant is static.
        """
        for i, (column, joint) in enumerate(zip(self.columns, self.joints, strict=True)):
            square = values[:, :, column] ** 2
            mean = np.where(starting[:, joint], WITHOUT_FIRST @ square, FOUR_EIGHTHS @ square)
            self.integrals[i] += mean @ duration

    def add_middles(self, values: Array, duration: Array) -> None:
        """n short pieces with values (n, k) at their middle and durations (n,)."""
        self.integrals += duration @ values[:, self.columns] ** 2

    def checks(self, robot: Robot, trajectory: Trajectory) -> list[LimitCheck]:
        """RMS torque against what the motor may give for all time, motor by motor; of the whole motion, so at its end."""
        checks = []
        for i, integral in zip(self.joints, self.integrals, strict=True):
            limit = robot.joints[i].limit(ContinuousTorque)
            rms, end = float(np.sqrt(integral / trajectory.duration)), float(trajectory.breaks[-1])
            checks.append(LimitCheck.of(limit, rms, end))
        return checks
