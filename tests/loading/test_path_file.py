"""Curves of a motion list are tables of points, lines, arcs and splines. Each mistake in them leads
to one message that names the file and the line.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_problem
from ssm_planner.problem.motion import Follow, Joints, Task, Tip
from ssm_planner.problem.serialization import problem_from_plain, to_plain

PROBLEM = """robot: vitreoretinal
start: {roll: 0 deg, tilt: -95 deg, spin: 0 deg, depth: 5 mm}
motion:
"""
TABLE = "tilt [deg], depth_mm\n-95, 5\n-96, 6\n-97, 7\n"
D = math.radians


def problem(folder: Path, table: str = TABLE, entries: str = "  - path: p.csv\n") -> Any:
    """Write a table and a problem that refers to it, and load the problem."""
    (folder / "p.csv").write_text(table, encoding="utf-8")
    (folder / "problem.yaml").write_text(PROBLEM + entries, encoding="utf-8")
    return load_problem(folder / "problem.yaml")


def test_forms_of_a_table(tmp_path: Path) -> None:
    """A table may contain coordinates of the task, joints or tips."""
    (path,) = problem(tmp_path).motion
    assert (path.kind, path.curve, path.name, path.line) == ("path", "samples", "path", 4)
    assert [point.line for point in (*path.through, path.to)] == [2, 3, 4]
    assert path.to.set_coordinates == pytest.approx({"tilt": D(-97), "depth": 0.007})
    joints = "time_s,q1_rad,q2_rad,q3_rad,q4_m,qd1_rad_per_s,motor1_torque_Nm\n0,0,0.5,0,-5e-3,1,1\n1,0,0.6,0,-6e-3,1,1\n"
    assert problem(tmp_path, joints).motion[0].to.values == pytest.approx((0, 0.6, 0, -0.006))
    tips = "tip_x_m,tip_y_m,tip_z_m,spin (deg)\n0,0,-0.005,0\n0.001,0,-0.005,90\n"
    to = problem(tmp_path, tips).motion[0].to
    assert (to.position, to.spin) == (pytest.approx((0.001, 0, -0.005)), pytest.approx(D(90)))


@pytest.mark.parametrize(
    ("table", "place", "message"),
    [
        ("tlit [deg]\n-95\n-96\n", ":1: tlit [deg]: ", "unknown coordinate"),
        ("tilt\n-95\n-96\n", ":1: tilt: ", "no unit (allowed: rad, mrad, deg"),
        ("tilt [mm]\n-95\n-96\n", ":1: tilt [mm]: ", "unknown unit 'mm'"),
        ("tilt [deg], tilt_rad\n-95,1\n", ":1: tilt_rad: ", "tilt occurs twice"),
        ("q1 [deg]\n0\n1\n", ":1: ", "missing column q2, q3, q4"),
        ("x_mm,y_mm,z_mm\n0,0,-5\n1,0,-5\n", ":1: ", "missing column spin"),
        (
            "x_mm,y_mm,z_mm,spin_deg,roll_deg\n0,0,-5,0,0\n",
            ":1: roll: ",
            "redundant: the tip determines it",
        ),
        ("time_s\n0\n1\n", ":1: ", "no coordinates"),
        ("tilt [deg]\n-95\nfast\n", ":3: column tilt = fast: ", "not a finite number"),
        ("tilt [deg],depth_mm\n-95,5\n-96\n", ":3: ", "1 cells (allowed: 2 as in the headings"),
        ("tilt [deg],depth_mm\n-95,5\n-96,\n", ":3: column depth: ", "no value"),
        ("tilt [deg],depth_mm\n-95,5,5\n-96,0,5\n", ":2: ", "commas separate the columns"),
        ("tilt [deg]\n-95\n-96\n-150\n", ":4: column tilt = ", "outside the limits of tilt"),
        ("tilt [deg]\n-95\n-150\n-96\n", ":3: column tilt = ", "outside the limits of tilt"),
        (
            "q1_deg,q2_deg,q3_deg,q4_mm\n0,30,0,-5\n0,30,0,5\n",
            ":3: column q4 = ",
            "outside the position limits",
        ),
        (
            "x_mm,y_mm,z_mm,spin_deg\n0,0,-5,0\n0,0,-500,0\n",
            ":3: column x, y, z = ",
            "outside the limits of depth",
        ),
        ("tilt [deg]\n-95\n", ": ", "a path needs more than one point (allowed: at least two)"),
        ("", ":1: ", "the file is empty"),
    ],
)
def test_mistakes_in_a_table(tmp_path: Path, table: str, place: str, message: str) -> None:
    with pytest.raises(ProblemError) as caught:
        problem(
            tmp_path,
            table,
            "  - tilt: {to: -94 deg}\n  - path: p.csv\nlimits: {tilt: [-139 deg, -81 deg]}\n",
        )
    assert str(caught.value).startswith(f"{tmp_path / 'p.csv'}{place}"), caught.value
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("path: none.csv", ":4: motion[0].path = none.csv: the file"),
        ("path: {through: 1}", "instead of text"),
        (
            "line: {to: {tilt: -96 deg}, through: [{tilt: -95 deg}]}",
            "motion[0].line.blend: missing",
        ),
        ("arc: {to: {tilt: -96 deg}}", "motion[0].arc.through: missing"),
        ("arc: {to: {tilt: -96 deg}, through: {tilt: -150 deg}}", "motion[0].arc.through.tilt"),
        (
            "spline: {to: {tilt: -96 deg}, through: [{tilt: -95 deg}, {tilt: -150 deg}]}",
            "motion[0].spline.through[1].tilt",
        ),
    ],
)
def test_mistakes_in_the_problem(tmp_path: Path, entry: str, message: str) -> None:
    with pytest.raises(ProblemError) as caught:
        problem(tmp_path, entries=f"  - {entry}\nlimits: {{tilt: [-139 deg, -81 deg]}}\n")
    assert message in str(caught.value)


def test_curves_are_kept_in_a_plan_and_included(tmp_path: Path) -> None:
    entries = """  - path: p.csv
  - line: {to: {tip: [1 mm, 2 mm, -10 mm], spin: 5 deg}}
  - arc: {through: {tilt: -100 deg, depth: 9 mm}, to: there}
  - spline: {through: [there], to: {joints: [0 deg, 10 deg, 20 deg, -5 mm]}}
points: {there: {tilt: -105 deg}}
"""
    result = problem(tmp_path, entries=entries)
    assert [(entry.name, entry.curve) for entry in result.motion] == [
        ("path", "samples"), ("line", "line"), ("arc", "arc"), ("spline", "spline")]  # fmt: skip
    assert [type(entry.to) for entry in result.motion] == [Task, Tip, Task, Joints]
    again = problem_from_plain(to_plain(result))
    assert again == result
    assert again.motion[0].file == result.motion[0].file
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "other.yaml").write_text(
        PROBLEM + "  - include: ../problem.yaml\n", encoding="utf-8"
    )
    assert load_problem(tmp_path / "below" / "other.yaml").motion[0] == result.motion[0]


def test_curves_in_python() -> None:
    with pytest.raises(ProblemError, match="not allowed for curve"):
        Follow(Task(tilt=-1.7), curve="arc")
    with pytest.raises(ProblemError, match="the point is empty"):
        Follow(Task())
