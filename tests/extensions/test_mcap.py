"""The reader of the package mcap finds the values of the plan in the exported file."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.dynamics.robot_dynamics import motor_torque
from ssm_planner.errors import ExportError
from ssm_planner.kinematics.robot_kinematics import fk
from ssm_planner.plans import Plan

pytest.importorskip("mcap", reason="package mcap, extra test")
AGREEMENT = 1e-9


@pytest.fixture(scope="module")
def messages(exported: Callable[[str], Path]) -> dict[str, list[tuple[int, Any]]]:
    """Return the times in ns and the contents of the messages by topic.

    Every fiftieth message of a topic is validated by its schema.
    """
    from jsonschema import Draft202012Validator
    from mcap.reader import make_reader

    result: dict[str, list[tuple[int, Any]]] = {}
    validators: dict[int, Any] = {}
    with (exported("mcap") / "motion.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            content = json.loads(message.data)
            if schema.id not in validators:
                validators[schema.id] = Draft202012Validator(json.loads(schema.data))
            if len(result.get(channel.topic, [])) % 50 == 0:
                validators[schema.id].validate(content)
            result.setdefault(channel.topic, []).append((message.log_time, content))
    return result


def test_the_channels_have_the_values_of_the_plan(
    messages: dict[str, list[tuple[int, Any]]], shipped: Plan
) -> None:
    times = np.array([time for time, _ in messages["/plan"]]) / 1e9
    motion, robot = shipped.motion, shipped.robot
    exact = np.minimum(np.arange(len(times)) / 100, motion.duration)
    assert np.abs(times - exact).max() <= 1e-9
    s = motion.sample(motion.breaks[0] + exact, clamp=True)
    torque = motor_torque(robot, s.q, s.qd, s.qdd)
    for name, values in {"q": s.q, "qd": s.qd, "qdd": s.qdd, "motor_torque": torque}.items():
        for k, joint in enumerate(robot.joints):
            read = [content[name].get(joint.name, np.nan) for _, content in messages["/plan"]]
            difference = np.abs(np.array(read) - values[:, k])
            assert np.all(difference <= AGREEMENT) or np.all(np.isnan(values[:, k]))
    tips = np.array([[tip[axis] for axis in "xyz"] for _, tip in messages["/tip"]])
    assert np.abs(tips - fk(robot, s.q).position).max() <= AGREEMENT


def test_the_transforms_lead_to_the_tool(
    messages: dict[str, list[tuple[int, Any]]], shipped: Plan
) -> None:
    """The chain of rotations gives the orientation of the tool, and every transform states its
    time.
    """
    from scipy.spatial.transform import Rotation

    for time, content in messages["/tf"][::40]:
        orientation, parent = Rotation.identity(), "base"
        for transform in content["transforms"]:
            assert transform["parent_frame_id"] == parent
            parent = transform["child_frame_id"]
            orientation *= Rotation.from_quat([transform["rotation"][key] for key in "xyzw"])
            stamp = transform["timestamp"]
            assert stamp["sec"] * 10**9 + stamp["nsec"] == time
        assert parent == "tool"
        q = shipped.motion.sample(shipped.motion.breaks[0] + np.array([time / 1e9]), clamp=True).q
        assert np.abs(orientation.as_matrix() - fk(shipped.robot, q).rotation[0]).max() <= 1e-8


def test_the_robot_is_beside_the_file(exported: Callable[[str], Path]) -> None:
    assert (exported("mcap") / "robot.urdf").read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e9, float("nan")])
def test_an_impossible_rate_is_refused(
    rate: float, exported: Callable[[str], Path], shipped: Plan, tmp_path: Path
) -> None:
    exported("mcap")
    with pytest.raises(ExportError, match="rate"):
        sys.modules["ssm_planner_mcap"].write(shipped, None, tmp_path, "", rate)
