"""A ROS 2 export contains messages that joint_trajectory_controller accepts, and a bag. The
references are the controller's documented spline, the equations of the drives, and the independent
reader mcap_ros2.
"""

from __future__ import annotations

import dataclasses
import itertools
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from ssm_planner.dynamics.motors import motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.robot_dynamics import motor_torque
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.export import export
from ssm_planner.formats.joint_trajectory import (
    CONTROLLER_REST_SPEED,
    controller_rejections,
    joint_efforts,
    parse_message,
)
from ssm_planner.formats.read import read_trajectory
from ssm_planner.formats.ros2 import _message_from_states, link_poses, quaternion
from ssm_planner.formats.spline_points import JUMP_INTERVAL, spline_points
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from tests.support.paths import RESULTS


def message(path: Path, under: str | None = None) -> dict:
    """Return the content of a YAML file, or the value of one of its keys."""
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    return data if under is None else data[under]


def controller_spline(
    points: list[dict], t: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q, qd and qdd (n, 4) at the times t (s) as joint_trajectory_controller interpolates.

    Points with velocities give cubics, and points with accelerations give quintics. The code
    follows the controller's documentation and is independent of the package.
    """
    times = np.array(
        [p["time_from_start"]["sec"] + p["time_from_start"]["nanosec"] * 1e-9 for p in points]
    )
    q, qd, qdd = [], [], []
    for time in t:
        k = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(points) - 2))
        a, b, h, s = points[k], points[k + 1], times[k + 1] - times[k], time - times[k]
        rows, values = [], []
        for derivative, key in enumerate(("positions", "velocities", "accelerations")):
            if not a[key]:
                continue
            for point, x in ((a, 0.0), (b, h)):
                rows.append((derivative, x))
                values.append(point[key])
        degree = len(rows)
        matrix = np.array(
            [
                [falling(n, d) * (x ** (n - d) if n >= d else 0.0) for n in range(degree)]
                for d, x in rows
            ]
        )
        c = np.linalg.solve(matrix, np.array(values))
        for out, d in ((q, 0), (qd, 1), (qdd, 2)):
            out.append(sum(falling(n, d) * c[n] * s ** (n - d) for n in range(d, degree)))
    return np.array(q), np.array(qd), np.array(qdd)


def falling(n: int, d: int) -> float:
    """Return the falling factorial n (n − 1) … with d factors."""
    return float(np.prod([n - i for i in range(d)])) if d else 1.0


@pytest.mark.parametrize(("which", "keys"), [("plan", 2), ("smooth_plan", 3)])
def test_the_controller_s_own_spline_keeps_the_limits(
    which: str, keys: int, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    source: Plan = request.getfixturevalue(which)
    export(source, "ros2", tmp_path, bag=False)
    points = message(tmp_path / "joint_trajectory.yaml")["points"]
    assert sum(bool(points[1][key]) for key in ("positions", "velocities", "accelerations")) == keys
    duration = (
        points[-1]["time_from_start"]["sec"] + points[-1]["time_from_start"]["nanosec"] * 1e-9
    )
    q, qd, qdd = controller_spline(points, np.linspace(0, duration, 3000))
    for i, joint in enumerate(source.robot.joints):
        low, high = joint.position
        assert q[:, i].min() >= low - 1e-6 * (high - low)
        assert q[:, i].max() <= high + 1e-6 * (high - low)
        assert np.abs(qd[:, i]).max() <= joint.velocity * (1 + 1e-6)
        assert np.abs(qdd[:, i]).max() <= joint.acceleration * (1 + 1e-6)


def test_joint_trajectory_controller_would_accept_it(plan: Plan, tmp_path: Path) -> None:
    """The files satisfy each rule of joint_trajectory_controller."""
    export(plan, "ros2", tmp_path, bag=False)
    for data in (
        message(tmp_path / "joint_trajectory.yaml"),
        message(tmp_path / "goal.yaml", "trajectory"),
    ):
        assert set(data) == {"header", "joint_names", "points"}
        assert set(data["header"]) == {"stamp", "frame_id"}
        assert data["joint_names"] == [joint.name for joint in plan.robot.joints]
        assert set(data["points"][0]) == {
            "positions",
            "velocities",
            "accelerations",
            "effort",
            "time_from_start",
        }
        ticks = [
            p["time_from_start"]["sec"] * 10**9 + p["time_from_start"]["nanosec"]
            for p in data["points"]
        ]
        assert ticks[0] == 0
        assert all(b > a for a, b in itertools.pairwise(ticks))
        assert all(0 <= p["time_from_start"]["nanosec"] < 10**9 for p in data["points"])
        assert max(map(abs, data["points"][-1]["velocities"])) <= CONTROLLER_REST_SPEED
        assert all(not p["effort"] for p in data["points"])
        assert all(len(p["positions"]) == len(p["velocities"]) == 4 for p in data["points"])
        assert all(
            isinstance(x, float) for p in data["points"] for x in p["positions"] + p["velocities"]
        )
        faults, remarks = controller_rejections(parse_message(data, "file"), data["joint_names"])
        assert not faults
        assert not remarks


def efforts_of(plan: Plan, folder: Path, **options: bool) -> tuple[np.ndarray, dict]:
    """Export a plan, and return the efforts (n, 4) of its points and the manifest."""
    _, manifest = export(plan, "ros2", folder, bag=False, **options)
    points = message(folder / "joint_trajectory.yaml")["points"]
    return np.array([p["effort"] for p in points]), manifest


def test_rigid_body_efforts_are_written_on_request(plan: Plan, tmp_path: Path) -> None:
    efforts, manifest = efforts_of(plan, tmp_path, rigid_effort=True)
    law = partial(joint_efforts, plan.robot, True)
    samples = spline_points(plan, plan.certificate, law=law).samples
    expected = RigidBody.from_robot(plan.robot).inverse_dynamics(samples.q, samples.qd, samples.qdd)
    assert efforts == pytest.approx(expected, rel=1e-12, abs=1e-15)
    assert any("effort" in note for note in manifest["notes"])


def test_efforts_are_motor_torques_through_the_drives(plan: Plan, tmp_path: Path) -> None:
    """The efforts agree with the equations of a worm and a screw, and with `motor_torque`."""
    efforts, manifest = efforts_of(plan, tmp_path, effort=True)
    law = partial(joint_efforts, plan.robot, False)
    s = spline_points(plan, plan.certificate, law=law).samples
    rigid = RigidBody.from_robot(plan.robot).inverse_dynamics(s.q, s.qd, s.qdd)
    torque = motor_torque(plan.robot, s.q, s.qd, s.qdd)
    compared = 0
    for i, joint in enumerate(plan.robot.joints):
        drive = joint.drive
        if drive is None:
            assert efforts[:, i] == pytest.approx(rigid[:, i], rel=1e-12, abs=1e-15)
            continue
        moving = np.abs(s.qd[:, i]) > 1e-3 * joint.velocity
        way = np.sign(s.qd[moving, i])
        f = drive.friction
        load = rigid[moving, i] + drive.output_inertia * s.qdd[moving, i]
        load += f.b_oc * way + f.b_ov * s.qd[moving, i]
        phi = np.arctan(f.mu / np.cos(drive.pressure_angle))
        slope = np.tan(drive.lead_angle + np.sign(load * way) * phi)
        expected = (
            drive.input_inertia * drive.ratio * s.qdd[moving, i]
            + f.b_c * way
            + f.b_v * drive.ratio * s.qd[moving, i]
            + drive.gamma * slope * load
        )
        peak = np.abs(expected).max()
        assert efforts[moving, i] / drive.ratio == pytest.approx(expected, abs=1e-9 * peak)
        # The end is excluded, because a joint at rest does not start there again.
        assert efforts[:-1, i] == pytest.approx(drive.ratio * torque[:-1, i], rel=1e-12, abs=1e-15)
        compared += int(moving.sum())
    assert compared > len(s.t)
    assert np.sqrt(np.mean(efforts[:, 0] ** 2)) > 3 * np.sqrt(np.mean(rigid[:, 0] ** 2))
    assert any("effort" in note for note in manifest["notes"])


@pytest.mark.parametrize("name", ["tilt_insert", "eye_approach", "plan", "smooth_plan"])
def test_interpolated_efforts_are_those_of_the_law_except_at_jumps(
    name: str, request: pytest.FixtureRequest
) -> None:
    """The error is at most 1 % of the largest effort. A larger error lasts less than two jump
    intervals. A joint that starts or stops counts as resting while its speed is almost 0.
    """
    if name.endswith("plan"):
        plan: Plan = request.getfixturevalue(name)
    else:
        plan = load_plan(RESULTS / name / "plan.json")
    robot = plan.robot
    law = partial(joint_efforts, robot, False)
    points = spline_points(plan, plan.certificate, law=law)
    written = law(points.samples)
    assert points.certificate.passed
    step = 1e-5
    fine = plan.motion.sample(plan.motion.breaks[0] + np.arange(0, plan.motion.duration, step))
    rigid = RigidBody.from_robot(robot)
    sign = np.where(np.abs(fine.qd) > 1e-9 * robot.velocities, np.sign(fine.qd), 0.0)
    torque = motor_motion(robot, rigid, fine, sign, np.zeros_like(sign)).torque
    efforts = rigid.inverse_dynamics(fine.q, fine.qd, fine.qdd)
    wrong_instants = 0
    for i, joint in enumerate(robot.joints):
        expected = efforts[:, i] if joint.drive is None else joint.drive.ratio * torque[:, i]
        t = (fine.t - plan.motion.breaks[0]) * points.stretch
        error = np.abs(np.interp(t, points.samples.t, written[:, i]) - expected)
        starts = (sign[:, i] == 0) & (np.abs(fine.qdd[:, i]) > 1e-9 * joint.acceleration)
        wrong = (error > 0.01 * np.abs(expected).max() + 1e-9) & ~starts
        ends = np.flatnonzero(np.diff(wrong, prepend=False, append=False)).reshape(-1, 2)
        assert np.ptp(ends, axis=1).max(initial=0) * step < 2 * JUMP_INTERVAL
        wrong_instants += int(wrong.sum())
    assert 0 < wrong_instants * step < 0.01 * plan.motion.duration


def test_the_stretch_is_small_and_stated(plan: Plan, tmp_path: Path) -> None:
    _, manifest = export(plan, "ros2", tmp_path, bag=False)
    assert 1.0 <= manifest["stretch"] < 1.0001
    assert manifest["spline"]["certificate"]["passed"]


def test_the_bag_is_read_by_an_independent_library(
    plan: Plan, robot: Robot, tmp_path: Path
) -> None:
    pytest.importorskip(
        "mcap_ros2", reason="the package mcap-ros2-support (extra test) reads the bag"
    )
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    rate = 50.0
    export(plan, "ros2", tmp_path, rate=rate)
    result: dict[str, list] = {}
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        for _, channel, raw, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            result.setdefault(channel.topic, []).append((raw.log_time, decoded))
    assert set(result) == {"/robot_description", "/joint_trajectory", "/joint_states", "/tf"}
    points = message(tmp_path / "joint_trajectory.yaml")["points"]
    (_, trajectory), *rest = result["/joint_trajectory"]
    assert not rest
    assert list(trajectory.joint_names) == [joint.name for joint in robot.joints]
    assert len(trajectory.points) == len(points)
    for mine, theirs in zip(points, trajectory.points, strict=True):
        assert list(theirs.positions) == mine["positions"]
        assert list(theirs.velocities) == mine["velocities"]
        assert theirs.time_from_start.nanosec == mine["time_from_start"]["nanosec"]
    assert "<robot name=" in result["/robot_description"][0][1].data
    states = result["/joint_states"]
    assert len(states) == int(plan.trajectory.duration * rate) + 2
    mechanism = Mechanism.from_geometry(robot.geometry)
    for (stamp, state), (_, transforms) in zip(states, result["/tf"], strict=True):
        assert list(state.name) == [joint.name for joint in robot.joints]
        t = np.array([min(stamp * 1e-9, plan.trajectory.duration)])
        assert np.array(state.position) == pytest.approx(plan.trajectory.sample(t).q[0], abs=1e-8)
        assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == stamp
        assert not len(state.effort)
        pose = np.eye(4)
        for item in transforms.transforms:
            r, p = item.transform.rotation, item.transform.translation
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = matrix_of(r.x, r.y, r.z, r.w), (p.x, p.y, p.z)
            pose = pose @ step
        assert item.child_frame_id == "tool"
        turned, tip = forward(mechanism, np.array(state.position)[None])
        assert np.abs(pose[:3, :3] - turned[0]).max() <= 1e-12
        assert np.abs(pose[:3, 3] - tip[0]).max() <= 1e-12


def matrix_of(x: float, y: float, z: float, w: float) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_quaternions_of_all_rotations() -> None:
    rng = np.random.default_rng(0)
    axes = [*np.eye(3), *rng.normal(size=(30, 3))]
    for axis in axes:
        for angle in (0.0, np.pi, -np.pi, np.pi - 1e-9, *rng.uniform(-4, 4, 5)):
            matrix = rotation(axis / np.linalg.norm(axis), angle)
            assert np.abs(matrix_of(*quaternion(matrix)) - matrix).max() <= 1e-14


def test_link_poses_chain_to_the_tool(robot: Robot) -> None:
    q = np.array([0.3, 0.7, -1.1, -0.02])
    turned, tip = np.eye(3), np.zeros(3)
    for _, _, r, p in link_poses(robot, q):
        tip = tip + turned @ p
        turned = turned @ r
    expected = forward(Mechanism.from_geometry(robot.geometry), q[None])
    assert np.abs(turned - expected[0][0]).max() <= 1e-14
    assert np.abs(tip - expected[1][0]).max() <= 1e-14


def test_without_the_package_rosbags_the_message_says_how_to_get_it(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("rosbags", "rosbags.rosbag2", "rosbags.typesys"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ExportError, match=r"pip install 'ssm-planner\[ros2\]' .*--no-bag"):
        export(plan, "ros2", tmp_path / "ros2", bag=True)
    assert not list(tmp_path.iterdir())
    for options in ({}, {"bag": False}):
        files, manifest = export(plan, "ros2", tmp_path / "ros2", **options)
        assert set(files) == {"joint_trajectory.yaml", "goal.yaml", "manifest"}
        left_out = [note for note in manifest["notes"] if "pip install" in note]
        assert len(left_out) == (0 if options else 1)


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e6, float("nan")])
def test_rates_that_make_no_bag(plan: Plan, tmp_path: Path, rate: float) -> None:
    with pytest.raises(ExportError, match=r"rate .* is out of range"):
        export(plan, "ros2", tmp_path / "x", rate=rate)


def test_a_spline_that_no_points_mend_is_refused(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A spline that exceeds its limits by more than the largest slowdown can correct is refused."""
    monkeypatch.setattr("ssm_planner.formats.spline_points.DIVISIONS", (1,))
    monkeypatch.setattr("ssm_planner.formats.spline_points.LARGEST_SLOWDOWN", 1e-9)
    joints = tuple(
        dataclasses.replace(joint, velocity=joint.velocity * 0.96)
        if joint.name == "tilt"
        else joint
        for joint in plan.robot.joints
    )
    slower = dataclasses.replace(
        plan,
        problem=dataclasses.replace(
            plan.problem, robot=dataclasses.replace(plan.robot, joints=joints)
        ),
    )
    with pytest.raises(ExportError, match=r"exceeds the velocity limit of tilt by 1\.\d+ %"):
        spline_points(slower, plan.certificate)


def test_a_late_subscriber_receives_the_description_of_the_robot(
    plan: Plan, tmp_path: Path
) -> None:
    """The topic of the description is reliable and transient local, with one message.

    The other topics declare no quality of service.
    """
    export(plan, "ros2", tmp_path, rate=20.0)
    metadata = yaml.safe_load((tmp_path / "bag/metadata.yaml").read_text(encoding="utf-8"))
    topics = {
        entry["topic_metadata"]["name"]: entry["topic_metadata"]["offered_qos_profiles"]
        for entry in metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    }
    assert not any(topics.pop(name) for name in ("/joint_trajectory", "/joint_states", "/tf"))
    (profiles,) = topics.values()
    (quality,) = yaml.safe_load(profiles) if isinstance(profiles, str) else profiles
    assert quality["depth"] == 1
    assert str(quality["history"]) in ("1", "keep_last")
    assert str(quality["reliability"]) in ("1", "reliable")
    assert str(quality["durability"]) in ("1", "transient_local")
    never = {"sec": 2**31 - 1, "nsec": 2**32 - 1}
    assert quality["deadline"] == quality["lifespan"] == never
    assert quality["avoid_ros_namespace_conventions"] is False


def test_a_bag_with_one_motion_needs_no_note(plan: Plan, robot: Robot, tmp_path: Path) -> None:
    export(plan, "ros2", tmp_path, rate=20.0)
    assert read_trajectory(tmp_path / "bag", robot).notes == ()


@pytest.mark.parametrize(
    ("duration", "rate", "count"),
    [(1.0, 10.0, 11), (1.05, 10.0, 12), (0.3, 1000.0, 301), (0.7, 10.0, 8), (0.01, 10.0, 2)],
)
def test_states_are_those_of_the_rate_and_the_end(duration: float, rate: float, count: int) -> None:
    """States lie at multiples of the period and at the end.

    Rounding errors of the duration do not add or remove a state.
    """
    for rounding in (-1e-15, 0.0, 1e-15):
        breaks = np.array([0.0, duration + rounding])
        t = Trajectory(breaks, np.zeros((1, 6, 4)), ()).uniform(rate).t
        assert len(t) == count
        assert t[:-1] == pytest.approx(np.arange(count - 1) / rate)
        assert t[-1] == pytest.approx(duration)


def test_rates_of_a_bag_up_to_the_largest(plan: Plan, tmp_path: Path) -> None:
    _, manifest = export(plan, "ros2", tmp_path, rate=1000.0, bag=False)
    assert manifest["rate_hz"] == 1000.0
    with pytest.raises(ExportError, match=r"rate 1000\.1 Hz is out of range .allowed: above 0, up"):
        export(plan, "ros2", tmp_path, rate=1000.1, bag=False)


def test_a_message_that_a_controller_would_reject_is_not_exported(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults = ["point 3: a fault", "another"]
    monkeypatch.setattr("ssm_planner.formats.ros2.controller_rejections", lambda *_: (faults, []))
    with pytest.raises(ExportError, match=r"would reject the trajectory: point 3: a fault$"):
        export(plan, "ros2", tmp_path / "x", bag=False)
    assert not list(tmp_path.iterdir())


def test_comments_name_the_plan(plan: Plan, bad_plan: Plan, tmp_path: Path) -> None:
    for source, mark in ((plan, ""), (bad_plan, "_unverified")):
        _, manifest = export(source, "ros2", tmp_path, bag=False, force=True)
        for name in ("joint_trajectory", "goal"):
            text = (tmp_path / f"{name}{mark}.yaml").read_text(encoding="utf-8")
            comments = [line for line in text.splitlines() if line.startswith("# ")]
            assert ("UNVERIFIED" in comments[0]) == bool(mark)
            assert f"SHA-256 {source.sha256}" in comments[bool(mark)]
            assert comments[1 + bool(mark)] == f"# {manifest['notes'][0]}."
            assert ("ros2 topic pub" in text) == (name == "joint_trajectory")


def test_a_changed_bag_of_an_export_is_refused(plan: Plan, robot: Robot, tmp_path: Path) -> None:
    """Reading a bag compares its files with the manifest of the export, but not the files outside
    the bag.
    """
    export(plan, "ros2", tmp_path, rate=20.0)
    (tmp_path / "goal.yaml").write_text("changed", encoding="utf-8")
    assert read_trajectory(tmp_path / "bag", robot).trajectory.duration > 0
    (file,) = (tmp_path / "bag").glob("*.mcap")
    file.write_bytes(file.read_bytes() + b" ")
    with pytest.raises(TrajectoryError, match=r"bag\.mcap: the file was modified after the exp"):
        read_trajectory(tmp_path / "bag", robot)


def test_joint_states_have_positions() -> None:
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    for count in (0, 1, 3):
        state = SimpleNamespace(name=["a", "b"], position=[0.0] * count, velocity=[], header=header)
        with pytest.raises(TrajectoryError, match=f"0: {count} values of position for 2 joints"):
            _message_from_states([state])
