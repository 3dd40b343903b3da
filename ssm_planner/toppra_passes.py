"""Compute the fastest timing of a path by the package toppra.

TOPP-RA [1] limits the speed ṡ and the acceleration s̈ along a path s by linear rows. A backward
pass computes the speeds from which the end can be reached, and a forward pass takes the largest of
them.

[1] H. Pham, Q.-C. Pham, A new approach to time-optimal path parameterization based on reachability
analysis, IEEE Trans. Robotics 34, 2018.
"""

import logging
from typing import Any

import numpy as np

from ssm_planner.typing import Array

Rows = tuple[Array, Array, Array]
"""Coefficients a, b and c of rows a s̈ + b ṡ² + c ≤ 1 at n points, (n, rows) each."""
SMALLEST_COEFFICIENT = 1e-9
"""Smallest coefficient by which a row is divided, and tolerance of rows without coefficients."""


def largest_speeds(
    grid: Array,
    start_rows: Rows,
    end_rows: Rows,
    ceiling: Array,
    *,
    speeds: tuple[float, float],
    exact_ends: bool,
) -> Array | None:
    """Compute the largest squared speeds ṡ² on a grid of n intervals of a path.

    The acceleration s̈ is constant in each interval.

    Parameters
    ----------
    grid : (n + 1,)
        Ends of the intervals.
    start_rows, end_rows : Rows
        Rows at the start and at the end of every interval.
    ceiling : (n + 1,)
        Largest ṡ² that speed limits allow.
    speeds : (float, float)
        Speed ṡ at both ends of the path.
    exact_ends : bool
        If false, the motion may be slower at its ends.

    Returns
    -------
    (n + 1,) or None
        Largest ṡ² at the ends of the intervals, or None if no motion is possible.
    """
    import toppra
    from toppra.constraint import LinearConstraint
    from toppra.interpolator import AbstractGeometricPath

    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    a_start, b_start, c_start = start_rows
    a_end, b_end, c_end = end_rows
    # With s̈ = u and ṡ² = x at the start of an interval of length Δ, ṡ² is x + 2 u Δ at its end.
    a = np.hstack([a_start, a_end + 2 * np.diff(grid)[:, None] * b_end])
    b = np.hstack([b_start, b_end])
    c = np.hstack([c_start, c_end])
    row_scale = np.maximum(np.maximum(np.abs(a), np.abs(b)), SMALLEST_COEFFICIENT)
    if ((row_scale == SMALLEST_COEFFICIENT) & (c > 1 + SMALLEST_COEFFICIENT)).any():
        return None
    # The rows of the last interval also apply to the end of the path.
    points = np.append(np.arange(len(a)), len(a) - 1)
    a = (a / row_scale)[points]
    b = (b / row_scale)[points]
    c = ((c - 1) / row_scale)[points]

    class Path(AbstractGeometricPath):  # type: ignore[misc, no-any-unimported]
        dof, path_interval, waypoints = 1, grid[[0, -1]], None

    class Limits(LinearConstraint):  # type: ignore[misc, no-any-unimported]
        def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
            count = a.shape[1]
            bounds = np.column_stack([np.zeros_like(ceiling), ceiling])
            return a, b, c, np.eye(count), np.zeros(count), None, bounds

    constraint = Limits()
    constraint.identical = True  # The factor of the rows is the same at every point.
    algorithm = toppra.algorithm.TOPPRA([constraint], Path(), grid, solver_wrapper="seidel")
    start_speed, end_speed = speeds
    controllable = algorithm.compute_controllable_sets(end_speed if exact_ends else 0.0, end_speed)
    # compute_parameterization would otherwise compute them again, for exact ends.
    algorithm.compute_controllable_sets = lambda *_: controllable
    if not exact_ends:
        start_speed = np.sqrt(min(start_speed**2, controllable[0, 1]))
    _, speed, _, _ = algorithm.compute_parameterization(start_speed, end_speed, return_data=True)
    return None if speed is None or not np.isfinite(speed).all() else np.square(speed)
