"""Exact extremes and sign changes of many polynomials on [0, 1], by their Bernstein coefficients.

A polynomial lies between its smallest and its largest Bernstein coefficient. It starts at the first
coefficient and ends at the last. It has at most as many roots as the coefficients have sign changes
(Farouki, The Bernstein polynomial basis: a centennial retrospective, 2012). When the interval is
halved, the coefficients converge to the polynomial quadratically.

The check uses this module for the positions, velocities, accelerations and jerks of a motion, which
are polynomials in time, and to find the instants at which a joint reverses.

Arrays are (m, n + 1, …) for m polynomials with n + 1 coefficients each. Operations are fastest if
the m values of one coefficient are adjacent in memory (Fortran order). The results have this order.
"""

from math import comb

import numpy as np
from numpy.polynomial.polynomial import polyval

from ssm_planner.typing import Array, Indices

MAX_HALVINGS = 48
"""Number of halvings of [0, 1] after which the remaining interval counts as a point.

Its length is then 2^−48, about 4e-15.
"""
BISECTION_STEPS = 54
"""Number of bisection steps for an interval that contains one zero.

The remaining interval is then smaller than the spacing of double-precision numbers near 1.
"""
MAX_SCALAR_POLYNOMIALS = 8
"""Largest number of polynomials for which bisection with Python floats is faster than arrays."""


def from_powers(powers: Array) -> Array:
    """Convert polynomials from powers to Bernstein form.

    Parameters
    ----------
    powers : (m, n + 1, …) array
        Coefficients a_k of the powers s^k of m polynomials.

    Returns
    -------
    (m, n + 1, …) array
        Bernstein coefficients b_j = Σ_i C(j, i)/C(n, i) · a_i (Farouki 2012). C denotes binomial
        coefficients.
    """
    degree = powers.shape[1] - 1
    scale = np.array([1 / comb(degree, i) for i in range(degree + 1)])
    # The scale has one entry for each power, along the second axis.
    coefficients = powers * scale.reshape(-1, *(1,) * (powers.ndim - 2))
    # Pascal's triangle gives Σ_i C(j, i) a_i. A matrix product is slower: it starts threads.
    for row in range(1, degree + 1):
        coefficients[:, row:] += coefficients[:, row - 1 : -1].copy(order="K")
    return coefficients


def to_powers(coefficients: Array) -> Array:
    """Convert polynomials in Bernstein form to coefficients of powers.

    Parameters
    ----------
    coefficients : (m, n + 1) array
        Bernstein coefficients b_j.

    Returns
    -------
    (m, n + 1) array
        Coefficients a_i = C(n, i) Δⁱ b_0 of the powers s^i (Farouki 2012). C denotes binomial
        coefficients, and Δ the forward difference Δ b_j = b_{j+1} − b_j.
    """
    degree = coefficients.shape[1] - 1
    powers = coefficients.copy(order="K")
    # Repeated differences of neighbours give Δⁱ b_0 in column i.
    for row in range(degree, 0, -1):
        for j in range(row, degree + 1):
            powers[:, j] -= powers[:, j - 1]
    return powers * np.array([comb(degree, i) for i in range(degree + 1)], dtype=float)


def split_at_middle(coefficients: Array) -> tuple[Array, Array]:
    """Divide polynomials on [0, 1] at 1/2 by de Casteljau's algorithm.

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
    """Find the largest value that any of m polynomials has on [0, 1], for each of k groups of them.

    The method is branch and bound. The interval [0, 1] is halved again and again. The ends and the
    middle of an interval give values of the polynomial, and its Bernstein coefficients give an
    upper bound. An interval is dropped if its bound does not exceed the largest value of the group
    so far by more than the tolerance.

    Parameters
    ----------
    coefficients : (k, n + 1, m) array
        Bernstein coefficients.
    tolerance : (k,) array
        Absolute accuracy of the largest value of each group.
    threshold : (k,) array
        Largest values that the caller already knows. The search drops intervals below them, so a
        result that does not exceed its threshold may be inexact.

    Returns
    -------
    value, polynomial, s : (k,) arrays
        Largest value of each group, index of its polynomial within the group, and argument at which
        the polynomial has this value.
    """
    ends = np.maximum(coefficients[:, 0], coefficients[:, -1])
    index = np.argmax(ends, axis=1)
    groups = np.arange(len(ends))
    maximum = ends[groups, index]
    argument = np.where(coefficients[groups, 0, index] >= maximum, 0.0, 1.0)
    value_to_exceed = np.maximum(maximum, threshold) + tolerance
    # The first and the last coefficient are values at the ends, which `maximum` already contains.
    # Only inner coefficients can show that a larger value may exist.
    group, polynomial = np.nonzero(
        coefficients[:, 1:-1].max(axis=1, initial=-np.inf) > value_to_exceed[:, None]
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
        # If several values of a group are better, the last assignment below counts. It must be the
        # largest of them.
        better = better[np.argsort(middle[better], kind="stable")]
        changed = group[better]
        maximum[changed] = middle[better]
        index[changed] = polynomial[better]
        argument[changed] = start[better] + width
        value_to_exceed = np.maximum(value_to_exceed, maximum + tolerance)
        pieces = np.concatenate([left_half, right_half])
        group = np.tile(group, 2)
        polynomial = np.tile(polynomial, 2)
        start = np.concatenate([start, start + width])
        keep = pieces[:, 1:-1].max(axis=1, initial=-np.inf) > value_to_exceed[group]
        pieces = pieces[keep]
        group = group[keep]
        polynomial = polynomial[keep]
        start = start[keep]
    return maximum, index, argument


def find_sign_changes(coefficients: Array, tolerance: Array) -> tuple[Indices, Array]:
    """Find every zero between 0 and 1 at which a polynomial changes its sign.

    A joint reverses at these zeros of its velocity. Only polynomials with Bernstein coefficients
    above tolerance and below −tolerance are examined. If such a polynomial also touches 0 without a
    change of its sign, the result may contain this zero.

    Parameters
    ----------
    coefficients : (m, n + 1) array
        Bernstein coefficients.
    tolerance : (m,) array
        Magnitude below which a coefficient counts as a rounding error.

    Returns
    -------
    polynomial, s : (k,) arrays
        Index of the polynomial and argument of each of k zeros. They are sorted by polynomial and
        then by argument.
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
        # Intervals without a zero are dropped, and so are those in which the polynomial is 0.
        keep = (pieces.max(axis=1) >= 0) & (pieces.min(axis=1) <= 0) & np.any(pieces != 0, axis=1)
        pieces = pieces[keep]
        index = index[keep]
        start = start[keep]
        # One sign change and nonzero ends mean exactly one zero, which bisection can find.
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
    # Two adjacent intervals can both find a zero at their common end.
    differs = np.append(True, (np.diff(polynomial) != 0) | (np.diff(s) > 1e-12))[: len(s)]
    return polynomial[interior & differs], s[interior & differs]


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
        The numbers of sign changes, which bound the numbers of zeros in (0, 1).
    """
    signs = np.sign(coefficients.T)
    # A coefficient that is 0 takes the sign of the one before it.
    for k in range(1, len(signs)):
        signs[k] = np.where(signs[k] == 0, signs[k - 1], signs[k])
    return np.count_nonzero(signs[1:] * signs[:-1] < 0, axis=0)


def _find_single_zeros(coefficients: Array) -> Array:
    """Find the zero of each polynomial that has exactly one zero in [0, 1], by bisection.

    Few polynomials are evaluated one by one with Python floats, which is faster then.

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
        zeros = [
            _find_single_zero(row, bool(start_value > 0))
            for row, start_value in zip(powers.tolist(), coefficients[:, 0], strict=True)
        ]
        return np.array(zeros)
    low = np.zeros(len(powers))
    high = np.ones(len(powers))
    start_sign = np.sign(coefficients[:, 0])
    for _ in range(BISECTION_STEPS):
        middle = (low + high) / 2
        is_before_zero = np.sign(polyval(middle, powers.T, tensor=False)) == start_sign
        low = np.where(is_before_zero, middle, low)
        high = np.where(is_before_zero, high, middle)
    return high


def _find_single_zero(powers: list[float], falling: bool) -> float:
    """Find the single zero of one polynomial in [0, 1] by bisection with Python floats.

    Parameters
    ----------
    powers : list of n + 1 floats
        Coefficients of the powers, the constant first.
    falling : bool
        True if the polynomial is positive before the zero and negative after it.

    Returns
    -------
    float
        Argument of the zero.
    """
    low = 0.0
    high = 1.0
    # The inner loop evaluates the polynomial in the middle by Horner's rule.
    for _ in range(BISECTION_STEPS):
        middle = (low + high) / 2
        value = 0.0
        for coefficient in reversed(powers):
            value = value * middle + coefficient
        is_before_zero = value > 0 if falling else value < 0
        if is_before_zero:
            low = middle
        else:
            high = middle
    return high
