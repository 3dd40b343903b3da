"""A robot without drives, or with motors that nothing connects: planned, drawn and sized, and said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ssm_planner.cli import main
from ssm_planner.pipeline.run import plan_to_folder
from ssm_planner.problem.motion import Straight
from ssm_planner.problem.problem import Problem


def _without(problem: Problem, *parts: str) -> Problem:
    joints = tuple(
        replace(joint, **dict.fromkeys(parts), alternatives=()) for joint in problem.robot.joints
    )
    short = (Straight(tilt=-1.6, name="tilt"),)
    return replace(
        problem, robot=replace(problem.robot, joints=joints), motion=short, objective="time"
    )


@pytest.mark.parametrize("parts", [("drive", "motor"), ("drive",), ("motor",)])
def test_a_result_folder_is_written_whatever_the_robot_has(
    tilt_insert: Problem, tmp_path: Path, parts: tuple[str, ...]
) -> None:
    plan, files = plan_to_folder(_without(tilt_insert, *parts), tmp_path)
    assert plan.passed
    assert {path.name for path in files.values()} | {"manifest.json"} == {
        path.name for path in tmp_path.iterdir()
    }
    assert (tmp_path / "motors.png").exists() == ("drive" not in parts)
    named = {
        joint.motor.name
        for joint in plan.robot.joints
        if joint.motor is not None and joint.drive is None
    }
    for name in named:
        assert any(f"its motor {name} counts for nothing" in note for note in plan.notes)


def test_without_drives_sizing_knows_nothing(
    tilt_insert: Problem, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, files = plan_to_folder(_without(tilt_insert, "drive", "motor"), tmp_path / "plan")
    assert main(["size", str(files["plan"]), "-o", str(tmp_path / "size")]) == 0
    out = capsys.readouterr().out
    assert "no joint has a drive" in out
    assert "yes (motors" not in out
    assert {path.name for path in (tmp_path / "size").iterdir()} == {"sizing.json"}
    assert main(["report", str(files["plan"]), "--figures", str(tmp_path / "figures")]) == 0
