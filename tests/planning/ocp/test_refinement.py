"""Verify the backoff of violated rows, and that a repeated plan has the same digits."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.planning.ocp.refinement import BACKOFF_FACTOR, LIMIT_TOLERANCE, additional_backoff
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.problem import Problem


@given(st.lists(st.floats(-1.0, 0.5), min_size=1, max_size=30))
def test_every_excess_is_tightened_by_more_than_itself_and_nothing_else(
    found: list[float],
) -> None:
    excess = np.array(found)[:, None]
    more = additional_backoff(excess)
    assert more.shape == excess.shape
    assert np.all(more[excess > 0] >= BACKOFF_FACTOR * excess[excess > 0] + LIMIT_TOLERANCE)
    assert np.all(more[excess <= 0] == 0)


def test_the_same_problem_is_solved_to_the_same_digits(tilt_insert: Problem) -> None:
    first = plan_motion(tilt_insert)
    assert np.array_equal(
        plan_motion(tilt_insert).trajectory.coefficients, first.trajectory.coefficients
    )
