"""Export format `ros2_control`: a ROS 2 package that plays a plan.

The export folder is the package: description with transmissions, controllers, launch file, the
trajectory and a program that sends it. The package has not been tested with ROS.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ssm_planner import ExportError, Format, Plan
from ssm_planner.display import jinja_environment, render_template
from ssm_planner.formats.ros2 import export_ros2
from ssm_planner.formats.urdf import HARDWARE_PLUGIN, export_urdf
from ssm_planner.publishing import one_line

NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
"""Names that ROS 2 accepts for packages (REP 144)."""
FILES = {
    "package.xml": "package.xml",
    "CMakeLists.txt": "CMakeLists.txt",
    "robot.launch.py": "launch/robot.launch.py",
    "play.py": "scripts/play.py",
}
"""Files of the package by the name of their template."""
NOTES = (
    "the package has not been tested with ROS: its XML, YAML and Python files were only parsed",
    "before the start, the arm must be at the first point of the trajectory; play.py checks this",
)

ROS2_CONTROL = Format(
    "ros2_control",
    "ssm_planner_ros2_control:write",
    "ROS 2 package that plays the plan with joint_trajectory_controller",
    {
        "package": "name of the package (default ssm_robot)",
        "hardware": f"plugin of the hardware (default {HARDWARE_PLUGIN})",
        "effort": "command efforts too: motor torque with friction, times ratio",
    },
)


def write(
    plan: Plan,
    certificate: Any,
    folder: Path,
    suffix: str,
    package: str = "ssm_robot",
    hardware: str = HARDWARE_PLUGIN,
    effort: bool = False,
) -> dict[str, Any]:
    """Write the package and return the entries of the manifest.

    The first parameters are those of every writer of a format, see `ssm_planner.Format`.

    Parameters
    ----------
    package : str
        Name of the package.
    hardware : str
        Plugin of ros2_control that moves the motors.
    effort : bool
        Add an effort interface to every joint, and efforts to the trajectory.

    Raises
    ------
    ExportError
        If ROS 2 does not accept the name of the package, or no spline keeps the limits.
    """
    if not NAME.fullmatch(package):
        allowed = "lower-case letters, digits and single underscores, with a letter first"
        raise ExportError(f"package = {package!r} is no name of a ROS package (allowed: {allowed})")
    details = export_ros2(plan, certificate, folder, suffix, effort=effort, bag=False)
    export_urdf(plan, certificate, folder, suffix)
    goal, description, controllers = (
        _move(folder / f"{stem}{suffix}.{ending}", folder / place)
        for stem, ending, place in (
            ("goal", "yaml", "config"),
            ("robot", "urdf", "urdf"),
            ("controllers", "yaml", "config"),
        )
    )
    text = description.read_text(encoding="utf-8")
    description.write_text(with_motors(text, plan, hardware, effort), encoding="utf-8")
    if effort:
        text = controllers.read_text(encoding="utf-8")
        text = text.replace(
            "command_interfaces: [position]", "command_interfaces: [position, effort]"
        )
        controllers.write_text(text, encoding="utf-8")
    values = {
        "package": package,
        "robot": one_line(plan.robot.name),
        "mark": "UNVERIFIED: the plan has no passed certificate. " if suffix else "",
        "sha256": plan.sha256,
        "goal": goal.name,
        "description": description.name,
        "controllers": controllers.name,
    }
    for template, place in FILES.items():
        templates = jinja_environment("ssm_planner_ros2_control", escape=template.endswith(".xml"))
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_text(render_template(templates, template, **values), "utf-8")
    return {**details, "notes": [*details["notes"], *NOTES]}


def _move(path: Path, folder: Path) -> Path:
    """Move a file into a folder, and return its new path."""
    folder.mkdir(exist_ok=True)
    return path.replace(folder / path.name)


def with_motors(urdf: str, plan: Plan, hardware: str, effort: bool) -> str:
    """Return the URDF text with the motors in its element `ros2_control`.

    Every drive becomes a SimpleTransmission. Its reduction is the motor angle per joint coordinate,
    which is in rad/m for the insertion. Simulated hardware starts at the first point of the plan.
    """
    head, opening, rest = urdf.partition("  <ros2_control")
    block, closing, tail = rest.partition("</ros2_control>")
    system = ElementTree.fromstring(opening + block + closing)
    for plugin in system.iterfind("hardware/plugin"):
        plugin.text = hardware
    start = plan.motion.sample(plan.motion.breaks[:1]).q[0]
    for element, joint, position in zip(
        system.findall("joint"), plan.robot.joints, start, strict=True
    ):
        for state in element.iterfind("state_interface[@name='position']"):
            ElementTree.SubElement(state, "param", name="initial_value").text = repr(
                float(position)
            )
        if effort:
            ElementTree.SubElement(element, "command_interface", name="effort")
        if joint.drive is None:
            continue
        transmission = ElementTree.SubElement(system, "transmission", name=f"{joint.name}_drive")
        plugin = ElementTree.SubElement(transmission, "plugin")
        plugin.text = "transmission_interface/SimpleTransmission"
        motor = {"name": f"{joint.name}_motor", "role": "actuator1"}
        ElementTree.SubElement(transmission, "actuator", motor)
        moved = ElementTree.SubElement(transmission, "joint", name=joint.name, role="joint1")
        ElementTree.SubElement(moved, "mechanical_reduction").text = repr(float(joint.drive.ratio))
        ElementTree.SubElement(moved, "offset").text = "0.0"
    ElementTree.indent(system)
    text = ElementTree.tostring(system, encoding="unicode")
    return head + "\n".join(f"  {line}" for line in text.splitlines()) + tail
