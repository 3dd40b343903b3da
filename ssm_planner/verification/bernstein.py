"""Exact extremes and sign changes of many polynomials on [0, 1] at once, by their Bernstein coefficients.

A polynomial lies between the smallest and the largest of its Bernstein coefficients, begins at the first and ends at
the last, and has at most as many roots as they have changes of sign (Farouki, The Bernstein polynomial basis: a
centennial retrospective, 2012). Halving the interval brings the coefficients to the polynomial quadratically.
"""

from __future__ import annotations

from math import comb

import numpy as np

from ssm_planner.typing import Array, Indices

DEPTH = 48
"""Halvings after which an interval counts as a point."""


def from_powers(powers: Array) -> Array:
    """Bernstein coefficients (n + 1, …) of Σ powers[k] s^k, (n + 1, …)."""
    degree = len(powers) - 1
    scale = np.array([1 / comb(degree, i) for i in range(degree + 1)])
    coefficients: Array = powers * scale.reshape(-1, *(1,) * (powers.ndim - 1))
    # Σ_i C(j, i) a_i by Pascal's triangle: cheaper than a matrix product, whose threads cost more than they give
    for row in range(1, degree + 1):
        coefficients[row:] += coefficients[row - 1 : -1].copy()
    return coefficients


def to_powers(coefficients: Array) -> Array:
    """The inverse of `from_powers`; (degree + 1, ...) to the same shape."""
    degree = len(coefficients) - 1
    powers = coefficients.copy()
    for row in range(degree, 0, -1):
        for j in range(row, degree + 1):
            powers[j] -= powers[j - 1]
    scale = np.array([comb(degree, i) for i in range(degree + 1)], dtype=float)
    powers *= scale.reshape(-1, *(1,) * (powers.ndim - 1))
    return powers


def derivative(coefficients: Array) -> Array:
    """Bernstein coefficients (n, …) of the derivative by s."""
    return (len(coefficients) - 1) * np.diff(coefficients, axis=0)


def halves(coefficients: Array) -> tuple[Array, Array]:
    """Coefficients (n + 1, …) on [0, 1/2] and on [1/2, 1] (de Casteljau)."""
    row, left, right = coefficients, [coefficients[0]], [coefficients[-1]]
    while len(row) > 1:
        row = (row[1:] + row[:-1]) / 2
        left.append(row[0])
        right.append(row[-1])
    return np.stack(left), np.stack(right[::-1])


def largest(coefficients: Array, tolerance: float, known: float = -np.inf) -> tuple[float, int, float]:
    """(value, polynomial, s) of the largest value of m polynomials on [0, 1], exact to the tolerance.

    coefficients (n + 1, m). Where none exceeds `known`, the largest value that was met; it may then not be exact.
    """
    ends = np.maximum(coefficients[0], coefficients[-1])
    i = int(np.argmax(ends))
    best = (float(ends[i]), i, 0.0 if coefficients[0, i] >= coefficients[-1, i] else 1.0)
    bar = max(best[0], known)
    bound = coefficients[1:-1].max(axis=0, initial=-np.inf)
    index = np.flatnonzero(bound > bar + tolerance)
    pieces, start, width = coefficients[:, index], np.zeros(len(index)), 1.0
    for _ in range(DEPTH):
        if not len(index):
            break
        left, right = halves(pieces)
        width /= 2
        i = int(np.argmax(right[0]))
        if right[0, i] > best[0]:
            best = (float(right[0, i]), int(index[i]), float(start[i] + width))
        bar = max(bar, best[0])
        pieces = np.concatenate([left, right], axis=1)
        index, start = np.tile(index, 2), np.concatenate([start, start + width])
        keep = pieces[1:-1].max(axis=0, initial=-np.inf) > bar + tolerance
        pieces, index, start = pieces[:, keep], index[keep], start[keep]
    return best


def sign_changes(coefficients: Array, tolerance: Array) -> tuple[Indices, Array]:
    """(polynomial, s) of every zero inside (0, 1) of m polynomials that leave [−tolerance, tolerance] on both sides.

    coefficients (n + 1, m), tolerance (m,). Zeros that only touch count too, where rounding does not decide otherwise.
    """
    crosses = (coefficients.max(axis=0) > tolerance) & (coefficients.min(axis=0) < -tolerance)
    index = np.flatnonzero(crosses)
    pieces, start, width = coefficients[:, index], np.zeros(len(index)), 1.0
    found: list[tuple[Indices, Array]] = []
    for _ in range(DEPTH):
        if not len(index):
            break
        left, right = halves(pieces)
        width /= 2
        pieces = np.concatenate([left, right], axis=1)
        index, start = np.tile(index, 2), np.concatenate([start, start + width])
        keep = (pieces.max(axis=0) >= 0) & (pieces.min(axis=0) <= 0) & np.any(pieces != 0, axis=0)
        pieces, index, start = pieces[:, keep], index[keep], start[keep]
        single = _changes(pieces) == 1
        single &= (pieces[0] != 0) & (pieces[-1] != 0)
        found.append((index[single], start[single] + width * _bisect(pieces[:, single])))
        pieces, index, start = pieces[:, ~single], index[~single], start[~single]
    found.append((index, start + width / 2))
    where, s = np.concatenate([i for i, _ in found]), np.concatenate([s for _, s in found])
    order = np.lexsort((s, where))
    where, s = where[order], s[order]
    inside = (s > 0) & (s < 1)
    fresh = np.append(True, (np.diff(where) != 0) | (np.diff(s) > 1e-12))[: len(s)]
    return where[inside & fresh], s[inside & fresh]


def _changes(coefficients: Array) -> Indices:
    """Changes of sign along the coefficients, zeros left out."""
    signs = np.sign(coefficients)
    for k in range(1, len(signs)):
        signs[k] = np.where(signs[k] == 0, signs[k - 1], signs[k])
    return np.asarray(np.count_nonzero(signs[1:] * signs[:-1] < 0, axis=0))


def _bisect(coefficients: Array) -> Array:
    """The one zero of each polynomial (ends of opposite sign), in [0, 1]."""
    powers = to_powers(coefficients)
    low, high = np.zeros(coefficients.shape[1]), np.ones(coefficients.shape[1])
    first = np.sign(coefficients[0])
    for _ in range(54):
        middle = (low + high) / 2
        ahead = np.sign(evaluate(powers, middle)) == first
        low, high = np.where(ahead, middle, low), np.where(ahead, high, middle)
    return high


def evaluate(powers: Array, s: Array) -> Array:
    """Σ powers[k] s^k by Horner's rule; powers (n + 1, …), s broadcast against the rest."""
    value = powers[-1] + 0.0 * s
    for coefficient in powers[-2::-1]:
        value = value * s + coefficient
    return value
