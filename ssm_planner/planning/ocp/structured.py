"""Solution of the program of `transcription` by the structured interior-point solver (`interior`).

The solver uses the fact that the program is a chain of elements. The dynamics hold by construction,
and limits of ü and jerk are linear in an element. Equalities remain if a jerk-limited coordinate
passes a point or stands there in a motion of several segments, and if the duration is given.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ssm_planner.elements.compiled import Location, native_elements
from ssm_planner.elements.element import ElementModel
from ssm_planner.interior.problem import Point, Program, RowGroup
from ssm_planner.interior.solve import SUPERLINEAR, solve
from ssm_planner.interior.spline import Spline
from ssm_planner.planning.ocp.nlp import (
    Multipliers,
    NlpData,
    NlpSolution,
    NlpStructure,
    cubics,
    stretched,
)
from ssm_planner.planning.ocp.transcription import EVEN, SMOOTHING
from ssm_planner.typing import Array, Indices

ITERATIONS = 600
"""Largest number of iterations for each exponent of the barrier."""
EXPONENTS = 1.2, 1.1, 1.3
"""Exponents by which the weight of the barrier falls. One of them usually converges.

A motion with one time, or with limited jerk, begins with SUPERLINEAR, which is more accurate.
"""
SLOWER = 1.2
"""Factor by which a guess is slowed down, so that it violates fewer rows and bounds."""
NOT_CONVERGED = "Structured_Solver_Not_Converged"
OFF_CENTRE = 1e-3
"""Relative deviation of slack times multiplier from the last barrier weight, if Ipopt starts there.
"""
Equalities = tuple[Indices, Indices, Array]
_NONE: Equalities = np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0)


def solve_structured(
    structure: NlpStructure,
    element: ElementModel,
    data: NlpData,
    start: Array,
    *,
    warm: NlpSolution | None = None,
    iterations: int = ITERATIONS,
    switching: bool = False,
    centred: bool = False,
) -> NlpSolution:
    """Solve a program by the structured solver.

    Parameters
    ----------
    structure, element, data
        The program.
    start : (n, 4 m + 1) array
        Elements of a guess.
    warm : NlpSolution or None
        Structured solution of a neighbouring program, which is tried as a start first.
    iterations : int
        Largest number of iterations. With fewer than usual, one way of lowering the barrier is
        tried instead of several.
    switching : bool
        A row has a rounded edge, which needs the patient ways.
    centred : bool
        Stop close to the central path, so that Ipopt finds its multipliers from the slacks.

    Returns
    -------
    NlpSolution
        Its status tells whether the solver converged.
    """
    program = program_of(structure, element, data)
    state = None if warm is None else warm.structured_state
    used = 0
    initial = _point(program, structure, data, start)
    accurate = structure.smooth or len(data.least_times) == 1
    exponents: tuple[float, ...] = (
        (SUPERLINEAR, *EXPONENTS) if accurate and not switching else EXPONENTS
    )
    if iterations < ITERATIONS:
        exponents = exponents[:1]
    for superlinear in exponents if state is None else (exponents[0], *exponents):
        outcome = solve(
            program,
            initial,
            warm=state,
            iterations=iterations,
            superlinear=superlinear,
            off_centre=OFF_CENTRE if centred else np.inf,
        )
        used += outcome.iterations
        if outcome.converged:
            break
        state = None
    multipliers = outcome.state.multipliers
    return NlpSolution(
        "Solve_Succeeded" if outcome.converged else NOT_CONVERGED,
        structure,
        outcome.z[:, : 4 * structure.coordinates + 1],
        used,
        solver="structured",
        structured_state=outcome.state,
        objective=outcome.objective,
        multipliers=_multipliers(program, structure, element, data, rows=multipliers),
    )


def _multipliers(
    program: Program, structure: NlpStructure, element: ElementModel, data: NlpData, *, rows: Array
) -> Multipliers:
    """Select the multipliers of path constraints and directions from those of all rows."""
    n, m = structure.elements, structure.coordinates
    sizes = [group.bound.size for group in program.groups]
    path = rows[: sizes[0] if element.row_names else 0].reshape(n, -1)
    linear = rows[sum(sizes) :][: program.bound.size].reshape(n, -1)
    # Rows of `_linear_rows`: upper bounds of (u,) u̇, ü, ü and u̇_b, then the lower ones, then
    # jerk.
    size = len(program.matrix) // 2 - m * (structure.smooth and structure.joints)
    upper, lower = (
        side[:, size - 4 * m : size - 3 * m] + side[:, size - m : size]
        for side in (linear[:, :size], linear[:, size : 2 * size])
    )
    return Multipliers.of_bounds(data, lower, upper, path, frozenset(element.row_names))


def program_of(structure: NlpStructure, element: ElementModel, data: NlpData) -> Program:
    """Return the program of a structure, an element model and data."""
    n, m = structure.elements, structure.coordinates
    # The whole motion is stretched with its times, unless it begins or ends at speed.
    at_speed = data.lower[0, m : 2 * m].any() or data.end[m:].any()
    spline = Spline(
        "bspline" if structure.smooth else "hermite",
        m,
        data.fractions,
        structure.block,
        None if at_speed else float(data.least_times.sum()),
    )
    free, _, equal = _boundary(structure, spline, data)
    matrix, bound = _linear_rows(structure, data)
    every = np.arange(n)
    groups = []
    if element.row_names or element.aim != "time":
        groups.append(
            _group(element, data.element_parameters, every, data.path_bound, data.weights[1])
        )
    if np.isfinite(data.breakaway_bound).any():
        indices, side = np.array(structure.breakaways).T
        sigma, *other_parameters = data.element_parameters
        parameters = (
            sigma[side],
            *(values if values.ndim == 1 else values[indices] for values in other_parameters),
        )
        groups.append(_group(element, parameters, indices, data.breakaway_bound, breakaway=True))
    return Program(
        spline=spline,
        groups=tuple(groups),
        matrix=matrix,
        bound=bound,
        free=free,
        equal=equal,
        least_times=data.least_times,
        duration=data.duration,
        time_weight=data.weights[0],
        smoothing=SMOOTHING / data.acceleration**2 if structure.joints else np.zeros(m),
        even=EVEN if len(data.least_times) > 1 else 0.0,
    )


def _group(
    element: ElementModel,
    parameters: tuple[Array, ...],
    elements: Indices,
    bound: Array,
    cost_weight: float = 0.0,
    *,
    breakaway: bool = False,
) -> RowGroup:
    """Return the rows and the cost of a model, or its breakaway rows."""
    location: Location = "breakaway" if breakaway else "collocation"
    native = native_elements(element, parameters, len(elements), location)
    if native is None:
        raise RuntimeError("the structured solver is in the compiled part, which is not there")
    return RowGroup(native, elements, bound, cost_weight)


def _boundary(
    structure: NlpStructure, spline: Spline, data: NlpData
) -> tuple[Array, Array, Equalities]:
    """Return the boundary conditions of the unknowns.

    These are the mask (rows, m) of free unknowns, the values of the others, and further fixed
    entries of the elements.
    """
    n, m = structure.elements, structure.coordinates
    same = np.vstack([data.is_fixed[:, : 2 * m], np.ones((1, 2 * m), dtype=bool)])
    state_values = np.vstack([data.lower[:, : 2 * m], data.end])
    if spline.kind == "hermite":
        return ~same.reshape(spline.rows, m), state_values.reshape(spline.rows, m), _NONE
    free = np.ones((spline.rows, m), dtype=bool)
    values = np.zeros((spline.rows, m))
    moving = structure.moving
    for k, i in np.argwhere(~moving):
        free[spline.local[k], i] = False
        values[spline.local[k], i] = state_values[k, i]
    equal: list[tuple[Any, Any, Any]] = []
    # Ends: u is given and ü = 0. u̇ is 0 or has a given value.
    for rows, k, speed, entries in (
        ((0, 1, 2), 0, state_values[0, m:], (m, 2 * m)),
        ((-1, -2, -3), n - 1, state_values[-1, m:], (4 * m + 1, 3 * m)),
    ):
        values[list(rows)] = state_values[k + (k > 0), :m]
        free[rows[0]] = False
        free[list(rows[1:])] &= speed != 0
        for i in np.flatnonzero(speed):
            equal += [(k, entries[0] + i, speed[i]), (k, entries[1] + i, 0.0)]
    equal += _via_equalities(structure, data)
    if not equal:
        return free, values, _NONE
    index, entry, value = np.array(equal).T
    return free, values, (index.astype(int), entry.astype(int), value)


def _via_equalities(structure: NlpStructure, data: NlpData) -> list[tuple[Any, Any, Any]]:
    """Return the fixed entries (element, entry of z, value) at via points.

    They count between segments in which the coordinate moves.
    """
    m, moving = structure.coordinates, structure.moving
    return [
        (k, e, data.lower[k, e])
        for k in structure.borders[1:]
        for e in np.flatnonzero(data.is_fixed[k, : 2 * m])
        if moving[k - 1, e % m] and moving[k, e % m]
    ]


def _linear_rows(structure: NlpStructure, data: NlpData) -> tuple[Array, Array]:
    """Return A (l, 5 m + 1) and bounds (n, l) of the linear rows.

    They bound u̇ at the start and between, ü and jerk, and u where it may reverse.
    """
    n, m = structure.elements, structure.coordinates
    counts = data.bounds_of_u_count(structure)
    v_min, _ = data.velocity
    offset = 0 if counts.any() else m
    columns = np.r_[offset : 4 * m, 4 * m + 1 : 5 * m + 1]
    identity = np.eye(5 * m + 1)[columns]
    counts = np.hstack([counts, ~data.is_fixed[:, m:]])
    v_bounds = data.velocity if structure.velocity_limits else (v_min, np.full((n, m), np.inf))
    lower, upper = (
        np.hstack([np.where(counts, bound, sign * np.inf)[:, offset:], middle])
        for sign, bound, middle in zip((-1, 1), (data.lower, data.upper), v_bounds, strict=True)
    )
    matrix = np.vstack([identity, -identity])
    bound = np.hstack([upper, -lower])
    if structure.smooth and structure.joints:
        rise = np.zeros((m, 5 * m + 1))
        rise[:, 2 * m : 3 * m] = np.diag(-n / data.jerk)
        rise[:, 3 * m : 4 * m] = np.diag(n / data.jerk)
        fall = -rise
        rise[:, 4 * m] = fall[:, 4 * m] = -n
        matrix = np.vstack([matrix, rise, fall])
        bound = np.hstack([bound, np.where(np.tile(structure.moving, 2), 0.0, np.inf)])
    return matrix, bound


def _point(program: Program, structure: NlpStructure, data: NlpData, elements: Array) -> Point:
    """Return the unknowns of a guess of elements (n, 4 m + 1), slowed down."""
    m = structure.coordinates
    times = np.maximum(structure.times(elements[:, -1]), 1.001 * data.least_times)
    if data.duration == (0.0, np.inf):
        elements, times = stretched(elements, SLOWER), times * SLOWER
    h = times[structure.block] * data.fractions
    pieces = cubics(elements)
    u = np.vstack([pieces.u, data.end[:m]])
    v = np.vstack([pieces.v, data.end[m:]])
    acceleration = np.vstack([pieces.a0[:1], (pieces.a1[:-1] + pieces.a0[1:]) / 2, pieces.a1[-1:]])
    c = program.spline.unknowns(u, v, acceleration, h)
    _, values, _ = _boundary(structure, program.spline, data)
    return Point(np.where(program.free, c, values), times)
