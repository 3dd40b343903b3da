from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.lower_bound import rest_to_rest
from ssm_planner.planning.ocp.straight import joint_pieces
from ssm_planner.planning.planner import feasible_phases
from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.planning.retiming.retime import retime
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.verification.check import check

Weaker = Callable[[Robot, float], Robot]


def paths(problem: Problem) -> list[StraightPath]:
    phases, reason = feasible_phases(problem, Mechanism.from_geometry(problem.robot.geometry))
    assert reason is None
    return [phase.path for phase in phases if phase.path is not None]


def test_insertion_takes_the_closed_form_time(tilt_insert: Problem) -> None:
    insertion = paths(tilt_insert)[1]
    joint = tilt_insert.robot.joints[3]
    expected = rest_to_rest(0.020, joint.velocity, joint.acceleration).duration
    assert retime(insertion, tilt_insert.robot).duration == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("factor", "passes"), [(0.35, 6), (0.29, 10)])
def test_the_viscous_tangents_settle(tilt_insert: Problem, factor: float, passes: int, weaker: Weaker) -> None:
    robot = weaker(tilt_insert.robot, factor)
    path = paths(tilt_insert)[0]
    result = retime(path, robot)
    assert result.solved
    assert result.passes <= passes
    assert result.duration > 1.02 * retime(path, tilt_insert.robot).duration


def test_a_motor_too_weak_to_start_gives_no_motion(tilt_insert: Problem, weaker: Weaker) -> None:
    result = retime(paths(tilt_insert)[0], weaker(tilt_insert.robot, 0.1))
    assert result.status == "infeasible"
    assert result.message


def test_a_path_follows_its_line_and_its_derivatives_are_its_own(tilt_insert: Problem) -> None:
    path = paths(tilt_insert)[0]
    s = np.linspace(0.01, 0.99, 50)
    h = 1e-6
    low, here, high = path.sample(s - h), path.sample(s), path.sample(s + h)
    assert np.allclose((high.q - low.q) / (2 * h), here.dq, rtol=1e-6, atol=1e-8)
    assert np.allclose((high.dq - low.dq) / (2 * h), here.ddq, rtol=1e-6, atol=1e-6)
    assert np.allclose((high.ddq - low.ddq) / (2 * h), path.third_derivative(s), rtol=1e-5, atol=1e-5)


def test_joint_pieces_stay_on_the_straight_line(tilt_insert: Problem) -> None:
    from ssm_planner.kinematics.task import task_from_joints
    from ssm_planner.planning.ocp.straight import solve_straight
    from ssm_planner.trajectory import join

    path = paths(tilt_insert)[0]
    motion = solve_straight(tilt_insert.robot, path, retime(path, tilt_insert.robot))
    trajectory = join([("tilt", *joint_pieces(path, motion))])
    samples = trajectory.sample(np.linspace(0, trajectory.duration, 5000))
    task = task_from_joints(path.mechanism, samples.q)
    for k in (0, 2, 3):
        assert np.abs(task[:, k] - path.start[k]).max() < 1e-8
    assert check(trajectory, tilt_insert.robot).passed
