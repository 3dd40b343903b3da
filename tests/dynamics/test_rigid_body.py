"""Rigid-body dynamics agree with Pinocchio and with the balance of power and energy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner.dynamics.rigid_body import RigidBody, static_loads
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.problem.robot import Body, Geometry, Robot, read_only_array
from tests.support.arm_motion import energy as energy_of
from tests.support.pinocchio_model import build

RNG = np.random.default_rng(7)


def random_states(
    rng: np.random.Generator, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q = rng.uniform(-np.pi, np.pi, (count, 4))
    q[:, 3] = rng.uniform(-0.05, 0.05, count)
    return q, rng.uniform(-2, 2, (count, 4)), rng.uniform(-5, 5, (count, 4))


def random_robot(robot: Robot, rng: np.random.Generator) -> Robot:
    """Return the robot with random axis angles, mounting, bodies and gravity."""
    turn = rotation(unit(rng), rng.uniform(0, np.pi))
    mechanism = Mechanism.from_angles(*rng.uniform(0.2, 2.8, 2))
    axes = [turn @ axis for axis in (mechanism.omega1, mechanism.omega2, mechanism.omega3)]
    tool = turn @ mechanism.tool_home
    bodies = []
    for axis in (axes[0], axes[1], axes[2], axes[2]):
        points = rng.normal(0, 0.1, (6, 3))
        masses = rng.uniform(0.05, 0.5, 6)
        com = masses @ points / masses.sum()
        inertia = sum(
            m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True)
        )
        bodies.append(
            Body(
                "b",
                masses.sum(),
                read_only_array(com, (3,)),
                read_only_array(inertia, (3, 3)),
                read_only_array(frame(axis), (3, 3)),
            )
        )
    geometry = Geometry(
        *(read_only_array(axis, (3,)) for axis in axes), read_only_array(tool, (3, 3))
    )
    gravity = read_only_array(9.81 * unit(rng), (3,))
    return dataclasses.replace(robot, geometry=geometry, bodies=tuple(bodies), gravity=gravity)


def unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def frame(z: np.ndarray) -> np.ndarray:
    x = np.cross(z, [0.3, 0.5, 0.8])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def rnea(robot: Robot, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    model = build(robot)
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])


def test_inverse_dynamics_agrees_with_pinocchio_for_the_shipped_robot(robot: Robot) -> None:
    q, qd, qdd = random_states(RNG, 1000)
    tau = RigidBody.from_robot(robot).inverse_dynamics(q, qd, qdd)
    assert np.abs(tau - rnea(robot, q, qd, qdd)).max() <= 1e-9
    assert np.abs(tau).max() > 0.1


@pytest.mark.parametrize("seed", range(5))
def test_inverse_dynamics_agrees_with_pinocchio_for_any_angles_and_mounting(
    robot: Robot, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    other = random_robot(robot, rng)
    q, qd, qdd = random_states(rng, 200)
    tau = RigidBody.from_robot(other).inverse_dynamics(q, qd, qdd)
    assert np.abs(tau - rnea(other, q, qd, qdd)).max() <= 1e-9


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_power_equals_the_rate_of_energy(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    body = RigidBody.from_robot(random_robot(robot, rng))
    q, qd, qdd = random_states(rng, 1)
    power = float(np.sum(body.inverse_dynamics(q, qd, qdd) * qd))
    h = 1e-5

    def energy(t: float) -> float:
        kinetic, potential = energy_of(body, q + t * qd + t**2 / 2 * qdd, qd + t * qdd)
        return float(kinetic[0] + potential[0])

    assert power == pytest.approx((energy(h) - energy(-h)) / (2 * h), rel=1e-6, abs=1e-6)


def test_mass_matrix_is_symmetric_positive_definite_and_that_of_the_dynamics(robot: Robot) -> None:
    body = RigidBody.from_robot(robot)
    q, _, qdd = random_states(RNG, 50)
    mass = body.mass_matrix(q)
    assert np.abs(mass - mass.transpose(0, 2, 1)).max() < 1e-14
    assert np.linalg.eigvalsh(mass).min() > 0
    still = np.zeros_like(q)
    tau = body.inverse_dynamics(q, still, qdd) - body.gravity_load(q)
    assert np.abs(np.einsum("nij,nj->ni", mass, qdd) - tau).max() < 1e-12


def test_the_load_along_a_path_is_that_of_the_dynamics(robot: Robot) -> None:
    """The load along a path is linear in path acceleration and squared path speed.

    It equals the load of the inverse dynamics.
    """
    rng = np.random.default_rng(5)
    q, dq, ddq = rng.uniform(-1, 1, (3, 40, 4))
    speed, acceleration = rng.uniform(-3, 3, (2, 40, 1))
    body = RigidBody.from_robot(robot)
    a, b, c = body.path_load(q, dq, ddq)
    efforts = body.inverse_dynamics(q, dq * speed, ddq * speed**2 + dq * acceleration)
    assert np.allclose(a * acceleration + b * speed**2 + c, efforts, rtol=1e-12, atol=1e-14)


def test_a_transposed_batch_is_refused(robot: Robot) -> None:
    body = RigidBody.from_robot(robot)
    batch = np.zeros((7, 4))
    with pytest.raises(
        GeometryError, match=r"argument qd has shape \(4, 7\), expected \(n, 4\) with n = 7"
    ):
        body.inverse_dynamics(batch, batch.T, batch)


def test_static_loads_of_many_robots_are_those_of_each(robot):
    rng = np.random.default_rng(8)
    robots = [random_robot(robot, rng) for _ in range(5)]
    robots = [dataclasses.replace(item, gravity=robot.gravity) for item in robots]
    q = rng.uniform(-1, 1, (5, 7, 4))
    axes = np.array(
        [[item.geometry.omega1, item.geometry.omega2, item.geometry.omega3] for item in robots]
    )
    masses = np.array([[body.mass for body in item.bodies] for item in robots])
    coms = np.array([[body.frame @ body.com for body in item.bodies] for item in robots])
    result = static_loads(axes, masses, coms, robot.gravity, q)
    for item, loads, configurations in zip(robots, result, q, strict=True):
        assert np.allclose(
            loads, RigidBody.from_robot(item).gravity_load(configurations), rtol=0, atol=1e-12
        )
