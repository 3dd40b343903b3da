"""The eye and the limits on rates are read from a problem file and survive plan.json. Wrong values
are refused with a message.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from ssm_planner.problem.serialization import problem_from_plain, to_plain
from tests.support.paths import PROBLEMS

SHIPPED = PROBLEMS
NAME = "tilt_insert.yaml"
END = "objective: time"
LIMIT = "  tilt: [-139 deg, -81 deg]"
EYE = """eye:
  centre: [9 mm, 0 mm, -8 mm]
  radius: 11.5 mm
  clearance: 1 mm
  port: 2.5 mm
  shaft_radius: 0.25 mm
  lens:
    centre: [9 mm, 0 mm, -2 mm]
    semi_axes: [4.8 mm, 4.8 mm, 2 mm]
    axis: [0, 0, 2]
"""
SPEEDS = """
  roll_rate: 10 deg/s
  tilt_rate: 20 deg/s
  spin_rate: 30 deg/s
  insertion_speed: 10 mm/s"""


@pytest.fixture(autouse=True)
def without_eye(files: Any) -> None:
    """Remove the eye from the problem before each test."""
    files.without_eye(NAME)


def test_the_limits_of_the_file_apply(files: Any) -> None:
    files.edit(NAME, END, EYE + END)
    files.edit(NAME, LIMIT, LIMIT + SPEEDS)
    problem = files.load(NAME)
    limits = problem.task_limits
    assert limits.rates == pytest.approx(
        {
            "roll": math.radians(10),
            "tilt": math.radians(20),
            "spin": math.radians(30),
            "depth": 0.01,
        }
    )
    eye = limits.eye
    assert eye.centre == pytest.approx([0.009, 0.0, -0.008])
    assert (eye.radius, eye.clearance, eye.port, eye.shaft_radius) == pytest.approx(
        (0.0115, 0.001, 0.0025, 0.00025)
    )
    assert eye.lens.semi_axes == pytest.approx([0.0048, 0.0048, 0.002])
    assert eye.lens.frame[:, 2] == pytest.approx([0.0, 0.0, 1.0])


def test_port_and_shaft_have_defaults_and_the_lens_may_be_left_out(files: Any) -> None:
    short = "eye: {centre: [9 mm, 0 mm, -8 mm], radius: 11.5 mm, clearance: 1 mm}\n"
    files.edit(NAME, END, short + END)
    eye = files.load(NAME).eye
    assert (eye.port, eye.shaft_radius, eye.lens) == (0.003, 0.0, None)


def test_without_these_keys_nothing_is_limited(files: Any) -> None:
    problem = files.load(NAME)
    assert problem.eye is None
    assert problem.rates == {}


@pytest.mark.parametrize("seed", range(5))
def test_the_frame_of_a_lens_is_a_rotation_with_the_axes_given(files: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    third = rng.normal(size=3)
    first = np.cross(third, rng.normal(size=3)) * rng.uniform(0.1, 10)
    axes = f"axis: {third.tolist()}\n    first_axis: {first.tolist()}"
    text = EYE.replace("axis: [0, 0, 2]", axes).replace(
        "[4.8 mm, 4.8 mm, 2 mm]", "[4.5 mm, 4 mm, 2 mm]"
    )
    files.edit(NAME, END, text + END)
    frame = files.load(NAME).eye.lens.frame
    assert np.abs(frame.T @ frame - np.eye(3)).max() < 1e-14
    assert np.linalg.det(frame) == pytest.approx(1.0)
    assert frame[:, 2] == pytest.approx(third / np.linalg.norm(third))
    assert frame[:, 0] == pytest.approx(first / np.linalg.norm(first))


def test_equal_semi_axes_permit_any_frame_about_the_third(files: Any) -> None:
    files.edit(NAME, END, EYE.replace("[0, 0, 2]", "[0.3, -2, 1]") + END)
    frame = files.load(NAME).eye.lens.frame
    assert np.abs(frame.T @ frame - np.eye(3)).max() < 1e-14
    assert frame[:, 2] == pytest.approx(
        np.array([0.3, -2.0, 1.0]) / np.linalg.norm([0.3, -2.0, 1.0])
    )


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("[9 mm, 0 mm, -8 mm]", "[9, 0, -8]", ("eye.centre", "without a unit")),
        ("[9 mm, 0 mm, -8 mm]", "[9 mm, -8 mm]", ("eye.centre", "2 values")),
        (
            "[9 mm, 0 mm, -8 mm]",
            "[0 mm, 0 mm, -8 mm]",
            ("eye.centre", "the port is not on its wall", "9 mm to 14 mm"),
        ),
        (
            "[9 mm, 0 mm, -8 mm]",
            "[9 mm, 0 mm, -12 mm]",
            ("eye.centre", "15 mm from the centre", "9 mm to 14 mm"),
        ),
        ("radius: 11.5 mm", "radius: 0 mm", ("eye.radius = 0 mm", "not greater than zero")),
        ("radius: 11.5 mm", "radius: 11.5 m", ("eye.radius = 11.5 m", "did you mean mm?")),
        ("clearance: 1 mm", "clearance: -1 mm", ("eye.clearance = -1 mm", "negative")),
        (
            "clearance: 1 mm",
            "clearance: 12 mm",
            ("eye.clearance = 12 mm", "leaves no room", "11.5 mm"),
        ),
        (
            "clearance: 1 mm",
            "clearance: 2 mm",
            ("eye.clearance = 2 mm", "leaves the port", "less than 1.9584 mm"),
        ),
        ("port: 2.5 mm", "port: 0 mm", ("eye.port = 0 mm", "not greater than zero")),
        ("port: 2.5 mm", "prot: 2.5 mm", ("eye.prot", "did you mean 'port'?")),
        ("shaft_radius: 0.25 mm", "shaft_radius: -1 mm", ("eye.shaft_radius = -1 mm", "negative")),
        (
            "[9 mm, 0 mm, -2 mm]",
            "[9 mm, 0 mm, 5 mm]",
            ("eye.lens.centre", "outside the eye", "11.5 mm"),
        ),
        (
            "[9 mm, 0 mm, -2 mm]",
            "[3 mm, 0 mm, -1 mm]",
            ("eye.lens.centre", "blocks the shaft", "1.125 times"),
        ),
        (
            "[4.8 mm, 4.8 mm, 2 mm]",
            "[4.8 mm, 0 mm, 2 mm]",
            ("eye.lens.semi_axes[1] = 0 mm", "above 0"),
        ),
        (
            "[4.8 mm, 4.8 mm, 2 mm]",
            "[4.8 mm, 4.8 mm, 20 mm]",
            ("eye.lens.semi_axes[2] = 20 mm", "below 11.5 mm"),
        ),
        (
            "[4.8 mm, 4.8 mm, 2 mm]",
            "[4.8 mm, 4 mm, 2 mm]",
            ("eye.lens.first_axis", "missing", "differ"),
        ),
        ("axis: [0, 0, 2]", "axis: [0, 0, 0]", ("eye.lens.axis = [0, 0, 0]", "no direction")),
        ("axis: [0, 0, 2]", "axis: [0, 1]", ("eye.lens.axis = [0, 1]", "three numbers")),
        (
            "axis: [0, 0, 2]",
            "axis: [0, 0, 2]\n    first_axis: [1, 0, 0.5]",
            ("eye.lens.first_axis", "at 63.43 deg to axis", "a right angle"),
        ),
    ],
)
def test_bad_eyes(files: Any, old: str, new: str, parts: tuple[str, ...]) -> None:
    files.edit(NAME, END, EYE + END)
    place = "lens:\n" if "missing" in parts else "first_axis" if "first_axis: [1" in new else None
    message = files.rejection(NAME, old, new, place)
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("new", "parts"),
    [
        ("tilt_rate: 0 deg/s", ("limits.tilt_rate = 0 deg/s", "not greater than zero")),
        ("tilt_rate: 20 mm/s", ("limits.tilt_rate = 20 mm/s", "a speed such as 65 deg/s")),
        (
            "insertion_speed: 20 deg/s",
            ("limits.insertion_speed = 20 deg/s", "a speed such as 20 mm/s"),
        ),
        ("insertion_rate: 20 mm/s", ("limits.insertion_rate", "unknown key", "insertion_speed")),
    ],
)
def test_bad_rates(files: Any, new: str, parts: tuple[str, ...]) -> None:
    message = files.rejection(NAME, LIMIT, f"  {new}")
    for part in parts:
        assert part in message


def test_limits_of_the_task_survive_plan_json(files: Any) -> None:
    files.edit(NAME, END, EYE + END)
    files.edit(NAME, LIMIT, LIMIT + SPEEDS + "\n  tip_speed: 12 mm/s")
    problem = files.load(NAME)
    limits = problem.task_limits
    document = json.loads(json.dumps(to_plain(problem), allow_nan=False))
    back = problem_from_plain(document).task_limits
    assert to_plain(back) == to_plain(limits)
    assert (back.ranges, back.tip_speed, back.rates) == (
        limits.ranges,
        limits.tip_speed,
        limits.rates,
    )
    for mine, its in ((limits.eye, back.eye), (limits.eye.lens, back.eye.lens)):
        assert np.array_equal(mine.centre, its.centre)
        assert not its.centre.flags.writeable


def test_a_plan_from_before_the_eye_limits_nothing_more(files: Any) -> None:
    """A plan file without the keys `rates` and `eye` has no such limits."""
    document = to_plain(files.load(NAME)) | {"limits": {"tilt": [-2.4, -1.45]}, "tip_speed": None}
    del document["rates"], document["eye"]
    problem = problem_from_plain(document)
    limits = problem.task_limits
    assert limits.ranges == {"tilt": (-2.4, -1.45), "depth": problem.robot.travel}
    assert (limits.tip_speed, limits.rates, limits.eye) == (None, {}, None)
