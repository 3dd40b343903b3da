"""Verify free motions from rest to rest that are faster because joints reverse between points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ssm_planner.pipeline.run import plan
from ssm_planner.planning.ocp.nlp import NlpSolution
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.planner import plan_motion
from ssm_planner.planning.reversals import MULTIPLIER_TOLERANCE, suggest_reversals
from ssm_planner.problem.limits import TaskRange, TaskRate, TipSpeed
from ssm_planner.problem.motion import Free, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot

Weaker = Callable[[Robot, float], Robot]
WithJerk = Callable[[Robot, float, float], Robot]
DEPTH = TaskRange("depth", 0.0, 0.03)


def free(
    base: Problem, start: tuple[float, ...], to: dict[str, float], *limits: Any, **changes: Any
) -> Problem:
    """Return a problem with one free motion between task positions in deg and mm."""
    roll, tilt, spin = np.radians(start[:3])
    target = {
        name: 1e-3 * value if name == "depth" else float(np.radians(value))
        for name, value in to.items()
    }
    return replace(
        base,
        start=Task(roll=roll, tilt=tilt, spin=spin, depth=1e-3 * start[3]),
        motion=(Free(Task(**target)),),
        limits=(DEPTH, *limits),
        **{"objective": "time", **changes},
    )


def without(problem: Problem) -> float:
    """Return the duration in s of the motion without added reversals."""
    return plan_motion(problem, may_reverse=False).phases[0].duration


def test_the_tool_is_drawn_back_to_swing_faster(tilt_insert: Problem) -> None:
    """Reversals shorten the motion by at least 6.5 %.

    The chord between the two tip positions gives the lower bound. Without reversals, the motion
    takes longer than the arc at constant depth.
    """
    speed = 0.02
    problem = free(tilt_insert, (-30, -100, 0, 28), {"roll": 30}, TipSpeed(speed))
    result = plan(problem)
    assert result.passed
    radius = 0.028 * abs(np.sin(np.radians(100)))
    chord, arc = radius / speed, radius * np.pi / 3 / speed
    assert chord < result.duration
    assert result.lower_bound == pytest.approx(chord, rel=1e-9)
    left = result.phases[0].reversal_multiplier
    multiplier = plan_motion(problem, may_reverse=False).phases[0].motion.reversal_multiplier
    assert left is not None
    assert multiplier is not None
    assert max(left, MULTIPLIER_TOLERANCE) < multiplier
    assert without(problem) > arc
    assert result.duration < 0.935 * without(problem)
    q = result.trajectory.uniform(200.0).q
    depth = -q[:, 3]
    assert depth.min() < 0.026
    assert depth[[0, -1]] == pytest.approx(0.028, abs=1e-12)
    # Tilt swings to both sides. A program without fixed directions finds 1.4817 s.
    assert q[:, 1].max() > q[0, 1] + 0.02
    assert q[:, 1].min() < q[0, 1] - 0.02
    assert result.duration < 1.002 * 1.4817


def test_ipopt_confirms_the_motion_alone_that_is_taken(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ipopt does not confirm the motion without reversals, which is slower."""
    confirmed: list[NlpSolution] = []
    solve = Transcription.solve

    def noted(self: Transcription, *given: Any, **named: Any) -> NlpSolution:
        confirmed.append(solve(self, *given, **named))
        return confirmed[-1]

    monkeypatch.setattr(Transcription, "solve", noted)
    planned = plan_motion(
        free(tilt_insert, (-30, -100, 0, 28), {"roll": 30}, TipSpeed(0.02))
    ).phases[0]
    assert len(planned.motion.border_instants) > len(planned.phase.points)
    assert [own.iterations <= 2 for own in confirmed] == [True]


def test_other_objectives_turn_at_the_same_places(tilt_insert: Problem) -> None:
    """Reversals also allow the least heat, and a duration that no motion without them can keep."""
    problem = free(tilt_insert, (-30, -100, 0, 28), {"roll": 30}, TipSpeed(0.02))
    fastest = plan(problem).duration
    cooler = plan(replace(problem, objective="time then heat"))
    assert cooler.passed
    assert fastest <= cooler.duration <= 1.0015 * fastest
    duration = 1.03 * fastest
    timed = plan(replace(problem, motion=(replace(problem.motion[0], duration=duration),)))  # type: ignore[call-arg]
    assert timed.passed
    assert timed.duration == pytest.approx(duration, rel=1e-9)


def test_weak_motors_are_spared_by_a_joint_that_turns_back(
    tilt_insert: Problem, weaker: Weaker
) -> None:
    """With weak motors, a reversal makes the motion at least 6 % faster."""
    robot = weaker(tilt_insert.robot, 0.35)
    problem = free(tilt_insert, (0, -85, 0, 0), {"tilt": -135}, robot=robot)
    result = plan(problem)
    assert result.passed
    assert without(problem) > 1.06 * result.duration


def test_with_jerk_limits(tilt_insert: Problem, with_jerk: WithJerk) -> None:
    robot = with_jerk(tilt_insert.robot, 60.0, 2.0)
    problem = free(tilt_insert, (-30, -100, 0, 28), {"roll": 30}, TipSpeed(0.012), robot=robot)
    result = plan(problem)
    assert result.passed
    assert result.lower_bound < result.duration < 0.97 * without(problem)


def test_a_joint_that_moves_takes_a_run_up_and_overshoots(tilt_insert: Problem) -> None:
    """The joint runs up and overshoots, and the plan is as fast as one without fixed directions.

    The program `tests/benchmarks/direction_free.py`, which has no fixed directions, finds 0.9756 s.
    """
    to = {"roll": 7.4, "tilt": -101.3, "spin": -13.6, "depth": 19.7}
    problem = free(tilt_insert, (-8.8, -116.5, -10, 27.7), to, TipSpeed(0.0135))
    result = plan(problem)
    assert result.passed
    assert without(problem) > 1.02 * result.duration
    assert result.duration < 1.001 * 0.9756
    roll = result.trajectory.uniform(400.0).q[:, 0]
    assert roll.max() > roll[0] + 0.01
    assert roll.min() < roll[-1] - 0.01


@pytest.mark.parametrize("planner", ["optimal", "fast"])
def test_turning_joints_stay_in_their_range(tilt_insert: Problem, planner: Any) -> None:
    """If its range is too narrow for the fastest motion, joint 1 stays within the range.

    The motion is slower than the fastest one, but faster than without reversals.
    """
    to = {"roll": 7.4, "tilt": -101.3, "spin": -13.6, "depth": 19.7}
    problem = free(tilt_insert, (-8.8, -116.5, -10, 27.7), to, TipSpeed(0.0135))
    free_to_turn = plan(problem)
    q = free_to_turn.trajectory.uniform(400.0).q[:, 0]
    low, high = q.min() + 0.01, q.max() - 0.01
    first, *others = problem.robot.joints
    robot = replace(problem.robot, joints=(replace(first, position=(low, high)), *others))
    result = plan(replace(problem, robot=robot, planner=planner))
    assert result.passed
    roll = result.trajectory.uniform(400.0).q[:, 0]
    assert low <= roll.min()
    assert roll.max() <= high
    assert free_to_turn.duration < result.duration < without(problem)


@pytest.mark.slow
def test_without_the_compiled_part_joints_turn_back_too(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the compiled part, the multipliers of Ipopt show where joints should reverse."""
    monkeypatch.setenv("SSM_PLANNER_NATIVE", "0")
    problem = free(tilt_insert, (-30, -100, 0, 28), {"roll": 30}, TipSpeed(0.012))
    result = plan_motion(problem)
    assert result.trajectory is not None
    assert result.trajectory.duration < 0.97 * without(problem)


@pytest.mark.parametrize("native", ["1", "0"])
def test_a_direction_is_opened_where_its_multiplier_says_so(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch, native: str
) -> None:
    """The multipliers suggest reversals of tilt and depth under a tip-speed limit, but not of roll.

    The multipliers belong to the optimum and do not depend on the solver.
    """
    monkeypatch.setenv("SSM_PLANNER_NATIVE", native)
    problem = free(tilt_insert, (-30, -100, 0, 28), {"roll": 30}, TipSpeed(0.012))
    planned = plan_motion(problem, may_reverse=False).phases[0]
    multipliers = planned.motion.direction_multipliers
    assert multipliers is not None
    roll, tilt, spin, depth = np.abs(multipliers.values).sum(axis=0)
    assert max(roll, spin) < MULTIPLIER_TOLERANCE
    assert min(tilt, depth) > 100 * MULTIPLIER_TOLERANCE
    # A joint that stands still must return to its position, so the mean of its multipliers is 0.
    # Averaging over the elements causes a small difference.
    assert np.abs(multipliers.values.sum(axis=0))[[1, 3]] == pytest.approx([0, 0], abs=0.1 * tilt)
    reversals = suggest_reversals(planned.phase, planned.motion)
    assert reversals is not None
    assert reversals.directions is not None
    assert np.all(reversals.directions[:, 0] == 1)
    # The tool retracts first, and q4 is −depth.
    assert np.all(reversals.directions[[0, -1], 3] == (1, -1))


def test_a_motion_states_the_largest_multiplier_that_remains(tilt_insert: Problem) -> None:
    """The multiplier that remains with reversals is less than 5 % of that without reversals."""
    to = {"roll": 7.4, "tilt": -101.3, "spin": -13.6, "depth": 19.7}
    problem = free(tilt_insert, (-8.8, -116.5, -10, 27.7), to, TipSpeed(0.0135))
    direct, turned = (
        plan_motion(problem, may_reverse=turning).phases[0].motion.reversal_multiplier
        for turning in (False, True)
    )
    assert direct is not None
    assert turned is not None
    assert turned < 0.05 * direct


def test_a_joint_goes_back_and_forth_for_the_rate_of_spin(tilt_insert: Problem) -> None:
    """The motion takes the lower bound, which is the time of joint 2 alone.

    A straight motion takes 2.149 s, and a motion without reversals takes 5.2 s.
    """
    rate = TaskRate("spin", float(np.radians(5)))
    result = plan(free(tilt_insert, (0, -85, 0, 0), {"tilt": -135}, rate))
    assert result.passed
    assert result.duration == pytest.approx(result.lower_bound, rel=1e-4)


@pytest.mark.parametrize(
    ("to", "limits"), [({"roll": 20, "depth": 5}, ()), ({"tilt": -95}, (TipSpeed(0.02),))]
)
def test_useless_reversals_do_not_change_the_motion(
    tilt_insert: Problem, to: dict[str, float], limits: Any
) -> None:
    """If reversals do not shorten the motion, the plan is the one without reversals."""
    problem = free(tilt_insert, (-5, -120, 0, 15), to, *limits)
    turning, plain = (plan_motion(problem, may_reverse=turning) for turning in (True, False))
    assert turning.trajectory is not None
    assert plain.trajectory is not None
    assert np.array_equal(turning.trajectory.coefficients, plain.trajectory.coefficients)
