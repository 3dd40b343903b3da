"""The independent oracle of tests/support agrees with the dynamics and with the check."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ssm_planner.dynamics import RigidBody
from ssm_planner.dynamics.friction import breakaway_coefficient
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.kinematics import tool_speed
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.plans import load_plan
from ssm_planner.problem import Problem, TaskLimits, TaskRange, TipSpeed
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import cubic_coefficients, quintic_coefficients
from ssm_planner.verification.check import check
from tests.support import oracle, pinocchio_model
from tests.support.paths import ROOT
from tests.support.plans import smooth, trapezoids
from tests.support.random_problems import random_problem

TIP = 0.1


def states(seed: int, count: int = 60) -> np.ndarray:
    """Return random q, q̇ and q̈, (3, n, 4)."""
    scale = np.array([1.0, 1.0, 1.0, 0.02])
    return np.random.default_rng(seed).normal(size=(3, count, 4)) * scale


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_efforts_are_those_of_the_package_and_of_pinocchio(tilt_insert: Problem, seed: int) -> None:
    robot = random_problem(tilt_insert, seed).robot
    q, qd, qdd = states(seed)
    result = oracle.efforts(robot, q, qd, qdd)
    assert result == pytest.approx(
        RigidBody.from_robot(robot).inverse_dynamics(q, qd, qdd), abs=1e-12
    )
    pin = pytest.importorskip("pinocchio")
    model = pinocchio_model.build(robot)
    data = model.createData()
    expected = [pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)]
    assert result == pytest.approx(np.array(expected), abs=1e-12)


@pytest.mark.parametrize("law", ["coulomb", "stribeck_exponential", "stribeck_gaussian"])
def test_motor_torques_are_those_of_the_motor_law(robot: Robot, law: str) -> None:
    rng = np.random.default_rng(4)
    more = {} if law == "coulomb" else {"mu_stribeck": 0.06, "stribeck_speed": 8.0}
    for i in (0, 1, 3):
        drive = robot.joints[i].drive
        assert drive is not None
        assert drive.friction is not None
        drive = dataclasses.replace(
            drive, friction=dataclasses.replace(drive.friction, law=law, **more)
        )
        qd = rng.normal(size=200) * robot.joints[i].velocity * rng.choice((1e-3, 1.0), 200)
        qdd, load = rng.normal(size=(2, 200)) * [[3.0], [2.0]]
        way = np.sign(qd)
        effort = output_effort(drive, load, qd, qdd, way)
        w, wd = drive.ratio * qd, drive.ratio * qdd
        result = oracle.motor_torque(drive, load, qd, qdd, way)
        assert result == pytest.approx(motor_torque(drive, effort, w, wd), rel=1e-9)
        started = oracle.motor_torque(drive, load, qd, qdd, way, True)
        mu = breakaway_coefficient(drive.friction, w)
        assert started == pytest.approx(motor_torque(drive, effort, w, wd, mu=mu), rel=1e-9)
        assert not oracle.motor_torque(drive, load, qd, qdd, 0 * way).any()


def test_tilt_and_speed_of_the_tip_are_those_of_the_kinematics(tilt_insert: Problem) -> None:
    for seed in range(5):
        robot = random_problem(tilt_insert, seed).robot
        mechanism = Mechanism.from_geometry(robot.geometry)
        q, qd, _ = states(seed)
        tilts = task_from_joints(mechanism, q)[:, 1]
        assert oracle.tilt(robot, q) == pytest.approx(tilts, abs=1e-9)
        speeds = tool_speed(TipSpeed, mechanism, q, qd)
        assert oracle.tip_speed(robot, q, qd) == pytest.approx(speeds, rel=1e-9)


def test_rows_are_joined_as_the_client_joins_them() -> None:
    """The oracle joins rows by cubics or quintics, and by lines where a velocity is missing."""
    q, qd, qdd = states(6, 8)
    t = np.cumsum(np.random.default_rng(6).uniform(1e-3, 1.0, 8))
    h = np.diff(t)
    for orders, join in ((2, cubic_coefficients), (3, quintic_coefficients)):
        rows = (q, qd, qdd)[:orders]
        pieces = join(h, *(tuple(x[side] for x in rows) for side in (slice(-1), slice(1, None))))
        expected = oracle.from_pieces(t, pieces)
        assert oracle.through(t, *rows).powers == pytest.approx(expected.powers, abs=1e-12)
    left_out = qd.copy()
    left_out[3] = np.nan
    mixed = oracle.through(t, q, left_out)
    assert mixed.curved.tolist() == [True, True, False, False, True, True, True]
    line = oracle.at(mixed, np.array([2]), np.array([0.25]), 0)
    assert line[0] == pytest.approx(0.75 * q[2] + 0.25 * q[3])


@pytest.mark.parametrize("name", ["trapezoids", "smooth", "tilt_insert"])
def test_the_worst_values_are_those_of_the_certificate(robot: Robot, name: str) -> None:
    """The oracle samples instants. It may miss a part of an extreme, but never reports more."""
    motion = load_plan(ROOT / "results/tilt_insert").motion
    if name != "tilt_insert":
        motion = (trapezoids if name == "trapezoids" else smooth)(robot)
    limits = TaskLimits((TaskRange("tilt", -2.4, -1.42), TipSpeed(TIP)))
    certificate = check(motion, robot, limits)
    played = oracle.from_pieces(motion.breaks, motion.coefficients)
    result = oracle.violations(played, robot, ranges={"tilt": (-2.4, -1.42)}, tip=TIP)
    common = [line for line in certificate.limits if (line.name, line.joint) in result]
    assert {"position", "velocity", "acceleration", "motor speed", "motor torque"} <= {
        line.name for line in common
    }
    for line in common:
        excess = result[line.name, line.joint]
        assert excess == pytest.approx(-line.margin, abs=5e-4), line
        assert excess <= -line.margin + 1e-6, line
    assert all(excess < 0 for (limit, _), excess in result.items() if limit.startswith("steps"))


@pytest.mark.parametrize(("size", "broken"), [(5e-7, False), (2e-6, True)])
def test_steps_count_as_speed(robot: Robot, size: float, broken: bool) -> None:
    """One step of less than 1 µrad does not count.

    Several such steps, or a larger step, count as an excess.
    """
    motion = trapezoids(robot)
    for times in (1, 4):
        coefficients = motion.coefficients.copy()
        coefficients[2:, 0, 0] += size
        if times > 1:
            coefficients[3:, 0, 0] += 9 * size
        result = oracle.violations(oracle.from_pieces(motion.breaks, coefficients), robot)
        assert (result["steps of position", "roll"] > 1e-3) is (broken or times > 1)
    coefficients = motion.coefficients.copy()
    coefficients[0, 1, 0] += size * robot.joints[0].velocity
    result = oracle.violations(oracle.from_pieces(motion.breaks, coefficients), robot)
    assert (result["steps of velocity", "roll"] > 1e-3) is broken


def test_a_target_is_missed_beyond_its_tolerance(robot: Robot) -> None:
    motion = trapezoids(robot)
    played = oracle.from_pieces(motion.breaks, motion.coefficients)
    middle, end = motion.sample(motion.breaks[[3, -1]], "left").q
    way = np.array([0.6, 0.0, 0.0, 0.8]) * oracle.TARGET
    assert oracle.missed(played, [middle, end]) == pytest.approx(-1, abs=0.1)
    assert oracle.missed(played, [middle, end + 0.9 * way]) == pytest.approx(-0.1)
    assert oracle.missed(played, [middle, end + 1.1 * way]) == pytest.approx(0.1)
    assert oracle.missed(played, [end + 2 * way, end]) > 0


def test_a_small_excess_of_every_limit_is_seen(robot: Robot) -> None:
    """The oracle finds a motion that exceeds a limit by 0.3 %, with the right excess."""
    motion = trapezoids(robot, share=1.0)
    quicker = motion.slower(1.003)
    played = oracle.from_pieces(quicker.breaks, quicker.coefficients)
    result = oracle.violations(played, robot)
    assert result["velocity", "tilt"] == pytest.approx(3e-3, rel=1e-6)
    assert result["acceleration", "tilt"] == pytest.approx(1.003**2 - 1, rel=1e-6)
