"""Verify the mesh and the initial guess of a free motion.

The guess keeps the acceleration limit of every joint.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.planning.ocp.guesses import guess_between
from ssm_planner.planning.ocp.mesh import MIN_ELEMENTS_PER_ARC, _element_ends
from ssm_planner.planning.ocp.segments import SegmentGuess

LIMITS = np.array([[0.5, 0.5, 1.0, 0.01], [2.0, 1.0, 3.0, 0.05], [30.0, 20.0, 50.0, 1.0]])
START = np.array([0.1, -0.2, 0.3, -0.001])
ways = st.lists(st.just(0.0) | st.floats(1e-9, 1.2), min_size=4, max_size=4).filter(
    lambda way: max(way) > 1e-3
)


def accelerations(way: np.ndarray, jerk: bool, count: int) -> np.ndarray:
    """Return the largest acceleration of each joint in the guess, (4,)."""
    result = guess_of(way, jerk, count).elements
    return np.abs([result.a0, result.a1]).max(axis=(0, 1))


def guess_of(way: np.ndarray, jerk: bool, count: int) -> SegmentGuess:
    """Return the guess from rest to rest, with or without jerk limits."""
    limits = LIMITS if jerk else np.vstack([LIMITS[:2], np.full(4, np.inf)])
    speeds = np.zeros((2, 4))
    return guess_between(START, way, speeds, limits, count=count).guesses[0]


@given(ways, st.booleans(), st.integers(8, 60))
def test_it_keeps_the_acceleration_limits(way: list[float], jerk: bool, count: int) -> None:
    way_ = np.array(way) * [1, -1, 1, -0.02]
    # If one joint switches within an element of another joint, its acceleration may be larger.
    assert np.all(accelerations(way_, jerk, count) <= 2 * LIMITS[1])


def test_a_switch_in_the_very_middle_of_an_element() -> None:
    """Joint 2 changes from acceleration to braking at half time, in the middle of an element.

    It cannot move in proportion to the leading joint, which moves at constant speed then.
    """
    for count in range(9, 40, 2):
        assert np.all(
            accelerations(np.array([-0.4, 0.24, 0.01, 0.0]), False, count) <= LIMITS[1] * (1 + 1e-9)
        )


@given(
    ways.filter(lambda way: way[3] > 1e-6), st.floats(0.0, 1.0), st.booleans(), st.integers(8, 60)
)
def test_its_halves_meet_where_one_joint_passes_a_place(
    way: list[float], share: float, jerk: bool, count: int
) -> None:
    """The two halves of a guess meet where one joint passes a given position."""
    way_ = np.array(way) * [1, -1, 1, -0.02]
    whole = guess_of(way_, jerk, count)
    place = START[3] + share * way_[3]
    first, second = whole.divided_at_position(3, place)
    duration = first.motion.duration
    assert duration == pytest.approx(second.motion.duration)
    assert 2 * duration == pytest.approx(whole.motion.duration)
    middle = second.elements.u[0]
    # The position is interpolated between nodes, so its error is of second order in their distance.
    assert middle[3] == pytest.approx(place, abs=4 / count**2 * abs(way_[3]))
    assert np.array_equal(first.elements.u[0], START)
    for half, reached in ((first, middle), (second, START + way_)):
        assert sum(half.arcs) == len(half.motion.breaks) - 1 == len(half.elements.u)
        end = half.elements.end[0][-1]
        # The error of the guess is of second order in the length of an element.
        assert np.abs(end - reached)[:3].max() <= 4 / count**2 * np.abs(way_).max()
        assert (np.diff(half.elements.u[:, 3]) * way_[3] >= -1e-12).all()


@given(
    st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=12).map(
        lambda lengths: np.cumsum([0, *lengths])
    ),
    st.integers(20, 120),
)
def test_arcs_get_elements_of_equal_length_in_proportion_to_their_own(
    borders: np.ndarray, count: int
) -> None:
    ends = _element_ends(borders, count)
    assert (ends[0], ends[-1]) == (borders[0], borders[-1])
    assert len(ends) - 1 == max(count, MIN_ELEMENTS_PER_ARC * (len(borders) - 1))
    sizes = np.diff([np.argmin(np.abs(ends - border)) for border in borders])
    assert sizes.min() >= MIN_ELEMENTS_PER_ARC
    shares = np.diff(borders) / borders[-1] * (len(ends) - 1 - MIN_ELEMENTS_PER_ARC * len(sizes))
    assert np.abs(sizes - MIN_ELEMENTS_PER_ARC - shares).max() < 1 + 1e-5
    for start, end, n in zip(borders[:-1], borders[1:], sizes, strict=True):
        inside = ends[(ends >= start) & (ends < end)]
        np.testing.assert_allclose(inside, start + (end - start) * np.arange(n) / n, atol=1e-12)
