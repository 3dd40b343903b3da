"""The kinematic commands and functions return the documented results for the shipped robot."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.cli import main
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.robot_kinematics import fk, ik
from ssm_planner.kinematics.task import pose_from_task
from ssm_planner.loading.load import load_robot
from ssm_planner.problem.robot import Robot
from tests.support.paths import ROOT

ROBOT = ROOT / "problems/robots/vitreoretinal.yaml"


Command = Callable[..., dict[str, Any]]


@pytest.fixture
def workspace(capsys: pytest.CaptureFixture[str]) -> Command:
    """Return a function that runs `workspace … --json` and returns the printed object."""

    def run(*words: str | Path) -> dict[str, Any]:
        assert main(["workspace", *map(str, words), "--json"]) in (0, 1)
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(ROBOT)


@pytest.mark.slow
def test_workspace_of_the_robot(workspace, tmp_path):
    result = workspace(ROBOT, "-o", tmp_path)
    assert math.degrees(result["alpha"]) == pytest.approx(30.0)
    assert math.degrees(result["beta"]) == pytest.approx(109.778393)
    assert np.degrees(result["tilt_range"]) == pytest.approx([-139.778393, -79.778393])
    assert sorted(extreme["tilt"] for extreme in result["extremes"]) == pytest.approx(
        result["tilt_range"], abs=1e-14
    )
    names = {"axes", "reachable_set", "theta2_against_tilt", "joint_speeds"}
    assert set(result["files"]) == names | {f"{name}_pdf" for name in names}
    for name, path in result["files"].items():
        assert Path(path).read_bytes().startswith(b"%PDF" if name.endswith("_pdf") else b"\x89PNG")


def test_reach_returns_the_published_design(workspace, tmp_path):
    result = workspace("--reach", "-140deg", "-80deg", "-o", tmp_path)
    assert np.degrees([result["alpha"], result["beta"]]) == pytest.approx([30.0, 110.0])
    assert np.degrees(result["region"]) == pytest.approx(
        np.array([[30, 110], [110, 30], [150, 70], [70, 150]])
    )
    assert Path(result["files"]["design_region"]).exists()
    with_robot = workspace(ROBOT, "--reach", "-80deg", "-140deg")
    assert math.degrees(with_robot["robot"]["margin"]) == pytest.approx(-0.221607, abs=1e-6)


def test_reach_of_the_impossible_is_an_answer(workspace):
    result = workspace("--reach", "-3.0rad", "-0.1rad", "--margin", "0.2rad")
    assert result == {"alpha": None, "beta": None, "region": [], "margin": 0.2, "reachable": False}


def test_workspace_needs_something_to_work_on(capsys):
    assert main(["workspace"]) == 2
    assert "needs a robot file, or a tilt range" in capsys.readouterr().err


def test_fk_of_ik_is_the_point_for_one_and_for_many(robot):
    point = {"roll": 0.1, "tilt": math.radians(-120.0), "spin": 0.3, "depth": 0.02}
    result = ik(robot, **point)
    many, one = fk(robot, result.joints), fk(robot, result.joints[0])
    assert (many.rotation.shape, many.position.shape, many.task.shape) == (
        (2, 3, 3),
        (2, 3),
        (2, 4),
    )
    assert (one.rotation.shape, one.position.shape, one.task.shape) == ((3, 3), (3,), (4,))
    assert np.abs(many.task - list(point.values())).max() < 1e-12
    assert np.linalg.norm(one.position) == pytest.approx(point["depth"], abs=1e-15)


def test_ik_returns_branches_that_reach(robot):
    target = {"roll": 0.1, "tilt": math.radians(-120.0), "spin": 0.3, "depth": 0.02}
    result = ik(robot, **target).to_dict()
    assert json.loads(json.dumps(result)) == result
    assert result["reachable"]
    assert result["error"] == {"orientation": 0.0, "tip": 0.0}
    assert len(result["branches"]) == 2
    mech = Mechanism.from_geometry(robot.geometry)
    expected = pose_from_task(mech, [[*target.values()]])
    for reached, pose in zip(forward(mech, result["branches"]), expected, strict=True):
        assert np.abs(reached - pose).max() < 1e-12


def test_ik_within_limits_drops_what_is_outside(robot):
    target = {"roll": 0.1, "tilt": math.radians(-120.0), "spin": 0.3, "depth": 0.2}
    assert ik(robot, **target).to_dict()["in_limits"] == [False, False]
    assert ik(robot, **target, within_limits=True).to_dict()["branches"] == []


def test_ik_outside_the_workspace_says_by_how_much(robot):
    result = ik(robot, roll=0.1, tilt=math.radians(-145.0), depth=0.02).to_dict()
    excess = math.radians(145.0 - 139.77839335)
    assert not result["reachable"]
    assert len(result["branches"]) == 1  # The branches meet at the boundary.
    assert result["error"] == pytest.approx(
        {"orientation": excess, "tip": 0.02 * math.sin(excess)}, abs=1e-9
    )
    assert result["boundary_distance"] == pytest.approx(-excess, abs=1e-9)


def test_ik_in_degrees_is_refused(robot):
    with pytest.raises(GeometryError, match="degrees"):
        ik(robot, roll=0.1, tilt=-120.0).to_dict()
