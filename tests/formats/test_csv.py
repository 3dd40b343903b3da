from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ssm_planner.dynamics.motors import directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ExportError
from ssm_planner.formats.csv import trajectory_table, write_csv
from ssm_planner.formats.export import export
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.plans import Plan


def table(path: Path) -> dict[str, np.ndarray]:
    names = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


@pytest.mark.parametrize("rate", [1000.0, 300.0, 7.0, 1e5 / 3])
def test_rows_at_a_rate_are_the_plan(plan: Plan, tmp_path: Path, rate: float) -> None:
    """Also at rates that do not divide the duration: the last row is the end."""
    export(plan, "csv", tmp_path, rate=rate, columns=["q", "qd"])
    rows = table(tmp_path / "trajectory.csv")
    t = rows["time_s"]
    assert np.diff(t)[:-1] == pytest.approx(1 / rate, rel=1e-9)
    assert t[-1] == plan.trajectory.duration
    samples = plan.trajectory.sample(t)
    for i, unit in enumerate(("rad", "rad", "rad", "m")):
        assert np.array_equal(rows[f"q{i + 1}_{unit}"], samples.q[:, i])
        assert np.array_equal(rows[f"qd{i + 1}_{unit}_per_s"], samples.qd[:, i])


def test_chosen_columns(plan: Plan, tmp_path: Path) -> None:
    export(plan, "csv", tmp_path, rate=100.0, columns=["q", "qddd", "torque", "task"])
    rows = table(tmp_path / "trajectory.csv")
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
    # the tool passes through the remote centre
    tip = np.column_stack([rows[f"tip_{axis}_m"] for axis in "xyz"])
    assert np.linalg.norm(tip, axis=1) == pytest.approx(np.abs(rows["task_depth_m"]), abs=1e-12)


@pytest.mark.parametrize("rate", [None, 400.0])
def test_columns_of_the_motors_are_those_of_the_motor_law(
    plan: Plan, tmp_path: Path, rate: float | None
) -> None:
    """After each row, but before the end of the motion; starts from rest are told from other rows."""
    export(plan, "csv", tmp_path, rate=rate, columns=["q", "angle", "speed", "torque"])
    rows, robot = table(tmp_path / "trajectory.csv"), plan.robot
    samples = plan.motion.sample(rows["time_s"])
    after, before = (directions(robot, samples, side) for side in (1, -1))
    way, away = (np.vstack([a[:-1], b[-1:]]) for a, b in zip(after, before, strict=True))
    assert away[:-1].any()
    assert not away[:-1].all()
    away[-1] = 0.0  # a motion that ends starts nothing
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
    """Acceleration that jumps between rows: the rows joined again exceed the limit, and the manifest says so."""
    _, manifest = export(plan, "csv", tmp_path / "a", rate=170.0)
    assert any("exceed the acceleration limit" in note for note in manifest["notes"])
    _, manifest = export(smooth_plan, "csv", tmp_path / "b", rate=1000.0)
    assert any("keep every limit" in note for note in manifest["notes"])
    _, manifest = export(plan, "csv", tmp_path / "c")
    assert any("keep every limit" in note for note in manifest["notes"])


def test_the_table_beside_the_plan(plan: Plan, tmp_path: Path) -> None:
    """The form that the result folder has: 1 kHz, states and motors."""
    path = write_csv(tmp_path / "trajectory.csv", plan.trajectory, plan.robot)
    header, rows = trajectory_table(plan.trajectory, plan.robot)
    assert list(table(path)) == header
    assert len(rows) == len(table(path)["time_s"]) == int(plan.trajectory.duration * 1000) + 2


def test_the_rate_of_the_table_is_an_option_and_a_long_motion_has_fewer_rows(
    plan: Plan, tmp_path: Path
) -> None:
    slow = plan.trajectory.slower(plan.trajectory.duration / 600)
    assert len(table(write_csv(tmp_path / "slow.csv", slow, plan.robot))["time_s"]) == 60_001
    assert len(table(write_csv(tmp_path / "chosen.csv", slow, plan.robot, 10.0))["time_s"]) == 6001


def test_the_counts_that_plain_clients_read(plan: Plan, tmp_path: Path) -> None:
    """One file for each driven joint, whole increments, the end held to the next whole period."""
    files, manifest = export(
        plan, "csv", tmp_path, rate=300.0, columns=["counts"], counts_per_turn=4096
    )
    assert set(files) == {f"{name}_time_position.csv" for name in ("roll", "tilt", "insertion")} | {
        "manifest"
    }
    assert manifest["rate_hz"] == 300.0
    per_unit = plan.robot.joints[0].drive.ratio * 4096 / (2 * np.pi)
    rows = table(files["roll_time_position.csv"])
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
