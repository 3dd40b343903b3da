"""The user functions of kinematics agree with each other.

A single configuration gives the corresponding row of a batch.
"""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner import GeometryError, Robot, Task, fk, ik, jacobian
from ssm_planner.typing import Array

STEP = 1e-6


@pytest.fixture
def joints() -> Array:
    spread = np.array([1.0, 1.0, 1.0, 0.01])
    return np.random.default_rng(3).uniform(-1.0, 1.0, (7, 4)) * spread


def test_the_jacobian_is_the_derivative_of_the_tool_pose(robot: Robot, joints: Array) -> None:
    result = jacobian(robot, joints)
    for i, step in enumerate(STEP * np.eye(4)):
        ahead, behind = fk(robot, joints + step), fk(robot, joints - step)
        velocity = (ahead.position - behind.position) / (2 * STEP)
        np.testing.assert_allclose(result[:, :3, i], velocity, atol=1e-9)
        # The rotation over the step is exp([ω] 2h), so its skew part divided by 2h is [ω].
        turning = ahead.rotation @ behind.rotation.transpose(0, 2, 1) / (2 * STEP)
        skew = (turning - turning.transpose(0, 2, 1)) / 2
        omega = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        np.testing.assert_allclose(result[:, 3:, i], omega, atol=1e-9)


def test_one_configuration_gives_the_row_of_a_batch(robot: Robot, joints: Array) -> None:
    row = jacobian(robot, joints)[2]
    np.testing.assert_allclose(jacobian(robot, joints[2]), row, atol=1e-12)


def test_ik_of_a_batch_gives_the_solutions_of_its_points(robot: Robot) -> None:
    tilts = np.radians([-130.0, -100.0, -85.0])
    batch = ik(robot, roll=0.3, tilt=tilts, depth=[0.01, 0.0, 0.02])
    assert batch.joints.shape == (3, 2, 4)
    for k, (tilt, depth) in enumerate(zip(tilts, [0.01, 0.0, 0.02], strict=True)):
        one = ik(robot, roll=0.3, tilt=tilt, depth=depth)
        np.testing.assert_allclose(one.joints, batch.joints[k], atol=1e-12)
        np.testing.assert_array_equal(one.in_limits, batch.in_limits[k])
        assert batch.reachable[k] == one.reachable
        assert batch.boundary_distance[k] == pytest.approx(one.boundary_distance, abs=1e-12)
    tasks = fk(robot, batch.joints.reshape(-1, 4)).task.reshape(3, 2, 4)
    np.testing.assert_allclose(tasks[..., 1], np.repeat(tilts[:, None], 2, axis=1), atol=1e-9)


def test_a_batch_marks_solutions_beyond_the_ranges(robot: Robot) -> None:
    points = {"roll": 0.2, "tilt": np.radians(-100.0), "depth": np.linspace(-0.5, 0.5, 9)}
    every, allowed = ik(robot, **points), ik(robot, **points, within_limits=True)
    assert not every.in_limits.all()
    np.testing.assert_array_equal(np.isnan(allowed.joints).all(axis=2), ~every.in_limits)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({"roll": Task(tilt=-2.0)}, r"roll = Task\(.*array of numbers"),
        ({"roll": [0.0, 1.0], "tilt": [0.0, 1.0, 2.0]}, "different lengths"),
        ({"tilt": "steep"}, "array of numbers"),
        ({"tilt": float("nan")}, "finite"),
    ],
)
def test_impossible_points_name_the_reason(
    robot: Robot, points: dict[str, object], message: str
) -> None:
    with pytest.raises(GeometryError, match=message):
        ik(robot, **points)  # type: ignore[arg-type]
