"""The values, extremes and sign changes of Bernstein polynomials agree with NumPy's polynomials."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from ssm_planner.verification import bernstein as module
from ssm_planner.verification.bernstein import (
    find_group_maxima,
    find_sign_changes,
    from_powers,
    split_at_middle,
    to_powers,
)

S = np.linspace(0.0, 1.0, 4001)


@pytest.fixture(scope="module")
def powers() -> np.ndarray:
    """Return the power coefficients (30, 6) of random polynomials of degree 5."""
    return np.random.default_rng(5).normal(size=(30, 6)) * [1, 3, 8, 8, 8, 4]


def test_both_forms_have_the_same_values(powers: np.ndarray) -> None:
    coefficients = from_powers(powers)
    assert to_powers(coefficients) == pytest.approx(powers, abs=1e-12)
    left, right = split_at_middle(coefficients)
    for k, row in enumerate(powers):
        exact = Polynomial(row)
        assert polyval(0.3, powers[k]) == pytest.approx(exact(0.3))
        assert coefficients[k, [0, -1]] == pytest.approx([exact(0.0), exact(1.0)])
        assert left[k, [0, -1]] == pytest.approx([exact(0.0), exact(0.5)])
        assert right[k, [0, -1]] == pytest.approx([exact(0.5), exact(1.0)])
        assert polyval(0.5, to_powers(left[k : k + 1])[0]) == pytest.approx(exact(0.25))
        assert polyval(0.5, to_powers(right[k : k + 1])[0]) == pytest.approx(exact(0.75))


def test_maxima_are_those_of_a_dense_evaluation_at_the_argument_that_is_stated(
    powers: np.ndarray,
) -> None:
    """The result is the largest value of each group of three polynomials.

    A larger value that is already known ends the search.
    """
    coefficients = from_powers(powers).T.reshape(6, 10, 3).swapaxes(0, 1)
    dense = np.array([Polynomial(row)(S) for row in powers]).reshape(10, 3, -1)
    value, index, s = find_group_maxima(coefficients, np.full(10, 1e-9), np.full(10, -np.inf))
    assert value == pytest.approx(dense.max(axis=(1, 2)), abs=1e-4)
    assert np.all(value >= dense.max(axis=(1, 2)) - 1e-9)
    rows = powers[3 * np.arange(10) + index]
    assert [Polynomial(row)(x) for row, x in zip(rows, s, strict=True)] == pytest.approx(value)
    assert ((s > 0) & (s < 1)).any()
    known, _, _ = find_group_maxima(coefficients, np.full(10, 1e-9), np.full(10, 1e3))
    assert np.all(known <= value)


@pytest.mark.parametrize(
    ("coefficients", "value", "s"),
    [
        ([3.0, 2.0, 1.0], 3.0, 0.0),
        ([1.0, 2.0, 3.0], 3.0, 1.0),
        ([0.0, 1.0, 0.0], 0.5, 0.5),
        ([2.0, 2.0, 2.0], 2.0, 0.0),
    ],
)
def test_the_argument_of_a_maximum_is_its_end_or_inside(
    coefficients: list[float], value: float, s: float
) -> None:
    result = find_group_maxima(
        np.array(coefficients)[None, :, None], np.full(1, 1e-9), np.full(1, -9.0)
    )
    assert [float(x[0]) for x in result] == pytest.approx([value, 0.0, s], abs=1e-6)


@pytest.mark.parametrize("count", [3, 30])
def test_sign_changes_are_the_simple_roots_inside(powers: np.ndarray, count: int) -> None:
    """A few polynomials are bisected one by one, and many polynomials together."""
    assert (count <= module.MAX_SCALAR_POLYNOMIALS) == (count == 3)
    index, s = find_sign_changes(from_powers(powers[:count]), np.full(count, 1e-12))
    for k in range(count):
        roots = Polynomial(powers[k]).roots()
        real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
        assert s[index == k] == pytest.approx(real[(real > 0) & (real < 1)], abs=1e-9)
    assert np.all(np.diff(index) >= 0)


@pytest.mark.parametrize(
    ("roots", "expected"),
    [
        ([0.25], [0.25]),
        ([0.5], [0.5]),
        ([0.25, 0.5, 0.75], [0.25, 0.5, 0.75]),
        ([0.0, 0.5], [0.5]),
        ([0.5, 1.0], [0.5]),
        ([-0.5, 0.3], [0.3]),
        ([0.3, 1.5], [0.3]),
        ([-0.5, 1.5], []),
        ([0.3, 0.3, 0.3], [0.3]),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_zeros_at_the_ends_do_not_count(
    roots: list[float], expected: list[float], sign: float
) -> None:
    exact = sign * Polynomial.fromroots(roots)
    index, s = find_sign_changes(from_powers(exact.coef[None]), np.full(1, 1e-12))
    inside = s[(s > 1e-9) & (s < 1 - 1e-9)]
    assert np.unique(np.round(inside, 5)) == pytest.approx(expected, abs=2e-5)
    assert not index.any()


def test_values_within_the_tolerance_change_no_sign() -> None:
    coefficients = np.array([[-1.0, 1.0], [-0.1, 1.0], [-1.0, 0.1], [-0.1, 0.1]])
    index, s = find_sign_changes(coefficients, np.full(4, 0.2))
    assert index.tolist() == [0]
    assert s == pytest.approx([0.5])
    assert find_sign_changes(coefficients, np.full(4, 2.0))[0].size == 0
