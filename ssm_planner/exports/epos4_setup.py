"""Objects to set in an EPOS4 before it follows a stream, each with its reason."""

from __future__ import annotations

import math

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.exports.epos4_axis import Axis

MODES = {"csp": 8, "csv": 9, "cst": 10}
"""Mode of operation (0x6060)."""
VELOCITY_UNIT = 0xFDB44700
"""0x60A9: velocities in 1e-3 rpm."""
LAG_PERIODS = 10
UINT32, INT32, UINT16 = 2**32 - 1, 2**31 - 1, 2**16 - 1


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
    lag = joint.velocity * LAG_PERIODS * period / 1000 * scale
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
            max(math.ceil(lag), 2),
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
            math.ceil((joint.acceleration + effects["acceleration"]) * turns),
            "rpm/s",
            f"acceleration limit of the joint, {room}",
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
