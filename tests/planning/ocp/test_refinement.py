"""Refinement: the backoff of violated rows; what is not solved twice."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.planning.ocp import transcription as program
from ssm_planner.planning.ocp.refinement import BACKOFF, TOLERANCE, backoff_of
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.problem import Problem


@given(st.lists(st.floats(-1.0, 0.5), min_size=1, max_size=30))
def test_every_excess_is_tightened_by_more_than_itself_and_nothing_else(
    found: list[float],
) -> None:
    excess = np.array(found)[:, None]
    more = backoff_of(excess)
    assert more.shape == excess.shape
    assert np.all(more[excess > 0] >= BACKOFF * excess[excess > 0] + TOLERANCE)
    assert np.all(more[excess <= 0] == 0)


def test_the_same_program_is_not_solved_again(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = plan_motion(tilt_insert)
    solved: list[int] = []
    monkeypatch.setattr(program, "ipopt", lambda *_, **__: solved.append(1))
    again = plan_motion(tilt_insert)
    assert not solved
    assert np.array_equal(again.trajectory.coefficients, first.trajectory.coefficients)


def test_what_was_forgotten_is_solved_again_to_the_same_digits(tilt_insert: Problem) -> None:
    first = plan_motion(tilt_insert)
    program.forget_solutions()
    assert np.array_equal(
        plan_motion(tilt_insert).trajectory.coefficients, first.trajectory.coefficients
    )
