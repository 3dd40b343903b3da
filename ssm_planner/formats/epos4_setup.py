"""What turns a joint's motion into the numbers of its drive: encoder increments, direction, rated torque.

Objects to set in an EPOS4 before it follows a stream, each with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.typing import Array

INT16, UINT16, INT32, UINT32 = 2**15 - 1, 2**16 - 1, 2**31 - 1, 2**32 - 1
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
            joint.name,
            joint,
            direction=joint.motor_direction,
            counts_per_turn=counts,
            increments_per_unit=float(per_unit),
            rated_torque=float(motor.nominal_torque),
        )
    if not axes:
        raise ExportError(f"{robot.file}: no joint of robot {robot.name} has a drive")
    return axes


def fits(values: Array, largest: int, joint: str, what: str, unit: str) -> Array:
    """Whole numbers (n,) that a drive's object holds. Raises ExportError naming joint, value and what is allowed."""
    k = int(np.argmax(np.abs(values)))
    if not np.isfinite(values).all() or abs(values[k]) > largest:
        raise ExportError(
            f"joint {joint}: {what} of {values[k]:.6g} {unit} does not fit (allowed: −{largest} to {largest})"
        )
    return values + 0.0


def following_error_window(axis: Axis, period: int) -> int:
    """Object 0x6065, increments: LAG_PERIODS periods (ms) at the joint's largest speed."""
    return max(math.ceil(axis.joint.velocity * LAG_PERIODS * period / 1000 * abs(axis.increments_per_unit)), 2)


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


MODES = {"csp": 8, "csv": 9, "cst": 10}
"""Mode of operation (0x6060)."""
VELOCITY_UNIT = 0xFDB44700
"""0x60A9: velocities in 1e-3 rpm."""
LAG_PERIODS = 10
SYNC = 0x80
"""COB-ID of the SYNC message."""
CURRENT_POSITION = 37
"""Homing method (0x6098): the present position becomes the home position."""
STREAMED = {
    "csp": (("0x607A:00", 32), ("0x60B1:00", 32), ("0x60B2:00", 16)),
    "csv": (("0x60FF:00", 32), ("0x60B2:00", 16)),
    "cst": (("0x6071:00", 16),),
}
"""Objects of the stream by mode, with their bits."""
COMMANDED = (("0x6040:00", 16), ("0x6060:00", 8))
RETURNED = ((("0x6041:00", 16), ("0x6064:00", 32)), (("0x606C:00", 32), ("0x6077:00", 16)))
LARGEST_PDO = 64
"""Bits."""


def pdo_mapping(mode: str) -> dict[str, list[dict[str, Any]]]:
    """PDOs of the stream, as few as hold it: for each its objects, and those to write to map them (0x1600 and so on)."""
    packed: list[list[tuple[str, int]]] = [[]]
    for entry in (*COMMANDED, *STREAMED[mode]):
        if sum(bits for _, bits in packed[-1]) + entry[1] > LARGEST_PDO:
            packed.append([])
        packed[-1].append(entry)
    return {
        "receive": [_pdo(0x1600 + k, 0x1400 + k, entries) for k, entries in enumerate(packed)],
        "transmit": [_pdo(0x1A00 + k, 0x1800 + k, list(entries)) for k, entries in enumerate(RETURNED)],
    }


def _pdo(mapping: int, communication: int, entries: list[tuple[str, int]]) -> dict[str, Any]:
    values = [int(key[2:6], 16) << 16 | int(key[7:], 16) << 8 | bits for key, bits in entries]
    return {
        "mapping": f"0x{mapping:04X}",
        "communication": f"0x{communication:04X}",
        "transmission_type": 1,
        "objects": [
            {"object": key, "bits": bits, "value": f"0x{value:08X}"}
            for (key, bits), value in zip(entries, values, strict=True)
        ],
    }


def sync_setup(period: int) -> dict[str, Any]:
    """The SYNC message that the controller sends once in each interpolation period, ms."""
    return {
        "cob_id": SYNC,
        "period_ms": period,
        "note": "one setpoint for each SYNC; its period must equal 0x60C2:01; transmission type 1: taken over with each SYNC",
    }


def homing(axis: Axis, start: float) -> dict[str, Any]:
    """How the drive's zero comes to be the joint's: start: increments of the first setpoint."""
    return {
        "convention": "0 increments are 0 rad or m of the joint",
        "home_position": {"object": "0x30B0:00", "value": int(start), "unit": "inc"},
        "home_offset": {"object": "0x30B1:00", "value": 0, "unit": "inc"},
        "method": {"object": "0x6098:00", "value": CURRENT_POSITION},
        "note": f"for joint {axis.name} standing at the start of the plan: its present position becomes the home position; "
        "compare objects and method with the drive's firmware specification",
    }


def setup_objects(axis: Axis, mode: str, period: int, effects: dict[str, float]) -> list[dict[str, str]]:
    """Rows joint, object, name, value, unit, reason for one axis.

    effects: largest effects of rounding on the joint's position, speed, acceleration: limits inside the drive must leave
    room for them. Raises ExportError where a value does not fit its object.
    """
    joint, scale = axis.joint, abs(axis.increments_per_unit)
    motor = joint.motor
    turns = 60 * scale / axis.counts_per_turn  # rpm of the motor per unit/s of the joint
    ends = sorted(axis.increments_per_unit * position for position in joint.position)
    speed = (joint.velocity + effects["speed"]) * turns
    largest = joint.velocity * turns if motor is None else motor.max_speed * 60 / (2 * np.pi)
    nominal = axis.rated_torque
    torque = nominal if motor is None else motor.max_torque
    room = "with room for the rounding of the stream"
    table = [
        ("0x6060:00", "mode of operation", MODES[mode], "", f"cyclic synchronous mode ({mode.upper()})", 127),
        (
            "0x60C2:01",
            "interpolation time period",
            period,
            "ms",
            "must equal the SYNC period; 0 would mean no interpolation and a noisy motion",
            100,
        ),
        ("0x60C2:02", "interpolation time index", -3, "", "the period is in ms (fixed)", 127),
        (
            "0x60A9:00",
            "velocity unit",
            VELOCITY_UNIT,
            "",
            "velocities in 1e-3 rpm: whole rpm would be too coarse",
            UINT32,
        ),
        (
            "0x6076:00",
            "motor rated torque",
            round(nominal * 1e6),
            "µN·m",
            "read only: must read this value, else the torque offsets are scaled wrongly",
            UINT32,
        ),
        (
            "0x6072:00",
            "max torque",
            math.floor(torque / nominal * 1000),
            "per mille",
            "largest usable torque of the motor",
            UINT16,
        ),
        (
            "0x607D:01",
            "software position limit, min",
            math.floor(ends[0] + 1e-6),
            "inc",
            f"range of joint {axis.name}, outwards",
            INT32,
        ),
        (
            "0x607D:02",
            "software position limit, max",
            math.ceil(ends[1] - 1e-6),
            "inc",
            f"range of joint {axis.name}, outwards",
            INT32,
        ),
        (
            "0x6065:00",
            "following error window",
            following_error_window(axis, period),
            "inc",
            f"{LAG_PERIODS} periods at the joint's largest speed: a first value, to be narrowed at the machine",
            UINT32,
        ),
        (
            "0x607F:00",
            "max profile velocity",
            math.ceil(speed * 1000),
            "1e-3 rpm",
            f"speed limit of the joint, {room}",
            UINT32,
        ),
        ("0x6080:00", "max motor speed", math.ceil(largest), "rpm", "largest speed of the motor", UINT32),
        (
            "0x60C5:00",
            "max acceleration",
            math.ceil(joint.acceleration * turns),
            "rpm/s",
            "acceleration limit of the joint; between two setpoints rounding to increments alone may ask for more",
            UINT32,
        ),
    ]
    rows = []
    for key, name, value, unit, reason, limit in table:
        if abs(value) > limit:
            raise ExportError(f"joint {axis.name}: {name} ({key}) = {value} does not fit (allowed: up to {limit})")
        shown = f"0x{value:08X}" if name == "velocity unit" else str(value)
        rows.append({"joint": axis.name, "object": key, "name": name, "value": shown, "unit": unit, "reason": reason})
    return rows
