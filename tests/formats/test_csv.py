"""A CSV export contains the plan in the chosen columns, and CSV files are read back. The references
are the sampled plan and the equations of the motors.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats import csv as module
from ssm_planner.formats.csv import DEFAULT_RATE, motion_table, read_csv, write_csv
from ssm_planner.formats.export import export
from ssm_planner.formats.read import read_trajectory
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.publishing import file_hashes
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.check import check
from tests.support.plans import NONE, certified


def columns_of(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a CSV file by name, (n,) each."""
    names = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


@pytest.mark.parametrize("rate", [1000.0, 300.0, 7.0, 1e5 / 3])
def test_rows_at_a_rate_are_the_plan(plan: Plan, tmp_path: Path, rate: float) -> None:
    """The last row is the end of the motion, also if the rate does not divide the duration."""
    export(plan, "csv", tmp_path, rate=rate, columns=["q", "qd"])
    rows = columns_of(tmp_path / "trajectory.csv")
    t = rows["time_s"]
    assert np.diff(t)[:-1] == pytest.approx(1 / rate, rel=1e-9)
    assert t[-1] == plan.trajectory.duration
    samples = plan.trajectory.sample(t)
    for i, unit in enumerate(("rad", "rad", "rad", "m")):
        assert np.array_equal(rows[f"q{i + 1}_{unit}"], samples.q[:, i])
        assert np.array_equal(rows[f"qd{i + 1}_{unit}_per_s"], samples.qd[:, i])


def test_chosen_columns(plan: Plan, tmp_path: Path) -> None:
    export(plan, "csv", tmp_path, rate=100.0, columns=["q", "qddd", "torque", "task"])
    rows = columns_of(tmp_path / "trajectory.csv")
    assert list(rows) == [
        "time_s", "q1_rad", "q2_rad", "q3_rad", "q4_m",
        "qddd1_rad_per_s3", "qddd2_rad_per_s3", "qddd3_rad_per_s3", "qddd4_m_per_s3",
        "motor1_torque_Nm", "motor2_torque_Nm", "motor4_torque_Nm",
        "task_roll_rad", "task_tilt_rad", "task_spin_rad", "task_depth_m",
        "tip_x_m", "tip_y_m", "tip_z_m",
    ]  # fmt: skip
    q = np.column_stack([rows[name] for name in ("q1_rad", "q2_rad", "q3_rad", "q4_m")])
    task = task_from_joints(Mechanism.from_geometry(plan.robot.geometry), q)
    assert rows["task_tilt_rad"] == pytest.approx(task[:, 1], abs=1e-15)
    # The tool passes through the remote centre.
    tip = np.column_stack([rows[f"tip_{axis}_m"] for axis in "xyz"])
    assert np.linalg.norm(tip, axis=1) == pytest.approx(np.abs(rows["task_depth_m"]), abs=1e-12)


def test_motor_speeds_beside_positions_alone_are_accepted(plan: Plan, tmp_path: Path) -> None:
    """Straight lines join rows without velocities.

    Their slopes differ from the motor speeds at the rows, which the reader accepts.
    """
    for name, groups in (("without", ["q"]), ("with", ["q", "qd"])):
        export(plan, "csv", tmp_path / name, rate=50.0, columns=[*groups, "speed", "torque"])
    reading = read_trajectory(tmp_path / "without", plan.robot)
    assert not reading.check(plan.robot, NONE).violations
    read_trajectory(tmp_path / "with", plan.robot)
    path = tmp_path / "with/trajectory.csv"
    rows = path.read_text(encoding="utf-8").splitlines()
    k = rows[0].split(",").index("motor1_speed_rad_per_s")
    cells = rows[3].split(",")
    cells[k] = repr(1.001 * float(cells[k]))
    rows[3] = ",".join(cells)
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    manifest = path.parent / "manifest.json"
    document = json.loads(manifest.read_text(encoding="utf-8"))
    document["files"] = file_hashes(path.parent)
    manifest.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(TrajectoryError, match="motor1_speed_rad_per_s is"):
        read_trajectory(path.parent, plan.robot)


@pytest.mark.parametrize("rate", [None, 400.0])
def test_columns_of_the_motors_are_those_of_the_motor_law(
    plan: Plan, tmp_path: Path, rate: float | None
) -> None:
    """The torques are those just after each row, but just before the end of the motion.

    Starts from rest have static friction.
    """
    export(plan, "csv", tmp_path, rate=rate, columns=["q", "angle", "speed", "torque"])
    rows, robot = columns_of(tmp_path / "trajectory.csv"), plan.robot
    samples = plan.motion.sample(rows["time_s"])
    after, before = (motion_directions(robot, samples, side) for side in (1, -1))
    way, away = (np.vstack([a[:-1], b[-1:]]) for a, b in zip(after, before, strict=True))
    assert away[:-1].any()
    assert not away[:-1].all()
    away[-1] = 0.0  # no joint starts at the end of the motion
    motor = motor_motion(robot, RigidBody.from_robot(robot), samples, way, away)
    for i, joint in enumerate(robot.joints):
        for name, unit in (("angle", "rad"), ("speed", "rad_per_s"), ("torque", "Nm")):
            column = f"motor{i + 1}_{name}_{unit}"
            assert (column in rows) == (joint.drive is not None)
            if column in rows:
                assert rows[column] == pytest.approx(getattr(motor, name)[:, i], abs=1e-12)


def test_columns_and_rates_that_are_not_known(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=r"unknown columns colour \(allowed: q, qd"):
        export(plan, "csv", tmp_path / "x", columns=["q", "colour"])
    for rate in (0.0, -5.0, 1e9, float("nan")):
        with pytest.raises(ExportError, match=r"rate .* is out of range"):
            export(plan, "csv", tmp_path / "x", rate=rate)


def test_a_fixed_rate_says_what_it_costs(plan: Plan, smooth_plan: Plan, tmp_path: Path) -> None:
    """The acceleration jumps between rows, so a motion through the rows exceeds the limit.

    The manifest states the excess.
    """
    _, manifest = export(plan, "csv", tmp_path / "a", rate=170.0)
    assert any("exceed the acceleration limit" in note for note in manifest["notes"])
    _, manifest = export(smooth_plan, "csv", tmp_path / "b", rate=1000.0)
    assert any("keep every limit" in note for note in manifest["notes"])
    _, manifest = export(plan, "csv", tmp_path / "c")
    assert any("keep every limit" in note for note in manifest["notes"])


def test_the_table_beside_the_plan(plan: Plan, tmp_path: Path) -> None:
    """The table in the result folder contains the states and the motors at 1 kHz."""
    path = write_csv(tmp_path / "trajectory.csv", plan.trajectory, plan.robot)
    header, rows = motion_table(plan.trajectory.uniform(DEFAULT_RATE), plan.robot)
    assert list(columns_of(path)) == header
    assert len(rows) == len(columns_of(path)["time_s"]) == int(plan.trajectory.duration * 1000) + 2


def test_the_rate_of_the_table_is_an_option_and_a_long_motion_has_fewer_rows(
    plan: Plan, tmp_path: Path
) -> None:
    slow = plan.trajectory.slower(plan.trajectory.duration / 600)
    assert len(columns_of(write_csv(tmp_path / "slow.csv", slow, plan.robot))["time_s"]) == 60_001
    assert (
        len(columns_of(write_csv(tmp_path / "chosen.csv", slow, plan.robot, 10.0))["time_s"])
        == 6001
    )


def test_the_counts_that_plain_clients_read(plan: Plan, tmp_path: Path) -> None:
    """The export writes one file of whole increments for each driven joint.

    It holds the last position until the next whole period.
    """
    files, manifest = export(
        plan, "csv", tmp_path, rate=300.0, columns=["counts"], counts_per_turn=4096
    )
    assert set(files) == {f"{name}_time_position.csv" for name in ("roll", "tilt", "insertion")} | {
        "manifest"
    }
    assert manifest["rate_hz"] == 300.0
    per_unit = plan.robot.joints[0].drive.ratio * 4096 / (2 * np.pi)
    rows = columns_of(files["roll_time_position.csv"])
    assert set(rows) == {"time", "position"}
    assert np.diff(rows["time"]) == pytest.approx(1 / 300, abs=1e-8)
    exact = (
        plan.trajectory.sample(np.minimum(rows["time"], plan.trajectory.duration)).q[:, 0]
        * per_unit
    )
    assert np.abs(rows["position"] - exact).max() <= 0.5 + 1e-3
    assert rows["position"][-1] == round(float(exact[-1]))
    files, _ = export(plan, "csv", tmp_path, columns=["q", "counts"], counts_per_turn=4096)
    assert "trajectory.csv" in files
    _, manifest = export(plan, "csv", tmp_path / "x", columns=["counts"])
    assert any("its increments use a placeholder value" in note for note in manifest["notes"])


def test_rates_are_allowed_up_to_the_largest(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LARGEST_RATE", 50.0)
    _, manifest = export(plan, "csv", tmp_path, rate=50.0)
    assert manifest["rate_hz"] == 50.0
    for rate in (50.000001, 0.0):
        with pytest.raises(ExportError, match=r"allowed: above 0, up to 50 Hz"):
            export(plan, "csv", tmp_path, rate=rate)


def test_the_note_states_the_worst_excess_of_the_rows(
    plan: Plan, robot: Robot, tmp_path: Path
) -> None:
    """The note states the same limit, joint, percentage and time as a check of the written file."""
    _, manifest = export(plan, "csv", tmp_path, rate=170.0)
    reading = read_csv(tmp_path / "trajectory.csv", robot)
    worst = check(reading.trajectory, robot, plan.limits, interpolation=reading.interpolation).worst
    (note,) = (note for note in manifest["notes"] if "exceed" in note)
    stated = re.search(r"exceed the (.+) limit of (\S+) by (\S+) % at (\S+) s", note)
    assert stated is not None
    assert stated.group(1, 2) == (worst.name, worst.joint)
    assert float(stated.group(3)) == pytest.approx(-100 * worst.margin, rel=1e-2)
    assert float(stated.group(4)) == pytest.approx(worst.time, abs=1e-4)
    assert f"({reading.interpolation})" in note
    rows = len(columns_of(tmp_path / "trajectory.csv")["time_s"])
    assert f"{rows} rows at 170 Hz; the last row is the end of the motion" in manifest["notes"]


def test_rows_without_positions_carry_no_verdict(plan: Plan, tmp_path: Path) -> None:
    _, manifest = export(plan, "csv", tmp_path, rate=100.0, columns=["qd"])
    assert len(manifest["notes"]) == 1
    assert "limit" not in manifest["notes"][0]
    assert (manifest["rate_hz"], manifest["trajectory"]) == (100.0, "trajectory.csv")


@given(
    negative=st.sampled_from(["", "-", "+"]),
    digits=st.from_regex(r"([0-9]{1,5}(\.[0-9]{0,6})?|\.[0-9]{1,6})", fullmatch=True),
    exponent=st.one_of(st.just(""), st.from_regex(r"[eE][+-]?[0-9]{1,2}", fullmatch=True)),
)
def test_the_last_digit_is_that_of_a_decimal_number(
    negative: str, digits: str, exponent: str
) -> None:
    text = negative + digits + exponent
    value = Decimal(text)
    assert module._last_digit_exponent(text) == (value.as_tuple().exponent if value else 99)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_the_first_rows_determine_the_rounding(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int
) -> None:
    """The reader counts the digits of each column separately, in the unit of the column."""
    monkeypatch.setattr(module, "ROUNDING_SAMPLE_ROWS", rows)
    lines = ["time_s,q1_deg,q2_rad,q3_rad,q4_mm", "0,10,0.5,0,-1.5", "1,10.5,0.51,0,-1.5"]
    lines += ["2,10.25,0.5,0,-1.125"]
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    digits = ([0, 1, 99, 1], [1, 2, 99, 1], [2, 2, 99, 3])[rows - 1]
    units = [math.pi / 180, 1.0, 1.0, 1e-3]
    expected = [0.5 * 10.0**-k * unit for k, unit in zip(digits, units, strict=True)]
    expected[2] = 0.0  # zeros do not show the rounding
    assert read_csv(path, robot).resolution == pytest.approx(expected)


def test_lines_are_counted_as_an_editor_counts_them(robot: Robot, tmp_path: Path) -> None:
    """Comments before the header and empty lines between the rows count as lines."""
    path = tmp_path / "t.csv"
    rows = [f"{t},0.3,1.15,0.1,{0 if t < 4 else 'nan'}" for t in range(6)]
    for above, between in ((0, 0), (2, 0), (0, 1), (3, 2)):
        gap = "\n" * (between + 1)
        text = "# a comment\n" * above + gap.join(["time_s,q1_rad,q2_rad,q3_rad,q4_m", *rows])
        path.write_text(text, encoding="utf-8")
        line = above + 1 + 5 * (between + 1)
        with pytest.raises(TrajectoryError, match=rf"t\.csv:{line}: position is not a finite"):
            read_csv(path, robot)
        path.write_text(text.replace("nan", "none"), encoding="utf-8")
        with pytest.raises(TrajectoryError, match=rf"t\.csv:{line}: q4_m: 'none' is not a num"):
            read_csv(path, robot)
        path.write_text(text.replace("q1_rad", "q1"), encoding="utf-8")
        with pytest.raises(TrajectoryError, match=rf"t\.csv:{above + 1}: column 'q1'"):
            read_csv(path, robot)


@pytest.mark.parametrize("block", [3, 4, 12, 13])
@pytest.mark.parametrize("extra", [0, 1, 400])
def test_columns_and_blocks_of_any_number_give_the_same_rows(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, extra: int
) -> None:
    """The cases include a last line of several kilobytes, and blocks that end with the file."""
    q = np.linspace([0.0, 1.0, 0.0, 0.0], [0.1, 1.1, 0.2, -0.01], 12)
    names = ["q4_m", "time_s", *(f"note {k}" for k in range(extra)), "q2_rad", "q1_rad", "q3_rad"]
    notes = np.full((12, extra), 1.23456789012345)
    rows = np.column_stack([q[:, 3], np.arange(12), notes, q[:, 1], q[:, 0], q[:, 2]])
    path = tmp_path / "t.csv"
    np.savetxt(path, rows, fmt="%.17g", delimiter=";", header=";".join(names), comments="")
    monkeypatch.setattr(module, "PIECES_PER_BLOCK", block)
    reading = read_csv(path, robot)
    assert np.array_equal(reading.trajectory.breaks, np.arange(12.0))
    assert reading.trajectory.sample(np.arange(12.0)).q == pytest.approx(q, abs=1e-15)
    assert len(reading.notes) == (extra > 0)
    text = path.read_text(encoding="utf-8").rstrip("\n")
    path.write_text(text[: text.rindex(";")], encoding="utf-8")
    with pytest.raises(TrajectoryError, match="columns"):
        read_csv(path, robot)


def test_a_file_that_was_cut_off_is_refused(robot: Robot, tmp_path: Path) -> None:
    """A file whose last row lacks a column is refused, even if the reader does not need that
    column.

    The last number before the cut may lack digits.
    """
    path = tmp_path / "t.csv"
    lines = ["time_s,q1_rad,q2_rad,q3_rad,q4_m,note", *(f"{t},0,1,0,0,5" for t in range(3))]
    path.write_text("\n".join(lines), encoding="utf-8")
    assert read_csv(path, robot).trajectory.duration == 2.0
    path.write_text("\n".join(lines)[:-2], encoding="utf-8")
    with pytest.raises(TrajectoryError, match="the last row has fewer than 6 columns"):
        read_csv(path, robot)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("time_s", "no columns found"),
        ("time_s,q1_rad", "no position of joint tilt, spin, insertion"),
        ("0.5,-.5,+1e-3,5.,nan,-inf,Infinity", "no header"),
        ("0.5,1e", "no time column"),
        ("0.5,.", "no time column"),
        ("0.5,e5", "no time column"),
    ],
)
def test_a_header_names_at_least_two_columns(
    robot: Robot, tmp_path: Path, header: str, message: str
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(header + "\n" + ",".join("0" * (1 + header.count(","))), encoding="utf-8")
    with pytest.raises(TrajectoryError, match=message):
        read_csv(path, robot)


def test_a_short_table_has_the_standard_rate(plan: Plan, tmp_path: Path) -> None:
    """A motion of up to 100 s has rows at 1 kHz. A longer motion has a lower rate."""
    for duration, rate in ((100.0, 1000.0), (100.1, 100.0), (0.5, 1000.0)):
        motion = plan.motion.slower(plan.motion.duration / duration)
        path = write_csv(tmp_path / "t.csv", motion, plan.robot)
        with path.open(encoding="utf-8") as file:
            t = [float(line.split(",")[0]) for line in list(file)[1:4]]
        assert t == pytest.approx([0.0, 1 / rate, 2 / rate])


def test_counts_are_written_up_to_the_first_period_behind_the_end(
    plan: Plan, tmp_path: Path
) -> None:
    moved = replace(
        plan, trajectory=Trajectory(plan.motion.breaks + 7.0, plan.motion.coefficients, ())
    )
    moved = certified(moved)
    for rate, behind in ((20 / plan.motion.duration, 0.0), (20.5 / plan.motion.duration, 0.5)):
        files, manifest = export(
            moved, "csv", tmp_path, rate=rate, columns=["counts"], counts_per_turn=4096
        )
        rows = columns_of(files["tilt_time_position.csv"])
        assert len(rows["time"]) == 21 + round(behind + 0.1)
        assert rows["time"][-1] == pytest.approx(plan.motion.duration + behind / rate)
        assert (manifest["rate_hz"], manifest["units"]["position"]) == (rate, "increments")
        assert f"{len(rows['time'])} rows at {rate:g} Hz" in manifest["notes"][0]
        assert "roll, tilt, insertion" in manifest["notes"][0]


def test_a_disk_that_fails_while_it_is_read(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "t.csv"
    path.write_text("time_s,q1_rad,q2_rad,q3_rad,q4_m\n0,0,0,0,0\n1,0,0,0,0\n", encoding="utf-8")

    def fail(*_: object, **__: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("ssm_planner.formats.csv.np.loadtxt", fail)
    with pytest.raises(TrajectoryError, match=r"t\.csv: cannot be read: Input/output error"):
        read_csv(path, robot)
    layout = module.read_layout(path)
    assert module._row_error(path, layout, "something else", 0) == f"{path}: something else"
    with pytest.raises(TrajectoryError, match="cannot be read"):
        read_csv(tmp_path, robot)
