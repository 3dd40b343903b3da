"""The backward and the forward pass of TOPP-RA, which find the fastest motion on a grid.

On the interval from grid point s_i to s_{i+1} of length Δ, let x = ṡ² at its start, w = ṡ² at its
end, and s̈ = (w − x) / 2Δ. The constraints a s̈ + b ṡ² + c ≤ 1 at both ends become p x + q w ≤ r.
Thus w lies below the lines with q > 0 and above those with q < 0,

    L_i(x) ≤ w ≤ U_i(x),   (1)

where U_i is a minimum of lines and concave, and L_i a maximum of lines and convex.

The backward pass computes the controllable ṡ² at every s_i, from which a motion within the
constraints reaches the end. They form an interval [lo_i, hi_i] with

    least_i ≤ x ≤ most_i (where L_i ≤ U_i),   L_i(x) ≤ hi_{i+1},   lo_{i+1} ≤ U_i(x).   (2)

A line of (1) that bounds x in (2) is solved for x, so hi_i and lo_i are minima and maxima of linear
functions of hi_{i+1} and lo_{i+1}. The forward pass takes the fastest controllable motion, x_{i+1}
= min(U_i(x_i), hi_{i+1}). native/reachability.c computes both passes. Without the compiled part,
the package toppra does, which takes about forty times as long.

Sources: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018, §III, with constraints at both ends of every interval
(its interpolation scheme).
"""

import ctypes

import numpy as np

from ssm_planner.native import library
from ssm_planner.planning.retiming.constraints import LinearConstraints
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.toppra_passes import largest_speeds
from ssm_planner.typing import Array


def fastest_profile(
    grid: Array, rows: LinearConstraints, speeds: tuple[float, float]
) -> Array | None:
    """Compute the fastest motion on a grid within linear constraints.

    The backward pass finds the values of ṡ² from which the end can be reached, and the forward pass
    takes the largest of them (see the module's docstring). Both run in C if the compiled part of
    the package is there, otherwise in the package toppra.

    Parameters
    ----------
    grid : (n + 1,) array
        Values of the path parameter s.
    rows : LinearConstraints
        Constraints a s̈ + b ṡ² + c ≤ 1 at the grid points. The coefficients k of ṡ must be 0.
    speeds : (float, float)
        ṡ at both ends, 1/s.

    Returns
    -------
    (n + 1,) array or None
        ṡ² at the grid points. None if there is no motion.
    """
    native = library.load()
    if native is None:
        return _fastest_by_toppra(grid, rows, speeds)
    n, m = len(grid) - 1, rows.a.shape[1]
    result = np.empty(n + 1)
    workspace = np.empty(8 * m + 2 * (n + 1) + 4 * m * n)
    arrays = [
        np.ascontiguousarray(values) for values in (grid, rows.a, rows.b, rows.c, rows.ceiling)
    ]
    # The C function writes to `result`. In the workspace it keeps the bounds lo and hi of ṡ² at the
    # n + 1 grid points, and the intercept and slope of each line: each of m constraints gives two
    # lines (one at either end of an interval), so 4 m numbers for the lines U_i of every interval,
    # and 4 m more for the lines L_i of the present one. Another 4 m numbers remain unused.
    pointers = [ctypes.c_void_p(values.ctypes.data) for values in (*arrays, result, workspace)]
    sizes = map(ctypes.c_long, (n, m))
    ends = map(ctypes.c_double, (speeds[0] ** 2, speeds[1] ** 2))
    return result if native.ssm_fastest(*sizes, *pointers[:5], *ends, *pointers[5:]) else None


def _fastest_by_toppra(
    grid: Array, rows: LinearConstraints, speeds: tuple[float, float]
) -> Array | None:
    """Compute the fastest motion on a grid by the package toppra, without the compiled part.

    The tolerances of toppra are absolute, about 1e-8. ṡ² is therefore expressed in thousandths of
    its typical value.

    Parameters
    ----------
    grid : (n + 1,) array
        Values of the path parameter s.
    rows : LinearConstraints
        Constraints a s̈ + b ṡ² + c ≤ 1 at the grid points. The coefficients k of ṡ must be 0.
    speeds : (float, float)
        ṡ at both ends, 1/s.

    Returns
    -------
    (n + 1,) array or None
        ṡ² at the grid points. None if there is no motion.
    """
    if speeds[1] ** 2 > (1 + ROUNDING_TOLERANCE) * rows.ceiling[-1]:
        return None
    # Both the speed limit and the largest acceleration bound ṡ². The median of these is typical.
    steepest = np.abs(rows.a).max(axis=1, initial=ROUNDING_TOLERANCE)
    unit = 1e-3 * float(np.median(np.minimum(rows.ceiling, 1 / steepest)))
    terms = unit * rows.a, unit * rows.b, rows.c
    at_start, at_end = zip(*((values[:-1], values[1:]) for values in terms), strict=True)
    scaled_start, scaled_end = (speed / np.sqrt(unit) for speed in speeds)
    ceiling = rows.ceiling / unit
    result = largest_speeds(
        grid, at_start, at_end, ceiling, speeds=(scaled_start, scaled_end), exact_ends=True
    )
    return None if result is None else unit * result
