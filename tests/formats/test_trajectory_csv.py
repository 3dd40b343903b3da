"""The column names that many programs write are understood as joint, derivative and unit."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.trajectory_csv import _parse_heading, _split_unit, identify_columns
from ssm_planner.problem.robot import Robot

NAMES = ("roll", "tilt", "spin", "insertion")
ORDERS = (
    ("q", "pos", "position", "angle", "theta", "displacement"),
    ("qd", "dq", "vel", "velocity", "speed", "rate"),
    ("qdd", "ddq", "acc", "accel", "acceleration"),
)
PER = ("", "/s", "/s^2")
UNITS = {"rad": 1.0, "deg": math.pi / 180, "m": 1.0, "mm": 1e-3}


def complete(order: int) -> list[str]:
    """Return the column names of a table with derivatives up to an order."""
    names = ["time_s"]
    for k in range(order + 1):
        names += [f"{name} [{'m' if i == 3 else 'rad'}{PER[k]}]" for i, name in enumerate(NAMES)]
    return names


@given(
    joint=st.integers(0, 3),
    order=st.integers(0, 2),
    word=st.integers(0, 5),
    style=st.integers(0, 4),
    small=st.booleans(),
    neutral=st.sampled_from(["", "actual ", "target ", "value "]),
)
def test_a_name_of_joint_quantity_and_unit_is_understood(
    robot: Robot, joint: int, order: int, word: int, style: int, small: bool, neutral: str
) -> None:
    quantity = ORDERS[order][min(word, len(ORDERS[order]) - 1)]
    number = joint + 1
    unit = ("mm" if small else "m") if joint == 3 else ("deg" if small else "rad")
    label = (
        f"{NAMES[joint]} {quantity}",
        f"joint{number}_{quantity}",
        f"Joint {number} {quantity}",
        f"{quantity} axis_{number}",
        f"{quantity} {NAMES[joint]}",
    )[style]
    meaning = _parse_heading(f"{neutral}{label} [{unit}{PER[order]}]", robot)
    assert meaning == ((order, joint), pytest.approx(UNITS[unit]))


@pytest.mark.parametrize("name", ["t_s", "time [s]", "Timestamp (s)", "time_from_start_s"])
def test_times_begin_with_a_word_for_time(robot: Robot, name: str) -> None:
    assert _parse_heading(name, robot) == ((-1, 0), 1.0)
    assert _parse_heading(f"duration {name}", robot) is None


@pytest.mark.parametrize("name", ["", "7", "motor current [A]", "roll error [rad]", "joint5_rad"])
def test_other_columns_are_ignored(robot: Robot, name: str) -> None:
    assert _parse_heading(name, robot) is None


@pytest.mark.parametrize(
    ("text", "base", "order"),
    [
        ("deg", "deg", 0),
        ("deg/s", "deg", 1),
        ("deg_per_s", "deg", 1),
        ("m/s^2", "m", 2),
        ("m/s²", "m", 2),
        ("rad_per_s2", "rad", 2),
        ("", "", 0),
    ],
)
def test_units_are_split_into_base_and_order(text: str, base: str, order: int) -> None:
    assert _split_unit(text) == (base, order)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_all_joints_or_none_have_a_derivative(robot: Robot, order: int) -> None:
    names = complete(order)
    columns, ignored = identify_columns(names, robot, "file")
    assert not ignored
    assert sorted(columns) == [(-1, 0), *((k, i) for k in range(order + 1) for i in range(4))]
    for key, heading in columns.items():
        assert names[heading.column] == heading.name
        fewer = [name for name in names if name != heading.name]
        words = "no time column" if key[0] < 0 else f"of joint {NAMES[key[1]]}"
        with pytest.raises(TrajectoryError, match=words) as caught:
            identify_columns(fewer, robot, "file")
        assert ("examples of column names" in str(caught.value)) == (key[0] == 0)


def test_accelerations_need_velocities(robot: Robot) -> None:
    names = [name for name in complete(2) if not name.endswith("/s]")]
    with pytest.raises(TrajectoryError, match="file: accelerations need velocities"):
        identify_columns(names, robot, "file")


def test_several_missing_joints_are_listed(robot: Robot) -> None:
    with pytest.raises(TrajectoryError, match="file: no position of joint roll, spin; examples"):
        identify_columns(["time_s", "tilt_rad", "insertion_mm"], robot, "file")
    names = [*complete(0), "spin [rad/s]"]
    with pytest.raises(TrajectoryError, match=r"no velocity of joint roll, tilt, insertion$"):
        identify_columns(names, robot, "file")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "roll",
            r"the unit is missing .allowed: rad.*derivatives add /s or /s\^2.; joint roll turns",
        ),
        ("roll [mm]", "unit 'mm' is not allowed .allowed: rad.*; joint roll turns"),
        ("insertion [deg]", "unit 'deg' is not allowed .allowed: m.*; joint insertion slides"),
        ("roll velocity [rad]", "the column is a velocity, but 'rad' is a unit of position"),
        ("roll position [rad/s^2]", "is a position, but 'rad/s.2' is a unit of acceleration"),
        ("time [h]", "unit 'h' is not allowed .allowed: s"),
        ("time", "the unit is missing .allowed: s"),
    ],
)
def test_wrong_units_are_named_with_the_column(robot: Robot, name: str, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message) as caught:
        identify_columns([*complete(0), name], robot, "file")
    assert str(caught.value).startswith(f"file: column {name!r}: ")
