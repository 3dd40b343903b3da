"""Controlled stops are compared with closed forms, bisection on the exact laws and `check`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.motors import drive_torque, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.plans import load_plan
from ssm_planner.problem.limits import TipSpeed
from ssm_planner.stopping import controlled_stops
from ssm_planner.trajectory import Samples, Span, Trajectory
from ssm_planner.verification import quickest_stops
from ssm_planner.verification import stops as stops_module
from ssm_planner.verification.check import check
from tests.support.paths import RESULTS


@pytest.fixture(scope="module")
def plan():
    return load_plan(RESULTS / "tilt_insert" / "plan.json")


def sliding(speed: float, acceleration: float) -> Trajectory:
    """Return a motion of joint 4 that starts at −5 mm.

    It accelerates, keeps its speed for 0.5 s and decelerates. `speed` is in m/s and `acceleration`
    in m/s².
    """
    ramp = speed / acceleration
    breaks = np.cumsum([0.0, ramp, 0.5, ramp])
    coefficients = np.zeros((3, 6, 4))
    places = -0.005 - np.cumsum([0.0, speed * ramp / 2, 0.5 * speed])
    coefficients[:, 0, 3], coefficients[:, 1, 3] = places, [0.0, -speed, -speed]
    coefficients[:, 2, 3] = [-acceleration / 2, 0.0, acceleration / 2]
    return Trajectory(breaks, coefficients, (Span("slide", 0.0, float(breaks[-1])),))


def test_one_joint_stops_as_a_brake_does(plan):
    """At constant speed, a stop takes the time v/a and the distance v²/2a.

    While the motion brakes at 80 % of the limit, a stop takes 80 % of the remaining time.
    """
    speed, limit = 0.01, plan.robot.joints[3].acceleration
    motion = sliding(speed, 0.8 * limit)
    stops = controlled_stops(motion, plan.robot, instants=500)
    assert stops.passed
    ramp = speed / (0.8 * limit)
    cruising = (stops.time > ramp) & (stops.time < ramp + 0.4)
    np.testing.assert_allclose(stops.duration[cruising], speed / limit, rtol=2e-3)
    np.testing.assert_allclose(stops.travel[cruising], speed**2 / (2 * limit), rtol=2e-3)
    braking = stops.time > ramp + 0.5
    left = motion.duration - stops.time[braking]
    np.testing.assert_allclose(stops.duration[braking], 0.8 * left, atol=2.5e-3)
    assert stops.duration[0] == stops.duration[-1] == 0.0


def least(plan, body, q, dq, ddq, v):
    """Return the smallest path acceleration s̈ that keeps the limits at one instant.

    It is found by bisection on the exact laws. `q` (4,), `dq` and `ddq` are the joint positions and
    their derivatives with respect to s. `v` is the path speed.
    """

    def kept(u):
        qd, qdd = dq * v, dq * u + ddq * v**2
        if any(
            abs(a) > j.acceleration * (1 + 1e-9)
            for a, j in zip(qdd, plan.robot.joints, strict=True)
        ):
            return False
        samples = Samples(np.zeros(1), *(x[None, :] for x in (q, qd, qdd, 0 * q)))
        torque = motor_motion(
            plan.robot, body, samples, np.sign(dq)[None, :], np.zeros((1, 4))
        ).torque[0]
        return all(
            abs(t) <= j.motor.max_torque
            for t, j in zip(torque, plan.robot.joints, strict=True)
            if j.motor and j.drive
        )

    low, high = -1e4, 0.0
    for _ in range(32):  # The final interval has a width of 1e4 / 2**32.
        middle = (low + high) / 2
        low, high = (low, middle) if kept(middle) else (middle, high)
    return high


@pytest.mark.parametrize("weak", [False, True])
@pytest.mark.slow
def test_a_stop_is_the_quickest_that_bisection_finds(plan, weak):
    """A stop takes as long as a simulation in small steps that brakes as hard as possible.

    The reference is the bisection on the exact laws. With weak motors, torque limits are active
    too.
    """
    if weak:
        joints = tuple(
            replace(
                j,
                motor=replace(j.motor, nominal_torque=1e-6, max_torque=factor * j.motor.max_torque),
            )
            if j.motor
            else j
            for j, factor in zip(plan.robot.joints, (0.4, 0.21, 1.0, 0.4), strict=True)
        )
        plan = replace(
            plan,
            problem=replace(plan.problem, robot=replace(plan.robot, joints=joints)),
            certificate=None,
        )
    body, dt = RigidBody.from_robot(plan.robot), 1e-3
    instants = np.array([0.6, 1.4, 1.8, 2.8])
    stops = controlled_stops(plan.motion, plan.robot, plan.limits, instants)
    assert stops.passed, stops.certificate.violations
    for start, duration in zip(stops.time, stops.duration, strict=True):
        s, v, t = start, 1.0, 0.0
        while v > 0:
            x = plan.motion.sample(np.array([s]))
            u = least(plan, body, x.q[0], x.qd[0], x.qdd[0], v)
            step = min(dt, -v / u) if u < 0 else dt
            s, v, t = s + v * step + u * step**2 / 2, v + u * step, t + step
            v = 0.0 if v < 1e-9 else v
        assert duration == pytest.approx(t, rel=0.01)


def variant(robot, kind):
    """Return the robot with weak motors, and with other drives for two of the kinds.

    The loads move the drives of the kind "slippery". The friction of the kind "varying" rises
    towards low speed.
    """

    def changed(joint):
        if joint.motor is None:
            return joint
        share = {"weak": 0.3, "slippery": 0.04, "varying": 0.4}[kind]
        motor = replace(joint.motor, nominal_torque=1e-6, max_torque=share * joint.motor.max_torque)
        friction, locks = joint.drive.friction, joint.drive.self_locking
        if kind == "slippery":
            friction = replace(friction, mu=0.02, mu_static=0.02, b_c=1e-6, b_oc=0.0)
            locks = False
        if kind == "varying":
            law = {"law": "stribeck_exponential", "mu_stribeck": 0.1, "stribeck_speed": 20.0}
            friction = replace(friction, **law, mu_static=friction.mu + 0.1)
        return replace(
            joint, motor=motor, drive=replace(joint.drive, friction=friction, self_locking=locks)
        )

    return replace(robot, joints=tuple(map(changed, robot.joints)))


@pytest.mark.parametrize("ends", [False, True])
@pytest.mark.parametrize("kind", ["weak", "slippery", "varying"])
def test_the_bound_of_an_interval_is_what_bisection_on_the_laws_finds(plan, kind, ends):
    """The bound for an interval equals the result of bisection on the exact laws.

    Intervals and speeds are random. With `ends`, the limits must also hold at rest at both ends.
    Cases that break a limit without braking are left out.
    """
    robot, rng = variant(plan.robot, kind), np.random.default_rng(7)
    path = stops_module._StopPath.from_motion(
        plan.motion, robot, np.linspace(0.0, plan.motion.duration, 50), np.zeros(0)
    )
    body = RigidBody.from_robot(robot)
    with np.errstate(all="ignore"):
        bounds = stops_module._DecelerationBounds.from_path(path, robot)
    k = rng.integers(0, len(path.s) - 1, 400)
    x, length = rng.uniform(0.05, 1.0, 400), np.diff(path.s)[k]
    share = 1 - stops_module.LIMIT_REDUCTION
    most = np.array([joint.acceleration for joint in robot.joints]) * share
    torque = np.array([j.motor.max_torque if j.motor else np.inf for j in robot.joints]) * share

    def kept(u):
        fine = np.ones(400, dtype=bool)
        still = 0.0 * x
        # The bound evaluates viscous friction at the speed at which the interval begins.
        last = [(0, still, still), (1, still, still)] if ends else [(1, x + 2 * u * length, x)]
        for end, square, viscous in [(0, x, x), *last]:
            q, dq, ddq = path.q[end, k], path.dq[end, k], path.ddq[end, k]
            qd, qdd = dq * np.sqrt(viscous)[:, None], dq * u[:, None] + ddq * square[:, None]
            tau = body.inverse_dynamics(q, dq * np.sqrt(np.maximum(square, 0))[:, None], qdd)
            for i, joint in enumerate(robot.joints):
                fine &= np.abs(qdd[:, i]) <= most[i] * (1 + 1e-9)
                if joint.drive is not None:
                    motion = tau[:, i], qd[:, i], qdd[:, i], np.sign(dq[:, i])
                    result = drive_torque(joint.drive, *motion, breakaway=np.zeros(400))[0]
                    fine &= np.nan_to_num(np.abs(result)) <= torque[i] * (1 + 1e-9)
        return fine

    low, high = np.full(400, -1e3), np.zeros(400)
    possible = kept(high)
    for _ in range(60):
        middle = (low + high) / 2
        inside = kept(middle)
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    with np.errstate(all="ignore"):  # some intervals have no bound
        result = bounds.smallest_acceleration(k, x, ends=ends)
    assert possible.sum() > 50
    assert result[possible] == pytest.approx(high[possible], rel=1e-6, abs=1e-6)


def test_stops_lie_on_the_path_and_are_what_the_check_says_of_each(plan):
    stops = controlled_stops(plan.motion, plan.robot, plan.limits, 60)
    fine = plan.motion.sample(np.linspace(0.0, plan.motion.duration, 20_001)).q
    moving = [
        (t, motion)
        for t, motion in zip(stops.time, stops.motions, strict=True)
        if motion is not None
    ]
    assert len(moving) > 50
    for t, stop in moving:
        planned, beginning = plan.motion.sample(t), stop.sample(0.0)
        np.testing.assert_allclose(beginning.q, planned.q, atol=1e-12)
        np.testing.assert_allclose(beginning.qd, planned.qd, atol=1e-9)
        last = stop.sample(stop.breaks[-1:], "left")
        assert np.abs(last.qd).max() < 1e-9
        assert np.abs(fine - last.q).max(axis=1).min() < 2e-4
    for _, stop in moving[::10]:
        limits = replace(plan.limits, start_rate=None)
        result = check(stop, plan.robot, limits)
        assert result.passed, result.violations


@pytest.mark.parametrize("name", ["tilt_insert", "eye_approach"])
def test_every_stop_of_a_shipped_plan_is_certified(name):
    plan = load_plan(RESULTS / name / "plan.json")
    stops = controlled_stops(plan.motion, plan.robot, plan.limits)
    assert stops.passed, stops.certificate.violations
    assert len(stops.time) >= 1000
    assert 0.1 < stops.duration.max() < 0.5
    assert 0 < stops.travel.max() < 5e-3


def test_a_limit_that_the_motion_breaks_its_stops_break_too(plan):
    slow = TipSpeed(1e-3).on(plan.limits)
    assert not controlled_stops(plan.motion, plan.robot, slow, 50).passed


def test_friction_that_depends_on_the_speed_by_nothing_makes_the_same_stops(plan):
    """Friction with a zero dependence on speed gives the same stops as constant friction.

    The program bounds constant friction by separate rows, and other friction by its law at every
    speed.
    """

    def varying(joint):
        if joint.drive is None:
            return joint
        friction = replace(
            joint.drive.friction, law="stribeck_exponential", mu_stribeck=0.0, stribeck_speed=50.0
        )
        return replace(joint, drive=replace(joint.drive, friction=friction))

    robot = replace(plan.robot, joints=tuple(map(varying, plan.robot.joints)))
    one, other = (controlled_stops(plan.motion, item, instants=60) for item in (plan.robot, robot))
    np.testing.assert_allclose(one.duration, other.duration, rtol=1e-9)
    np.testing.assert_allclose(one.travel, other.travel, rtol=1e-9)


@pytest.mark.parametrize("jerk", [None, 500.0])
@pytest.mark.parametrize("name", ["tilt_insert", "eye_approach"])
def test_a_stop_does_not_depend_on_the_other_instants(name, jerk):
    """The stop from an instant is the same alone, in any selection, and among all cycles."""
    plan = load_plan(RESULTS / name / "plan.json")
    robot = plan.robot
    robot = replace(robot, joints=tuple(replace(joint, jerk=jerk) for joint in robot.joints))
    times = np.arange(0.0, plan.motion.duration, 1e-3 if jerk is None else 1e-2)
    stops = quickest_stops(plan.motion, robot, times)
    rng = np.random.default_rng(5)
    selections = [rng.choice(len(times), count, replace=False) for count in (1, 2, 30)]
    for chosen in map(np.sort, (*selections, np.arange(3, len(times), 7))):
        some = quickest_stops(plan.motion, robot, times[chosen])
        assert np.array_equal(some.time, stops.time[chosen])
        assert np.array_equal(some.duration, stops.duration[chosen])
        assert some.travel == pytest.approx(stops.travel[chosen], rel=1e-12)
        for k, stop in zip(chosen, some.motions, strict=True):
            reference = stops.motions[k]
            if stop is None or reference is None:
                assert stop is reference
                continue
            assert np.array_equal(stop.breaks, reference.breaks)
            assert np.array_equal(stop.coefficients, reference.coefficients)
