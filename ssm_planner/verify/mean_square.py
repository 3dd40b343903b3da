"""Root mean square of the motor torques over a motion, from the instants that the scan looks at anyway.

What a motor may give for all time is a limit of its heat, which goes with the square of the torque. A start from rest
is an instant without duration: static friction there counts as a peak, not as heat.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ssm_planner.model.trajectory import Trajectory
from ssm_planner.problem.values import Array, Robot
from ssm_planner.verify.certificate import LimitCheck
from ssm_planner.verify.pieces import Flags
from ssm_planner.verify.quantities import Quantity

CONTINUOUS = "continuous torque"
"""Name of the limit."""
FOUR_EIGHTHS = np.array([1.0, 3.0, 3.0, 1.0])[:, None] / 8
"""Weights of four instants at equal distances: exact for cubics (Simpson's 3/8 rule)."""
WITHOUT_FIRST = np.array([0.0, 3.0, 0.0, 1.0])[:, None] / 4
"""The same without the first instant: exact for parabolas (Radau's rule of two points)."""


class MeanSquares:
    """∫ τ² dt of every motor torque among the quantities of a scan, stretch after stretch."""

    def __init__(self, quantities: Sequence[Quantity]) -> None:
        self.rows = [k for k, quantity in enumerate(quantities) if quantity.name == "motor torque"]
        self.joints = [quantities[k].index for k in self.rows]
        self.integrals = np.zeros(len(self.rows))

    def add_intervals(self, values: Array, starting: Flags, duration: Array) -> None:
        """Intervals (n,) with values (k, 4, n) of the quantities at four instants; starting (4, n): the first is static."""
        weights = np.where(starting[self.joints][:, None], WITHOUT_FIRST, FOUR_EIGHTHS)
        self.integrals += np.sum(np.sum(weights * values[self.rows] ** 2, axis=1) * duration, axis=1)

    def add_middles(self, values: Array, duration: Array) -> None:
        """Short pieces (n,) with values (k, n) of the quantities at their middle."""
        self.integrals += values[self.rows] ** 2 @ duration

    def checks(self, robot: Robot, trajectory: Trajectory) -> list[LimitCheck]:
        """RMS torque against what the motor may give for all time, motor by motor; of the whole motion, so at its end."""
        checks = []
        for i, integral in zip(self.joints, self.integrals, strict=True):
            joint = robot.joints[i]
            assert joint.motor is not None
            rms, limit = float(np.sqrt(integral / trajectory.duration)), joint.motor.nominal_torque
            end = float(trajectory.breaks[-1])
            checks.append(LimitCheck(CONTINUOUS, joint.name, rms, limit, 1 - rms / limit, end, "N·m"))
        return checks
