"""Compute the fastest timing of a path with the package toppra.

A timing assigns a speed ṡ to every point s of a path. TOPP-RA [1] describes the limits of the
motion by rows, that is, by inequalities that are linear in ṡ² and in the acceleration s̈. A
backward pass along the path computes the speeds from which the end can be reached, and a forward
pass takes the largest of them at each point. The planner and the cross-check of its result call
`largest_speeds`.

[1] H. Pham, Q.-C. Pham, A new approach to time-optimal path parameterization based on reachability
analysis, IEEE Trans. Robotics 34, 2018.
"""

import logging
from typing import Any

import numpy as np

from ssm_planner.typing import Array

Rows = tuple[Array, Array, Array] | Array
"""Coefficients a, b and c of k rows a s̈ + b ṡ² + c ≤ 1 in each of n intervals, (n, k) each.

They are three arrays or one array of the shape (3, n, k).
"""
SMALLEST_COEFFICIENT = 1e-9
"""Smallest coefficient by which a row is divided.

It is also the tolerance of rows that contain neither s̈ nor ṡ², so that only c ≤ 1 remains.
"""


def largest_speeds(
    grid: Array,
    start_rows: Rows,
    end_rows: Rows,
    ceiling: Array,
    *,
    speeds: tuple[float, float] | Array,
    exact_ends: bool,
) -> Array | None:
    """Compute the largest squared path speeds that a set of limits permits.

    The path is given by a parameter s, whose n intervals form a grid. The path speed is ṡ, and s̈
    is the path acceleration.

    Parameters
    ----------
    grid : (n + 1,) array
        Values of s at the ends of the intervals, increasing.
    start_rows : Rows
        Rows that apply at the start of every interval.
    end_rows : Rows
        Rows that apply at the end of every interval.
    ceiling : (n + 1,) array
        Largest ṡ² that speed limits allow at each grid point.
    speeds : (float, float) or (2,) array
        Speeds ṡ at the start and at the end of the path.
    exact_ends : bool
        True if the motion must have exactly these speeds. If false, the motion may be slower at its
        ends.

    Returns
    -------
    (n + 1,) array or None
        Largest ṡ² at the grid points, or None if no timing satisfies all rows.

    Notes
    -----
    The acceleration s̈ is constant in each interval, so ṡ² grows by 2 s̈ Δ over an interval of the
    length Δ. With this relation, the rows at the end of an interval become rows in s̈ and in ṡ² at
    its start. Every row is divided by the larger magnitude of a and b, so that the absolute
    tolerances of toppra have the same meaning for all rows.
    """
    # toppra takes long to import, and most uses of the package do not need it.
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

    # toppra expects a path and a constraint as objects, although it only uses the rows here.
    class Path(AbstractGeometricPath):  # type: ignore[misc, no-any-unimported]
        dof, path_interval, waypoints = 1, grid[[0, -1]], None

    class Limits(LinearConstraint):  # type: ignore[misc, no-any-unimported]
        def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
            """Return the rows in toppra's form F (a s̈ + b ṡ² + c) ≤ g, with F = 1 and g = 0."""
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
