"""A value of the wrong type in any place of a file is refused by an error of this package."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.loading.drives import drive_from
from ssm_planner.loading.files import read_section, section_from_data, shipped_files
from ssm_planner.loading.load import Problem, problem_from_dict
from ssm_planner.loading.motors import motor_from
from ssm_planner.loading.robots import robot_from
from ssm_planner.plans import Plan
from tests.support.paths import RESULTS

WRONG: tuple[Any, ...] = (5, "x", [], {}, None, True, math.nan, [5], {"a": 1})
START = {"roll": "0 deg", "tilt": "-90 deg", "spin": "0 deg", "depth": "1 mm"}
HEAD = {"robot": "vitreoretinal", "start": START}
PROBLEM = {
    **HEAD,
    "points": {"above": {"tilt": "-95 deg"}},
    "motion": [
        {"tilt": {"to": "-100 deg", "duration": "2 s"}},
        {"free": {"to": "above", "through": [START]}},
        {"repeat": {"times": 2, "motion": [{"insert": {"to": "5 mm"}}]}},
        {"straight": {"to": {"depth": "5 mm"}, "through": ["above"], "blend": "0.3 mm"}},
        {"arc": {"to": "above", "through": {"roll": "1 deg"}}},
        {"scan": {"at": "above", "pattern": "ring", "diameter": "2 mm"}},
        {"include": "tilt_insert"},
        {"retina": {"to": {"tilt": "-100 deg"}, "distance": "1 mm"}},
    ],
    "limits": {"tilt": ["-110 deg", "-80 deg"], "tip_speed": "5 mm/s", "friction": "95 %"},
    "mounting": [{"x": "3 deg"}],
    "joints": {"tilt": {"velocity": "5 deg/s"}},
}


def places(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every entry of mappings and lists, at most two entries of each list."""
    items = list(data.items()) if isinstance(data, dict) else []
    items = list(enumerate(data))[:8] if isinstance(data, list) else items
    for key, item in items:
        yield (*path, key)
        yield from places(item, (*path, key))


def with_value(data: Any, path: tuple[Any, ...], value: object) -> Any:
    """Return a copy of data with another value at a path."""
    changed = part = copy.deepcopy(data)
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    return changed


@pytest.mark.parametrize("kind", ["problem", "robots", "drives", "motors"])
def test_every_wrong_value_is_refused_with_a_message(kind: str) -> None:
    read = {"robots": robot_from, "drives": drive_from, "motors": motor_from}.get(kind)
    data: Any = PROBLEM
    if read is not None:
        file = next(iter(shipped_files(kind).values()))  # type: ignore[arg-type]
        data = read_section(file).value
    refused = 0
    for path in places(data):
        for value in WRONG:
            changed = with_value(data, path, value)
            try:
                if read is None:
                    problem_from_dict(changed)
                else:
                    read(section_from_data(changed))
            except ProblemError:
                refused += 1
    assert refused > 30


PARTS = ("problem", "candidates", "software", "phases", "certificate", "proof", "trajectory")


@pytest.mark.parametrize("part", PARTS)
def test_a_damaged_plan_is_refused_with_a_message(part: str) -> None:
    document = json.loads((RESULTS / "tilt_insert" / "plan.json").read_bytes())
    document[part] = document.get(part) or []
    paths = [path for path in places({part: document[part]}) if len(path) < 4]
    refused = 0
    for path in paths[:30]:
        for value in (7, "x"):
            document_part = with_value({part: document[part]}, path, value)
            try:
                Plan._from_document({**document, **document_part}, "0" * 64, Path("plan.json"))
            except SsmPlannerError:
                refused += 1
    assert refused


@pytest.mark.parametrize("value", [[], [0.0] * 3, [0.0] * 5])
def test_a_phase_of_a_plan_has_four_task_coordinates(value: list[float]) -> None:
    document = json.loads((RESULTS / "tilt_insert" / "plan.json").read_bytes())
    document["phases"][0]["task_start"] = value
    with pytest.raises(SsmPlannerError, match="task_start"):
        Plan._from_document(document, "0" * 64, Path("plan.json"))


@pytest.mark.parametrize("motion", [5, True, "hello", {}])
def test_a_motion_that_is_no_list_is_refused(motion: object) -> None:
    with pytest.raises(ProblemError, match="motion"):
        problem_from_dict({**HEAD, "motion": motion})


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ({"foo": 1}, r"points\.a\.foo.*: unknown key"),
        ({"tilt": "5 mm"}, r"points\.a\.tilt = 5 mm"),
        ({"tilt": -100}, r"points\.a\.tilt = -100"),
        ({}, r"points\.a: the point is empty"),
    ],
)
def test_a_named_point_that_no_motion_uses_is_checked(
    point: dict[str, object], message: str
) -> None:
    data = {**HEAD, "motion": [{"tilt": {"to": "-100 deg"}}], "points": {"a": point}}
    with pytest.raises(ProblemError, match=message):
        problem_from_dict(data)


@pytest.mark.parametrize(
    ("points", "message"), [({}, "unknown name"), ({"nowher": START}, "did you mean 'nowher'")]
)
def test_an_unknown_name_of_a_point_is_named(points: dict[str, object], message: str) -> None:
    data = {**HEAD, "motion": [{"free": {"to": "nowhere"}}], "points": points}
    with pytest.raises(ProblemError, match=message):
        problem_from_dict(data)
    del data["points"]
    with pytest.raises(ProblemError, match="unknown name of a point"):
        problem_from_dict(data)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot: x\nstart:\n\troll: 1\n", "line 3: not valid YAML: a tab instead of spaces"),
        ("robot: @x\n", "cannot start any token"),
        ("name: ''\n", "name = : an empty text"),
        ("name: 5\n", "name = 5: a number instead of text"),
        ("speed: null\n", "speed = null: empty value"),
    ],
)
def test_a_message_names_what_the_file_contains(text: str, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        Problem.from_yaml(text)


def test_a_misspelt_robot_has_a_suggestion_and_the_shipped_names() -> None:
    data = {**HEAD, "robot": "vitreoretinall", "motion": [{"tilt": {"to": "-100 deg"}}]}
    with pytest.raises(ProblemError, match=r"did you mean 'vitreoretinal'.*raven_like"):
        problem_from_dict(data)
