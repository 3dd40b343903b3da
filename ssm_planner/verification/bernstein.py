"""Exact extremes and sign changes of many polynomials on [0, 1], by their Bernstein coefficients.

A polynomial lies between its smallest and its largest Bernstein coefficient. It starts at the first
coefficient and ends at the last. It has at most as many roots as the coefficients have sign changes
(Farouki, The Bernstein polynomial basis: a centennial retrospective, 2012). When the interval is
halved, the coefficients converge to the polynomial quadratically.

Arrays are (m, n + 1, …) for m polynomials with n + 1 coefficients each. Operations are fastest if
the m values of one coefficient are adjacent in memory (Fortran order). The results have this order.
"""

from math import comb

import numpy as np
from numpy.polynomial.polynomial import polyval

from ssm_planner.typing import Array, Indices

MAX_HALVINGS = 48
"""Number of halvings after which an interval counts as a point."""
BISECTION_STEPS = 54
"""Number of bisections of an interval with one zero."""
MAX_SCALAR_POLYNOMIALS = 8
"""Number of polynomials up to which Python floats are faster than arrays."""


def from_powers(powers: Array) -> Array:
    """Return Bernstein coefficients of the polynomials Σ powers[:, k] s^k.

    Parameters
    ----------
    powers : (m, n + 1, …) array
        Coefficients of the powers.

    Returns
    -------
    (m, n + 1, …) array
        b_j = Σ_i C(j, i)/C(n, i) · a_i (Farouki 2012).
    """
    degree = powers.shape[1] - 1
    scale = np.array([1 / comb(degree, i) for i in range(degree + 1)])
    coefficients = powers * scale.reshape(-1, *(1,) * (powers.ndim - 2))
    # Pascal's triangle gives Σ_i C(j, i) a_i. A matrix product is slower: it starts threads.
    for row in range(1, degree + 1):
        coefficients[:, row:] += coefficients[:, row - 1 : -1].copy(order="K")
    return coefficients


def to_powers(coefficients: Array) -> Array:
    """Return the power coefficients of polynomials.

    Parameters
    ----------
    coefficients : (m, n + 1) array
        Bernstein coefficients b_j.

    Returns
    -------
    (m, n + 1) array
        a_i = C(n, i) Δⁱ b_0, with the forward differences Δ (Farouki 2012).
    """
    degree = coefficients.shape[1] - 1
    powers = coefficients.copy(order="K")
    for row in range(degree, 0, -1):
        for j in range(row, degree + 1):
            powers[:, j] -= powers[:, j - 1]
    return powers * np.array([comb(degree, i) for i in range(degree + 1)], dtype=float)


def split_at_middle(coefficients: Array) -> tuple[Array, Array]:
    """Divide polynomials at the middle of the interval by de Casteljau's algorithm.

    Parameters
    ----------
    coefficients : (m, n + 1) array
        Bernstein coefficients on [0, 1].

    Returns
    -------
    left_half, right_half : (m, n + 1) arrays
        Bernstein coefficients of the same polynomials on [0, 1/2] and on [1/2, 1].
    """
    row = coefficients.T
    left_half = [coefficients[:, 0]]
    right_half = [coefficients[:, -1]]
    while len(row) > 1:
        row = (row[1:] + row[:-1]) / 2
        left_half.append(row[0])
        right_half.append(row[-1])
    return np.stack(left_half).T, np.stack(right_half[::-1]).T


def find_group_maxima(
    coefficients: Array, tolerance: Array, threshold: Array
) -> tuple[Array, Indices, Array]:
    """Find the largest value on [0, 1] in each of k groups of m polynomials.

    The intervals are halved. An interval is dropped when its Bernstein coefficients show that it
    contains no larger value.

    Parameters
    ----------
    coefficients : (k, n + 1, m) array
        Bernstein coefficients.
    tolerance : (k,) array
        Absolute accuracy of the values.
    threshold : (k,) array
        Values that the caller already has. A result that does not exceed its threshold may be
        inexact.

    Returns
    -------
    value, polynomial, s : (k,) arrays
        The largest value, the index of its polynomial, and its argument.
    """
    ends = np.maximum(coefficients[:, 0], coefficients[:, -1])
    index = np.argmax(ends, axis=1)
    groups = np.arange(len(ends))
    maximum = ends[groups, index]
    argument = np.where(coefficients[groups, 0, index] >= maximum, 0.0, 1.0)
    bar = np.maximum(maximum, threshold) + tolerance
    group, polynomial = np.nonzero(
        coefficients[:, 1:-1].max(axis=1, initial=-np.inf) > bar[:, None]
    )
    pieces = coefficients[group, :, polynomial]
    start = np.zeros(len(polynomial))
    width = 1.0
    for _ in range(MAX_HALVINGS):
        if not len(polynomial):
            break
        left_half, right_half = split_at_middle(pieces)
        width /= 2
        middle = right_half[:, 0]
        better = np.flatnonzero(middle > maximum[group])
        better = better[
            np.argsort(middle[better], kind="stable")
        ]  # the last entry of a group counts
        changed = group[better]
        maximum[changed], index[changed], argument[changed] = (
            middle[better],
            polynomial[better],
            start[better] + width,
        )
        bar = np.maximum(bar, maximum + tolerance)
        pieces = np.concatenate([left_half, right_half])
        group = np.tile(group, 2)
        polynomial = np.tile(polynomial, 2)
        start = np.concatenate([start, start + width])
        keep = pieces[:, 1:-1].max(axis=1, initial=-np.inf) > bar[group]
        pieces = pieces[keep]
        group = group[keep]
        polynomial = polynomial[keep]
        start = start[keep]
    return maximum, index, argument


def find_sign_changes(coefficients: Array, tolerance: Array) -> tuple[Indices, Array]:
    """Find every zero inside (0, 1) at which a polynomial changes its sign.

    Only polynomials that leave [−tolerance, tolerance] on both sides are examined. A zero at which
    such a polynomial only touches 0 counts as well, unless rounding decides otherwise.

    Parameters
    ----------
    coefficients : (m, n + 1) array
        Bernstein coefficients.
    tolerance : (m,) array
        Magnitude that counts as rounding.

    Returns
    -------
    polynomial, s : (k,) arrays
        Index of the polynomial and argument of each zero, in this order.
    """
    crosses = (coefficients.max(axis=1) > tolerance) & (coefficients.min(axis=1) < -tolerance)
    index = np.flatnonzero(crosses)
    pieces = coefficients[index]
    start = np.zeros(len(index))
    width = 1.0
    roots: list[tuple[Indices, Array]] = []
    for _ in range(MAX_HALVINGS):
        if not len(index):
            break
        left_half, right_half = split_at_middle(pieces)
        width /= 2
        pieces = np.concatenate([left_half, right_half])
        index = np.tile(index, 2)
        start = np.concatenate([start, start + width])
        keep = (pieces.max(axis=1) >= 0) & (pieces.min(axis=1) <= 0) & np.any(pieces != 0, axis=1)
        pieces = pieces[keep]
        index = index[keep]
        start = start[keep]
        single = _count_sign_changes(pieces) == 1
        single &= (pieces[:, 0] != 0) & (pieces[:, -1] != 0)
        roots.append((index[single], start[single] + width * _find_single_zeros(pieces[single])))
        pieces = pieces[~single]
        index = index[~single]
        start = start[~single]
    roots.append((index, start + width / 2))
    polynomial = np.concatenate([i for i, _ in roots])
    s = np.concatenate([s for _, s in roots])
    order = np.lexsort((s, polynomial))
    polynomial = polynomial[order]
    s = s[order]
    interior = (s > 0) & (s < 1)
    fresh = np.append(True, (np.diff(polynomial) != 0) | (np.diff(s) > 1e-12))[: len(s)]
    return polynomial[interior & fresh], s[interior & fresh]


def _count_sign_changes(coefficients: Array) -> Indices:
    """Return the number of sign changes in each row of coefficients.

    Zeros are skipped, so (1, 0, −1) has one change.

    Parameters
    ----------
    coefficients : (m, n + 1) array
        Coefficients of m polynomials in Bernstein form.

    Returns
    -------
    (m,) array of int
    """
    signs = np.sign(coefficients.T)
    for k in range(1, len(signs)):
        signs[k] = np.where(signs[k] == 0, signs[k - 1], signs[k])
    return np.count_nonzero(signs[1:] * signs[:-1] < 0, axis=0)


def _find_single_zeros(coefficients: Array) -> Array:
    """Find the single zero of each polynomial in [0, 1] by bisection.

    Parameters
    ----------
    coefficients : (m, n + 1) array
        Bernstein coefficients. The first and the last of each polynomial have opposite signs.

    Returns
    -------
    (m,) array
        Arguments of the zeros.
    """
    powers = to_powers(coefficients)
    if len(powers) <= MAX_SCALAR_POLYNOMIALS:
        return np.array(
            [
                _find_single_zero(row, bool(start_sign > 0))
                for row, start_sign in zip(powers.tolist(), coefficients[:, 0], strict=True)
            ]
        )
    low = np.zeros(len(powers))
    high = np.ones(len(powers))
    start_sign = np.sign(coefficients[:, 0])
    for _ in range(BISECTION_STEPS):
        middle = (low + high) / 2
        ahead = np.sign(polyval(middle, powers.T, tensor=False)) == start_sign
        low = np.where(ahead, middle, low)
        high = np.where(ahead, high, middle)
    return high


def _find_single_zero(powers: list[float], falling: bool) -> float:
    """Return the zero of one polynomial, with its power coefficients, like `_find_single_zeros`."""
    low = 0.0
    high = 1.0
    leading, *lower = powers[::-1]
    for _ in range(BISECTION_STEPS):
        middle = (low + high) / 2
        value = leading
        for coefficient in lower:
            value = value * middle + coefficient
        if (value > 0) if falling else (value < 0):
            low = middle
        else:
            high = middle
    return high
