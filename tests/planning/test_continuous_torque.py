"""A motor that would get too hot over the whole motion: tightened where that helps, otherwise named with its relaxation."""

from __future__ import annotations

import dataclasses

import pytest

from ssm_planner.pipeline.run import Strictness, plan
from ssm_planner.problem.limits import MotorTorque
from ssm_planner.problem.problem import Problem
from ssm_planner.reporting.text import summary_lines
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.certificate import Certificate, LimitCheck
from ssm_planner.verification.check import check


def with_nominal(problem: Problem, i: int, torque: float) -> Problem:
    """The problem with another nominal torque of the motor of joint i."""
    return with_motor(problem, i, nominal_torque=torque)


def with_motor(problem: Problem, i: int, **figures: float) -> Problem:
    """The problem with other figures of the motor of joint i."""
    joints = list(problem.robot.joints)
    joints[i] = dataclasses.replace(joints[i], motor=dataclasses.replace(joints[i].motor, **figures))
    return dataclasses.replace(problem, robot=dataclasses.replace(problem.robot, joints=tuple(joints)))


def rms(problem: Problem, trajectory: Trajectory, joint: str) -> float:
    limits = check(trajectory, problem.robot).limits
    return next(limit.worst for limit in limits if (limit.name, limit.joint) == ("continuous torque", joint))


def test_a_motor_that_friction_heats_too_much_is_named_with_what_it_needs(tilt_insert: Problem) -> None:
    """Half of what the fastest motion takes: the load does not get lighter, so a smaller peak does not help."""
    fastest = plan(tilt_insert)
    needed = rms(tilt_insert, fastest.trajectory, "roll")
    weak = with_nominal(tilt_insert, 0, needed / 2)
    result = plan(weak)
    assert not result.passed
    reason = result.reason
    assert (reason.constraint, reason.joint, reason.where) == ("continuous torque", "roll", None)
    assert reason.required == pytest.approx(needed, rel=1e-4)
    assert reason.available == needed / 2
    assert "the motor of joint roll would run at an RMS torque of" in reason.message
    assert f"it may do {1e3 * needed / 2:.6g} mN·m for all time" in reason.message
    first, pause, *_ = reason.relaxation.split("; or ")
    assert first.startswith("continuous torque of joint roll of")
    assert first.endswith(f"tried, takes {fastest.duration:.4g} s")
    assert pause.startswith("a dwell of")
    assert f"relaxation: {reason.relaxation}" in summary_lines(result)
    assert plan(with_nominal(tilt_insert, 0, reason.required * (1 + 1e-6))).passed


def test_a_motor_that_acceleration_heats_goes_slower(tilt_insert: Problem) -> None:
    problem = dataclasses.replace(tilt_insert, motion=tilt_insert.motion[1:])
    joint = problem.robot.joints[3]
    # a heavy rotor on a drive with hardly any friction
    friction = dataclasses.replace(joint.drive.friction, b_c=0.0, b_oc=0.0, mu_lowest=None)
    drive = dataclasses.replace(joint.drive, friction=friction, input_inertia=100 * joint.drive.input_inertia)
    joints = (*problem.robot.joints[:3], dataclasses.replace(joint, drive=drive))
    problem = dataclasses.replace(problem, robot=dataclasses.replace(problem.robot, joints=joints))
    problem = with_motor(problem, 3, max_torque=2.19e-3, nominal_torque=2.19e-3)
    fastest = plan(problem)
    assert fastest.passed
    limit = 0.9 * rms(problem, fastest.trajectory, "insertion")
    result = plan(with_nominal(problem, 3, limit))
    assert result.passed
    assert rms(problem, result.trajectory, "insertion") <= limit * (1 + 1e-6)
    assert 1.0 < result.duration / fastest.duration < 1.1


def test_what_a_tightening_did_not_help_is_not_tightened_again(tilt_insert: Problem) -> None:
    def certificate(margin: float) -> Certificate:
        worst = LimitCheck("continuous torque", "tilt", 0.05 * (1 - margin), 0.05, margin, 1.0, "N·m")
        return Certificate((worst,), "", 0)

    once = Strictness(tilt_insert).more(certificate(-0.1))
    assert once is not None
    assert once.more(certificate(-0.09)) is None
    assert once.more(certificate(-0.02)) is not None


@pytest.mark.parametrize("excess", [1e-3, 0.1, 0.2])
def test_what_is_tightened_lies_below_the_peak_and_above_nothing(tilt_insert: Problem, excess: float) -> None:
    own = tilt_insert.robot.joints[1].limit(MotorTorque).largest
    limits = (
        LimitCheck("motor torque", "tilt", 0.4 * own, own, 0.6, 1.0, "N·m"),
        LimitCheck("continuous torque", "tilt", 1 + excess, 1.0, -excess, 3.0, "N·m"),
    )
    strict = Strictness(tilt_insert).more(Certificate(limits, "", 0))
    torque = strict.problem.robot.joints[1].limit(MotorTorque)
    assert 0 < torque.largest < 0.4 * own * (1 - min(excess, 0.5))
    untouched = dataclasses.replace(torque, largest=own).on(strict.problem)
    assert untouched.all_limits == tilt_insert.all_limits
    # a smaller excess that is left tightens again
    left = dataclasses.replace(limits[1], worst=1 + 0.4 * excess, margin=-0.4 * excess)
    again = strict.more(Certificate((left,), "", 0))
    assert again.problem.robot.joints[1].limit(MotorTorque).largest < torque.largest


@pytest.mark.parametrize("excess", [0.3, 30.0])
def test_much_heat_is_not_cured_by_creeping(tilt_insert: Problem, excess: float) -> None:
    limit = LimitCheck("continuous torque", "tilt", 1 + excess, 1.0, -excess, 3.0, "N·m")
    assert Strictness(tilt_insert).more(Certificate((limit,), "", 0)) is None
