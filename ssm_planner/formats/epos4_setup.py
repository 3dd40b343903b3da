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
from ssm_planner.units import rpm

INT16, INT32, UINT32 = 2**15 - 1, 2**31 - 1, 2**32 - 1
PLACEHOLDER = "PLACEHOLDER: "
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
    encoder: str
    """Where the counts come from."""

    def increments(self, q: Array) -> Array:
        """Target positions (n,), whole numbers, of joint positions (n,)."""
        return np.round(q * self.increments_per_unit) + 0.0

    def to_dict(self) -> dict[str, Any]:
        """What the manifest of an export says of it."""
        return {
            "increments_per_unit": self.increments_per_unit,
            "increments_per_motor_turn": self.counts_per_turn,
            "direction": self.direction,
            "rated_torque_Nm": self.rated_torque,
            "encoder": self.encoder,
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
        counts, encoder = _counts(joint, counts_per_turn)
        per_unit = joint.motor_direction * drive.ratio * counts / (2 * np.pi)
        axes[joint.name] = Axis(
            joint.name,
            joint,
            direction=joint.motor_direction,
            counts_per_turn=counts,
            increments_per_unit=float(per_unit),
            rated_torque=float(motor.nominal_torque),
            encoder=encoder,
        )
    if not axes:
        raise ExportError(f"{robot.file}: no joint of robot {robot.name} has a drive")
    return axes


def encoder_notes(axes: Mapping[str, Axis]) -> list[str]:
    """What is not known of the encoders."""
    return [
        f"joint {name}: the encoder behind its increments is a placeholder figure"
        for name, axis in axes.items()
        if axis.encoder.startswith(PLACEHOLDER)
    ]


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
    return max(
        math.ceil(
            axis.joint.velocity * LAG_PERIODS * period / 1000 * abs(axis.increments_per_unit)
        ),
        2,
    )


def _counts(joint: Joint, given: int | Mapping[str, int] | None) -> tuple[int, str]:
    """Increments per motor turn, and where they come from."""
    counts, motor = given.get(joint.name) if isinstance(given, Mapping) else given, joint.motor
    if counts is None and motor is not None and motor.encoder_counts is not None:
        mark = PLACEHOLDER if "encoder_counts" in motor.placeholders else ""
        return QUADRATURE * motor.encoder_counts, mark + motor.sources.get(
            "encoder_counts", "the motor's file"
        )
    if counts is None:
        file = "the motor's file" if motor is None else motor.file
        raise ExportError(
            f"{file}: encoder_counts is missing for the motor of joint {joint.name}: give it there, or the increments per "
            "motor turn (4 × encoder counts) by --counts-per-turn"
        )
    if counts < 1:
        raise ExportError(
            f"--counts-per-turn {counts}: not a number of increments (allowed: 1 and more)"
        )
    return int(counts), "given with the export"


MODES = {"csp": 8, "csv": 9, "cst": 10}
"""Mode of operation (0x6060)."""
VELOCITY_UNIT = 0xFDB44700
"""0x60A9: velocities in 1e-3 rpm."""
LAG_PERIODS = 10
SYNC = 0x80
"""COB-ID of the SYNC message."""
CURRENT_POSITION = 37
"""Homing method (0x6098): the present position becomes the home position."""
BITS = {
    **dict.fromkeys(("0x6060:00", "0x6061:00"), 8),
    **dict.fromkeys(("0x607A:00", "0x60FF:00", "0x60B1:00"), 32),
}
BITS |= dict.fromkeys(("0x6064:00", "0x606C:00"), 32)
"""Of the objects that are mapped; 16 where not named."""
COMMANDS = ("0x6040:00", "0x6060:00")
STREAMED = {
    "csp": (("0x607A:00", "0x60B1:00"), ("0x60B2:00",)),
    "csv": (("0x60FF:00", "0x60B2:00"),),
    "cst": (("0x6071:00",),),
}
"""Objects of the stream by mode, PDO by PDO of at most 64 bits."""
RETURNED = (("0x6041:00", "0x6061:00"), ("0x6064:00", "0x606C:00"), ("0x6077:00",))
AT_ONCE, AT_SYNC = 255, 1
"""Transmission types: a command or status goes through when it changes, set points and measurements with each SYNC."""
QUOTED, UNVERIFIED = "quoted", "not verified"
DOUBTFUL = {"0x60B1:00", "0x6080:00"}
"""How sure an object is: number, meaning and unit as others' public code quotes them, or in part from CiA 402 alone."""
NOT_VERIFIED = (
    "nothing was tried on a drive, and the maker's firmware specification was not at hand: objects, units and meanings are "
    "those that other people's public code quotes; compare them with the specification of the drive",
    "0x60B1 in CSP: a velocity offset is CiA 402; whether the drive takes it for feed-forward in this mode was not found",
    "0x60C5 and 0x607F: in cyclic modes they are quoted as without effect; the stream itself keeps the limits",
    "0x6080: quoted in rpm; whether 0x60A9 scales it too was not found",
    "0x30B0: quoted as the position that homing method 37 gives to the present one; read 0x6064 afterwards",
)


def pdo_mapping(mode: str) -> dict[str, list[dict[str, Any]]]:
    """PDOs of the stream: for each the objects to write to map it, and when it goes through.

    Commands and status in PDOs of their own, so that the drive can be switched on before the first SYNC.
    """
    return {
        "receive": [
            _pdo(0x1600 + k, 0x1400 + k, 0x200 + 0x100 * k, objects)
            for k, objects in enumerate((COMMANDS, *STREAMED[mode]))
        ],
        "transmit": [
            _pdo(0x1A00 + k, 0x1800 + k, 0x180 + 0x100 * k, objects)
            for k, objects in enumerate(RETURNED)
        ],
    }


def _pdo(mapping: int, communication: int, cob_id: int, objects: tuple[str, ...]) -> dict[str, Any]:
    sizes = [BITS.get(key, 16) for key in objects]
    return {
        "mapping": f"0x{mapping:04X}",
        "communication": f"0x{communication:04X}",
        "cob_id": f"0x{cob_id:03X} + node ID",
        "transmission_type": AT_ONCE if objects in (COMMANDS, RETURNED[0]) else AT_SYNC,
        "objects": [
            {
                "object": key,
                "bits": bits,
                "value": f"0x{key[2:6]}{key[7:]}{bits:02X}",
                "known": UNVERIFIED if key in DOUBTFUL else QUOTED,
            }
            for key, bits in zip(objects, sizes, strict=True)
        ],
    }


def sync_setup(period: int) -> dict[str, Any]:
    """The SYNC message that the controller sends once in each interpolation period, ms."""
    return {
        "cob_id": SYNC,
        "period_ms": period,
        "note": "one setpoint for each SYNC, sent before it; its period must equal 0x60C2:01; transmission type 1: taken "
        "over with each SYNC",
    }


def homing(axis: Axis, start: float) -> dict[str, Any]:
    """How the drive's zero comes to be the joint's: start: increments of the first setpoint."""
    return {
        "convention": "0 increments are 0 rad or m of the joint",
        "home_position": {
            "object": "0x30B0:00",
            "value": int(start),
            "unit": "inc",
            "known": QUOTED,
        },
        "home_offset": {"object": "0x30B1:00", "value": 0, "unit": "inc", "known": QUOTED},
        "method": {"object": "0x6098:00", "value": CURRENT_POSITION, "known": QUOTED},
        "note": f"for joint {axis.name} standing at the start of the plan: its present position becomes the home position; "
        "the offset is a distance that homing moves by: none",
    }


OBJECTS = (
    ("0x6060:00", "mode of operation", "", 127, "cyclic synchronous mode of the stream"),
    (
        "0x60C2:01",
        "interpolation time period",
        "ms",
        100,
        "must equal the SYNC period; 0: none, a noisy motion",
    ),
    ("0x60C2:02", "interpolation time index", "", 127, "the period is in ms (fixed)"),
    (
        "0x60A9:00",
        "velocity unit",
        "",
        UINT32,
        "velocities in 1e-3 rpm: whole rpm would be too coarse",
    ),
    (
        "0x6076:00",
        "motor rated torque",
        "µN·m",
        UINT32,
        "read only: must read this value, or torque offsets are wrong",
    ),
    (
        "0x3001:02",
        "output current limit",
        "mA",
        UINT32,
        "current at the largest usable torque of the motor",
    ),
    ("0x607D:01", "software position limit, min", "inc", INT32, "range of the joint, outwards"),
    ("0x607D:02", "software position limit, max", "inc", INT32, "range of the joint, outwards"),
    (
        "0x6065:00",
        "following error window",
        "inc",
        UINT32,
        "10 periods at full speed: to be narrowed at the machine",
    ),
    (
        "0x607F:00",
        "max profile velocity",
        "1e-3 rpm",
        UINT32,
        "the joint's limit, with room for the stream's rounding",
    ),
    ("0x6080:00", "max motor speed", "rpm", UINT32, "largest speed of the motor"),
    (
        "0x60C5:00",
        "max acceleration",
        "rpm/s",
        UINT32,
        "the joint's limit; rounding to increments may ask for more",
    ),
)
"""Object, name, unit, largest value, reason."""


def setup_objects(
    axis: Axis, mode: str, period: int, effects: dict[str, float]
) -> list[dict[str, str]]:
    """Rows joint, object, name, value, unit, reason, known for one axis.

    effects: largest effects of rounding on the joint's position, speed, acceleration: limits inside the drive must leave
    room for them. Raises ExportError where a value does not fit its object.
    """
    joint, motor = axis.joint, axis.joint.motor
    assert motor is not None
    turns = (
        60 * abs(axis.increments_per_unit) / axis.counts_per_turn
    )  # rpm of the motor per unit/s of the joint
    low, high = sorted(axis.increments_per_unit * position for position in joint.position)
    values = {
        "0x6060:00": MODES[mode],
        "0x60C2:01": period,
        "0x60C2:02": -3,
        "0x60A9:00": VELOCITY_UNIT,
        "0x6076:00": round(axis.rated_torque * 1e6),
        "0x607D:01": math.floor(low + 1e-6),
        "0x607D:02": math.ceil(high - 1e-6),
        "0x6065:00": following_error_window(axis, period),
        "0x607F:00": math.ceil((joint.velocity + effects["speed"]) * turns * 1000),
        "0x6080:00": math.ceil(motor.max_speed / rpm),
        "0x60C5:00": math.ceil(joint.acceleration * turns),
    }
    if motor.torque_constant is not None:
        values["0x3001:02"] = math.floor(motor.max_torque / motor.torque_constant * 1000)
    rows = []
    for key, name, unit, largest, reason in OBJECTS:
        value = values.get(key)
        if value is None:
            continue
        if abs(value) > largest:
            raise ExportError(
                f"joint {axis.name}: {name} ({key}) = {value} does not fit (allowed: up to {largest})"
            )
        shown = f"0x{value:08X}" if name == "velocity unit" else str(value)
        row = {"object": key, "name": name, "value": shown, "unit": unit, "reason": reason}
        rows.append({"joint": axis.name, **row, "known": UNVERIFIED if key in DOUBTFUL else QUOTED})
    return rows
