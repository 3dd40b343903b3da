"""The solutions of the Paden–Kahan subproblems are exact where an exact solution exists.

Elsewhere they are least-squares solutions. Degenerate cases give finite results.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.rotations import rotation
from tests.support.paden_kahan import subproblem_1, subproblem_2, subproblem_3_prime

angles = st.floats(-math.pi, math.pi)
seeds = st.integers(0, 2**32 - 1)


def unit(rng: np.random.Generator, *shape: int) -> np.ndarray:
    vectors = rng.standard_normal((*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def turn(omega, theta, vector):
    return np.einsum("...ij,...j->...i", rotation(omega, theta), vector)


@settings(max_examples=200, deadline=None)
@given(seeds, angles)
def test_subproblem_1_recovers_the_rotation(seed, theta):
    rng = np.random.default_rng(seed)
    omega, p = unit(rng), rng.standard_normal(3)
    q = turn(omega, theta, p)
    assert np.abs(turn(omega, subproblem_1(omega, p, q), p) - q).max() < 1e-14 * (
        1.0 + np.linalg.norm(p)
    )


@settings(max_examples=50, deadline=None)
@given(seeds)
def test_subproblem_1_is_the_least_squares_rotation(seed):
    rng = np.random.default_rng(seed)
    omega, p, q = unit(rng), rng.standard_normal(3), rng.standard_normal(3)
    miss = np.linalg.norm(turn(omega, subproblem_1(omega, p, q), p) - q)
    sweep = turn(omega, np.linspace(-math.pi, math.pi, 2001), p) - q
    assert miss <= np.linalg.norm(sweep, axis=-1).min() + 1e-12


def test_subproblem_1_on_its_axis_turns_nothing():
    axis = np.array([0.0, 0.6, 0.8])
    assert subproblem_1(axis, axis, [1.0, 0.0, 0.0]) == 0.0
    assert subproblem_1(axis, [1.0, 0.0, 0.0], 2.0 * axis) == pytest.approx(0.0, abs=1e-15)


@settings(max_examples=300, deadline=None)
@given(seeds, angles, angles)
def test_subproblem_2_finds_both_solutions(seed, theta1, theta2):
    rng = np.random.default_rng(seed)
    omega1, omega2, p = unit(rng), unit(rng), unit(rng)
    q = turn(omega1, theta1, turn(omega2, theta2, p))
    first, second, count = subproblem_2(omega1, omega2, p, q)
    assert count in (1, 2)
    for k in range(2):
        assert np.abs(turn(omega1, first[k], turn(omega2, second[k], p)) - q).max() < 1e-13
    gap = np.remainder(second - theta2 + math.pi, 2.0 * math.pi) - math.pi
    assert np.abs(gap).min() < 1e-6


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_subproblem_2_is_least_squares_out_of_reach(seed):
    rng = np.random.default_rng(seed)
    omega1, omega2, p, q = unit(rng), unit(rng), unit(rng), unit(rng)
    first, second, _count = subproblem_2(omega1, omega2, p, q)
    miss = np.linalg.norm(turn(omega1, first, turn(omega2, second, p)) - q, axis=-1)
    grid = np.linspace(-math.pi, math.pi, 181)
    places = np.einsum("aij,bj->abi", rotation(omega1, grid), turn(omega2, grid, p))
    assert miss.max() <= np.linalg.norm(places - q, axis=-1).min() + 1e-12


def test_subproblem_2_counts_two_one_and_none():
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    # The tool is 0.5 rad from y, so |φ| lies in [π/2 − 0.5, π/2 + 0.5].
    tool = np.array([math.sin(0.5), math.cos(0.5), 0.0])
    for phi, expected in (
        (math.pi / 2, 2),
        (math.pi / 2 + 0.5, 1),
        (math.pi / 2 - 0.5, 1),
        (0.3, 0),
        (3.0, 0),
    ):
        q = np.array([math.cos(phi), 0.0, math.sin(phi)])
        _, theta2, count = subproblem_2(x, y, tool, q)
        assert count == expected
        assert (abs(math.sin((theta2[0] - theta2[1]) / 2.0)) > 1e-6) == (expected == 2)


@settings(max_examples=300, deadline=None)
@given(seeds, st.floats(-10.0, 10.0))
def test_subproblem_3_prime_finds_the_translation(seed, theta):
    rng = np.random.default_rng(seed)
    v, p, q = unit(rng), rng.standard_normal(3), rng.standard_normal(3)
    delta = np.linalg.norm(q - p - v * theta)
    solutions, count = subproblem_3_prime(v, p, q, delta)
    assert count >= 1
    assert (
        np.abs(np.linalg.norm(q - p - solutions[:, np.newaxis] * v, axis=-1) - delta).max() < 1e-6
    )
    assert np.abs(solutions - theta).min() < 1e-6


def test_subproblem_3_prime_counts_two_one_and_none():
    v, q = np.array([0.0, 0.0, 1.0]), np.array([3.0, 0.0, 7.0])
    solutions, count = subproblem_3_prime(v, np.zeros(3), q, np.array([5.0, 3.0, 1.0]))
    assert count.tolist() == [2, 1, 0]
    assert np.array_equal(solutions, [[11.0, 3.0], [7.0, 7.0], [7.0, 7.0]])
    solutions, count = subproblem_3_prime(v, np.zeros(3), np.zeros(3), 0.0)
    assert count == 1
    assert np.array_equal(solutions, [0.0, 0.0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: subproblem_1([0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]), "omega .*unit"),
        (
            lambda: subproblem_1([0.0, 0.0, math.nan], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
            "omega .*unit",
        ),
        (lambda: subproblem_1([0.0, 0.0, 1.0], [1.0, 0.0], [1.0, 0.0, 0.0]), r"p has shape \(2,\)"),
        (
            lambda: subproblem_1([0.0, 0.0, 1.0], np.zeros((2, 3)), np.zeros((3, 3))),
            "shapes do not fit together",
        ),
        (
            lambda: subproblem_2([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], np.zeros(3), [1.0, 0.0, 0.0]),
            "p of shape",
        ),
        (lambda: subproblem_3_prime([0.0, 0.0, 1.0], np.zeros(3), np.zeros(3), -1.0), "delta"),
    ],
)
def test_bad_arguments_are_named(call, message):
    with pytest.raises(GeometryError, match=message):
        call()
