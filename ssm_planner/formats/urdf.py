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
from ssm_planner.publishing import one_line
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

LINKS = ("link1", "link2", "link3", "stage")
TOOL = "tool"
SMALLEST_MASS, SMALLEST_INERTIA = 1e-12, 1e-14
"""kg, kg·m²: of a link whose body has none. Readers refuse a moving link without inertia, or take 1 kg for it."""
NO_MASS = f"has no mass: {SMALLEST_MASS:g} kg and {SMALLEST_INERTIA:g} kg*m^2 stand in, for readers that refuse none"
PLUGIN = "mock_components/GenericSystem"
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
    (folder / f"controllers{suffix}.yaml").write_text(controllers(plan.robot, mark), encoding="utf-8")
    light = [body.name for body in plan.robot.bodies if body.mass == 0]
    return {
        "units": {"angle": "rad", "length": "m", "mass": "kg"},
        "rate_hz": None,
        "notes": [
            *(f"not in it: {x}" for x in ABSENT),
            *(f"body {one_line(name)} {NO_MASS}" for name in light),
            f"links collide as the thin cylinders that are drawn; the hardware of ros2_control is {PLUGIN}, a stand-in",
        ],
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
        f'  <link name="{TOOL}">',
        f"    <!-- {NO_MASS} -->",
        *_inertial(SMALLEST_MASS, np.zeros(3), SMALLEST_INERTIA * np.eye(3)),
        "  </link>",
        f'  <joint name="{TOOL}_tip" type="fixed">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{TOOL}"/>',
        f'    <origin xyz="0 0 0" rpy="{_triple(rpy(rotation))}"/>',
        "  </joint>",
        *_ros2_control(robot),
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
    lines = [f'  <link name="{name}">', f"    <!-- {_comment(body.name)} -->"]
    if body.mass > 0:
        lines += _inertial(body.mass, body.com, inertia_about_com(body))
    else:
        lines += [f"    <!-- {NO_MASS} -->", *_inertial(SMALLEST_MASS, np.zeros(3), SMALLEST_INERTIA * np.eye(3))]
    length, radius = (0.12, 0.001) if joint.kind == "prismatic" else (0.08, 0.003)
    lines += [
        "    <visual>",
        f'      <origin xyz="0 0 {length / 2}" rpy="0 0 0"/>',
        f'      <geometry><cylinder length="{length}" radius="{radius}"/></geometry>',
        "    </visual>",
        "    <collision>",
        f'      <origin xyz="0 0 {length / 2}" rpy="0 0 0"/>',
        f'      <geometry><cylinder length="{length}" radius="{radius}"/></geometry>',
        "    </collision>",
        "  </link>",
    ]
    return lines


def _inertial(mass: float, com: Array, i: Array) -> list[str]:
    return [
        "    <inertial>",
        f'      <origin xyz="{_triple(com)}" rpy="0 0 0"/>',
        f'      <mass value="{_n(mass)}"/>',
        f'      <inertia ixx="{_n(i[0, 0])}" ixy="{_n(i[0, 1])}" ixz="{_n(i[0, 2])}" iyy="{_n(i[1, 1])}" '
        f'iyz="{_n(i[1, 2])}" izz="{_n(i[2, 2])}"/>',
        "    </inertial>",
    ]


def _ros2_control(robot: Robot) -> list[str]:
    """Interfaces of ros2_control: position commands, position and velocity states; the plugin is a stand-in that mirrors."""
    lines = ['  <ros2_control name="ssm" type="system">', f"    <hardware><plugin>{PLUGIN}</plugin></hardware>"]
    for joint in robot.joints:
        low, high = joint.position
        lines += [
            f"    <joint name={quoteattr(joint.name)}>",
            '      <command_interface name="position">',
            f'        <param name="min">{_n(low)}</param>',
            f'        <param name="max">{_n(high)}</param>',
            "      </command_interface>",
            '      <state_interface name="position"/>',
            '      <state_interface name="velocity"/>',
            "    </joint>",
        ]
    return [*lines, "  </ros2_control>"]


def controllers(robot: Robot, mark: str = "") -> str:
    """controllers.yaml for ros2_control: a joint_trajectory_controller that refuses to be off by much."""
    names = "".join(f"      - {joint.name}\n" for joint in robot.joints)
    tolerances = "".join(
        f"      {joint.name}: {{trajectory: {0.01 * (high - low):.7f}, goal: {0.001 * (high - low):.7f}}}\n"
        for joint in robot.joints
        for low, high in (joint.position,)
    )
    return f"""# Controllers of ros2_control for robot.urdf; rad and m. Tolerances are a hundredth and a thousandth of each
# joint's range: first values, to be narrowed at the machine. {mark}
controller_manager:
  ros__parameters:
    update_rate: 1000
    joint_state_broadcaster: {{type: joint_state_broadcaster/JointStateBroadcaster}}
    joint_trajectory_controller: {{type: joint_trajectory_controller/JointTrajectoryController}}
joint_trajectory_controller:
  ros__parameters:
    joints:
{names}    command_interfaces: [position]
    state_interfaces: [position, velocity]
    allow_nonzero_velocity_at_trajectory_end: false
    constraints:
      stopped_velocity_tolerance: 0.01
{tolerances}"""


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
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in text) or "robot"


def _comment(text: str) -> str:
    return one_line(text, without="-<>")
