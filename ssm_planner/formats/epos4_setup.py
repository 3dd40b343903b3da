"""Convert the motion of a joint to the units of its drive, and list the setup objects of an EPOS4.

The units of a drive depend on the encoder, the direction and the rated torque of the motor.
`drive_axes` determines them for each joint. The object dictionary of a drive stores its settings
under indices such as 0x6065. `setup_objects` computes the values that belong to an export, each
with a reason. `pdo_mapping`, `sync_setup` and `homing_objects` describe the communication and the
start of a stream.
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
"""Largest integer of 16 bits with sign."""
INT32_MAX = 2**31 - 1
"""Largest integer of 32 bits with sign."""
PLACEHOLDER_PREFIX = "PLACEHOLDER: "
"""Beginning of the source of an encoder resolution that is only assumed."""


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
    """Name of the joint."""
    joint: Joint
    """The joint with its drive and motor."""
    direction: int
    """Sign of the drive's position relative to the joint, ±1."""
    counts_per_turn: int
    """Increments per motor turn."""
    increments_per_unit: float
    """Increments per rad or m of the joint. The sign is that of the direction."""
    rated_torque: float
    """Rated torque, N·m (object 0x6076)."""
    encoder: str
    """Source of the encoder resolution."""

    def increments(self, q: Array) -> Array:
        """Convert joint positions to target positions of the drive.

        Parameters
        ----------
        q : (n,) array
            Positions of the joint, rad or m.

        Returns
        -------
        (n,) array
            Positions in increments, rounded to whole numbers.
        """
        return np.round(q * self.increments_per_unit) + 0.0  # turns −0.0 into 0.0

    def to_dict(self) -> JsonObject:
        """Return the units of the drive as entries of the manifest."""
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

    Returns
    -------
    dict of Axis
        Units, direction of rotation and rated torque of each drive, by name of its joint.

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
    """Return a note for each axis whose increments depend on an assumed encoder resolution."""
    return [
        f"joint {name}: its increments use a placeholder value of the encoder resolution"
        for name, axis in axes.items()
        if axis.encoder.startswith(PLACEHOLDER_PREFIX)
    ]


def check_integer_range(
    values: Array, bound: int, joint: str, quantity_name: str, unit: str
) -> Array:
    """Check that integers fit an object of the drive, and return them.

    Parameters
    ----------
    values : (n,) array
        Integers as floats.
    bound : int
        Largest absolute value that the object can represent.
    joint : str
        Name of the joint for the error message.
    quantity_name : str
        Name of the quantity for the error message.
    unit : str
        Unit of the values for the error message.

    Returns
    -------
    (n,) array of int32
        The values.

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
    return values.astype(np.int32)


def following_error_window(axis: Axis, period: int) -> int:
    """Return the following error at which the drive stops with a fault (object 0x6065).

    It is the distance that the joint travels in `FOLLOWING_ERROR_PERIODS` interpolation periods at
    its largest velocity.

    Parameters
    ----------
    axis : Axis
        Axis of the joint.
    period : int
        Interpolation period, ms.

    Returns
    -------
    int
        Following error in increments, at least 2.
    """
    travel = axis.joint.velocity * FOLLOWING_ERROR_PERIODS * period / 1000
    return max(math.ceil(travel * abs(axis.increments_per_unit)), 2)


def _encoder_counts(joint: Joint, counts_per_turn: CountsPerTurn) -> tuple[int, str]:
    """Return the increments per motor turn of a joint, and the source of this number.

    A number that the caller gives has priority over the motor file.

    Parameters
    ----------
    joint : Joint
        Joint with a motor.
    counts_per_turn : int or mapping from joint to int, optional
        Number that the caller gives, for all joints or by joint (4 × encoder counts).

    Returns
    -------
    counts : int
        Increments per motor turn.
    source : str
        Source of the number. It begins with `PLACEHOLDER_PREFIX` if the motor file only assumes it.

    Raises
    ------
    ExportError
        If both the caller and the motor file omit the number, or if the caller gives a number below
        1.
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
"""Values of object 0x6060, which selects the mode of operation, by the name of the mode.

The modes are cyclic synchronous position (csp), velocity (csv) and torque (cst).
"""
VELOCITY_UNIT_MRPM = 0xFDB44700
"""Value of object 0x60A9 that selects 1e-3 rpm as the unit of velocities."""
FOLLOWING_ERROR_PERIODS = 10
"""Number of interpolation periods of travel that the window of the following error allows."""
SYNC_COB_ID = 0x80
"""CAN identifier of the SYNC message."""
HOMING_AT_CURRENT_POSITION = 37
"""Homing method (object 0x6098) that defines the present position as the home position."""
OBJECT_BITS = {
    **dict.fromkeys(("0x6060:00", "0x6061:00"), 8),
    **dict.fromkeys(("0x607A:00", "0x60FF:00", "0x60B1:00", "0x6064:00", "0x606C:00"), 32),
}
"""Number of bits of each mapped object. Other objects have 16 bits."""
COMMAND_OBJECTS = ("0x6040:00", "0x6060:00")
"""Objects with the control word and the mode of operation, which the controller sends."""
STREAM_OBJECTS = {
    "csp": (("0x607A:00", "0x60B1:00"), ("0x60B2:00",)),
    "csv": (("0x60FF:00", "0x60B2:00"),),
    "cst": (("0x6071:00",),),
}
"""Objects that receive the setpoints in every period, by mode.

The objects of each inner tuple share one process data object (PDO) of at most 64 bits.
"""
FEEDBACK_OBJECTS = (("0x6041:00", "0x6061:00"), ("0x6064:00", "0x606C:00"), ("0x6077:00",))
"""Objects that the drive sends, by PDO.

The first PDO contains the status word and the mode, the second one position and velocity, and the
third one the torque.
"""
TRANSMIT_ON_CHANGE = 255
"""Transmission type of a PDO that is sent on every change. Commands and status have it."""
TRANSMIT_AT_SYNC = 1
"""Transmission type of a PDO that is sent at each SYNC message. All other PDOs have it."""
STATUS_QUOTED = "quoted"
"""Mark of an object whose number, meaning and unit are stated in public code of other authors."""
STATUS_NOT_VERIFIED = "not verified"
"""Mark of an object in `UNCONFIRMED_OBJECTS`."""
UNCONFIRMED_OBJECTS = {"0x60B1:00", "0x6080:00"}
"""Objects whose meaning only the general standard CiA 402 states, not a source for this drive.

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
"""Statements about the drive that were not tested. The manifest contains them."""


def pdo_mapping(mode: str) -> dict[str, list[JsonObject]]:
    """Return the process data objects (PDOs) that transfer setpoints, commands and feedback.

    A PDO is a CAN message with several objects. Commands and status have separate PDOs, so that the
    drive can be switched on before the first SYNC message.

    Parameters
    ----------
    mode : str
        "csp", "csv" or "cst" (`OPERATION_MODES`).

    Returns
    -------
    dict of lists of dict
        PDOs that the drive receives ("receive") and sends ("transmit"), as entries of the manifest.
    """
    # CANopen (CiA 301) defines the indices and the CAN identifiers of the first PDO of each kind.
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
    """Return the entry of the manifest for one process data object (PDO).

    Parameters
    ----------
    mapping, communication : int
        Indices of the objects that configure the content and the transmission of the PDO.
    cob_id : int
        CAN identifier without the node ID.
    keys : tuple of str
        Objects in the PDO, such as "0x607A:00" (index and subindex).

    Returns
    -------
    dict
        Indices, CAN identifier, transmission type and objects of the PDO.
    """
    objects = []
    for key in keys:
        bits = OBJECT_BITS.get(key, 16)
        objects.append(
            {
                "object": key,
                "bits": bits,
                # Index (4 hexadecimal digits), subindex (2) and number of bits (2) of the object.
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
    """Describe the SYNC message that the controller sends once per interpolation period.

    Parameters
    ----------
    period : int
        Interpolation period, ms.

    Returns
    -------
    dict
        Entries of the manifest: CAN identifier, period and a note for the user.
    """
    return {
        "cob_id": SYNC_COB_ID,
        "period_ms": period,
        "note": "send one setpoint before each SYNC; the SYNC period must equal 0x60C2:01; with "
        "transmission type 1 the drive applies it at the SYNC",
    }


def homing_objects(axis: Axis, start: float) -> JsonObject:
    """Return the objects that make position 0 of the drive equal to position 0 of the joint.

    Parameters
    ----------
    axis : Axis
        Axis of the joint.
    start : float
        First target position of the joint, in increments. The robot rests there during homing.

    Returns
    -------
    dict
        Entries of the manifest: home position, offset and homing method.
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

    Every position is wrong by at most half an increment. A difference of two positions is then
    wrong by one increment, and a second difference by two.

    Parameters
    ----------
    axis : Axis
        Axis with the size of an increment.
    period : int
        Interval between the positions, ms.

    Returns
    -------
    dict[str, float]
        Bounds for "position" (rad or m), "speed" (rad/s or m/s) and "acceleration" (rad/s² or m/s²)
        of the joint.
    """
    increment = 1 / abs(axis.increments_per_unit)
    h = period / 1000
    return {"position": increment / 2, "speed": increment / h, "acceleration": 2 * increment / h**2}


def setup_objects(axis: Axis, mode: str, period: int) -> list[dict[str, str]]:
    """Return the table of the setup objects for one axis.

    The largest velocity in the drive exceeds that of the joint by the effect of rounding the
    positions to increments (`rounding_bounds`), so that the drive does not cut off a permitted
    motion.

    Parameters
    ----------
    axis : Axis
        Axis of the joint.
    mode : str
        "csp", "csv" or "cst" (`OPERATION_MODES`).
    period : int
        Interpolation period, ms.

    Returns
    -------
    list of dict
        Rows with the columns joint, object, name, value, unit, reason and known. The column known
        states whether a source for the drive confirms the object: `STATUS_QUOTED` or
        `STATUS_NOT_VERIFIED`.

    Raises
    ------
    ExportError
        If a value does not fit its object.
    """
    joint = axis.joint
    motor = axis.joint.motor
    assert motor is not None
    # Motor speed in rpm at a joint speed of 1 rad/s or 1 m/s:
    rpm_per_unit = 60 * abs(axis.increments_per_unit) / axis.counts_per_turn
    max_speed = joint.velocity + rounding_bounds(axis, period)["speed"]
    low, high = sorted(axis.increments_per_unit * position for position in joint.position)
    # The table epos4_objects.csv names these objects, and states their units and reasons. Factors
    # convert N·m to µN·m and rpm to 1e-3 rpm. The exponent −3 selects 1e-3 s.
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
        # Largest current, mA
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
    """Write the table of the setup objects as the text of a CSV file.

    Parameters
    ----------
    rows : list of dict
        Rows of `setup_objects`, at least one. The first row determines the columns.

    Returns
    -------
    str
        Text of the file with a header line.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
