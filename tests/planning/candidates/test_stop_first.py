"""Verify plans that begin at speed, at an instant at which the joints can stop.

A certified motion must exist to every target that the robot can reach from rest. The program Ruckig
gives the shortest stopping times.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan, starting_from
from ssm_planner.planning.lower_bound import quickest_stop
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TaskRange
from ssm_planner.problem.motion import Dwell, Free, Joints, Motion, Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array
from tests.support.cases import drawn
from tests.support.paths import ROOT

TARGET = Task(roll=0.35, tilt=-2.1, spin=0.4, depth=0.02)


def jerk_limited(problem: Problem) -> Problem:
    """Return the problem with jerk limits for all joints."""
    limits = {"revolute": 40.0, "prismatic": 1.0}
    joints = tuple(replace(joint, jerk=limits[joint.kind]) for joint in problem.robot.joints)
    return replace(problem, robot=replace(problem.robot, joints=joints))


@pytest.fixture(scope="module", params=["stock", "jerk", "eye"])
def moving(request: pytest.FixtureRequest, tilt_insert: Problem) -> Plan:
    """Return the plan of a certified free motion from rest to rest."""
    problem = tilt_insert
    target = TARGET
    if request.param == "jerk":
        problem = jerk_limited(problem)
    if request.param == "eye":
        problem = load_problem(ROOT / "problems/eye_approach.yaml")
        target = Task(roll=0.1, tilt=-1.9, spin=0.3, depth=0.016)
    quick = replace(problem, planner="fast", objective="time", motion=(Free(target),))
    result = plan(quick, relaxations=False)
    assert result.passed
    return result


def replanned(base: Plan, at: float, *motion: Motion) -> Plan:
    """Return the plan that continues from the instant `at` of the base plan."""
    problem = starting_from(replace(base.problem, motion=motion), base, at)
    return plan(problem, relaxations=False)


def stopping_times(base: Plan, at: float) -> Array:
    """Return the shortest times in s in which the joints come to rest, (4,).

    With jerk limits, Ruckig computes them.
    """
    state = base.motion.sample(at)
    q, qd, qdd = state.q[0], state.qd[0], state.qdd[0]
    joints = base.problem.robot.joints
    if joints[0].jerk is None:
        return np.abs(qd) / [joint.acceleration for joint in joints]
    ruckig = pytest.importorskip("ruckig", reason="Ruckig is not installed")
    task, result = ruckig.InputParameter(4), ruckig.Trajectory(4)
    task.control_interface = ruckig.ControlInterface.Velocity
    task.synchronization = ruckig.Synchronization.No
    task.current_position, task.current_velocity, task.current_acceleration = q, qd, qdd
    task.target_velocity = task.target_acceleration = [0.0] * 4
    task.max_acceleration = [joint.acceleration for joint in joints]
    task.max_jerk = [joint.jerk for joint in joints]
    assert ruckig.Ruckig(4).calculate(task, result) == ruckig.Result.Working
    return np.array(result.independent_min_durations)


KEPT = [(0, 1, 2, 3), (0, 1, 2), (3,), (1, 3)]
RETURNS = [(share, kept) for kept in KEPT for share in drawn(2, [0.1, 0.37, 0.66, 0.9], str(kept))]


@pytest.mark.parametrize(("share", "kept"), RETURNS)
def test_joints_return_to_where_they_are_while_they_move(
    moving: Plan, share: float, kept: tuple[int, ...]
) -> None:
    """Some joints have their present position as the target. The others continue a little."""
    time = share * moving.motion.duration
    state = moving.motion.sample(time)
    q, qd = state.q[0], state.qd[0]
    target = q + 0.3 * qd * np.abs(qd) / moving.problem.robot.accelerations
    target[list(kept)] = q[list(kept)]
    result = replanned(moving, time, Free(Joints.from_array(target)))
    assert result.passed, result.reason
    first, last = (
        result.motion.sample(t, side) for t, side in ((0.0, "right"), (result.duration, "left"))
    )
    assert first.q[0] == pytest.approx(q, abs=1e-9)
    assert first.qd[0] == pytest.approx(qd, abs=1e-7)
    assert last.q[0] == pytest.approx(target, abs=1e-8)
    assert result.duration >= (1 - 1e-6) * stopping_times(moving, time).max()


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_a_line_begins_after_a_stop(moving: Plan, share: float) -> None:
    """With jerk limits, the robot comes to rest as soon as its slowest joint can."""
    time = share * moving.motion.duration
    result = replanned(moving, time, Straight(depth=0.002))
    assert result.passed, result.reason
    assert [phase.name.partition(",")[0] for phase in result.phases] == ["stop", "insert"]
    quickest = stopping_times(moving, time).max()
    stop = result.phases[0].duration
    if moving.problem.robot.joints[0].jerk is None:
        assert quickest * (1 - 1e-6) <= stop <= 1.5 * quickest
    else:
        assert stop == pytest.approx(quickest, rel=1e-6)


def test_the_present_position_is_a_target_only_at_speed(tilt_insert: Problem) -> None:
    """A motion to the present position is refused at rest, and planned at speed."""
    start, present = Task(tilt=-1.6, depth=0.01), Free(Task(tilt=-1.6))
    still = replace(
        tilt_insert, planner="fast", objective="time", start=start, motion=(present,), limits=()
    )
    with pytest.raises(ProblemError, match="has length zero"):
        plan(still)
    speed, acceleration = 0.015, tilt_insert.robot.joints[3].acceleration
    moving = replace(still, start_rate={"depth": speed})
    result = plan(moving, relaxations=False)
    assert result.passed, result.reason
    # The joint brakes over v²/(2 a) and returns from rest.
    expected = speed / acceleration * (1 + np.sqrt(2))
    assert result.duration == pytest.approx(expected, rel=1e-4)
    waits = plan(replace(moving, motion=(present, Dwell(0.3))), relaxations=False)
    assert waits.passed, waits.reason
    assert [phase.duration for phase in waits.phases] == pytest.approx([expected, 0.3], rel=1e-4)
    backwards = replace(still, end_rate=moving.start_rate)
    assert plan(backwards, relaxations=False).duration == pytest.approx(expected, rel=1e-4)
    with pytest.raises(ProblemError, match="a dwell has no speed"):
        plan(replace(moving, motion=(Dwell(0.3),)))


@pytest.mark.parametrize("seed", range(40))
def test_the_quickest_stop_is_that_of_ruckig(seed: int) -> None:
    ruckig = pytest.importorskip("ruckig", reason="Ruckig is not installed")
    rng = np.random.default_rng(seed)
    limit, jerk = rng.uniform(0.5, 4.0), 10 ** rng.uniform(-0.5, 2)
    speed, acceleration = rng.uniform(-1.0, 1.0), rng.uniform(-limit, limit)
    curve = quickest_stop(speed, acceleration, limit, jerk)
    task, result = ruckig.InputParameter(1), ruckig.Trajectory(1)
    task.control_interface = ruckig.ControlInterface.Velocity
    task.current_position, task.current_velocity, task.current_acceleration = (
        [0.0],
        [speed],
        [acceleration],
    )
    task.target_velocity = task.target_acceleration = [0.0]
    task.max_acceleration, task.max_jerk = [limit], [jerk]
    assert ruckig.Ruckig(1).calculate(task, result) == ruckig.Result.Working
    assert curve.duration == pytest.approx(result.duration, rel=1e-9)
    t = np.linspace(0.0, curve.duration, 200)
    values = np.array([result.at_time(instant) for instant in t])[:, :, 0]
    for own, other in zip(curve.evaluate(t), values.T, strict=True):
        assert own == pytest.approx(other, abs=1e-8)


@pytest.fixture
def stops_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Change the planner so that it finds no direct motion for phases that begin at speed."""
    free = PhasePlanner.free

    def from_rest(planner: PhasePlanner, *given: Any, **named: Any) -> PlannedPhase | Reason:
        if planner.phase.qd_start.any():
            return Reason(message="no direct motion")
        return free(planner, *given, **named)

    monkeypatch.setattr(PhasePlanner, "free", from_rest)


@pytest.mark.usefixtures("stops_alone")
@pytest.mark.parametrize("torque", [1.2e-3, 2.2e-3, 6.7e-3])
def test_a_weak_motor_brakes_its_heavy_rotor_less_hard(tilt_insert: Problem, torque: float) -> None:
    """The insertion has almost no friction, so the motor itself must brake the rotor."""
    *others, joint = tilt_insert.robot.joints
    assert joint.drive is not None
    assert joint.drive.friction is not None
    assert joint.motor is not None
    friction = replace(joint.drive.friction, b_c=0.0, b_oc=0.0, mu_lowest=None)
    drive = replace(joint.drive, friction=friction, input_inertia=100 * joint.drive.input_inertia)
    motor = replace(joint.motor, max_torque=torque, nominal_torque=torque)
    robot = replace(tilt_insert.robot, joints=(*others, replace(joint, drive=drive, motor=motor)))
    problem = replace(
        tilt_insert,
        robot=robot,
        motion=tilt_insert.motion[1:],
        planner="fast",
        objective="time",
        duty=None,
        eye=None,
    )
    base = plan(problem, relaxations=False)
    assert base.passed
    state = base.motion.sample(0.5 * base.duration)
    result = replanned(base, 0.5 * base.duration, Free(Joints.from_array(state.q[0])))
    assert result.passed, result.reason
    assert [phase.name for phase in result.phases] == ["free, stops first"]
    quickest = abs(float(state.qd[0, 3])) / joint.acceleration
    assert result.duration >= (1 + np.sqrt(2)) * quickest * (1 - 1e-6)


@pytest.mark.usefixtures("stops_alone")
@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_requested_duration_is_kept_after_a_stop(moving: Plan, share: float) -> None:
    """A slower stop would need another path, so only the motion after the stop takes longer."""
    time = share * moving.motion.duration
    target = Joints.from_array(moving.motion.sample(0.0).q[0])
    fastest = replanned(moving, time, Free(target))
    assert fastest.passed, fastest.reason
    assert [phase.name for phase in fastest.phases] == ["free, stops first"]
    duration = 1.3 * fastest.duration
    slower = replanned(moving, time, Free(target, duration=duration))
    assert slower.passed, slower.reason
    assert slower.duration == pytest.approx(duration, rel=1e-9)
    instants = np.linspace(0.0, stopping_times(moving, time).max(), 20)
    own, other = (result.motion.sample(instants).q for result in (slower, fastest))
    assert own == pytest.approx(other, abs=1e-9)
    late = replanned(moving, time, Free(target, duration=0.9 * fastest.duration))
    assert late.reason is not None
    assert late.reason.constraint == "duration"


@pytest.mark.parametrize("share", [0.1, 0.25, 0.4, 0.6, 0.8])
def test_a_stop_before_a_line_stays_in_a_narrow_range_of_roll(
    tilt_insert: Problem, share: float
) -> None:
    """The roll range is 1 mrad wider on each side than the base motion.

    Joints that stop one after another would leave it.
    """
    quick = replace(
        tilt_insert, planner="fast", objective="time", motion=(Free(TARGET),), limits=(), eye=None
    )
    base = plan(quick, relaxations=False)
    assert base.passed
    mechanism = Mechanism.from_robot(quick.robot)
    samples = base.motion.sample(np.linspace(0.0, base.duration, 400))
    roll = task_from_joints(mechanism, samples.q)[:, 0]
    narrow = TaskRange("roll", float(roll.min()) - 1e-3, float(roll.max()) + 1e-3)
    base = plan(replace(quick, limits=(narrow,)), relaxations=False)
    assert base.passed
    result = replanned(base, share * base.duration, Straight(depth=0.002))
    assert result.passed, result.reason


def test_the_tasks_of_a_retracting_tool(tilt_insert: Problem) -> None:
    """An alarm commands only a depth, and the other task coordinates keep their present values."""
    base = plan(
        replace(
            tilt_insert,
            planner="fast",
            objective="time",
            motion=(Free(Task(roll=np.radians(20), tilt=np.radians(-125), depth=0.02)),),
        ),
        relaxations=False,
    )
    assert base.passed
    mechanism = Mechanism.from_robot(tilt_insert.robot)
    for time in np.linspace(0.02, 0.98, 17) * base.motion.duration:
        result = replanned(base, float(time), Free(Task(depth=0.002)))
        assert result.passed, (time, result.reason)
        ends = result.motion.sample(result.duration, "left").q
        task = task_from_joints(mechanism, base.motion.sample(time).q)[0]
        assert task_from_joints(mechanism, ends)[0] == pytest.approx([*task[:3], 0.002], abs=1e-7)
