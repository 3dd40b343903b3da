"""Stops of robots with jerk limits are as quick as those of the package ruckig. They exist at every
instant, keep every limit, and pass the check after an export.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import ruckig
from hypothesis import given
from hypothesis import strategies as st

import ssm_planner as ssm
from ssm_planner import Plan, Problem, Robot, Trajectory
from ssm_planner.cli import main
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.trajectory import Samples
from ssm_planner.verification import check_stops, quickest_stops
from ssm_planner.verification.joint_stops import _stops_from_states
from tests.support.cases import drawn
from tests.support.paths import PROBLEMS
from tests.support.random_problems import random_problem

JERKY = """
joints: {roll: {jerk: 4000 deg/s^3}, tilt: {jerk: 4000 deg/s^3}, insertion: {jerk: 2 m/s^3}}
"""


def with_jerk(robot: Robot, ratio: float) -> Robot:
    """Return the robot with jerk limits, which are the acceleration limits times a ratio in 1/s."""
    joints = [replace(joint, jerk=ratio * joint.acceleration) for joint in robot.joints]
    return replace(robot, joints=tuple(joints))


@pytest.fixture(scope="module")
def plan(tilt_insert: Problem) -> Plan:
    robot = with_jerk(tilt_insert.robot, 20.0)
    return ssm.plan(unchecked_copy(tilt_insert, robot=robot, planner="fast"), relaxations=False)


def state(velocity: np.ndarray, acceleration: np.ndarray) -> Samples:
    """Return one instant of a motion at the position 0."""
    zeros = np.zeros((1, 4))
    return Samples(np.zeros(1), zeros, velocity[None], acceleration[None], zeros)


fractions = st.lists(st.floats(-1.0, 1.0).map(lambda x: round(x, 3)), min_size=4, max_size=4)


@given(v=fractions, a=fractions, together=st.booleans())
def test_stops_are_as_short_as_by_ruckig(
    v: list[float], a: list[float], together: bool, tilt_insert: Problem
) -> None:
    robot = with_jerk(tilt_insert.robot, 20.0)
    velocity = np.array(v) * robot.velocities
    acceleration = np.array(a) * robot.accelerations
    stop = _stops_from_states(state(velocity, acceleration), robot, 1.0, together=together)
    lengths, coefficients = stop[0]
    if not len(lengths):
        assert not velocity.any()
        return
    motion = Trajectory(np.append(0.0, np.cumsum(lengths)), coefficients, ())
    start, end = motion.sample([0.0]), motion.sample([motion.duration], "left")
    np.testing.assert_allclose(start.qd[0], velocity, atol=1e-9)
    np.testing.assert_allclose(start.qdd[0], acceleration, atol=1e-7)
    np.testing.assert_allclose(end.qd[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(end.qdd[0], 0.0, atol=1e-6)
    inner = motion.breaks[1:-1]
    left, right = motion.sample(inner, "left"), motion.sample(inner)
    for name in ("q", "qd", "qdd"):
        np.testing.assert_allclose(getattr(left, name), getattr(right, name), atol=1e-6)
    middle = motion.sample(motion.breaks[:-1] + lengths / 2)
    jerks = np.array([joint.jerk for joint in robot.joints])
    assert np.all(np.abs(middle.qddd) <= jerks * (1 + 1e-9))
    assert np.all(np.abs(right.qdd) <= robot.accelerations * (1 + 1e-9))
    otg, wanted, answer = ruckig.Ruckig(4), ruckig.InputParameter(4), ruckig.Trajectory(4)
    wanted.control_interface = ruckig.ControlInterface.Velocity
    wanted.synchronization = ruckig.Synchronization.No
    wanted.current_velocity, wanted.current_acceleration = velocity, acceleration
    wanted.target_velocity = wanted.target_acceleration = [0.0] * 4
    wanted.max_acceleration, wanted.max_jerk = robot.accelerations, jerks
    otg.calculate(wanted, answer)
    assert motion.duration == pytest.approx(max(answer.independent_min_durations), abs=1e-6)


@pytest.mark.parametrize("seed", drawn(2, [101, 108, 117, 122, 129]))
def test_every_stop_of_a_random_motion_is_certified(seed: int, tilt_insert: Problem) -> None:
    problem = random_problem(tilt_insert, seed)
    ratio = float(np.random.default_rng(seed).choice([5, 20, 60]))
    problem = unchecked_copy(problem, robot=with_jerk(problem.robot, ratio), planner="fast")
    stops = ssm.controlled_stops(ssm.plan(problem, relaxations=False), instants=200)
    assert stops.passed
    assert stops.duration.max() > 0.0


def test_stops_are_short_where_nothing_forbids_them(plan: Plan) -> None:
    robot = plan.robot
    stops = ssm.controlled_stops(plan)
    longest = robot.velocities / robot.accelerations + 1 / 20.0  # v/A + A/J
    # An accelerating joint first loses its acceleration, and gains the speed A²/2J in this time.
    assert stops.duration.max() <= longest.max() + 2 / 20.0


def test_the_motion_continues_where_no_stop_is_possible(plan: Plan) -> None:
    instants = np.linspace(0.0, plan.motion.duration, 40)
    # Motors this weak cannot brake harder than the motion does.
    limit = ssm.TaskLimits(plan.limits.limits, eye=plan.limits.eye)
    weak = [
        replace(joint, motor=joint.motor and unchecked_copy(joint.motor, max_torque=1e-6))
        for joint in plan.robot.joints
    ]
    robot = replace(plan.robot, joints=tuple(weak))
    stops = quickest_stops(plan.motion, robot, instants, limit)
    remaining = plan.motion.duration - instants[1:]  # The robot still rests at the first instant.
    assert stops.duration[1:] == pytest.approx(remaining, abs=1e-6)
    certificate = check_stops(stops, plan.motion, plan.robot, limit)
    assert certificate.passed
    for time, stop in zip(stops.time, stops.motions, strict=True):
        if stop is not None:
            t = np.linspace(0.0, stop.duration, 20)
            later = np.minimum(time + t, plan.motion.duration)
            np.testing.assert_allclose(stop.positions(t), plan.motion.positions(later), atol=1e-9)


@pytest.fixture(scope="module")
def jerky(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a problem with jerk limits, and save its plan in the folder `plan` beside it.

    Return the file of the problem.
    """
    text = (PROBLEMS / "tilt_insert.yaml").read_text(encoding="utf-8")
    problem = tmp_path_factory.mktemp("jerky") / "jerky.yaml"
    robots = f"robot: {PROBLEMS}/robots/"
    problem.write_text(text.replace("robot: robots/", robots) + JERKY, encoding="utf-8")
    ssm.plan(problem).save(problem.with_name("plan"))
    return problem


@pytest.mark.parametrize("format", ["csv", "epos4"])
def test_exported_stops_pass_the_check(
    format: str, jerky: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = jerky
    folder = tmp_path / format
    words = ["--to", format, "--stops", "30", "-o", str(folder)]
    assert main(["export", str(problem.with_name("plan")), *words]) == 0
    stops = folder / "stops.csv"
    capsys.readouterr()
    judged = 0 if format == "csv" else 4  # Positions alone do not show jerks.
    assert main(["check", str(folder), "--problem", str(problem)]) == judged
    # A forged stop that is too fast for the joints is refused, also with updated hashes.
    manifest = folder / "manifest.json"
    rows = [line.split(",") for line in stops.read_text(encoding="utf-8").splitlines()]
    first = next(k for k, row in enumerate(rows[1:], 1) if row[1] == "0.000000" and k > 300)
    forged = [row if k < first else [*row[:5], rows[first][5]] for k, row in enumerate(rows)]
    old = hashlib.sha256(stops.read_bytes()).hexdigest()
    stops.write_text("\n".join(map(",".join, forged)) + "\n", encoding="utf-8")
    new = hashlib.sha256(stops.read_bytes()).hexdigest()
    text = manifest.read_text(encoding="utf-8")
    assert old in text
    manifest.write_text(text.replace(old, new), encoding="utf-8")
    assert main(["check", str(folder), "--problem", str(problem)]) not in (0, judged)
