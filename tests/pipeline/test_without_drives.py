"""Verify plans, result folders, sizing and reports for robots that lack drives, motors or both."""

from __future__ import annotations

from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from ssm_planner.cli import main
from ssm_planner.pipeline.run import plan, plan_to_folder
from ssm_planner.problem.motion import Dwell, Free, Motion, Straight, Task
from ssm_planner.problem.problem import Planner, Problem

SHORT = Straight(tilt=-1.6, name="tilt")
BOTH = ("drive", "motor")
JOINTS = (0, 1, 2, 3)
LACKING: dict[str, dict[int, tuple[str, ...]]] = {
    "drives": dict.fromkeys(JOINTS, ("drive",)),
    "motors": dict.fromkeys(JOINTS, ("motor",)),
    "both": dict.fromkeys(JOINTS, BOTH),
    "the tilt's": {1: BOTH},
    "all but the tilt's": dict.fromkeys((0, 2, 3), BOTH),
    "a motor here, a drive there": {0: ("motor",), 1: ("drive",)},
}
"""Each case names the parts that are missing at each joint."""
OBJECTIVES: dict[str, dict[str, Any]] = {
    "time": {"objective": "time"},
    "time then heat": {"objective": "time then heat"},
    "effort": {"objective": "effort", "duration": 2.0},
    "duration": {"objective": "time then heat", "duration": 2.0},
}


def _lacking(
    problem: Problem, parts: dict[int, tuple[str, ...]], motion: Motion = SHORT, **changes: Any
) -> Problem:
    """Return the problem with one motion and without the given parts of each joint."""
    joints = tuple(
        replace(joint, **dict.fromkeys(parts.get(i, ())), alternatives=())
        for i, joint in enumerate(problem.robot.joints)
    )
    robot = replace(problem.robot, joints=joints)
    return replace(problem, robot=robot, motion=(motion,), **{"objective": "time"} | changes)


@pytest.mark.parametrize("parts", [BOTH, ("drive",), ("motor",)])
@pytest.mark.slow
def test_a_result_folder_is_written_whatever_the_robot_has(
    tilt_insert: Problem, tmp_path: Path, parts: tuple[str, ...]
) -> None:
    outcome, files = plan_to_folder(_lacking(tilt_insert, dict.fromkeys(JOINTS, parts)), tmp_path)
    assert outcome.passed
    assert {path.name for path in files.values()} | {"manifest.json"} == {
        path.name for path in tmp_path.iterdir()
    }
    assert (tmp_path / "motors.png").exists() == ("drive" not in parts)
    named = {
        joint.motor.name
        for joint in outcome.robot.joints
        if joint.motor is not None and joint.drive is None
    }
    for name in named:
        assert any(f"its motor {name} is ignored" in note for note in outcome.notes)


@pytest.mark.slow
def test_without_drives_sizing_knows_nothing(
    tilt_insert: Problem, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without drives, the command size reports that no joint has a drive."""
    _, files = plan_to_folder(_lacking(tilt_insert, LACKING["both"]), tmp_path / "plan")
    assert main(["size", str(files["plan"]), "-o", str(tmp_path / "size")]) == 0
    out = capsys.readouterr().out
    assert "no joint has a drive" in out
    assert "suffice: yes" not in out
    assert {path.name for path in (tmp_path / "size").iterdir()} == {"sizing.json", "sizing.html"}
    assert main(["report", str(files["plan"]), "--figures", str(tmp_path / "figures")]) == 0


SAMPLE = [
    (lacking, objective, planner)
    for (lacking, objective), planner in zip(
        ((lacking, objective) for lacking in LACKING for objective in OBJECTIVES),
        cycle(get_args(Planner)[:3]),
        strict=False,
    )
]


@pytest.mark.parametrize(("lacking", "objective", "planner"), SAMPLE)
def test_any_objective_has_a_plan(
    tilt_insert: Problem, lacking: str, objective: str, planner: Planner
) -> None:
    """Every objective has a plan even if drives or motors are missing."""
    changes = OBJECTIVES[objective]
    outcome = plan(_lacking(tilt_insert, LACKING[lacking], planner=planner, **changes))
    assert outcome.passed
    if "duration" in changes:
        assert outcome.duration == pytest.approx(changes["duration"], rel=1e-9)


@pytest.mark.parametrize("lacking", ["both", "drives", "motors"])
@pytest.mark.parametrize("planner", ["fast", "ipopt"])
def test_without_motors_there_is_no_heat_to_make_less(
    tilt_insert: Problem, lacking: str, planner: Planner
) -> None:
    """Without motors, the motion with the least heat has the bits of the fastest motion."""
    problem = _lacking(tilt_insert, LACKING[lacking], planner=planner)
    fastest, coolest = plan(problem), plan(replace(problem, objective="time then heat"))
    assert fastest.passed
    assert coolest.trajectory is not None
    assert fastest.trajectory is not None
    assert np.array_equal(fastest.trajectory.coefficients, coolest.trajectory.coefficients)


@pytest.mark.parametrize("lacking", ["both", "all but the tilt's"])
@pytest.mark.parametrize("planner", ["optimal", "fast", "ipopt"])
@pytest.mark.parametrize(
    "motion", [Straight(spin=1.0, name="spin"), Free(Task(spin=1.0))], ids=["straight", "free"]
)
def test_a_joint_without_motor_accelerates_least(
    tilt_insert: Problem, lacking: str, planner: Planner, motion: Motion
) -> None:
    """From rest to rest over Δ in the time T, the cubic q(t) has the least ∫ q̈² dt.

    This least value is 12 Δ² / T³.
    """
    problem = _lacking(
        tilt_insert,
        LACKING[lacking],
        motion,
        objective="effort",
        duration=3.0,
        planner=planner,
    )
    outcome = plan(problem)
    assert outcome.passed
    assert outcome.trajectory is not None
    times = np.linspace(0.0, 3.0, 3001)
    acceleration = outcome.trajectory.sample(times).qdd[:, 2]
    assert np.trapezoid(acceleration**2, times) == pytest.approx(12 / 3.0**3, rel=1e-4)


@pytest.mark.parametrize("motion", [SHORT, Dwell(0.5)], ids=["straight", "dwell"])
def test_jerk_limits_need_no_drive(tilt_insert: Problem, motion: Motion) -> None:
    problem = _lacking(
        tilt_insert, LACKING["both"], motion, objective="time then heat", planner="fast"
    )
    joints = tuple(
        replace(joint, jerk=1.0 if joint.name == "insertion" else 35.0)
        for joint in problem.robot.joints
    )
    assert plan(replace(problem, robot=replace(problem.robot, joints=joints))).passed
