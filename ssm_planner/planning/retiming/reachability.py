"""The two passes of TOPP-RA.

On interval i from grid point s_i to s_{i+1}, let x = ṡ² at its start, w = ṡ² at its end, and s̈ =
(w − x) / 2Δ. The rows a s̈ + b ṡ² + c ≤ 1 at both ends become p x + q w ≤ r. Thus w lies below the
lines with q > 0 and above those with q < 0,

    L_i(x) ≤ w ≤ U_i(x),   (1)

where U_i is a minimum of lines and concave, and L_i a maximum of lines and convex.

In the backward pass, the controllable ṡ² at s_i, from which a motion within the rows reaches the
end, form an interval [lo_i, hi_i] with

    least_i ≤ x ≤ most_i (where L_i ≤ U_i),   L_i(x) ≤ hi_{i+1},   lo_{i+1} ≤ U_i(x).   (2)

A line of (1) that bounds x in (2) is solved for x, so hi_i and lo_i are minima and maxima of linear
functions of hi_{i+1} and lo_{i+1}. The forward pass is x_{i+1} = min(U_i(x_i), hi_{i+1}).
native/reachability.c computes the same.

Sources: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018, §III, with rows at both ends of every interval (its
interpolation scheme).
"""

from __future__ import annotations

import ctypes

import numpy as np

from ssm_planner.native import library
from ssm_planner.planning.retiming.constraints import LinearConstraints
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.typing import Array, Mask, record

LEVEL = 1e-10
"""A row whose |q| is below this share of its |p| bounds x alone."""
NEWTON = 150
"""Largest number of iterations of Newton's method for the bounds of an interval."""
SETTLED = 1e-12
"""Relative distance below 0 at which two lines of an interval count as meeting."""


class _Constants(ctypes.Structure):
    """Constants of the passes in C."""

    _fields_ = tuple((name, ctypes.c_double) for name in ("level", "settled", "rounding")) + (
        ("newton", ctypes.c_long),
    )


Lines = tuple[Array, Array]
"""Values at 0 and slopes of lines, (n, lines) each.

A missing line has an infinite value and slope 0.
"""


def fastest_profile(
    grid: Array, rows: LinearConstraints, speeds: tuple[float, float]
) -> Array | None:
    """Return the largest ṡ² (n + 1,) on a grid (n + 1,) within rows without k.

    `speeds` are ṡ at both ends. None if there is no such motion.
    """
    start, end = (speed**2 for speed in speeds)
    native = library.load()
    if native is not None:
        return _fastest_native(native, grid, rows, (start, end))
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # Bounds of rows that almost never bind overflow.
        return _fastest_numpy(grid, rows, (start, end))


def _fastest_native(
    native: ctypes.CDLL, grid: Array, rows: LinearConstraints, squares: tuple[float, float]
) -> Array | None:
    """Return the result of `fastest_profile` by C code. `squares` are ṡ² at both ends."""
    n, m = len(grid) - 1, rows.a.shape[1]
    result = np.empty(n + 1)
    work = np.empty(8 * m + 2 * (n + 1) + 4 * m * n)
    arrays = [
        np.ascontiguousarray(values) for values in (grid, rows.a, rows.b, rows.c, rows.ceiling)
    ]
    pointers = [ctypes.c_void_p(values.ctypes.data) for values in (*arrays, result, work)]
    sizes = map(ctypes.c_long, (n, m))
    ends = map(ctypes.c_double, squares)
    constants = ctypes.byref(_Constants(LEVEL, SETTLED, ROUNDING, NEWTON))
    return (
        result
        if native.ssm_fastest(constants, *sizes, *pointers[:5], *ends, *pointers[5:])
        else None
    )


def _fastest_numpy(
    grid: Array, rows: LinearConstraints, squares: tuple[float, float]
) -> Array | None:
    """Return the result of `fastest_profile` by NumPy. `squares` are ṡ² at both ends."""
    start, end = squares
    intervals = _Intervals.from_rows(grid, rows)
    bounds = intervals.controllable(end)
    if (
        bounds is None
        or not (1 - ROUNDING) * bounds[0][0] <= start <= (1 + ROUNDING) * bounds[1][0]
    ):
        return None
    low, high = bounds
    result = [start]
    for values, slopes, bound in zip(*intervals.upper, high[1:].tolist(), strict=True):
        result.append(min(bound, float((values + slopes * result[-1]).min())))
    return np.maximum(result, low)


@record
class _Intervals:
    """The lines of (1), and the bounds (n + 1,) of x on each interval by itself."""

    upper: Lines
    lower: Lines
    x_min: Array
    x_max: Array

    @classmethod
    def from_rows(cls, grid: Array, rows: LinearConstraints) -> _Intervals:
        """Build the lines from the rows at the grid points (n + 1,)."""
        per_step = 1 / (2 * np.diff(grid))[:, None]
        a_start = rows.a[:-1] * per_step
        a_end = rows.a[1:] * per_step
        p = np.hstack([rows.b[:-1] - a_start, -a_end])
        q = np.hstack([a_start, a_end + rows.b[1:]])
        r = 1 - np.hstack([rows.c[:-1], rows.c[1:]])
        level = np.abs(q) <= LEVEL * np.abs(p)
        with np.errstate(divide="ignore", invalid="ignore"):
            value = r / q
            slope = -p / q
            alone = r / p
        upper, lower = (q > 0) & ~level, (q < 0) & ~level
        x_min, x_max = np.zeros(len(grid)), rows.ceiling.copy()
        x_max[:-1] = np.minimum(x_max[:-1], np.where(level & (p > 0), alone, np.inf).min(axis=1))
        x_min[:-1] = np.maximum(x_min[:-1], np.where(level & (p < 0), alone, -np.inf).max(axis=1))
        x_min[:-1][(level & (p == 0) & (r < 0)).any(axis=1)] = np.inf
        return cls(_lines(value, slope, upper), _lines(value, slope, lower, -np.inf), x_min, x_max)

    def controllable(self, end: float) -> tuple[Array, Array] | None:
        """Return (lo, hi) of (2), (n + 1,) each, for ṡ² = end at the end.

        None if an interval is empty.
        """
        bounds = self._own_bounds()
        if bounds is None or not bounds[0][-1] <= end <= (1 + ROUNDING) * bounds[1][-1]:
            return None
        x_min, x_max = bounds[0][:-1], bounds[1][:-1]
        upper, lower = self.upper, self.lower
        # hi follows from the rising lines of L, and from the falling lines of U at lo. lo follows
        # from the rising lines of U, and from the falling lines of L at hi.
        rising = _solved(lower, lower[1] > 0, np.inf)
        falling = _solved(upper, upper[1] < 0, np.inf)
        gaining = _solved(upper, upper[1] > 0, -np.inf)
        losing = _solved(lower, lower[1] < 0, -np.inf)
        low, high = np.append(x_min, end), np.append(x_max, end)
        for i in reversed(range(len(x_min))):
            least, most = low[i + 1], high[i + 1]
            for (values, slopes), y in ((rising, most), (falling, least)):
                high[i] = min(high[i], (values[i] + slopes[i] * y).min(initial=np.inf))
            for (values, slopes), y in ((gaining, least), (losing, most)):
                low[i] = max(low[i], (values[i] + slopes[i] * y).max(initial=-np.inf))
        return None if (low > high + ROUNDING * np.abs(high)).any() else (low, high)

    def _own_bounds(self) -> tuple[Array, Array] | None:
        """Return (least, most), (n + 1,) each, between which L ≤ U.

        They are the roots of the concave function U − L, by Newton's method. None if L > U
        everywhere.
        """
        bounds = []
        for sign, x in ((-1, self.x_max.copy()), (1, self.x_min.copy())):
            if not np.isfinite(x).all():
                return None
            for _ in range(NEWTON):
                upper, rise = _active(self.upper, x[:-1])
                lower, fall = _active(self.lower, x[:-1], -1)
                upper = upper + rise * x[:-1]
                lower = lower + fall * x[:-1]
                slope = rise - fall
                open_ = upper - lower < -SETTLED * (np.abs(upper) + np.abs(lower))
                if (open_ & (sign * slope <= 0)).any():
                    return None
                if not open_.any():
                    break
                x[:-1] -= np.where(open_, (upper - lower) / np.where(open_, slope, 1.0), 0.0)
            bounds.append(x)
        return bounds[1], bounds[0]


def _lines(values: Array, slopes: Array, mask: Mask, missing: float = np.inf) -> Lines:
    """Return the selected lines. The others get the value `missing`."""
    return np.where(mask, values, missing), np.where(mask, slopes, 0.0)


def _solved(lines: Lines, mask: Mask, missing: float) -> Lines:
    """Return the selected lines y = v + s x as x = −v/s + y/s."""
    steep = np.where(mask, lines[1], 1.0)
    return _lines(-np.where(mask, lines[0], 0.0) / steep, 1 / steep, mask, missing)


def _active(lines: Lines, x: Array, sign: int = 1) -> Lines:
    """Return value at 0 and slope of the smallest line at x (n,); with sign −1 the largest."""
    line = np.argmin(sign * _values_at(lines, x), axis=1)
    rows = np.arange(len(line))
    return lines[0][rows, line], lines[1][rows, line]


def _values_at(lines: Lines, x: Array) -> Array:
    """Return the values of all lines at x (n,), (n, lines)."""
    return np.asarray(lines[0] + lines[1] * x[:, None])
