"""An export for EPOS4 drives reproduces its plan. The references are the sampled plan, the
equations of the motors, and simulated CANopen drives that receive the exported streams.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import json
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.csv import read_columns
from ssm_planner.formats.epos4 import (
    _integer_streams,
    _joint_offsets,
    period_ms,
    setpoint_times,
)
from ssm_planner.formats.epos4_setup import drive_axes
from ssm_planner.formats.export import export
from ssm_planner.formats.read import read_trajectory
from ssm_planner.plans import Plan
from ssm_planner.problem.controller import Controller
from ssm_planner.problem.robot import Robot
from ssm_planner.simulation.simulate import Scenario, _Simulation
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.ends import end_velocities
from tests.support.plans import certified, read_back, trapezoids

COUNTS = 4096
DRIVEN = ("roll", "tilt", "insertion")


def stream(folder: Path, joint: str) -> dict[str, np.ndarray]:
    """Return the columns of the exported table of a joint by name, (n,) each."""
    path = folder / f"{joint}.csv"
    names = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def objects(folder: Path, joint: str) -> dict[tuple[int, int], int]:
    """Return the values of the set-up objects of a joint by (index, subindex)."""
    with (folder / "objects.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["joint"] == joint]
    assert all(row["reason"] for row in rows)
    return {
        (int(row["object"][:6], 16), int(row["object"][7:], 16)): int(row["value"], 0)
        for row in rows
    }


def test_positions_are_the_plan_s_to_half_an_increment(plan: Plan, tmp_path: Path) -> None:
    for rate in (1000.0, 250.0, 100.0):
        _, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, rate=rate)
        for i, joint in enumerate(plan.robot.joints):
            if joint.drive is None:
                continue
            rows = stream(tmp_path, joint.name)
            t = rows["time_s"]
            assert np.diff(t) == pytest.approx(1 / rate, abs=1e-9)
            exact = plan.trajectory.sample(np.minimum(t, plan.trajectory.duration)).q[:, i]
            per_unit = joint.drive.ratio * COUNTS / (2 * np.pi)
            counts = rows["target_position_inc"]
            assert np.abs(counts - exact * per_unit).max() <= 0.5 + 1e-9
            assert counts[-1] == round(
                float(plan.trajectory.sample(plan.trajectory.breaks[-1:]).q[0, i] * per_unit)
            )
            effects = manifest["axes"][joint.name]["rounding"]
            assert effects["position"] <= 0.5 / per_unit * (1 + 1e-9)
            assert effects["speed"] <= rate / per_unit * (1 + 1e-9)
            assert effects["acceleration"] <= 2 * rate**2 / per_unit * (1 + 1e-9)


def test_the_published_scale(plan: Plan, tmp_path: Path) -> None:
    """Encoders of 1024 counts give 78 227.8 increments per rad of joints 1 and 2, and 3 359.58 per
    mm of joint 4.
    """
    _, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS)
    scales = [manifest["axes"][name]["increments_per_unit"] for name in DRIVEN]
    assert scales == pytest.approx([78227.8, 78227.8, 3359.58e3], rel=1e-6)


def test_offsets_are_the_motors_speed_and_torque(plan: Plan, tmp_path: Path) -> None:
    export(plan, "epos4", tmp_path, counts_per_turn=COUNTS)
    for i, joint in enumerate(plan.robot.joints):
        if joint.drive is None:
            continue
        rows = stream(tmp_path, joint.name)
        inside = rows["time_s"] < plan.trajectory.duration
        samples = plan.trajectory.sample(rows["time_s"][inside])
        direction, breakaway = motion_directions(plan.robot, samples, 1)
        motor = motor_motion(
            plan.robot, RigidBody.from_robot(plan.robot), samples, direction, breakaway
        )
        rpm = motor.speed[:, i] * 60 / (2 * np.pi)
        assert np.abs(rows["velocity_offset_mrpm"][inside] / 1000 - rpm).max() <= 0.0005 + 1e-9
        share = motor.torque[:, i] / joint.motor.nominal_torque
        assert np.abs(rows["torque_offset_permille"][inside] / 1000 - share).max() <= 0.0005 + 1e-9
        assert rows["velocity_offset_mrpm"][-1] == 0
        assert rows["torque_offset_permille"][-1] == 0


def test_rounding_does_not_add_up(plan: Plan, tmp_path: Path) -> None:
    """The velocity offsets integrate to the travel of the positions, so rounding errors do not
    accumulate.
    """
    export(plan, "epos4", tmp_path, counts_per_turn=COUNTS)
    rows = stream(tmp_path, "roll")
    turns = np.trapezoid(rows["velocity_offset_mrpm"] / 60000, rows["time_s"])
    travel = (rows["target_position_inc"][-1] - rows["target_position_inc"][0]) / COUNTS
    assert turns == pytest.approx(travel, rel=1e-4)


def test_the_direction_of_the_motor(plan: Plan, tmp_path: Path) -> None:
    joints = tuple(dataclasses.replace(joint, motor_direction=-1) for joint in plan.robot.joints)
    reversed_plan = dataclasses.replace(
        plan,
        problem=dataclasses.replace(
            plan.problem, robot=dataclasses.replace(plan.robot, joints=joints)
        ),
    )
    reversed_plan = certified(reversed_plan)
    export(plan, "epos4", tmp_path / "a", counts_per_turn=COUNTS)
    export(reversed_plan, "epos4", tmp_path / "b", counts_per_turn=COUNTS)
    for name in DRIVEN:
        a, b = stream(tmp_path / "a", name), stream(tmp_path / "b", name)
        for column in ("target_position_inc", "velocity_offset_mrpm", "torque_offset_permille"):
            assert np.array_equal(a[column], -b[column])
        limits = objects(tmp_path / "b", name)
        assert limits[0x607D, 1] <= b["target_position_inc"].min()
        assert limits[0x607D, 2] >= b["target_position_inc"].max()
    back = read_trajectory(tmp_path / "b", reversed_plan.robot)
    assert back.trajectory.coefficients[0, 0] == pytest.approx(
        plan.trajectory.coefficients[0, 0], abs=1e-5
    )


def with_encoders(plan: Plan, counts: int | None) -> Plan:
    """Return the certified plan with the given encoder counts at every motor. None removes the
    counts.
    """
    joints = tuple(
        dataclasses.replace(
            joint,
            motor=None
            if joint.motor is None
            else dataclasses.replace(
                joint.motor, encoder_counts=counts, placeholders=(), file="some_motor.yaml"
            ),
        )
        for joint in plan.robot.joints
    )
    robot = dataclasses.replace(plan.robot, joints=joints)
    return certified(
        dataclasses.replace(plan, problem=dataclasses.replace(plan.problem, robot=robot))
    )


def test_encoder_counts_from_the_motor_file(plan: Plan, tmp_path: Path) -> None:
    _, manifest = export(plan, "epos4", tmp_path)
    for name in DRIVEN:
        assert manifest["axes"][name]["increments_per_motor_turn"] == COUNTS
        assert manifest["axes"][name]["encoder"].startswith("PLACEHOLDER: not known")
        assert any(
            f"joint {name}: its increments use a placeholder value" in x for x in manifest["notes"]
        )
    bare = with_encoders(plan, None)
    with pytest.raises(
        ExportError, match=r"some_motor\.yaml: encoder_counts is missing .*--counts-per-turn"
    ):
        export(bare, "epos4", tmp_path)
    with pytest.raises(ExportError, match="motor of joint insertion"):
        export(bare, "epos4", tmp_path, counts_per_turn={"roll": COUNTS, "tilt": COUNTS})
    _, manifest = export(with_encoders(plan, 512), "epos4", tmp_path)
    assert manifest["axes"]["roll"]["increments_per_motor_turn"] == 2048
    assert not any("encoder" in note for note in manifest["notes"])


def test_unverified_objects_are_marked(plan: Plan, tmp_path: Path) -> None:
    """The export marks each object whose number, unit or effect is quoted from no source. The
    manifest lists these objects under `not_verified`.
    """
    _, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS)
    with (tmp_path / "objects.csv").open(encoding="utf-8", newline="") as file:
        marked = {row["object"] for row in csv.DictReader(file) if row["known"] != "quoted"}
    mapped = [entry for pdo in manifest["pdo"]["receive"] for entry in pdo["objects"]]
    marked |= {entry["object"] for entry in mapped if entry["known"] != "quoted"}
    assert marked == {"0x6080:00", "0x60B1:00"}
    said = " ".join(manifest["not_verified"])
    assert all(key[:6] in said for key in (*marked, "0x60C5", "0x30B0"))


def test_modes_of_velocity_and_torque(plan: Plan, tmp_path: Path) -> None:
    for mode, code, columns in (
        ("csv", 9, {"time_s", "target_velocity_mrpm", "torque_offset_permille"}),
        ("cst", 10, {"time_s", "target_torque_permille"}),
    ):
        export(plan, "epos4", tmp_path / mode, counts_per_turn=COUNTS, mode=mode)
        assert set(stream(tmp_path / mode, "roll")) == columns
        assert objects(tmp_path / mode, "roll")[0x6060, 0] == code
        with pytest.raises(TrajectoryError, match="hold no positions"):
            read_trajectory(tmp_path / mode, plan.robot)
    with pytest.raises(ExportError, match=r"unknown mode 'ppm' .allowed: csp, csv, cst"):
        export(plan, "epos4", tmp_path / "x", counts_per_turn=COUNTS, mode="ppm")


def test_the_form_that_plain_clients_read(plan: Plan, tmp_path: Path) -> None:
    """A time_position file has two columns, and its positions are whole increments."""
    export(plan, "epos4", tmp_path, counts_per_turn=COUNTS)
    lines = (tmp_path / "roll_time_position.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "time,position"
    assert all(
        len(line.split(",")) == 2 and line.split(",")[1].lstrip("-").isdigit() for line in lines[1:]
    )


@pytest.mark.parametrize(
    ("rate", "period"), [(1000.0, 1), (500.0, 2), (333.3333333333333, 3), (10.0, 100), (250.0, 4)]
)
def test_rates_that_are_whole_milliseconds(rate: float, period: int) -> None:
    assert period_ms(rate) == period


@pytest.mark.parametrize("rate", [300.0, 2000.0, 5.0, 0.0, -1.0, float("nan"), float("inf"), 999.0])
def test_rates_that_are_not(rate: float) -> None:
    with pytest.raises(ExportError, match="whole ms from 1 to 100"):
        period_ms(rate)


def changed(plan: Plan, **motor: float) -> Plan:
    """Return the plan with changed values of the motor of joint 1."""
    joint = plan.robot.joints[0]
    joint = dataclasses.replace(joint, motor=dataclasses.replace(joint.motor, **motor))
    return dataclasses.replace(
        plan,
        problem=dataclasses.replace(
            plan.problem,
            robot=dataclasses.replace(plan.robot, joints=(joint, *plan.robot.joints[1:])),
        ),
    )


def test_numbers_that_do_not_fit_their_objects(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(
        ExportError,
        match=r"joint roll: torque of .* per mille of rated torque \(INT16\) does not fit",
    ):
        # No motor with such a nominal torque passes the check, so the export needs `force`.
        export(
            changed(plan, nominal_torque=1e-6),
            "epos4",
            tmp_path / "x",
            force=True,
            counts_per_turn=COUNTS,
        )
    with pytest.raises(
        ExportError, match=r"joint roll: target position of .* increments does not fit"
    ):
        export(plan, "epos4", tmp_path / "x", counts_per_turn=10**9)
    assert not list(tmp_path.iterdir())


def test_limits_inside_the_drive_leave_room_for_the_stream(plan: Plan, tmp_path: Path) -> None:
    for rate in (1000.0, 100.0):
        _, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, rate=rate)
        for name in DRIVEN:
            counts, values = stream(tmp_path, name)["target_position_inc"], objects(tmp_path, name)
            assert values[0x607D, 1] <= counts.min() <= counts.max() <= values[0x607D, 2]
            speed = np.abs(np.diff(counts)) * rate / COUNTS * 60
            assert speed.max() <= values[0x607F, 0] / 1000
            acceleration = np.abs(np.diff(counts, 2)) * rate**2 / COUNTS * 60
            limit = next(j for j in plan.robot.joints if j.name == name).acceleration
            per_unit = abs(manifest["axes"][name]["increments_per_unit"])
            assert 0 <= values[0x60C5, 0] - limit * per_unit / COUNTS * 60 + 1e-6 < 1.1
            rounding = manifest["axes"][name]["rounding"]["acceleration"] * per_unit / COUNTS * 60
            assert acceleration.max() <= (values[0x60C5, 0] + rounding) * (1 + 1e-9)
            assert np.abs(np.diff(counts)).max() < values[0x6065, 0]
            assert values[0x60C2, 1] == 1000 / rate
            assert values[0x60C2, 2] == -3


@pytest.mark.parametrize("mode", ["csp", "csv", "cst"])
def test_homing_pdo_mapping_and_sync(mode: str, plan: Plan, tmp_path: Path) -> None:
    _, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, mode=mode, rate=500.0)
    assert manifest["sync"]["period_ms"] == manifest["interpolation_period_ms"] == 2
    assert [pdo["transmission_type"] for pdo in manifest["pdo"]["receive"]][:2] == [255, 1]
    for pdos in manifest["pdo"].values():
        assert len(pdos) <= 4
        for pdo in pdos:
            assert sum(entry["bits"] for entry in pdo["objects"]) <= 64
            for entry in pdo["objects"]:
                index, sub, bits = (
                    int(entry["value"][2:6], 16),
                    int(entry["value"][6:8], 16),
                    int(entry["value"][8:], 16),
                )
                assert entry["object"] == f"0x{index:04X}:{sub:02X}"
                assert bits == entry["bits"]
    mapped = {entry["object"] for pdo in manifest["pdo"]["receive"] for entry in pdo["objects"]}
    target = {"csp": "0x607A:00", "csv": "0x60FF:00", "cst": "0x6071:00"}[mode]
    assert {"0x6040:00", "0x6060:00", target} <= mapped
    for i, joint in enumerate(plan.robot.joints):
        if joint.name in DRIVEN:
            axis = manifest["axes"][joint.name]
            start = plan.trajectory.sample(plan.trajectory.breaks[:1]).q[0, i]
            assert (
                abs(axis["homing"]["home_position"]["value"] - start * axis["increments_per_unit"])
                <= 0.5 + 1e-9
            )


def test_a_joint_without_drive_is_named(plan: Plan, tmp_path: Path) -> None:
    _, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS)
    assert any("joint spin has no drive and no stream" in note for note in manifest["notes"])
    assert any("placeholder" in note for note in manifest["notes"])
    # The manifest keeps the notes on the joints after it.
    for name in ("roll", "tilt", "insertion"):
        assert any(f"joint {name}: " in note and "rounding" in note for note in manifest["notes"])


# --- Playback to simulated drives ---


def map_pdos(node, mapping: dict) -> None:
    """Map the PDOs of a client's node as the manifest describes. This configures the drive, too."""
    for pdos, exported in ((node.rpdo, mapping["receive"]), (node.tpdo, mapping["transmit"])):
        for number, pdo in enumerate(exported, start=1):
            target = pdos[number]
            target.clear()
            for entry in pdo["objects"]:
                index, sub = (int(part, 16) for part in entry["object"].split(":"))
                target.add_variable(index, sub, entry["bits"])
            target.cob_id = int(pdo["cob_id"].split()[0], 16) + node.id
            target.trans_type, target.enabled = pdo["transmission_type"], True
            target.save()
            assert [m.raw for m in node.sdo[int(pdo["mapping"], 16)].values()][
                : len(pdo["objects"])
            ] == [int(entry["value"], 16) for entry in pdo["objects"]]


@contextmanager
def bench(folder: Path, channel: str, rated: dict[str, float]) -> Iterator[tuple[dict, dict]]:
    """Yield the drives and the clients of the driven joints, by joint name, on one virtual bus.

    They are set up, mapped and homed as the export describes.
    """
    canopen = pytest.importorskip(
        "canopen", reason="the package canopen (extra test) plays the client"
    )
    from canopen.profiles.p402 import BaseNode402

    from tests.support.simulated_drive import SimulatedDrive, dictionary

    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    network = canopen.Network()
    # The bus keeps the timestamps of the sender, so a busy machine changes no period.
    network.connect(interface="virtual", channel=channel, preserve_timestamps=True)
    drives, clients = {}, {}
    try:
        for number, joint in enumerate(DRIVEN, start=1):
            drives[joint] = SimulatedDrive(
                channel, number, position=17, rated_torque=round(rated[joint] * 1e6)
            )
            clients[joint] = network.add_node(BaseNode402(number, dictionary(number)))
        for joint, node in clients.items():
            node.nmt.state = "PRE-OPERATIONAL"
            map_pdos(node, manifest["pdo"])
            node.setup_402_state_machine()
            for (index, sub), value in objects(folder, joint).items():
                variable = node.sdo[index] if sub == 0 else node.sdo[index][sub]
                if index == 0x6076:
                    assert variable.raw == value
                elif index != 0x6060:
                    variable.raw = value
            node.nmt.state = "OPERATIONAL"
            node.op_mode = "HOMING"
            node.state = "OPERATION ENABLED"
            homing = manifest["axes"][joint]["homing"]
            for entry in (homing["home_position"], homing["home_offset"], homing["method"]):
                node.sdo[int(entry["object"][:6], 16)].raw = entry["value"]
            node.controlword = 0x1F
            assert settled(lambda node=node: node.statusword & 0x1400 == 0x1400)
            assert node.sdo[0x6064].raw == stream(folder, joint)["target_position_inc"][0]
            node.controlword = 0x0F
            node.op_mode = "CYCLIC SYNCHRONOUS POSITION"
        yield drives, clients
    finally:
        network.disconnect()
        for drive in drives.values():
            drive.close()


COLUMNS = {
    0x607A: "target_position_inc",
    0x60B1: "velocity_offset_mrpm",
    0x60B2: "torque_offset_permille",
}


def play(folder: Path, clients: dict, period: float) -> None:
    """Send one row of each stream and one SYNC every period (s). Stop early when a drive reports a
    fault.
    """
    import can

    streams = {joint: stream(folder, joint) for joint in clients}
    network = next(iter(clients.values())).network
    for k in range(len(streams["roll"]["time_s"])):
        for joint, node in clients.items():
            for pdo in node.rpdo.values():
                columns = [COLUMNS.get(variable.index) for variable in pdo]
                for variable, column in zip(pdo, columns, strict=True):
                    if column is not None:
                        variable.raw = int(streams[joint][column][k])
                if any(columns):
                    pdo.transmit()
        sync = can.Message(arbitration_id=0x80, is_extended_id=False, timestamp=k * period)
        network.bus.send(sync)
        if any(node.state == "FAULT" for node in clients.values()):
            return


def settled(condition) -> bool:
    """Wait at most 20 s for the condition, because messages may be under way. Return its value."""
    end = time.monotonic() + 20
    while time.monotonic() < end and not condition():
        time.sleep(0.005)
    return condition()


def rated_torques(robot: Robot) -> dict[str, float]:
    """Return the nominal torque (N·m) of every motor by the name of its joint."""
    return {
        joint.name: joint.motor.nominal_torque for joint in robot.joints if joint.motor is not None
    }


LOOP_PERIOD = 4e-4


def told_to_simulation(plan: Plan) -> np.ndarray:
    """Return the motor angles in rad (periods, 4) that `simulate` demands of its drives."""
    return _Simulation(
        plan, Scenario(), Controller(loop_period=LOOP_PERIOD, counts_per_turn=COUNTS)
    ).commands.demand


def test_simulated_drives_receive_the_plan(plan: Plan, tmp_path: Path) -> None:
    """Drives that the client of canopen enables in CSP mode receive every setpoint."""
    export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, rate=250.0)
    with bench(tmp_path, "played", rated_torques(plan.robot)) as (drives, clients):
        assert all(node.state == "OPERATION ENABLED" for node in clients.values())
        play(tmp_path, clients, 0.004)
        count = len(stream(tmp_path, "roll")["time_s"])
        assert settled(lambda: all(len(drive.received) == count for drive in drives.values()))
        assert all(node.state == "OPERATION ENABLED" for node in clients.values())
        for i, joint in enumerate(plan.robot.joints):
            if joint.name not in drives:
                continue
            received = np.array(drives[joint.name].received)
            t = np.minimum(np.arange(count) * 0.004, plan.trajectory.duration)
            exact = plan.trajectory.sample(t).q[:, i] * joint.drive.ratio * COUNTS / (2 * np.pi)
            assert np.abs(received[:, 0] - exact).max() <= 0.5 + 1e-9
            assert received[-1, 0] == round(float(exact[-1]))
            rows = stream(tmp_path, joint.name)
            assert np.array_equal(received[:, 1], rows["velocity_offset_mrpm"])
            assert np.array_equal(received[:, 2], rows["torque_offset_permille"])
            assert abs(drives[joint.name].position - exact[-1]) <= 1
            # At every SYNC, `simulate` demands the same position to within an increment.
            setpoints = told_to_simulation(plan)[:: round(0.004 / LOOP_PERIOD), i][:count]
            increments = setpoints * joint.motor_direction * COUNTS / (2 * np.pi)
            assert len(setpoints) >= count - 1
            assert np.abs(received[: len(setpoints), 0] - increments).max() <= 1
            reported, target = clients[joint.name].tpdo[2][0], int(received[-1, 0])
            assert settled(lambda reported=reported, target=target: reported.raw == target)


def test_a_mismatched_period_is_refused_and_seen(plan: Plan, tmp_path: Path) -> None:
    """A drive that expects a SYNC every 10 ms and gets one every 4 ms goes to fault."""
    from tests.support.simulated_drive import PERIOD_FAULT

    export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, rate=100.0)
    with bench(tmp_path, "period", rated_torques(plan.robot)) as (drives, clients):
        play(tmp_path, clients, 0.004)
        assert settled(lambda: any(drive.fault == PERIOD_FAULT for drive in drives.values()))
        assert settled(lambda: any(node.state == "FAULT" for node in clients.values()))
        assert settled(
            lambda: any(
                log.code == PERIOD_FAULT for node in clients.values() for log in node.emcy.log
            )
        )


def test_a_limit_overrun_is_refused_and_seen(plan: Plan, tmp_path: Path) -> None:
    """A target beyond the software position limit causes a fault, and the drive does not execute
    it.
    """
    from tests.support.simulated_drive import LIMIT_FAULT

    export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, rate=250.0)
    path = tmp_path / "insertion.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    limit = objects(tmp_path, "insertion")[0x607D, 2]
    lines[6] = ",".join([lines[6].split(",")[0], str(limit + 1), "0", "0"])
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with bench(tmp_path, "limit", rated_torques(plan.robot)) as (drives, clients):
        play(tmp_path, clients, 0.004)
        assert settled(lambda: drives["insertion"].fault == LIMIT_FAULT)
        assert settled(lambda: clients["insertion"].state == "FAULT")
        assert len(drives["insertion"].received) == 5
        assert max(target for target, *_ in drives["insertion"].received) <= limit


def test_the_manifest_names_the_stream_of_every_axis(
    plan: Plan, tmp_path: Path, robot: Robot
) -> None:
    export(plan, "epos4", tmp_path, counts_per_turn=COUNTS)
    manifest = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    assert set(manifest["axes"]) == {joint.name for joint in robot.joints}
    for file in (None, "other.csv", "../insertion.csv"):
        changed = json.loads(json.dumps(manifest))
        changed["axes"]["insertion"]["file"] = file
        (tmp_path / "manifest.json").write_text(json.dumps(changed), encoding="utf-8")
        with pytest.raises(TrajectoryError, match=r"insertion\.file is|was modified"):
            read_trajectory(tmp_path, robot)
    manifest["axes"].pop("spin")
    (tmp_path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"axes\.spin is None"):
        read_trajectory(tmp_path, robot)


@pytest.mark.parametrize("moving", ["begins", "ends"])
def test_only_a_motion_that_ends_moving_has_to_be_continued(
    plan: Plan, robot: Robot, tmp_path: Path, moving: str
) -> None:
    """A motion that ends moving is stretched so that it ends at a setpoint, and a note reports its
    final speeds. A motion that ends at rest gets no such note.
    """
    complete = plan.motion
    half = len(complete.breaks) // 3
    rows = slice(None, half) if moving == "ends" else slice(half, None)
    breaks = complete.breaks[: half + 1] if moving == "ends" else complete.breaks[half:]
    part = Trajectory(breaks, complete.coefficients[rows], ())
    cut = certified(dataclasses.replace(plan, trajectory=part))
    _, manifest = export(cut, "epos4", tmp_path, force=True, counts_per_turn=COUNTS, rate=125.0)
    notes = [note for note in manifest["notes"] if "the motion ends moving" in note]
    assert len(notes) == (moving == "ends")
    last = stream(tmp_path, "tilt_unverified")["time_s"][-1]
    speeds = end_velocities(part)[1]
    assert (manifest["stretch"] > 1) == (moving == "ends")
    assert manifest["stretch"] * part.duration <= last + 1e-12
    for i, joint in enumerate(robot.joints):
        if joint.drive is None:
            continue
        speed = stream(tmp_path, f"{joint.name}_unverified")["velocity_offset_mrpm"][-1]
        expected = speeds[i] / manifest["stretch"] * joint.drive.ratio * 60_000 / (2 * np.pi)
        assert speed == pytest.approx(joint.motor_direction * expected, abs=0.51)
        if moving == "ends" and abs(speeds[i]) > 1e-6:
            assert f"{joint.name} at {speeds[i]:.4g} {joint.unit}/s" in notes[0]


def test_a_plan_that_ends_between_setpoints(robot: Robot, tmp_path: Path) -> None:
    """The last setpoint equals the target and lies at or after the end of the plan."""
    plan = read_back(
        tmp_path / "plan.json", robot, trapezoids(robot, (np.array([0.0001, 0.0, 0.0, 0.0]),))
    )
    assert (plan.trajectory.duration * 1000) % 10 > 0.01
    export(plan, "epos4", tmp_path / "e", counts_per_turn=COUNTS, rate=100.0)
    rows = stream(tmp_path / "e", "roll")
    assert rows["time_s"][-1] >= plan.trajectory.duration
    assert rows["target_position_inc"][-1] == round(0.3001 * 78227.8)


def test_the_time_at_which_a_plan_starts_is_of_no_account(plan: Plan, tmp_path: Path) -> None:
    later = Trajectory(plan.motion.breaks + 7.0, plan.motion.coefficients, ())
    moved = certified(dataclasses.replace(plan, trajectory=later))
    for source, name in ((plan, "a"), (moved, "b")):
        export(source, "epos4", tmp_path / name, counts_per_turn=COUNTS, rate=125.0)
    for name in (*DRIVEN, "spin"):
        a, b = stream(tmp_path / "a", name), stream(tmp_path / "b", name)
        for column, values in a.items():
            assert b[column] == pytest.approx(values, abs=1 if name in DRIVEN else 1e-9)
    assert objects(tmp_path / "a", "roll") == pytest.approx(objects(tmp_path / "b", "roll"), abs=1)


@pytest.mark.parametrize("mode", ["csp", "csv", "cst"])
def test_files_and_manifest_of_each_mode(plan: Plan, tmp_path: Path, mode: str) -> None:
    files, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, mode=mode, rate=125.0)
    plain = {f"{name}_time_position.csv" for name in DRIVEN} if mode == "csp" else set()
    streams = {f"{name}.csv" for name in (*DRIVEN, "spin")}
    assert set(files) == {"objects.csv", "manifest", *streams, *plain}
    assert (manifest["mode"], manifest["rate_hz"]) == (mode, 125.0)
    assert manifest["interpolation_period_ms"] == manifest["sync"]["period_ms"] == 8
    spin = stream(tmp_path, "spin")
    exact = plan.motion.sample(np.minimum(spin["time_s"], plan.motion.duration)).q[:, 2]
    assert spin["position_rad"] == pytest.approx(exact, abs=1e-15)
    count = len(spin["time_s"])
    assert (
        f"{count} setpoints; the last is the target, reached by {spin['time_s'][-1]:.3f} s"
        in (manifest["notes"])
    )


def test_notes_state_the_rounding_of_the_manifest_in_other_units(
    plan: Plan, tmp_path: Path
) -> None:
    _, manifest = export(plan, "epos4", tmp_path, counts_per_turn=64)
    units = {"roll": ("deg", 180 / np.pi), "tilt": ("deg", 180 / np.pi), "insertion": ("mm", 1e3)}
    for joint in plan.robot.joints:
        if joint.drive is None:
            continue
        (note,) = (n for n in manifest["notes"] if n.startswith(f"joint {joint.name}: rounding"))
        unit, scale = units[joint.name]
        effects = manifest["axes"][joint.name]["rounding"]
        numbers = [float(x) for x in re.findall(r"([0-9.e+-]+) (?=deg|mm|%)", note)]
        expected = [scale * effects["position"], scale * effects["speed"]]
        expected += [100 * effects["speed"] / joint.velocity, scale * effects["acceleration"]]
        assert numbers == pytest.approx(expected, rel=0.06)
        assert note.count(unit) == 3
    (spin,) = (note for note in manifest["notes"] if "joint spin has no drive" in note)
    travel = np.ptp(plan.motion.sample(plan.motion.breaks).q[:, 2])
    assert spin.endswith(f"moves it by {np.degrees(travel):.4g} deg")


def test_a_joint_without_drive_that_does_not_move_needs_no_note(
    robot: Robot, tmp_path: Path
) -> None:
    moves = (np.array([0.01, 0.0, 0.0, 0.0]),)
    plan = read_back(tmp_path / "plan.json", robot, trapezoids(robot, moves))
    _, manifest = export(plan, "epos4", tmp_path / "e", counts_per_turn=COUNTS)
    assert not any("spin" in note for note in manifest["notes"])


@pytest.mark.parametrize("error", [-1e-13, 0.0, 1e-13])
@pytest.mark.parametrize("period", [1, 4, 100])
def test_a_duration_of_whole_periods_needs_one_setpoint_more(error: float, period: int) -> None:
    """A rounding error of the duration adds no setpoint, but an extra microsecond adds one."""
    rest = np.zeros((1, 6, 4))
    for extra, count in ((0.0, 21), (1e-6, 22)):
        duration = 20 * period * 1e-3 * (1 + error) + extra
        motion = Trajectory(np.array([0.0, duration]), rest, ())
        t, stretch = setpoint_times(SimpleNamespace(motion=motion), period)  # type: ignore[arg-type]
        assert len(t) == count
        assert np.diff(t) == pytest.approx(period * 1e-3)
        assert stretch == 1.0


@pytest.mark.parametrize(
    ("key", "largest", "quantity"),
    [
        ("q", 2**31 - 1, "target position"),
        ("speed", 2**31 - 1, "velocity"),
        ("torque", 2**15 - 1, "torque"),
    ],
)
def test_every_column_is_kept_to_the_range_of_its_object(
    robot: Robot, key: str, largest: int, quantity: str
) -> None:
    """Whole numbers up to the largest of an object are written unchanged. The next number is
    refused.
    """
    axis = drive_axes(robot, COUNTS)["roll"]
    unit = {
        "q": 1 / axis.increments_per_unit,
        "speed": 1e-3 * 2 * np.pi / 60,
        "torque": 1e-3 * axis.rated_torque,
    }[key]
    for sign in (1, -1):
        motion = {name: np.zeros((2, 4)) for name in ("q", "speed", "torque")}
        motion[key][1, 0] = sign * largest * unit
        output = _integer_streams({"roll": axis}, motion, "csp")["roll"]
        assert [abs(column[1]) for column in output.values()].count(largest) == 1
        motion[key][1, 0] = sign * (largest + 1) * unit
        for mode in ("csp", "csv", "cst"):
            with pytest.raises(ExportError, match=f"joint roll: {quantity} of .* does not fit"):
                _integer_streams({"roll": axis}, motion, mode)


def test_offsets_are_read_in_the_units_in_which_they_are_written(robot: Robot) -> None:
    joint = robot.joints[1]
    assert joint.drive is not None
    assert joint.motor is not None
    axis = dataclasses.replace(drive_axes(robot, COUNTS)[joint.name], direction=-1)
    offsets = _joint_offsets(
        axis, np.array([60_000.0]), np.array([1000.0])
    )  # 1 turn/s and the rated torque
    assert offsets.velocity == pytest.approx([-2 * np.pi / joint.drive.ratio])
    assert offsets.torque == pytest.approx([-joint.motor.nominal_torque])
    assert offsets.velocity_rounding == pytest.approx(np.pi / joint.drive.ratio / 60_000)
    assert offsets.torque_rounding == pytest.approx(0.5e-3 * joint.motor.nominal_torque)


def test_positions_are_read_with_their_rounding(plan: Plan, tmp_path: Path) -> None:
    _, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, rate=250.0)
    reading = read_trajectory(tmp_path, plan.robot)
    for i, joint in enumerate(plan.robot.joints):
        rows, axis = stream(tmp_path, joint.name), manifest["axes"][joint.name]
        scale = axis.get("increments_per_unit", 1.0)
        column = "position_rad" if joint.drive is None else "target_position_inc"
        q = reading.trajectory.sample(rows["time_s"]).q[:, i]
        assert q * scale == pytest.approx(rows[column], abs=1e-6)
        assert reading.resolution[i] == (0.0 if joint.drive is None else 0.5 / scale)
    assert reading.interpolation.startswith("linear")


def test_streams_that_do_not_fit_each_other_or_the_robot(plan: Plan, tmp_path: Path) -> None:
    files, manifest = export(plan, "epos4", tmp_path, counts_per_turn=COUNTS, rate=10.0)
    joints = plan.robot.joints
    for lacking in ("drive", "motor"):
        without = (dataclasses.replace(joints[0], **{lacking: None}), *joints[1:])
        bare = dataclasses.replace(plan.robot, joints=without)
        with pytest.raises(TrajectoryError, match="it was exported for another robot"):
            read_trajectory(tmp_path, bare)
    lines = files["tilt.csv"].read_text(encoding="utf-8").splitlines()

    def refused(changed: list[str], message: str) -> None:
        files["tilt.csv"].write_text("\n".join(changed) + "\n", encoding="utf-8")
        digest = hashlib.sha256(files["tilt.csv"].read_bytes()).hexdigest()
        mended = {**manifest, "files": {**manifest["files"], "tilt.csv": digest}}
        files["manifest"].write_text(json.dumps(mended), encoding="utf-8")
        with pytest.raises(TrajectoryError, match=message):
            read_trajectory(tmp_path, plan.robot)

    refused(lines[:-1], "the tables of the axes have different times")
    refused(lines[:2], r"tilt\.csv: the file has fewer than two rows")
    refused([*lines[:2], lines[2].replace(",", ",nan,", 1)], "columns")
    refused([*lines[:2], "0.1,nan,0,0"], r"tilt\.csv: .* not finite")
    refused([lines[0].replace("time_s", "t"), *lines[1:]], "no column time_s")
    for axis in (None, 3, {}, {"file": 3}):
        wrong = {**manifest, "axes": {**manifest["axes"], "tilt": axis}}
        files["manifest"].write_text(json.dumps(wrong), encoding="utf-8")
        with pytest.raises(
            TrajectoryError, match=r"does not give the increments of joint tilt|was modified"
        ):
            read_trajectory(tmp_path, plan.robot)


def test_a_table_of_two_rows_is_read(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("b,time,a\n1,0,3\n4,1,6\n", encoding="utf-8")
    assert np.array_equal(read_columns(path, ("time", "a", "b")), [[0, 3, 1], [1, 6, 4]])


def test_setpoints_that_the_check_would_reject_are_not_exported(plan: Plan, tmp_path: Path) -> None:
    """With one increment per turn, rounding of the positions changes the gravity load by more than
    the check allows.
    """
    with pytest.raises(
        ExportError, match=r"would reject the setpoints, which exceed the torque offset limit of"
    ):
        export(plan, "epos4", tmp_path / "e", counts_per_turn=1)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("move", [1e-4, 1e-5])
@pytest.mark.parametrize("rate", [1000.0, 100.0])
def test_motions_about_as_short_as_a_period_keep_the_motor_law(
    robot: Robot, tmp_path: Path, move: float, rate: float
) -> None:
    motion = trapezoids(robot, (np.array([move, 0.0, 0.0, 0.0]),))
    plan = read_back(tmp_path / "plan.json", robot, motion)
    export(plan, "epos4", tmp_path / "e", counts_per_turn=COUNTS, rate=rate)
    reading = read_trajectory(tmp_path / "e", robot)
    assert not reading.check(robot, plan.limits).violations
