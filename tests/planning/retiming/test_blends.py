"""Verify rounded corners between motions.

A rounded path is smooth, leaves its lines only within the given distance of a corner, and is faster
than a path with stops.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.phases import Phase, build_phases, start_configurations
from ssm_planner.planning.retiming.blends import BlendedPath
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TaskRate
from ssm_planner.problem.motion import Dwell, Follow, Straight, Task, Tip
from ssm_planner.problem.problem import Problem

START = Task(0.0, np.radians(-95), 0.0, 0.005)
ONWARD = Follow(Tip((0.004, -0.003, -0.014), 0.1), curve="line", name="line")


def cornered(problem: Problem, blend: float | None, **changes: Any) -> Problem:
    """Return a problem with three motions and rounded corners at the distance `blend`, in m."""
    tilt, insert = Straight(tilt=np.radians(-120), blend=blend), Straight(depth=0.015, blend=blend)
    return replace(problem, start=START, motion=(tilt, insert, ONWARD), objective="time", **changes)


def phases(problem: Problem) -> tuple[Phase, ...]:
    """Return the phases of a problem for its first start configuration."""
    return build_phases(problem, start_configurations(problem)[0])


@pytest.mark.parametrize("blend", [1e-4, 1e-3])
def test_a_rounded_path_is_smooth_and_keeps_to_its_lines_but_near_corners(
    tilt_insert: Problem, blend: float
) -> None:
    (phase,) = phases(cornered(tilt_insert, blend))
    path, h = phase.path, 1e-7
    assert isinstance(path, BlendedPath)
    s = np.linspace(0.001, 0.999, 3001)
    s = s[np.abs(s[:, None] - path.breaks).min(axis=1) > 2 * h]
    before, samples, behind = (path.sample(s + shift) for shift in (-h, 0.0, h))
    assert (behind.q - before.q) / (2 * h) == pytest.approx(
        samples.dq, abs=1e-5 * np.abs(samples.dq).max()
    )
    assert (behind.dq - before.dq) / (2 * h) == pytest.approx(
        samples.ddq, abs=1e-4 * np.abs(samples.ddq).max()
    )
    inner = path.breaks[1:-1]
    left, right = path.sample(inner - 1e-12), path.sample(inner + 1e-12)
    for one, other in ((left.q, right.q), (left.dq, right.dq), (left.ddq, right.ddq)):
        assert one == pytest.approx(other, abs=1e-6 * np.abs(samples.ddq).max())
    # No joint reverses between knots, and one reverses at each knot that is not a break.
    knots, signs = path.directions
    assert (knots[0], knots[-1]) == (0.0, 1.0)
    for first, last, sign in zip(knots[:-1], knots[1:], signs, strict=True):
        slopes = path.sample(first + (last - first) * np.linspace(0.01, 0.99, 30)).dq
        assert np.all(slopes * sign >= -1e-9)
        assert sign.any()
    turning = knots[1:-1][np.abs(knots[1:-1, None] - path.breaks).min(axis=1) > 1e-9]
    slopes = np.abs(path.sample(turning).dq / np.abs(samples.dq).max(axis=0).clip(1e-12))
    assert np.all(np.where(slopes == 0, 1.0, slopes).min(axis=1) < 1e-6)
    # On a short rounding, the joints move almost in straight lines too, and none overshoots.
    joints = path.sample(np.linspace(*inner[:2], 101)).q
    low, high = np.sort(joints[[0, -1]], axis=0)
    assert blend > 1e-4 or np.all((joints >= low - 1e-9) & (joints <= high + 1e-9))
    # A rounding begins and ends at the given distance from the corner.
    tips, corner = (
        tip_position(path.mechanism, path.sample(inner[:2]).q),
        tip_position(path.mechanism, path.pieces[1].first[None]),
    )
    assert np.linalg.norm(tips - corner, axis=1) == pytest.approx(blend, rel=1e-6)


def test_corners_are_passed_sooner_and_the_check_says_how_far_off(tilt_insert: Problem) -> None:
    """A larger rounding is faster, and the plan states how far the tip departs from the corner."""
    durations = [plan(cornered(tilt_insert, None, planner="toppra")).duration]
    for blend in (0.2e-3, 0.8e-3):
        result = plan(cornered(tilt_insert, blend))
        assert result.passed, result.reason
        (phase,) = result.phases
        assert phase.name == "tilt + insert + line"
        # At a right angle, the tip departs from the corner by (3/16) √2 of the distance. Farther
        # from the corner than the distance, it stays on its lines.
        assert 0.1 * blend < phase.corner_departure < 0.3 * blend  # type: ignore[operator]
        assert phase.corner_reach <= blend + 1e-9  # type: ignore[operator]
        assert phase.corner_reach == pytest.approx(blend, rel=0.2)
        durations.append(result.duration)
        speed = np.abs(result.motion.sample(result.duration * np.linspace(0.05, 0.95, 500)).qd).max(
            axis=1
        )
        assert speed.min() > 0
    assert durations == sorted(durations, reverse=True)  # type: ignore[type-var]
    again = Plan.from_json(result.to_json().encode(), Path("plan.json"))
    assert again.problem.motion[0].blend == pytest.approx(0.8e-3)  # type: ignore[union-attr]
    assert again.phases == result.phases


def test_rates_of_task_coordinates_are_kept_in_the_corners_too(tilt_insert: Problem) -> None:
    rates = (TaskRate("tilt", np.radians(10)), TaskRate("depth", 4e-3))
    tilt = Straight(tilt=np.radians(-110), blend=0.3e-3)
    problem = replace(tilt_insert, start=START, motion=(tilt, Straight(depth=0.009)))
    result = plan(replace(problem, limits=(*problem.limits, *rates)))
    assert result.passed, result.reason
    assert result.phases[0].solver == "TOPP-RA"
    # Each rate binds during almost all of its motion, and the two motions overlap only near the
    # corner.
    assert result.duration == pytest.approx(
        np.radians(15) / rates[0].largest + 4e-3 / rates[1].largest, rel=0.12
    )


def test_where_jerk_is_limited_it_is_kept_in_the_corners_too(
    tilt_insert: Problem, with_jerk: Any
) -> None:
    robot = with_jerk(tilt_insert.robot, 100.0, 2.0)
    tilt = Straight(tilt=np.radians(-105), blend=0.3e-3)
    problem = replace(
        tilt_insert, robot=robot, start=START, motion=(tilt, Straight(depth=0.01)), objective="time"
    )
    result = plan(problem)
    assert result.passed, result.reason
    assert 0 < result.phases[0].corner_departure < 0.1e-3  # type: ignore[operator]


def test_a_line_of_the_tip_takes_durations_and_jerk_limits(
    tilt_insert: Problem, with_jerk: Any
) -> None:
    robot = with_jerk(tilt_insert.robot, 100.0, 2.0)
    problem = replace(
        tilt_insert, robot=robot, start=START, motion=(replace(ONWARD, duration=4.0),)
    )
    result = plan(problem)
    assert result.passed, result.reason
    assert result.duration == pytest.approx(4.0, rel=1e-6)
    tips = tip_position(
        Mechanism.from_geometry(robot.geometry), result.motion.sample(np.linspace(0, 4, 3000)).q
    )
    way = tips[-1] - tips[0]
    off = np.cross(tips - tips[0], way / np.linalg.norm(way))
    assert np.abs(off).max() < 1e-7


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ((Straight(tilt=-1.8, blend=5e-3), Straight(depth=0.006)), r"5 mm: the rounding of the corner .* up to 0\.3547 mm"),
        ((Straight(depth=0.006, blend=8e-4), Straight(tilt=-1.8)), r"0\.8 mm: the rounding of the corner"),
        ((Straight(depth=0.012, blend=8e-4), Straight(depth=0.012, tilt=-1.70)), r"0\.8 mm: the rounding of the corner"),
        ((Straight(tilt=-1.8, blend=1e-3), Straight(spin=0.3)), "does not move the tip, so the corner"),
        ((Straight(tilt=-1.8, blend=1e-4), Straight(tilt=-1.7)), "goes back along the first"),
        ((Straight(tilt=-1.8, blend=1e-4), Straight(tilt=-1.8)), "cannot have a rounded corner"),
    ],
)  # fmt: skip
def test_corners_that_cannot_be_rounded(tilt_insert: Problem, motion: Any, message: str) -> None:
    """A corner that cannot be rounded is refused when the phases are built."""
    with pytest.raises(ProblemError, match=message):
        phases(replace(tilt_insert, start=START, motion=motion))


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ((Straight(tilt=-1.8, blend=1e-3),), "the last motion cannot have a blend"),
        ((Straight(tilt=-1.8, blend=1e-3), Dwell(1.0), Straight(depth=0.01)), r"stops before the next motion, a dwell"),
        ((Straight(tilt=-1.8, blend=1e-3), Straight(depth=0.01, duration=2.0)), "cannot have a duration"),
    ],
)  # fmt: skip
def test_blends_that_are_none(tilt_insert: Problem, motion: Any, message: str) -> None:
    """A blend without a following motion to blend with is refused when the problem is built."""
    with pytest.raises(ProblemError, match=message):
        replace(tilt_insert, start=START, motion=motion)
