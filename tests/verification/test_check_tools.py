"""Bernstein polynomials agree with dense evaluation, the evaluation in blocks agrees with CasADi,
and the symbolic torques of the motors agree with the model.
"""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyval

from ssm_planner.codegen.vectorised import VectorisedFunction, dense_function
from ssm_planner.dynamics.motors import (
    motion_directions,
    motion_directions_symbolic,
    motor_motion,
    motor_torque_symbolic,
)
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import GeometryError
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Samples
from ssm_planner.verification import bernstein

numbers = st.floats(-10, 10, allow_nan=False).map(lambda x: round(x, 3))
polynomials = st.lists(st.lists(numbers, min_size=1, max_size=6), min_size=1, max_size=5)


@given(polynomials)
@settings(max_examples=150, deadline=None)
def test_the_largest_value_is_that_of_dense_evaluation(rows: list[list[float]]) -> None:
    degree = max(len(row) for row in rows)
    powers = np.array([row + [0.0] * (degree - len(row)) for row in rows])
    groups = bernstein.from_powers(powers).T[None]
    value, index, s = (
        found[0]
        for found in bernstein.find_group_maxima(groups, np.array([1e-12]), np.array([-np.inf]))
    )
    grid = np.linspace(0, 1, 2001)
    assert value >= max(float(np.polyval(row[::-1], grid).max()) for row in powers) - 1e-9
    assert value == pytest.approx(float(np.polyval(powers[index, ::-1], s)), abs=1e-9)


@given(
    st.lists(st.floats(0.02, 0.98), min_size=1, max_size=4, unique_by=lambda x: round(x, 2)),
    st.sampled_from([-1, 1]),
)
@settings(max_examples=150, deadline=None)
def test_every_simple_zero_is_found(zeros: list[float], sign: int) -> None:
    powers = sign * np.poly(zeros)[None, ::-1]
    _, found = bernstein.find_sign_changes(bernstein.from_powers(powers), np.array([1e-12]))
    assert np.sort(found) == pytest.approx(sorted(zeros), abs=1e-9)


def test_no_zeros_within_the_tolerance() -> None:
    powers = np.array([[-1e-12, 2e-12], [-1.0, 2.0]])
    index, s = bernstein.find_sign_changes(bernstein.from_powers(powers), np.full(2, 1e-9))
    assert index.tolist() == [1]
    assert s == pytest.approx([0.5])


@given(st.lists(numbers, min_size=1, max_size=6))
@settings(max_examples=50, deadline=None)
def test_powers_and_bernstein_coefficients_are_inverse(row: list[float]) -> None:
    powers = np.array(row)[None]
    coefficients = bernstein.from_powers(powers)
    assert bernstein.to_powers(coefficients) == pytest.approx(powers, abs=1e-10)
    assert coefficients[0, 0] == powers[0, 0]
    assert coefficients[0, -1] == pytest.approx(powers.sum())
    left, right = bernstein.split_at_middle(coefficients)
    for part, s in ((left, 0.25), (right, 0.75)):
        assert polyval(0.5, bernstein.to_powers(part)[0]) == pytest.approx(
            polyval(s, powers[0]), abs=1e-9
        )


def every_operation() -> ca.Function:
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    a, b, c = x[0], x[1], x[2]
    rows = [
        a + b, a - b, a * b, a / (2 + b * b), -a, ca.exp(a / 3), ca.log(1 + b * b), ca.sqrt(1 + c * c), a**2, a + a,
        1 / (3 + c),
        ca.sin(a), ca.cos(b), ca.tan(c / 4), ca.asin(a / 4), ca.acos(b / 4), ca.atan(c), ca.floor(a), ca.ceil(b), ca.fabs(c),
        ca.sign(a), ca.if_else(a > b, c, y), ca.if_else(a <= 0, b, a), ca.fmin(a, b), ca.fmax(b, c), ca.atan2(a, b),
        ca.logic_and(a > 0, b > 0), ca.logic_or(a > 0, b > 0), ca.logic_not(a > 0), a == b, a != b, ca.fmod(a, 2 + b * b),
        (2 + a * a) ** y, ca.copysign(a, b), 7.0, y,
    ]  # fmt: skip
    return dense_function("every_operation", [x, y], [ca.vertcat(*rows), ca.vertcat(a, 0.0)])


def test_bulk_evaluation_is_casadi_s(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ssm_planner.codegen.vectorised.SAMPLES_PER_BLOCK", 64)
    rng = np.random.default_rng(3)
    function = every_operation()
    x, y = rng.uniform(-3, 3, (150, 3)), rng.uniform(-2, 2, (150, 1))
    x[:10] = 0.0
    x[10:20, 1] = x[10:20, 0]
    result = VectorisedFunction(function)(x, y)
    monkeypatch.setenv("SSM_PLANNER_NATIVE", "0")
    for mine, theirs in zip(result, VectorisedFunction(function)(x, y), strict=True):
        assert mine.tobytes() == theirs.tobytes()
    for k in range(150):
        for mine, theirs in zip(result, function(x[k], y[k]), strict=True):
            assert mine[k] == pytest.approx(theirs.full()[:, 0], rel=1e-14, abs=1e-15)


def test_bulk_evaluation_refuses_wrong_shapes() -> None:
    function = VectorisedFunction(every_operation())
    with pytest.raises(GeometryError, match="every_operation"):
        function(np.zeros((5, 3)), np.zeros((4, 1)))
    with pytest.raises(GeometryError, match="every_operation"):
        function(np.zeros((3, 5)), np.zeros((3, 1)))


def random_samples(rng: np.random.Generator, count: int) -> Samples:
    """Return random states. In many of them, one or all derivatives of a joint are 0."""
    q, qd, qdd, qddd = (rng.normal(size=(count, 4)) for _ in range(4))
    for values in (qd, qdd, qddd):
        values[rng.random(values.shape) < 0.3] = 0.0
    qd[rng.random(qd.shape) < 0.3] *= 1e-10
    return Samples(np.arange(count, dtype=float), q, qd, qdd, qddd)


def variants(robot: Robot) -> list[Robot]:
    """Return robots whose joint 4 has other drives.

    The drives have an antibacklash nut and Stribeck friction, or do not lock themselves.
    """
    joint = robot.joints[3]
    stribeck = {"mu_stribeck": 0.05, "stribeck_speed": 3.0}
    drives = []
    for law in ("stribeck_gaussian", "stribeck_exponential"):
        friction = dataclasses.replace(joint.drive.friction, law=law, **stribeck)
        drives.append(
            dataclasses.replace(
                joint.drive,
                kind="antibacklash_screw",
                preload=5.0,
                second_nut_mass=0.05,
                friction=friction,
            )
        )
    slippery = dataclasses.replace(joint.drive.friction, mu=0.05, mu_static=0.06)
    drives.append(dataclasses.replace(joint.drive, friction=slippery, self_locking=False))
    return [robot] + [
        dataclasses.replace(
            robot, joints=(*robot.joints[:3], dataclasses.replace(joint, drive=drive))
        )
        for drive in drives
    ]


@pytest.mark.parametrize("side", [1, -1])
def test_the_motors_law_is_that_of_the_model(robot: Robot, side: int) -> None:
    """The torque, the effort and the directions equal those of the model.

    The joints move, rest, start or are held.
    """
    samples = random_samples(np.random.default_rng(5), 4000)
    for item in variants(robot):
        direction, breakaway = motion_directions(item, samples, side)
        expected = motor_motion(item, RigidBody.from_robot(item), samples, direction, breakaway)
        q, qd, qdd, qddd, way, away = (
            ca.SX.sym(name, 4) for name in ("q", "qd", "qdd", "qddd", "way", "away")
        )
        law = VectorisedFunction(
            dense_function(
                "law",
                [q, qd, qdd, way, away],
                list(motor_torque_symbolic(item, q, qd, qdd, way, away)),
            )
        )
        _, torque, effort = law(
            samples.q, samples.qd, samples.qdd, direction, np.asarray(breakaway, dtype=float)
        )
        for i, joint in enumerate(item.joints):
            if joint.drive is None:
                assert not torque[:, i].any()
                continue
            size = np.abs(expected.torque[:, i]).max()
            assert np.abs(torque[:, i] - expected.torque[:, i]).max() <= 1e-14 * size
            assert effort[:, i] == pytest.approx(expected.effort[:, i], rel=1e-13, abs=1e-13)
        rule = VectorisedFunction(
            dense_function(
                "rule", [qd, qdd, qddd], list(motion_directions_symbolic(item, qd, qdd, qddd, side))
            )
        )
        result = rule(samples.qd, samples.qdd, samples.qddd)
        assert np.array_equal(result[0], direction)
        assert np.array_equal(result[1] != 0, np.asarray(breakaway, dtype=bool))
