"""The forward simulation of the whole arm obeys the laws of mechanics. A self-locking arm holds its
position, an arm with little friction falls, and the energy balances. The motor torques agree with
the inverse dynamics, and fixed steps agree with an adaptive integration.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.errors import GeometryError
from ssm_planner.loading.load import load_robot
from tests.support.adaptive_arm import simulate_arm
from tests.support.arm_motion import energy_error
from tests.support.paths import PROBLEMS
from tests.support.velocity_control import ArmSimulation

ROBOT = PROBLEMS / "robots" / "vitreoretinal.yaml"
Q0 = np.array([-0.98, 1.15, 0.26, 0.0])


@pytest.fixture(scope="module")
def robot():
    return load_robot(ROBOT)


@pytest.fixture(scope="module")
def arm(robot):
    return ArmSimulation(robot)


def polynomial(t, start, step, duration):
    """Return position, velocity and acceleration (n, 4) of a rest-to-rest quintic at times (n,)."""
    s = np.clip(np.asarray(t) / duration, 0.0, 1.0)[..., None]
    p, v, a = (
        s**3 * (10 - 15 * s + 6 * s**2),
        30 * s**2 * (1 - s) ** 2,
        60 * s * (1 - s) * (1 - 2 * s),
    )
    return start + step * p, step * v / duration, step * a / duration**2


def tilt_and_insert(period=1e-3):
    """Return positions and velocities (n, 4) of a motion of 3.2 s, one row for each period.

    Joints 1 to 3 turn the tool for 2 s. Then joint 4 inserts the tool by 20 mm within 1 s.
    """
    t = np.arange(0.0, 3.2, period)
    turn = np.array([1.87, -2.02, -0.04, 0.0])
    q, qd, _ = polynomial(t, Q0, turn, 2.0)
    q4, qd4, _ = polynomial(t - 2.0, np.zeros(4), np.array([0.0, 0.0, 0.0, -0.02]), 1.0)
    return q + q4, qd + qd4


def slippery(robot, mu):
    """Return the robot with drives that have little friction and do not lock themselves."""

    def oiled(joint):
        if joint.drive is None:
            return joint
        friction = replace(joint.drive.friction, mu=mu, mu_static=mu, b_c=1e-6, b_oc=0.0)
        return replace(joint, drive=replace(joint.drive, friction=friction, self_locking=False))

    return replace(robot, joints=tuple(map(oiled, robot.joints)))


def test_without_power_the_self_locked_arm_does_not_move_in_sixty_seconds(robot):
    motion = ArmSimulation(robot, servos=(None,) * 4).hold(np.array([0.3, 0.5, 0.2, -0.01]), 60.0)
    assert motion.status == "done"
    assert motion.time[-1] == pytest.approx(60.0)
    assert np.max(np.abs(motion.q - motion.q[0])) <= 1e-9
    assert np.nanmax(np.abs(motion.w)) == 0.0


def test_with_friction_below_self_locking_it_falls(robot):
    oiled = slippery(robot, 0.02)
    motion = ArmSimulation(oiled, servos=(None,) * 4).hold(np.array([0.3, 0.5, 0.2, -0.01]), 1.0)
    fallen = motion.q[-1] - motion.q[0]
    weight = ArmSimulation(oiled).body.gravity_load(motion.q[:1])[0]
    for joint in (0, 1):
        assert abs(fallen[joint]) > 1e-3
        assert np.sign(fallen[joint]) == -np.sign(weight[joint])
    assert energy_error(motion) < 1e-3


def test_energy_balances_over_a_tilt_and_insert_and_the_reference_is_followed(arm):
    q, qd = tilt_and_insert()
    motion = arm.run(q, qd)
    assert motion.status == "done"
    assert energy_error(motion) <= 1e-3
    assert np.all(np.diff(motion.friction_loss) >= -1e-12)
    assert motion.friction_loss[-1] > 0.5 * motion.work[-1] > 0
    assert np.max(np.abs(motion.q - q)[:, :3]) < 5e-3
    assert np.max(np.abs(motion.q - q)[:, 3]) < 1e-4


def test_motors_give_what_the_inverse_law_asks(arm, robot):
    q, qd = tilt_and_insert()
    motion = arm.run(q, qd)
    middle = slice(900, 1100)
    qdd = np.gradient(qd, 1e-3, axis=0)
    tau = arm.body.inverse_dynamics(q, qd, qdd)
    for k in (0, 1):
        drive = robot.joints[k].drive
        effort = output_effort(drive, tau[:, k], qd[:, k], qdd[:, k])
        expected = motor_torque(drive, effort, drive.ratio * qd[:, k], drive.ratio * qdd[:, k])
        np.testing.assert_allclose(motion.tau[middle, k], expected[middle], rtol=0.02)


def test_a_second_of_the_whole_arm_takes_ten_million_instructions_at_most(arm):
    """If CasADi needs 5 ns for each instruction, one simulated second takes at most 50 ms."""
    assert arm._period_function().n_instructions() / arm.period < 10e6


def test_fixed_steps_tend_to_the_adaptive_motion(robot):
    step = np.array([0.2, -0.15, 0.05, -0.005])
    times = np.arange(0.0, 0.45, 1e-3)
    adaptive = simulate_arm(ArmSimulation(robot), lambda t: polynomial(t, Q0, step, 0.4), times)
    assert adaptive.status == "done"
    assert {joint for _, joint, _ in adaptive.events} == {0, 1, 3}
    assert energy_error(adaptive.motion) < 1e-6
    errors = []
    for period in (1e-3, 2.5e-4):
        t = np.arange(0.0, 0.45, period)
        q, qd, _ = polynomial(t, Q0, step, 0.4)
        motion = ArmSimulation(robot, period=period).run(q, qd)
        every = motion.q[:: round(1e-3 / period)][: len(times)]
        errors.append(np.max(np.abs(every - adaptive.motion.q[: len(every)])))
    assert errors[0] < 1e-4
    assert errors[1] < 0.5 * errors[0]


def test_a_weak_motor_saturates_and_a_held_arm_stays(robot, arm):
    held = arm.hold(Q0, 0.5)
    assert np.max(np.abs(held.q - Q0)) <= 1e-9
    weak = tuple(None if s is None else replace(s, limit=5e-3) for s in arm.servos)
    q, qd = tilt_and_insert()
    motion = ArmSimulation(robot, servos=weak).run(q, qd)
    assert np.nanmax(np.abs(motion.tau)) <= 5e-3
    assert np.abs(motion.q[-1, 0] - q[-1, 0]) > 0.5


def test_references_of_a_wrong_shape_are_refused(arm):
    with pytest.raises(GeometryError, match=r"\(n, 4\)"):
        arm.run(np.zeros((10, 4)), np.zeros((9, 4)))
    with pytest.raises(GeometryError, match=r"\(n, 4\)"):
        arm.run(np.zeros((4,)), np.zeros((4,)))
