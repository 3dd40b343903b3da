"""The backward and the forward pass of TOPP-RA, which find the fastest motion on a grid.

TOPP-RA computes the fastest timing of a given path q(s). A motion is described by the squared path
speed ṡ² = (ds/dt)² at the grid points, and s̈ is constant between them. For the interval of length
Δ from grid point s_i to s_{i+1}, let x be ṡ² at its start, and w be ṡ² at its end, so that s̈ =
(w − x) / 2Δ. The constraints a s̈ + b ṡ² + c ≤ 1 at both ends become p x + q w ≤ r. For a given x,
w must lie below the lines with q > 0 and above those with q < 0,

    L_i(x) ≤ w ≤ U_i(x),   (1)

where U_i is the minimum of the former lines, and L_i the maximum of the latter. U_i is concave, and
L_i is convex.

The backward pass computes the controllable values of ṡ² at every s_i. A value is controllable if a
motion within the constraints leads from it to the end. The controllable values form an interval
[lo_i, hi_i]. It contains all x with

    least_i ≤ x ≤ most_i (where L_i ≤ U_i),   L_i(x) ≤ hi_{i+1},   lo_{i+1} ≤ U_i(x).   (2)

where least_i and most_i are the ends of the range in which L_i ≤ U_i. Each line of (1) that bounds
x in (2) is solved for x. Thus hi_i is a minimum, and lo_i a maximum, of linear functions of
hi_{i+1} and lo_{i+1}. The forward pass takes the largest controllable value at every point, x_{i+1}
= min(U_i(x_i), hi_{i+1}). native/reachability.c computes both passes. If the package was built
without a C compiler, the package toppra computes them, which takes about forty times as long.

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
    takes the largest of them (see the module's docstring). The compiled C code computes both passes
    if it is available. Otherwise, the package toppra does.

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
    # The C function writes to `result`. The workspace holds the bounds lo and hi of ṡ² at the n + 1
    # grid points, and the intercept and slope of every line. Each of the m constraints gives two
    # lines on an interval, one for each of its ends. This makes 4 m numbers for the lines U_i of
    # every interval, and 4 m more for the lines L_i of the present interval. Another 4 m numbers
    # remain unused.
    pointers = [ctypes.c_void_p(values.ctypes.data) for values in (*arrays, result, workspace)]
    sizes = map(ctypes.c_long, (n, m))
    ends = map(ctypes.c_double, (speeds[0] ** 2, speeds[1] ** 2))
    return result if native.ssm_fastest(*sizes, *pointers[:5], *ends, *pointers[5:]) else None


def _fastest_by_toppra(
    grid: Array, rows: LinearConstraints, speeds: tuple[float, float]
) -> Array | None:
    """Compute the fastest motion on a grid by the package toppra instead of the compiled C code.

    The tolerances of toppra are absolute, about 1e-8. ṡ² is therefore expressed in thousandths of
    its typical value, so that the tolerances are small in comparison.

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
    # Two limits bound ṡ² at each point: the ceiling, and the steepest row, because s̈ ≤ 1 / a lets
    # ṡ² grow to about 1 / a over the path. The median of the smaller bound is a typical value.
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
