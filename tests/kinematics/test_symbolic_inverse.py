"""The symbolic inverse kinematics equals the numeric one.

Its derivatives agree with finite differences.
"""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest

from ssm_planner.kinematics.forward import forward, forward_symbolic
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.task import joints_from_task_symbolic, task_from_joints_symbolic
from ssm_planner.kinematics.workspace import tilt_interval

BRANCHES = (1, -1)


def joints_function(mech, branch: int) -> casadi.Function:
    """Return a function that gives joints (4,) and their Jacobian (4, 4) for task coordinates."""
    task = casadi.SX.sym("task", 4)
    joints = joints_from_task_symbolic(mech, task, branch)
    return casadi.Function("joints", [task], [joints, casadi.jacobian(joints, task)])


def tasks_inside(rng: np.random.Generator, mech, count: int) -> np.ndarray:
    """Return task coordinates (count, 4) with tilts on both sides of ω1.

    The distance of each tilt from the boundary is at least a tenth of the tilt interval.
    """
    low, high = tilt_interval(mech)
    task = rng.uniform(-4.0, 4.0, (count, 4))
    task[:, 1] = (low + (high - low) * rng.uniform(0.1, 0.9, count)) * rng.choice(
        [-1.0, 1.0], count
    )
    return task


def test_symbolic_equals_numeric_on_every_branch(random_mechanism):
    rng = np.random.default_rng(31)
    for _ in range(20):
        mech = random_mechanism(rng)
        task = tasks_inside(rng, mech, 10)
        numeric = inverse_task(mech, task).joints
        for k, branch in enumerate(BRANCHES):
            function = joints_function(mech, branch)
            for i in range(10):
                assert np.abs(function(task[i])[0].full()[:, 0] - numeric[i, k]).max() < 1e-11


def test_first_derivatives_agree_with_finite_differences(random_mechanism):
    rng = np.random.default_rng(32)
    step = 3e-4
    # These weights give the sixth-order central difference.
    weights = {1: 3.0 / 4.0, 2: -3.0 / 20.0, 3: 1.0 / 60.0}
    for _ in range(10):
        mech = random_mechanism(rng, rng.uniform(0.4, 2.7), rng.uniform(0.4, 2.7))
        for branch in BRANCHES:
            function = joints_function(mech, branch)
            for task in tasks_inside(rng, mech, 5):
                exact = function(task)[1].full()
                difference = np.zeros((4, 4))
                for j in range(4):
                    for k, weight in weights.items():
                        shift = k * step * np.eye(4)[j]
                        ahead, behind = (
                            function(task + shift)[0].full(),
                            function(task - shift)[0].full(),
                        )
                        difference[:, j] += weight * (ahead - behind)[:, 0] / step
                assert np.abs(exact - difference).max() <= 1e-6 * np.abs(exact).max()


def test_second_derivatives_agree_with_differences_of_the_first(random_mechanism):
    rng = np.random.default_rng(33)
    mech = random_mechanism(rng, 0.6, 1.7)
    symbol = casadi.SX.sym("task", 4)
    joints = joints_from_task_symbolic(mech, symbol, 1)
    first = casadi.vec(casadi.jacobian(joints, symbol))
    function = casadi.Function("second", [symbol], [first, casadi.jacobian(first, symbol)])
    step = 1e-5
    for task in tasks_inside(rng, mech, 10):
        exact = function(task)[1].full()
        shifts = step * np.eye(4)
        columns = [
            (function(task + item)[0] - function(task - item)[0]).full()[:, 0] / (2.0 * step)
            for item in shifts
        ]
        assert np.abs(exact - np.stack(columns, axis=1)).max() <= 1e-6 * np.abs(exact).max()


def test_inverse_undoes_forward_symbolically(random_mechanism):
    rng = np.random.default_rng(34)
    for _ in range(10):
        mech = random_mechanism(rng)
        task = casadi.SX.sym("task", 4)
        for branch in BRANCHES:
            joints = joints_from_task_symbolic(mech, task, branch)
            outputs = [task_from_joints_symbolic(mech, joints), *forward_symbolic(mech, joints)]
            function = casadi.Function("loop", [task], outputs)
            for item in tasks_inside(rng, mech, 5):
                item[1] = mech.side * abs(item[1])
                again, _, position = function(item)
                gap = again.full()[:, 0] - item
                gap[[0, 2]] = np.remainder(gap[[0, 2]] + math.pi, 2.0 * math.pi) - math.pi
                assert np.abs(gap).max() < 1e-11
                expected = forward(mech, inverse_task(mech, item).joints[:, 0])[1][0]
                assert np.abs(position.full()[:, 0] - expected).max() < 1e-11


def test_a_reference_moves_by_whole_turns(vitreoretinal):
    """A reference shifts the joints by whole turns and does not change their derivatives."""
    task = casadi.SX.sym("task", 4)
    near = np.array([20.0, -15.0, 9.0, 0.0])
    plain = joints_from_task_symbolic(vitreoretinal, task, -1)
    moved = joints_from_task_symbolic(vitreoretinal, task, -1, reference=near)
    jacobians = casadi.jacobian(plain, task), casadi.jacobian(moved, task)
    function = casadi.Function("joints", [task], [plain, moved, *jacobians])
    a, b, first, second = (item.full() for item in function([0.2, -2.0, 0.3, 0.01]))
    turns = (b - a)[:, 0] / (2.0 * math.pi)
    assert np.abs(turns - turns.round()).max() < 1e-12
    assert np.abs((b[:, 0] - near)[:3]).max() <= math.pi
    assert np.array_equal(first, second)


def test_outside_the_workspace_is_not_a_number(vitreoretinal):
    values = joints_function(vitreoretinal, -1)([0.0, -1.0, 0.0, 0.0])[0].full()[:, 0]
    assert np.isnan(values[:3]).all()
    assert values[3] == pytest.approx(0.0)
