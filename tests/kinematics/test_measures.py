"""Measures along the workspace are compared with finite differences and determinants.

Further tests check their values at the boundary of the workspace.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import space_jacobian
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.workspace import (
    boundary_distance,
    joint_speed_per_tilt_speed,
    smallest_singular_value,
    theta2_from_tilt,
    tilt_interval,
)


def test_joint_speeds_are_the_derivatives_of_the_inverse(random_mechanism):
    rng = np.random.default_rng(41)
    step = 1e-6
    for _ in range(50):
        mech = random_mechanism(rng, rng.uniform(0.3, 2.8), rng.uniform(0.3, 2.8))
        low, high = tilt_interval(mech)
        tilt = (low + (high - low) * rng.uniform(0.1, 0.9, 20)) * rng.choice([-1.0, 1.0], 20)
        task = np.zeros((20, 4))
        for k, branch in enumerate((1, -1)):
            task[:, 1] = tilt + step
            ahead = inverse_task(mech, task).joints[:, k, :3]
            task[:, 1] = tilt - step
            difference = (ahead - inverse_task(mech, task).joints[:, k, :3]) / (2.0 * step)
            speeds = joint_speed_per_tilt_speed(mech, tilt, branch)
            assert np.abs(speeds - difference).max() < 1e-6 * max(1.0, np.abs(speeds).max())


def test_joint_speeds_move_the_tool_about_the_rolled_tilt_axis(vitreoretinal):
    tilt = np.radians([-130.0, -100.0, -85.0])
    speeds = joint_speed_per_tilt_speed(vitreoretinal, tilt, -1)
    joints = inverse_task(
        vitreoretinal, np.column_stack((np.zeros(3), tilt, np.zeros((3, 2))))
    ).joints[:, 1]
    omega = np.einsum("nij,nj->ni", space_jacobian(vitreoretinal, joints)[:, 3:, :3], speeds)
    assert np.abs(omega - vitreoretinal.tilt_axis).max() < 1e-12


def test_joint_speed_has_no_bound_at_the_boundary(random_mechanism):
    rng = np.random.default_rng(42)
    for _ in range(20):
        mech = random_mechanism(rng, rng.uniform(0.3, 1.2), rng.uniform(1.3, 1.8))
        low, high = tilt_interval(mech)
        assert (
            np.isinf(joint_speed_per_tilt_speed(mech, low, 1)[1])
            or np.abs(joint_speed_per_tilt_speed(mech, low, 1)[1]) > 1e6
        )
        near = np.abs(
            joint_speed_per_tilt_speed(mech, high - np.array([1e-2, 1e-4, 1e-6]), 1)[:, 1]
        )
        # θ2 varies with the square root of the distance to the boundary.
        assert near[1:] / near[:-1] == pytest.approx([10.0, 10.0], rel=0.1)
        assert np.isnan(
            joint_speed_per_tilt_speed(mech, np.array([low - 1e-3, high + 1e-3]), 1)
        ).all()


def test_smallest_singular_value_vanishes_at_the_boundary_only(random_mechanism):
    rng = np.random.default_rng(43)
    for _ in range(50):
        mech = random_mechanism(rng, rng.uniform(0.3, 1.2), rng.uniform(1.3, 1.8))
        low, high = tilt_interval(mech)
        tilt = np.linspace(low, high, 51)
        q = rng.uniform(-3.0, 3.0, (51, 4))
        q[:, 1] = theta2_from_tilt(mech, tilt, 1)
        values = smallest_singular_value(mech, q)
        assert values[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-7)
        assert np.all(values[1:-1] > 1e-3)
        product = np.prod(
            np.linalg.svd(space_jacobian(mech, q)[:, 3:, :3], compute_uv=False), axis=1
        )
        expected = math.sin(mech.alpha) * math.sin(mech.beta) * np.abs(np.sin(q[:, 1] - mech.delta))
        assert np.abs(product - expected).max() < 1e-12


def test_boundary_distance(vitreoretinal):
    low, high = tilt_interval(vitreoretinal)
    tilts = np.array([low, high, (low + high) / 2.0, low - 0.1, -high])
    assert boundary_distance(vitreoretinal, tilts) == pytest.approx(
        [0.0, 0.0, (high - low) / 2.0, -0.1, 0.0], abs=1e-15
    )
    with pytest.raises(GeometryError, match=r"tilt of shape \(\).*degrees"):
        boundary_distance(vitreoretinal, -113.0)
