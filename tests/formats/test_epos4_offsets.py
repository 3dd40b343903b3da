"""The velocity and torque offsets of a stream must agree with its positions. Offsets that the
motion can have pass, and other offsets do not. The references are the plan and the equations of the
motors.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.formats import epos4_offsets as module
from ssm_planner.formats.epos4_offsets import Offsets, offset_checks
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.verification.certificate import LimitCheck

NONE = np.zeros(4)
DRIVEN = (0, 1, 3)


def stream(plan: Plan, t: np.ndarray) -> tuple[np.ndarray, dict[int, Offsets]]:
    """Return positions (n, 4) and exact offsets of the driven joints of a plan at times t (s)."""
    samples, robot = plan.motion.sample(t), plan.robot
    way, away = motion_directions(robot, samples, 1)
    torque = motor_motion(robot, RigidBody.from_robot(robot), samples, way, away).torque
    offsets = {i: Offsets(samples.qd[:, i], torque[:, i], 1e-6, 1e-6) for i in DRIVEN}
    return samples.q, offsets


def checks_of(
    plan: Plan, t: np.ndarray, q: np.ndarray, offsets: dict[int, Offsets]
) -> dict[tuple[str, str | None], LimitCheck]:
    return {(c.name, c.joint): c for c in offset_checks(plan.robot, t, q, NONE, offsets)}


@pytest.mark.parametrize("which", ["plan", "smooth_plan"])
@pytest.mark.parametrize("even", [True, False])
def test_offsets_of_the_motion_itself_pass_and_changed_ones_do_not(
    which: str, even: bool, request: pytest.FixtureRequest
) -> None:
    plan: Plan = request.getfixturevalue(which)
    count = int(plan.motion.duration / 2e-3)
    t = np.linspace(0.0, plan.motion.duration, count)
    if not even:
        t[1:-1] += np.random.default_rng(3).uniform(-6e-4, 6e-4, count - 2)
    q, offsets = stream(plan, t)
    result = checks_of(plan, t, q, offsets)
    assert all(check.passed for check in result.values())
    assert len(result) == 9
    velocity, torque, motor = (sorted({name for name, _ in result}, key=len)[k] for k in (2, 1, 0))
    assert motor == "motor torque"
    assert "torque" in torque
    assert "torque" not in velocity
    for i in DRIVEN:
        joint = plan.robot.joints[i]
        exact = offsets[i]
        k = count // 3
        mask = np.arange(count) == k
        step = joint.acceleration * 4e-3
        faster = replace(exact, velocity=exact.velocity + step * mask)
        check = checks_of(plan, t, q, {**offsets, i: faster})[velocity, joint.name]
        assert not check.passed
        assert check.time in t[k - 1 : k + 1]
        stronger = replace(exact, torque=exact.torque + 0.6 * np.ptp(exact.torque) * mask)
        check = checks_of(plan, t, q, {**offsets, i: stronger})[torque, joint.name]
        assert not check.passed
        assert check.time == t[k]
        weaker = replace(exact, torque=exact.torque - 0.6 * np.ptp(exact.torque) * mask)
        assert not checks_of(plan, t, q, {**offsets, i: weaker})[torque, joint.name].passed
        check = result[motor, joint.name]
        assert check.worst == pytest.approx(np.abs(exact.torque).max() - 1e-6)
        assert check.time == t[np.argmax(np.abs(exact.torque))]


def test_a_velocity_may_differ_from_the_slopes_beside_it_by_what_the_acceleration_gives(
    robot: Robot,
) -> None:
    joint, h = robot.joints[0], 0.01
    t = h * np.arange(5.0)
    for share, passed in ((0.999, True), (1.001, False)):
        for k in range(5):
            velocity = np.zeros(5)
            velocity[k] = -share * (joint.acceleration * h / 2 + 2 * 1e-5 / h + 1e-4)
            offset = Offsets(velocity, np.zeros(5), 1e-4, 0.0)
            check = module._velocity_check(joint, t, np.zeros(4), offset, rounding=1e-5)
            assert check.passed is passed
            assert check.worst == pytest.approx(abs(velocity[k]))
            assert check.time == t[max(k - 1, 0)]


def test_accelerations_near_a_setpoint_are_those_of_the_intervals_around(robot: Robot) -> None:
    """The bounds are the extremes of the mean accelerations in two intervals on each side of a
    setpoint.

    They are widened by a fraction of the limit that is proportional to the longest interval.
    """
    limit = np.array([joint.acceleration for joint in robot.joints])
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 6.5]) * 1e-3
    mean = np.array([0.1, 0.2, -0.3, 0.4, 0.0, 0.1, -0.2])[:, None] * limit
    qd = np.vstack([np.zeros(4), np.cumsum(mean * np.diff(t)[:, None], axis=0)])
    rounding = 1e-6 * limit * np.eye(4)[0]
    moving = np.zeros((8, 4), dtype=bool)
    low, high = module._acceleration_bounds(robot, t, qd, rounding, standing=moving)
    pad = limit * 1e-3 / module.FULL_ACCELERATION_PERIOD
    pad[0] += 2 * 1e-6 * limit[0] / 0.5e-3
    for k in range(8):
        near = mean[np.clip(np.arange(k - 2, k + 2), 0, 6)]
        assert low[k] == pytest.approx(np.minimum(near.min(axis=0) - pad, 0.0))
        assert high[k] == pytest.approx(np.maximum(near.max(axis=0) + pad, 0.0))
    low, high = module._acceleration_bounds(robot, 100 * t, 100 * qd, rounding, standing=moving)
    assert low.min(axis=0) == pytest.approx(-limit)
    assert high.max(axis=0) == pytest.approx(limit)


def test_near_rest_a_motion_may_be_shorter_than_a_period(robot: Robot) -> None:
    """Up to two setpoints away from rest, the bounds are the acceleration limits of both signs."""
    limit = np.array([joint.acceleration for joint in robot.joints])
    t = np.arange(8) * 1e-3
    standing = np.zeros((8, 4), dtype=bool)
    standing[0, 1] = True
    low, high = module._acceleration_bounds(
        robot, t, np.zeros((8, 4)), np.zeros(4), standing=standing
    )
    full = (low == -limit) & (high == limit)
    assert np.argwhere(full).tolist() == [[0, 1], [1, 1], [2, 1]]


def test_a_torque_may_exceed_the_motor_law_by_its_rounding_and_a_thousandth(plan: Plan) -> None:
    """A torque may leave the range of the nearby accelerations by at most twice its rounding plus a
    thousandth of the largest torque of the joint.
    """
    t = np.linspace(0.0, plan.motion.duration, 200)
    q, offsets = stream(plan, t)
    qd = np.gradient(q, t, axis=0)
    for i in DRIVEN:
        qd[:, i] = offsets[i].velocity
    low, high = module._motor_torque_range(plan.robot, t, q, qd, offsets)
    for i in DRIVEN:
        joint, rounding = plan.robot.joints[i], 1e-4 * np.abs(high[:, i]).max()
        allowed = 2 * rounding + 1e-3 * np.abs(high[:, i]).max()
        for k, sign, bound in ((60, 1, high), (140, -1, low)):
            for share, passed in ((0.99, True), (1.01, False)):
                torque = offsets[i].torque.copy()
                torque[k] = bound[k, i] + sign * share * allowed
                other = replace(offsets[i], torque=torque, torque_rounding=rounding)
                check = checks_of(plan, t, q, {**offsets, i: other})["torque offset", joint.name]
                assert check.passed is passed
                assert check.time == t[k]
                assert check.worst == pytest.approx(share * allowed)


def test_a_torque_offset_within_its_rounding_keeps_the_limit_of_the_motor(plan: Plan) -> None:
    t = np.linspace(0.0, plan.motion.duration, 50)
    q, offsets = stream(plan, t)
    joint, rounding = plan.robot.joints[0], 1e-3
    assert joint.motor is not None
    for excess, passed in ((0.9, True), (1.1, False)):
        for sign in (1, -1):
            torque = offsets[0].torque.copy()
            torque[20] = sign * (joint.motor.max_torque + excess * rounding)
            other = replace(offsets[0], torque=torque, torque_rounding=rounding)
            check = checks_of(plan, t, q, {**offsets, 0: other})["motor torque", "roll"]
            assert check.passed is passed
            assert check.time == t[20]


def test_a_joint_may_rest_up_to_the_rounding_of_its_offset(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A joint counts as resting up to the rounding of its velocity offset plus a millionth of its
    speed limit.

    A joint without offsets has no rounding.
    """
    offsets = {1: Offsets(np.zeros(2), np.zeros(2), 0.25, 0.0)}
    largest = np.array(
        [1e-6 * joint.velocity + 0.25 * (i == 1) for i, joint in enumerate(robot.joints)]
    )
    accelerations, masks = module._acceleration_bounds, []

    def noted(*arguments: Any, standing: Any) -> Any:
        masks.append(standing)
        return accelerations(*arguments, standing=standing)

    monkeypatch.setattr(module, "_acceleration_bounds", noted)
    speeds = np.outer([0.999, 1.001], largest)
    module._motor_torque_range(robot, np.array([0.0, 1e-3]), np.zeros((2, 4)), speeds, offsets)
    assert masks[0].tolist() == [[True] * 4, [False] * 4]
