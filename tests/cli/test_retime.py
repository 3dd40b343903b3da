"""`retime` follows the path of a given motion along the same curve.

The new motion is never slower than a given motion that kept the limits.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.cli import main
from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.formats.export import export
from ssm_planner.pipeline.retime import retime
from ssm_planner.planning.retiming.paths import split_at_corners
from ssm_planner.plans import load_plan
from ssm_planner.problem.motion import Follow, Joints
from ssm_planner.problem.problem import Problem
from ssm_planner.trajectory import Trajectory
from tests.support.cases import selected
from tests.support.paths import PROBLEMS, RESULTS

ROBOT = PROBLEMS / "robots/vitreoretinal.yaml"


def retimed(path: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    capsys.readouterr()
    assert main(["retime", str(path), "--robot", str(ROBOT), "-o", str(out), "--json"]) == 0
    result: dict[str, object] = json.loads(capsys.readouterr().out)
    return result


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "rate", "speed"),
    [
        ("csv", 1000, 0.2),
        *selected([], every=[("csv", 250, 0.2)]),
        ("csv", 100, 0.2),
        ("ros2", 500, 0.5),
    ],
)
def test_a_slowed_export_is_as_fast_again(
    tilt_insert: Problem, tmp_path: Path, kind: str, rate: float, speed: float
) -> None:
    """A slowed export regains its original duration for each rate and format of the file."""
    original = load_plan(RESULTS / "tilt_insert")
    export(original, kind, tmp_path, speed=speed, rate=rate)
    again = retime(tmp_path / ("bag" if kind == "ros2" else "trajectory.csv"), tilt_insert.robot)
    assert again.passed
    # The shipped plan is up to 0.1 % longer, because it produces less heat.
    assert again.duration == pytest.approx(original.duration, rel=3e-3)
    assert len(again.phases) == 2
    # Every point of the new motion must lie on the old path.
    old = original.motion.sample(np.linspace(0.0, original.duration, 20_000)).q
    new = again.motion.sample(np.linspace(0.0, again.duration, 50)).q
    scale = [joint.velocity for joint in original.robot.joints]
    distance = np.linalg.norm((new[:, None] - old) / scale, axis=2).min(axis=1)
    assert distance.max() < 1e-3


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_the_command_writes_the_plan_that_it_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    export(RESULTS / "tilt_insert", "csv", tmp_path / "csv", rate=100.0)
    result = retimed(tmp_path / "csv/trajectory.csv", tmp_path / "out", capsys)
    assert result["passed"]
    assert result["runs"] == 2
    again = load_plan(tmp_path / "out")
    assert again.passed
    assert result["duration"] == again.duration
    stored = json.loads((tmp_path / "out/plan.json").read_text(encoding="utf-8"))
    assert again.to_dict()["problem"] == stored["problem"]


def test_points_alone_are_a_curve_with_rests_at_its_corners(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    angle = np.linspace(0, np.pi, 40)
    curve = np.column_stack(
        [0.2 * np.sin(angle), 0.6 + 0.1 * np.cos(angle), 0 * angle, -0.01 + 0.003 * np.sin(angle)]
    )
    points = np.concatenate(
        [curve, curve[-1] + np.linspace(0, 1, 10)[1:, None] * [0.2, 0.0, 0.3, 0.0]]
    )
    rows = np.column_stack([np.arange(len(points)) * 1.0, points])
    np.savetxt(
        tmp_path / "points.csv",
        rows,
        delimiter=",",
        comments="",
        header="time_s,q1_rad,q2_rad,q3_rad,q4_m",
        fmt="%.12f",
    )
    result = retimed(tmp_path / "points.csv", tmp_path / "out", capsys)
    assert result["passed"]
    assert result["runs"] == 2
    assert max(result["off_lines"][:3]) < 2e-3
    assert result["duration"] < 3


def test_paths_are_cut_at_corners_and_reversals_alone() -> None:
    angle = np.linspace(0, 2 * np.pi, 100)
    circle = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle])
    assert len(split_at_corners(circle, np.ones(4))) == 1
    there_and_back = np.concatenate([circle, circle[-2::-1]])
    assert [len(run) for run in split_at_corners(there_and_back, np.ones(4))] == [100, 100]
    assert [
        len(run) for run in split_at_corners(np.repeat(there_and_back, 3, axis=0), np.ones(4))
    ] == [
        100,
        100,
    ]
    assert split_at_corners(np.ones((5, 4)), np.ones(4)) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "pass either a robot or a problem"),
        (["--robot", str(ROBOT)], "has length zero"),
        (["--robot", str(ROBOT), "--problem", "tilt_insert"], "pass either a robot or a problem"),
    ],
)
def test_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    (tmp_path / "still.csv").write_text(
        "time_s,q1_rad,q2_rad,q3_rad,q4_m\n0,0,0.5,0,-0.01\n1,0,0.5,0,-0.01\n", encoding="utf-8"
    )
    assert main(["retime", str(tmp_path / "still.csv"), *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_path_takes_neither_jerk_limits_nor_durations(tilt_insert: Problem) -> None:
    path = Follow(Joints((0.0, 0.5, 0.0, -0.01)), curve="samples")
    with pytest.raises(
        ProblemError, match="only TOPP-RA can time it, and does not support a duration"
    ):
        replace(tilt_insert, motion=(path,), duration=5.0)
    joints = tuple(replace(joint, jerk=100.0) for joint in tilt_insert.robot.joints)
    with pytest.raises(ProblemError, match="does not support a jerk limit of joint roll"):
        replace(tilt_insert, motion=(path,), robot=replace(tilt_insert.robot, joints=joints))


def test_arrays_are_retimed_like_a_file(tmp_path: Path) -> None:
    """An array of points, a trajectory and a file with the same path give the same duration."""
    t = np.linspace(0.0, 2.0, 21)
    q = np.array([-0.9, 1.1, 0.3, 0.0]) + np.outer(t**2 * (3 - t), [0.1, -0.2, 0.05, -0.001])
    table = tmp_path / "path.csv"
    rows = np.column_stack([t, q])
    np.savetxt(table, rows, delimiter=",", header="time_s,q1_rad,q2_rad,q3_rad,q4_m", comments="")
    plans = [retime(path, ROBOT) for path in (q, table)]
    smooth = retime(Trajectory.from_samples(t, q), ROBOT)
    assert all(one.passed for one in (*plans, smooth))
    assert plans[0].duration == pytest.approx(plans[1].duration, rel=1e-9)
    assert smooth.duration == pytest.approx(plans[0].duration, rel=1e-3)


@pytest.mark.parametrize(
    "path",
    [np.zeros((3, 4)), np.zeros((3, 3)), np.full((2, 4), np.nan), [[0] * 4, [1] * 3], [["a"] * 4]],
)
def test_an_array_that_is_no_path_is_refused(path: np.ndarray) -> None:
    with pytest.raises(SsmPlannerError, match="path"):
        retime(path, ROBOT)
