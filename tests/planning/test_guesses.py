"""The first guess of a free motion keeps velocity, acceleration and jerk limits of every joint."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.planning.ocp.mesh import closed_form_guess

LIMITS = np.array([[0.5, 0.5, 1.0, 0.01], [2.0, 1.0, 3.0, 0.05], [30.0, 20.0, 50.0, 1.0]])
ways = st.lists(st.just(0.0) | st.floats(1e-9, 1.2), min_size=4, max_size=4).filter(lambda way: max(way) > 1e-3)


def accelerations(way: np.ndarray, jerk: bool, count: int) -> np.ndarray:
    made = closed_form_guess(way, LIMITS, jerk, count, 2)
    return np.abs(made.states[2:]).max(axis=(0, 1))


@given(ways, st.booleans(), st.integers(8, 60))
def test_it_keeps_the_acceleration_limits(way: list[float], jerk: bool, count: int) -> None:
    way_ = np.array(way) * [1, -1, 1, -0.02]
    # a switch of one joint within an element of another may add half an element's rise
    assert np.all(accelerations(way_, jerk, count) <= 2 * LIMITS[1])


def test_a_switch_in_the_very_middle_of_an_element() -> None:
    """Joint 2 cannot keep step with a leader that cruises, and turns from speeding up to braking at half time."""
    for count in range(9, 40, 2):
        assert np.all(accelerations(np.array([-0.4, 0.24, 0.01, 0.0]), False, count) <= LIMITS[1] * (1 + 1e-9))
