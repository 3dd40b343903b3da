"""The bound along a path never exceeds the duration of a valid motion, and is close to it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from ssm_planner import load_plan, load_problem, plan
from ssm_planner.problem import Robot
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.trajectory import Trajectory, join_sections, rest_coefficients
from ssm_planner.verification import path_rows
from ssm_planner.verification.path_bound import _integrand, _minimise_integrand, path_bound
from ssm_planner.verification.second_opinion import Opinion, shortest_path_duration
from tests.campaign.opinions import weakened, with_friction
from tests.support.paths import ROOT
from tests.support.random_problems import random_problem
from tests.verification.test_second_opinion import bang_bang

GAP = 5e-4
"""Largest relative gap between an optimal duration and the bound."""
ROUNDING = 1e-6


@pytest.mark.parametrize("name", ["tilt_insert", "eye_approach"])
def test_shipped_plans_are_within_half_a_per_mille_of_their_bound(name: str) -> None:
    result = load_plan(ROOT / "results" / name)
    for span in result.motion.phases:
        bound = shortest_path_duration(
            result.motion, result.robot, result.limits, (span.start, span.end)
        ).bound
        assert bound is not None
        duration = span.end - span.start
        assert bound <= (1 + ROUNDING) * duration
        assert duration <= (1 + GAP) * bound


@pytest.mark.parametrize("distance", [0.05, 0.1, 0.9])
@pytest.mark.parametrize("joint", [0, 2])
def test_the_bound_of_a_single_joint_is_its_bang_bang_time(joint: int, distance: float) -> None:
    problem = load_problem("tilt_insert")
    motion, expected = bang_bang(problem.robot, joint, distance)
    bound = shortest_path_duration(motion, problem.robot, problem.task_limits, (0.0, 1.5)).bound
    assert bound is not None
    assert (1 - GAP) * expected <= bound <= (1 + ROUNDING) * expected


def test_the_bound_is_valid_for_any_guess_of_the_timing() -> None:
    """The timing only guides the search for multipliers. A bad timing gives a smaller bound."""
    result = load_plan(ROOT / "results/tilt_insert")
    span = result.motion.phases[0].start, result.motion.phases[0].end
    path = path_rows.PathRows.from_trajectory(result.motion, result.robot, span)
    rng = np.random.default_rng(0)
    bounds = []
    for size in (0.02, 0.2, 0.9):
        squares = 1 - size * rng.uniform(0, 1, len(path.lengths) + 1)
        bounds.append(path_bound(path, result.limits, squares)[0])
    known = [bound for bound in bounds if bound is not None]
    assert known
    assert max(known) <= (1 + ROUNDING) * (span[1] - span[0])


@pytest.mark.parametrize("speed", [0.85, 0.3])
def test_a_slow_motion_has_the_bound_of_its_path(speed: float) -> None:
    result = load_plan(ROOT / "results/tilt_insert")
    bounds = [
        shortest_path_duration(
            motion, result.robot, result.limits, (0.0, motion.phases[0].end)
        ).bound
        for motion in (result.motion, result.motion.slower(speed))
    ]
    assert bounds[0] == pytest.approx(bounds[1], rel=GAP)


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_the_bound_scales_with_the_acceleration_limits(factor: float) -> None:
    """If only acceleration limits bind, durations are proportional to 1/√acceleration."""
    problem = load_problem("tilt_insert")
    motion, _ = bang_bang(problem.robot, 2, 0.1)
    bounds = [
        shortest_path_duration(motion, robot, problem.task_limits, (0.0, 1.5)).bound
        for robot in (problem.robot, with_acceleration(problem.robot, factor))
    ]
    assert bounds[1] == pytest.approx(bounds[0] / np.sqrt(factor), rel=GAP)


def with_acceleration(robot: Robot, factor: float) -> Robot:
    """Return the robot with other acceleration limits."""
    joints = (unchecked_copy(j, acceleration=factor * j.acceleration) for j in robot.joints)
    return unchecked_copy(robot, joints=tuple(joints))


def test_a_motion_faster_than_its_bound_breaks_a_torque_limit() -> None:
    """A motion that is faster than the bound violates a limit, whatever toppra finds."""
    problem = weakened(0.9)
    smooth = replace(problem, robot=with_friction(problem.robot, 0.97))
    wrong = plan(smooth, relaxations=False).motion
    span = 0.0, wrong.phases[0].end
    bounds = [
        shortest_path_duration(wrong, robot, problem.task_limits, span).bound
        for robot in (problem.robot, smooth.robot)
    ]
    assert bounds[0] > 1.005 * span[1]  # type: ignore[operator]
    assert bounds[1] <= (1 + ROUNDING) * span[1]  # type: ignore[operator]


def test_the_integral_does_not_depend_on_the_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    result = load_plan(ROOT / "results/tilt_insert")
    span = result.motion.phases[0].start, result.motion.phases[0].end
    bounds = []
    for intervals in (200, 700):
        monkeypatch.setattr(path_rows, "PATH_INTERVALS", intervals)
        path = path_rows.PathRows.from_trajectory(result.motion, result.robot, span)
        bounds.append(path_bound(path, result.limits)[0])
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-5)


def test_the_smallest_value_is_exact() -> None:
    """The stationary points of 1/y + p y² + κ y are the roots of a cubic."""
    rng = np.random.default_rng(1)
    p, kappa, fastest = rng.uniform(-1, 3, 300), rng.uniform(-1, 3, 300), rng.uniform(0.2, 5, 300)
    smallest = _integrand(_minimise_integrand(p, kappa, fastest), p, kappa)
    for values in zip(p, kappa, fastest, smallest, strict=True):
        weight, slope, end, least = values
        roots = Polynomial([-1.0, 0.0, slope, 2 * weight]).roots()
        real = roots[np.abs(roots.imag) < 1e-9].real
        y = np.append(real[(real > 0) & (real < end)], end)
        assert least == pytest.approx((1 / y + weight * y**2 + slope * y).min(), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [50, 91, 129])
def test_random_motions_where_the_limits_alternate(seed: int) -> None:
    """The motions touch a speed limit briefly, stay at a torque limit, or begin to brake early."""
    problem: Any = random_problem(load_problem("tilt_insert"), 94000 + seed)
    result = plan(unchecked_copy(problem, planner="fast"), relaxations=False)
    assert result.trajectory is not None
    phase = next(p for p in result.phases if p.name in ("straight", "free"))
    span = result.trajectory.phases[result.phases.index(phase)]
    opinion = shortest_path_duration(
        result.trajectory, problem.robot, problem.task_limits, (span.start, span.end)
    )
    assert opinion.bound is not None
    assert opinion.bound <= (1 + ROUNDING) * phase.duration
    assert opinion.duration is not None
    assert opinion.duration <= (1 + GAP) * opinion.bound


def test_a_rest_keeps_its_duration() -> None:
    """Where nothing moves, ṡ is at most 1 by definition."""
    problem = load_problem("tilt_insert")
    motion = Trajectory.from_samples(
        [0.0, 1.0], np.tile([0.3, 1.15, 0.1, 0.0], (2, 1)), np.zeros((2, 4))
    )
    path = path_rows.PathRows.from_trajectory(motion, problem.robot, (0.0, 1.0))
    bound, _ = path_bound(path, problem.task_limits)
    assert bound == pytest.approx(1.0)


def test_a_joint_that_returns_within_an_interval_does_not_rest() -> None:
    """Joint 2 moves out and back within each interval.

    The path speed ṡ is fixed to 1 only at the ends of the motion.
    """
    problem = load_problem("tilt_insert")
    count, speed = 250, 0.05
    coefficients = np.zeros((count, 6, 4))
    coefficients[:, 0] = [0.3, 1.15, 0.1, 0.0]
    coefficients[:, 1, 1] = speed * (-1.0) ** np.arange(count)
    coefficients[:, 2, 1] = -coefficients[:, 1, 1]
    motion = Trajectory(np.arange(count + 1.0), coefficients, ())
    use = speed / problem.robot.joints[1].velocity
    path = path_rows.PathRows.from_trajectory(motion, problem.robot, (0.0, float(count)))
    bound, _ = path_bound(path, problem.task_limits)
    assert bound is None or bound < 2 * count * use


def test_rests_of_the_polynomials_count() -> None:
    problem = load_problem("tilt_insert")
    motion, expected = bang_bang(problem.robot, 2, 0.4)
    rest = np.array([0.0, 0.7]), rest_coefficients(motion.sample([1.5]).q[0])
    both = join_sections([("", motion.breaks, motion.coefficients), ("", *rest)])
    bound = shortest_path_duration(both, problem.robot, problem.task_limits, (0.0, 2.2)).bound
    assert bound is not None
    assert 0.95 * (expected + 0.7) <= bound <= (1 + ROUNDING) * (expected + 0.7)


def changes_of(opinion: Opinion) -> dict[tuple[str, str | None], float]:
    assert opinion.sensitivities is not None
    return {(item.limit, item.joint): item.seconds_per_percent for item in opinion.sensitivities}


def test_the_sensitivity_of_a_bang_bang_motion_follows_from_its_closed_form() -> None:
    """T = 2 √(d/a), so one percent more acceleration saves half a percent of T."""
    problem = load_problem("tilt_insert")
    motion, expected = bang_bang(problem.robot, 2, 0.1)
    changes = changes_of(
        shortest_path_duration(motion, problem.robot, problem.task_limits, (0.0, 1.5))
    )
    assert changes["acceleration", "spin"] == pytest.approx(-0.005 * expected, rel=5e-3)
    assert sum(changes.values()) == pytest.approx(changes["acceleration", "spin"], rel=1e-6)


@pytest.mark.parametrize("name", ["tilt_insert", "eye_approach"])
def test_sensitivities_satisfy_the_scaling_of_time(name: str) -> None:
    """If only limits of speed and acceleration bind, T(v/λ, a/λ²) = λ T(v, a).

    Euler's theorem then gives a weighted sum of the sensitivities.
    """
    result = load_plan(ROOT / "results" / name)
    for span in result.motion.phases:
        opinion = shortest_path_duration(
            result.motion, result.robot, result.limits, (span.start, span.end)
        )
        changes = changes_of(opinion)
        assert not any(change for (limit, _), change in changes.items() if "torque" in limit)
        orders = {limit: 2 if limit == "acceleration" else 1 for limit, _ in changes}
        total = sum(orders[limit] * change for (limit, _), change in changes.items())
        assert total == pytest.approx(-0.01 * (span.end - span.start), rel=2e-3)


def test_a_torque_that_binds_has_a_sensitivity_that_planning_again_confirms() -> None:
    problem = unchecked_copy(weakened(0.9), planner="fast")
    base = plan(problem, relaxations=False)
    span = base.motion.phases[0]
    ends = span.start, span.end
    changes = changes_of(
        shortest_path_duration(base.motion, problem.robot, problem.task_limits, ends)
    )
    (_, joint), change = min(
        ((name, value) for name, value in changes.items() if name[0] == "motor torque"),
        key=lambda item: item[1],
    )
    stronger = tuple(
        unchecked_copy(j, motor=unchecked_copy(j.motor, max_torque=1.001 * j.motor.max_torque))
        if j.name == joint
        else j
        for j in problem.robot.joints
    )
    again = plan(
        unchecked_copy(problem, robot=unchecked_copy(problem.robot, joints=stronger)),
        relaxations=False,
    )
    gained = again.motion.phases[0].end - base.motion.phases[0].end
    assert gained < -1e-3
    assert change == pytest.approx(10 * gained, rel=0.05)
