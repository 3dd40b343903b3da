"""Verify limits of task rates, tip speed, retina clearance and lens clearance.

Plans keep each limit, and they reach the limit if it makes the motion slower.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.planning.ocp.free import solve_free
from ssm_planner.planning.tolerances import GAP
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import (
    LensClearance,
    Limit,
    RetinaClearance,
    TaskRange,
    TaskRate,
    TipSpeed,
)
from ssm_planner.problem.motion import Free, Straight, Task
from ssm_planner.problem.problem import Eye, Lens, Problem
from ssm_planner.problem.robot import read_only_array
from ssm_planner.verification.certificate import LimitCheck
from ssm_planner.verification.check import check
from tests.support.cases import drawn

START = {"roll": -0.2, "tilt": -1.7, "spin": 0.0, "depth": 0.004}
GOAL = {"roll": 0.2, "tilt": -2.2, "spin": 0.6, "depth": 0.014}
RATES = {"roll": 0.25, "tilt": 0.3, "spin": 0.35, "depth": 0.006}
LIMIT = {"roll": "roll rate", "tilt": "tilt rate", "spin": "spin rate", "depth": "insertion speed"}
SWING = {"roll": 0.0, "tilt": -1.65, "spin": 0.0, "depth": 0.003}
FAR = {"roll": 0.0, "tilt": -2.25, "spin": 0.0, "depth": 0.015}


def moving(
    problem: Problem,
    kind: Any,
    start: dict[str, float],
    goal: dict[str, float],
    *limits: Limit,
    **changes: Any,
) -> Problem:
    """Return a problem with one motion of a kind between two task positions."""
    motion = (Free(Task(**goal)) if kind == "free" else Straight(**goal),)
    return dataclasses.replace(
        problem,
        start=Task(**start),
        motion=motion,
        limits=(TaskRange("depth", 0.0, 0.03), *limits),
        **{"objective": "time", **changes},
    )


def limit(result: Plan, name: str) -> LimitCheck:
    """Return the check of the limit with this name."""
    assert result.certificate is not None
    return next(line for line in result.certificate.limits if line.name == name)


@pytest.mark.parametrize("kind", ["straight", "free"])
@pytest.mark.parametrize("name", RATES)
def test_a_rate_that_binds_is_kept_and_used(tilt_insert: Problem, kind: str, name: str) -> None:
    loose = plan(moving(tilt_insert, kind, START, GOAL))
    result = plan(moving(tilt_insert, kind, START, GOAL, TaskRate(name, RATES[name])))
    assert result.passed
    assert -1e-6 <= limit(result, LIMIT[name]).margin < 1e-3
    # A coordinate at its rate limit takes at least its displacement divided by the rate.
    assert result.duration > loose.duration
    assert result.duration > abs(GOAL[name] - START[name]) / RATES[name]


@pytest.mark.parametrize("kind", ["straight", "free"])
def test_all_rates_and_the_tip_speed_together(tilt_insert: Problem, kind: str) -> None:
    result = plan(
        moving(
            tilt_insert,
            kind,
            START,
            GOAL,
            *(TaskRate(*rate) for rate in RATES.items()),
            TipSpeed(0.006),
        )
    )
    assert result.passed
    assert {LIMIT[name] for name in RATES} | {"tip speed"} <= {
        line.name for line in result.certificate.limits
    }


def test_the_tip_stays_off_the_retina_where_the_direct_way_does_not(laser_scan: Problem) -> None:
    """Inserted as fast as it swings, the tip would come too near the wall."""
    start = {"roll": 0.0, "tilt": float(np.radians(-88)), "spin": 0.0, "depth": 0.0025}
    goal = {"roll": 0.0, "tilt": float(np.radians(-112)), "spin": 0.0, "depth": 0.018}
    with_eye = moving(laser_scan, "free", start, goal)
    without = plan(dataclasses.replace(with_eye, eye=None))
    against = check(without.trajectory, laser_scan.robot, with_eye.task_limits)
    violated = next(line for line in against.limits if line.name == RetinaClearance.name)
    assert violated.margin < -1e-3
    result = plan(with_eye)
    assert result.passed
    assert limit(result, RetinaClearance.name).margin >= -1e-6
    assert result.duration > without.duration * (1 - 1e-6)


def edge_of_the_port(problem: Problem) -> dict[str, float]:
    """Return the task coordinates of a tip at the inner edge of the port.

    The limit of the retina clearance allows this position, but the row of the retina would not.
    """
    assert problem.eye is not None
    return {"roll": 0.0, "tilt": float(np.radians(-88)), "spin": 0.0, "depth": problem.eye.port}


def test_a_motion_may_end_at_the_edge_of_the_port(laser_scan: Problem) -> None:
    start = {"roll": 0.0, "tilt": float(np.radians(-88)), "spin": 0.0, "depth": 0.001}
    result = plan(moving(laser_scan, "free", start, edge_of_the_port(laser_scan)))
    assert result.passed, result.reason
    assert limit(result, RetinaClearance.name).margin >= -1e-6


def test_the_tip_swings_first_from_the_edge_of_the_port(laser_scan: Problem) -> None:
    """From the edge of the port, the tip must swing far enough before it moves inwards.

    It stays at the edge until then.
    """
    start, eye = edge_of_the_port(laser_scan), laser_scan.eye
    assert eye is not None
    result, back = (
        plan(moving(laser_scan, "free", *ends)) for ends in ((start, FAR), (FAR, start))
    )
    for item in (result, back):
        assert item.passed
        assert limit(item, RetinaClearance.name).margin >= -1e-6
    joints = result.trajectory.uniform(2000.0).q
    begun = int(np.argmax(-joints[:, 3] > eye.port + 1e-7))
    assert joints[begun, 1] != pytest.approx(joints[0, 1], abs=1e-2)
    # Inside the port, the tip has more freedom than at its edge.
    before = plan(moving(laser_scan, "free", {**start, "depth": start["depth"] - 1e-4}, FAR))
    assert before.duration == pytest.approx(result.duration, rel=1e-3)


def with_insertion_motor(problem: Problem, torque: float) -> Problem:
    """Return the problem with another largest torque of the motor of joint 4, in N m."""
    joint = problem.robot.joints[3]
    assert joint.motor is not None
    motor = dataclasses.replace(
        joint.motor, max_torque=torque, nominal_torque=min(joint.motor.nominal_torque, torque)
    )
    joints = (*problem.robot.joints[:3], dataclasses.replace(joint, motor=motor))
    return dataclasses.replace(problem, robot=dataclasses.replace(problem.robot, joints=joints))


def in_the_way(problem: Problem) -> Eye:
    """Return an eye with a small lens in the path of a shaft that swings while it is inserted.

    The shaft moves from SWING to FAR.
    """
    tilt, depth = -1.95, 0.0075
    place = depth * np.array([-np.cos(tilt), 0.0, np.sin(tilt)])
    assert problem.eye is not None
    lens = Lens(
        read_only_array(place, (3,)),
        read_only_array([1.2e-3, 1.2e-3, 1.2e-3], (3,)),
        read_only_array(np.eye(3), (3, 3)),
    )
    return dataclasses.replace(problem.eye, lens=lens, clearance=0.5e-3)


@pytest.mark.parametrize("objective", ["time", "time then heat"])
def test_the_shaft_goes_around_a_lens_in_its_way(laser_scan: Problem, objective: str) -> None:
    """The tool swings past the lens first and is inserted behind it."""
    problem = moving(
        laser_scan, "free", SWING, FAR, objective=objective, eye=in_the_way(laser_scan)
    )
    without = plan(dataclasses.replace(problem, eye=None))
    against = check(without.trajectory, problem.robot, problem.task_limits)
    assert next(line for line in against.limits if line.name == LensClearance.name).margin < -0.02
    result = plan(problem)
    assert result.passed
    assert -1e-6 <= limit(result, LensClearance.name).margin < 1e-2
    assert result.duration > without.duration
    tilted = result.trajectory.uniform(1000.0)
    straight = SWING["depth"] + (FAR["depth"] - SWING["depth"]) * 0.5
    half = int(np.argmin(np.abs(tilted.q[:, 1] - tilted.q[[0, -1], 1].mean())))
    assert -tilted.q[half, 3] < straight


def test_a_lens_on_a_straight_line_is_the_reason(laser_scan: Problem) -> None:
    problem = moving(laser_scan, "straight", SWING, FAR, eye=in_the_way(laser_scan))
    result = plan(problem)
    assert (result.status, result.reason.constraint) == ("infeasible", LensClearance.name)
    assert result.reason.available < 1 < result.reason.required
    assert "% of the way" in result.reason.where


@pytest.mark.slow
def test_the_mesh_is_fine_enough_for_the_eye(laser_scan: Problem) -> None:
    """Twice as many elements shorten the motion by less than 0.2 %."""
    problem = moving(laser_scan, "free", SWING, FAR, eye=in_the_way(laser_scan))
    phase = feasible_phases(problem)[0][0]
    coarse, fine = (solve_free(phase, count=n) for n in (40, 80))
    assert coarse.solved
    assert fine.solved
    assert coarse.breaks[-1] / fine.breaks[-1] - 1 < 2e-3


@pytest.mark.parametrize("strength", drawn(2, [2.19e-3, 4e-3, 6.72e-3]))
@pytest.mark.slow
def test_the_motion_around_a_lens_takes_no_longer_on_any_mesh(
    laser_scan: Problem, strength: float
) -> None:
    """The default mesh and finer meshes give the same duration."""
    problem = moving(
        with_insertion_motor(laser_scan, strength), "free", SWING, FAR, eye=in_the_way(laser_scan)
    )
    phase = feasible_phases(problem)[0][0]
    durations = [solve_free(phase, count=n).duration for n in (40, 57, 80)]
    assert max(durations) / min(durations) - 1 < 2e-3


def ball_at(problem: Problem, roll: float, tilt: float, depth: float, radius: float) -> Eye:
    """Return the eye with a spherical lens on the axis of a tool at this roll and tilt.

    `roll` and `tilt` are in rad, `depth` and `radius` in m.
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    place = tip_position(
        mechanism, inverse_task(mechanism, [[roll, tilt, 0.0, depth]]).joints[0, :1]
    )[0]
    assert problem.eye is not None
    lens = Lens(
        read_only_array(place, (3,)),
        read_only_array([radius] * 3, (3,)),
        read_only_array(np.eye(3), (3, 3)),
    )
    return dataclasses.replace(problem.eye, lens=lens, clearance=0.5e-3)


@pytest.mark.parametrize(
    ("tilt", "depth", "rolls", "ball"),
    [
        (-135, 18e-3, (-20, 20), (14e-3, 1.5e-3)),
        (-125, 18e-3, (18, -22), (13e-3, 2e-3)),
        (-128, 17e-3, (-25, 8), (12e-3, 1e-3)),
    ],
)
@pytest.mark.slow
def test_a_tool_is_drawn_back_over_a_lens_in_its_way(
    laser_scan: Problem,
    tilt: float,
    depth: float,
    rolls: tuple[float, float],
    ball: tuple[float, float],
) -> None:
    """The tool retracts, and its motion is no slower than one through a waypoint given by hand."""
    tilt, (begin, end) = np.radians(tilt), np.radians(rolls)
    eye = ball_at(laser_scan, 0.0, tilt, *ball)
    start = Task(roll=begin, tilt=tilt, spin=0.0, depth=depth)
    problem = dataclasses.replace(
        laser_scan,
        start=start,
        motion=(Free(Task(roll=end)),),
        limits=(),
        eye=eye,
        objective="time",
    )
    result = plan(problem)
    assert result.passed
    by_hand = Free(Task(roll=end, depth=depth), (Task(roll=0.0, depth=10e-3),))
    other = plan(dataclasses.replace(problem, motion=(by_hand,)))
    assert result.duration <= (1 + GAP) * other.duration
    depths = -result.trajectory.uniform(500.0).q[:, 3]
    assert depths.min() < ball[0]
    assert result.lower_bound <= result.duration


def test_a_straight_motion_that_grazes_the_retina_does_not_stand_in_for_a_free_one() -> None:
    """A straight motion comes 3 µm too near at the edge of the port, between its samples.

    The planner must not use it instead of the free motion.
    """
    problem = load_problem("problems/eye_approach.yaml")
    assert problem.eye is not None
    eye = dataclasses.replace(problem.eye, clearance=0.928e-3)
    assert plan(dataclasses.replace(problem, eye=eye, planner="fast"), relaxations=False).passed
