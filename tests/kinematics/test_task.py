"""Joints and task coordinates are converted in both directions, symbolically and numerically.

A pose has two sets of task coordinates, and the sign of the tilt follows one convention.
"""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.kinematics.task import (
    pose_from_task,
    task_from_joints,
    task_from_joints_symbolic,
    task_rates,
    task_rates_symbolic,
    tip_from_task,
)
from ssm_planner.kinematics.workspace import tilt_interval


def test_task_names_the_pose_that_the_joints_make(random_mechanism):
    rng = np.random.default_rng(5)
    for _ in range(200):
        mech = random_mechanism(rng)
        q = rng.uniform(-4.0, 4.0, (50, 4))
        task = task_from_joints(mech, q)
        for reached, named in zip(forward(mech, q), pose_from_task(mech, task), strict=True):
            assert np.abs(reached - named).max() < 1e-12
        low, high = tilt_interval(mech)
        assert np.all((task[:, 1] >= low - 1e-12) & (task[:, 1] <= high + 1e-12))
        assert np.all((task[:, [0, 2]] > -math.pi) & (task[:, [0, 2]] <= math.pi))
        assert np.allclose(task[:, 3], mech.insertion_sign * q[:, 3])


def test_home_is_home(random_mechanism):
    """At zero joint positions, roll and tilt are those of home, and spin and depth are zero."""
    rng = np.random.default_rng(6)
    for _ in range(200):
        mech = random_mechanism(rng)
        home = [mech.home_roll, mech.home_tilt, 0.0, 0.0]
        assert np.abs(task_from_joints(mech, np.zeros(4))[0] - home).max() < 1e-12


def test_pose_of_the_published_robot_is_its_published_formula(vitreoretinal):
    rng = np.random.default_rng(7)
    x, y, z = np.eye(3)
    task = rng.uniform(-3.0, 3.0, (100, 4))
    expected = (
        rotation(x, task[:, 0])
        @ rotation(y, task[:, 1] - vitreoretinal.home_tilt)
        @ vitreoretinal.tool_home
        @ rotation(z, task[:, 2])
    )
    rotations, positions = pose_from_task(vitreoretinal, task)
    assert np.abs(rotations - expected).max() < 1e-14
    assert np.abs(positions + task[:, 3:] * expected[:, :, 2]).max() < 1e-14


def test_two_sets_of_task_coordinates_are_one_pose(random_mechanism):
    """The opposite tilt, with roll and spin turned by π, gives the same pose."""
    rng = np.random.default_rng(8)
    mech = random_mechanism(rng)
    task = rng.uniform(-3.0, 3.0, (100, 4))
    other = task * [1.0, -1.0, 1.0, 1.0] + [math.pi, 0.0, math.pi, 0.0]
    for a, b in zip(pose_from_task(mech, task), pose_from_task(mech, other), strict=True):
        assert np.abs(a - b).max() < 1e-14


def test_roll_and_spin_continue_from_a_neighbour(vitreoretinal):
    q = np.zeros((200, 4))
    q[:, 0] = np.linspace(0.0, 25.0, 200)
    q[:, 2] = np.linspace(0.0, -25.0, 200)
    near = np.zeros(4)
    for item in q:
        task = task_from_joints(vitreoretinal, item, near=near)[0]
        assert np.abs(task - near).max() < 2.1 * math.pi
        near = task
    assert near[0] == pytest.approx(25.0, abs=1e-9)
    assert near[2] == pytest.approx(-25.0, abs=1e-9)


def test_symbolic_equals_numeric(random_mechanism):
    rng = np.random.default_rng(9)
    for _ in range(10):
        mech = random_mechanism(rng)
        symbol = casadi.SX.sym("q", 4)
        function = casadi.Function("task", [symbol], [task_from_joints_symbolic(mech, symbol)])
        for q in rng.uniform(-3.0, 3.0, (20, 4)):
            task = function(q).full()[:, 0]
            assert np.abs(task_from_joints(mech, q, near=task)[0] - task).max() < 1e-13


def test_task_rates_are_differences_of_the_task(random_mechanism):
    rng = np.random.default_rng(10)
    step = 1e-6
    for _ in range(50):
        mech = random_mechanism(rng)
        q, qd = rng.uniform(-3.0, 3.0, (40, 4)), rng.uniform(-1.0, 1.0, (40, 4))
        ahead = task_from_joints(mech, q + step * qd)
        moved = ahead - task_from_joints(mech, q - step * qd, near=ahead)
        # Near a tilt of 0° or 180°, the rates and the errors of finite differences are unbounded.
        clear = np.abs(np.sin(ahead[:, 1])) > 0.05
        assert np.abs(moved / (2 * step) - task_rates(mech, q, qd))[clear].max() < 1e-6


def test_symbolic_task_rates_are_the_derivative_and_the_numeric_ones(random_mechanism):
    rng = np.random.default_rng(11)
    for _ in range(10):
        mech = random_mechanism(rng)
        q, qd = casadi.SX.sym("q", 4), casadi.SX.sym("qd", 4)
        derivative = casadi.jtimes(task_from_joints_symbolic(mech, q), q, qd)
        function = casadi.Function("rates", [q, qd], [task_rates_symbolic(mech, q, qd), derivative])
        points, speeds = rng.uniform(-3.0, 3.0, (50, 4)), rng.uniform(-1.0, 1.0, (50, 4))
        numeric = task_rates(mech, points, speeds)
        for item, speed, expected in zip(points, speeds, numeric, strict=True):
            for result in function(item, speed):
                assert result.full()[:, 0] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_the_tip_follows_from_task_coordinates_by_two_ways(random_mechanism):
    rng = np.random.default_rng(9)
    for _ in range(5):
        mech, task = random_mechanism(rng), rng.uniform(-3.0, 3.0, (40, 4))
        assert tip_from_task(mech, task) == pytest.approx(pose_from_task(mech, task)[1], abs=1e-14)


def test_the_tilt_rate_vanishes_at_the_workspace_boundary(vitreoretinal):
    for x in (0.0, math.pi):
        rates = task_rates(
            vitreoretinal, [0.3, vitreoretinal.delta + x, 0.2, -0.01], [0.1, 0.7, -0.2, -0.02]
        )[0]
        assert rates[1] == pytest.approx(0.0, abs=1e-12)
        assert np.isfinite(rates).all()
        assert rates[3] == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (
            np.array([[0.0, -113.0, 0.0, 0.0]]),
            r"task\[0, 1\] of shape \(1, 4\): tilt = -113 rad.*degrees",
        ),
        (np.zeros((4, 9)), r"task has shape \(4, 9\).*transposed"),
        (np.full((3, 4), math.inf), r"task of shape \(3, 4\) is not finite"),
    ],
)
def test_bad_task_names_the_argument(vitreoretinal, task, message):
    with pytest.raises(GeometryError, match=message):
        pose_from_task(vitreoretinal, task)
