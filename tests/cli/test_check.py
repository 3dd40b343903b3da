"""`ssm-planner check` takes the robot and the limits from a plan, a problem or an option."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import TrajectoryError
from ssm_planner.loading.load import load_problem
from ssm_planner.problem.robot import Robot
from ssm_planner.verification.check import check
from tests.support.cli import run
from tests.support.paths import PROBLEMS
from tests.support.plans import smooth, write_plan

APPROACH, ROBOT = PROBLEMS / "eye_approach.yaml", PROBLEMS / "robots/vitreoretinal.yaml"
TASK_ONLY = {
    "roll rate",
    "tilt rate",
    "spin rate",
    "insertion speed",
    "retina clearance",
    "lens clearance",
}


@pytest.fixture
def csv(robot: Robot, tmp_path: Path) -> Path:
    trajectory = smooth(robot)
    s = trajectory.sample(np.linspace(0, trajectory.duration, 801))
    path = tmp_path / "t.csv"
    header = (
        "time_s,q1_rad,q2_rad,q3_rad,q4_m,qd1_rad_per_s,qd2_rad_per_s,qd3_rad_per_s,qd4_m_per_s"
    )
    np.savetxt(
        path,
        np.column_stack([s.t, s.q, s.qd]),
        fmt="%.15g",
        delimiter=",",
        header=header,
        comments="",
    )
    return path


def limits_of(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    return {limit["name"]: limit for limit in json.loads(capsys.readouterr().out)["limits"]}


def test_a_problem_brings_its_robot_and_its_limits(
    csv: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = load_problem(APPROACH)
    status = run("check", csv, "--problem", APPROACH, "--json")
    result = limits_of(capsys)
    assert set(result) >= TASK_ONLY
    exact = check(smooth(problem.robot), problem.robot, problem.task_limits)
    assert status == (0 if exact.passed else 1)
    for limit in exact.limits:
        if limit.name in TASK_ONLY:
            assert result[limit.name]["worst"] == pytest.approx(limit.worst, rel=1e-4)
            assert result[limit.name]["limit"] == limit.limit


def test_a_robot_alone_limits_no_task(csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("check", csv, "--robot", ROBOT, "--json") == 0
    assert not TASK_ONLY & set(limits_of(capsys))


def test_a_plan_brings_its_own_limits_unless_a_problem_is_given(
    robot: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = write_plan(
        tmp_path / "plan.json", robot, smooth(robot), load_problem(APPROACH).task_limits
    )
    run("check", plan, "--json")
    mine = limits_of(capsys)
    assert set(mine) >= TASK_ONLY
    run("check", plan, "--problem", PROBLEMS / "waypoints.yaml", "--json")
    assert not TASK_ONLY & set(limits_of(capsys))
    run("check", plan, "--tip-speed", "1 mm/s", "--json")
    other = limits_of(capsys)
    assert other["tip speed"]["limit"] == pytest.approx(1e-3)
    assert other["retina clearance"] == mine["retina clearance"]


def test_a_tip_in_the_retina_is_told_in_words(
    robot: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    deep = smooth(robot, (np.array([0.0, 0.0, 0.0, -0.025]),))
    plan = write_plan(tmp_path / "plan.json", robot, deep, load_problem(APPROACH).task_limits)
    assert run("check", plan) == 1
    line = next(
        line for line in capsys.readouterr().out.splitlines() if line.startswith("retina clearance")
    )
    assert "mm" in line
    assert "EXCEEDED" in line


def test_without_robot_or_problem_the_way_out_is_named(csv: Path) -> None:
    with pytest.raises(TrajectoryError, match=r"--robot ROBOT.yaml or --problem PROBLEM.yaml"):
        run("check", csv)
