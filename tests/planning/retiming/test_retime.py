"""Verify the timing of paths by TOPP-RA against closed forms and optimal control."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.planning.lower_bound import rest_to_rest
from ssm_planner.planning.ocp.straight import solve_straight
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planner import plan_motion
from ssm_planner.planning.retiming import retime as retiming
from ssm_planner.planning.retiming.paths import MotionPath, StraightPath
from ssm_planner.planning.retiming.retime import retime, retime_motion
from ssm_planner.problem.motion import Free, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import join_sections
from ssm_planner.verification.check import check

Weaker = Callable[[Robot, float], Robot]


def paths(problem: Problem) -> list[StraightPath]:
    """Return the paths of all phases of a problem that have one."""
    phases, reason = feasible_phases(problem)
    assert reason is None
    return [phase.path for phase in phases if phase.path is not None]


def test_insertion_takes_the_closed_form_time(tilt_insert: Problem) -> None:
    insertion = paths(tilt_insert)[1]
    joint = tilt_insert.robot.joints[3]
    expected = rest_to_rest(0.020, joint.velocity, joint.acceleration).duration
    assert retime(insertion, tilt_insert.robot).duration == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("factor", "passes"), [(0.35, 6), (0.29, 10)])
def test_the_viscous_tangents_settle(
    tilt_insert: Problem,
    factor: float,
    passes: int,
    weaker: Weaker,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The linearised viscous friction converges in at most `passes` passes."""
    robot = weaker(tilt_insert.robot, factor)
    path = paths(tilt_insert)[0]
    result = retime(path, robot)
    assert result.solved
    assert result.duration > 1.02 * retime(path, tilt_insert.robot).duration
    monkeypatch.setattr(retiming, "MAX_PASSES", passes)
    assert retime(path, robot).duration == result.duration


def phase_along(path: StraightPath, problem: Problem, robot: Robot) -> Phase:
    """Return the phase of a path, in the problem with this robot."""
    problem = replace(problem, robot=robot, objective="time")
    points = path.sample(np.array([0.0, 1.0])).q
    return Phase(problem, problem.motion[0], path.start, path.end, points, path=path)


def test_tangents_settle_while_the_linear_rows_bind_though_the_true_ones_do_not(
    tilt_insert: Problem,
) -> None:
    """Weak motors make the linearised constraints bind where the exact ones do not.

    The duration still agrees with that of optimal control.
    """
    path = paths(tilt_insert)[1]
    durations = []
    for torque in (0.7e-3, 0.6e-3, 0.5e-3, 0.45e-3, 0.4e-3):
        joints = tilt_insert.robot.joints
        assert joints[3].motor is not None
        weak = replace(
            joints[3], motor=replace(joints[3].motor, max_torque=torque, nominal_torque=torque)
        )
        robot = replace(tilt_insert.robot, joints=(*joints[:3], weak))
        result = retime(path, robot)
        assert result.solved
        optimum = solve_straight(phase_along(path, tilt_insert, robot), path, result).duration
        assert result.duration == pytest.approx(optimum, rel=3e-4)
        durations.append(result.duration)
    assert durations == sorted(durations)


def test_a_motor_too_weak_to_start_gives_no_motion(tilt_insert: Problem, weaker: Weaker) -> None:
    result = retime(paths(tilt_insert)[0], weaker(tilt_insert.robot, 0.1))
    assert not result.solved


def test_a_path_follows_its_line_and_its_derivatives_are_its_own(tilt_insert: Problem) -> None:
    path = paths(tilt_insert)[0]
    s = np.linspace(0.01, 0.99, 50)
    h = 1e-6
    low, middle, high = path.sample(s - h), path.sample(s), path.sample(s + h)
    assert np.allclose((high.q - low.q) / (2 * h), middle.dq, rtol=1e-6, atol=1e-8)
    assert np.allclose((high.dq - low.dq) / (2 * h), middle.ddq, rtol=1e-6, atol=1e-6)


def test_joint_pieces_stay_on_the_straight_line(tilt_insert: Problem) -> None:
    from ssm_planner.kinematics.task import task_from_joints

    path = paths(tilt_insert)[0]
    phase = phase_along(path, tilt_insert, tilt_insert.robot)
    motion = solve_straight(phase, path, retime(path, tilt_insert.robot))
    trajectory = join_sections([("tilt", motion.breaks, motion.coefficients)])
    samples = trajectory.sample(np.linspace(0, trajectory.duration, 5000))
    task = task_from_joints(path.mechanism, samples.q)
    for k in (0, 2, 3):
        assert np.abs(task[:, k] - path.start[k]).max() < 1e-8
    assert check(trajectory, tilt_insert.robot).passed


@pytest.fixture(scope="module")
def small_move(tilt_insert: Problem) -> Problem:
    """Return a problem in which one joint moves far and the others move very little.

    The small displacements have sharp bends.
    """
    start = Task(roll=0.0, tilt=np.radians(-113), spin=0.0, depth=0.015)
    to = Task(roll=np.radians(2), tilt=np.radians(-113.05), depth=0.01501)
    return replace(tilt_insert, start=start, motion=(Free(to, name="free"),), objective="time")


def test_along_the_path_of_a_free_motion_there_is_hardly_a_faster_one(small_move: Problem) -> None:
    """The planner retimes the path of its motion, at full speed or slower, to the same duration."""
    planned = plan_motion(small_move)
    (phase,), trajectory = planned.phases, planned.trajectory
    assert trajectory is not None
    knots, signs = np.array([0.0, 1.0]), np.sign(np.diff(phase.phase.points, axis=0))
    mechanism = Mechanism.from_geometry(small_move.robot.geometry)
    for speed, tolerance in ((1.0, 1e-4), (0.4, 1e-3)):
        path = MotionPath(mechanism, trajectory.slower(speed), knots, signs)
        again = retime_motion(path, small_move.robot, small_move.task_limits)
        assert again.duration == pytest.approx(phase.duration, rel=tolerance)
