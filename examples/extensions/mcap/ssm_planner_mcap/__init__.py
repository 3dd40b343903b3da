"""Export format `mcap`: a plan to watch in Foxglove.

The file has channels with JSON messages: the motion of the joints, the motor torques, the position
of the tip, and the transforms of the links. Foxglove draws the robot from robot.urdf beside it.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner import ExportError, Format, Plan, fk, motor_torque
from ssm_planner.formats.ros2 import LARGEST_STATE_RATE, link_poses, quaternion
from ssm_planner.formats.urdf import robot_urdf

NANO = 1_000_000_000
"""Nanoseconds per second."""
NUMBER = {"type": "number"}
INTEGER = {"type": "integer"}

MCAP = Format(
    "mcap",
    "ssm_planner_mcap:write",
    "plan to watch in Foxglove (MCAP with JSON channels, URDF)",
    {"rate": "messages per second in each channel (default 100)"},
)


def write(
    plan: Plan, certificate: Any, folder: Path, suffix: str, rate: float = 100.0
) -> dict[str, Any]:
    """Write motion.mcap and robot.urdf, and return the entries of the manifest.

    The parameters are those of every writer of a format, see `ssm_planner.Format`. `rate` is the
    number of messages per second, Hz.

    Raises
    ------
    ExportError
        If the rate is out of range.
    """
    from mcap.writer import Writer

    if not 0 < rate <= LARGEST_STATE_RATE:
        raise ExportError(f"rate = {rate:g} Hz (allowed: above 0, up to {LARGEST_STATE_RATE:g} Hz)")
    robot, motion = plan.robot, plan.motion
    mark = "UNVERIFIED: the exported plan has no passed certificate." if suffix else ""
    (folder / f"robot{suffix}.urdf").write_text(robot_urdf(robot, mark), encoding="utf-8")
    s = motion.uniform(rate)
    times = s.t - s.t[0]
    values = {"q": s.q, "qd": s.qd, "qdd": s.qdd}
    values["motor_torque"] = motor_torque(robot, s.q, s.qd, s.qdd)
    tips = fk(robot, s.q).position
    names = [joint.name for joint in robot.joints]
    with (folder / f"motion{suffix}.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="ssm-planner")
        writer.add_metadata("plan", {"sha256": plan.sha256, "robot": robot.name, "mark": mark})
        plan_channel = _channel(writer, "/plan", "ssm.Plan", plan_schema(names))
        tip_channel = _channel(writer, "/tip", "ssm.Tip", _object(dict.fromkeys("xyz", NUMBER)))
        frames = _channel(writer, "/tf", "foxglove.FrameTransforms", TRANSFORMS)
        for k, time in enumerate(times):
            joints = {name: _by_joint(names, rows[k]) for name, rows in values.items()}
            tip = dict(zip("xyz", tips[k].tolist(), strict=True))
            for channel, message in (
                (plan_channel, joints),
                (tip_channel, tip),
                (frames, frame_transforms(float(time), link_poses(robot, s.q[k]))),
            ):
                nanoseconds = round(float(time) * NANO)
                text = json.dumps(message, allow_nan=False).encode()
                writer.add_message(channel, nanoseconds, text, nanoseconds)
        writer.finish()
    notes = [f"joint {j.name} has no drive: no motor torque" for j in robot.joints if not j.drive]
    return {"rate_hz": rate, "units": {"all": "rad, m, s, N*m"}, "notes": notes}


def _by_joint(names: list[str], row: np.ndarray) -> dict[str, float]:
    """Return the finite values (4,) by joint."""
    pairs = zip(names, row.tolist(), strict=True)
    return {name: value for name, value in pairs if math.isfinite(value)}


def _object(properties: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON schema of an object."""
    return {"type": "object", "properties": properties}


def plan_schema(names: list[str]) -> dict[str, Any]:
    """Return the JSON schema of the channel /plan: four quantities, each by joint."""
    joints = _object(dict.fromkeys(names, NUMBER))
    return _object(dict.fromkeys(("q", "qd", "qdd", "motor_torque"), joints))


_TRANSFORM = {
    "timestamp": _object({"sec": INTEGER, "nsec": INTEGER}),
    "parent_frame_id": {"type": "string"},
    "child_frame_id": {"type": "string"},
    "translation": _object(dict.fromkeys("xyz", NUMBER)),
    "rotation": _object(dict.fromkeys("xyzw", NUMBER)),
}
TRANSFORMS = _object({"transforms": {"type": "array", "items": _object(_TRANSFORM)}})
"""JSON schema of foxglove.FrameTransforms."""


def frame_transforms(time: float, poses: list[Any]) -> dict[str, Any]:
    """Return the message of the channel /tf at a time in s for the poses of `link_poses`."""
    seconds, nanoseconds = divmod(round(time * NANO), NANO)
    return {
        "transforms": [
            {
                "timestamp": {"sec": seconds, "nsec": nanoseconds},
                "parent_frame_id": parent,
                "child_frame_id": child,
                "translation": dict(zip("xyz", shift.tolist(), strict=True)),
                "rotation": dict(zip("xyzw", quaternion(turn).tolist(), strict=True)),
            }
            for parent, child, turn, shift in poses
        ]
    }


def _channel(writer: Any, topic: str, name: str, schema: dict[str, Any]) -> int:
    """Add a channel of JSON messages and return its number."""
    number = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
    return writer.register_channel(topic, "json", number)
