"""RMS torques in the certificate agree with the sizing and with closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ssm_planner.dynamics.motors import REST_FRACTION
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.plans import load_plan
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.requirements import motor_requirements
from ssm_planner.trajectory import Trajectory, quintic_coefficients
from ssm_planner.verification.certificate import Certificate, LimitCheck
from ssm_planner.verification.check import check
from tests.support.paths import ROOT
from tests.support.plans import smooth, trapezoids

HOME = np.array([[0.3, 0.5, 0.1, -0.005]])
ZERO = np.zeros((1, 4))


def continuous(certificate: Certificate) -> dict[str | None, LimitCheck]:
    return {limit.joint: limit for limit in certificate.limits if limit.name == "continuous torque"}


def by_sizing(trajectory: Trajectory, robot: Robot, rate: float = 2000.0) -> dict[str, float]:
    return {item.joint: item.rms_torque for item in motor_requirements(trajectory, robot, rate)}


def with_static_friction(robot: Robot, mu: float) -> Robot:
    joints = []
    for joint in robot.joints:
        if joint.drive is not None:
            friction = dataclasses.replace(joint.drive.friction, mu_static=mu)
            joint = dataclasses.replace(
                joint, drive=dataclasses.replace(joint.drive, friction=friction)
            )
        joints.append(joint)
    return dataclasses.replace(robot, joints=tuple(joints))


def back_and_forth(robot: Robot, count: int) -> Trajectory:
    """Return sinusoidal motions of all joints as quintics.

    Each joint reverses within pieces, at other instants than the others.
    """
    t = np.linspace(0.0, 4.0, count)
    angle = t[:, None] * [3.1, 4.3, 2.2, 5.7] + [0.1, 0.7, 1.3, 2.0]
    rate, size = np.array([3.1, 4.3, 2.2, 5.7]), np.array([0.15, 0.1, 0.2, 0.003])
    q, qd, qdd = (
        HOME + size * np.sin(angle),
        size * rate * np.cos(angle),
        -size * rate**2 * np.sin(angle),
    )
    return Trajectory(
        t,
        quintic_coefficients(np.diff(t), (q[:-1], qd[:-1], qdd[:-1]), (q[1:], qd[1:], qdd[1:])),
        (),
    )


def test_it_is_the_rms_of_the_sizing_on_the_shipped_plan() -> None:
    """The continuous torque of the certificate equals the RMS torque of the sizing."""
    plan = load_plan(ROOT / "results/tilt_insert/plan.json")
    result = continuous(check(plan.trajectory, plan.robot, plan.limits))
    sized = by_sizing(plan.trajectory, plan.robot)
    assert set(result) == set(sized) == {"roll", "tilt", "insertion"}
    for joint, limit in result.items():
        assert limit.worst == pytest.approx(sized[joint], rel=1e-6)


@pytest.mark.parametrize("make", [trapezoids, smooth, lambda robot: back_and_forth(robot, 9)])
def test_it_is_the_rms_of_the_sizing_with_starts_turns_and_jumps(robot: Robot, make) -> None:
    """The continuous torque equals that of the sizing, also with starts, reversals and jumps."""
    robot = with_static_friction(robot, 0.6)
    trajectory = make(robot)
    result = continuous(check(trajectory, robot))
    for joint, rms in by_sizing(trajectory, robot, 20_000.0).items():
        assert result[joint].worst == pytest.approx(rms, rel=1e-6)


def test_constant_speed_and_a_dwell_in_closed_form(robot: Robot) -> None:
    """The tool is inserted at constant speed and load for a quarter of the time, and then rests."""
    speed, times = -0.004, np.array([0.0, 0.5, 2.0])
    moved = HOME + [[0.0, 0.0, 0.0, speed * times[1]]]
    rate = np.array([[0.0, 0.0, 0.0, speed]])
    pieces = [
        quintic_coefficients(np.diff(times[:2]), (HOME, rate, ZERO), (moved, rate, ZERO)),
        quintic_coefficients(np.diff(times[1:]), (moved, ZERO, ZERO), (moved, ZERO, ZERO)),
    ]
    trajectory = Trajectory(times, np.concatenate(pieces), ())
    joint = robot.joints[3]
    assert joint.velocity * REST_FRACTION < abs(speed)
    load = RigidBody.from_robot(robot).inverse_dynamics(HOME, rate, ZERO)[0, 3]
    effort = output_effort(joint.drive, load, speed, 0.0)
    torque = abs(float(motor_torque(joint.drive, effort, joint.drive.ratio * speed, 0.0)))
    result = continuous(check(trajectory, robot))
    assert result["insertion"].worst == pytest.approx(torque * np.sqrt(0.25), rel=1e-9)
    assert result["insertion"].limit == joint.motor.nominal_torque
    assert result["insertion"].margin == pytest.approx(
        1 - torque / 2 / joint.motor.nominal_torque, rel=1e-9
    )
    assert (result["insertion"].time, result["insertion"].unit) == (2.0, "N·m")
    # Self-locking drives hold without torque.
    assert result["roll"].worst == result["tilt"].worst == 0.0


def test_a_drive_that_does_not_lock_itself_pays_for_a_dwell(robot: Robot) -> None:
    """Without friction, the holding torque is the load divided by the ratio, all the time."""
    drive = robot.joints[0].drive
    friction = dataclasses.replace(drive.friction, mu=1e-9, mu_static=1e-9, b_c=0.0, b_oc=0.0)
    free = dataclasses.replace(
        robot.joints[0], drive=dataclasses.replace(drive, friction=friction, self_locking=False)
    )
    robot = dataclasses.replace(robot, joints=(free, *robot.joints[1:]))
    times = np.array([0.0, 3.0])
    result = continuous(
        check(
            Trajectory(
                times,
                quintic_coefficients(np.diff(times), (HOME, ZERO, ZERO), (HOME, ZERO, ZERO)),
                (),
            ),
            robot,
        )
    )
    load = float(RigidBody.from_robot(robot).gravity_load(HOME)[0, 0])
    assert result["roll"].worst == pytest.approx(
        abs(load) * drive.gamma * np.tan(drive.lead_angle), rel=1e-6
    )
    assert result["roll"].worst > 0


def test_static_friction_is_a_peak_and_no_heat(robot: Robot) -> None:
    """Static friction raises the peak torque, but not the continuous torque."""
    trajectory = smooth(robot)
    low, high = (check(trajectory, with_static_friction(robot, mu)) for mu in (0.3, 0.9))
    for joint in ("roll", "tilt"):
        peaks = [
            next(x.worst for x in c.limits if (x.name, x.joint) == ("motor torque", joint))
            for c in (low, high)
        ]
        assert peaks[1] > 1.05 * peaks[0]
        assert continuous(high)[joint].worst == pytest.approx(
            continuous(low)[joint].worst, rel=1e-12
        )


def test_it_is_left_out_where_there_is_no_acceleration(robot: Robot) -> None:
    certificate = check(smooth(robot), robot, TaskLimits(), resolution=np.full(4, 1e-9))
    assert not continuous(certificate)
    unjudged = {line.joint for line in certificate.unjudged if line.name == "continuous torque"}
    driven = {joint.name for joint in robot.joints if joint.motor is not None}
    assert unjudged == driven
    once = check(smooth(robot), robot, TaskLimits(duty=None), resolution=np.full(4, 1e-9))
    assert not any(line.name == "continuous torque" for line in once.unjudged)
