"""Verify the objectives: time, time then heat, and effort in a given time.

The motor model, integrated by Gauss quadrature, gives the reference for heat and effort.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.problem.limits import TaskRange
from ssm_planner.problem.motion import Dwell, Free, Joints, Motion, Straight
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Samples, Trajectory
from ssm_planner.typing import Array

WithJerk = Callable[[Robot, float, float], Robot]

FIRST = (-0.5, 0.6, 0.0, 0.0)
FREE = Free(Joints((0.3, -0.2, 0.5, -0.015)))
STRAIGHT = Straight(**{"roll": 0.2, "tilt": -2.1, "depth": 0.01}, name="straight")
THROUGH = dataclasses.replace(FREE, through=(Joints((0.1, 0.7, 0.3, 0.0)),))
MOTIONS = {"free": FREE, "straight": STRAIGHT, "through": THROUGH}


def moving(problem: Problem, *motions: Motion, **changes: Any) -> Problem:
    """Return a problem with these motions from the joint positions FIRST."""
    limits = (TaskRange("depth", 0.0, 0.03),)
    return dataclasses.replace(
        problem, start=Joints(FIRST), motion=motions, limits=limits, **changes
    )


def torques(robot: Robot, samples: Samples, direction: Array) -> Array:
    """Return the motor torques of samples, (n, 4) in N m."""
    still = np.zeros_like(direction, dtype=bool)
    return motor_motion(robot, RigidBody.from_robot(robot), samples, direction, still).torque


def integral(trajectory: Trajectory, robot: Robot, of: Callable[[Samples, Array], Array]) -> float:
    """Return ∫ Σ (torque / nominal torque)² dt in s, by Gauss quadrature in every piece.

    The function `of` returns torques (n, 4) in N m from samples and directions.
    """
    nodes, weights = np.polynomial.legendre.leggauss(8)
    lengths = np.diff(trajectory.breaks)
    piece = np.repeat(np.arange(len(lengths)), len(nodes))
    samples = trajectory.sample_pieces(
        piece, np.tile((nodes + 1) / 2, len(lengths)) * lengths[piece]
    )
    nominal = np.array(
        [joint.motor.nominal_torque if joint.motor else np.inf for joint in robot.joints]
    )
    rate = np.nansum((of(samples, motion_directions(robot, samples, 1)[0]) / nominal) ** 2, axis=1)
    return float(np.sum(rate * np.tile(weights / 2, len(lengths)) * lengths[piece]))


def heat(trajectory: Trajectory, robot: Robot) -> float:
    """Return the heat of a motion, the integral of its squared relative torques in s."""
    return integral(
        trajectory, robot, lambda samples, direction: torques(robot, samples, direction)
    )


def effort(trajectory: Trajectory, robot: Robot) -> float:
    """Return the integral of the torques beyond those of an infinitely slow motion."""

    def beyond(samples: Samples, direction: Array) -> Array:
        slow = dataclasses.replace(samples, qd=0 * samples.qd, qdd=0 * samples.qdd)
        return torques(robot, samples, direction) - torques(robot, slow, direction)

    return integral(trajectory, robot, beyond)


def stretched(trajectory: Trajectory, factor: float) -> Trajectory:
    """Return the same motion in `factor` times its time."""
    powers = factor ** -np.arange(6.0)
    return Trajectory(trajectory.breaks * factor, trajectory.coefficients * powers[:, None], ())


@pytest.mark.parametrize("jerk", [False, True])
@pytest.mark.parametrize("kind", MOTIONS)
def test_hardly_longer_and_no_hotter(
    tilt_insert: Problem, with_jerk: WithJerk, kind: str, jerk: bool
) -> None:
    """The motion with less heat is no hotter, and at most 0.1 % longer than the fastest one."""
    robot = with_jerk(tilt_insert.robot, 35.0, 1.0) if jerk else tilt_insert.robot
    problem = moving(tilt_insert, MOTIONS[kind], robot=robot)
    fastest = plan(dataclasses.replace(problem, objective="time"))
    coolest = plan(dataclasses.replace(problem, objective="time then heat"))
    assert fastest.passed
    assert coolest.passed
    assert (
        fastest.duration * (1 - 1e-6) <= coolest.duration <= 1.001 * fastest.duration * (1 + 1e-6)
    )
    ratio = heat(coolest.trajectory, robot) / heat(fastest.trajectory, robot)
    # In a free motion, the joints that do not limit the time can reduce the heat.
    assert ratio <= (1 + 1e-6 if kind == "straight" else 0.999)


def test_time_then_heat_is_what_a_problem_gets_unless_it_says_otherwise(
    tilt_insert: Problem,
) -> None:
    default = {field.name: field.default for field in dataclasses.fields(Problem)}["objective"]
    assert default == "time then heat"


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_given_duration_is_taken_with_less_effort_than_the_fastest_motion_stretched(
    tilt_insert: Problem, kind: str
) -> None:
    fastest = plan(moving(tilt_insert, MOTIONS[kind], objective="time"))
    duration = 1.4 * fastest.duration
    result = plan(moving(tilt_insert, MOTIONS[kind], objective="effort", duration=duration))
    assert result.passed
    assert result.duration == pytest.approx(duration, rel=1e-9)
    robot = tilt_insert.robot
    same = stretched(fastest.trajectory, 1.4)
    assert same.duration == pytest.approx(duration)
    assert effort(result.trajectory, robot) < 0.9 * effort(same, robot)


def test_effort_falls_faster_than_time_grows(tilt_insert: Problem) -> None:
    """The effort of viscous friction decreases as 1/T, and that of inertia as 1/T³."""
    products = []
    for duration in (1.1, 1.4, 2.0, 4.0):
        motion = dataclasses.replace(FREE, duration=duration)
        result = plan(moving(tilt_insert, motion, objective="effort"))
        assert result.passed
        assert result.duration == pytest.approx(duration, rel=1e-9)
        products.append(duration * effort(result.trajectory, tilt_insert.robot))
    assert all(shorter > 1.005 * longer for shorter, longer in pairwise(products))


def test_a_duration_of_the_whole_is_shared_by_the_motions_that_have_none(
    tilt_insert: Problem,
) -> None:
    timed = dataclasses.replace(STRAIGHT, duration=3.0)
    motions = FREE, Dwell(0.25), timed
    result = plan(moving(tilt_insert, *motions, duration=5.0))
    assert result.passed
    assert result.duration == pytest.approx(5.0, rel=1e-9)
    assert [phase.duration for phase in result.phases] == pytest.approx([1.75, 0.25, 3.0], rel=1e-9)


def test_two_motions_share_it_by_their_fastest_times(tilt_insert: Problem) -> None:
    fastest = plan(moving(tilt_insert, FREE, STRAIGHT, objective="time"))
    result = plan(
        moving(tilt_insert, FREE, STRAIGHT, objective="effort", duration=2 * fastest.duration)
    )
    assert result.passed
    assert result.duration == pytest.approx(2 * fastest.duration, rel=1e-9)
    for phase, fast in zip(result.phases, fastest.phases, strict=True):
        assert phase.duration == pytest.approx(2 * fast.duration, rel=1e-6)


def test_the_shortest_possible_duration_may_be_asked_for_and_nothing_less(
    tilt_insert: Problem,
) -> None:
    fastest = plan(moving(tilt_insert, STRAIGHT, objective="time")).duration
    just = plan(moving(tilt_insert, STRAIGHT, objective="effort", duration=1.0001 * fastest))
    assert just.passed
    assert just.duration == pytest.approx(1.0001 * fastest, rel=1e-9)
    less = plan(moving(tilt_insert, STRAIGHT, objective="effort", duration=0.999 * fastest))
    assert (less.status, less.reason.constraint) == ("infeasible", "duration")
    assert less.reason.required == pytest.approx(fastest, rel=1e-6)
    assert less.reason.available == pytest.approx(0.999 * fastest)


def test_without_the_least_effort_any_motion_that_takes_as_long_does(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the minimisation of effort fails, the plan is another motion with the given duration."""
    solve = Transcription.solve

    def no_effort(self: Transcription, *arguments: Any, **named: Any) -> Any:
        answer = solve(self, *arguments, **named)
        return (
            dataclasses.replace(answer, message="Maximum_Iterations_Exceeded")
            if self.element.aim == "effort"
            else answer
        )

    monkeypatch.setattr(Transcription, "solve", no_effort)
    result = plan(moving(tilt_insert, dataclasses.replace(FREE, duration=4.0)))
    assert result.passed
    assert result.duration == pytest.approx(4.0, rel=1e-9)
