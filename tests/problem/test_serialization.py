"""A robot survives its JSON form bit for bit, and a fault of the JSON data is named by its key."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_robot
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import robot_from_plain, to_plain
from tests.support.paths import ROOT


def same(a: object, b: object) -> None:
    """Assert that two values are equal in type, structure and every bit."""
    if dataclasses.is_dataclass(a):
        assert type(a) is type(b)
        for field in dataclasses.fields(a):
            same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, np.ndarray):
        assert np.array_equal(a, b)
        assert not b.flags.writeable
    elif isinstance(a, (list, tuple)):
        assert type(a) is type(b)
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            same(x, y)
    elif isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            same(a[key], b[key])
    else:
        assert type(a) is type(b)
        assert a == b


def through_json(robot: Robot) -> dict:
    """Return the data of a robot after a round trip through JSON."""
    return json.loads(json.dumps(to_plain(robot), allow_nan=False))


def test_a_robot_survives_json_bit_for_bit(robot: Robot) -> None:
    same(robot, robot_from_plain(through_json(robot)))


def test_every_optional_value_survives(robot: Robot) -> None:
    drive = robot.joints[0].drive
    friction = dataclasses.replace(
        drive.friction,
        law="stribeck_gaussian",
        stribeck_speed=3,
        covariance={"mu": {"mu": 1e-4}},
        mu_lowest=0.1,
    )
    drive = dataclasses.replace(
        drive, friction=friction, placeholders=("preload",), dimensions={"ratio": 120.0}
    )
    joint = dataclasses.replace(robot.joints[0], drive=drive, jerk=12.5)
    full = dataclasses.replace(robot, joints=(joint, *robot.joints[1:]))
    back = robot_from_plain(through_json(full))
    assert back.joints[0].drive.friction.stribeck_speed == 3.0
    assert back.joints[0].drive.friction.covariance == {"mu": {"mu": 1e-4}}
    same(robot_from_plain(through_json(back)), back)


@pytest.mark.parametrize(
    ("path", "value", "key"),
    [
        (("joints", 0, "velocity"), "fast", "robot.joints[0].velocity"),
        (("joints", 0, "velocity"), -1.0, "robot.joints[0].velocity"),
        (("joints", 0, "velocity"), None, "robot.joints[0].velocity"),
        (("joints", 2, "position"), [1.0], "robot.joints[2].position"),
        (("joints", 0, "kind"), "helical", "robot.joints[0].kind"),
        (
            ("joints", 0, "drive", "friction", "mu"),
            float("inf"),
            "robot.joints[0].drive.friction.mu",
        ),
        (("geometry", "omega1"), [1.0, 0.0], "robot.geometry.omega1"),
        (("geometry", "insertion_sign"), True, "robot.geometry.insertion_sign"),
        (("bodies", 1, "mass"), True, "robot.bodies[1].mass"),
        (("bodies",), [], "robot.bodies"),
        (("colour",), "red", "robot.colour"),
        (("gravity",), [[0.0, 0.0, "down"]], "robot.gravity"),
    ],
)
def test_a_fault_is_named_by_its_key(robot: Robot, path: tuple, value: object, key: str) -> None:
    data = through_json(robot)
    place = data
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    with pytest.raises(ProblemError) as caught:
        robot_from_plain(data, file="plan.json")
    assert caught.value.key == key
    assert "plan.json" in str(caught.value)


def test_a_missing_key_is_named(robot: Robot) -> None:
    data = through_json(robot)
    del data["joints"][3]["acceleration"]
    with pytest.raises(ProblemError, match=r"robot\.joints\[3\]\.acceleration: missing"):
        robot_from_plain(data)


def test_all_shipped_robots(tmp_path: Path) -> None:
    for file in sorted((ROOT / "problems/robots").glob("*.yaml")):
        robot = load_robot(file)
        same(robot, robot_from_plain(through_json(robot)))
