"""The mechanism as URDF: joints, limits, inertias; friction stays behind, for URDF has no place for it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.rigid_body import inertia_about_com
from ssm_planner.dynamics.transmission import motor_torque_rows
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Body, Joint, Robot
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

LINKS = ("link1", "link2", "link3", "stage")
TOOL = "tool"
NO_EFFORT = 1e3
"""N·m or N: URDF asks for an effort limit where the robot file gives no motor."""

ABSENT = (
    "friction: the law of worms and screws (friction that grows with the load, self-locking, static friction) has no place "
    "in URDF, whose constant friction and damping would be wrong, so none is given; motor torques are not joint efforts",
    "limits of acceleration, jerk, motor speed and torque, of the task and about the eye",
    "gravity: simulators take theirs along -z",
    "inertia of rotors, wheels and nuts (input and output inertia of the drives)",
)


def export_urdf(plan: Plan, certificate: Certificate, folder: Path, suffix: str) -> dict[str, Any]:
    """Write robot.urdf into a folder; returns what the manifest says of it."""
    path = folder / f"robot{suffix}.urdf"
    mark = "" if not suffix else "UNVERIFIED: the plan it was exported with has no passed certificate."
    path.write_text(urdf(plan.robot, mark), encoding="utf-8")
    return {
        "units": {"angle": "rad", "length": "m", "mass": "kg"},
        "rate_hz": None,
        "notes": [f"not in it: {x}" for x in ABSENT],
    }


def urdf(robot: Robot, mark: str = "") -> str:
    """The robot as URDF text: base, four links, and the frame of the tool tip."""
    lines = ['<?xml version="1.0"?>', "<!--", f"  Robot {_comment(robot.name)}. {mark}".rstrip()]
    lines += ["  The base frame has its origin at the remote centre of motion; rad, m, kg.", "  Not in this file:"]
    lines += [f"  - {text}" for text in ABSENT]
    gravity = ", ".join(f"{value:.6g}" for value in robot.gravity)
    lines += [f"  Gravity in the base frame: ({gravity}) m/s^2.", "-->"]
    lines += [f"<robot name={quoteattr(_name(robot.name))}>", '  <link name="base"/>']
    parent, frame = "base", np.eye(3)
    axes = (robot.geometry.omega1, robot.geometry.omega2, robot.geometry.omega3, robot.geometry.omega3)
    for link, body, joint, axis in zip(LINKS, robot.bodies, robot.joints, axes, strict=True):
        lines += _link(link, body, joint)
        lines += _joint(joint, parent, link, frame.T @ body.frame, body.frame.T @ axis)
        parent, frame = link, body.frame
    rotation = frame.T @ robot.geometry.tool_home
    lines += [
        f'  <link name="{TOOL}"/>',
        f'  <joint name="{TOOL}_tip" type="fixed">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{TOOL}"/>',
        f'    <origin xyz="0 0 0" rpy="{_triple(rpy(rotation))}"/>',
        "  </joint>",
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def rpy(rotation: Array) -> Array:
    """Roll, pitch, yaw (3,), rad, of R = Rz(yaw) Ry(pitch) Rx(roll) (3, 3), accurate at ±90° too."""
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    if math.hypot(rotation[0, 0], rotation[1, 0]) < 1e-12:
        yaw = 0.0
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    roll = math.atan2(s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1])
    return np.array([roll, pitch, yaw]) + 0.0


def effort_limit(joint: Joint) -> float:
    """Largest steady effort, N·m or N, that the motor brings through its drive against a load."""
    drive, motor = joint.drive, joint.motor
    if drive is None or motor is None:
        return NO_EFFORT
    rows = motor_torque_rows(drive, 1)
    slope = max(float(rows.slope[0]), float(rows.slope[1]))
    return max((motor.max_torque - float(rows.coulomb)) / slope - friction_of(drive).b_oc, 0.0)


def _link(name: str, body: Body, joint: Joint) -> list[str]:
    lines = [f'  <link name="{name}">']
    if body.mass > 0:
        i = inertia_about_com(body)
        lines += [
            f"    <!-- {_comment(body.name)} -->",
            "    <inertial>",
            f'      <origin xyz="{_triple(body.com)}" rpy="0 0 0"/>',
            f'      <mass value="{body.mass!r}"/>',
            f'      <inertia ixx="{_n(i[0, 0])}" ixy="{_n(i[0, 1])}" ixz="{_n(i[0, 2])}" iyy="{_n(i[1, 1])}" '
            f'iyz="{_n(i[1, 2])}" izz="{_n(i[2, 2])}"/>',
            "    </inertial>",
        ]
    length, radius = (0.12, 0.001) if joint.kind == "prismatic" else (0.08, 0.003)
    lines += [
        "    <visual>",
        f'      <origin xyz="0 0 {length / 2}" rpy="0 0 0"/>',
        f'      <geometry><cylinder length="{length}" radius="{radius}"/></geometry>',
        "    </visual>",
        "  </link>",
    ]
    return lines


def _joint(joint: Joint, parent: str, child: str, placed: Array, axis: Array) -> list[str]:
    low, high = joint.position
    return [
        f'  <joint name="{escape(joint.name)}" type="{joint.kind}">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f'    <origin xyz="0 0 0" rpy="{_triple(rpy(placed))}"/>',
        f'    <axis xyz="{_triple(axis)}"/>',
        f'    <limit lower="{_n(low)}" upper="{_n(high)}" velocity="{_n(joint.velocity)}" '
        f'effort="{_n(effort_limit(joint))}"/>',
        "  </joint>",
    ]


def _triple(values: Array) -> str:
    return " ".join(_n(value) for value in np.where(np.abs(values) < 1e-16, 0.0, values))


def _n(value: float) -> str:
    return repr(float(value) + 0.0)


def _name(text: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in text)


def _comment(text: str) -> str:
    return text.replace("--", "- ")
