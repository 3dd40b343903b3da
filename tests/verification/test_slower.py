"""The search for the worst speed agrees with a scan of a thousand speeds. The check of a slower
motion agrees with the direct check of the slowed motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ProblemError
from ssm_planner.plans import load_plan
from ssm_planner.verification.check import check
from ssm_planner.verification.slower import check_slower, check_speeds
from tests.support.paths import RESULTS


@pytest.fixture(scope="module")
def plan():
    return load_plan(RESULTS / "tilt_insert" / "plan.json")


def with_stribeck(plan, rise: float, speed: float):
    """Return the robot of a plan, with drives whose friction rises towards low speed."""
    joints = []
    for joint in plan.robot.joints:
        if joint.drive is not None:
            friction = joint.drive.friction
            law = {
                "law": "stribeck_gaussian",
                "mu_stribeck": rise * friction.mu,
                "stribeck_speed": speed,
            }
            friction = replace(friction, **law, mu_static=(1 + rise) * friction.mu)
            joint = replace(joint, drive=replace(joint.drive, friction=friction))
        joints.append(joint)
    return replace(plan.robot, joints=tuple(joints))


def scan(plan, robot, factors):
    """Return the largest motor torques (m, 4) of a motion at each of m factors of its speed."""
    result = []
    for factor in factors:
        slow = plan.motion.slower(factor)
        samples = slow.sample(np.linspace(slow.breaks[0], slow.breaks[-1], 2000))
        way, away = motion_directions(robot, samples, 1)
        torque = motor_motion(robot, RigidBody.from_robot(robot), samples, way, away).torque
        result.append(np.nanmax(np.abs(np.nan_to_num(torque)), axis=0))
    return np.array(result)


@pytest.mark.parametrize("law", ["coulomb", "stribeck"])
@pytest.mark.slow
def test_the_worst_speed_is_that_of_a_scan_of_a_thousand(plan, law):
    robot = plan.robot if law == "coulomb" else with_stribeck(plan, 0.8, 40.0)
    factors = np.geomspace(0.01, 1.0, 1000)
    brute = scan(plan, robot, factors)
    result = check_speeds(plan.motion, robot, plan.limits)
    worst = {item.found.joint: item for item in result.worst if item.found.name == "motor torque"}
    assert set(worst) == {"roll", "tilt", "insertion"}
    for joint, item in worst.items():
        i = [j.name for j in robot.joints].index(joint)
        assert item.found.worst == pytest.approx(brute[:, i].max(), rel=0.01)
        value = np.interp(item.speed, factors, brute[:, i])
        assert value == pytest.approx(brute[:, i].max(), rel=0.01)
    if law == "stribeck":
        assert min(item.speed for item in worst.values()) < 0.5


def test_a_certificate_at_one_speed_is_that_of_the_slowed_motion(plan):
    slow = check_slower(plan.motion, plan.robot, plan.limits, 0.1)
    direct = check(plan.motion.slower(0.1), plan.robot, plan.limits)
    for a, b in zip(slow.limits, direct.limits, strict=True):
        assert (a.name, a.joint) == (b.name, b.joint)
        assert a.worst == pytest.approx(b.worst, rel=1e-6, abs=1e-9)
    speeds = {
        c.joint: c.worst
        for c in check(plan.motion, plan.robot, plan.limits).limits
        if c.name == "velocity"
    }
    for item in slow.limits:
        if item.name == "velocity":
            assert item.worst == pytest.approx(0.1 * speeds[item.joint], rel=1e-6)


def test_a_motion_that_passes_at_full_speed_may_not_at_a_lower_one(plan):
    """The motor can give more torque than full speed needs, but less than the worst speed needs."""
    robot = with_stribeck(plan, 0.8, 40.0)
    free = check_speeds(plan.motion, robot, plan.limits)
    worst = next(
        item
        for item in free.worst
        if item.found.name == "motor torque" and item.found.joint == "tilt"
    )
    full = next(
        item
        for item in dict(free.certificates)[1.0].limits
        if (item.name, item.joint) == ("motor torque", "tilt")
    )
    assert full.worst < worst.found.worst
    between = (full.worst + worst.found.worst) / 2
    tilt = replace(
        robot.joints[1],
        motor=replace(robot.joints[1].motor, max_torque=between, nominal_torque=between),
    )
    weak = replace(robot, joints=(robot.joints[0], tilt, *robot.joints[2:]))
    assert check(plan.motion, weak, plan.limits).passed
    result = check_speeds(plan.motion, weak, plan.limits)
    assert not result.passed
    assert not check_slower(plan.motion, weak, plan.limits, worst.speed).passed


@pytest.mark.parametrize("speed", [0.0, 1.5, -0.1])
def test_an_invalid_speed_is_refused(plan, speed):
    with pytest.raises(ProblemError):
        check_slower(plan.motion, plan.robot, plan.limits, speed)
    with pytest.raises(ProblemError):
        check_speeds(plan.motion, plan.robot, plan.limits, speed or 1.0)
