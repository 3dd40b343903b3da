"""Short forms in a problem file, such as names of points, repetitions and included files, give the
same problem as the long forms.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import json_schema, load_problem
from ssm_planner.problem.problem import Problem
from tests.support.paths import ROOT

START = {"roll": "0 deg", "tilt": "-85 deg", "spin": "0 deg", "depth": "1 mm"}
ABOVE = {"tilt": "-110 deg", "depth": "5 mm"}
ROBOT = str(ROOT / "problems/robots/vitreoretinal.yaml")


def problem(*motion: Any, **keys: Any) -> Problem:
    """Return a problem of the shipped robot with a motion list and further keys."""
    return Problem.from_dict({"robot": ROBOT, "start": START, "motion": list(motion), **keys})


def test_names_of_points_are_their_points() -> None:
    entries = (
        {"free": {"to": "above", "through": ["side", {"depth": "3 mm"}]}},
        {"straight": {"to": "side"}},
    )
    side = {"roll": "10 deg"}
    named = problem(*entries, points={"above": ABOVE, "side": side, "begin": START}, start="begin")
    plain = problem(
        {"free": {"to": ABOVE, "through": [side, {"depth": "3 mm"}]}}, {"straight": {"to": side}}
    )
    assert named.motion == plain.motion
    assert named.start == plain.start


def test_repeated_motions_follow_one_another() -> None:
    once = [{"tilt": {"to": "-100 deg"}}, {"repeat": {"times": 2, "motion": [{"dwell": "1 s"}]}}]
    named = problem({"repeat": {"times": 3, "motion": once}}, {"tilt": {"to": "-90 deg"}})
    assert [entry.name for entry in named.motion] == 3 * ["tilt", "dwell", "dwell"] + ["tilt"]


def test_motions_of_another_problem_with_names_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "part.yaml").write_text(
        "points: {above: {depth: 2 mm}}\nmotion:\n  - free: {to: above}\n  - tilt: {to: 99 deg}\n",
        encoding="utf-8",
    )
    text = f"robot: {ROBOT}\nstart: {START}\npoints: {{above: {ABOVE}}}\n".replace("'", "")
    (tmp_path / "whole.yaml").write_text(
        f"{text}motion:\n  - free: {{to: above}}\n  - include: part.yaml\n", encoding="utf-8"
    )
    with pytest.raises(ProblemError, match=r"whole.yaml:6: .*outside the limits of tilt"):
        load_problem(tmp_path / "whole.yaml")
    (tmp_path / "part.yaml").write_text(
        (tmp_path / "part.yaml").read_text(encoding="utf-8").replace("99", "-99"), encoding="utf-8"
    )
    complete = load_problem(tmp_path / "whole.yaml")
    assert [entry.name for entry in complete.motion] == ["free", "free", "tilt"]
    assert complete.motion[1].to.set_coordinates == {"depth": 0.002}


def test_the_robot_of_one_problem() -> None:
    """A problem may change the limits, speed, mounting and payload of its robot."""
    plain = problem({"dwell": "1 s"}).robot
    joints = {
        "roll": {"velocity": "40 deg/s", "jerk": "4000 deg/s^3"},
        "insertion": {"acceleration": "80 mm/s^2"},
    }
    other = problem(
        {"dwell": "1 s"}, joints=joints, speed="50 %", mounting=["x 90 deg"], tip_payload="20 g"
    ).robot
    assert other.joints[0].velocity == pytest.approx(np.radians(20))
    assert other.joints[0].jerk == pytest.approx(np.radians(4000))
    assert other.joints[1].velocity == pytest.approx(plain.joints[1].velocity / 2)
    assert other.joints[3].acceleration == pytest.approx(0.08)
    # After a rotation by 90° about x, the y axis of the base points up.
    assert other.gravity == pytest.approx([0.0, plain.gravity[2], 0.0])
    assert other.bodies[3].mass == pytest.approx(plain.bodies[3].mass + 0.02)
    assert other.bodies[3].mass * other.bodies[3].com == pytest.approx(
        plain.bodies[3].mass * plain.bodies[3].com
    )


@pytest.mark.parametrize(
    ("motion", "keys", "message"),
    [
        (
            {"free": {"to": "abve"}},
            {"points": {"above": ABOVE}},
            "motion[0].free.to = abve: unknown name of a point",
        ),
        ({"free": {"to": "above"}}, {}, "unknown name of a point"),
        ({"dwell": "1 s"}, {"points": {"above": 3}}, "points.above = 3: not a mapping of names"),
        ({"dwell": "1 s"}, {"points": [1]}, "points = [1]: not a mapping of names to points"),
        (
            {"repeat": {"times": 0, "motion": [{"dwell": "1 s"}]}},
            {},
            "motion[0].repeat.times = 0: too small",
        ),
        ({"repeat": {"times": 10_000, "motion": 2 * [{"dwell": "1 s"}]}}, {}, "too many motions"),
        ({"repeat": {"motion": [{"dwell": "1 s"}]}}, {}, "repeat.times: missing"),
        ({"repeat": {"times": 2, "motion": 3}}, {}, "not a list"),
        ({"include": 3}, {}, "invalid problem"),
        ({"include": "nowhere.yaml"}, {}, "does not exist"),
        ({"dwell": "1 s"}, {"speed": "130 %"}, "invalid share of the speed"),
        ({"dwell": "1 s"}, {"speed": "fast"}, "instead of a share"),
        ({"dwell": "1 s"}, {"mounting": ["x alpha"]}, "names alpha"),
        ({"dwell": "1 s"}, {"joints": {"elbow": {}}}, "joints.elbow"),
        ({"dwell": "1 s"}, {"joints": {"roll": {"velocity": "-3 deg/s"}}}, "joints.roll.velocity"),
        ({"dwell": "1 s"}, {"tip_payload": "-3 g"}, "tip_payload"),
    ],
)
def test_the_message_names_the_error(motion: Any, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ProblemError, match=re.escape(message)):
        problem(motion, **keys)


def test_a_problem_that_includes_itself_is_refused(tmp_path: Path) -> None:
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{name}.yaml").write_text(
            f"robot: {ROBOT}\nstart: {START}\nmotion: [include: {other}.yaml]\n".replace("'", ""),
            encoding="utf-8",
        )
    with pytest.raises(ProblemError, match="includes itself"):
        load_problem(tmp_path / "a.yaml")


def test_the_schema_for_editors_knows_names() -> None:
    text = str(json_schema("problem"))
    assert all(
        f"'{key}'" in text
        for key in ("points", "repeat", "include", "speed", "mounting", "tip_payload")
    )
    assert "A name among `points`." in text
