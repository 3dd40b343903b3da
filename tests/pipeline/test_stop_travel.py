"""Verify the limit on the distance that the tip travels until it can stop.

Plans keep the limit, independent code checks it, and reasons and relaxations name it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.retiming.constraints import braking_travel
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.limits import StopTravel
from ssm_planner.problem.problem import Planner, Problem
from ssm_planner.stopping import controlled_stops
from ssm_planner.verification.check import check
from tests.support.paths import ROOT


def limited(name: str, largest: float) -> Problem:
    """Return a shipped problem with the limit of the stop travel, in m."""
    return StopTravel(largest).on(load_problem(ROOT / "problems" / f"{name}.yaml"))


@cache
def planned(name: str, largest: float) -> Plan:
    """Return the plan of the shipped problem with the limit."""
    return plan(limited(name, largest))


@pytest.mark.parametrize(
    ("name", "largest"),
    [
        pytest.param("tilt_insert", 0.5e-3, marks=pytest.mark.slow),
        pytest.param("eye_approach", 0.5e-3, marks=pytest.mark.slow),
        ("waypoints", 1e-3),
        pytest.param("laser_scan", 0.2e-3, marks=pytest.mark.slow),
    ],
)
def test_stops_from_everywhere_keep_to_the_limit(name: str, largest: float, tmp_path: Path) -> None:
    """The cases are straight and free motions, waypoints and a scan.

    The plan uses at least 98 % of the limit, and the stored plan contains the limit.
    """
    result = planned(name, largest)
    assert result.reason is None, result.reason
    (line,) = (item for item in result.certificate.limits if item.name == StopTravel.name)
    assert 0.98 * largest < line.worst <= largest
    stops = controlled_stops(result.motion, result.robot, result.limits, 2500)
    assert stops.passed
    assert stops.travel.max() <= largest * (1 + 1e-4)
    again = load_plan(result.write(tmp_path / "plan.json"))
    assert again.problem.stop_travel == StopTravel(largest)


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["fast", "toppra"])
def test_other_planners_keep_it_too(planner: Planner) -> None:
    result = plan(replace(limited("tilt_insert", 0.5e-3), planner=planner))
    assert result.reason is None, result.reason
    assert result.certificate.passed
    assert result.duration == pytest.approx(planned("tilt_insert", 0.5e-3).duration, rel=1e-3)


def test_the_motion_is_slowed_only_where_it_has_to_be() -> None:
    """The tip does not move while the tool tilts, so this phase is as fast as without the limit."""
    free, slow = (
        plan(load_problem(ROOT / "problems" / "tilt_insert.yaml")),
        planned("tilt_insert", 0.5e-3),
    )
    tilt, insert = zip(
        (p.duration for p in free.phases), (p.duration for p in slow.phases), strict=True
    )
    assert tilt[1] == pytest.approx(tilt[0], rel=1e-4)
    # At the constant speed v, the tip stops within v²/(2 a), so v = √(2 a d). The insertion
    # takes 20 mm / v and one ramp more.
    a = slow.robot.joints[3].acceleration
    v = np.sqrt(2 * a * 0.5e-3)
    assert insert[1] == pytest.approx(0.02 / v + v / a, rel=0.02)
    assert insert[1] > 1.5 * insert[0]


def test_the_check_finds_what_a_planner_without_the_limit_exceeds() -> None:
    result = load_plan(ROOT / "results" / "tilt_insert" / "plan.json")
    certificate = check(result.motion, result.robot, StopTravel(1e-3).on(result.limits))
    (broken,) = certificate.violations
    assert broken.name == StopTravel.name
    assert broken.worst == pytest.approx(result.stops.travel.max(), rel=2e-3)


def test_the_planner_s_estimate_is_that_of_joints_that_brake_evenly() -> None:
    """The planner's estimate of the stop travel assumes constant braking of every joint."""
    robot = load_problem(ROOT / "problems" / "tilt_insert.yaml").robot
    qd = np.array([[0.0, 0.0, 0.0, -0.01]])
    travel = braking_travel(
        Mechanism.from_geometry(robot.geometry), robot, np.array([[0.3, 0.5, 0.2, -0.01]]), qd
    )
    assert travel[0] == pytest.approx(0.01**2 / (2 * robot.joints[3].acceleration))


@pytest.mark.slow
def test_a_start_too_fast_to_stop_is_named_and_a_relaxation_tried() -> None:
    problem = replace(limited("tilt_insert", 0.2e-3), start_rate={"depth": 0.01})
    problem = replace(problem, motion=problem.motion[1:], eye=None)
    result = plan(problem)
    assert result.reason is not None
    assert isinstance(result.reason.limit, StopTravel)
    assert result.reason.required == pytest.approx(
        0.01**2 / (2 * problem.robot.joints[3].acceleration)
    )
    assert "stop travel of" in str(result.reason.relaxation)
    assert "takes" in str(result.reason.relaxation)


def test_a_problem_without_a_path_for_a_stop_is_refused() -> None:
    """A problem that leaves no path for a stop is refused."""
    problem = limited("tilt_insert", 0.5e-3)
    with pytest.raises(ProblemError, match="leaves no path for a stop"):
        replace(problem, end_rate={"depth": 0.01})
    first, *others = problem.robot.joints
    jerky = replace(problem.robot, joints=(replace(first, jerk=100.0), *others))
    with pytest.raises(ProblemError, match="jerk of joint roll"):
        replace(problem, robot=jerky)
