"""Problem files: start, motion list and limits are read, and each mistake leads to a message that
names the line and the key.
"""

from __future__ import annotations

import math
from typing import Any

import pytest

NAME = "tilt_insert.yaml"
START = "start: {roll: 0 deg, tilt: -85 deg, spin: 0 deg, depth: 0 mm}"
TILT = (
    "  - tilt:   {to: -135 deg}     # straight in task space; the other coordinates do not change"
)
LIMIT = "  tilt: [-139 deg, -81 deg]"
D = math.radians


def test_shipped(files: Any) -> None:
    """The values of the shipped problem are read in SI units."""
    problem = files.load(NAME)
    assert problem.name == "tilt_insert"
    assert problem.objective == "time"
    assert problem.tip_speed is None
    assert problem.start.set_coordinates == pytest.approx(
        {"roll": 0, "tilt": D(-85), "spin": 0, "depth": 0}
    )
    tilt, insert = problem.motion
    assert (tilt.kind, tilt.name, tilt.line) == ("straight", "tilt", 5)
    assert tilt.to.set_coordinates == pytest.approx({"tilt": D(-135)})
    assert (insert.kind, insert.name) == ("straight", "insert")
    assert insert.to.set_coordinates == pytest.approx({"depth": 0.02})
    assert problem.ranges["tilt"] == pytest.approx((D(-139), D(-81)))
    assert problem.ranges["roll"] == pytest.approx((D(-30), D(30)))
    assert problem.ranges["depth"] == pytest.approx((0, 0.03))


def test_every_form_of_motion(files: Any) -> None:
    motion = """
  - straight: {to: {roll: 10 deg, depth: 5 mm}}
  - free: {to: {roll: 10 deg, tilt: -120 deg, depth: 15 mm}}
  - free: {to: {joints: [0 deg, 10 deg, 20 deg, -5 mm]}}
  - free: {to: {tip: [1 mm, 2 mm, -10 mm], spin: 5 deg}}
  - dwell: 0.2 s
  - spin: {to: 90 deg}
  - roll: {to: -5 deg}"""
    files.edit(NAME, TILT, motion)
    files.edit(NAME, LIMIT, LIMIT + "\n  tip_speed: 25 mm/s")
    problem = files.load(NAME)
    kinds = [(m.kind, m.name) for m in problem.motion]
    assert kinds == [
        ("straight", "straight"),
        ("free", "free"),
        ("free", "free"),
        ("free", "free"),
        ("dwell", "dwell"),
        ("straight", "spin"),
        ("straight", "roll"),
        ("straight", "insert"),
    ]
    assert problem.motion[2].to.values == pytest.approx((0, D(10), D(20), -0.005))
    assert problem.motion[3].to.position == pytest.approx((0.001, 0.002, -0.01))
    assert problem.motion[3].to.spin == pytest.approx(D(5))
    assert problem.motion[4].duration == pytest.approx(0.2)
    assert problem.tip_speed == pytest.approx(0.025)
    lines = (files.root / NAME).read_text(encoding="utf-8").splitlines()
    for entry in problem.motion:
        assert entry.name in lines[entry.line - 1]


def test_start_by_joints_or_tip(files: Any) -> None:
    files.edit(NAME, START, "start: {joints: [0 deg, 1 deg, 2 deg, 0 mm]}")
    assert files.load(NAME).start.values == pytest.approx((0, D(1), D(2), 0))
    files.edit(
        NAME, "{joints: [0 deg, 1 deg, 2 deg, 0 mm]}", "{tip: [0 mm, 0 mm, -5 mm], spin: 0 deg}"
    )
    assert files.load(NAME).start.position == pytest.approx((0, 0, -0.005))


def test_limits_narrow_those_of_the_robot(files: Any) -> None:
    files.edit(NAME, LIMIT, "  tilt: [-200 deg, -84 deg]")
    assert files.load(NAME).ranges["tilt"] == pytest.approx((D(-139), D(-84)))
    files.edit(NAME, "  depth: [0 mm, 30 mm]", "  depth: [-10 mm, 100 mm]")
    assert files.load(NAME).ranges["depth"] == pytest.approx((0, 0.03))


def test_limits_of_the_robot_hold_without_those_of_the_problem(files: Any) -> None:
    files.edit(NAME, LIMIT + "\n", "")
    message = files.rejection(NAME, "-135 deg", "-139.5 deg")
    assert "-139 deg to -81 deg" in message


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        (
            "robots/vitreoretinal.yaml",
            "robots/missing.yaml",
            ("robot = robots/missing.yaml", "does not exist"),
        ),
        (
            "robot: robots/vitreoretinal.yaml",
            "robto: robots/vitreoretinal.yaml",
            ("robto", "did you mean 'robot'?"),
        ),
        ("objective: time", "objective: energy", ("objective = energy", "'time'")),
        (
            "objective: time",
            "objective: time\nname: ''",
            ("name", "a text of at least one character"),
        ),
        (
            START,
            "start: {roll: 0 deg, tilt: -85 deg, depth: 0 mm}",
            ("start.spin", "missing", "roll, tilt, spin, depth"),
        ),
        (START, "start: {}", ("start", "the point is empty", "joints")),
        (START, "start: here", ("start = here", "unknown name of a point")),
        (START, "start:", ("start", "empty value")),
        (
            START,
            START.replace("-85", "-80"),
            ("start.tilt = -80 deg", "outside the limits", "-139 deg to -81 deg"),
        ),
        (START, START.replace("-85 deg", "-85"), ("start.tilt = -85", "without a unit")),
        (START, START.replace("0 mm", "0 deg"), ("start.depth = 0 deg", "an angle, not a length")),
        (START, "start: {joints: [0 deg]}", ("start.joints = [0 deg]", "1 values", "4 values")),
        (
            START,
            "start: {joints: [0 deg, 0 deg, 0 deg, 0 mm], tilt: -85 deg}",
            ("start.tilt", "redundant: joints"),
        ),
        (START, "start: {joints: [0 deg, 0 deg, 0 deg, 0 deg]}", ("an angle, not a length",)),
        (
            START,
            "start: {joints: [0 deg, 181 deg, 0 deg, 0 mm]}",
            ("start.joints[1] = 181 deg", "-180 deg to 180 deg"),
        ),
        (
            START,
            "start: {joints: [0 deg, 0 deg, 0 deg, 1 mm]}",
            ("joints[3] = 1 mm", "-30 mm to 0 mm"),
        ),
        (START, "start: {tip: [0 mm, 0 mm, -5 mm]}", ("start.spin", "missing")),
        (
            START,
            "start: {tip: [0 mm, 0 mm, 0 mm], spin: 0 deg}",
            ("remote centre leaves roll and tilt open",),
        ),
        (
            START,
            "start: {tip: [0 mm, 0 mm, -31 mm], spin: 0 deg}",
            ("31 mm from the remote centre", "0 mm to 30 mm"),
        ),
        (
            START,
            "start: {tip: [0 mm, 0 mm, -5 mm], tilt: -90 deg, spin: 0 deg}",
            ("start.tilt", "redundant: tip"),
        ),
        (
            TILT,
            "  - tilt: {to: -140 deg}",
            ("motion[0].tilt.to = -140 deg", "outside the limits", "-139 deg to -81 deg"),
        ),
        (TILT, "  - tilt: {to: -110 rad}", ("motion[0].tilt.to = -110 rad", "did you mean deg?")),
        (TILT, "  - tilt: {to: 20 mm}", ("a length, not an angle",)),
        (TILT, "  - tilt: {too: -135 deg}", ("motion[0].tilt.too", "did you mean 'to'?")),
        (
            TILT,
            "  - tilt: -135 deg",
            ("motion[0].tilt = -135 deg", "instead of a mapping", "to"),
        ),
        (TILT, "  - tillt: {to: -135 deg}", ("motion[0].tillt", "did you mean 'tilt'?")),
        (
            TILT,
            "  - {tilt: {to: -135 deg}, roll: {to: 0 deg}}",
            ("motion[0]", "2 motions in one entry (tilt, roll)"),
        ),
        (TILT, "  - {}", ("motion[0]", "the entry has no motion")),
        (TILT, "  - dwell", ("motion[0] = dwell", "a text instead of a mapping")),
        (TILT, "  - dwell: 0 s", ("motion[0].dwell = 0 s", "not greater than zero")),
        (TILT, "  - dwell: -1 s", ("motion[0].dwell = -1 s", "not greater than zero")),
        (TILT, "  - dwell: 1", ("motion[0].dwell = 1", "a time such as 0.2 s")),
        (TILT, "  - roll: {to: 31 deg}", ("motion[0].roll.to = 31 deg", "-30 deg to 30 deg")),
        (
            TILT,
            "  - insert: {to: 31 mm}",
            ("motion[0].insert.to = 31 mm", "limits of depth", "0 mm to 30 mm"),
        ),
        (TILT, "  - insert: {to: 20}", ("motion[0].insert.to = 20", "a length such as 20 mm")),
        (TILT, "  - straight: {to: {}}", ("motion[0].straight.to", "the point is empty")),
        (
            TILT,
            "  - straight: {to: {joints: [0 deg, 0 deg, 0 deg, 0 mm]}}",
            ("straight.to.joints", "unknown key"),
        ),
        (
            TILT,
            "  - free: {to: {depth: 40 mm}}",
            ("motion[0].free.to.depth = 40 mm", "0 mm to 30 mm"),
        ),
        (
            TILT,
            "  - free: {to: {tip: [1 mm, 2 mm], spin: 0 deg}}",
            ("motion[0].free.to.tip", "2 values", "3 values"),
        ),
        (
            LIMIT,
            "  tilt: [-80 deg, -70 deg]",
            ("limits.tilt = [-80 deg, -70 deg]", "no overlap", "-139 deg to -81"),
        ),
        (LIMIT, "  tilt: [-81 deg, -139 deg]", ("limits.tilt", "not below")),
        (LIMIT, "  tilt: -81 deg", ("limits.tilt = -81 deg", "2 values")),
        (LIMIT, "  tip_speed: 0 mm/s", ("limits.tip_speed = 0 mm/s", "not greater than zero")),
        (LIMIT, "  tip_speed: 25 deg/s", ("limits.tip_speed", "a speed such as 20 mm/s")),
        (
            LIMIT,
            "  insertion: [0 mm, 30 mm]",
            (
                "limits.insertion",
                "unknown key",
                "roll, tilt, spin, depth, tip_speed, stop_travel, roll_rate",
            ),
        ),
    ],
)
def test_bad_problems(files: Any, old: str, new: str, parts: tuple[str, ...]) -> None:
    place = "name: ''" if "name: ''" in new else None
    message = files.rejection(NAME, old, new, place)
    for part in parts:
        assert part in message
    assert "Traceback" not in message
    assert "pydantic" not in message


def test_empty_motion_list(files: Any) -> None:
    files.edit(NAME, TILT + "\n", "")
    message = files.rejection(NAME, "motion:\n  - insert: {to: 20 mm}\n", "motion: []\n")
    assert "motion: no entries (allowed: at least 1)" in message


def test_motion_is_not_a_list(files: Any) -> None:
    files.edit(NAME, TILT + "\n", "")
    message = files.rejection(
        NAME, "motion:\n  - insert: {to: 20 mm}\n", "motion: {insert: {to: 20 mm}}\n"
    )
    assert "motion: not a list" in message


def test_too_many_motions(files: Any) -> None:
    message = files.rejection(NAME, TILT, "  - dwell: 1 ms\n" * 10_000 + TILT, at="motion:")
    assert "allowed: at most 10000" in message


def test_several_faults_come_in_the_order_of_the_file(files: Any) -> None:
    files.edit(NAME, LIMIT, "  tilt: [-139, -81]")
    files.edit(NAME, TILT, "  - tilt: {to: 5}\n" * 12)
    message = files.rejection(NAME, START, START.replace("-85 deg", "-85"))
    lines = message.splitlines()
    assert len(lines) == 11
    assert "start.tilt" in lines[0]
    assert "motion[0].tilt.to" in lines[1]
    assert lines[-1] == "… and 4 more"
