"""Convert the motion of a joint to the units of its drive, and list the setup objects of an EPOS4.

The units depend on the encoder, the direction and the rated torque of the motor. Every setup object
is listed with a reason.
"""

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.problem import JOINTS, Joint, Robot, check_mapping
from ssm_planner.typing import Array, JsonObject, frozen
from ssm_planner.units import rpm

INT16_MAX = 2**15 - 1
INT32_MAX = 2**31 - 1
PLACEHOLDER_PREFIX = "PLACEHOLDER: "


@frozen
class Axis:
    """A driven joint and the units of its drive.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> from ssm_planner.formats.epos4_setup import drive_axes
    >>> drive_axes(ssm.load_robot("vitreoretinal"), 4096)["roll"].counts_per_turn
    4096
    """

    name: str
    joint: Joint
    direction: int
    counts_per_turn: int
    """Increments per motor turn."""
    increments_per_unit: float
    """Increments per rad or m of the joint. The sign is that of the direction."""
    rated_torque: float
    """Rated torque, N·m (object 0x6076)."""
    encoder: str
    """Source of the encoder resolution."""

    def increments(self, q: Array) -> Array:
        """Convert joint positions q (n,) to target positions (n,), rounded to whole increments."""
        return np.round(q * self.increments_per_unit) + 0.0

    def to_dict(self) -> JsonObject:
        """Return the entries of the manifest."""
        return {
            "increments_per_unit": self.increments_per_unit,
            "increments_per_motor_turn": self.counts_per_turn,
            "direction": self.direction,
            "rated_torque_Nm": self.rated_torque,
            "encoder": self.encoder,
        }


CountsPerTurn = int | Mapping[str, int] | None
"""Increments per motor turn, for all joints or by joint. None means those of the motor files."""


def drive_axes(robot: Robot, counts_per_turn: CountsPerTurn) -> dict[str, Axis]:
    """Return the axes of all joints with a drive, by name of the joint.

    Parameters
    ----------
    robot : Robot
        Robot that performs the motion.
    counts_per_turn : int or mapping from joint to int, optional
        Increments per motor turn (4 × encoder counts), for all joints or by joint. The default
        comes from the motor files.

    Raises
    ------
    ExportError
        If no joint has a drive, or a drive lacks a motor or an encoder resolution.
    """
    if isinstance(counts_per_turn, Mapping):
        check_mapping(counts_per_turn, JOINTS, "counts_per_turn")
    axes = {}
    for joint in robot.joints:
        drive = joint.drive
        motor = joint.motor
        if drive is None:
            continue
        if motor is None:
            raise ExportError(
                f"{robot.file}: joints.{joint.name}.motor is missing: setpoints depend on the "
                "motor's encoder and rated torque"
            )
        counts, encoder = _encoder_counts(joint, counts_per_turn)
        per_unit = joint.motor_direction * drive.ratio * counts / (2 * np.pi)
        axes[joint.name] = Axis(
            joint.name,
            joint,
            direction=joint.motor_direction,
            counts_per_turn=counts,
            increments_per_unit=per_unit,
            rated_torque=motor.nominal_torque,
            encoder=encoder,
        )
    if not axes:
        raise ExportError(
            f"{robot.file}: no joint of robot {robot.name} has a drive: name one in "
            "joints.NAME.drive, and its motor in joints.NAME.motor"
        )
    return axes


def encoder_notes(axes: Mapping[str, Axis]) -> list[str]:
    """Return notes on placeholder values of the encoders."""
    return [
        f"joint {name}: its increments use a placeholder value of the encoder resolution"
        for name, axis in axes.items()
        if axis.encoder.startswith(PLACEHOLDER_PREFIX)
    ]


def check_integer_range(
    values: Array, bound: int, joint: str, quantity_name: str, unit: str
) -> Array:
    """Check that an object of the drive can represent integers, and return them.

    Parameters
    ----------
    values : (n,)
        Integers.
    bound : int
        Largest absolute value of the object.
    joint, quantity_name, unit : str
        Joint, quantity and unit. The error message contains them.

    Raises
    ------
    ExportError
        If a value is too large or not finite.
    """
    k = int(np.argmax(np.abs(values)))
    if not np.isfinite(values).all() or abs(values[k]) > bound:
        raise ExportError(
            f"joint {joint}: {quantity_name} of {values[k]:.6g} {unit} does not fit (allowed: "
            f"−{bound} to {bound})"
        )
    return values + 0.0


def following_error_window(axis: Axis, period: int) -> int:
    """Return the following error that trips the drive (object 0x6065), increments.

    It is the travel of the joint in `FOLLOWING_ERROR_PERIODS` periods at its largest speed.
    `period` is in ms.
    """
    travel = axis.joint.velocity * FOLLOWING_ERROR_PERIODS * period / 1000
    return max(math.ceil(travel * abs(axis.increments_per_unit)), 2)


def _encoder_counts(joint: Joint, counts_per_turn: CountsPerTurn) -> tuple[int, str]:
    """Return the increments per motor turn of a joint, and the source of this number.

    Raises ExportError if neither the caller nor the motor file gives it.
    """
    if isinstance(counts_per_turn, Mapping):
        counts_per_turn = counts_per_turn.get(joint.name)
    counts = counts_per_turn
    motor = joint.motor
    if counts is None and motor is not None and motor.increments is not None:
        mark = PLACEHOLDER_PREFIX if "encoder_counts" in motor.placeholders else ""
        return motor.increments, mark + motor.sources.get("encoder_counts", "the motor's file")
    if counts is None:
        file = "the motor's file" if motor is None else motor.file
        raise ExportError(
            f"{file}: encoder_counts is missing for the motor of joint {joint.name}: add it to the "
            "file, or pass the increments per motor turn (4 × encoder counts) with "
            "--counts-per-turn"
        )
    if counts < 1:
        raise ExportError(f"--counts-per-turn {counts} is out of range (allowed: 1 or more)")
    return int(counts), "given with the export"


OPERATION_MODES = {"csp": 8, "csv": 9, "cst": 10}
"""Mode of operation (object 0x6060)."""
VELOCITY_UNIT_MRPM = 0xFDB44700
"""Value of object 0x60A9 for velocities in 1e-3 rpm."""
FOLLOWING_ERROR_PERIODS = 10
"""Number of periods of travel that determine the window of the following error."""
SYNC_COB_ID = 0x80
"""COB-ID of the SYNC message."""
HOMING_AT_CURRENT_POSITION = 37
"""Homing method (object 0x6098) that defines the present position as the home position."""
OBJECT_BITS = {
    **dict.fromkeys(("0x6060:00", "0x6061:00"), 8),
    **dict.fromkeys(("0x607A:00", "0x60FF:00", "0x60B1:00"), 32),
}
OBJECT_BITS |= dict.fromkeys(("0x6064:00", "0x606C:00"), 32)
"""Number of bits of each mapped object. Other objects have 16 bits."""
COMMAND_OBJECTS = ("0x6040:00", "0x6060:00")
STREAM_OBJECTS = {
    "csp": (("0x607A:00", "0x60B1:00"), ("0x60B2:00",)),
    "csv": (("0x60FF:00", "0x60B2:00"),),
    "cst": (("0x6071:00",),),
}
"""Objects of the stream, by mode and PDO. A PDO has at most 64 bits."""
FEEDBACK_OBJECTS = (("0x6041:00", "0x6061:00"), ("0x6064:00", "0x606C:00"), ("0x6077:00",))
TRANSMIT_ON_CHANGE = 255
"""Transmission type of commands and status: on every change."""
TRANSMIT_AT_SYNC = 1
"""Transmission type of all other objects: at each SYNC."""
STATUS_QUOTED = "quoted"
STATUS_NOT_VERIFIED = "not verified"
UNCONFIRMED_OBJECTS = {"0x60B1:00", "0x6080:00"}
"""Objects whose meaning is known only from CiA 402.

Public code of other authors states number, meaning and unit of all other objects.
"""
UNTESTED_ASSUMPTIONS = (
    "the export was not tested on a drive, and the firmware specification was not available: "
    "objects, units and meanings come from public code of other authors; compare them with the "
    "specification of the drive",
    "0x60B1 in CSP: a velocity offset is CiA 402; no source states if the drive uses it as "
    "feed-forward in this mode",
    "0x60C5 and 0x607F: according to public code they have no effect in cyclic modes; the stream "
    "itself keeps the limits",
    "0x6080: public code uses rpm; no source states if 0x60A9 scales it too",
    "0x30B0: according to public code, homing method 37 assigns this value to the present "
    "position; read 0x6064 afterwards",
)


def pdo_mapping(mode: str) -> dict[str, list[JsonObject]]:
    """Return the PDOs of a stream with their objects and transmission types.

    Commands and status have separate PDOs, so that the drive can be switched on before the first
    SYNC.
    """
    receive = [
        _pdo(0x1600 + k, 0x1400 + k, 0x200 + 0x100 * k, objects)
        for k, objects in enumerate((COMMAND_OBJECTS,) + STREAM_OBJECTS[mode])
    ]
    transmit = [
        _pdo(0x1A00 + k, 0x1800 + k, 0x180 + 0x100 * k, objects)
        for k, objects in enumerate(FEEDBACK_OBJECTS)
    ]
    return {"receive": receive, "transmit": transmit}


def _pdo(mapping: int, communication: int, cob_id: int, keys: tuple[str, ...]) -> JsonObject:
    """Describe one PDO (process data object) for the manifest.

    Parameters
    ----------
    mapping, communication : int
        Indices of the objects that configure the content and the transmission of the PDO.
    cob_id : int
        CAN identifier without the node ID.
    keys : tuple of str
        Objects in the PDO, such as "0x607A:00".
    """
    objects = []
    for key in keys:
        bits = OBJECT_BITS.get(key, 16)
        objects.append(
            {
                "object": key,
                "bits": bits,
                "value": f"0x{key[2:6]}{key[7:]}{bits:02X}",
                "known": STATUS_NOT_VERIFIED if key in UNCONFIRMED_OBJECTS else STATUS_QUOTED,
            }
        )
    return {
        "mapping": f"0x{mapping:04X}",
        "communication": f"0x{communication:04X}",
        "cob_id": f"0x{cob_id:03X} + node ID",
        "transmission_type": TRANSMIT_ON_CHANGE
        if keys in (COMMAND_OBJECTS, FEEDBACK_OBJECTS[0])
        else TRANSMIT_AT_SYNC,
        "objects": objects,
    }


def sync_setup(period: int) -> JsonObject:
    """Describe the SYNC message that the controller sends once per interpolation period (ms)."""
    return {
        "cob_id": SYNC_COB_ID,
        "period_ms": period,
        "note": "send one setpoint before each SYNC; the SYNC period must equal 0x60C2:01; with "
        "transmission type 1 the drive applies it at the SYNC",
    }


def homing_objects(axis: Axis, start: float) -> JsonObject:
    """Return the objects with which position 0 of the drive corresponds to position 0 of the joint.

    `start` is the first setpoint, in increments.
    """
    return {
        "convention": "0 increments are 0 rad or m of the joint",
        "home_position": {
            "object": "0x30B0:00",
            "value": int(start),
            "unit": "inc",
            "known": STATUS_QUOTED,
        },
        "home_offset": {"object": "0x30B1:00", "value": 0, "unit": "inc", "known": STATUS_QUOTED},
        "method": {
            "object": "0x6098:00",
            "value": HOMING_AT_CURRENT_POSITION,
            "known": STATUS_QUOTED,
        },
        "note": f"home joint {axis.name} at the start of the plan: its present position becomes "
        "the home position; the offset is 0, so homing does not move the joint",
    }


with Path(__file__).with_name("epos4_objects.csv").open(encoding="utf-8") as _table:
    SETUP_OBJECTS = tuple(csv.reader(_table))[1:]
"""Object, name, unit, largest value and reason of each setup object."""


def rounding_bounds(axis: Axis, period: int) -> dict[str, float]:
    """Return bounds of the errors that result from rounding positions to increments.

    Every position is wrong by at most half an increment, so a difference of two positions is wrong
    by one increment, and a second difference by two.

    Parameters
    ----------
    axis : Axis
        Settings of one axis.
    period : int
        Interval between the positions, ms.

    Returns
    -------
    dict[str, float]
        Bounds for the joint's position, speed and acceleration, rad or m and s.
    """
    increment = 1 / abs(axis.increments_per_unit)
    h = period / 1000
    return {"position": increment / 2, "speed": increment / h, "acceleration": 2 * increment / h**2}


def setup_objects(axis: Axis, mode: str, period: int) -> list[dict[str, str]]:
    """Return the table of the setup objects for one axis.

    Each row has the columns joint, object, name, value, unit, reason and known.

    Parameters
    ----------
    axis : Axis
        Settings of one axis.
    mode : str
        Mode of operation of the controller.
    period : int
        Interpolation period, ms. The limits in the drive allow for `rounding_bounds`.

    Raises
    ------
    ExportError
        If a value does not fit its object.
    """
    joint = axis.joint
    motor = axis.joint.motor
    assert motor is not None
    # Motor speed in rpm at a joint speed of 1 rad/s or 1 m/s.
    rpm_per_unit = 60 * abs(axis.increments_per_unit) / axis.counts_per_turn
    max_speed = joint.velocity + rounding_bounds(axis, period)["speed"]
    low, high = sorted(axis.increments_per_unit * position for position in joint.position)
    values = {
        "0x6060:00": OPERATION_MODES[mode],
        "0x60C2:01": period,
        "0x60C2:02": -3,
        "0x60A9:00": VELOCITY_UNIT_MRPM,
        "0x6076:00": round(axis.rated_torque * 1e6),
        "0x607D:01": math.floor(low + 1e-6),
        "0x607D:02": math.ceil(high - 1e-6),
        "0x6065:00": following_error_window(axis, period),
        "0x607F:00": math.ceil(max_speed * rpm_per_unit * 1000),
        "0x6080:00": math.ceil(motor.max_speed / rpm),
        "0x60C5:00": math.ceil(joint.acceleration * rpm_per_unit),
    }
    if motor.torque_constant is not None:
        values["0x3001:02"] = math.floor(motor.max_torque / motor.torque_constant * 1000)
    rows = []
    for key, name, unit, maximum, reason in SETUP_OBJECTS:
        value = values.get(key)
        if value is None:
            continue
        if abs(value) > int(maximum):
            raise ExportError(
                f"joint {axis.name}: {name} ({key}) = {value} does not fit (allowed: up to "
                f"{maximum})"
            )
        text = f"0x{value:08X}" if name == "velocity unit" else str(value)
        rows.append(
            {
                "joint": axis.name,
                "object": key,
                "name": name,
                "value": text,
                "unit": unit,
                "reason": reason,
                "known": STATUS_NOT_VERIFIED if key in UNCONFIRMED_OBJECTS else STATUS_QUOTED,
            }
        )
    return rows


def setup_objects_csv(rows: list[dict[str, str]]) -> str:
    """Return the rows of `setup_objects` as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
