"""Axes, forward kinematics and Jacobians obey geometric laws.

Pinocchio is the independent reference.
"""

from __future__ import annotations

import math
from dataclasses import replace

import casadi
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ssm_planner.errors import GeometryError, ProblemError
from ssm_planner.kinematics.forward import (
    forward,
    forward_symbolic,
    space_jacobian,
    tip_position,
    tip_position_symbolic,
)
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import cross_product_matrix, rotation
from ssm_planner.problem.robot import Geometry

RNG_SEED = 3


def pinocchio_model(mechanism: Mechanism):
    """Return the same mechanism as a Pinocchio model, and the id of its tool frame."""
    pin = pytest.importorskip("pinocchio")
    model = pin.Model()
    joint = 0
    for i, axis in enumerate((mechanism.omega1, mechanism.omega2, mechanism.omega3)):
        joint = model.addJoint(
            joint, pin.JointModelRevoluteUnaligned(axis), pin.SE3.Identity(), f"revolute{i}"
        )
    joint = model.addJoint(
        joint, pin.JointModelPrismaticUnaligned(mechanism.omega3), pin.SE3.Identity(), "slide"
    )
    placement = pin.SE3(np.array(mechanism.tool_home), np.zeros(3))
    frame = model.addFrame(pin.Frame("tool", joint, placement, pin.FrameType.OP_FRAME))
    return model, frame


def test_published_robot_has_its_published_angles(vitreoretinal):
    assert math.degrees(vitreoretinal.alpha) == pytest.approx(30.0, abs=1e-12)
    assert math.cos(vitreoretinal.beta) == pytest.approx(
        float(vitreoretinal.omega2 @ vitreoretinal.omega3), abs=1e-15
    )
    assert math.degrees(vitreoretinal.beta) == pytest.approx(109.778, abs=5e-4)
    assert math.degrees(vitreoretinal.home_tilt) == pytest.approx(-113.0, abs=1e-12)
    assert vitreoretinal.home_roll == 0.0


def test_home_roll_and_tilt_point_at_omega3(random_mechanism):
    rng = np.random.default_rng(RNG_SEED)
    for _ in range(200):
        mech = random_mechanism(rng)
        pointing = (
            rotation(mech.omega1, mech.home_roll)
            @ rotation(mech.tilt_axis, mech.home_tilt)
            @ mech.omega1
        )
        assert np.abs(pointing - mech.omega3).max() < 1e-14
        assert -math.pi / 2 < mech.home_roll <= math.pi / 2 + 1e-12
        assert abs(mech.tilt_axis @ mech.omega1) < 1e-15
        assert mech.tilt_axis @ mech.omega2 > 0.0


def test_delta_is_where_the_tool_is_nearest_to_omega1(random_mechanism):
    rng = np.random.default_rng(RNG_SEED)
    sweep = np.linspace(-math.pi, math.pi, 721)
    for _ in range(50):
        mech = random_mechanism(rng)
        cosine = rotation(mech.omega2, mech.delta + sweep) @ mech.omega3 @ mech.omega1
        assert np.argmax(cosine) == 360
        assert mech.home_branch == (1 if math.sin(-mech.delta) >= 0.0 else -1)


def test_the_published_angles_give_the_published_axes(vitreoretinal):
    result = Mechanism.from_angles(vitreoretinal.alpha, vitreoretinal.beta, vitreoretinal.home_tilt)
    for name in ("omega1", "omega2", "omega3", "tilt_axis", "tool_home"):
        assert np.abs(getattr(result, name) - getattr(vitreoretinal, name)).max() < 1e-15


@pytest.mark.parametrize(
    ("alpha", "beta"), [(0.5, 0.5), (2.8, 2.0), (2.0, 0.4), (0.0, 1.0), (1.0, math.pi)]
)
def test_a_mechanism_from_angles_returns_these_angles(alpha, beta):
    mech = Mechanism.from_angles(alpha, beta)
    assert mech.alpha == pytest.approx(alpha, abs=1e-15)
    assert mech.beta == pytest.approx(beta, abs=1e-14)


def test_forward_and_jacobians_agree_with_pinocchio(random_mechanism):
    pin = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(RNG_SEED)
    for _ in range(20):
        mech = random_mechanism(rng)
        model, frame = pinocchio_model(mech)
        data = model.createData()
        q = rng.uniform(-3.0, 3.0, (10, 4))
        (rotations, positions), jacobians = forward(mech, q), space_jacobian(mech, q)
        for i, item in enumerate(q):
            pin.computeJointJacobians(model, data, item)
            placed = pin.updateFramePlacement(model, data, frame)
            assert np.abs(placed.rotation - rotations[i]).max() < 1e-14
            assert np.abs(placed.translation - positions[i]).max() < 1e-14
            world = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.WORLD)
            assert np.abs(world - jacobians[i]).max() < 1e-14


def test_forward_is_the_product_of_exponentials(random_mechanism):
    rng = np.random.default_rng(RNG_SEED)
    mech = random_mechanism(rng)
    q = rng.uniform(-3.0, 3.0, (3000, 4))
    elbow = rotation(mech.omega1, q[:, 0]) @ rotation(mech.omega2, q[:, 1])
    rotations, positions = forward(mech, q)
    assert np.abs(rotations - elbow @ rotation(mech.omega3, q[:, 2]) @ mech.tool_home).max() < 1e-14
    assert np.abs(positions - (elbow @ mech.omega3) * q[:, 3:]).max() < 1e-14
    assert np.array_equal(tip_position(mech, q), positions)


def test_symbolic_forward_equals_numeric(random_mechanism):
    rng = np.random.default_rng(RNG_SEED)
    for _ in range(5):
        mech = random_mechanism(rng)
        symbol = casadi.SX.sym("q", 4)
        outputs = [*forward_symbolic(mech, symbol), tip_position_symbolic(mech, symbol)]
        function = casadi.Function("forward", [symbol], outputs)
        q = rng.uniform(-3.0, 3.0, (20, 4))
        rotations, positions = forward(mech, q)
        numeric = rotations, positions[..., np.newaxis], positions[..., np.newaxis]
        for i, item in enumerate(q):
            for symbolic, array in zip(function(item), numeric, strict=True):
                assert np.abs(symbolic.full() - array[i]).max() < 1e-14


def test_rotation_is_that_of_scipy():
    axis = np.array([0.6, 0.0, 0.8])
    angle = np.array([0.0, 1e-9, 1.0, math.pi - 1e-9, math.pi, -2.0])
    expected = Rotation.from_rotvec(axis * angle[:, np.newaxis])
    assert np.abs(rotation(axis, angle) - expected.as_matrix()).max() < 1e-15
    assert (
        np.abs(
            cross_product_matrix(axis) @ np.array([1.0, 2.0, 3.0]) - np.cross(axis, [1.0, 2.0, 3.0])
        ).max()
        < 1e-15
    )


GEOMETRY = Geometry(
    omega1=np.array([1.0, 0.0, 0.0]),
    omega2=np.array([0.0, 1.0, 0.0]),
    omega3=np.array([0.0, 0.0, 1.0]),
    tool_home=np.eye(3),
)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"omega1": np.array([1.0, 0.1, 0.0])},
            r"Geometry\.omega1 = .*length 1\.004988 .*unit vector",
        ),
        ({"omega2": np.array([-1.0, 0.0, 0.0])}, "joints 1 and 2 are parallel"),
        ({"omega3": np.array([0.0, 1.0, 0.0])}, "joints 2 and 3 are parallel"),
        (
            {"omega3": np.array([0.0, math.nan, 1.0])},
            r"Geometry\.omega3 .*finite numbers of shape \(3,\)",
        ),
        ({"omega1": np.eye(3)}, r"(?s)Geometry\.omega1 .*shape \(3,\)"),
        ({"tool_home": np.diag([1.0, 1.0, -1.0])}, r"Geometry\.tool_home .*right-handed"),
        (
            {"tool_home": np.diag([1.0, -1.0, -1.0])},
            r"(?s)Geometry\.tool_home .*the z axis of the tool",
        ),
        ({"tool_home": 2.0 * np.eye(3)}, r"Geometry\.tool_home .*not a rotation"),
        ({"insertion_sign": 2}, r"Geometry\.insertion_sign = 2"),
    ],
)
def test_bad_geometry_names_the_field(change, message):
    with pytest.raises(ProblemError, match=message):
        replace(GEOMETRY, **change)


@pytest.mark.parametrize(
    ("tool_home", "message"),
    [
        (np.diag([1.0, -1.0, -1.0]), "tool_home: its z column"),
        (2.0 * np.eye(3), "tool_home = .* is not a rotation"),
        (np.diag([1.0, 1.0, -1.0]), "tool_home = .* is not a rotation"),
    ],
)
def test_bad_tool_frames_are_refused(tool_home, message):
    with pytest.raises(GeometryError, match=message):
        Mechanism.from_angles(0.5, 1.9, tool_home=tool_home)


@pytest.mark.parametrize(
    ("alpha", "beta", "tilt"), [(30.0, 1.9, None), (0.5, -0.1, None), (0.5, 1.9, -113.0)]
)
def test_angles_in_degrees_are_refused(alpha, beta, tilt):
    with pytest.raises(GeometryError, match=r"alpha|beta|home_tilt"):
        Mechanism.from_angles(alpha, beta, tilt)


@pytest.mark.parametrize(
    ("q", "message"),
    [
        (np.zeros((4, 7)), r"q has shape \(4, 7\): must be \(n, 4\); it looks transposed"),
        (np.zeros((2, 3)), r"q has shape \(2, 3\)"),
        (np.zeros((2, 4, 1)), r"q has shape \(2, 4, 1\)"),
        ([[0.0, math.nan, 0.0, 0.0]], r"q of shape \(1, 4\) is not finite at \[0, 1\]"),
        ("none", "q is not an array of numbers"),
    ],
)
def test_bad_joints_name_the_argument(vitreoretinal, q, message):
    for function in (forward, space_jacobian):
        with pytest.raises(GeometryError, match=message):
            function(vitreoretinal, q)


def test_an_empty_batch_is_a_batch(vitreoretinal):
    rotations, positions = forward(vitreoretinal, np.empty((0, 4)))
    jacobians = space_jacobian(vitreoretinal, np.empty((0, 4)))
    assert rotations.shape == (0, 3, 3)
    assert positions.shape == (0, 3)
    assert jacobians.shape == (0, 6, 4)
