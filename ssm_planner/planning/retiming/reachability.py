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
native/reachability.c computes both passes. Without the compiled part, the package toppra does, which
takes about forty times as long.

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
from ssm_planner.toppra_passes import largest_speeds
from ssm_planner.typing import Array


def fastest_profile(
    grid: Array, rows: LinearConstraints, speeds: tuple[float, float]
) -> Array | None:
    """Return the largest ṡ² (n + 1,) on a grid (n + 1,) within rows without k.

    `speeds` are ṡ at both ends. None if there is no such motion.
    """
    native = library.load()
    if native is None:
        return _fastest_by_toppra(grid, rows, speeds)
    n, m = len(grid) - 1, rows.a.shape[1]
    result = np.empty(n + 1)
    work = np.empty(8 * m + 2 * (n + 1) + 4 * m * n)
    arrays = [
        np.ascontiguousarray(values) for values in (grid, rows.a, rows.b, rows.c, rows.ceiling)
    ]
    pointers = [ctypes.c_void_p(values.ctypes.data) for values in (*arrays, result, work)]
    sizes = map(ctypes.c_long, (n, m))
    ends = map(ctypes.c_double, (speeds[0] ** 2, speeds[1] ** 2))
    return result if native.ssm_fastest(*sizes, *pointers[:5], *ends, *pointers[5:]) else None


def _fastest_by_toppra(
    grid: Array, rows: LinearConstraints, speeds: tuple[float, float]
) -> Array | None:
    """Return the result of `fastest_profile` by the package toppra.

    Its tolerances are absolute, about 1e-8. ṡ² is therefore given in thousandths of its typical
    size.
    """
    if speeds[1] ** 2 > (1 + ROUNDING) * rows.ceiling[-1]:
        return None
    strongest = np.abs(rows.a).max(axis=1, initial=ROUNDING)
    unit = 1e-3 * float(np.median(np.minimum(rows.ceiling, 1 / strongest)))
    terms = unit * rows.a, unit * rows.b, rows.c
    begin, end = zip(*((values[:-1], values[1:]) for values in terms), strict=True)
    start, last = (speed / np.sqrt(unit) for speed in speeds)
    ceiling = rows.ceiling / unit
    result = largest_speeds(grid, begin, end, ceiling, speeds=(start, last), exact_ends=True)
    return None if result is None else unit * result
