"""Verify free motions that begin or end at speed, whose joints may reverse or overshoot.

The references are closed forms, the program Ruckig for the slowest joint alone, and a linear
program.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from ssm_planner.cli import main
from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import Replanner, plan, starting_from
from ssm_planner.planning import phase_planner, planner
from ssm_planner.planning.lower_bound import quickest_stop
from ssm_planner.planning.ocp.guesses import guess_between
from ssm_planner.planning.ocp.joint_profile import JointProfile
from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.limits import TASK_COORDINATES
from ssm_planner.problem.motion import Free, Joints, Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.reporting.text import solver_and_condition_lines
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array
from ssm_planner.verification.check import check
from tests.support.paths import ROOT

WithJerk = Callable[[Robot, float, float], Robot]
LOW, HIGH = np.radians([-25, -137, -60]), np.radians([25, -84, 60])


@pytest.fixture(scope="module")
def shipped(tilt_insert: Problem) -> Plan:
    """Return the plan of the shipped problem `tilt_insert` with the objective time."""
    return plan(dataclasses.replace(tilt_insert, objective="time"))


@pytest.fixture(scope="module")
def to_anywhere(tilt_insert: Problem) -> Problem:
    """Return a problem with one free motion, the template of plans to any target."""
    return dataclasses.replace(tilt_insert, objective="time", motion=(Free(Task(tilt=-1.6)),))


def optimum(
    problem: Problem,
    q: Array,
    qd: Array,
    target: Array,
    *,
    qd_end: Array | None = None,
    pull: Array | None = None,
) -> float:
    """Return the time in s that the slowest joint needs alone, computed by Ruckig.

    The positions, velocities and start accelerations `q`, `qd`, `target`, `qd_end` and `pull` have
    the shape (4,).
    """
    ruckig = pytest.importorskip("ruckig", reason="Ruckig is not installed")
    slowest = 0.0
    for i, joint in enumerate(problem.robot.joints):
        task, result = ruckig.InputParameter(1), ruckig.Trajectory(1)
        task.current_position, task.current_velocity, task.target_position = (
            [q[i]],
            [qd[i]],
            [target[i]],
        )
        task.target_velocity = [0.0 if qd_end is None else qd_end[i]]
        task.current_acceleration = [0.0 if pull is None else pull[i]]
        task.max_velocity, task.max_acceleration = (
            [joint.velocity],
            [(1 + 1e-9) * joint.acceleration],
        )
        task.max_jerk = [joint.jerk or np.inf]
        assert ruckig.Ruckig(1).calculate(task, result) == ruckig.Result.Working
        slowest = max(slowest, result.duration)
    return slowest


def test_back_to_where_it_came_from(shipped: Plan, to_anywhere: Problem) -> None:
    """A plan back to the start pose continues from the speed of the interrupted motion."""
    back = Replanner(to_anywhere).plan_from(shipped, 1.0, Task(tilt=np.radians(-85)))
    assert back.passed
    state = shipped.motion.sample(1.0)
    begins = back.motion.sample(0.0)
    assert begins.q == pytest.approx(state.q, abs=1e-12)
    assert begins.qd == pytest.approx(state.qd, abs=1e-9)
    assert back.duration == pytest.approx(1.6498, abs=1e-4)
    assert back.duration == pytest.approx(back.lower_bound, rel=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_from_any_instant_to_any_target_as_fast_as_the_slowest_joint(
    shipped: Plan, to_anywhere: Problem, seed: int
) -> None:
    """The duration is within 1 % of the time that Ruckig computes for the slowest joint."""
    rng = np.random.default_rng(seed)
    time = float(rng.uniform(0, shipped.motion.duration))
    roll, tilt, spin = rng.uniform(LOW, HIGH).tolist()
    target = Task(roll, tilt, spin, float(rng.uniform(0.001, 0.029)))
    result = Replanner(to_anywhere).plan_from(shipped, time, target)
    assert result.passed, result.reason
    state = shipped.motion.sample(time)
    last = result.motion.sample(result.motion.breaks[-1:], "left").q[0]
    least = optimum(to_anywhere, state.q[0], state.qd[0], last)
    assert (1 - 1e-6) * least <= result.duration <= 1.01 * least


@pytest.mark.parametrize("seed", [0, 7])
def test_where_jerk_is_limited_the_acceleration_goes_on_too(
    tilt_insert: Problem, with_jerk: WithJerk, seed: int
) -> None:
    """Under a jerk limit, the new motion also begins with the acceleration of the old one."""
    robot = with_jerk(tilt_insert.robot, 35.0, 1.0)
    problem = dataclasses.replace(tilt_insert, objective="time", robot=robot)
    first = plan(dataclasses.replace(problem, motion=(Straight(tilt=np.radians(-135)),)))
    rng = np.random.default_rng(seed)
    time = float(rng.uniform(0, first.motion.duration))
    roll, tilt, spin = rng.uniform(LOW, HIGH).tolist()
    free = dataclasses.replace(problem, motion=(Free(Task(tilt=-1.6)),))
    result = Replanner(free).plan_from(first, time, Task(roll, tilt, spin, 0.01))
    assert result.passed, result.reason
    state, begins = first.motion.sample(time), result.motion.sample(0.0)
    assert begins.qdd == pytest.approx(state.qdd, abs=1e-9)
    last = result.motion.sample(result.motion.breaks[-1:], "left").q[0]
    least = optimum(free, state.q[0], state.qd[0], last, pull=state.qdd[0])
    assert (1 - 1e-6) * least <= result.duration <= 1.01 * least


def test_an_end_at_speed_against_the_way_is_a_start_run_backwards(tilt_insert: Problem) -> None:
    """A free motion that ends at speed takes the time that Ruckig computes for the slowest joint.

    The sliding joint must end with a velocity opposite to its displacement, so it overshoots the
    target first.
    """
    first, last = Joints((-0.3, 0.5, 0.1, -0.008)), Joints((0.3, -0.2, 0.5, -0.015))
    rate = {"depth": -0.012}
    problem = dataclasses.replace(
        tilt_insert, objective="time", start=first, motion=(Free(last),), end_rate=rate
    )
    result = plan(problem)
    assert result.passed, result.reason
    depth = result.motion.uniform(500).q[:, 3]
    # The joint passes the target by at least 90 % of its braking distance.
    assert depth.min() < -0.015 - 0.9 * 0.012**2 / 0.2
    least = optimum(
        problem,
        np.array(first.values),
        np.zeros(4),
        np.array(last.values),
        qd_end=np.array([0, 0, 0, 0.012]),
    )
    assert result.duration == pytest.approx(least, rel=1e-4)


def test_too_fast_to_stop_before_the_target_it_overshoots(tilt_insert: Problem) -> None:
    """A joint that cannot stop before its target overshoots, in the closed-form time."""
    start, speed = 0.010, 0.018
    motion = (Free(Task(depth=start + 0.0005)),)
    first = Task(tilt=-1.6, depth=start)
    result = plan(
        dataclasses.replace(
            tilt_insert, objective="time", start=first, motion=motion, start_rate={"depth": speed}
        )
    )
    assert result.passed, result.reason
    a = tilt_insert.robot.joints[3].acceleration
    beyond = speed**2 / (2 * a) - 0.0005
    assert result.duration == pytest.approx(speed / a + 2 * np.sqrt(beyond / a), rel=1e-4)
    missed = check(
        result.motion,
        result.robot,
        dataclasses.replace(result.limits, start_rate={"depth": 0.9 * speed}),
    )
    assert [item.name for item in missed.violations] == ["start velocity"]


def test_points_are_passed_after_turning(tilt_insert: Problem) -> None:
    """A motion that begins at speed still passes its waypoint."""
    through = (Joints((0.1, 0.2, 0.1, -0.012)),)
    motion = (Free(Joints((0.3, -0.2, 0.5, -0.02)), through=through),)
    start = Joints((-0.2, 0.5, 0.0, -0.01))
    mechanism = Mechanism.from_geometry(tilt_insert.robot.geometry)
    qd = np.array([[-0.6, 0.7, 0.3, -0.015]])
    rates = task_rates(mechanism, [start.values], qd)[0]
    problem = dataclasses.replace(tilt_insert, objective="time", start=start, motion=motion)
    result = plan(
        dataclasses.replace(
            problem, start_rate=dict(zip(TASK_COORDINATES, rates.tolist(), strict=True))
        )
    )
    assert result.passed, result.reason
    q = result.motion.uniform(2000).q
    assert np.abs(q - through[0].values).max(axis=1).min() < 1e-3
    assert result.motion.sample(0.0).qd == pytest.approx(qd, abs=1e-9)


def test_where_a_line_cannot_begin_at_this_speed_the_robot_stops_first(
    shipped: Plan, tilt_insert: Problem
) -> None:
    """If a straight motion cannot begin at the given speed, the plan has a stop phase first."""
    line = dataclasses.replace(tilt_insert, motion=(Straight(tilt=np.radians(-100)),))
    result = plan(starting_from(line, shipped, 0.9))
    assert result.passed, result.reason
    assert [phase.name for phase in result.phases] == ["stop", "tilt"]
    with pytest.raises(ProblemError, match=r"at = 9 s: not an instant of this motion"):
        starting_from(line, shipped, 9.0)


@pytest.mark.parametrize("share", [0.6, 1.0, 1.15])
def test_with_limited_jerk_joints_overshoot_a_target_within_their_braking_distance(
    tilt_insert: Problem, with_jerk: WithJerk, share: float
) -> None:
    """With limited jerk, a joint needs more than v²/(2a) to stop, so it overshoots and returns."""
    robot = with_jerk(tilt_insert.robot, 35.0, 1.0)
    problem = dataclasses.replace(tilt_insert, objective="time", robot=robot)
    first = plan(dataclasses.replace(problem, motion=(Free(Task(0.5, -2.3, 0.4, 0.02)),)))
    state = first.motion.sample(0.4 * first.motion.duration)
    braking = [joint.acceleration for joint in robot.joints]
    target = state.q[0] + share * state.qd[0] * np.abs(state.qd[0]) / 2 / braking
    free = dataclasses.replace(problem, motion=(Free(Joints(tuple(target))),))
    result = Replanner(free).plan_from(first, 0.4 * first.motion.duration)
    assert result.passed, result.reason
    least = optimum(free, state.q[0], state.qd[0], target, pull=state.qdd[0])
    assert (1 - 1e-6) * least <= result.duration <= 1.01 * least


@pytest.mark.parametrize("seed", range(20))
def test_the_guess_keeps_the_limits_of_each_joint_and_its_directions(seed: int) -> None:
    """The initial guess keeps the speed, acceleration and direction of each joint."""
    rng = np.random.default_rng(seed)
    way, limits = rng.uniform(-1, 1, 4), np.array([[1.0] * 4, [3.0] * 4, [np.inf] * 4])
    speeds = np.stack([rng.uniform(-1, 1, 4) * (rng.random(4) < 0.7), np.zeros(4)])
    start = rng.uniform(-1, 1, 4)
    result = guess_between(start, way, speeds, limits, count=40)
    assert result.points[0] == pytest.approx(start)
    assert result.points[-1] == pytest.approx(start + way)
    for guess, sign in zip(result.guesses, result.directions, strict=True):
        velocity = guess.elements.v
        assert np.abs(velocity).max() <= 1 + 1e-9
        assert np.abs([guess.elements.a0, guess.elements.a1]).max() <= 3 + 1e-9
        slack = 3.0 * 2 * 4e-3 * sum(item.motion.duration for item in result.guesses)
        assert (velocity * sign >= -slack).all()
        assert (velocity[:, sign == 0] == 0).all()


@pytest.mark.parametrize("is_at_stop", [False, True])
@given(
    speed=st.floats(-0.9, 0.9),
    acceleration=st.floats(-2.0, 2.0),
    displacement=st.floats(-2.0, 2.0),
    longer=st.floats(1.0, 3.0),
)
def test_a_jerk_limited_guess_begins_with_the_state_of_the_joint(
    is_at_stop: bool, speed: float, acceleration: float, displacement: float, longer: float
) -> None:
    """The guess has the initial velocity and acceleration, and reverses at the stated times.

    If it begins with a stop, it covers the displacement exactly.
    """
    limits = np.array([1.0, 2.0, 10.0])
    speed, acceleration = round(speed, 3), round(acceleration, 3)
    if is_at_stop and (speed or acceleration):
        displacement = quickest_stop(speed, acceleration, 2.0, 10.0).distance
    profile = JointProfile.from_limits(displacement, (speed, 0.0), limits, acceleration)
    if not profile.is_moving:
        return
    duration = longer * profile.duration
    curve = profile.with_duration(duration)
    _, initial_speed, initial_acceleration = curve.evaluate(np.zeros(1))
    assert initial_speed[0] == pytest.approx(speed, abs=1e-12)
    if profile.prelude is not None:
        assert initial_acceleration[0] == pytest.approx(acceleration, abs=1e-9)
    assert curve.evaluate(np.array([curve.duration]))[1][0] == pytest.approx(0.0, abs=1e-9)
    if profile.prelude_reversals:
        assert curve.distance == pytest.approx(displacement, abs=1e-9)
    reversals = [*profile.reversal_times[0], duration]
    direction = profile.sign * (-1.0) ** len(profile.reversal_times[0])
    start = 0.0
    for end in reversals:
        inside = np.linspace(start, end, 12)[1:-1]
        assert np.all(direction * curve.evaluate(inside)[1] >= -1e-9)
        start, direction = end, -direction


@pytest.mark.slow
def test_the_command_begins_at_an_instant_of_a_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command `plan --from --at` plans from an instant, and `--from` alone is refused."""
    words = [
        "plan",
        "tilt_insert",
        "--from",
        str(ROOT / "results/tilt_insert"),
        "--json",
        "-o",
        str(tmp_path / "on"),
    ]
    assert main([*words, "--at", "1.2s"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["passed"]
    assert [phase["name"] for phase in result["phases"]] == ["stop", "tilt", "insert"]
    assert "starts       at tilt" in "\n".join(
        solver_and_condition_lines(load_plan(tmp_path / "on"))
    )
    assert main(words) == 2


def test_a_start_at_the_limit_of_a_rate_is_within_it() -> None:
    """A start state whose tilt rate lies exactly at its limit is not refused."""
    shipped = load_plan(ROOT / "results/eye_approach")
    free = dataclasses.replace(shipped.problem, objective="time", motion=(Free(Task(tilt=-1.6)),))
    result = Replanner(free).plan_from(shipped, 0.4836, Task(0.1, -1.75, 0.4, 0.005))
    assert result.passed, result.reason
    assert [phase.name for phase in result.phases] == ["free"]
    assert shipped.certificate is not None
    first = next(item for item in shipped.certificate.limits if item.name == "tilt rate")
    assert first.margin == pytest.approx(0.0, abs=1e-6)


def test_where_no_joint_may_turn_by_itself_the_robot_stops_first(
    shipped: Plan, to_anywhere: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the solver finds no motion with joints that reverse, the robot stops first."""
    solve = phase_planner.solve_free

    def without_turns(*given: Any, **named: Any) -> PhaseSolution:
        result = solve(*given, **named)
        return PhaseSolution("not converged", "") if len(result.directions) > 1 else result

    monkeypatch.setattr(phase_planner, "solve_free", without_turns)
    result = Replanner(to_anywhere).plan_from(shipped, 1.0, Task(tilt=np.radians(-85)))
    assert result.passed, result.reason
    assert [phase.name for phase in result.phases] == ["free, stops first"]
    assert 1.6498 < result.duration < 1.1 * 1.6498


def test_a_motor_that_can_neither_hold_its_speed_nor_brake_is_named_at_once(
    shipped: Plan, to_anywhere: Problem
) -> None:
    """A motor too weak to hold its speed or to brake is reported before optimisation.

    Of 400 random accelerations within the limits, none requires less than the torque that the
    reason states.
    """
    time = 1.0
    state = shipped.motion.sample(time)
    robot, rng = to_anywhere.robot, np.random.default_rng(3)
    most = np.array([joint.acceleration for joint in robot.joints])
    qdd = np.clip(rng.uniform(-1.5, 1.5, (400, 4)), -1, 1) * most
    q, qd = np.tile(state.q, (400, 1)), np.tile(state.qd, (400, 1))
    samples = Samples(np.zeros(400), q, qd, qdd, np.zeros((400, 4)))
    torque = motor_motion(
        robot, RigidBody.from_robot(robot), samples, *motion_directions(robot, samples, 1)
    ).torque
    i = int(np.nanargmax(np.abs(torque).min(axis=0)))
    least = float((np.sign(qd[0, i]) * torque[:, i]).min())
    assert least > 0
    for share in (0.9, 1.01):
        motor = dataclasses.replace(
            robot.joints[i].motor, max_torque=share * least, nominal_torque=1e-3
        )
        joints = (
            *robot.joints[:i],
            dataclasses.replace(robot.joints[i], motor=motor),
            *robot.joints[i + 1 :],
        )
        weak = dataclasses.replace(
            to_anywhere, robot=dataclasses.replace(robot, joints=joints), duty=None
        )
        problem = starting_from(weak, shipped, time)
        (phase,), _ = planner.feasible_phases(problem)
        reason = planner.check_braking_torque(phase)
        assert (reason is None) == (share > 1)
        if reason is not None:
            assert reason.required <= least
            assert reason.available == share * least


def test_a_joint_that_stands_but_for_rounding_begins_at_rest(
    shipped: Plan, to_anywhere: Problem
) -> None:
    """A velocity that differs from zero only by rounding counts as rest.

    Otherwise a weak motor would have to brake the joint against its load.
    """
    drift = shipped.motion.coefficients.copy()
    drift[:, :, 2] = 0.0
    drift[:, 1, 2] = 2e-7
    problem = starting_from(
        to_anywhere, dataclasses.replace(shipped.motion, coefficients=drift), 1.0
    )
    (phase,), _ = planner.feasible_phases(problem)
    assert phase.qd_start[2] == 0.0


def reaches(
    duration: float, way: float, begin: tuple[float, float], limits: Array, count: int = 160
) -> bool:
    """Return whether one joint can come to rest after the displacement `way` in this time.

    A linear program with piecewise constant jerk decides it. `begin` is (q̇, q̈) at the start, and
    `limits` (3,) are the largest velocity, acceleration and jerk.
    """
    speed, pull = begin
    velocity, acceleration, jerk = limits
    h = duration / count
    steps = np.arange(1, count + 1)[:, None] - np.arange(count)
    a, v, q = (
        np.where(steps > 0, part, 0.0)
        for part in (h, h**2 * (steps - 1 / 2), h**3 * (steps * (steps - 1) / 2 + 1 / 6))
    )
    t = h * np.arange(1, count + 1)
    start_a, start_v = np.full(count, pull), speed + pull * t
    result = linprog(
        np.zeros(count),
        A_ub=jerk * np.vstack([a / acceleration, -a / acceleration, v / velocity, -v / velocity]),
        b_ub=1
        + np.concatenate(
            [
                -start_a / acceleration,
                start_a / acceleration,
                -start_v / velocity,
                start_v / velocity,
            ]
        ),
        A_eq=jerk * np.vstack([a[-1] / acceleration, v[-1] / velocity, q[-1] / abs(way)]),
        b_eq=[
            -pull / acceleration,
            -start_v[-1] / velocity,
            (way - speed * duration - pull * duration**2 / 2) / abs(way),
        ],
        bounds=(-1, 1),
    )
    return bool(result.status == 0)


def test_under_a_jerk_limit_it_is_as_fast_as_the_slowest_joint() -> None:
    """With three overshooting joints, the plan takes the least time of its slowest joint.

    The accelerations at the start can decay within a hundredth of the motion. A linear program
    gives the least time, with which the plan agrees within 0.5 %.
    """
    base = load_problem(ROOT / "problems/direct_reach.yaml")
    joints = [unchecked_copy(joint, jerk=100 * joint.acceleration) for joint in base.robot.joints]
    robot = unchecked_copy(base.robot, joints=tuple(joints))
    speed, pull = (
        (2.735333, -3.141592, 4.195394, 0.02533739),
        (-11.73423, 0.0, -8.723335, -0.03827418),
    )
    start, to = (0.882121, -0.079921, 0.40618, -0.011803), (0.063436, 0.586358, -0.26295, -0.004234)
    mechanism = Mechanism.from_geometry(robot.geometry)
    rates = task_rates(mechanism, np.array([start]), np.array([speed]))[0]
    problem = dataclasses.replace(
        base,
        robot=robot,
        start=Joints(start),
        start_rate=dict(zip(TASK_COORDINATES, rates.tolist(), strict=True)),
        start_acceleration=pull,
        motion=(Free(Joints(to)),),
        objective="time",
    )
    result = plan(problem)
    assert result.passed
    assert [phase.name for phase in result.phases] == ["free"]
    first = robot.joints[0]
    limits = np.array([first.velocity, first.acceleration, 100 * first.acceleration])
    way, begin = to[0] - start[0], (speed[0], pull[0])
    assert reaches(1.001 * result.duration, way, begin, limits)
    assert not reaches(0.995 * result.duration, way, begin, limits)
