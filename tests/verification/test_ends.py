"""Rest at both ends is a limit of every trajectory, unless the task declares speeds there."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from ssm_planner import api
from ssm_planner.cli import main
from ssm_planner.formats.export import export
from ssm_planner.formats.read import read_trajectory
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import joint_rates, task_rates
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Span, Trajectory
from ssm_planner.verification.check import check
from ssm_planner.verification.ends import JumpRecorder, end_velocities
from ssm_planner.verification.limits import JUMP_DRIFT_RATE, JUMP_TOLERANCE
from tests.support.paths import ROOT
from tests.support.plans import read_back, trapezoids

ROBOT = str(ROOT / "problems/robots/vitreoretinal.yaml")
SHIPPED = ROOT / "results/tilt_insert/trajectory.csv"
ENDS = {"start velocity", "end velocity"}


def part(trajectory: Trajectory, first: int, last: int) -> Trajectory:
    """Return the pieces from the index `first` to the index before `last`."""
    breaks = trajectory.breaks[first : last + 1].copy()
    return Trajectory(
        breaks, trajectory.coefficients[first:last].copy(), (Span("part", breaks[0], breaks[-1]),)
    )


def rates_at(trajectory: Trajectory, robot: Robot, end: int) -> dict[str, float]:
    velocity = end_velocities(trajectory)[end]
    q = trajectory.sample(trajectory.breaks[[0, -1]]).q[end]
    rates = task_rates(Mechanism.from_geometry(robot.geometry), q[None], velocity[None])[0]
    return dict(zip(("roll", "tilt", "spin", "depth"), rates.tolist(), strict=True))


@pytest.mark.parametrize("columns", [13, 5], ids=["with velocities", "positions alone"])
@pytest.mark.parametrize("rows", [slice(0, 141), slice(141, None)], ids=["head", "tail"])
def test_a_cut_of_the_shipped_motion_fails(
    tmp_path: Path, rows: slice, columns: int, capsys: pytest.CaptureFixture[str]
) -> None:
    header, *lines = SHIPPED.read_text(encoding="utf-8").splitlines()
    path = tmp_path / "cut.csv"
    remaining = [",".join(line.split(",")[:columns]) for line in (header, *lines[rows])]
    path.write_text("\n".join(remaining) + "\n", encoding="utf-8")
    end = "--end-rate" if rows.start == 0 else "--start-rate"
    judged = ENDS if columns == 13 else {"velocity jump"}

    def exceeded(*options: str) -> set[str]:
        assert main(["check", str(path), "--robot", ROBOT, "--json", *options]) in (0, 1, 4)
        result = json.loads(capsys.readouterr().out)
        broken = any(limit["margin"] < -1e-6 for limit in result["limits"])
        assert broken == (result["verdict"] == "violated")
        return judged & {limit["name"] for limit in result["limits"] if limit["margin"] < -1e-6}

    assert exceeded()
    assert not exceeded(end, "any")
    assert exceeded(end, "tilt=12deg/s")


@pytest.mark.parametrize(
    "word", ["tilt", "tilt=3mm/s", "tlt=3deg/s", "", "tilt=1deg/s;roll=2deg/s"]
)
def test_rates_that_are_none_are_refused(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    """An option that does not state valid rates is refused."""
    assert main(["check", str(SHIPPED), "--robot", ROBOT, "--end-rate", word]) == 2
    assert "--end-rate" in capsys.readouterr().err


def test_every_cut_fails_and_every_declared_cut_passes(robot: Robot) -> None:
    complete = trapezoids(robot)
    assert check(complete, robot).passed
    count = len(complete.breaks) - 1
    for k in range(1, count):
        for piece, end in ((part(complete, 0, k), 1), (part(complete, k, count), 0)):
            result = ENDS & {limit.name for limit in check(piece, robot).violations}
            moving = np.abs(end_velocities(piece)[end]).max() > 1e-9
            assert result == ({("start velocity", "end velocity")[end]} if moving else set())
            declared = {("start_rate", "end_rate")[end]: rates_at(piece, robot, end)}
            assert not ENDS & {
                limit.name for limit in check(piece, robot, TaskLimits(**declared)).violations
            }
            wrong = {
                name: value * (1 + 1e-4) + 1e-4
                for name, value in rates_at(piece, robot, end).items()
            }
            missed = check(
                piece, robot, TaskLimits(**{("start_rate", "end_rate")[end]: wrong})
            ).violations
            assert {limit.name for limit in missed} & ENDS == {
                ("start velocity", "end velocity")[end]
            }


def test_joint_rates_are_those_of_the_task(robot: Robot) -> None:
    mechanism, rng = Mechanism.from_geometry(robot.geometry), np.random.default_rng(0)
    for _ in range(20):
        q, rate = np.array([0.2, 1.0, 0.1, -0.01]) + 0.1 * rng.normal(size=4), rng.normal(size=4)
        qd = joint_rates(mechanism, q, rate)
        assert task_rates(mechanism, q[None], qd[None])[0] == pytest.approx(rate, abs=1e-12)


def test_a_plan_that_ends_moving_leaves_for_every_controller(robot: Robot, tmp_path: Path) -> None:
    """Exports keep the last speed of a plan that ends in motion."""
    complete = trapezoids(robot)
    moving = part(complete, 0, 1)
    limits = TaskLimits(end_rate=rates_at(moving, robot, 1))
    plan = read_back(tmp_path / "plan.json", robot, moving, limits=limits)
    assert plan.limits.end_rate == limits.end_rate
    assert api.check(plan).passed
    pytest.importorskip("rosbags")
    files, manifest = export(plan, "ros2", tmp_path / "ros2")
    assert api.check(tmp_path / "ros2", robot).passed
    assert not check(
        read_trajectory(files["joint_trajectory.yaml"], robot).trajectory, robot
    ).passed
    files, manifest = export(plan, "csv", tmp_path / "csv")
    assert api.check(tmp_path / "csv", robot).passed
    files, manifest = export(plan, "pvt", tmp_path / "pvt", counts_per_turn=4096)
    assert api.check(tmp_path / "pvt", robot).passed
    assert abs(manifest["axes"]["roll"]["end_velocity"]) > 1000
    files, manifest = export(plan, "epos4", tmp_path / "epos4", counts_per_turn=4096)
    assert not api.check(tmp_path / "epos4", robot).violations
    rows = np.loadtxt(files["roll.csv"], delimiter=",", skiprows=1)
    # The last speed and position are those of the plan. The speed does not drop to 0.
    speed = (
        np.diff(rows[-2:, 1])[0]
        / np.diff(rows[-2:, 0])[0]
        / manifest["axes"]["roll"]["increments_per_unit"]
    )
    assert speed == pytest.approx(end_velocities(moving)[1][0], rel=0.02)
    assert abs(rows[-1, 2]) == pytest.approx(abs(rows[-2, 2]), rel=0.05)
    at_end = moving.sample(moving.breaks[-1:], "left").q[0, 0]
    assert rows[-1, 1] == pytest.approx(
        at_end * manifest["axes"]["roll"]["increments_per_unit"], abs=0.6
    )
    assert any("ends moving" in note for note in manifest["notes"])


def test_limits_of_a_slower_motion_ask_for_slower_ends() -> None:
    """A motion at half speed has half the required end rates."""
    limits = TaskLimits(end_rate={"tilt": 0.2})
    assert limits.slower(2.0).end_rate == {"tilt": 0.1}
    assert limits.slower(2.0).start_rate == {}
    assert dataclasses.replace(limits, end_rate=None).slower(2.0).end_rate is None


def stairs(order: int, joint: int, size: float, pieces: int, length: float) -> Trajectory:
    """Return a motion whose position (order 0) or speed (order 1) rises and falls in equal jumps.

    The jumps are at the breaks. Each piece has a length in s.
    """
    breaks = length * np.arange(pieces + 1)
    coefficients = np.zeros((pieces, 6, 4))
    coefficients[:, 0] = [0.3, 1.15, 0.1, -0.02]
    level = size * np.minimum(np.arange(pieces), np.arange(pieces)[::-1])
    coefficients[:, order, joint] += level
    if order == 1:
        coefficients[1:, 0, joint] += np.cumsum(level[:-1]) * length
    return Trajectory(breaks, coefficients, ())


@pytest.mark.parametrize("length", [1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("joint", [0, 3])
def test_small_jumps_that_add_up_to_a_teleport_are_refused(
    robot: Robot, joint: int, length: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each jump is within its tolerance, but their sum is a motion that motors cannot follow."""
    size = 0.999 * JUMP_TOLERANCE
    motion = stairs(0, joint, size, 4001, length)
    name = robot.joints[joint].name
    blocks = []
    for block in (8192, 37):
        monkeypatch.setattr("ssm_planner.verification.pieces.PIECES_PER_BLOCK", block)
        certificate = check(motion, robot)
        (line,) = (c for c in certificate.limits if (c.name, c.joint) == ("position jump", name))
        assert not line.passed
        allowed = JUMP_DRIFT_RATE * robot.joints[joint].velocity * length
        assert line.worst == pytest.approx(4000 * size - 3999 * allowed, rel=1e-6)
        blocks.append(line)
    assert blocks[0].worst == pytest.approx(blocks[1].worst, rel=1e-9)
    other = [c for c in certificate.limits if c.name == "position jump" and c.joint != name]
    assert all(c.worst == 0.0 for c in other)


def test_small_jumps_of_velocity_add_up_to_an_acceleration(robot: Robot) -> None:
    joint = robot.joints[0]
    jump = 0.999 * JUMP_TOLERANCE * joint.velocity
    limit = joint.acceleration
    for share, passes in (
        (0.5 * JUMP_DRIFT_RATE, True),
        (2 * JUMP_DRIFT_RATE, False),
        (1.0, False),
    ):
        motion = stairs(1, 0, jump, 2001, jump / (share * limit))
        certificate = check(motion, robot)
        lines = [c for c in certificate.limits if (c.name, c.joint) == ("velocity jump", "roll")]
        assert [line.passed for line in lines] == [passes]


def test_jumps_that_time_excuses_do_not_add_up(robot: Robot) -> None:
    """Jumps within the tolerated drift do not add up.

    The reported jump is exactly the largest single jump.
    """
    rng = np.random.default_rng(8)
    motion = stairs(0, 0, 0.0, 400, 0.05)
    coefficients = motion.coefficients.copy()
    noise = rng.uniform(-1, 1, 400) * 1e-6 * 0.2 * robot.joints[0].velocity * 0.05
    coefficients[:, 0, 0] += noise
    certificate = check(Trajectory(motion.breaks, coefficients, ()), robot)
    (line,) = (c for c in certificate.limits if (c.name, c.joint) == ("position jump", "roll"))
    assert line.passed
    assert line.worst == np.abs(np.diff(coefficients[:, 0, 0])).max()


@pytest.mark.parametrize("parts", [1, 3])
def test_jumps_add_up_over_the_worst_interval_of_time(robot: Robot, parts: int) -> None:
    """The result is the largest sum over all intervals that end at a break.

    The tolerated drift in the interval is subtracted.
    """
    jumps, rng = JumpRecorder(robot), np.random.default_rng(2)
    time = np.sort(rng.uniform(0.0, 1.0, 12))
    step = jumps._tolerated_drift[:2] / 12
    jump = np.zeros((12, 3, 4))
    jump[:, :2] = step * rng.exponential(1.0, (12, 2, 4))
    blocks = np.array_split(np.arange(12), parts)
    level = np.concatenate([jumps._accumulated_jumps(jump[k], time[k]) for k in blocks])
    for m in range(12):
        sums = [
            jump[first : m + 1].sum(axis=0) - jumps._tolerated_drift * (time[m] - time[first])
            for first in range(m + 1)
        ]
        assert level[m] == pytest.approx(np.max(sums, axis=0), rel=1e-9, abs=1e-12)
