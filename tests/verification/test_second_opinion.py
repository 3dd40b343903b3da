"""The package toppra times the paths of plans, without code of the planner or of the check.

A plan that is faster than TOPP-RA breaks a limit. A plan that is slower is not optimal.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from ssm_planner import Plan, Problem, load_plan, load_problem, plan
from ssm_planner.problem import Dwell, Robot
from ssm_planner.problem.value import unchecked
from tests.support import second_opinion
from tests.support.paths import ROOT
from tests.support.random_problems import random_problem
from tests.support.second_opinion import path_duration

FASTER = 5e-4
"""Largest share by which a plan may be faster. Halving TOPP-RA's grid changes less than 5e-5."""
SLOWER = 5e-4
BY_HEAT = 1.5e-3
"""Largest shares by which a plan is slower. The objective "time then heat" gives 1e-3 away."""
UNKNOWN = ("continuous torque", "nut contact", "self-locking")
"""Limits that slow a motion down and that TOPP-RA does not know."""


def ratios(made: Plan, robot: Robot | None = None) -> Iterator[tuple[str, float]]:
    """Yield the ratio of the plan's duration to TOPP-RA's, for each phase that it can judge."""
    for span, motion in zip(made.motion.phases, made.problem.motion, strict=True):
        if isinstance(motion, Dwell) or motion.duration is not None or span.end - span.start < 1e-9:
            continue
        duration = path_duration(
            made.motion, robot or made.robot, made.limits, span.start, span.end
        )
        if duration is not None:
            yield span.name, (span.end - span.start) / duration


def tolerance(problem: Problem) -> float:
    return SLOWER if problem.objective == "time" else BY_HEAT


@pytest.mark.parametrize("name", ["tilt_insert", "eye_approach"])
def test_shipped_plans_are_as_fast_as_toppra_on_their_paths(name: str) -> None:
    made = load_plan(ROOT / "results" / name)
    judged = dict(ratios(made))
    assert len(judged) == len(made.problem.motion)
    for ratio in judged.values():
        assert 1 - 1e-4 <= ratio <= 1 + tolerance(made.problem)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 60, 20))
def test_random_plans_are_never_faster_and_rarely_slower(first: int) -> None:
    base = load_problem("tilt_insert")
    judged = phases = 0
    for seed in range(first, first + 20):
        problem = replace(random_problem(base, seed), planner="fast")
        if problem.duration is not None or problem.robot.jerk_limited:
            continue
        made = plan(problem, relaxations=False)
        if not made.passed:
            continue
        assert made.certificate is not None
        phases += len(problem.motion)
        slowed = any(
            limit.margin < 1e-2 for limit in made.certificate.limits if limit.name in UNKNOWN
        )
        for name, ratio in ratios(made):
            judged += 1
            assert ratio >= 1 - FASTER, (seed, name)
            # Near the poles of the task coordinates, limits on rates are not resolved as finely.
            assert slowed or problem.task_limits.rates or ratio <= 1 + tolerance(problem), (
                seed,
                name,
            )
    assert judged >= 10
    assert judged >= 0.6 * phases


@pytest.mark.parametrize("strength", [0.86, 0.9, 0.94, 0.98])
def test_friction_that_the_planner_underestimates_is_noticed(strength: float) -> None:
    """The planner sees 1 % less friction than the robot has, and torque limits the motion."""
    problem = load_problem("tilt_insert")
    joints = []
    for joint in problem.robot.joints:
        motor = joint.motor
        if joint.name == "tilt" and motor is not None:
            motor = unchecked(motor, max_torque=strength * largest_torque())
        joints.append(replace(joint, motor=motor))
    robot = replace(problem.robot, joints=tuple(joints))
    honest = plan(
        replace(problem, robot=robot, planner="fast", objective="time"), relaxations=False
    )
    assert honest.passed
    smooth = plan(
        replace(problem, robot=with_friction(robot, 0.99), planner="fast", objective="time"),
        relaxations=False,
    )
    assert dict(ratios(honest))["tilt"] == pytest.approx(1, abs=FASTER)
    wrong = dict(ratios(smooth, robot)).get("tilt")
    assert wrong is None or wrong < 1 - FASTER


def largest_torque() -> float:
    """Return the largest motor torque of joint 2 in the shipped motion, N·m."""
    made = load_plan(ROOT / "results/tilt_insert")
    return next(
        requirement.peak_torque for requirement in made.requirements if requirement.joint == "tilt"
    )


def with_friction(robot: Robot, factor: float) -> Robot:
    """Return the robot with all friction coefficients times a factor."""
    joints = []
    for joint in robot.joints:
        drive = joint.drive
        if drive is not None and drive.friction is not None:
            friction = drive.friction
            drive = replace(
                drive,
                friction=replace(
                    friction, mu=factor * friction.mu, mu_static=factor * friction.mu_static
                ),
            )
        joints.append(replace(joint, drive=drive))
    return replace(robot, joints=tuple(joints))


def test_the_opinion_shares_no_code_with_the_planner_or_the_check() -> None:
    tree = ast.parse(Path(second_opinion.__file__).read_text(encoding="utf-8"))
    modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not [name for name in modules if "planning" in name or "verification" in name]
