"""Second opinions on random plans.

Toppra and the lower bound must not contradict a correct plan, and their durations must be close to
it. A planner that underestimates friction must be noticed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner import Plan, Problem, Robot, load_plan, load_problem, plan
from ssm_planner.plans import LIMITS_IGNORED_BY_TOPPRA, TOO_FAST_DIFFERENCE
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.verification.second_opinion import second_opinions
from tests.support.paths import ROOT
from tests.support.random_problems import random_problem

from .rows import Count, Row

GAP = 5e-4
"""Largest relative excess of an optimal duration on a given path over toppra's and the bound."""
ROUNDING = 1e-6
ERROR = 0.01
"""Fraction of the friction that a faulty planner ignores."""
STRENGTHS = (0.82, 0.99)
"""Torque of the motor relative to the need of the motion, so that torque limits the motion."""


def run(count: int, seed: int) -> list[Row]:
    """Judge 3/4 × count plans of random problems, and count / 4 plans with an error of friction."""
    agreement = Count("random plans: no figure is below a bound, no plan is called too fast")
    gaps = Count("optimal motions on given paths: within 0.05 % of toppra and of the bound")
    errors = Count("1 % of friction that the planner does not see is noticed")
    base = load_problem("tilt_insert")
    number = 0
    while agreement.cases < 3 * count // 4:
        number += 1
        problem = unchecked_copy(random_problem(base, 1000 * seed + number), planner="fast")
        output = plan(problem, relaxations=False)
        if output.passed and problem.duration is None and not problem.robot.jerk_limited:
            result = judged(output)
            agreement.add(disagreement(result))
            if is_optimal(result):
                gaps.add(gap(result))
    rng = np.random.default_rng(seed)
    while errors.cases < max(count // 4, 1):
        joint, strength = str(rng.choice(("roll", "tilt"))), float(rng.uniform(*STRENGTHS))
        errors.add(unnoticed(weakened(strength, joint)))
    return [agreement.row, gaps.row, errors.row]


def judged(made: Plan, robot: Robot | None = None) -> Plan:
    """Return the plan as toppra judges it, with the limits of the robot or of another one."""
    problem = unchecked_copy(made.problem, planner="optimal", robot=robot or made.robot)
    software = {name: text for name, text in made.software.items() if name != "toppra"}
    changed = replace(
        made, problem=unchecked_copy(made.problem, planner="optimal"), software=software
    )
    opinions = second_opinions(made.motion, problem)
    return changed.cross_checked(lambda: (opinions, ()))


def disagreement(result: Plan) -> str | None:
    """Return a false statement about a certified plan, or None."""
    if not result.passed:
        return f"{result.problem.name}: {result.reason and result.reason.message}"
    for phase in result.phases:
        if "lower bound" in (phase.not_judged or ""):
            return f"{result.problem.name}, {phase.name}: {phase.not_judged}"
        if (phase.path_bound or 0.0) > (1 + ROUNDING) * phase.duration:
            return f"{result.problem.name}, {phase.name}: bound {phase.path_bound}"
    return None


def is_optimal(result: Plan) -> bool:
    """Return True if the plan has the shortest duration that toppra's limits allow."""
    limits = result.certificate.limits if result.certificate else ()
    slowed = any(limit.name in LIMITS_IGNORED_BY_TOPPRA and limit.margin < 0.01 for limit in limits)
    timed = any(getattr(entry, "constant_speed", None) for entry in result.problem.motion)
    return result.problem.objective == "time" and not (slowed or timed)


def gap(result: Plan) -> str | None:
    """Return the first phase on a given path that toppra or the bound does not confirm, or None."""
    for phase in result.phases:
        if phase.branch is None or not phase.solver or "requested" in (phase.not_judged or ""):
            continue
        duration, bound = phase.toppra_duration, phase.path_bound
        if not (duration and bound and -TOO_FAST_DIFFERENCE <= phase.difference <= GAP):
            return f"{result.problem.name}, {phase.name}: toppra {duration}, bound {bound}"
        if phase.duration > (1 + GAP) * bound:
            return f"{result.problem.name}, {phase.name}: {phase.duration}, bound {bound}"
    return None


def unnoticed(problem: Problem) -> str | None:
    """Return a description if a planner with a friction error is not contradicted, or None."""
    smooth = replace(problem, robot=with_friction(problem.robot, 1 - ERROR))
    output = plan(smooth, relaxations=False)
    if not output.passed:
        return f"no plan: {output.reason}"
    result = judged(output, problem.robot)
    if result.passed or "the cross-check failed" not in str(
        result.reason and result.reason.message
    ):
        torques = [joint.motor and joint.motor.max_torque for joint in problem.robot.joints]
        return f"not noticed with the motor torques {torques}"
    return None


def weakened(strength: float, joint: str = "tilt") -> Problem:
    """Return the shipped problem with a motor whose largest torque is a fraction of the need."""
    result = load_plan(ROOT / "results/tilt_insert")
    needs = {requirement.joint: requirement.peak_torque for requirement in result.requirements}
    joints = tuple(
        replace(item, motor=unchecked_copy(item.motor, max_torque=strength * needs[joint]))
        if item.name == joint
        else item
        for item in result.robot.joints
    )
    robot = replace(result.robot, joints=joints)
    return replace(result.problem, robot=robot, planner="fast", objective="time")


def with_friction(robot: Robot, factor: float) -> Robot:
    """Return the robot with all friction coefficients multiplied by a factor."""
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
