"""Recordings of executed motions are compared with their plan. The recordings are computed from the
plan with known delays, noise and faults, which the comparison must recover.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.cli import compare as command
from ssm_planner.cli.shared import add_arguments
from ssm_planner.comparison.clock import align_axis
from ssm_planner.comparison.compare import compare
from ssm_planner.comparison.measured import (
    AxisRecording,
    assign_recordings,
    read_axis_recording,
)
from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import RecordingError
from ssm_planner.kinematics import fk
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.sizing import tip_error
from tests.support.executions import FAULTS, LEAD, Executions, kinds, taken, write
from tests.support.executions import RPM as RAD_PER_RPM
from tests.support.paths import RESULTS
from tests.support.plans import read_back, trapezoids

RPM = 60 / (2 * np.pi)
COUNTS = 4096


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory, robot: Robot) -> Plan:
    return read_back(
        tmp_path_factory.mktemp("plan") / "plan.json", robot, trapezoids(robot, share=0.9)
    )


@dataclasses.dataclass
class Executed:
    """The samples of one axis are times in s, speeds in rpm, torques in % of the nominal torque,
    and encoder counts.
    """

    time: np.ndarray
    rpm: np.ndarray
    percent: np.ndarray
    counts: np.ndarray

    def write(self, path: Path, position: bool = False) -> Path:
        """Write the samples in the format of an EPOS recorder, and return the path."""
        names, units = (
            [";Velocity actual value averaged;Torque actual value averaged"],
            ["ms;rpm;%"],
        )
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


def executed(
    plan: Plan, name: str, delay: float = 0.3, direction: int = 1, noise: float = 0.0
) -> Executed:
    """Return the motion of one axis that follows the plan after a delay, sampled every 2 ms.

    `noise` is its standard deviation relative to the largest value of a channel.
    """
    i = [joint.name for joint in plan.robot.joints].index(name)
    joint = plan.robot.joints[i]
    t = np.arange(0.0, delay + plan.trajectory.duration + 0.4, 0.002)
    inside = (t >= delay) & (t <= delay + plan.trajectory.duration)
    samples = plan.trajectory.sample(np.clip(t - delay, 0.0, plan.trajectory.duration))
    way, away = motion_directions(plan.robot, samples, 1)
    motor = motor_motion(plan.robot, RigidBody.from_robot(plan.robot), samples, way, away)
    w, tau = np.where(inside, motor.speed[:, i], 0.0), np.where(inside, motor.torque[:, i], 0.0)
    rng = np.random.default_rng(i)
    w += noise * np.abs(w).max() * rng.normal(size=len(t))
    tau += noise * np.abs(tau).max() * rng.normal(size=len(t))
    counts = samples.q[:, i] * joint.drive.ratio * COUNTS / (2 * np.pi)
    return Executed(
        t,
        direction * w * RPM,
        direction * tau / joint.motor.nominal_torque * 100,
        direction * counts,
    )


def test_positions_of_a_recording_in_utf_16(plan: Plan, tmp_path: Path) -> None:
    """Excel writes its Unicode text files in UTF-16."""
    path = executed(plan, "roll").write(tmp_path / "roll.csv", position=True)
    other = tmp_path / "roll.txt"
    other.write_text(path.read_text(encoding="utf-8"), encoding="utf-16")
    a, b = (read_axis_recording(file, plan.robot, "roll", COUNTS) for file in (path, other))
    assert a.q is not None
    assert b.q is not None
    assert np.array_equal(a.q, b.q)


@pytest.mark.parametrize("name", ["roll", "tilt", "insertion"])
def test_a_faithful_execution(plan: Plan, tmp_path: Path, name: str) -> None:
    path = executed(plan, name, delay=0.31, noise=0.005).write(
        tmp_path / f"{name}.csv", position=True
    )
    measured = read_axis_recording(path, plan.robot, name, COUNTS)
    (result,) = compare(plan.trajectory, plan.robot, plan.certificate, [measured])
    assert result.alignment.delay == pytest.approx(0.31, abs=0.002)
    assert result.alignment.correlation > 0.99
    assert result.covered == pytest.approx(1.0, abs=0.01)
    assert result.differences["speed"].nrmsd < 0.01
    assert result.differences["torque"].nrmsd < 0.05
    assert result.differences["position"].nrmsd < 0.002
    assert result.followed
    planned = {limit.name: limit.margin for limit in plan.certificate.limits if limit.joint == name}
    for limit in result.limits:
        assert limit.planned_margin == planned[limit.name]
        # An acceleration is the difference of two means, and its error is larger.
        error = 0.05 if limit.name == "acceleration" else 0.03
        assert limit.margin == pytest.approx(planned[limit.name], abs=error)


def test_the_errors_are_those_that_were_put_in(plan: Plan, tmp_path: Path) -> None:
    """The NRMSD of a constant torque error e is e / (max − min) of the measured torque."""
    recorded = executed(plan, "roll", delay=0.0)
    inside = recorded.time <= plan.trajectory.duration
    recorded = Executed(*(x[inside] for x in dataclasses.astuple(recorded)))
    recorded.percent = recorded.percent + 3.0
    measured = read_axis_recording(recorded.write(tmp_path / "roll.csv"), plan.robot, "roll")
    (result,) = compare(plan.trajectory, plan.robot, plan.certificate, [measured])
    error = 0.03 * plan.robot.joints[0].motor.nominal_torque
    torque = result.differences["torque"]
    assert torque.rms == pytest.approx(error, rel=0.03)
    assert torque.nrmsd == pytest.approx(torque.rms / np.ptp(measured.tau), rel=1e-12)


def test_the_motor_s_direction_comes_from_the_robot_file(plan: Plan, tmp_path: Path) -> None:
    path = executed(plan, "tilt", direction=-1).write(tmp_path / "tilt.csv", position=True)
    joint = dataclasses.replace(plan.robot.joints[1], motor_direction=-1)
    robot = dataclasses.replace(
        plan.robot, joints=(plan.robot.joints[0], joint, *plan.robot.joints[2:])
    )
    (result,) = compare(
        plan.trajectory, robot, plan.certificate, [read_axis_recording(path, robot, "tilt", COUNTS)]
    )
    assert result.differences["position"].nrmsd < 0.002
    (result,) = compare(
        plan.trajectory,
        plan.robot,
        plan.certificate,
        [read_axis_recording(path, plan.robot, "tilt", COUNTS)],
    )
    assert [(item.kind, item.verdict) for item in result.findings] == [("reversed", "not held")]
    assert "motor_direction" in result.findings[0].text


def test_another_joint_s_recording_is_named(plan: Plan, tmp_path: Path) -> None:
    path = executed(plan, "insertion").write(tmp_path / "x.csv")
    (result,) = compare(
        plan.trajectory,
        plan.robot,
        plan.certificate,
        [read_axis_recording(path, plan.robot, "roll")],
    )
    assert result.verdict == "not held"
    assert (
        "not the planned one of joint roll, but that of joint insertion" in result.findings[0].text
    )


def test_without_a_position_channel_the_speed_is_integrated(plan: Plan, tmp_path: Path) -> None:
    path = executed(plan, "roll").write(tmp_path / "roll.csv")
    (result,) = compare(
        plan.trajectory,
        plan.robot,
        plan.certificate,
        [read_axis_recording(path, plan.robot, "roll")],
    )
    assert result.differences["position"].nrmsd < 0.01
    assert any("integral" in note for note in result.notes)


def test_part_of_the_motion(plan: Plan, tmp_path: Path) -> None:
    """A recording of a part of the motion has the verdict "cannot tell"."""
    recorded = executed(plan, "roll", delay=0.2)
    some = (recorded.time > 0.35) & (recorded.time < 1.2)
    part = Executed(*(x[some] for x in dataclasses.astuple(recorded)))
    measured = read_axis_recording(part.write(tmp_path / "roll.csv"), plan.robot, "roll")
    (result,) = compare(plan.trajectory, plan.robot, plan.certificate, [measured])
    assert result.covered < 0.7
    assert any("% of the motion" in finding.text for finding in result.findings)
    assert result.verdict == "cannot tell"
    assert result.differences["speed"].nrmsd < 0.01


def test_a_limit_that_was_exceeded_in_reality(
    plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The torque is 130 % of its limit for ten samples. The exit status is 1."""
    good = [
        str(executed(plan, name).write(tmp_path / f"{name}.csv")) for name in ("insertion", "tilt")
    ]
    healthy = executed(plan, "roll").write(tmp_path / "healthy_roll.csv")
    recorded = executed(plan, "roll")
    motor = plan.robot.joints[0].motor
    recorded.percent[300:310] = 130 * motor.max_torque / motor.nominal_torque
    bad = recorded.write(tmp_path / "roll.csv")
    parser = argparse.ArgumentParser()
    add_arguments(parser, "compare")
    words = ["--json", str(plan.path), *good]
    assert command.run_compare(parser.parse_args([*words, f"roll={healthy}"])) == 0
    assert json.loads(capsys.readouterr().out)["held"] is True
    assert command.run_compare(parser.parse_args([*words, f"roll={bad}"])) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["held"] is False
    exceeded = [
        (axis["joint"], limit["name"])
        for axis in document["axes"]
        for limit in axis["limits"]
        if not limit["held"]
    ]
    assert exceeded == [("roll", "motor torque")]
    assert {"delay", "correlation", "covered", "nrmsd", "limits", "held", "notes"} <= set(
        document["axes"][0]
    )
    assert set(document["axes"][0]["nrmsd"]) == {"position", "speed", "torque"}
    assert command.run_compare(parser.parse_args([str(plan.path), f"roll={bad}"])) == 1
    assert "NOT held in reality" in capsys.readouterr().out


def test_the_joint_of_a_recording_is_given_or_follows_from_the_file_name(robot: Robot) -> None:
    """The joint is given before the path, or follows from the name of the file."""
    words = ["roll=a.csv", "run3_tilt.csv", "axis4.csv"]
    assert [joint for joint, _ in assign_recordings(words, robot)] == ["roll", "tilt", "insertion"]
    for bad, message in (
        (["something.csv"], "the joint of this recording is unknown"),
        (["roll_tilt.csv"], "the joint of this recording is unknown"),
        (["elbow=a.csv"], "the joint of this recording is unknown"),
        (["roll=a.csv", "roll.csv"], "a second recording of joint roll"),
    ):
        with pytest.raises(RecordingError, match=message):
            assign_recordings(bad, robot)


def test_joints_without_a_drive_and_counts_that_are_not_known(plan: Plan, tmp_path: Path) -> None:
    path = executed(plan, "roll").write(tmp_path / "roll.csv", position=True)
    with pytest.raises(RecordingError, match="states no drive"):
        read_axis_recording(path, plan.robot, "spin")
    with pytest.raises(RecordingError, match="give --counts-per-turn"):
        read_axis_recording(path, plan.robot, "roll")


@pytest.mark.parametrize("delay", [-0.4, 0.0, 0.123, 0.777, 2.5])
def test_alignment_finds_any_delay(delay: float) -> None:
    t = np.linspace(0, 1.5, 3001)
    speed = np.sin(np.pi * t / 1.5) ** 2 * (1 + 0.5 * np.sin(9 * t))
    time = np.arange(0, 5, 0.003)
    measured = np.interp(time - delay, t, speed, left=0, right=0)
    measured += 0.02 * np.random.default_rng(1).normal(size=len(time))
    result = align_axis(t, speed, time, measured)
    assert result.delay == pytest.approx(delay, abs=0.003)
    assert result.correlation > 0.97


def test_a_motor_that_should_stand_and_does() -> None:
    """The correlation is 1 if a motor rests as planned, and 0 if it moves instead."""
    t = np.linspace(0, 1, 100)
    result = align_axis(t, np.zeros(100), t, np.zeros(100))
    assert result.correlation == 1.0
    assert align_axis(t, np.zeros(100), t, np.ones(100)).correlation == 0.0


def test_a_recording_of_another_motion_is_named_by_its_speed(plan: Plan, tmp_path: Path) -> None:
    """The recording has five strokes to and fro, as on a test rig."""
    other = executed(plan, "roll")
    stroke = np.sin(10 * np.pi * other.time / other.time[-1])
    recording = dataclasses.replace(other, rpm=300 * stroke, percent=20 * np.sign(stroke))
    measured = read_axis_recording(recording.write(tmp_path / "roll.csv"), plan.robot, "roll")
    (result,) = compare(plan.trajectory, plan.robot, plan.certificate, [measured])
    assert result.verdict == "not held"
    assert {item.kind for item in result.findings} & {"other motion", "several motions"}


def test_a_channel_that_does_not_change_has_no_nrmsd(plan: Plan, tmp_path: Path) -> None:
    measured = read_axis_recording(
        executed(plan, "roll").write(tmp_path / "roll.csv"), plan.robot, "roll"
    )
    constant = dataclasses.replace(measured, tau=np.zeros_like(measured.tau))
    (result,) = compare(plan.trajectory, plan.robot, None, [constant])
    assert result.differences["torque"].nrmsd is None
    assert json.loads(json.dumps(result.to_dict(), allow_nan=False))["nrmsd"]["torque"] is None
    assert all(limit.planned_margin is None for limit in result.limits)


SHIPPED = RESULTS / "tilt_insert" / "plan.json"


@pytest.fixture(scope="module")
def shipped() -> Executions:
    return Executions(load_plan(SHIPPED))


def sagging(it: Executions) -> list:
    """Return recordings in which the roll torque is cut off and the speed drops."""
    run = it.run()
    high = np.abs(run.tau["roll"]) > 20e-3
    run.tau["roll"] = np.clip(run.tau["roll"], -20e-3, 20e-3)
    run.w["roll"][high] *= 0.8
    it.follow(run, "roll")
    return it.measured(run, np.random.default_rng(1))


def two_late(it: Executions) -> list:
    """Return recordings in which two axes are late."""
    run = it.run()
    for name, late in (("tilt", 50), ("insertion", 200)):
        run.time[name] = run.time[name] + late * 1e-3
    return it.measured(run, np.random.default_rng(2))


def more_torque(it: Executions) -> list:
    """Return recordings with 1.4 times the usual torques."""
    run = it.run()
    for name in it.names:
        run.tau[name] = 1.4 * run.tau[name]
    return it.measured(run, np.random.default_rng(3))


def noisy(it: Executions) -> list:
    return it.measured(it.run(), np.random.default_rng(4), rpm=2.0)


def stalled_tilt(it: Executions) -> list:
    """Return recordings in which the tilt axis stalls at 0.8 s."""
    run = it.run()
    blocked = (run.time["tilt"] > 0.8) & (run.w["tilt"] != 0)
    run.w["tilt"][run.time["tilt"] > 0.8] = 0.0
    run.tau["tilt"][blocked] = -78e-3
    it.follow(run, "tilt")
    return it.measured(run, np.random.default_rng(5))


def some_missing(it: Executions) -> list:
    """Return recordings that lack 5 % of their samples."""
    rng, run = np.random.default_rng(6), it.run()
    for name in it.names:
        run.keep(name, rng.random(len(run.time[name])) > 0.05)
    return it.measured(run, rng)


def a_gap(it: Executions) -> list:
    """Return recordings in which the roll axis has no samples between 1.0 s and 1.4 s."""
    run = it.run()
    run.keep("roll", (run.time["roll"] < 1.0) | (run.time["roll"] > 1.4))
    return it.measured(run, np.random.default_rng(7))


def wrong_clock(it: Executions) -> list:
    """Return recordings with a clock that is wrong by 1 %."""
    run = it.run()
    for name in it.names:
        run.time[name] = 1.01 * run.time[name]
    return it.measured(run, np.random.default_rng(8))


@pytest.mark.parametrize(
    ("execution", "verdict", "finding"),
    [
        (sagging, "not held", "the torque is cut off"),
        (
            two_late,
            "not held",
            "out of step, behind the first by: roll 0 ms, tilt 50 ms, insertion 200 ms",
        ),
        (more_torque, "not held", "torque is 1.40 times the predicted"),
        (noisy, "held", ""),
        (stalled_tilt, "not held", "(torque up to 78"),
        (some_missing, "held", "% of the samples are missing"),
        (a_gap, "cannot tell", "no samples for 0.4"),
        (wrong_clock, "cannot tell", "the recordings' clock is off by +1 %"),
    ],
)
def test_executions_of_the_shipped_plan_are_called_what_they_are(
    shipped: Executions,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    execution,
    verdict: str,
    finding: str,
) -> None:
    files = write(shipped, execution(shipped), tmp_path)
    words = [
        str(SHIPPED),
        *(f"{joint}={path}" for joint, path in files.items()),
        "--counts-per-turn",
        "4096",
    ]
    parser = argparse.ArgumentParser()
    add_arguments(parser, "compare")
    status = {"held": 0, "not held": 1, "cannot tell": 4}[verdict]
    assert command.run_compare(parser.parse_args([*words, "--json"])) == status
    document = json.loads(capsys.readouterr().out)
    assert (document["verdict"], document["held"]) == (verdict, verdict == "held")
    texts = [item["text"] for part in (document, *document["axes"]) for item in part["findings"]]
    assert finding in " ".join(texts)
    command.run_compare(parser.parse_args(words))
    assert {"held": "held in", "not held": "NOT held", "cannot tell": "CANNOT TELL"}[
        verdict
    ] in capsys.readouterr().out


@pytest.mark.parametrize("kind", FAULTS)
def test_seeded_faults_are_called_rightly(shipped: Executions, kind: str) -> None:
    """This test uses two seeds of each kind of fault."""
    for seed in (0, 1):
        recordings, verdict, finding = shipped.faulty(kind, seed)
        result = compare(
            shipped.plan.motion, shipped.plan.robot, shipped.plan.certificate, recordings
        )
        assert (result.verdict, finding in kinds(result)) == (verdict, True), kinds(result)


def test_a_healthy_run_raises_no_alarm(shipped: Executions) -> None:
    for seed in range(8):
        result = compare(
            shipped.plan.motion, shipped.plan.robot, shipped.plan.certificate, shipped.healthy(seed)
        )
        assert result.followed, kinds(result)
        assert abs(result.clock.rate - 1) == 0.0


def test_noise_hides_no_limit_it_does_not_reach(shipped: Executions) -> None:
    """A limit is violated only by an excess beyond the noise.

    The same excess is judged under little noise and under much noise.
    """
    joint = shipped.joints["roll"]
    for rpm, held in ((0.5, False), (200.0, True)):
        run = shipped.run()
        fast = np.abs(run.w["roll"]) > 0.999 * joint.velocity * joint.drive.ratio
        run.w["roll"][fast] *= 1.03
        result = compare(
            shipped.plan.motion,
            shipped.plan.robot,
            None,
            shipped.measured(run, np.random.default_rng(1), rpm=rpm),
        )[0]
        velocity = next(limit for limit in result.limits if limit.name == "velocity")
        assert (velocity.verdict != "not held") == held
        assert velocity.noise * joint.drive.ratio > rpm * RAD_PER_RPM / 10


def verdict_of(paths: dict[str, Path], *options: str) -> int:
    """Return the exit status of the command for the shipped plan."""
    words = [f"{joint}={path}" for joint, path in paths.items()]
    parser = argparse.ArgumentParser()
    add_arguments(parser, "compare")
    options = ("--counts-per-turn", "4096", *options)
    return command.run_compare(parser.parse_args([str(SHIPPED), *words, *options]))


def edit(path: Path, change: Callable[[int, list[str]], list[str]]) -> None:
    """Change the fields of every sample of a file. The samples are counted from 0."""
    lines = path.read_text().splitlines()
    rows = (";".join(change(k, row.split(";"))) for k, row in enumerate(lines[2:]))
    path.write_text("\n".join([*lines[:2], *rows]) + "\n")


def in_torque(text: str) -> Callable[[int, list[str]], list[str]]:
    """Return a function for `edit` that replaces the torque of 9 samples by a text."""
    return lambda k, row: [*row[:2], text, row[3]] if 600 <= k < 609 else row


@pytest.mark.parametrize("text", ["inf", "nan", "600, was 80", "80, checked"])
def test_a_value_that_is_not_used_as_it_stands_is_not_held(
    shipped: Executions, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    paths = write(shipped, shipped.healthy(1), tmp_path)
    edit(paths["roll"], in_torque(text))
    assert verdict_of(paths) == 4
    assert "cannot tell: roll: unread data: " in capsys.readouterr().out


def test_further_columns_and_fields_are_not_held(
    shipped: Executions, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = write(shipped, shipped.healthy(1), tmp_path)
    edit(paths["roll"], lambda k, row: [*row, "900"] if k == 700 else row)
    assert verdict_of(paths) == 4
    assert "1 lines with more than 4 columns" in capsys.readouterr().out
    text = paths["tilt"].read_text().splitlines()
    raw = [";".join([row, row.split(";")[2]]) for row in text[2:]]
    text = [text[0] + ";Torque actual value", text[1] + ";%", *raw]
    paths["roll"] = write(shipped, shipped.healthy(1), tmp_path)["roll"]
    paths["tilt"].write_text("\n".join(text) + "\n")
    assert verdict_of(paths) == 4
    assert "not from 'Torque actual value'" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("column", [1, 2, 3])
def test_a_value_that_no_channel_can_have_is_refused(
    shipped: Executions, tmp_path: Path, column: int
) -> None:
    paths = write(shipped, shipped.healthy(1), tmp_path)
    edit(
        paths["roll"],
        lambda k, row: [*row[:column], "1e200", *row[column + 1 :]] if k == 600 else row,
    )
    with pytest.raises(RecordingError, match=r"roll\.csv:603: a value is too large"):
        verdict_of(paths)


def lost(it: Executions, folder: Path) -> dict[str, Path]:
    """Write the recordings of a run that loses increments, and return their paths."""
    run = it.run()
    run.q["roll"][1500:] += 0.3 * it.joints["roll"].velocity
    return write(it, it.measured(run, np.random.default_rng(1)), folder)


def test_the_position_is_read_with_a_unit_in_its_heading(
    shipped: Executions, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = lost(shipped, tmp_path)
    names = "Time [ms];Velocity actual value averaged [rpm];Torque actual value averaged [%]"
    rows = paths["roll"].read_text().splitlines()[2:]
    text = [f"{names};Position actual value [inc]", *rows]
    paths["roll"].write_text("\n".join(text) + "\n")
    assert verdict_of(paths) == 1
    assert "not held: roll: tracking" in capsys.readouterr().out


def test_a_demand_is_not_a_measurement(shipped: Executions, tmp_path: Path) -> None:
    paths = write(shipped, shipped.healthy(1), tmp_path)
    text = paths["roll"].read_text().replace("Position actual value", "Position demand value")
    paths["roll"].write_text(text)
    assert read_axis_recording(paths["roll"], shipped.plan.robot, "roll", COUNTS).q is None


def test_an_option_out_of_range_is_refused(shipped: Executions, tmp_path: Path) -> None:
    paths = write(shipped, shipped.healthy(1), tmp_path)
    for lag in ("0 ms", "-1 s"):
        with pytest.raises(RecordingError, match=r"the lag .* is out of range"):
            verdict_of(paths, f"--lag={lag}")
    for counts in ("0", "-4096"):
        with pytest.raises(RecordingError, match="counts per turn"):
            verdict_of(paths, f"--counts-per-turn={counts}")


def test_a_remark_does_not_read_as_a_verdict(
    shipped: Executions, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The run has the planned speed, but half of this speed was declared.

    No line of the output may begin with the word "held".
    """
    paths = write(shipped, shipped.healthy(1), tmp_path)
    assert verdict_of(paths, "--speed", "50%") == 1
    assert not re.search(r"^held", capsys.readouterr().out, re.MULTILINE)


def with_error(
    recordings: list[AxisRecording], plan: Plan, rng: np.random.Generator
) -> tuple[list[AxisRecording], float]:
    """Add slow position errors to recordings, and return the largest tip error in m as well."""
    t = np.linspace(0.0, plan.motion.duration, 3000)
    planned = plan.motion.sample(plan.motion.breaks[0] + t).q
    actual = planned.copy()
    changed = []
    for recording in recordings:
        i = JOINTS.index(recording.joint)
        size = rng.uniform(1e-5, 1e-4) if i == 3 else rng.uniform(1e-4, 8e-4)
        rate, phase = rng.uniform(0.5, 9.0), rng.uniform(0, 6)

        def error(
            time: np.ndarray, size: float = size, rate: float = rate, phase: float = phase
        ) -> np.ndarray:
            return size * np.sin(rate * time + phase)

        actual[:, i] += error(t)
        speed = recording.w + plan.robot.joints[i].drive.ratio * np.gradient(
            error(recording.time - LEAD), recording.time
        )
        q = recording.q + error(recording.time - LEAD)
        changed.append(dataclasses.replace(recording, q=q, w=speed))
    tips = (fk(plan.robot, q).position for q in (planned, actual))
    return changed, float(np.linalg.norm(np.subtract(*tips), axis=1).max())


def test_the_tip_error_of_seeded_runs_is_recovered(shipped: Executions) -> None:
    for seed in range(12):
        rng = np.random.default_rng(3510 + seed)
        recordings, expected = with_error(shipped.healthy(seed), shipped.plan, rng)
        result = compare(shipped.plan.motion, shipped.plan.robot, None, recordings).tip_error
        assert result.missing == ()
        assert result.largest == pytest.approx(expected, abs=20e-6)
        # The shipped robot does not state backlash, stiffness and homing.
        assert result.total is None


def test_the_tip_error_adds_what_the_motors_do_not_show(shipped: Executions) -> None:
    """The measured error and the bound on the errors behind the encoders add up."""
    joints = []
    for joint in shipped.plan.robot.joints:
        motor = joint.motor and unchecked_copy(joint.motor, encoder_counts=500, placeholders=())
        errors = {"backlash": 1e-4, "homing_error": 1e-5, "stiffness": 1e6, "tracking_error": 1e-2}
        joints.append(unchecked_copy(joint, motor=motor, **errors))
    robot = unchecked_copy(shipped.plan.robot, joints=tuple(joints))
    motion = shipped.plan.motion
    result = compare(motion, robot, None, shipped.healthy(1)).tip_error
    followed = [unchecked_copy(joint, tracking_error=0.0) for joint in joints]
    unseen = tip_error(motion, unchecked_copy(robot, joints=tuple(followed))).bound
    assert result.total == pytest.approx(result.largest + unseen)
    assert result.to_dict()["total"] == result.total
    tight = [unchecked_copy(joint, tracking_error=1e-5) for joint in joints]
    late = with_error(shipped.healthy(1), shipped.plan, np.random.default_rng(1))[0]
    found = compare(motion, unchecked_copy(robot, joints=tuple(tight)), None, late)
    assert "tracking" in kinds(found)
    assert found.verdict == "not held"


def test_the_tip_error_of_a_joint_without_a_recording_is_that_of_its_file(
    shipped: Executions,
) -> None:
    """The spin has no drive, so only the robot file can state its tracking error."""
    motion = shipped.plan.motion
    for spin_error in (1e-3, None):
        joints = tuple(
            unchecked_copy(
                joint,
                motor=joint.motor
                and unchecked_copy(joint.motor, encoder_counts=500, placeholders=()),
                backlash=1e-4,
                homing_error=1e-5,
                stiffness=1e6,
                tracking_error=spin_error if joint.drive is None else None,
            )
            for joint in shipped.plan.robot.joints
        )
        robot = unchecked_copy(shipped.plan.robot, joints=joints)
        result = compare(motion, robot, None, shipped.healthy(1)).tip_error
        assert (result.total is None) == (spin_error is None)
        assert ("spin: tracking error" in result.to_dict()["missing"]) == (spin_error is None)


@pytest.mark.parametrize("lack", ["recording", "position", "samples"])
def test_a_tip_error_without_its_data_is_not_known(shipped: Executions, lack: str) -> None:
    recordings = shipped.healthy(2)
    if lack == "recording":
        del recordings[0]
    elif lack == "position":
        recordings[0] = dataclasses.replace(recordings[0], q=None)
    else:
        count = len(recordings[0].time)
        recordings[0] = taken(recordings[0], slice(count // 2, count))
    result = compare(shipped.plan.motion, shipped.plan.robot, None, recordings).tip_error
    assert any(text.startswith("roll: ") for text in result.missing)
    document = result.to_dict()
    assert document["largest"] is document["angle"] is document["total"] is None
