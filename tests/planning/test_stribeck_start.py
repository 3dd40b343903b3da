"""Verify starts with kinetic friction at rest that is larger than the static friction."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import breakaway_torque
from ssm_planner.elements.rows import directed_torques
from ssm_planner.planning.motor_strength import check_motor_torque
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.problem import Problem


def stribeck(drive: Drive) -> Drive:
    """Return the drive with mu + mu_stribeck = 0.4 at zero speed and mu_static = 0.25."""
    friction = dataclasses.replace(
        drive.friction,
        law="stribeck_gaussian",
        mu=0.2,
        mu_static=0.25,
        mu_stribeck=0.2,
        stribeck_speed=1.0,
    )
    return dataclasses.replace(drive, friction=friction)


@pytest.mark.parametrize("sigma", [1.0, -1.0])
def test_the_planners_torque_at_a_start_is_the_breakaway_torque(
    tilt_insert: Problem, sigma: float
) -> None:
    drive = stribeck(tilt_insert.robot.joints[0].drive)
    state = SimpleNamespace(
        sigma=[ca.SX(sigma)], qd=[ca.SX(0)], qdd=[ca.SX(0)], tau_rigid=[ca.SX(0.3)]
    )
    result = max(float(value) for value in directed_torques(drive, state, 0, breakaway=True))
    assert result == pytest.approx(sigma * breakaway_torque(drive, 0.3, sigma, mu=0.4), rel=1e-12)


def test_a_motor_too_weak_for_it_is_named(tilt_insert: Problem) -> None:
    robot, joint = tilt_insert.robot, tilt_insert.robot.joints[0]
    drive = stribeck(joint.drive)
    body = RigidBody.from_robot(robot)
    q = np.linspace(-1.0, 1.0, 41)[:, None] * np.ones(4)
    load = body.gravity_load(q)[:, 0]
    most, least = np.argmax(np.abs(load)), np.argmin(np.abs(load))
    sign = np.sign(load[most])
    path = SimpleNamespace(
        directions=(np.array([0.0, 1.0]), np.array([[sign, 0.0, 0.0, 0.0]])),
        sample=lambda s: SimpleNamespace(s=s, q=np.where(s[:, None] == 0.0, q[most], q[least])),
    )
    needed = abs(float(breakaway_torque(drive, load[most], sign, mu=0.4)))
    motor = dataclasses.replace(joint.motor, max_torque=0.99 * needed)
    weak = dataclasses.replace(
        robot, joints=(dataclasses.replace(joint, drive=drive, motor=motor), *robot.joints[1:])
    )
    phase = SimpleNamespace(
        motion=SimpleNamespace(name="motion 1"),
        problem=SimpleNamespace(robot=weak),
        path=path,
    )
    reason = check_motor_torque(phase, path)
    assert reason is not None
    assert reason.joint == joint.name
    assert reason.required == pytest.approx(needed, rel=1e-12)
