"""Verify plans with motors that would become too hot if the motion repeats.

The planner slows the motion down if this helps. Otherwise, the reason names the motor and a
relaxation.
"""

from __future__ import annotations

import dataclasses
from itertools import groupby
from typing import Any

import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.pipeline import certified
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.planner import PlannerResult, plan_motion
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.serialization import problem_from_plain, to_plain
from ssm_planner.reporting.text import cross_check_lines, summary_lines
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.check import check


def with_nominal(problem: Problem, i: int, torque: float) -> Problem:
    """Return the problem with another nominal torque of the motor of joint i, in N m."""
    return with_motor(problem, i, nominal_torque=torque)


def with_motor(problem: Problem, i: int, **figures: float) -> Problem:
    """Return the problem with other data of the motor of joint i."""
    joints = list(problem.robot.joints)
    joints[i] = dataclasses.replace(
        joints[i], motor=dataclasses.replace(joints[i].motor, **figures)
    )
    return dataclasses.replace(
        problem, robot=dataclasses.replace(problem.robot, joints=tuple(joints))
    )


def rms(problem: Problem, trajectory: Trajectory, joint: str) -> float:
    """Return the RMS torque of the motor of a joint, in N m, from the check."""
    limits = check(trajectory, problem.robot).limits
    return next(
        limit.worst for limit in limits if (limit.name, limit.joint) == ("continuous torque", joint)
    )


@pytest.mark.slow
def test_a_motor_that_friction_heats_too_much_is_named_with_what_it_needs(
    tilt_insert: Problem,
) -> None:
    """The nominal torque is 40 % of the RMS torque of the fastest motion.

    A slower motion does not reduce the load, so it does not help.
    """
    tilt = dataclasses.replace(tilt_insert, motion=tilt_insert.motion[:1])
    fastest = plan(tilt)
    needed = rms(tilt, fastest.trajectory, "roll")
    weak = with_nominal(tilt, 0, 0.4 * needed)
    result = plan(weak)
    assert not result.passed
    reason = result.reason
    assert (reason.constraint, reason.joint, reason.where) == ("continuous torque", "roll", None)
    assert reason.required == pytest.approx(needed, rel=1e-4)
    assert reason.available == 0.4 * needed
    assert "the motor of joint roll would run at an RMS torque of" in reason.message
    assert f"its continuous torque is {1e3 * 0.4 * needed:.6g} mN·m" in reason.message
    first, pause, *_ = reason.relaxation.split("; or ")
    assert first.startswith("continuous torque of joint roll of")
    assert float(first.split("takes ")[1].split(" s")[0]) >= round(fastest.duration, 3)
    assert pause.startswith("a dwell of")
    assert f"relaxation: {reason.relaxation}" in summary_lines(result)
    assert plan(with_nominal(tilt, 0, reason.required * (1 + 1e-6))).passed


def heavy_rotor(problem: Problem, torque: float) -> Problem:
    """Return the insertion alone, with a heavy rotor and almost no friction.

    `torque` in N m is both the largest and the nominal torque of the motor.
    """
    joint = problem.robot.joints[3]
    friction = dataclasses.replace(joint.drive.friction, b_c=0.0, b_oc=0.0, mu_lowest=None)
    drive = dataclasses.replace(
        joint.drive, friction=friction, input_inertia=100 * joint.drive.input_inertia
    )
    joints = (*problem.robot.joints[:3], dataclasses.replace(joint, drive=drive))
    robot = dataclasses.replace(problem.robot, joints=joints)
    problem = dataclasses.replace(problem, motion=problem.motion[1:], robot=robot)
    return with_motor(problem, 3, max_torque=torque, nominal_torque=torque)


@pytest.mark.parametrize("torque", [2.19e-3, 6.72e-3])
@pytest.mark.parametrize("share", [0.95, 0.8, 0.5])
def test_a_motor_that_acceleration_heats_goes_slower(
    tilt_insert: Problem, torque: float, share: float
) -> None:
    """In T times the duration, the motion needs at most 1/T² of the RMS torque.

    Therefore T ≤ share^(-1/2) suffices.
    """
    problem = heavy_rotor(tilt_insert, torque)
    fastest = plan(problem)
    assert fastest.passed
    limit = share * rms(problem, fastest.trajectory, "insertion")
    result = plan(with_nominal(problem, 3, limit))
    assert result.passed
    assert 0.995 * limit < rms(problem, result.trajectory, "insertion") <= limit * (1 + 1e-6)
    assert 1.0 < result.duration / fastest.duration < share**-0.5 * 1.02


def test_a_motor_cools_in_a_phase_in_which_it_stands(tilt_insert: Problem) -> None:
    """Roll moves in the tilt phase alone. The insertion lasts until the roll motor is cool."""
    problem = with_motor(tilt_insert, 0, nominal_torque=18e-3, max_torque=40e-3)
    result = plan(problem)
    assert result.passed
    heat = rms(problem, result.trajectory, "roll") ** 2 * result.duration
    assert result.duration == pytest.approx(heat / 18e-3**2, rel=2e-3)
    assert all(phase.lower_bound < phase.duration for phase in result.phases)
    # toppra does not know this limit, so the report explains why its duration is shorter.
    remark = "toppra does not know the limit on continuous torque"
    assert remark in "\n".join(cross_check_lines(result.cross_checked()))
    assert remark not in "\n".join(cross_check_lines(plan(tilt_insert).cross_checked()))
    # A motion to the present position takes no time, so no time for cooling is added to it.
    again = plan(dataclasses.replace(problem, motion=(*problem.motion, problem.motion[1])))
    assert again.passed
    assert [phase.duration for phase in again.phases] == [
        *(phase.duration for phase in result.phases),
        0.0,
    ]


@pytest.mark.slow
def test_ipopt_confirms_no_motion_that_is_too_warm(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search for a cool motion uses the structured solver alone.

    Ipopt confirms only the first motion and the result.
    """
    planners: list[str] = []

    def planned(problem: Problem, *arguments: Any, **named: Any) -> PlannerResult:
        planners.append(problem.planner)
        return plan_motion(problem, *arguments, **named)

    monkeypatch.setattr(certified, "plan_motion", planned)
    tilt = dataclasses.replace(tilt_insert, motion=tilt_insert.motion[:1], objective="time")
    assert plan(
        with_motor(tilt, 0, nominal_torque=18e-3, max_torque=40e-3), relaxations=False
    ).passed
    assert [planner for planner, _ in groupby(planners)] == ["optimal", "fast", "optimal"]


@pytest.mark.parametrize("planner", ["fast", "optimal"])
@pytest.mark.slow
def test_a_motor_that_slow_motion_alone_hardly_heats_slows_down_beyond_its_least_heat(
    tilt_insert: Problem, planner: Any
) -> None:
    """A slow motion needs nearly the RMS torque of friction and load alone.

    This is less than the RMS torque of the motion with the least heat.
    """
    tilt = dataclasses.replace(
        tilt_insert, motion=tilt_insert.motion[:1], objective="time", planner=planner
    )
    slow = plan(dataclasses.replace(tilt, duty=None, objective="effort", duration=20.0))
    least = rms(dataclasses.replace(tilt, duty=0.0), slow.trajectory, "roll")
    limit = 1.02 * least
    result = plan(with_nominal(tilt, 0, limit), relaxations=False)
    assert result.passed
    assert 0.99 * limit < rms(tilt, result.trajectory, "roll") <= limit * (1 + 1e-6)


@pytest.mark.parametrize("planner", ["fast", "optimal"])
def test_where_the_hot_motor_rests_the_whole_takes_as_long_as_its_heat(
    tilt_insert: Problem, planner: Any
) -> None:
    """If two motors would become too hot, the hotter one reaches exactly its nominal torque."""
    problem = dataclasses.replace(
        with_motor(tilt_insert, 0, nominal_torque=18e-3, max_torque=40e-3), planner=planner
    )
    problem = with_motor(problem, 1, nominal_torque=6e-3)
    result = plan(problem, relaxations=False)
    assert result.passed
    heats = [
        (rms(problem, result.trajectory, name) / torque) ** 2
        for name, torque in (("roll", 18e-3), ("tilt", 6e-3))
    ]
    assert max(heats) == pytest.approx(1.0, abs=2e-3)


def test_a_pause_before_the_motion_repeats_cools(tilt_insert: Problem) -> None:
    """A pause after each repetition reduces the RMS torque, so the fastest motion passes."""
    tilt = dataclasses.replace(tilt_insert, motion=tilt_insert.motion[:1])
    fastest = plan(tilt)
    rms_alone = rms(tilt, fastest.trajectory, "roll")
    weak = with_nominal(tilt, 0, rms_alone / 2)
    assert not plan(weak, relaxations=False).passed
    pause = 3 * fastest.duration
    result = plan(dataclasses.replace(weak, duty=pause * (1 + 1e-5)))
    assert result.passed
    assert result.duration == pytest.approx(fastest.duration, rel=1e-3)
    outcome = next(
        item
        for item in result.certificate.limits
        if (item.name, item.joint) == ("continuous torque", "roll")
    )
    assert outcome.worst == pytest.approx(rms_alone / 2, rel=1e-3)
    once = plan(dataclasses.replace(weak, duty=None))
    assert once.passed
    assert not any(item.name == "continuous torque" for item in once.certificate.limits)
    assert any(
        "continuous torque" in item and "once" in item for item in once.certificate.unchecked
    )
    # A plan whose duty was changed has no valid certificate.
    assert not dataclasses.replace(result, problem=weak).passed


def test_a_file_states_the_duty(tilt_insert: Problem) -> None:
    start = "start: {{roll: 0 deg, tilt: -85 deg, spin: 0 deg, depth: 0 mm}}"
    text = "\n".join(["duty: {}", "robot: vitreoretinal", start, "motion: [tilt: {{to: -90 deg}}]"])
    assert Problem.from_yaml(text.format("2.5 s")).duty == 2.5
    assert Problem.from_yaml(text.format("once")).duty is None
    assert tilt_insert.duty == 0.0
    with pytest.raises(ProblemError, match="duty"):
        Problem.from_yaml(text.format("-1 s"))
    for problem in (Problem.from_yaml(text.format("once")), Problem.from_yaml(text.format("3 s"))):
        assert problem_from_plain(to_plain(problem)).duty == problem.duty
