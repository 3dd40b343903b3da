"""Export format `mjcf`: the robot for MuJoCo, with the exact friction of its drives.

MuJoCo has no friction that depends on the load. The exported model therefore contains every motor
shaft as a body of its own, and a spring connects it to its joint, as in `ssm-planner simulate`. A
passive force moves the shafts by the exact law, which the folder contains as generated C code.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import casadi as ca
import numpy as np

from ssm_planner import Controller, ExportError, Format, Joint, Plan, Robot
from ssm_planner.codegen import SIGN_FUNCTION, Argument, c_literal, dense_function, write_function
from ssm_planner.dynamics import inertia_about_com
from ssm_planner.formats.c import ROBOT_FILE, export_c
from ssm_planner.formats.ros2 import link_poses, quaternion
from ssm_planner.formats.urdf import LINK_CYLINDERS, SMALLEST_INERTIA, SMALLEST_MASS, TOOL_FRAME
from ssm_planner.laws import drive_step
from ssm_planner.simulation.playback import robot_compliance

TIMESTEP = 4e-4
"""Default time step of the model, s."""
LONGEST_STEP = 1e-3
"""Largest time step, s. The springs between motors and joints vibrate at up to 100 Hz."""
SPEED_SOURCE = 1e3
"""Inertia (kg·m² or kg) that makes a joint without a drive follow the commanded speed."""
LIGHTEST_SHAFT = 1e-9
"""Smallest inertia of a motor shaft in the model, kg·m². MuJoCo requires one.

The law determines the speed of the shaft, so the inertia in the model does not matter.
"""
FILES = ("ssm_passive.c", "ssm_mujoco.py")
"""Files of this package that the export copies."""

MJCF = Format(
    "mjcf",
    "ssm_planner_mujoco:write",
    "robot for MuJoCo with the exact friction of its drives (MJCF, C and Python)",
    {"timestep": f"time step of the model in s (default {TIMESTEP:g})"},
)


def write(
    plan: Plan, certificate: Any, folder: Path, suffix: str, timestep: str | float = TIMESTEP
) -> dict[str, Any]:
    """Write the MJCF file, the C export, the law of the drives and the Python module.

    The parameters are those of every writer of a format, see `ssm_planner.Format`. `timestep` is
    the time step of the model, s.

    Raises
    ------
    ExportError
        If the time step is out of range.
    """
    robot = plan.robot
    step = _time_step(timestep)
    details = export_c(plan, certificate, folder, suffix)
    (folder / f"robot{suffix}.xml").write_text(mjcf(robot, step, suffix), encoding="utf-8")
    (folder / "ssm_drives.h").write_text(drives_header(robot, suffix), encoding="utf-8")
    for name in FILES:
        shutil.copyfile(Path(__file__).parent / name, folder / name)
    assumed = "springs, dampers and backlash between motors and joints are assumed, not measured"
    return {**details, "notes": [*details["notes"], assumed]}


def _time_step(text: str | float) -> float:
    """Return a time step in s. Raises ExportError if it is not a number or out of range."""
    try:
        step = float(text)
    except ValueError:
        step = math.nan
    if not 0 < step <= LONGEST_STEP:
        allowed = f"above 0, up to {LONGEST_STEP:g} s"
        raise ExportError(f"timestep = {text} is not allowed (allowed: {allowed})")
    return step


def shafts(robot: Robot) -> list[str]:
    """Return the name of the MuJoCo joint that the law of each joint moves.

    It is the motor shaft, or the joint itself if it has no drive.
    """
    return [j.name if j.drive is None else f"{j.name}_motor" for j in robot.joints]


def _inertia(joint: Joint) -> float:
    """Return the inertia of the shaft of a joint in the model, or of the joint without a drive."""
    return SPEED_SOURCE if joint.drive is None else max(joint.drive.input_inertia, LIGHTEST_SHAFT)


def drives_header(robot: Robot, suffix: str = "") -> str:
    """Return the C header with the constants and the law of the drives.

    A suffix marks the files of an unverified plan.

    The law is `ssm_planner.laws.drive_step`. It computes the speeds of the motors after
    a step from their speeds, times at rest and torques, and the efforts of the springs.
    """
    speed, rest, torque, load = (ca.SX.sym(name, 4) for name in ("speed", "rest", "torque", "load"))
    h = ca.SX.sym("h")
    after = [
        torque[k]
        if joint.drive is None
        else drive_step(joint.drive, speed[k], rest[k], torque[k], load[k], h=h).w
        for k, joint in enumerate(robot.joints)
    ]
    inputs = {"speed": speed, "rest": rest, "torque": torque, "load": load}
    head = ", ".join(f"const ssm_real {name}[4]" for name in inputs)
    body = write_function(
        f"static void ssm_drive_speeds({head}, ssm_real h, ssm_real after[4])",
        dense_function("drives", [*inputs.values(), h], [ca.vertcat(*after)]),
        [*(Argument(name, 4) for name in inputs), Argument("h", 0)],
        [Argument("after", 4)],
    )
    compliance = robot_compliance(robot, Controller())
    drives = [joint.drive for joint in robot.joints]
    rows = {
        "RATIO": [0.0 if drive is None else drive.ratio for drive in drives],
        "INERTIA": [_inertia(joint) for joint in robot.joints],
        "STIFFNESS": compliance.stiffness,
        "DAMPING": compliance.damping,
        "FREE_PLAY": compliance.backlash / 2,
    }
    table = ",\n".join(f"    {{{', '.join(map(c_literal, values))}}}" for values in rows.values())
    return f"""\
/* {_mark(suffix)}Law of the drives in SI units, joints as in ssm_robot.h.
   A ratio of 0 means no drive. */
#include "{ROBOT_FILE}{suffix}.h"
#include <math.h>
static const char *const ssm_joint_name[4] = {_strings([joint.name for joint in robot.joints])};
static const char *const ssm_shaft_name[4] = {_strings(shafts(robot))};
enum {{ {", ".join(rows)} }};
const ssm_real ssm_drive_constants[{len(rows)}][4] = {{
{table}
}};
{SIGN_FUNCTION}
/* Computes the motor speeds after a step of h seconds. `torque` is the commanded speed of a joint
   without a drive. */
{body}"""


def _mark(suffix: str) -> str:
    """Return the warning in the comments of an unverified plan, which the suffix indicates."""
    return "UNVERIFIED: the plan has no passed certificate. " if suffix else ""


def _strings(values: Sequence[str]) -> str:
    """Return the value of a C array of strings."""
    return "{" + ", ".join(f'"{value}"' for value in values) + "}"


def mjcf(robot: Robot, timestep: float, suffix: str = "") -> str:
    """Return the MJCF text: the bodies of the robot, a shaft for every drive, and the motors.

    A suffix marks the files of an unverified plan.
    """
    root = ElementTree.Element("mujoco", model=f"robot{suffix}")
    ElementTree.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    options = {"timestep": repr(timestep), "integrator": "Euler", "gravity": _text(robot.gravity)}
    ElementTree.SubElement(root, "option", options)
    ElementTree.SubElement(root, "size", nuserdata="8")
    parent = world = ElementTree.SubElement(root, "worldbody")
    motors = ElementTree.SubElement(root, "actuator")
    for k, (_, name, turn, _) in enumerate(link_poses(robot, np.zeros(4))):
        x, y, z, w = quaternion(turn)
        parent = ElementTree.SubElement(parent, "body", name=name, quat=_text([w, x, y, z]))
        if name == TOOL_FRAME:
            _inertial(parent, SMALLEST_MASS, np.zeros(3), SMALLEST_INERTIA * np.eye(3))
            continue
        body, joint = robot.bodies[k], robot.joints[k]
        moved = {
            "name": joint.name,
            "type": "slide" if joint.slides else "hinge",
            "axis": _text(body.frame.T @ robot.geometry.axes[k]),
            "range": _text(joint.position),
            "limited": "false",
            "armature": repr(_inertia(joint) if joint.drive is None else 0.0),
        }
        ElementTree.SubElement(parent, "joint", moved)
        if body.mass > 0:
            _inertial(parent, body.mass, body.com, inertia_about_com(body))
        else:
            _inertial(parent, SMALLEST_MASS, np.zeros(3), SMALLEST_INERTIA * np.eye(3))
        length, radius = LINK_CYLINDERS[joint.slides]
        shape = {"type": "cylinder", "size": _text([radius, length / 2])}
        shape |= {"pos": _text([0, 0, length / 2]), "contype": "0", "conaffinity": "0"}
        ElementTree.SubElement(parent, "geom", shape)
        motor = {"name": joint.name, "joint": shafts(robot)[k]}
        if joint.drive is not None:
            shaft = ElementTree.SubElement(world, "body", name=shafts(robot)[k])
            ElementTree.SubElement(shaft, "joint", name=shafts(robot)[k], type="hinge")
            _inertial(shaft, SMALLEST_MASS, np.zeros(3), _inertia(joint) * np.eye(3))
            if joint.motor is not None:
                limit = joint.motor.max_torque
                motor |= {"ctrllimited": "true", "ctrlrange": _text([-limit, limit])}
        ElementTree.SubElement(motors, "motor", motor)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _inertial(body: ElementTree.Element, mass: float, com: Any, inertia: Any) -> None:
    """Add the mass, the centre of mass and the inertia (3, 3) about it to a body."""
    entries = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    values = {"mass": repr(float(mass)), "pos": _text(com), "fullinertia": _text(entries)}
    ElementTree.SubElement(body, "inertial", values)


def _text(values: Any) -> str:
    """Return numbers with all digits, separated by spaces."""
    return " ".join(repr(float(value)) for value in values)
