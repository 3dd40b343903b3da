"""Damaged, hostile and manually changed files lead to one message that names the file. None of them
is shown as certified.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ssm_planner import api
from ssm_planner.cli import main
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.agreement import first_difference
from ssm_planner.formats.export import export
from ssm_planner.formats.joint_trajectory import TrajectoryMessage, parse_message
from ssm_planner.formats.read import read_trajectory
from ssm_planner.formats.ros2 import _message_from_states, _ros_joint_state, _ros_trajectory
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import to_plain
from ssm_planner.reporting.html.report import report_page, verdict_marks
from ssm_planner.trajectory import Trajectory
from tests.support.paths import ROOT
from tests.support.plans import certified, read_back, smooth, trapezoids, write_plan

ROBOT = str(ROOT / "problems/robots/vitreoretinal.yaml")
SHIPPED = ROOT / "results/tilt_insert/plan.json"


@pytest.fixture
def made(robot: Robot, tmp_path: Path) -> Plan:
    """Return a plan that was written to a file and read back."""
    return read_back(tmp_path / "plan.json", robot, trapezoids(robot))


def test_coefficients_changed_by_hand_are_nowhere_certified(tmp_path: Path) -> None:
    document = json.loads(SHIPPED.read_text(encoding="utf-8"))
    document["trajectory"]["coefficients"][3][2][1] *= 1 + 1e-9
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    plan = load_plan(path)
    assert not plan.passed
    assert verdict_marks(plan)[1][:2] == ("bad", "Not certified")
    assert "changed after the check" in report_page(plan)
    assert any("changed after the check" in note for note in plan.notes)
    with pytest.raises(ExportError, match="changed after the check"):
        export(plan, "csv", tmp_path / "csv")
    assert verdict_marks(load_plan(SHIPPED))[1][1] == "Certified"


def test_a_plan_changed_in_python_has_no_certificate(made: Plan, robot: Robot) -> None:
    assert made.passed
    other = dataclasses.replace(made, trajectory=smooth(robot))
    assert not other.passed
    assert other.uncertified_reason
    assert certified(other).passed


def test_a_certificate_without_limits_is_none(robot: Robot, tmp_path: Path) -> None:
    path = write_plan(tmp_path / "plan.json", robot, trapezoids(robot))
    document = json.loads(path.read_text(encoding="utf-8"))
    document["certificate"]["limits"] = []
    path.write_text(json.dumps(document), encoding="utf-8")
    plan = load_plan(path)
    assert not plan.passed
    assert "no limits" in str(plan.uncertified_reason)
    assert verdict_marks(plan)[1][1] == "Not certified"


def test_limits_in_a_plan_are_compared_with_the_robot_s(
    robot: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    joints = tuple(
        dataclasses.replace(joint, velocity=2 * joint.velocity) for joint in robot.joints
    )
    fast = dataclasses.replace(robot, joints=joints, limits=())
    path = write_plan(tmp_path / "plan.json", fast, trapezoids(fast))
    assert main(["check", str(path)]) == 0
    assert "those of the plan" in capsys.readouterr().out
    assert main(["check", str(path), "--robot", ROBOT]) == 1
    out = capsys.readouterr().out
    assert "the plan was made for another limit: velocity of joint tilt" in out
    assert "tilt range" in out


@pytest.mark.parametrize(
    ("column", "factor"), [(2, 50), (3, 9)], ids=["velocity offset", "torque offset"]
)
def test_offsets_of_a_drive_are_judged_with_and_without_the_hash(
    made: Plan, robot: Robot, tmp_path: Path, column: int, factor: int
) -> None:
    files, manifest = export(made, "epos4", tmp_path / "e", counts_per_turn=4096)
    assert not api.check(tmp_path / "e", robot).violations
    lines = [line.split(",") for line in files["tilt.csv"].read_text(encoding="utf-8").splitlines()]
    for line in lines[1:]:
        line[column] = str(factor * int(line[column]))
    files["tilt.csv"].write_text("\n".join(map(",".join, lines)) + "\n", encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"tilt\.csv: the file was modified after the export"):
        api.check(tmp_path / "e", robot)
    manifest["files"]["tilt.csv"] = hashlib.sha256(files["tilt.csv"].read_bytes()).hexdigest()
    files["manifest"].write_text(json.dumps(manifest), encoding="utf-8")
    result = api.check(tmp_path / "e", robot)
    assert ("velocity offset" if column == 2 else "torque offset", "tilt") in {
        (v.name, v.joint) for v in result.violations
    }


@pytest.mark.parametrize(
    "name", [".", "..", "../x.csv", "/etc/passwd", "", "x\0.csv", "manifest.json"]
)
def test_a_manifest_names_only_its_own_files(
    made: Plan, robot: Robot, tmp_path: Path, name: str
) -> None:
    files, manifest = export(made, "csv", tmp_path / "csv")
    files["manifest"].write_text(json.dumps({**manifest, "trajectory": name}), encoding="utf-8")
    with pytest.raises(TrajectoryError, match="manifest"):
        read_trajectory(tmp_path / "csv", robot)


@pytest.mark.parametrize("kind", [{"x": 1}, ["epos4"], None, 3, "x" * 9000])
def test_a_manifest_of_an_unknown_kind_is_named(
    made: Plan, robot: Robot, tmp_path: Path, kind: object
) -> None:
    files, manifest = export(made, "epos4", tmp_path / "epos4", force=True, counts_per_turn=1024)
    files["manifest"].write_text(json.dumps({**manifest, "kind": kind}), encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"does not contain a trajectory|manifest\.json"):
        read_trajectory(tmp_path / "epos4", robot)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("increments_per_motor_turn", None, "does not give the increments of joint roll"),
        ("increments_per_motor_turn", 0, "does not give the increments of joint roll"),
        ("increments_per_motor_turn", 2.5, "does not give the increments of joint roll"),
        ("increments_per_motor_turn", 2**31, "does not give the increments of joint roll"),
        ("increments_per_unit", "x", r"roll\.increments_per_unit is 'x', but the motion gives"),
        ("increments_per_unit", True, r"roll\.increments_per_unit is True, but the motion"),
        ("increments_per_unit", 1.0, r"roll\.increments_per_unit is 1\.0, but the motion"),
        ("rated_torque_Nm", None, r"roll\.rated_torque_Nm is None, but the motion gives"),
        ("rated_torque_Nm", 1.0, r"roll\.rated_torque_Nm is 1\.0, but the motion gives"),
    ],
)
def test_a_manifest_states_the_scales_of_the_robot(
    made: Plan, robot: Robot, tmp_path: Path, key: str, value: object, message: str
) -> None:
    files, manifest = export(made, "epos4", tmp_path / "epos4", force=True, counts_per_turn=1024)
    read_trajectory(tmp_path / "epos4", robot)
    manifest["axes"]["roll"][key] = value
    files["manifest"].write_text(json.dumps(manifest), encoding="utf-8")
    with pytest.raises(TrajectoryError, match=message):
        read_trajectory(tmp_path / "epos4", robot)


def bag(folder: Path, plan: Plan, *messages: TrajectoryMessage) -> Path:
    """Write a bag that contains only these trajectories."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/t", "trajectory_msgs/msg/JointTrajectory", typestore=store)
        for k, message in enumerate(messages):
            content = _ros_trajectory(message)
            writer.write(topic, k, store.serialize_cdr(content, topic.msgtype))
    return folder


def message_of(robot: Robot, shift: float = 0.0) -> TrajectoryMessage:
    """Return a message of three points. `shift` (rad) moves joint 1 at the second point."""
    t = np.array([0.0, 1.0, 2.0])
    q = np.array([[0.3, 1.15, 0.1, 0.0], [0.35 + shift, 1.15, 0.1, 0.0], [0.4, 1.15, 0.1, 0.0]])
    empty: list[list[float]] = [[], [], []]
    names = tuple(joint.name for joint in robot.joints)
    return TrajectoryMessage(
        names, t, q.tolist(), [[0.0] * 4] * 3, accelerations=empty, effort=empty
    )


def test_a_bag_with_two_motions_is_refused(made: Plan, robot: Robot, tmp_path: Path) -> None:
    same = bag(tmp_path / "same", made, message_of(robot), message_of(robot))
    assert "all the same" in read_trajectory(same, robot).notes[0]
    two = bag(tmp_path / "two", made, message_of(robot), message_of(robot, shift=0.01))
    with pytest.raises(TrajectoryError, match="2 different JointTrajectory messages"):
        read_trajectory(two, robot)
    with pytest.raises(TrajectoryError, match="no JointTrajectory and no JointState"):
        read_trajectory(bag(tmp_path / "none", made), robot)


def test_a_bag_of_joint_states_is_the_motion_of_its_states(robot: Robot, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, message = get_typestore(Stores.ROS2_HUMBLE), message_of(robot)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/s", "sensor_msgs/msg/JointState", typestore=store)
        for k, (q, qd) in enumerate(zip(message.positions, message.velocities, strict=True)):
            state = _ros_joint_state(5.0 + k, message.names, np.asarray(q), np.asarray(qd))
            writer.write(topic, k, store.serialize_cdr(state, topic.msgtype))
    reading = read_trajectory(tmp_path / "bag", robot)
    assert any("JointStates of the bag" in note for note in reading.notes)
    samples = reading.trajectory.sample(message.time)
    assert samples.q == pytest.approx(np.array(message.positions))


@pytest.mark.parametrize("key", ["names", "time", "positions", "velocities"])
def test_messages_differ_in_any_of_their_parts(robot: Robot, key: str) -> None:
    one = message_of(robot)
    value = getattr(one, key)
    shorter = replace(one, **{key: value[:-1]})
    turned = value[::-1] if key in ("names", "time") else [[1.0] * 4, *value[1:]]
    changed = replace(one, **{key: turned})
    missing = replace(one, velocities=[[], *one.velocities[1:]])
    assert first_difference(to_plain(one), to_plain(message_of(robot)), "message") is None
    for other in (shorter, changed, missing):
        place = f"message.{'velocities' if other is missing else key}"
        assert (first_difference(to_plain(other), to_plain(one), "message") or "").startswith(place)


def test_times_of_joint_states_count_from_the_first() -> None:
    def state(sec: int, nanosec: int) -> SimpleNamespace:
        header = SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec))
        return SimpleNamespace(name=["a", "b"], position=[1.0, 2.0], velocity=[], header=header)

    made = _message_from_states([state(7, 900_000_000), state(8, 100_000_000), state(10, 0)])
    assert isinstance(made, TrajectoryMessage)
    assert made.time == pytest.approx([0.0, 0.2, 2.1], abs=1e-12)
    assert made.velocities == [[], [], []]
    bad = state(9, 0)
    bad.velocity = [1.0]
    with pytest.raises(TrajectoryError, match="JointState 1: 1 values of velocity for 2 joints"):
        _message_from_states([state(8, 0), bad])


@pytest.mark.parametrize(
    "stamp",
    [
        {"sec": 0.9},
        {"sec": 1, "nanosec": 9e9},
        {"sec": 1, "nanosec": 10**9},
        {"sec": 1, "nanosec": -1},
        {"sec": "2"},
        {"sec": True},
        {"sec": 1e999},
        {"sec": 10**30},
        {"sec": None},
        {"sec": 1, "nsec": 900_000_000},
        {"sec": 1, "nsecs": 900_000_000},
        {"sec": 1, "nanosec": 0, "msec": 900},
        1.5,
        [1, 0],
        None,
    ],
)
def test_a_time_must_be_whole_seconds_and_nanoseconds(stamp: object) -> None:
    point = {"positions": [0.0] * 4, "time_from_start": stamp}
    with pytest.raises(TrajectoryError, match=r"point 0: time_from_start is .* must have whole"):
        parse_message({"joint_names": list("abcd"), "points": [point]}, "t.yaml")
    point["time_from_start"] = {"sec": 2, "nanosec": 999_999_999}
    message = parse_message({"joint_names": list("abcd"), "points": [point]}, "t.yaml")
    assert message.time.tolist() == [2.999999999]


@pytest.mark.parametrize("names", ["roll", {"roll": 1}, ["roll", 3], [None, "tilt"]])
def test_joint_names_are_a_list_of_texts(names: object) -> None:
    with pytest.raises(TrajectoryError, match="joint_names is not a list of names"):
        parse_message({"joint_names": names, "points": []}, "t.yaml")


def test_joints_in_another_order_in_mid_bag(made: Plan, robot: Robot) -> None:
    pytest.importorskip("rosbags")
    names, rows = tuple(joint.name for joint in robot.joints), np.arange(12.0).reshape(3, 4)
    states = [_ros_joint_state(float(k), names, row, 0.1 * row) for k, row in enumerate(rows)]
    turned = _ros_joint_state(1.0, names[::-1], rows[1, ::-1], 0.1 * rows[1, ::-1])
    assert isinstance(complete := _message_from_states(states), TrajectoryMessage)
    assert isinstance(
        mixed := _message_from_states([states[0], turned, states[2]]), TrajectoryMessage
    )
    assert np.array_equal(mixed.positions, complete.positions)
    assert np.array_equal(mixed.velocities, complete.velocities)
    with pytest.raises(TrajectoryError, match="other joints"):
        _message_from_states(
            [states[0], _ros_joint_state(1.0, ("a", "b", "c", "d"), rows[1], rows[1])]
        )


def test_damaged_bags_are_refused(made: Plan, robot: Robot, tmp_path: Path) -> None:
    folder = bag(tmp_path / "bag", made, message_of(robot))
    file = next(folder.glob("*.mcap"))
    data, rng = file.read_bytes(), np.random.default_rng(0)
    for _ in range(100):
        offset = int(rng.integers(len(data)))
        file.write_bytes(
            data[:offset] + bytes([rng.integers(256)]) + data[offset + int(rng.integers(2)) :]
        )
        try:
            read_trajectory(folder, robot)
        except TrajectoryError as error:
            assert str(folder) in str(error)  # noqa: PT017 - most are refused, not all


@pytest.mark.parametrize(
    "text",
    [
        "[" * 40_000,
        "a: &a [*a]",
        "a: !!int x",
        "a: 2001-99-99",
        "joint_names: [roll]\npoints: [{time_from_start: {sec: 1e999}}]",
    ],
)
def test_hostile_yaml_gets_one_message(robot: Robot, tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"t\.yaml"):
        read_trajectory(path, robot)


@pytest.mark.parametrize(
    "value",
    [
        "1e-99999999999999999999",
        "1e99999999999999999999",
        "9" * 400,
        "-" + "9" * 5000,
        "0x10",
        "1_0",
    ],
)
def test_hostile_numbers_in_a_csv(robot: Robot, tmp_path: Path, value: str) -> None:
    path = tmp_path / "t.csv"
    rows = [f"{t},0.3,{1.15 if t else value},0.1,0" for t in range(3)]
    path.write_text("time_s,q1_rad,q2_rad,q3_rad,q4_m\n" + "\n".join(rows), encoding="utf-8")
    status = main(["check", str(path), "--robot", ROBOT])
    assert status == (1 if value.startswith("1e-") else 2)


def test_points_on_a_curve_are_no_other_unit(robot: Robot) -> None:
    from ssm_planner.formats.points import Points, interpolate_points

    t = np.linspace(0.0, 3.0, 31)
    q = np.array([0.3, 1.15, 0.1, -0.01]) + np.outer(np.sin(12 * t) / 40, [1, 1, 1, 0.01])
    qd = np.outer(12 * np.cos(12 * t) / 40, [1, 1, 1, 0.01])
    slope = np.diff(q[:, 0]) / np.diff(t)
    mean = (qd[1:, 0] + qd[:-1, 0]) / 2
    assert abs(slope @ mean / (slope @ slope) - 1) > 0.05
    interpolate_points(Points(t, q, qd), robot)
    with pytest.raises(TrajectoryError, match="degrees where radians are meant"):
        interpolate_points(Points(t, q, np.degrees(qd)), robot)


@pytest.mark.parametrize(
    ("breaks", "size"),
    [([0.0, 1.0], 1e300), ([0.0, 1e-300], 1.0), ([0.0, 1e300], 1.0), ([0.0, 1e8], 1.0)],
)
def test_coefficients_that_overflow_are_no_trajectory(breaks: list[float], size: float) -> None:
    with pytest.raises(TrajectoryError):
        Trajectory(np.array(breaks), np.full((1, 6, 4), size), ())


@pytest.mark.parametrize("close", [">&-", ">/dev/full", "2>&-", "</dev/null"])
def test_streams_that_are_closed_or_plain(robot: Robot, tmp_path: Path, close: str) -> None:
    path = write_plan(tmp_path / "plan.json", robot, trapezoids(robot))
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    command = f"'{sys.executable}' -m ssm_planner check '{path}' {close}"
    run = subprocess.run(
        ["sh", "-c", command], cwd=ROOT, env=environment, capture_output=True, check=False
    )
    assert run.returncode == (2 if "full" in close else 0)
    assert b"Traceback" not in run.stderr
