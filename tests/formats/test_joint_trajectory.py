"""JointTrajectory messages are written and read, and messages that the controller would reject are
refused. PyYAML is the independent reader of the written files.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats import joint_trajectory as module
from ssm_planner.formats.joint_trajectory import (
    TrajectoryMessage,
    controller_rejections,
    interpolate_message,
    parse_message,
    read_yaml,
    split_time,
    yaml_text,
)
from ssm_planner.problem.robot import Robot

NAMES = ("roll", "tilt", "spin", "insertion")


def message_of(count: int = 3, **changes: object) -> TrajectoryMessage:
    """Return a message of a slow motion with velocities and accelerations."""
    t = np.arange(float(count))
    zero = np.zeros((count, 4)).tolist()
    q = np.outer(t, [0.01, 0.02, 0.03, -0.001]) + [0.0, 1.0, 0.0, 0.0]
    fields = {"positions": q.tolist(), "velocities": zero, "accelerations": zero}
    fields |= {"names": NAMES, "time": t, "effort": [[]] * count, **changes}
    return TrajectoryMessage(**fields)  # type: ignore[arg-type]


@given(st.floats(-1e9, 1e9))
def test_a_time_is_split_into_whole_seconds_and_nanoseconds(t: float) -> None:
    sec, nanosec = split_time(t)
    assert 0 <= nanosec < 10**9
    assert sec * 10**9 + nanosec == round(t * 1e9)


@given(
    under=st.sampled_from(["", "trajectory"]),
    numbers=st.lists(st.floats(-1e3, 1e3), min_size=8, max_size=8),
)
@example(under="", numbers=[1e-5, -1e-05, 1e22, 1.5e-300, -0.0, 0.1, 3.0, 1e16])
@settings(max_examples=20)
def test_any_yaml_reader_reads_the_written_numbers(
    tmp_path_factory: pytest.TempPathFactory, under: str, numbers: list[float]
) -> None:
    """PyYAML follows YAML 1.1, in which 1e-05 is a text.

    Numbers are therefore written in another form.
    """
    rows = [numbers[:4], numbers[4:]]
    message = message_of(2, velocities=rows, effort=rows[::-1])
    path = tmp_path_factory.mktemp("yaml") / "t.yaml"
    path.write_text(yaml_text(message, ["one: two", "three"], under), encoding="utf-8")
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# one: two\n# three\n")
    content = yaml.safe_load(text)
    data = content[under] if under else content
    assert data["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "base"}
    found = parse_message(data, "here")
    assert found.names == message.names
    assert np.array_equal(found.time, message.time)
    for field in module.POINT_FIELDS:
        assert [list(row) for row in getattr(found, field)] == getattr(message, field)
        assert all(type(x) is float for point in data["points"] for x in point[field])
    assert not re.search(r"-0\.0[,\]]", text)


def test_a_goal_is_the_message_below_its_key(tmp_path: Path) -> None:
    """The message below its key has the same lines, indented by two more spaces."""
    for name, under in (("a", ""), ("b", "trajectory")):
        (tmp_path / f"{name}.yaml").write_text(
            yaml_text(message_of(), ["comment"], under), encoding="utf-8"
        )
    plain, goal = (
        (tmp_path / f"{name}.yaml").read_text(encoding="utf-8").splitlines() for name in "ab"
    )
    assert goal[1] == "trajectory:"
    assert goal[2:] == [f"  {line}" for line in plain[1:]]
    assert [line[0] for line in plain] == ["#", "h", "j", "p", "-", "-", "-"]


def test_goals_are_read_at_any_usual_depth(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(yaml_text(message_of(), [], ""), encoding="utf-8")
    text = path.read_text(encoding="utf-8")
    plain = read_yaml(path, robot)
    for above in (["trajectory"], ["goal"], ["goal", "trajectory"]):
        data = yaml.safe_load(text)
        for key in reversed(above):
            data = {key: data}
        path.write_text(yaml.safe_dump(data), encoding="utf-8")
        reading = read_yaml(path, robot)
        assert np.array_equal(reading.trajectory.coefficients, plain.trajectory.coefficients)
        assert reading.interpolation == plain.interpolation
    path.write_bytes(b"a: \xff")
    with pytest.raises(TrajectoryError, match=r"t\.yaml: not a text file"):
        read_yaml(path, robot)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"names": ("roll", "tilt", "spin", "elbow")},
            "joint 'elbow' is not one of roll, tilt, spin, insertion",
        ),
        ({"names": ("roll", "roll", "roll", "tilt")}, "joint 'roll' is named twice"),
        ({"names": ("roll", "tilt", "spin")}, "joint 'insertion' is missing"),
        ({"time": np.array([-0.25, 1.0, 2.0])}, "point 0: time_from_start is negative: -0.25 s"),
        (
            {"time": np.array([0.0, 3.5, 2.5])},
            "point 2: time_from_start does not increase (2.5 s after 3.5 s)",
        ),
        (
            {"time": np.array([0.0, 0.0, 0.0])},
            "point 1: time_from_start does not increase (0 s after 0 s)",
        ),
        ({"positions": [[0.0] * 4, [], [0.0] * 4]}, "point 1: 0 positions for 4 joints"),
        ({"velocities": [[], [], [0.0] * 3]}, "point 2: 3 velocities for 4 joints"),
        ({"accelerations": [[0.0] * 5, [], []]}, "point 0: 5 accelerations for 4 joints"),
        ({"effort": [[0.0], [0.0], []]}, "point 0: 1 effort for 4 joints"),
    ],
)
def test_every_fault_is_named_once(robot: Robot, changes: dict, message: str) -> None:
    wrong = message_of(**changes)
    faults, _ = controller_rejections(wrong, NAMES)
    assert faults.count(message) == 1
    rest = [fault for fault in faults if fault != message]
    assert all(("missing" in f and "names" in changes) or " for 3 joints" in f for f in rest)
    with pytest.raises(TrajectoryError) as caught:
        interpolate_message(wrong, robot, "here")
    more = f" (and {len(rest)} more)" if rest else ""
    assert str(caught.value) == f"here: {faults[0]}{more}"


def test_a_message_without_points_has_no_remarks() -> None:
    empty = message_of(0)
    assert controller_rejections(empty, NAMES) == (["no points"], [])


def test_remarks_depend_on_the_last_velocity_the_first_time_and_efforts(robot: Robot) -> None:
    assert controller_rejections(message_of(), NAMES) == ([], [])
    rest_speed = module.CONTROLLER_REST_SPEED
    for speed, remarked in ((rest_speed, False), (-1.01 * rest_speed, True), (0.25, True)):
        moving = message_of(velocities=[[0.5] * 4, [0.5] * 4, [0.0, 0.0, speed, 0.0]])
        faults, remarks = controller_rejections(moving, NAMES)
        assert not faults
        assert len(remarks) == remarked
        if remarked:
            assert f"the last velocity is {abs(speed):.3g}, not zero" in remarks[0]
    assert not any(controller_rejections(message_of(velocities=[[0.5] * 4, [0.5] * 4, []]), NAMES))
    late = message_of(time=np.array([0.125, 1.0, 2.0]))
    ((remark,),) = controller_rejections(late, NAMES)[1:]
    assert "moves the robot to the first point until 0.125 s" in remark
    with_effort = message_of(effort=[[], [0.0] * 4, []])
    assert ["efforts" in remark for remark in controller_rejections(with_effort, NAMES)[1]] == [
        True
    ]
    assert interpolate_message(late, robot, "here", ("first",)).notes == ("first", remark)


@pytest.mark.parametrize("missing", [None, 0, 2])
@pytest.mark.parametrize("field", ["velocities", "accelerations"])
def test_points_may_lack_a_quantity(robot: Robot, field: str, missing: int | None) -> None:
    rows = np.zeros((5, 4)).tolist()
    if missing is not None:
        rows[missing] = []
    reading = interpolate_message(message_of(5, **{field: rows}), robot, "here")
    lesser = {"velocities": "linear", "accelerations": "cubic"}[field]
    pieces = {None: 0, 0: 1, 2: 2}[missing]
    if pieces:
        stated = f"mixed between points: {pieces} {lesser}, {4 - pieces} quintic"
        assert reading.interpolation == stated
    else:
        assert reading.interpolation.startswith("quintic")
    none = interpolate_message(message_of(5, **{field: [[]] * 5}), robot, "here")
    assert none.interpolation.startswith(lesser)


def test_joints_may_come_in_any_order(robot: Robot) -> None:
    order = [3, 1, 0, 2]
    usual = message_of()
    turned = message_of(
        names=tuple(NAMES[k] for k in order),
        positions=np.array(usual.positions)[:, order].tolist(),
    )
    result, expected = (interpolate_message(m, robot, "").trajectory for m in (turned, usual))
    assert np.array_equal(result.coefficients, expected.coefficients)
    assert expected.sample(usual.time).q == pytest.approx(np.array(usual.positions))


@pytest.mark.parametrize("sec", [10**9, -(10**9), 0])
def test_seconds_are_taken_up_to_a_thousand_million(sec: int) -> None:
    def message(seconds: int) -> TrajectoryMessage:
        point = {"positions": [], "time_from_start": {"sec": seconds}}
        return parse_message({"joint_names": [], "points": [point]}, "here")

    assert message(sec).time.tolist() == [sec]
    with pytest.raises(TrajectoryError, match="here: point 0: time_from_start"):
        message((10**9 + 1) * (-1 if sec < 0 else 1))


@pytest.mark.parametrize("data", [None, 3, [], {"points": []}, {"joint_names": [], "points": 3}])
def test_other_data_is_no_message(data: object) -> None:
    with pytest.raises(TrajectoryError, match="here: not a JointTrajectory"):
        parse_message(data, "here")


@pytest.mark.parametrize("value", [3, {"a": 1}, ["1"], [True], [None], "12"])
def test_quantities_are_lists_of_numbers(value: object) -> None:
    fine = {"time_from_start": {"sec": 0}, "positions": [1, 2.5], "velocities": None}
    for key in module.POINT_FIELDS:
        points = [fine, {**fine, "time_from_start": {"sec": 1}, key: value}]
        with pytest.raises(TrajectoryError, match=f"here: point 1: {key} is not a list of num"):
            parse_message({"joint_names": ["a", "b"], "points": points}, "here")
    result = parse_message({"joint_names": ["a", "b"], "points": [fine]}, "here")
    assert result.positions == [[1, 2.5]]
    assert result.velocities == result.accelerations == result.effort == [[]]


def test_a_fault_of_the_points_names_its_point(robot: Robot) -> None:
    far = message_of(positions=[[0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 90.0, 0.0, 0.0]])
    with pytest.raises(TrajectoryError, match=re.escape("here: point 2: position of joint tilt")):
        interpolate_message(far, robot, "here")
