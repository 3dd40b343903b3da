"""Verify the lower bound of the duration.

No motion is faster than the bound, and the bound equals the duration of the plan if one joint or
rate alone limits it. Ruckig gives the reference for one joint.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.lower_bound import (
    angular_acceleration_bound,
    minimum_times,
    rest_to_rest,
    slowest_joint_times,
)
from ssm_planner.problem.limits import TASK_COORDINATES, TaskRate, TipSpeed
from ssm_planner.problem.motion import Free, Task
from ssm_planner.problem.problem import Problem, TaskLimits

positive = st.floats(1e-2, 1e2)
share = st.floats(-0.99, 0.99)


@settings(deadline=None, max_examples=300)
@given(way=st.floats(-50.0, 50.0), velocity=positive, acceleration=positive, begin=share, end=share)
def test_the_fastest_way_between_two_speeds_is_ruckigs(
    way: float, velocity: float, acceleration: float, begin: float, end: float
) -> None:
    assume(abs(way) > 1e-3)
    ruckig = pytest.importorskip("ruckig", reason="Ruckig is not installed")
    task = ruckig.InputParameter(1)
    task.current_position, task.target_position = [0.0], [way]
    task.current_velocity, task.target_velocity = [begin * velocity], [end * velocity]
    task.max_velocity, task.max_acceleration = [velocity], [acceleration]
    reference = ruckig.Trajectory(1)
    assume(ruckig.Ruckig(1).calculate(task, reference) == ruckig.Result.Working)
    found = minimum_times(way, velocity, acceleration, (begin * velocity, end * velocity))
    assert found == pytest.approx(reference.duration, rel=1e-6, abs=1e-6)


@given(way=positive, velocity=positive, acceleration=positive, begin=share, end=share)
def test_a_free_speed_costs_no_time(
    way: float, velocity: float, acceleration: float, begin: float, end: float
) -> None:
    """The minimum time with a free end speed is that with the best fixed speed."""
    speeds = begin * velocity, end * velocity
    both = minimum_times(way, velocity, acceleration, speeds)
    one = [
        minimum_times(way, velocity, acceleration, each)
        for each in ((speeds[0], np.nan), (np.nan, speeds[1]))
    ]
    assert max(one) <= both * (1 + 1e-9)
    assert minimum_times(way, velocity, acceleration, (np.nan, np.nan)) <= min(one) * (1 + 1e-9)
    assert minimum_times(way, velocity, acceleration) == pytest.approx(
        rest_to_rest(way, velocity, acceleration).duration, rel=1e-9
    )
    # The free end has the best of all speeds.
    top = min(velocity, np.sqrt(speeds[0] ** 2 + 2 * acceleration * way))
    best = min(
        minimum_times(way, velocity, acceleration, (speeds[0], v))
        for v in top * np.linspace(-1, 1, 201)
    )
    assert best == pytest.approx(one[0], rel=1e-3)


@pytest.mark.parametrize("name", ["roll", "tilt", "spin"])
def test_no_coordinate_accelerates_more_than_the_bound_says(
    tilt_insert: Problem, name: str
) -> None:
    robot, rng, k = tilt_insert.robot, np.random.default_rng(3), TASK_COORDINATES.index(name)
    mechanism, most = (
        Mechanism.from_geometry(robot.geometry),
        [joint.velocity for joint in robot.joints],
    )
    low, high = tilt_insert.ranges["tilt"]
    task = np.column_stack(
        [np.zeros(400), rng.uniform(low, high, 400), np.zeros(400), np.full(400, 0.01)]
    )
    q = inverse_task(mechanism, task).joints[:, 0]
    qd, qdd = (
        rng.choice([-1.0, 1.0], (400, 4)) * bound
        for bound in (most, [j.acceleration for j in robot.joints])
    )
    step = 1e-5
    ahead, behind = (
        task_rates(mechanism, q + s * qd + s**2 / 2 * qdd, qd + s * qdd) for s in (step, -step)
    )
    result = np.abs(ahead - behind)[:, k] / (2 * step)
    bound = angular_acceleration_bound(robot, name, tilt_insert.task_limits)
    assert bound / 5 < result.max() < bound


def only(problem: Problem, **to: float) -> Problem:
    """Return a problem with one free motion that changes only the given task coordinates."""
    start = Task(roll=0.1, tilt=np.radians(-100), spin=0.2, depth=0.005)
    return replace(problem, start=start, motion=(Free(Task(**to)),), objective="time")


@pytest.mark.parametrize(
    ("to", "changes", "gap"),
    [
        ({"depth": 0.02}, {"limits": (TaskRate("depth", 0.008),)}, 1e-3),
        ({"depth": 0.02}, {"limits": (TipSpeed(0.008),)}, 1e-3),
        ({"tilt": np.radians(-130)}, {"limits": (TaskRate("tilt", np.radians(12)),)}, 0.05),
        ({"depth": 0.02}, {"start_rate": {"depth": 0.01}}, 1e-3),
        ({"depth": 0.006}, {"start_rate": {"depth": 0.01}, "end_rate": {"depth": 0.012}}, 1e-3),
    ],
)
def test_where_one_limit_binds_alone_the_gap_closes(
    tilt_insert: Problem, to: dict[str, float], changes: dict[str, object], gap: float
) -> None:
    """If one limit alone binds, the plan takes nearly the time of the lower bound."""
    result = plan(replace(only(tilt_insert, **to), **changes))
    assert result.passed
    assert -1e-6 < result.gap < gap


@pytest.mark.parametrize("seed", range(4))
def test_through_points_every_stretch_counts(tilt_insert: Problem, seed: int) -> None:
    """A different joint determines the time of each part between two points."""
    rng = np.random.default_rng(seed)
    through = (Task(roll=rng.uniform(0.5, 0.8)), Task(depth=rng.uniform(0.01, 0.02)))
    first = only(tilt_insert, spin=rng.uniform(0.8, 1.2))
    problem = replace(first, limits=(), motion=(Free(first.motion[0].to, through),))
    result = plan(problem)
    assert result.passed
    assert -1e-6 < result.gap < 0.35


def test_many_motions_at_a_time_take_what_each_takes_alone(tilt_insert: Problem) -> None:
    rng = np.random.default_rng(3)
    for jerk in (None, 40.0):
        joints = tuple(replace(joint, jerk=jerk) for joint in tilt_insert.robot.joints)
        robot = replace(tilt_insert.robot, joints=joints)
        ways = 10.0 ** rng.uniform(-6, 0, (60, 4)) * rng.choice([-1, 1], (60, 4))
        alone = [
            max(
                rest_to_rest(abs(way), joint.velocity, joint.acceleration, joint.jerk).duration
                for way, joint in zip(row, joints, strict=True)
            )
            for row in ways.tolist()
        ]
        assert slowest_joint_times(robot, ways, np.zeros(60), TaskLimits()) == pytest.approx(
            alone, rel=1e-9
        )
