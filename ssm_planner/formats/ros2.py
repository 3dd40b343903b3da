"""A plan for ROS 2: JointTrajectory as YAML and as action goal, and a rosbag2 that shows the motion.

JointTrajectory messages: as YAML, as it is given to `ros2 topic pub` or an action goal, and in rosbag2 files.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.formats.joint_trajectory import (
    INSTALL,
    Message,
    controller_faults,
    split_time,
    trajectory_message,
)
from ssm_planner.formats.spline_points import spline_points
from ssm_planner.plans import Plan
from ssm_planner.publishing import one_line
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

LARGEST_RATE = 1000.0
PUBLISH = (
    "For ros2 topic pub --once /joint_trajectory_controller/joint_trajectory trajectory_msgs/msg/JointTrajectory, with",
    "--yaml-file where that option exists. Too long for a command line; the bag holds the same message:",
    "ros2 bag play bag --topics /joint_trajectory --remap \\",
    "  /joint_trajectory:=/joint_trajectory_controller/joint_trajectory",
)


def export_ros2(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float = 100.0,
    effort: bool = False,
    bag: bool | None = None,
) -> dict[str, Any]:
    """Write joint_trajectory.yaml, goal.yaml and, with `bag`, a rosbag2 (MCAP); returns what the manifest says.

    rate: of the bag's joint states and transforms, Hz. effort: give the rigid-body efforts too, which a controller
    without an effort interface rejects. bag: None leaves it out where the package rosbags is missing, and says so. Raises
    ExportError.
    """
    if not 0 < rate <= LARGEST_RATE:
        raise ExportError(f"a rate of {rate:g} Hz (allowed: above 0, up to {LARGEST_RATE:g} Hz)")
    points = spline_points(plan, certificate)
    message = trajectory_message(plan, points, effort)
    faults, remarks = controller_faults(message, [joint.name for joint in plan.robot.joints])
    if faults:
        raise ExportError(f"{plan.path}: joint_trajectory_controller would reject the trajectory: {faults[0]}")
    name = f"joint_trajectory{suffix}.yaml"
    marks = ["UNVERIFIED: the plan has no passed certificate; do not run it on a machine."] if suffix else []
    marks += [f"Plan {one_line(plan.path.name)}, SHA-256 {plan.sha256}; rad, m, N*m, N.", points.note + "."]
    _write(folder / name, message, [*marks, *PUBLISH], "")
    goal = f"goal{suffix}.yaml"
    _write(folder / goal, message, [*marks, "Goal of control_msgs/action/FollowJointTrajectory."], "trajectory")
    if bag is None and find_spec("rosbags") is None:
        remarks = [*remarks, f"no rosbag2 was written: {INSTALL}"]
    elif bag is not False:
        from ssm_planner.formats.rosbag import write_bag

        write_bag(folder / f"bag{suffix}", plan, message, rate)
    return {
        "trajectory": name,
        "rate_hz": rate,
        "units": {"revolute": "rad", "prismatic": "m", "effort": "N*m, N", "time": "s and ns"},
        "stretch": points.stretch,
        "spline": {"interpolation": points.certificate.interpolation, "certificate": points.certificate.to_dict()},
        "notes": [points.note, *remarks],
    }


def _write(path: Path, message: Message, comments: Sequence[str], under: str) -> None:
    indent = "  " if under else ""
    lines = [f"# {comment}" for comment in comments]
    lines += [f"{under}:"] if under else []
    lines += [f"{indent}header: {{stamp: {{sec: 0, nanosec: 0}}, frame_id: base}}"]
    lines += [f"{indent}joint_names: {json.dumps(list(message.names))}", f"{indent}points:"]
    fields = ("positions", "velocities", "accelerations", "effort")
    for k, t in enumerate(message.time):
        sec, nanosec = split_time(float(t))
        values = ", ".join(f"{field}: {_list(getattr(message, field)[k])}" for field in fields)
        lines.append(f"{indent}- {{{values}, time_from_start: {{sec: {sec}, nanosec: {nanosec}}}}}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _list(values: Sequence[float] | Array) -> str:
    """Numbers that YAML 1.1 reads as numbers: a bare 1e-05 would be a text."""
    return "[" + ", ".join(_number(float(value) + 0.0) for value in np.asarray(values)) + "]"


def _number(value: float) -> str:
    text = repr(value)
    mantissa, e, exponent = text.partition("e")
    return text if not e or "." in mantissa else f"{mantissa}.0e{exponent}"
