"""A tool along the axis of joint 1 allows any roll angle.

Only a mechanism with α = β reaches this pose.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.robot import Geometry
from tests.support.pose_inverse import inverse


@pytest.mark.parametrize("degrees", [20.0, 30.0, 45.0, 60.0])
def test_joints_along_the_first_axis_are_finite_and_reach_the_pose(degrees: float) -> None:
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    omega3 = np.array([math.cos(math.radians(2 * degrees)), math.sin(math.radians(2 * degrees)), 0])
    tool = np.column_stack([[0.0, 0.0, 1.0], np.cross(omega3, [0.0, 0.0, 1.0]), omega3])
    mechanism = Mechanism.from_geometry(
        Geometry(np.array([1.0, 0.0, 0.0]), np.array([cosine, sine, 0.0]), omega3, tool)
    )
    turn = np.linspace(-3.0, 3.0, 7)
    x = np.column_stack([0 * turn, np.cos(turn), np.sin(turn)])
    axis = np.tile([1.0, 0.0, 0.0], (7, 1))
    rotations = np.stack([x, np.cross(axis, x), axis], axis=2)
    positions = 0.01 * axis
    result = inverse(mechanism, rotations, positions)
    assert np.isfinite(result.joints).all()
    for k in range(result.joints.shape[1]):
        reached = forward(mechanism, result.joints[:, k])
        assert np.abs(reached[0] - rotations).max() < 1e-6
        assert np.abs(np.abs(reached[1]) - np.abs(positions)).max() < 1e-8
