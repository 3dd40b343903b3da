"""Export the mechanism as URDF with joints, limits and inertias.

`export_urdf` writes robot.urdf and the configuration of controllers for ros2_control. `robot_urdf`
returns the text, which a rosbag2 contains as well. URDF cannot represent the friction of the
drives, so the export leaves it out.
"""

import math
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.display import jinja_environment, render_template
from ssm_planner.dynamics import inertia_about_com, motor_torque_rows, required_friction
from ssm_planner.plans import Plan
from ssm_planner.problem import Joint, Robot
from ssm_planner.publishing import one_line
from ssm_planner.typing import Array, JsonObject
from ssm_planner.verification import Certificate

if TYPE_CHECKING:
    from jinja2 import Environment

LINK_NAMES = ("link1", "link2", "link3", "stage")
"""Names of the moving links."""
TOOL_FRAME = "tool"
"""Name of the frame at the tool tip."""
SMALLEST_MASS = 1e-12
"""Mass of a link whose body is massless, kg.

Some readers refuse a moving link without mass and inertia. Others assume 1 kg.
"""
SMALLEST_INERTIA = 1e-14
"""Moment of inertia of a link whose body is massless, kg·m²."""
MASSLESS_NOTE = (
    f"has no mass: {SMALLEST_MASS:g} kg and {SMALLEST_INERTIA:g} kg*m^2 are used instead, because "
    "some readers refuse a massless link"
)
"""Note about a massless body."""
HARDWARE_PLUGIN = "mock_components/GenericSystem"
"""Placeholder for the hardware in ros2_control."""
LINK_CYLINDERS = ((0.08, 0.003), (0.12, 0.001))
"""Length and radius (m) of the cylinder that represents a turning link, and a sliding link."""
UNLIMITED_EFFORT = 1e3
"""Effort limit (N·m or N) of a joint without a motor. URDF requires a number."""

OMITTED_PROPERTIES = (
    "friction: URDF cannot express the law of worms and screws (friction that grows with the load, "
    "self-locking, static friction), and its constant friction and damping would be wrong; motor "
    "torques are not joint efforts",
    "limits of acceleration, jerk, motor speed, motor torque, task and eye",
    "gravity: simulators assume the direction -z",
    "inertia of rotors, wheels and nuts (input and output inertia of the drives)",
)
"""Properties of the robot that the file does not contain."""


def export_urdf(plan: Plan, certificate: Certificate, folder: Path, suffix: str) -> JsonObject:
    """Write robot.urdf and controllers.yaml, and return the entries of the manifest.

    Parameters
    ----------
    plan : Plan
        The plan with its robot.
    certificate : Certificate
        Certificate of the plan. The files do not contain it.
    folder : Path
        Folder of the files.
    suffix : str
        Text before the extension of all file names: "" for a verified plan, or "_unverified".

    Returns
    -------
    dict
        Entries that this format adds to the manifest: units, rate (null) and notes for the user.
    """
    path = folder / f"robot{suffix}.urdf"
    mark = "" if not suffix else "UNVERIFIED: the exported plan has no passed certificate."
    path.write_text(robot_urdf(plan.robot, mark), encoding="utf-8")
    controllers = render_template(
        _templates(escape=False), "controllers.yaml", joints=plan.robot.joints, mark=mark
    )
    (folder / f"controllers{suffix}.yaml").write_text(controllers, encoding="utf-8")
    notes = [f"not included: {text}" for text in OMITTED_PROPERTIES]
    massless = [body for body in plan.robot.bodies if body.mass == 0]
    notes += [f"body {one_line(body.name)} {MASSLESS_NOTE}" for body in massless]
    notes += [
        "the collision shapes are the thin cylinders of the visuals; the hardware of "
        f"ros2_control is a placeholder, {HARDWARE_PLUGIN}"
    ]
    return {
        "units": {"angle": "rad", "length": "m", "mass": "kg"},
        "rate_hz": None,
        "notes": notes,
    }


def robot_urdf(robot: Robot, mark: str = "") -> str:
    """Return the robot as URDF text with a base, four links and the frame of the tool tip.

    Parameters
    ----------
    robot : Robot
        Robot that is described.
    mark : str
        Warning that is added to the comment at the beginning.

    Returns
    -------
    str
        Text of the URDF file (XML).
    """
    return render_template(
        _templates(escape=True),
        "robot.urdf",
        name=robot.name,
        mark=mark,
        absent=OMITTED_PROPERTIES,
        gravity=robot.gravity,
        links=list(_link_values(robot)),
        massless=MASSLESS_NOTE,
        stand_in=(SMALLEST_MASS, np.zeros(3), SMALLEST_INERTIA * np.eye(3)),
        tool=TOOL_FRAME,
        tool_rpy=rpy_angles(robot.bodies[-1].frame.T @ robot.geometry.tool_home),
        plugin=HARDWARE_PLUGIN,
    )


def _link_values(robot: Robot) -> Iterator[dict[str, Any]]:
    """Yield the values that the template robot.urdf needs for every link and its joint.

    Parameters
    ----------
    robot : Robot
        Robot that is described.

    Yields
    ------
    dict
        `name` of the link and of its `parent`, `body`, `joint`, `inertia` about the centre of mass
        (None for a massless body), `size` of the drawn cylinder, `rpy` (roll, pitch and yaw of the
        link relative to its parent at q = 0, rad), `axis` of the joint in the frame of the link,
        and the largest `effort` of the joint in N·m or N.
    """
    parent = "base"
    frame = np.eye(3)
    geometry = robot.geometry
    links = zip(LINK_NAMES, robot.bodies, robot.joints, geometry.axes, strict=True)
    for name, body, joint, axis in links:
        yield {
            "name": name,
            "parent": parent,
            "body": body,
            "joint": joint,
            "inertia": inertia_about_com(body) if body.mass > 0 else None,
            "size": LINK_CYLINDERS[joint.slides],
            "rpy": rpy_angles(frame.T @ body.frame),
            "axis": body.frame.T @ axis,
            "effort": effort_limit(joint),
        }
        parent = name
        frame = body.frame


def rpy_angles(rotation: Array) -> Array:
    """Return the roll, pitch and yaw angles of a rotation matrix.

    The rotation is R = Rz(yaw) Ry(pitch) Rx(roll), as URDF defines it. The angles are also accurate
    at a pitch of ±90°, where the yaw is chosen as 0.

    Parameters
    ----------
    rotation : (3, 3) array
        Rotation matrix.

    Returns
    -------
    (3,) array
        Roll, pitch and yaw, rad.
    """
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    if math.hypot(rotation[0, 0], rotation[1, 0]) < 1e-12:
        yaw = 0.0
    s = math.sin(yaw)
    c = math.cos(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    roll = math.atan2(
        s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1]
    )
    return np.array([roll, pitch, yaw]) + 0.0


def effort_limit(joint: Joint) -> float:
    """Return the largest steady effort that the motor of a joint provides through its drive.

    The motor lifts the load F at its largest torque τ_max. The motor torque of the drive is
    τ = τ_0 + k (F + b_oc), where τ_0 is the torque without load, k is the slope, and b_oc is the
    friction at the output. The result is the load F = (τ_max − τ_0)/k − b_oc.

    Parameters
    ----------
    joint : Joint
        Joint with its drive and motor.

    Returns
    -------
    float
        Effort, N·m or N. It is `UNLIMITED_EFFORT` for a joint without a motor.
    """
    drive = joint.drive
    motor = joint.motor
    if drive is None or motor is None:
        return UNLIMITED_EFFORT
    rows = motor_torque_rows(drive, 1)
    # The torque in the direction +1 is the larger one of two linear functions of the load.
    slope = max(float(rows.slope[0]), float(rows.slope[1]))
    return max(
        (motor.max_torque - float(rows.coulomb)) / slope - required_friction(drive).b_oc, 0.0
    )


@cache
def _templates(escape: bool) -> "Environment":
    """Return the Jinja environment that renders the templates of this module.

    Parameters
    ----------
    escape : bool
        True to escape texts for XML.

    Returns
    -------
    jinja2.Environment
        Environment with the filters that the templates use.
    """
    from markupsafe import Markup

    return jinja_environment(
        "ssm_planner.formats",
        escape,
        exact=_format_exact,
        triple=_format_triple,
        identifier=lambda text: re.sub("[^0-9A-Za-z]", "_", text) or "robot",
        comment=lambda text: Markup(one_line(text, without="-<>")),
    )


def _format_triple(values: Array) -> str:
    """Format three numbers for an XML attribute.

    Values below 1e-16 are rounding errors, so they become 0.
    """
    return " ".join(_format_exact(value) for value in np.where(np.abs(values) < 1e-16, 0.0, values))


def _format_exact(value: float) -> str:
    """Format a number with all digits and without a negative zero."""
    return repr(float(value) + 0.0)
