"""The efforts and torques for users obey the laws of power and of self-locking drives."""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner import GeometryError, Robot, inverse_dynamics, motor_torque
from ssm_planner.dynamics.rigid_body import RigidBody
from tests.support.arm_motion import energy

Q = np.array([[-0.4, 0.6, 0.2, -0.01], [0.1, -0.7, 1.0, -0.02], [0.0, 0.0, 0.0, 0.0]])
QD = np.array([[0.2, -0.1, 0.3, 0.004], [-0.2, 0.3, 0.0, -0.001], [0.0, 0.0, 0.0, 0.0]])
QDD = np.array([[1.0, 2.0, -1.0, 0.1], [0.5, -0.3, 0.2, 0.0], [0.0, 0.0, 0.0, 0.0]])
DRIVEN = [0, 1, 3]


def test_the_power_of_the_efforts_is_the_change_of_energy(robot: Robot) -> None:
    body, h = RigidBody.from_robot(robot), 1e-5
    power = np.sum(inverse_dynamics(robot, Q, QD, QDD) * QD, axis=1)
    ahead, behind = (sum(energy(body, Q + t * QD + t**2 / 2 * QDD, QD + t * QDD)) for t in (h, -h))
    np.testing.assert_allclose((ahead - behind) / (2 * h), power, rtol=1e-6, atol=1e-9)


def test_a_motor_brings_at_least_the_power_of_its_joint(robot: Robot) -> None:
    """A motor in motion supplies at least the power of its joint because friction takes power."""
    efforts, torques = inverse_dynamics(robot, Q, QD, QDD), motor_torque(robot, Q, QD, QDD)
    for i in DRIVEN:
        drive, motor = robot.joints[i].drive, robot.joints[i].motor
        assert drive is not None
        assert motor is not None
        speed = drive.ratio * QD[:2, i]
        moving = speed != 0
        assert (torques[:2, i] * speed >= efforts[:2, i] * QD[:2, i])[moving].all()


def test_a_drive_holds_a_robot_that_stands(robot: Robot) -> None:
    torques = motor_torque(robot, Q, np.zeros_like(Q), np.zeros_like(Q))
    assert inverse_dynamics(robot, Q, np.zeros_like(Q), np.zeros_like(Q))[:, 0].any()
    np.testing.assert_array_equal(torques[:, DRIVEN], 0.0)
    assert np.isnan(torques[:, 2]).all(), "the spin of the shipped robot has no drive"


def test_a_start_needs_static_friction(robot: Robot) -> None:
    """A start needs at least the torque of slow motion with the same acceleration."""
    slow = 1e-7 * np.array([joint.velocity for joint in robot.joints])
    ahead = np.array([0.5, 0.5, 0.0, 0.05])
    start = motor_torque(robot, Q[0], np.zeros(4), ahead)
    moving = motor_torque(robot, Q[0], slow, ahead)
    assert (start[DRIVEN] >= moving[DRIVEN] - 1e-9).all()


def test_one_row_gives_the_row_of_a_batch(robot: Robot) -> None:
    for function in (inverse_dynamics, motor_torque):
        np.testing.assert_allclose(
            function(robot, Q, QD, QDD)[1], function(robot, Q[1], QD[1], QDD[1]), rtol=1e-12
        )


def test_arrays_of_different_lengths_are_refused(robot: Robot) -> None:
    for function in (inverse_dynamics, motor_torque):
        with pytest.raises(GeometryError, match="3, 3, 2"):
            function(robot, Q, QD, QDD[:2])
        with pytest.raises(GeometryError, match="qd"):
            function(robot, Q, QD.T, QDD)
