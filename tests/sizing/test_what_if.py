"""The largest payload and the shortest duration of a set of motors are sharp limits.

The motors suffice just within a limit and fail just beyond it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.rigid_body import with_payload
from ssm_planner.errors import ProblemError
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.joint_load import joint_loads
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.size import largest_payload, shortest_duration, size
from ssm_planner.trajectory import Trajectory
from tests.support.sizing_cases import COMPLETE, equipped, random_trajectory

KNOWN = Conditions(supply_voltage=24.0, current_limit=20.0)


def passes(duty: DutyCycle, payload: float = 0.0) -> bool:
    return size(duty, None, KNOWN, payload).adequate is True


def test_loads_are_linear_in_the_payload(robot: Robot, trajectory: Trajectory) -> None:
    empty, loaded = (
        joint_loads(trajectory, robot),
        joint_loads(trajectory, with_payload(robot, 1.0)),
    )
    direct = joint_loads(trajectory, with_payload(robot, 0.37))
    for a, b, c in zip(empty, loaded, direct, strict=True):
        assert a.interpolate(b, 0.37).tau_rigid == pytest.approx(c.tau_rigid, abs=1e-12)


def test_the_payload_hangs_at_the_tip(robot: Robot) -> None:
    """At rest, a payload adds its weight at the tip to the loads of the joints.

    The reference is the transposed Jacobian times the wrench that holds the payload.
    """
    from ssm_planner.kinematics.forward import space_jacobian, tip_position
    from ssm_planner.kinematics.mechanism import Mechanism

    q = np.array([[0.4, -0.3, 0.7, -0.02]])
    still = np.zeros((1, 6, 4))
    still[0, 0] = q[0]
    motion = Trajectory(np.array([0.0, 1.0]), still, ())
    empty, loaded = joint_loads(motion, robot), joint_loads(motion, with_payload(robot, 0.5))
    mechanism = Mechanism.from_geometry(robot.geometry)
    force = -0.5 * robot.gravity  # This force holds the payload.
    wrench = np.concatenate([force, np.cross(tip_position(mechanism, q)[0], force)])
    expected = space_jacobian(mechanism, q)[0].T @ wrench
    for i, a, b in zip((0, 1, 3), empty, loaded, strict=True):
        assert b.gravity[0] - a.gravity[0] == pytest.approx(expected[i], abs=1e-12)


def test_stretching_the_loads_is_stretching_the_motion(
    robot: Robot, trajectory: Trajectory
) -> None:
    """Loads stretched in time equal the loads of the slower motion."""
    factor = 1.7
    coefficients = trajectory.coefficients / factor ** np.arange(6)[:, None]
    slower = Trajectory(trajectory.breaks * factor, coefficients, ())
    for a, b in zip(
        joint_loads(trajectory, robot, 2000.0),
        joint_loads(slower, robot, 2000.0 / factor),
        strict=True,
    ):
        stretched = a.stretched(factor)
        assert stretched.duration == pytest.approx(b.duration)
        assert stretched.tau_rigid == pytest.approx(b.tau_rigid, abs=1e-12)
        assert stretched.torque() == pytest.approx(b.torque(), abs=1e-12)
        assert stretched.rms(stretched.torque()) == pytest.approx(b.rms(b.torque()), rel=1e-9)


@pytest.fixture(scope="module")
def strong(robot: Robot) -> DutyCycle:
    motor = replace(COMPLETE, max_torque=0.25)
    return DutyCycle.of_trajectory(random_trajectory(3), equipped(robot, motor))


@pytest.mark.slow
def test_largest_payload(strong: DutyCycle) -> None:
    result = largest_payload(strong, {}, KNOWN)
    assert result.status == "found"
    assert result.not_checked == ()
    assert passes(strong, result.value)
    assert not passes(strong, result.value * 1.001)
    assert result.binds


def test_shortest_duration(strong: DutyCycle) -> None:
    result = shortest_duration(strong, {}, KNOWN)
    assert result.status == "found"

    def faster(factor: float) -> DutyCycle:
        ((trajectory, _),) = strong.runs
        coefficients = trajectory.coefficients / factor ** np.arange(6)[:, None]
        return DutyCycle.of_trajectory(
            Trajectory(trajectory.breaks * factor, coefficients, ()), strong.robot
        )

    assert passes(faster(result.value * 1.001))
    assert not passes(faster(result.value * 0.998))


def test_a_motor_that_never_suffices(robot: Robot) -> None:
    """Both limits have the status `never` if the motor does not suffice without payload."""
    weak = replace(COMPLETE, max_torque=2e-5, nominal_torque=1e-5)
    duty = DutyCycle.of_trajectory(random_trajectory(3), equipped(robot, weak))
    assert largest_payload(duty, {}, KNOWN).status == "never"
    result = shortest_duration(duty, {}, KNOWN)
    assert (result.status, result.value) == ("never", None)


def test_no_negative_payload(robot: Robot) -> None:
    with pytest.raises(ProblemError, match="payload"):
        with_payload(robot, -0.1)
    assert with_payload(robot, 0.0) is robot
