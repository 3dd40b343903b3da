"""TOPP-RA's two passes, on all grid intervals at once.

On interval i, from grid point s_i to s_{i+1}, with x = ṡ² at its start, w = ṡ² at its end and the acceleration
s̈ = (w − x) / 2Δ, the rows a s̈ + b ṡ² + c ≤ 1 at both ends are p x + q w ≤ r: w lies below the lines with q > 0 and above
those with q < 0,

    L_i(x) ≤ w ≤ U_i(x),   U_i the least of lines, concave; L_i the largest, convex.                                  (1)

Backward pass: the controllable ṡ² at s_i, from which a motion within the rows reaches the end, are an interval [lo_i, hi_i]:

    least_i ≤ x ≤ most_i (where L_i ≤ U_i),   L_i(x) ≤ hi_{i+1},   lo_{i+1} ≤ U_i(x).                                  (2)

A line of (1) that bounds x from above in (2) makes hi_i a line in hi_{i+1}, or in lo_{i+1}: hi is a recurrence
y_{i+1} = min_k (v_k + s_k y_i), and so are −lo, and in the forward pass x_{i+1} = min(U_i(x_i), hi_{i+1}). All i are solved
together: at the present values one line of each is active, with which the recurrence is linear; where the values stay, they
are what taking one interval after the other gives, as native/reachability.c does.

Sources: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on Reachability Analysis, IEEE
T-RO 34(3), 2018, §III, with rows at both ends of every interval (its interpolation scheme); R. Howard, Dynamic Programming
and Markov Processes, 1960 (policy iteration).
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from ssm_planner.native import library
from ssm_planner.planning.retiming.constraints import LinearConstraints
from ssm_planner.typing import Array, Mask

LEVEL = 1e-10
"""A row whose q is smaller than this share of its p bounds x alone."""
STEPS, NEWTON = 15, 150
"""Of the iterations over all intervals before they are taken one by one; of Newton's method for the bounds of an interval."""
SETTLED = 1e-12
"""Relative distance below 0 at which two lines of an interval count as meeting."""
ROUNDING = 1e-9
"""Share by which bounds may cross, and a speed asked for at an end may lie outside what is controllable."""


class _Constants(ctypes.Structure):
    """Of the passes in C."""

    _fields_ = tuple((name, ctypes.c_double) for name in ("level", "settled", "rounding")) + (
        ("newton", ctypes.c_long),
    )


Lines = tuple[Array, Array]
"""Values at 0 and slopes, (n, lines) each; a line that is none has an infinite value and no slope."""


def fastest(grid: Array, rows: LinearConstraints, speeds: tuple[float, float]) -> Array | None:
    """The largest ṡ² (n + 1,) on a grid (n + 1,) that keeps rows without k, from and to the given ṡ; None without one."""
    start, end = (speed**2 for speed in speeds)
    native = library.load()
    if native is not None:
        return _fastest_native(native, grid, rows, (start, end))
    with np.errstate(over="ignore", invalid="ignore"):  # bounds of rows that hardly bind overflow
        return _fastest(grid, rows, (start, end))


def _fastest_native(
    native: ctypes.CDLL, grid: Array, rows: LinearConstraints, squares: tuple[float, float]
) -> Array | None:
    n, m = len(grid) - 1, rows.a.shape[1]
    found, work = np.empty(n + 1), np.empty(8 * m + 2 * (n + 1) + 4 * m * n)
    given = [
        np.ascontiguousarray(values) for values in (grid, rows.a, rows.b, rows.c, rows.ceiling)
    ]
    pointers = [ctypes.c_void_p(values.ctypes.data) for values in (*given, found, work)]
    sizes, ends = map(ctypes.c_long, (n, m)), map(ctypes.c_double, squares)
    constants = ctypes.byref(_Constants(LEVEL, SETTLED, ROUNDING, NEWTON))
    return (
        found
        if native.ssm_fastest(constants, *sizes, *pointers[:5], *ends, *pointers[5:])
        else None
    )


def _fastest(grid: Array, rows: LinearConstraints, squares: tuple[float, float]) -> Array | None:
    """The same from and to the given ṡ², by NumPy."""
    start, end = squares
    intervals = _Intervals.of(grid, rows)
    found = intervals.controllable(end)
    if found is None or not (1 - ROUNDING) * found[0][0] <= start <= (1 + ROUNDING) * found[1][0]:
        return None
    low, high = found
    return np.maximum(_recurrence(start, intervals.upper, high[1:]), low)


@dataclass(frozen=True, eq=False)
class _Intervals:
    """The lines of (1), and bounds (n + 1,) of x that hold for themselves."""

    upper: Lines
    lower: Lines
    least: Array
    most: Array

    @classmethod
    def of(cls, grid: Array, rows: LinearConstraints) -> _Intervals:
        per_step = 1 / (2 * np.diff(grid))[:, None]
        first, last = rows.a[:-1] * per_step, rows.a[1:] * per_step
        p, q = np.hstack([rows.b[:-1] - first, -last]), np.hstack([first, last + rows.b[1:]])
        r = 1 - np.hstack([rows.c[:-1], rows.c[1:]])
        level = np.abs(q) <= LEVEL * np.abs(p)
        with np.errstate(divide="ignore", invalid="ignore"):
            value, slope, alone = r / q, -p / q, r / p
        upper, lower = (q > 0) & ~level, (q < 0) & ~level
        least, most = np.zeros(len(grid)), rows.ceiling.copy()
        most[:-1] = np.minimum(most[:-1], np.where(level & (p > 0), alone, np.inf).min(axis=1))
        least[:-1] = np.maximum(least[:-1], np.where(level & (p < 0), alone, -np.inf).max(axis=1))
        least[:-1][(level & (p == 0) & (r < 0)).any(axis=1)] = np.inf
        return cls(_lines(value, slope, upper), _lines(value, slope, lower, -np.inf), least, most)

    def controllable(self, end: float) -> tuple[Array, Array] | None:
        """(lo, hi), (n + 1,) each, of (2) for ṡ² = end at the end; None where there is nothing between them."""
        own = self._own_bounds()
        if own is None or not own[0][-1] <= end <= (1 + ROUNDING) * own[1][-1]:
            return None
        least, most = own[0][:-1], own[1][:-1]
        # hi by the lines of L that rise, and by those of U that fall at lo; lo by those of U that rise, and of L that fall
        upper, lower = self.upper, self.lower
        rising, falling = _solved(lower, lower[1] > 0, np.inf), _solved(upper, upper[1] < 0, np.inf)
        gaining, losing = (
            _solved(upper, upper[1] > 0, -np.inf),
            _solved(lower, lower[1] < 0, -np.inf),
        )
        low = np.append(least, end)
        for _ in range(len(low) + 1):
            bound = np.minimum(most, _at(falling, low[1:]).min(axis=1, initial=np.inf))
            high = _recurrence(end, _reversed(rising), bound[::-1])[::-1]
            bound = np.maximum(least, _at(losing, high[1:]).max(axis=1, initial=-np.inf))
            before = low
            low = -_recurrence(-end, _reversed((-gaining[0], gaining[1])), -bound[::-1])[::-1]
            if (low > high + ROUNDING * np.abs(high)).any():
                return None
            if np.array_equal(low, before):
                break
        return low, high

    def _own_bounds(self) -> tuple[Array, Array] | None:
        """(least, most), (n + 1,): between them L ≤ U, by Newton's method for a concave function; None where nowhere."""
        bounds = []
        for sign, x in ((-1, self.most.copy()), (1, self.least.copy())):
            if not np.isfinite(x).all():
                return None
            for _ in range(NEWTON):
                (upper, rise), (lower, fall) = (
                    _active(self.upper, x[:-1]),
                    _active(self.lower, x[:-1], -1),
                )
                upper, lower, slope = upper + rise * x[:-1], lower + fall * x[:-1], rise - fall
                open_ = upper - lower < -SETTLED * (np.abs(upper) + np.abs(lower))
                if (open_ & (sign * slope <= 0)).any():
                    return None
                if not open_.any():
                    break
                x[:-1] -= np.where(open_, (upper - lower) / np.where(open_, slope, 1.0), 0.0)
            bounds.append(x)
        return bounds[1], bounds[0]


def _recurrence(first: float, lines: Lines, most: Array) -> Array:
    """y (n + 1,) of y_0 = first, y_{i+1} = min(most_i, min_k v_ik + s_ik y_i)."""
    y = np.append(first, most)
    for _ in range(STEPS):
        before, found = y, [first]
        active, last = (part.tolist() for part in (*_active(lines, y[:-1]), most)), first
        for value, slope, bound in zip(*active, strict=True):
            last = value + slope * last
            if last > bound:  # twice as fast as min
                last = bound
            found.append(last)
        y = np.array(found)
        if np.array_equal(y, before):
            return y
    found = [first]
    for values, slopes, bound in zip(*lines, most.tolist(), strict=True):
        found.append(min(bound, float((values + slopes * found[-1]).min())))
    return np.array(found)


def _lines(values: Array, slopes: Array, chosen: Mask, none: float = np.inf) -> Lines:
    return np.where(chosen, values, none), np.where(chosen, slopes, 0.0)


def _solved(lines: Lines, chosen: Mask, none: float) -> Lines:
    """The chosen lines y = v + s x as x = −v/s + y/s."""
    steep = np.where(chosen, lines[1], 1.0)
    return _lines(-np.where(chosen, lines[0], 0.0) / steep, 1 / steep, chosen, none)


def _active(lines: Lines, x: Array, sign: int = 1) -> Lines:
    """Value at 0 and slope, (n,) each, of the least of the lines at x (n,); with sign −1 of the largest."""
    line = np.argmin(sign * _at(lines, x), axis=1)
    of = np.arange(len(line))
    return lines[0][of, line], lines[1][of, line]


def _at(lines: Lines, x: Array) -> Array:
    """Of all lines at x (n,)."""
    return np.asarray(lines[0] + lines[1] * x[:, None])


def _reversed(lines: Lines) -> Lines:
    return lines[0][::-1], lines[1][::-1]
