"""What turns a joint's motion into the numbers of its drive: encoder increments, direction, rated torque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.problem.values import Array, Joint, Robot

INT16, INT32 = 2**15 - 1, 2**31 - 1
QUADRATURE = 4
"""Increments (quadcounts) per encoder count."""


@dataclass(frozen=True)
class Axis:
    """One driven joint as its drive sees it."""

    name: str
    joint: Joint
    direction: int
    counts_per_turn: int
    """Increments per motor turn."""
    increments_per_unit: float
    """Increments per rad or m of the joint, signed by the direction."""
    rated_torque: float
    """Object 0x6076, N·m."""

    def increments(self, q: Array) -> Array:
        """Target positions, whole numbers, of joint positions."""
        return np.round(q * self.increments_per_unit) + 0.0

    def to_dict(self) -> dict[str, Any]:
        return {
            "increments_per_unit": self.increments_per_unit,
            "increments_per_motor_turn": self.counts_per_turn,
            "direction": self.direction,
            "rated_torque_Nm": self.rated_torque,
        }


def axes_of(robot: Robot, counts_per_turn: int | Mapping[str, int] | None) -> dict[str, Axis]:
    """Axes by joint for every joint with a drive. Raises ExportError naming the figure that is missing and its file."""
    axes = {}
    for joint in robot.joints:
        drive, motor = joint.drive, joint.motor
        if drive is None:
            continue
        if motor is None:
            raise ExportError(
                f"{robot.file}: joints.{joint.name}.motor is missing: torque offsets are per mille of its rated torque"
            )
        counts = _counts(joint, counts_per_turn)
        per_unit = joint.motor_direction * drive.ratio * counts / (2 * np.pi)
        axes[joint.name] = Axis(
            joint.name, joint, joint.motor_direction, counts, float(per_unit), float(motor.nominal_torque)
        )
    if not axes:
        raise ExportError(f"{robot.file}: no joint of robot {robot.name} has a drive")
    return axes


def fits(values: Array, largest: int, joint: str, what: str, unit: str) -> Array:
    """Whole numbers that a drive's object holds. Raises ExportError naming joint, value and what is allowed."""
    k = int(np.argmax(np.abs(values)))
    if not np.isfinite(values).all() or abs(values[k]) > largest:
        raise ExportError(
            f"joint {joint}: {what} of {values[k]:.6g} {unit} does not fit (allowed: −{largest} to {largest})"
        )
    return values + 0.0


def _counts(joint: Joint, given: int | Mapping[str, int] | None) -> int:
    counts = given.get(joint.name) if isinstance(given, Mapping) else given
    if counts is None and joint.motor is not None and joint.motor.encoder_counts is not None:
        return QUADRATURE * joint.motor.encoder_counts
    if counts is None:
        file = "the motor's file" if joint.motor is None else joint.motor.file
        raise ExportError(
            f"{file}: encoder_counts is missing for the motor of joint {joint.name}: give it there, or the increments per "
            "motor turn (4 × encoder counts) by --counts-per-turn"
        )
    if counts < 1:
        raise ExportError(f"--counts-per-turn {counts}: not a number of increments (allowed: 1 and more)")
    return int(counts)
