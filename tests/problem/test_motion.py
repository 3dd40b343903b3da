"""A problem has the same values whether it is written in Python, as a mapping or as text."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_problem, load_robot
from ssm_planner.problem.limits import TaskRange, TipSpeed
from ssm_planner.problem.motion import Dwell, Free, Joints, Scan, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.serialization import problem_from_plain, to_plain
from ssm_planner.units import deg, mm

TEXT = """\
robot: vitreoretinal
start: {roll: 0 deg, tilt: -85 deg, spin: 0 deg, depth: 0 mm}
motion:
  - tilt: {to: -135 deg}
  - dwell: 0.2 s
  - insert: {to: 20 mm}
limits: {tilt: [-139 deg, -81 deg], tip_speed: 25 mm/s}
"""
START = {"roll": "0 deg", "tilt": "-85 deg", "spin": "0 deg", "depth": "0 mm"}
DATA = {
    "robot": "vitreoretinal",
    "start": START,
    "motion": [{"tilt": {"to": "-135 deg"}}, {"dwell": "0.2 s"}, {"insert": {"to": "20 mm"}}],
    "limits": {"tilt": ["-139 deg", "-81 deg"], "tip_speed": "25 mm/s"},
}


def test_the_same_problem_in_python_as_text_and_as_a_mapping() -> None:
    output = Problem(
        load_robot("vitreoretinal"),
        start=Task(tilt=-85 * deg),
        motion=[Straight(tilt=-135 * deg), Dwell(0.2), Straight(depth=20 * mm)],  # type: ignore[arg-type]
        limits=[TaskRange("tilt", -139 * deg, -81 * deg), TipSpeed(25 * mm)],  # type: ignore[arg-type]
    )
    assert [motion.name for motion in output.motion] == ["tilt", "dwell", "insert"]
    assert isinstance(output.limits, tuple)
    assert to_plain(output.start)["task"] == pytest.approx(
        {"roll": 0, "tilt": math.radians(-85), "spin": 0, "depth": 0}
    )
    text, data = Problem.from_yaml(TEXT), Problem.from_dict(DATA)
    assert text == data
    for field in ("robot", "objective", "planner"):
        assert getattr(output, field) == getattr(data, field)
    assert [m.kind for m in output.motion] == [m.kind for m in data.motion]
    assert output.motion[2].to.depth == pytest.approx(data.motion[2].to.depth, rel=1e-15)
    assert output.tip_speed == pytest.approx(data.tip_speed)


def test_the_ranges_of_the_robot_hold_whatever_the_problem_says() -> None:
    problem = load_problem("tilt_insert")
    robots = problem.robot.ranges | {"depth": problem.robot.travel}
    assert dataclasses.replace(problem, limits=(TipSpeed(0.02),)).ranges == robots
    roll = TaskRange("roll", -0.5, 0.5)
    assert dataclasses.replace(problem, limits=(roll,)).ranges == robots | {"roll": (-0.5, 0.5)}
    low, high = robots["tilt"]
    wider = dataclasses.replace(
        problem, limits=(TaskRange("tilt", low - 1, high + 1), TaskRange("depth", -1.0, 1.0))
    )
    assert wider.ranges == robots
    assert dict(wider.excess_ranges) == {"tilt": (low - 1, high + 1), "depth": (-1.0, 1.0)}
    assert not problem.excess_ranges
    narrower = dataclasses.replace(problem, limits=(TaskRange("tilt", low + 0.01, high + 1),))
    assert narrower.ranges["tilt"] == (low + 0.01, high)
    assert dataclasses.replace(narrower) == narrower


def test_messages_name_the_key_or_the_line() -> None:
    with pytest.raises(ProblemError, match=r"^motion\[0\]\.tilt\.to = 5 mm: "):
        Problem.from_dict({**DATA, "motion": [{"tilt": {"to": "5 mm"}}]})
    with pytest.raises(
        ProblemError, match=r"^line 4: motion\[0\]\.tilt\.to = -200 deg: outside the limits of tilt"
    ):
        Problem.from_yaml(TEXT.replace("-135 deg", "-200 deg"))
    with pytest.raises(
        ProblemError, match=r"^planner = toppra: TOPP-RA does not support a duration"
    ):
        Problem.from_dict({**DATA, "planner": "toppra", "objective": "effort", "duration": "9 s"})
    with pytest.raises(ProblemError, match="a mapping"):
        Problem.from_yaml("- robot")


@pytest.mark.parametrize("name", ["tilt_insert", "laser_scan", "waypoints", "eye_approach"])
def test_every_motion_survives_plan_json(name: str) -> None:
    problem = load_problem(name)
    back = problem_from_plain(json.loads(json.dumps(to_plain(problem), allow_nan=False)))
    assert back == problem
    assert to_plain(back) == to_plain(problem)


def test_every_form_of_a_point_survives_plan_json() -> None:
    points = Joints((0.1, 0.2, 0.3, -0.01), line=3), Tip((0.001, 0.0, -0.01), 0.2), Task(tilt=-2.0)
    problem = dataclasses.replace(
        load_problem("tilt_insert"), start=points[0], motion=(Free(points[2], points[:2], 9.0),)
    )
    document = to_plain(problem)
    keys = {"task", "joints", "tip", "spin", "line"}
    assert set(document["start"]) == set(document["motion"][0]["target"]) == keys
    assert set(document["motion"][0]) == {
        "kind",
        "name",
        "target",
        "duration",
        "line",
        "through",
        "scan",
    }
    back = problem_from_plain(json.loads(json.dumps(document)))
    assert back == problem
    assert back.start.line == 3


def test_names_of_motions_by_default() -> None:
    assert Straight(roll=0.1).name == "roll"
    assert Straight(roll=0.1, depth=0.01).name == "straight"
    assert (
        Free(Task(tilt=-2.0)).name,
        Dwell(1).name,
        Scan(Task(tilt=-2.0), 1e-3, (1e-3,)).name,
    ) == (
        "free",
        "dwell",
        "scan",
    )
    assert math.isclose(180 * deg, math.pi)
