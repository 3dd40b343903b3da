"""Verify the search for the fastest motion whose motors keep their continuous torque.

The search finds the root of a function that decreases with a multiplier of the heat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ssm_planner.pipeline import thermal
from ssm_planner.pipeline.retime import retime
from ssm_planner.pipeline.run import plan
from ssm_planner.pipeline.thermal import HEAT_MULTIPLIERS, ThermalSearch
from ssm_planner.planning.tolerances import GAP
from ssm_planner.plans import Plan
from ssm_planner.problem.motion import Dwell, Follow, Free, Joints, Motion, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot


def weaker(robot: Robot, share: float) -> Robot:
    """Return the robot with `share` times the nominal torque of every motor."""
    joints = tuple(
        joint
        if joint.motor is None
        else replace(
            joint, motor=replace(joint.motor, nominal_torque=share * joint.motor.nominal_torque)
        )
        for joint in robot.joints
    )
    return replace(robot, joints=joints)


@pytest.mark.parametrize(
    "excess",
    [
        lambda number: 0.3 - number,
        lambda number: 1e-3 - number**5,
        lambda number: 2 * np.exp(-20 * number) - 0.1,
        lambda number: 0.4 - number**0.2,
    ],
)
def test_the_search_for_the_multiplier_ends_within_the_gap(
    excess: Callable[[float], float],
) -> None:
    numbers: list[float] = []

    def motion(number: float) -> Any:
        numbers.append(number)
        heat = excess(number)
        return SimpleNamespace(passed=heat <= 0, excess_heat=heat)

    result = thermal._find_smallest_cool(motion, HEAT_MULTIPLIERS, motion(0.0))
    assert result is not None
    number, outcome = result
    cool = -GAP <= outcome.excess_heat <= 0
    assert cool or max(other for other in numbers if other < number) >= number - GAP
    assert len(numbers) <= 16


def test_a_jump_of_the_heat_ends_the_search() -> None:
    """No multiplier gives a heat between the two values.

    Therefore the search takes the smallest multiplier on the cool side.
    """

    def motion(number: float) -> Any:
        heat = 0.2 if number < 0.6173 else -0.3
        return SimpleNamespace(passed=heat <= 0, excess_heat=heat)

    result = thermal._find_smallest_cool(motion, HEAT_MULTIPLIERS, motion(0.0))
    assert result is not None
    assert 0.6173 <= result[0] <= 0.6173 + GAP


def test_all_phases_are_slower_if_resting_phases_do_not_suffice(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If a longer phase in which the hot motor rests fails, all phases become slower.

    A longer phase may fail because it exceeds another limit.
    """
    tilt = replace(tilt_insert, motion=tilt_insert.motion[:1], objective="time", planner="fast")
    roll, *others = tilt.robot.joints
    assert roll.motor is not None
    motor = replace(roll.motor, nominal_torque=18e-3, max_torque=40e-3)
    robot = replace(tilt.robot, joints=(replace(roll, motor=motor), *others))
    problem = replace(tilt, robot=robot, motion=tilt_insert.motion)
    fastest = plan(problem, relaxations=False)
    assert fastest.passed
    monkeypatch.setattr(
        ThermalSearch, "_extend_rests", lambda search, *_: replace(search.initial, certificate=None)
    )
    slower = plan(problem, relaxations=False)
    assert slower.passed
    assert slower.duration > fastest.duration


@pytest.mark.parametrize(
    ("motion", "longer"),
    [
        (Free(Task(tilt=-1.9)), True),
        (Free(Task(tilt=-1.9), duration=4.0), False),
        (Follow(Task(tilt=-1.9), curve="line", constant_speed=0.01), False),
        (Dwell(0.2), False),
    ],
)
def test_prescribed_durations_and_speeds_are_kept(motion: Motion, longer: bool) -> None:
    phase: Any = SimpleNamespace(motion=motion, begins_and_ends_at_rest=True)
    planned: Any = SimpleNamespace(phase=phase)
    assert thermal._may_take_longer(planned) == longer


def at_constant_speed(problem: Problem) -> Plan:
    """Return the plan of a line at constant speed, which TOPP-RA times."""
    end = Task(roll=0.3, tilt=-1.9, spin=0.0, depth=0.02)
    line = Follow(end, curve="line", constant_speed=0.01)
    start = Task(roll=0.0, tilt=-1.5, spin=0.0, depth=0.01)
    return plan(replace(problem, start=start, motion=(line,), objective="time"))


def along_a_table(problem: Problem) -> Plan:
    """Return the plan of a table of joint positions, which TOPP-RA times."""
    q = joint_path()
    points = [Joints((a, b, c, d)) for a, b, c, d in q.tolist()]
    table = Follow(points[-1], tuple(points[1:-1]), curve="samples")
    start = points[0]
    return plan(replace(problem, start=start, motion=(table,), objective="time", limits=()))


def along_a_table_by_toppra(problem: Problem) -> Plan:
    """Return the plan of the table with the planner TOPP-RA.

    TOPP-RA cannot plan the free motion to the first point of the table.
    """
    return along_a_table(replace(problem, planner="toppra"))


def retimed(problem: Problem) -> Plan:
    """Return the plan of a path of joint positions that is only retimed."""
    return retime(joint_path(), problem.robot)


def joint_path() -> np.ndarray:
    """Return 25 points on a straight line in joint space, (25, 4), in rad and m."""
    share = np.linspace(0.0, 1.0, 25)[:, None]
    path: np.ndarray = np.array([-0.5, 0.5, 0.2, -0.02]) + share * np.array([0.4, 0.5, -0.2, 0.005])
    return path


@pytest.mark.parametrize(
    "timed", [at_constant_speed, along_a_table, along_a_table_by_toppra, retimed]
)
def test_a_hot_motion_that_toppra_alone_times_has_a_reason(
    tilt_insert: Problem, timed: Callable[[Problem], Plan]
) -> None:
    """TOPP-RA supports no duration, so a longer duration is not among the relaxations."""
    result = timed(replace(tilt_insert, robot=weaker(tilt_insert.robot, 0.35)))
    assert not result.passed
    assert result.reason is not None
    assert result.reason.constraint == "continuous torque"
    assert result.reason.relaxation is not None
    assert "duration" not in result.reason.relaxation


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["fast", "optimal"])
def test_a_printed_relaxation_gives_the_printed_motion(tilt_insert: Problem, planner: Any) -> None:
    """The requested planner planned the printed motion in the same search."""
    problem = replace(
        tilt_insert,
        robot=weaker(tilt_insert.robot, 0.3),
        motion=tilt_insert.motion[:1],
        planner=planner,
    )
    changed: list[Problem] = []
    result = plan(problem, on_relaxation=changed.append)
    assert result.reason is not None
    assert result.reason.relaxation is not None
    again = plan(changed[0], relaxations=False)
    assert again.passed
    printed = result.reason.relaxation.split("; or")[0].rpartition("takes ")[2]
    assert float(printed.removesuffix(" s")) == pytest.approx(again.duration, rel=1e-3)
