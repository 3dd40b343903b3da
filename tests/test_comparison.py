"""Recordings of an executed motion against its plan: made from the plan with known delay, noise and faults."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.cli import compare as command
from ssm_planner.comparison import align, assign, compare, read_measured
from ssm_planner.dynamics.motors import directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import RecordingError
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot

sys.path.insert(0, str(Path(__file__).parent))
from plans import read_back, trapezoids

RPM = 60 / (2 * np.pi)
COUNTS = 4096


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory, robot: Robot) -> Plan:
    return read_back(tmp_path_factory.mktemp("plan") / "plan.json", robot, trapezoids(robot, share=0.9))


@dataclasses.dataclass
class Executed:
    """What the recorder of one axis saw."""

    time: np.ndarray
    rpm: np.ndarray
    percent: np.ndarray
    counts: np.ndarray

    def write(self, path: Path, position: bool = False) -> Path:
        """As an EPOS recorder export."""
        names, units = [";Velocity actual value averaged;Torque actual value averaged"], ["ms;rpm;%"]
        columns = [self.time * 1e3, np.round(self.rpm), np.round(self.percent, 1)]
        if position:
            names[0] += ";Position actual value"
            units[0] += ";inc"
            columns.append(np.round(self.counts))
        lines = [
            "Date:;2024-01-01 10:00:00",
            f"Recorded samples:;{len(self.time)}",
            "Sampling period:;2.000",
            *names,
            *units,
        ]
        lines += [";".join(f"{x:.10g}" for x in row) for row in np.column_stack(columns)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path


def executed(plan: Plan, name: str, delay: float = 0.3, direction: int = 1, noise: float = 0.0) -> Executed:
    """The plan as carried out after a delay, sampled every 2 ms, with noise as a share of the largest value."""
    i = [joint.name for joint in plan.robot.joints].index(name)
    joint = plan.robot.joints[i]
    t = np.arange(0.0, delay + plan.trajectory.duration + 0.4, 0.002)
    inside = (t >= delay) & (t <= delay + plan.trajectory.duration)
    samples = plan.trajectory.sample(np.clip(t - delay, 0.0, plan.trajectory.duration))
    way, away = directions(plan.robot, samples, 1)
    motor = motor_motion(plan.robot, RigidBody.from_robot(plan.robot), samples, way, away)
    w, tau = np.where(inside, motor.speed[:, i], 0.0), np.where(inside, motor.torque[:, i], 0.0)
    rng = np.random.default_rng(i)
    w += noise * np.abs(w).max() * rng.normal(size=len(t))
    tau += noise * np.abs(tau).max() * rng.normal(size=len(t))
    counts = samples.q[:, i] * joint.drive.ratio * COUNTS / (2 * np.pi)
    return Executed(t, direction * w * RPM, direction * tau / joint.motor.nominal_torque * 100, direction * counts)


@pytest.mark.parametrize("name", ["roll", "tilt", "insertion"])
def test_a_faithful_execution(plan: Plan, tmp_path: Path, name: str) -> None:
    path = executed(plan, name, delay=0.31, noise=0.005).write(tmp_path / f"{name}.csv", position=True)
    measured = read_measured(path, plan.robot, name, COUNTS)
    found = compare(plan.trajectory, plan.robot, plan.certificate, measured)
    assert found.alignment.delay == pytest.approx(0.31, abs=0.002)
    assert found.alignment.correlation > 0.99
    assert found.covered == pytest.approx(1.0, abs=0.01)
    assert found.differences["speed"].nrmsd < 0.01
    assert found.differences["torque"].nrmsd < 0.05
    assert found.differences["position"].nrmsd < 0.002
    assert found.held
    planned = {limit.name: limit.margin for limit in plan.certificate.limits if limit.joint == name}
    for limit in found.limits:
        assert limit.planned_margin == planned[limit.name]
        assert limit.margin == pytest.approx(planned[limit.name], abs=0.03)


def test_the_errors_are_those_that_were_put_in(plan: Plan, tmp_path: Path) -> None:
    """NRMSD of a constant torque error e is e / (max − min of the measured)."""
    recorded = executed(plan, "roll", delay=0.0)
    inside = recorded.time <= plan.trajectory.duration
    recorded = Executed(*(x[inside] for x in dataclasses.astuple(recorded)))
    recorded.percent = recorded.percent + 3.0
    measured = read_measured(recorded.write(tmp_path / "roll.csv"), plan.robot, "roll")
    found = compare(plan.trajectory, plan.robot, plan.certificate, measured)
    error = 0.03 * plan.robot.joints[0].motor.nominal_torque
    torque = found.differences["torque"]
    assert torque.rms == pytest.approx(error, rel=0.03)
    assert torque.nrmsd == pytest.approx(torque.rms / np.ptp(measured.tau), rel=1e-12)


def test_the_motor_s_direction_comes_from_the_robot_file(plan: Plan, tmp_path: Path) -> None:
    path = executed(plan, "tilt", direction=-1).write(tmp_path / "tilt.csv", position=True)
    joint = dataclasses.replace(plan.robot.joints[1], motor_direction=-1)
    robot = dataclasses.replace(plan.robot, joints=(plan.robot.joints[0], joint, *plan.robot.joints[2:]))
    found = compare(plan.trajectory, robot, plan.certificate, read_measured(path, robot, "tilt", COUNTS))
    assert found.differences["position"].nrmsd < 0.002
    with pytest.raises(RecordingError, match="reversed it is; motor_direction"):
        compare(plan.trajectory, plan.robot, plan.certificate, read_measured(path, plan.robot, "tilt", COUNTS))


def test_another_joint_s_recording_is_refused(plan: Plan, tmp_path: Path) -> None:
    path = executed(plan, "insertion").write(tmp_path / "x.csv")
    with pytest.raises(RecordingError, match="its speed is not the planned one of joint roll"):
        compare(plan.trajectory, plan.robot, plan.certificate, read_measured(path, plan.robot, "roll"))


def test_without_a_position_channel_the_speed_is_integrated(plan: Plan, tmp_path: Path) -> None:
    path = executed(plan, "roll").write(tmp_path / "roll.csv")
    found = compare(plan.trajectory, plan.robot, plan.certificate, read_measured(path, plan.robot, "roll"))
    assert found.differences["position"].nrmsd < 0.01
    assert any("integral" in note for note in found.notes)


def test_part_of_the_motion(plan: Plan, tmp_path: Path) -> None:
    recorded = executed(plan, "roll", delay=0.2)
    some = (recorded.time > 0.35) & (recorded.time < 1.2)
    part = Executed(*(x[some] for x in dataclasses.astuple(recorded)))
    measured = read_measured(part.write(tmp_path / "roll.csv"), plan.robot, "roll")
    found = compare(plan.trajectory, plan.robot, plan.certificate, measured)
    assert found.covered < 0.7
    assert any("% of the motion" in note for note in found.notes)
    assert found.differences["speed"].nrmsd < 0.01


def test_a_limit_that_was_exceeded_in_reality(plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Torque up to 130 % of the largest for some samples: found, named, and exit status 1."""
    good = executed(plan, "insertion").write(tmp_path / "insertion.csv")
    recorded = executed(plan, "roll")
    motor = plan.robot.joints[0].motor
    recorded.percent[300:310] = 130 * motor.max_torque / motor.nominal_torque
    bad = recorded.write(tmp_path / "roll.csv")
    parser = argparse.ArgumentParser()
    command.compare_arguments(parser)
    assert command.run_compare(parser.parse_args([str(plan.path), str(good), "--json"])) == 0
    assert json.loads(capsys.readouterr().out)["held"] is True
    assert command.run_compare(parser.parse_args([str(plan.path), str(good), str(bad), "--json"])) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["held"] is False
    exceeded = [
        (axis["joint"], limit["name"]) for axis in document["axes"] for limit in axis["limits"] if not limit["held"]
    ]
    assert exceeded == [("roll", "motor torque")]
    assert {"delay", "correlation", "covered", "nrmsd", "limits", "held", "notes"} <= set(document["axes"][0])
    assert set(document["axes"][0]["nrmsd"]) == {"position", "speed", "torque"}
    assert command.run_compare(parser.parse_args([str(plan.path), f"roll={bad}"])) == 1
    assert "NOT held in reality" in capsys.readouterr().out


def test_which_joint_a_file_is_of(robot: Robot) -> None:
    words = ["roll=a.csv", "run3_tilt.csv", "axis4.csv"]
    assert [joint for joint, _ in assign(words, robot)] == ["roll", "tilt", "insertion"]
    for bad, message in (
        (["something.csv"], "of which joint"),
        (["roll_tilt.csv"], "of which joint"),
        (["elbow=a.csv"], "of which joint"),
        (["roll=a.csv", "roll.csv"], "a second recording of joint roll"),
    ):
        with pytest.raises(RecordingError, match=message):
            assign(bad, robot)


def test_joints_without_a_drive_and_counts_that_are_not_known(plan: Plan, tmp_path: Path) -> None:
    path = executed(plan, "roll").write(tmp_path / "roll.csv", position=True)
    with pytest.raises(RecordingError, match="has no drive"):
        read_measured(path, plan.robot, "spin")
    with pytest.raises(RecordingError, match="give --counts-per-turn"):
        read_measured(path, plan.robot, "roll")


@pytest.mark.parametrize("delay", [-0.4, 0.0, 0.123, 0.777, 2.5])
def test_alignment_finds_any_delay(delay: float) -> None:
    t = np.linspace(0, 1.5, 3001)
    speed = np.sin(np.pi * t / 1.5) ** 2 * (1 + 0.5 * np.sin(9 * t))
    time = np.arange(0, 5, 0.003)
    measured = np.interp(time - delay, t, speed, left=0, right=0)
    measured += 0.02 * np.random.default_rng(1).normal(size=len(time))
    found = align(t, speed, time, measured)
    assert found.delay == pytest.approx(delay, abs=0.003)
    assert found.correlation > 0.97


def test_a_motor_that_should_stand_and_does() -> None:
    t = np.linspace(0, 1, 100)
    found = align(t, np.zeros(100), t, np.zeros(100))
    assert found.correlation == 1.0
    assert align(t, np.zeros(100), t, np.ones(100)).correlation == 0.0


def test_a_real_recording_of_another_machine_is_not_taken_for_this_motion(plan: Plan) -> None:
    """Start, rest and return of a worm drive on its rig: read, and refused by its speed."""
    folder = Path(__file__).parents[2] / "shared/recordings/drive3_worm/start_stop"
    if not folder.is_dir():
        pytest.skip("the recordings of the rigs are not beside the project (../shared/recordings)")
    for path in sorted(folder.glob("*.csv")):
        measured = read_measured(path, plan.robot, "roll")
        assert len(measured.time) > 100
        with pytest.raises(RecordingError, match="its speed is not the planned one"):
            compare(plan.trajectory, plan.robot, plan.certificate, measured)


def test_a_channel_that_does_not_change_has_no_nrmsd(plan: Plan, tmp_path: Path) -> None:
    measured = read_measured(executed(plan, "roll").write(tmp_path / "roll.csv"), plan.robot, "roll")
    constant = dataclasses.replace(measured, tau=np.zeros_like(measured.tau))
    found = compare(plan.trajectory, plan.robot, None, constant)
    assert found.differences["torque"].nrmsd is None
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["nrmsd"]["torque"] is None
    assert all(limit.planned_margin is None for limit in found.limits)
