"""One motion is played under many frictions. The reference is a fake arm whose motion is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.robot import Robot
from ssm_planner.progress import Step
from ssm_planner.simulation import draws as module
from ssm_planner.simulation.draws import PROGRESS_INTERVAL, TIP_INTERVAL, Draws, play_draws
from ssm_planner.simulation.plant import MOTOR, Q, W
from ssm_planner.simulation.playback import CONTROLLED_STATE_SIZE, CURRENT, TRIP, Commands

CONSTANTS = {0: 0.5, 1: 2.0, 3: 0.1}
"""Torque constants of the driven joints, N·m/A."""
OFFSETS = np.array([1.0, 2.0, 3.0, 4.0])
START = np.array([0.3, 1.15, 0.1, -0.005])
COUNT, PERIODS = 3, 12


def commands() -> Commands:
    """Return commands whose demand of joint 1 is the index of the period."""
    zero = np.zeros((PERIODS, 4))
    demand = zero.copy()
    demand[:, 0] = np.arange(PERIODS)
    return Commands(demand, zero, zero, zero, zero, zero, np.ones(PERIODS))


def playback(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, moved: Any, halved: Any = None
) -> tuple[Draws, list[tuple[str, np.ndarray, np.ndarray]], list[Step]]:
    """Play the commands. Return the result, the calls (function, states, inputs), and the progress.

    `moved` changes the states, errors and saturations of a period in place.
    """
    calls: list[tuple[str, np.ndarray, np.ndarray]] = []

    def step(name: str) -> Any:
        def period(x: np.ndarray, inputs: np.ndarray) -> tuple[np.ndarray, ...]:
            calls.append((name, x.copy(), inputs.copy()))
            y, following, cut = x.copy(), np.zeros((COUNT, 4)), np.zeros((COUNT, 4))
            moved(len(calls) - 1, y, following, cut)
            return y, following, cut

        return period

    arm = SimpleNamespace(
        robot=robot,
        control_step=step("full"),
        control_step_in_halves=step("half"),
        half_step_periods=lambda told: np.zeros(PERIODS, dtype=bool) if halved is None else halved,
        torque_constants=[CONSTANTS.get(k, 0.0) for k in range(4)],
    )
    monkeypatch.setattr(module, "VectorisedFunction", lambda function: function)
    start, friction = (
        np.zeros(CONTROLLED_STATE_SIZE),
        np.outer(np.arange(1.0, COUNT + 1), np.ones(28)),
    )
    start[Q] = START
    said: list[Step] = []
    result = play_draws(
        arm,  # type: ignore[arg-type]
        start,
        commands(),
        offsets=OFFSETS,
        friction=friction,
        planned=np.tile(START, (PERIODS, 1)),
        tip_limit=1e-4,
        progress=said.append,
    )
    return result, calls, said


def test_every_period_passes_commands_offsets_and_frictions(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    def moved(m: int, x: np.ndarray, following: np.ndarray, cut: np.ndarray) -> None:
        x[:, MOTOR.start] += 1.0

    half = np.arange(PERIODS) == 4
    result, calls, said = playback(robot, monkeypatch, moved, half)
    assert [name for name, _, _ in calls] == ["half" if h else "full" for h in half]
    table = commands().table()
    for m, (_, x, inputs) in enumerate(calls):
        assert np.array_equal(x[:, MOTOR.start], np.full(COUNT, m))
        assert np.array_equal(x[:, Q], np.tile(START, (COUNT, 1)))
        assert np.array_equal(inputs[:, :25], np.tile(table[m], (COUNT, 1)))
        assert np.array_equal(inputs[:, 25:29], np.tile(OFFSETS, (COUNT, 1)))
        assert np.array_equal(inputs[:, 29:], result.friction)
    assert PERIODS < PROGRESS_INTERVAL
    assert said == [Step(f"playing {COUNT} frictions", 0, PERIODS)]


def test_a_result_is_the_largest_value_of_all_periods(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The largest absolute value counts. Each draw has a negative peak in a different period."""

    def moved(m: int, x: np.ndarray, following: np.ndarray, cut: np.ndarray) -> None:
        for draw in range(COUNT):
            peak = m == 3 * draw + 1
            x[draw, CURRENT] = -(draw + 1.0) if peak else 0.5
            following[draw] = -(draw + 2.0) if peak else 0.25
            cut[draw, 1] = float(draw == 1 and m == 2)
            x[draw, TRIP.start + 3] = float(draw == 2)

    result, _, _ = playback(robot, monkeypatch, moved)
    constants = [CONSTANTS.get(k, 0.0) for k in range(4)]
    assert result.peak_torque == pytest.approx(np.outer([1.0, 2.0, 3.0], constants))
    assert result.following_error == pytest.approx(np.outer([2.0, 3.0, 4.0], np.ones(4)))
    assert [list(row) for row in np.argwhere(result.saturated)] == [[1, 1]]
    assert [list(row) for row in np.argwhere(result.tripped)] == [[2, 3]]
    assert result.tip_limit == 1e-4
    assert result.tip_error.max() <= 1e-15


def test_the_tip_error_is_that_of_the_instants_that_are_evaluated(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tip leaves its plan for one period.

    The tip error is evaluated in this period for draw 2, and is not evaluated for draw 1.
    """
    instants = {1: TIP_INTERVAL + 1, 2: 2 * TIP_INTERVAL}
    away = START + [0.0, 0.0, 0.0, -1e-3]

    def moved(m: int, x: np.ndarray, following: np.ndarray, cut: np.ndarray) -> None:
        x[:, Q] = START
        for draw, instant in instants.items():
            if m + 1 == instant:
                x[draw, Q] = away

    result, _, _ = playback(robot, monkeypatch, moved)
    tips = tip_position(Mechanism.from_geometry(robot.geometry), np.array([START, away]))
    distance = np.linalg.norm(tips[1] - tips[0])
    assert result.tip_error == pytest.approx([0.0, 0.0, distance], abs=1e-12)


@pytest.mark.parametrize("motor", [0, 1, 3])
def test_one_motor_that_diverges_makes_the_tip_error_infinite(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, motor: int
) -> None:
    def moved(m: int, x: np.ndarray, following: np.ndarray, cut: np.ndarray) -> None:
        x[1, W.start + motor] = np.nan

    result, _, _ = playback(robot, monkeypatch, moved)
    assert np.isinf(result.tip_error).tolist() == [False, True, False]
    assert result.passed.tolist() == [True, False, True]
