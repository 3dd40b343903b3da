"""Exact extremes and sign changes of many polynomials on [0, 1] at once, by their Bernstein coefficients.

A polynomial lies between the smallest and the largest of its Bernstein coefficients, begins at the first and ends at
the last, and has at most as many roots as they have changes of sign (Farouki, The Bernstein polynomial basis: a
centennial retrospective, 2012). Halving the interval brings the coefficients to the polynomial quadratically.

Polynomials come first, (m, n + 1, …) for the n + 1 coefficients of each; operations are fastest where each coefficient's m
values lie together in memory (Fortran order), as they do in the results.
"""

from __future__ import annotations

from math import comb

import numpy as np

from ssm_planner.typing import Array, Indices

DEPTH = 48
"""Halvings after which an interval counts as a point."""
BISECTIONS = 54
"""Of an interval with one zero."""
FEW = 8
"""Polynomials up to which numbers are faster than arrays of them."""


def from_powers(powers: Array) -> Array:
    """Bernstein coefficients (m, n + 1, …) of Σ powers[:, k] s^k, (m, n + 1, …)."""
    degree = powers.shape[1] - 1
    scale = np.array([1 / comb(degree, i) for i in range(degree + 1)])
    coefficients: Array = powers * scale.reshape(-1, *(1,) * (powers.ndim - 2))
    # Σ_i C(j, i) a_i by Pascal's triangle: cheaper than a matrix product, whose threads cost more than they give
    for row in range(1, degree + 1):
        coefficients[:, row:] += coefficients[:, row - 1 : -1].copy(order="K")
    return coefficients


def to_powers(coefficients: Array) -> Array:
    """The inverse of `from_powers`: (m, n + 1) to the same shape."""
    degree = coefficients.shape[1] - 1
    powers = coefficients.copy(order="K")
    for row in range(degree, 0, -1):
        for j in range(row, degree + 1):
            powers[:, j] -= powers[:, j - 1]
    return powers * np.array([comb(degree, i) for i in range(degree + 1)], dtype=float)


def halves(coefficients: Array) -> tuple[Array, Array]:
    """Coefficients (m, n + 1) on [0, 1/2] and on [1/2, 1] (de Casteljau)."""
    row, left, right = coefficients.T, [coefficients[:, 0]], [coefficients[:, -1]]
    while len(row) > 1:
        row = (row[1:] + row[:-1]) / 2
        left.append(row[0])
        right.append(row[-1])
    return np.stack(left).T, np.stack(right[::-1]).T


def largest(coefficients: Array, tolerance: Array, known: Array) -> tuple[Array, Indices, Array]:
    """(value, polynomial, s), (k,) each, of the largest values on [0, 1] of k groups of m polynomials.

    coefficients (k, n + 1, m), known (k,), tolerance (k,): to which they are exact. Where none of a group exceeds `known`,
    the largest value that was met; it may then not be exact.
    """
    ends = np.maximum(coefficients[:, 0], coefficients[:, -1])
    index = np.argmax(ends, axis=1)
    groups = np.arange(len(ends))
    best = ends[groups, index]
    where = np.where(coefficients[groups, 0, index] >= best, 0.0, 1.0)
    bar = np.maximum(best, known) + tolerance
    group, of = np.nonzero(coefficients[:, 1:-1].max(axis=1, initial=-np.inf) > bar[:, None])
    pieces, start, width = coefficients[group, :, of], np.zeros(len(of)), 1.0
    for _ in range(DEPTH):
        if not len(of):
            break
        left, right = halves(pieces)
        width /= 2
        middle = right[:, 0]
        better = np.flatnonzero(middle > best[group])
        better = better[np.argsort(middle[better], kind="stable")]  # of a group the last counts
        changed = group[better]
        best[changed], index[changed], where[changed] = (
            middle[better],
            of[better],
            start[better] + width,
        )
        bar = np.maximum(bar, best + tolerance)
        pieces = np.concatenate([left, right])
        group, of, start = np.tile(group, 2), np.tile(of, 2), np.concatenate([start, start + width])
        keep = pieces[:, 1:-1].max(axis=1, initial=-np.inf) > bar[group]
        pieces, group, of, start = pieces[keep], group[keep], of[keep], start[keep]
    return best, index, where


def sign_changes(coefficients: Array, tolerance: Array) -> tuple[Indices, Array]:
    """(polynomial, s) of every zero inside (0, 1) of m polynomials that leave [−tolerance, tolerance] on both sides.

    coefficients (m, n + 1), tolerance (m,). Zeros that only touch count too, where rounding does not decide otherwise.
    """
    crosses = (coefficients.max(axis=1) > tolerance) & (coefficients.min(axis=1) < -tolerance)
    index = np.flatnonzero(crosses)
    pieces, start, width = coefficients[index], np.zeros(len(index)), 1.0
    found: list[tuple[Indices, Array]] = []
    for _ in range(DEPTH):
        if not len(index):
            break
        left, right = halves(pieces)
        width /= 2
        pieces = np.concatenate([left, right])
        index, start = np.tile(index, 2), np.concatenate([start, start + width])
        keep = (pieces.max(axis=1) >= 0) & (pieces.min(axis=1) <= 0) & np.any(pieces != 0, axis=1)
        pieces, index, start = pieces[keep], index[keep], start[keep]
        single = _changes(pieces) == 1
        single &= (pieces[:, 0] != 0) & (pieces[:, -1] != 0)
        found.append((index[single], start[single] + width * _bisect(pieces[single])))
        pieces, index, start = pieces[~single], index[~single], start[~single]
    found.append((index, start + width / 2))
    where, s = np.concatenate([i for i, _ in found]), np.concatenate([s for _, s in found])
    order = np.lexsort((s, where))
    where, s = where[order], s[order]
    inside = (s > 0) & (s < 1)
    fresh = np.append(True, (np.diff(where) != 0) | (np.diff(s) > 1e-12))[: len(s)]
    return where[inside & fresh], s[inside & fresh]


def _changes(coefficients: Array) -> Indices:
    """Changes of sign along the coefficients (m, n + 1) of each polynomial, zeros left out, (m,)."""
    signs = np.sign(coefficients.T)
    for k in range(1, len(signs)):
        signs[k] = np.where(signs[k] == 0, signs[k - 1], signs[k])
    return np.asarray(np.count_nonzero(signs[1:] * signs[:-1] < 0, axis=0))


def _bisect(coefficients: Array) -> Array:
    """The one zero in [0, 1] of each polynomial (m, n + 1), its ends of opposite sign; (m,)."""
    powers = to_powers(coefficients)
    if len(powers) <= FEW:
        return np.array(
            [
                _bisected(own, bool(first > 0))
                for own, first in zip(powers.tolist(), coefficients[:, 0], strict=True)
            ]
        )
    low, high = np.zeros(len(powers)), np.ones(len(powers))
    first = np.sign(coefficients[:, 0])
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        ahead = np.sign(evaluate(powers, middle)) == first
        low, high = np.where(ahead, middle, low), np.where(ahead, high, middle)
    return high


def _bisected(powers: list[float], falling: bool) -> float:
    """The zero of one polynomial, as `_bisect` finds it."""
    low, high = 0.0, 1.0
    last, *others = powers[::-1]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        value = last
        for coefficient in others:
            value = value * middle + coefficient
        if (value > 0) if falling else (value < 0):
            low = middle
        else:
            high = middle
    return high


def evaluate(powers: Array, s: Array) -> Array:
    """Σ powers[:, k] s^k by Horner's rule, (m,); powers (m, n + 1), s (m,) or one for all."""
    value = powers[:, -1] + 0.0 * s
    for coefficient in powers.T[-2::-1]:
        value = value * s + coefficient
    return value
