"""Verify the relaxations that a failed plan or a failed check suggests.

A plan with the printed value passes, and a plan with a clearly smaller change fails.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.certified import violation_reason
from ssm_planner.pipeline.relaxation import (
    OFFERED_SHARES,
    changes_of_limits,
    find_relaxation,
    relaxation_for,
)
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.limits import (
    LensClearance,
    Limit,
    MotorTorque,
    RetinaClearance,
    SelfLocking,
)
from ssm_planner.problem.motion import Dwell
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.units import display_unit
from ssm_planner.verification.certificate import Certificate, LimitCheck
from tests.support.paths import PROBLEMS
from tests.support.random_problems import random_problem

PROBLEM = load_problem(PROBLEMS / "eye_approach.yaml")

MOVABLE = [
    limit for limit in PROBLEM.all_limits if np.isfinite(limit.low) or np.isfinite(limit.high)
]


def certificate(limit: Limit, worst: float, bound: float) -> Certificate:
    """Return a certificate in which one limit is exceeded."""
    result = LimitCheck(
        name=limit.name,
        joint=limit.joint,
        worst=worst,
        limit=bound,
        margin=-0.1,
        time=0.5,
        unit=limit.unit,
    )
    return Certificate((result,), "quintic polynomial pieces", 1000)


@pytest.mark.parametrize("limit", MOVABLE, ids=lambda limit: f"{limit.key}")
def test_an_exceeded_limit_is_moved_so_that_what_was_found_is_allowed(limit: Limit) -> None:
    bound = limit.low if limit.is_floor else limit.high
    worst = bound + (-0.1 if limit.is_floor else 0.1) * (abs(bound) or 1.0)
    reason = violation_reason(PROBLEM, certificate(limit, worst, bound))
    result = relaxation_for(PROBLEM, reason)
    if result is None:
        return
    moved = limit.relaxed(result.needed)
    assert moved is not None
    assert moved.contains(worst)
    assert not limit.contains(worst)


def test_a_clearance_that_was_not_kept_is_lowered_to_what_was_kept() -> None:
    clearance = next(limit for limit in PROBLEM.all_limits if isinstance(limit, RetinaClearance))
    smallest = 0.9 * clearance.clearance
    result = relaxation_for(
        PROBLEM, violation_reason(PROBLEM, certificate(clearance, smallest, clearance.clearance))
    )
    assert result is not None
    assert (result.needed, result.present) == (smallest, clearance.clearance)


@pytest.mark.parametrize("limit", MOVABLE, ids=lambda limit: f"{limit.key}")
@pytest.mark.parametrize("beyond", [0.12345678, 1.2345612, 12.3456789])
def test_a_value_is_tried_as_it_is_printed(limit: Limit, beyond: float) -> None:
    """A value is rounded to the printed digits so that it never allows less than was asked for."""
    bound = limit.low if limit.is_floor else limit.high
    required = bound + (-1e-3 if limit.is_floor else 1) * beyond * (abs(bound) or 1.0)
    value = limit.rounded(required)
    assert limit.described(value) == limit.described(limit.rounded(value))
    assert value <= required * (1 + 1e-12) if limit.is_floor else value >= required * (1 - 1e-12)
    assert value == pytest.approx(required, rel=1e-4)
    printed = limit.described(value).split(" instead")[0]
    number = float(next(word for word in reversed(printed.split()) if word[-1].isdecimal()))
    if not isinstance(limit, (LensClearance, SelfLocking)):
        assert number == pytest.approx(display_unit(limit.unit)[1] * value, rel=1e-14)


def typed_in(text: str) -> float:
    """Return the value in the text of a relaxation, as a reader would type it."""
    words = text.split(" instead")[0].split()
    return float(words[-2])


def test_the_range_that_is_printed_plans_when_it_is_typed_in(tilt_insert: Problem) -> None:
    """Both ends of the range of joint roll must move, and either one alone does not suffice."""
    joints = tilt_insert.robot.joints
    narrow = replace(joints[0], position=(-np.radians(45), np.radians(45)))
    problem = replace(
        tilt_insert,
        robot=replace(tilt_insert.robot, joints=(narrow, *joints[1:])),
        objective="time",
    )
    reason = plan(problem).reason
    assert reason is not None
    assert reason.relaxation is not None
    lower, upper = (np.radians(typed_in(part)) for part in reason.relaxation.split(" and "))
    wide = replace(joints[0], position=(lower, upper))
    assert plan(replace(problem, robot=replace(problem.robot, joints=(wide, *joints[1:])))).passed
    assert lower == pytest.approx(np.radians(-56.19), abs=1e-5)


@pytest.mark.slow
def test_a_motor_too_weak_for_now_and_for_all_time_is_relaxed_in_both(tilt_insert: Problem) -> None:
    """A motor with too little peak and continuous torque gets one relaxation of both values."""
    joints = tilt_insert.robot.joints
    assert joints[0].motor is not None
    motor = replace(joints[0].motor, nominal_torque=10e-3, max_torque=12e-3)
    robot = replace(tilt_insert.robot, joints=(replace(joints[0], motor=motor), *joints[1:]))
    # Joint roll moves all the time and cannot cool at rest.
    tilt = replace(tilt_insert, motion=tilt_insert.motion[:1], planner="fast")
    reason = plan(replace(tilt, robot=robot)).reason
    assert reason is not None
    assert reason.relaxation is not None
    largest, nominal = (1e-3 * typed_in(part) for part in reason.relaxation.split(" and "))
    assert "tried together, takes" in reason.relaxation
    motor = replace(motor, nominal_torque=nominal, max_torque=largest)
    assert plan(
        replace(tilt, robot=replace(robot, joints=(replace(joints[0], motor=motor), *joints[1:])))
    ).passed


def test_a_start_too_fast_is_slowed_down(tilt_insert: Problem) -> None:
    """The relaxation states a slower start rate, and the plan with this rate passes."""
    problem = replace(
        tilt_insert,
        motion=tilt_insert.motion[:1],
        start_rate={"tilt": -np.radians(80)},
        objective="time",
    )
    reason = plan(problem).reason
    assert reason is not None
    assert reason.constraint == "velocity"
    assert reason.relaxation is not None
    result = re.search(
        r"start_rate of \{tilt: (\S+) deg/s\} instead of \{tilt: -80 deg/s\}: tried",
        reason.relaxation,
    )
    assert result is not None
    assert plan(replace(problem, start_rate={"tilt": np.radians(float(result[1]))})).passed


@pytest.mark.slow
def test_a_motor_that_gets_too_warm_may_pause(tilt_insert: Problem) -> None:
    """A plan with the suggested dwell passes, and a plan with 90 % of it fails."""
    joints = tilt_insert.robot.joints
    assert joints[0].motor is not None
    motor = replace(joints[0].motor, nominal_torque=10e-3, max_torque=40e-3)
    robot = replace(tilt_insert.robot, joints=(replace(joints[0], motor=motor), *joints[1:]))
    problem = replace(
        tilt_insert,
        robot=robot,
        objective="time",
        motion=tilt_insert.motion[:1],
        planner="fast",
    )
    reason = plan(problem).reason
    assert reason is not None
    assert reason.relaxation is not None
    result = re.search(r"or a dwell of (\S+) s at the end: tried, takes", reason.relaxation)
    assert result is not None
    assert plan(replace(problem, motion=(*problem.motion, Dwell(float(result[1]), "dwell")))).passed
    shorter = replace(problem, motion=(*problem.motion, Dwell(0.9 * float(result[1]), "dwell")))
    assert not plan(shorter, relaxations=False).passed


@pytest.mark.parametrize("needed", [0.02, 0.3, 0.85, 0.95, 1.0, 1.02, 1.2, 1.9])
def test_ten_percent_less_of_a_relaxation_does_not_do(tilt_insert: Problem, needed: float) -> None:
    """The case states the needed fraction of the relaxation that the reason asks for."""
    joint = tilt_insert.robot.joints[0]
    limit = next(item for item in joint.limits if isinstance(item, MotorTorque))
    present, required = limit.largest, 1.5 * limit.largest

    def attempt(problem: Problem) -> float | Reason:
        motor = problem.robot.joints[0].motor
        assert motor is not None
        share = (motor.max_torque - present) / (required - present)
        return 1.0 if share >= needed else Reason(None, None, None, None, "no motion")

    cure = find_relaxation(
        replace(tilt_insert, objective="time"),
        Reason(limit, None, required, present, "too weak"),
        attempt,
    )
    assert cure is not None
    assert cure.works
    less = cure.relaxation.problem(present + 0.9 * (cure.value - present))
    assert isinstance(attempt(less), Reason)


@pytest.mark.parametrize("needed", [0.3, 1.2])
@pytest.mark.parametrize("more", [0.0, 0.5])
def test_the_printed_relaxation_is_planned_in_full(
    tilt_insert: Problem, needed: float, more: float
) -> None:
    """Only the printed value is planned in full if the feasibility trials are right.

    Otherwise, every tried value is planned. `needed` is the fraction of the relaxation that a trial
    requires. A full plan requires the fraction `needed + more`.
    """
    joint = tilt_insert.robot.joints[0]
    limit = next(item for item in joint.limits if isinstance(item, MotorTorque))
    present, required = limit.largest, 1.5 * limit.largest
    planned: list[float] = []

    def motion(problem: Problem, least: float) -> float | Reason:
        motor = problem.robot.joints[0].motor
        assert motor is not None
        planned.append((motor.max_torque - present) / (required - present))
        return 1.0 if planned[-1] >= least else Reason(None, None, None, None, "no motion")

    def looked(problem: Problem) -> float | Reason:
        result = motion(problem, needed)
        planned.pop()
        return result

    cure = find_relaxation(
        tilt_insert,
        Reason(limit, None, required, present, "too weak"),
        lambda problem: motion(problem, needed + more),
        feasible=looked,
    )
    assert cure is not None
    assert cure.works
    share = (cure.value - present) / (required - present)
    assert needed + more <= share <= (needed + more) / 0.9 * 1.01
    assert (planned == [pytest.approx(share)]) == (more == 0.0)


def test_a_motion_that_is_too_short_is_longer_than_the_whole_was(tilt_insert: Problem) -> None:
    """The relaxation changes both the duration of the motion and the total duration."""
    tilt, insert = tilt_insert.motion
    problem = replace(
        tilt_insert, motion=(replace(tilt, duration=0.2), insert), duration=1.0, objective="effort"
    )
    reason = plan(problem).reason
    assert reason is not None
    assert reason.relaxation is not None
    assert reason.relaxation.endswith(" s")
    own, complete = (
        typed_in(part)
        for part in reason.relaxation.split(": tried together, takes")[0].split(" and ")
    )
    longer = replace(problem, motion=(replace(tilt, duration=own), insert), duration=complete)
    assert plan(longer).passed
    less = 0.2 + 0.9 * (own - 0.2)
    assert not plan(
        replace(longer, motion=(replace(tilt, duration=less), insert)), relaxations=False
    ).passed


@pytest.mark.slow
def test_other_joints_are_tried_with_less_too(tilt_insert: Problem) -> None:
    """Another joint configuration at the target needs 92 % of the torque of the nearest one."""
    problem = random_problem(tilt_insert, 61129, most=1)
    reason = plan(problem).reason
    assert reason is not None
    assert reason.relaxation is not None
    joints = problem.robot.joints
    joint = next(item for item in joints if item.name == reason.joint)
    assert joint.motor is not None
    present, enough = joint.motor.max_torque, 1e-3 * typed_in(reason.relaxation)

    def passes(torque: float) -> bool:
        motor = unchecked_copy(joint.motor, max_torque=torque)
        changed = tuple(
            unchecked_copy(item, motor=motor) if item is joint else item for item in joints
        )
        robot = unchecked_copy(problem.robot, joints=changed)
        return plan(unchecked_copy(problem, robot=robot), relaxations=False).passed

    assert passes(enough)
    assert not passes(present + 0.9 * (enough - present))


@pytest.mark.parametrize("limit", MOVABLE, ids=lambda limit: f"{limit.name} {limit.joint}")
def test_a_share_of_a_change_moves_the_limit_by_this_share(limit: Limit) -> None:
    """The bound moves by the given fraction of the change, rounded to the printed digits."""
    end = limit.high if np.isfinite(limit.high) else limit.low
    outside = end + 0.01 * (abs(end) or 1.0) * (1 if end == limit.high else -1)
    moved = limit.relaxed(outside)
    try:
        relaxed = PROBLEM if moved is None else moved.on(PROBLEM)
    except ProblemError:
        return  # No problem accepts another limit of this kind.
    changes = changes_of_limits(PROBLEM, relaxed)
    assert set(changes) <= set(OFFERED_SHARES)
    for share, (words, changed) in changes.items():
        present = next(item for item in changed.all_limits if item.key == limit.key)
        bounds = [present.low, present.high]
        assert any(np.isclose(bounds, end + share * (outside - end), rtol=1e-5, atol=0.0))
        assert " instead of " in words


def test_an_unchanged_problem_has_no_changes() -> None:
    assert changes_of_limits(PROBLEM, PROBLEM) == {}


@pytest.mark.parametrize("preload", [0.0, 0.2, 0.6])
def test_lost_contact_of_the_nuts_names_the_preload_that_plans(preload: float) -> None:
    """The contact force grows by the same amount as the preload.

    Therefore the needed preload is the present one plus the missing force.
    """
    problem = load_problem("tilt_insert")
    *others, insertion = problem.robot.joints
    drive = unchecked_copy(insertion.drive, kind="antibacklash_screw", preload=preload)
    joints = (*others, unchecked_copy(insertion, drive=drive))
    loose = unchecked_copy(
        problem, robot=unchecked_copy(problem.robot, joints=joints), planner="fast"
    )
    reason = plan(loose).reason
    assert reason is not None
    assert reason.constraint == "nut contact"
    result = re.match(
        r"preload of joint insertion of ([\d.]+) N instead of", str(reason.relaxation)
    )
    assert result, reason.relaxation
    needed = float(result[1])
    assert needed == pytest.approx(preload - reason.available, rel=1e-3)
    for value, passes in ((needed, True), (0.99 * needed, False)):
        stiffer = unchecked_copy(insertion, drive=unchecked_copy(drive, preload=value))
        robot = unchecked_copy(problem.robot, joints=(*others, stiffer))
        assert plan(unchecked_copy(loose, robot=robot), relaxations=False).passed == passes
