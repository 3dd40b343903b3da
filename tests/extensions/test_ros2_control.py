"""The exported ROS 2 package is complete. Its parts agree with each other and with the robot."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from ssm_planner.errors import ExportError
from ssm_planner.plans import Plan

ORDER = (
    *("name", "version", "description", "maintainer", "license"),
    *("buildtool_depend", "exec_depend", "export"),
)
"""Order of the elements in package.xml, as its schema requires (REP 149)."""
IMPORTED = re.compile(r"^(?:from|import) (\w+)", re.M)
STANDARD = {"pathlib", "sys", "launch"}
"""Modules of Python, and `launch`, which ros2launch brings."""
ROS_NAMES = {"yaml": "python3-yaml"}


@pytest.fixture(scope="module")
def package(exported: Callable[[str], Path]) -> Path:
    return exported("ros2_control")


@pytest.fixture(scope="module")
def goal(package: Path) -> dict[str, Any]:
    return yaml.safe_load((package / "config/goal.yaml").read_text(encoding="utf-8"))


def description(folder: Path) -> ElementTree.Element:
    return ElementTree.parse(folder / "urdf/robot.urdf").getroot()


def write(plan: Plan, folder: Path, **options: Any) -> None:
    sys.modules["ssm_planner_ros2_control"].write(plan, None, folder, "", **options)


def test_package_xml_is_in_the_order_of_its_schema(package: Path) -> None:
    root = ElementTree.parse(package / "package.xml").getroot()
    tags = [element.tag for element in root]
    assert tags == sorted(tags, key=ORDER.index)
    assert root.get("format") == "3"
    assert re.fullmatch(r"\d+\.\d+\.\d+", root.findtext("version", ""))
    assert root.findtext("export/build_type") == "ament_cmake"
    assert "Not tested with ROS" in root.findtext("description", "")


def test_the_package_depends_on_what_it_uses(package: Path) -> None:
    root = ElementTree.parse(package / "package.xml").getroot()
    depends = {element.text for element in root.findall("exec_depend")}
    for place in ("launch/robot.launch.py", "scripts/play.py"):
        text = (package / place).read_text(encoding="utf-8")
        compile(text, place, "exec")
        used = set(IMPORTED.findall(text)) - STANDARD
        used |= set(re.findall(r'package="(\w+)"', text))
        assert {ROS_NAMES.get(name, name) for name in used} <= depends
    controllers = yaml.safe_load((package / "config/controllers.yaml").read_text(encoding="utf-8"))
    manager = controllers["controller_manager"]["ros__parameters"]
    types = {value["type"].partition("/")[0] for value in manager.values() if type(value) is dict}
    assert types <= depends


def test_everything_that_is_installed_and_named_exists(package: Path) -> None:
    text = (package / "CMakeLists.txt").read_text(encoding="utf-8")
    folders, programs = re.findall(r"install\(\w+ (.*?) DESTINATION", text)
    assert all((package / name).exists() for name in [*folders.split(), *programs.split()])
    name = ElementTree.parse(package / "package.xml").getroot().findtext("name")
    assert f"project({name} NONE)" in text
    for place in ("launch/robot.launch.py", "scripts/play.py"):
        source = (package / place).read_text(encoding="utf-8")
        assert f'get_package_share_directory("{name}")' in source
        files = re.findall(r'"((?:urdf|config)/[\w.]+)"', source)
        assert files
        assert all((package / file).is_file() for file in files)


def test_every_drive_is_a_transmission_with_its_ratio(package: Path, shipped: Plan) -> None:
    reductions = {
        transmission.find("joint").get("name"): float(  # type: ignore[union-attr]
            transmission.findtext("joint/mechanical_reduction", "")
        )
        for transmission in description(package).iterfind("ros2_control/transmission")
    }
    joints = shipped.robot.joints
    assert reductions == {j.name: j.drive.ratio for j in joints if j.drive is not None}


def test_simulated_hardware_starts_at_the_first_point(package: Path, goal: dict[str, Any]) -> None:
    trajectory = goal["trajectory"]
    values = [
        float(element.text or "")
        for element in description(package).iterfind("ros2_control/joint/state_interface/param")
    ]
    assert values == pytest.approx(trajectory["points"][0]["positions"], abs=1e-12)
    joints = [
        element.get("name") for element in description(package).iterfind("ros2_control/joint")
    ]
    controllers = yaml.safe_load((package / "config/controllers.yaml").read_text(encoding="utf-8"))
    parameters = controllers["joint_trajectory_controller"]["ros__parameters"]
    assert joints == trajectory["joint_names"] == parameters["joints"]


def test_the_rest_of_the_description_is_that_of_the_urdf_export(
    package: Path, shipped: Plan
) -> None:
    from ssm_planner.formats.urdf import robot_urdf

    mine, theirs = (
        re.sub(r"  <ros2_control.*</ros2_control>", "", text, flags=re.S)
        for text in (
            (package / "urdf/robot.urdf").read_text(encoding="utf-8"),
            robot_urdf(shipped.robot),
        )
    )
    assert mine == theirs
    assert mine.count("<link") == 6


def test_efforts_are_commanded_only_if_asked_for(
    package: Path, shipped: Plan, tmp_path: Path
) -> None:
    write(shipped, tmp_path, effort=True, package="my_arm", hardware="maker/Drives")
    for folder, expected in ((package, ["position"]), (tmp_path, ["position", "effort"])):
        text = (folder / "config/controllers.yaml").read_text(encoding="utf-8")
        parameters = yaml.safe_load(text)["joint_trajectory_controller"]["ros__parameters"]
        assert parameters["command_interfaces"] == expected
        for joint in description(folder).iterfind("ros2_control/joint"):
            assert [e.get("name") for e in joint.iterfind("command_interface")] == expected
        goal = (folder / "config/goal.yaml").read_text(encoding="utf-8")
        efforts = re.findall(r"effort: \[(.*?)\]", goal)
        assert all(bool(effort) == ("effort" in expected) for effort in efforts)
    assert description(tmp_path).findtext("ros2_control/hardware/plugin") == "maker/Drives"
    assert "my_arm" in (tmp_path / "CMakeLists.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["My_arm", "1arm", "arm__two", "arm-two", "", "arm_", "a b"])
def test_names_that_ros_refuses_are_refused(
    name: str, package: Path, shipped: Plan, tmp_path: Path
) -> None:
    assert package.is_dir()
    with pytest.raises(ExportError, match="no name of a ROS package"):
        write(shipped, tmp_path, package=name)
    assert not list(tmp_path.iterdir())


ROS = (
    *("rclpy", "rclpy.action", "ament_index_python", "ament_index_python.packages"),
    *("control_msgs", "control_msgs.action", "rosidl_runtime_py", "rosidl_runtime_py.set_message"),
    *("sensor_msgs", "sensor_msgs.msg"),
)


@pytest.mark.parametrize(
    ("shift", "missing", "sent"), [(0.0, None, True), (0.01, None, False), (0.0, "tilt", False)]
)
def test_the_plan_is_sent_only_if_the_arm_is_at_its_first_point(
    shift: float,
    missing: str | None,
    sent: bool,
    package: Path,
    goal: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The modules of ROS are replaced by objects that record calls."""
    for name in ROS:
        monkeypatch.setitem(sys.modules, name, MagicMock())

    def set_fields(message: Any, values: Any) -> None:
        trajectory = values["trajectory"]
        points = [SimpleNamespace(**trajectory["points"][0])]
        names = trajectory["joint_names"]
        message.trajectory = SimpleNamespace(joint_names=names, points=points)
        remaining = [k for k, name in enumerate(names) if name != missing]
        positions = np.array(points[0].positions)[remaining] + shift
        states = SimpleNamespace(name=[names[k] for k in remaining], position=positions.tolist())
        sys.modules["rclpy"].task.Future.return_value.result.return_value = states

    sys.modules["rosidl_runtime_py.set_message"].set_message_fields = set_fields
    action = sys.modules["control_msgs.action"].FollowJointTrajectory
    action.Goal.return_value = SimpleNamespace()
    share = sys.modules["ament_index_python.packages"].get_package_share_directory
    share.return_value = str(package)
    program: dict[str, Any] = {"__name__": "play"}
    exec((package / "scripts/play.py").read_text(encoding="utf-8"), program)
    program["yaml"] = SimpleNamespace(safe_load=lambda text: goal)
    client = sys.modules["rclpy.action"].ActionClient.return_value
    status = program["main"]()
    assert client.send_goal_async.called == sent
    assert sent or "not at the first point" in status
