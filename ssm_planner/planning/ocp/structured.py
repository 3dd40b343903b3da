"""Solution of a nonlinear program by the structured interior-point solver (package `interior`).

The program is the one that `transcription` states for Ipopt, in another form. The mesh divides the
motion into elements (time intervals), on which the coordinates u (the path parameter or the joints)
are cubic polynomials of time. Here the unknowns are the coefficients of a spline. Neighbouring
elements then join without constraints, and limits of ü and jerk are linear in the variables of one
element. Equality constraints remain in two cases. One is a given duration. The other is a
jerk-limited coordinate that passes a given point, reverses there, or begins or ends at speed.

The vector z (5 m + 1,) describes an element with m coordinates: u, u̇, ü at the start, ü at the end
(m entries each), the length, and the middle Bernstein coefficient of u̇ (m entries). u̇ is a parabola
in an element, and keeps a bound if its three Bernstein coefficients do. The element model
(`elements.element.ElementModel`) gives the path constraints and the cost as functions of z.

`solve_structured` is the main entry. It needs the compiled part of the package.
"""

from typing import Any

import numpy as np

from ssm_planner.elements.compiled import Location, NativeElements, native_elements
from ssm_planner.elements.element import ElementModel
from ssm_planner.interior.problem import Point, Program, RowGroup
from ssm_planner.interior.solve import solve
from ssm_planner.interior.spline import Spline
from ssm_planner.planning.ocp.nlp import (
    Multipliers,
    NlpData,
    NlpSolution,
    NlpStructure,
    as_cubics,
    stretched,
)
from ssm_planner.planning.ocp.transcription import BLOCK_VARIANCE_WEIGHT, SMOOTHING_WEIGHT
from ssm_planner.typing import Array, Indices

MAX_ITERATIONS = 600
"""Largest number of iterations of one attempt, that is, with one of `BARRIER_EXPONENTS`."""
BARRIER_EXPONENTS = 1.5, 1.2, 1.1, 1.3
"""Exponents e with which the barrier weight decreases, μ → μ^e, in the order of the attempts.

One of the attempts usually converges. Only a motion with limited jerk, or with a single unknown
duration, is tried with the first exponent, which is accurate and fast.
"""
GUESS_SLOWDOWN = 1.2
"""Factor on the duration of a guess. The slower motion violates fewer constraints."""
NOT_CONVERGED = "Structured_Solver_Not_Converged"
"""Message of a solution that did not converge."""
CENTRING_TOLERANCE = 1e-3
"""Largest relative deviation of slack · multiplier from the barrier weight, if Ipopt continues.

A slack is the distance of a constraint from its bound. Ipopt computes its first multipliers as
barrier weight / slack. They are exact if the product of slack and multiplier is the barrier weight.
"""
Equalities = tuple[Indices, Indices, Array]
"""Equality constraints z_k[i] = value, as in `interior.problem.Program.equal`.

For q constraints, these are three arrays (q,): the index k of the element (time interval), the
index i of the entry of its vector z, and the value.
"""


def solve_structured(
    structure: NlpStructure,
    element: ElementModel,
    data: NlpData,
    start: Array,
    *,
    warm: NlpSolution | None = None,
    iterations: int = MAX_ITERATIONS,
    slow_barrier: bool = False,
    centred: bool = False,
) -> NlpSolution:
    """Solve a nonlinear program by the structured interior-point solver.

    An interior-point solver adds a logarithmic barrier of the constraints to the objective, and
    reduces its weight μ in steps μ → μ^e. The function tries the exponents e in `BARRIER_EXPONENTS`
    one after the other until the solver converges.

    Parameters
    ----------
    structure : NlpStructure
        Numbers of elements, segments and blocks, and kinds of constraints of the program.
    element : ElementModel
        Path constraints and cost as functions of the motion in one element (time interval).
    data : NlpData
        Parameters and bounds of the program.
    start : (n, 4 m + 1) array
        Elements of a guess: u, u̇, ü at the start, ü at the end (m numbers each), and length.
    warm : NlpSolution or None
        Solution of a similar program by this solver. The first attempt starts at its variables and
        multipliers (a warm start), and the other attempts start at the guess. None: all attempts
        start at the guess.
    iterations : int
        Largest number of iterations of an attempt. Below `MAX_ITERATIONS`, only one exponent is
        tried.
    slow_barrier : bool
        True if the barrier weight must decrease slowly, because a path constraint has rounded
        edges. The first of `BARRIER_EXPONENTS` is then skipped.
    centred : bool
        True if the solver must stop close to the central path. On this path, the product of the
        slack (distance from the bound) and the multiplier is the barrier weight for every
        constraint, so Ipopt can compute the multipliers from the slacks.

    Returns
    -------
    NlpSolution
        The solution of the first attempt that converged. If none did, the last iterate of the last
        attempt with the message `NOT_CONVERGED`.
    """
    program = build_program(structure, element, data)
    state = None if warm is None else warm.structured_state
    total_iterations = 0
    initial = _initial_point(program, structure, data, start)
    accurate = structure.has_continuous_acceleration or len(data.least_times) == 1
    # The first exponent is only reliable for these programs (see `BARRIER_EXPONENTS`).
    is_fast = accurate and not slow_barrier
    exponents: tuple[float, ...] = BARRIER_EXPONENTS if is_fast else BARRIER_EXPONENTS[1:]
    # A short solve has no time for several attempts.
    if iterations < MAX_ITERATIONS:
        exponents = exponents[:1]
    # After a failed warm start, the same exponent is tried from the guess.
    for barrier_exponent in exponents if state is None else (exponents[0], *exponents):
        outcome = solve(
            program,
            initial,
            warm=state,
            iterations=iterations,
            barrier_exponent=barrier_exponent,
            centring_tolerance=CENTRING_TOLERANCE if centred else np.inf,
        )
        total_iterations += outcome.iterations
        if outcome.converged:
            break
        state = None
    multipliers = outcome.state.multipliers
    return NlpSolution(
        "Solve_Succeeded" if outcome.converged else NOT_CONVERGED,
        structure,
        outcome.z[:, : 4 * structure.coordinates + 1],  # without the Bernstein coefficients
        total_iterations,
        solver="structured",
        structured_state=outcome.state,
        objective=outcome.objective,
        multipliers=_multipliers(program, structure, element, data, rows=multipliers),
    )


def _multipliers(
    program: Program, structure: NlpStructure, element: ElementModel, data: NlpData, *, rows: Array
) -> Multipliers:
    """Select the multipliers of path constraints and directions from those of all constraints.

    A direction constraint is the bound of u̇ that forbids a coordinate u to reverse.

    Parameters
    ----------
    program : Program
        Program of the structured solver.
    structure : NlpStructure
        Structure of this program with n elements (time intervals) and m coordinates.
    element : ElementModel
        Functions of one element. Only the names of its r path constraints are used.
    data : NlpData
        Bounds of the program. Those of u̇ determine the directions of the coordinates.
    rows : (all inequality constraints,) array
        Multipliers in the order of `interior.problem.Program.sizes`: those of the groups (path
        constraints, then breakaway constraints), then those of the linear constraints of each
        element. Further multipliers are not used.

    Returns
    -------
    Multipliers
        Multipliers of the path constraints, (n, 3 r), and of the directions, (n, m).
    """
    n, m = structure.elements, structure.coordinates
    sizes = [group.bound.size for group in program.groups]
    path_multipliers = rows[: sizes[0] if element.row_names else 0].reshape(n, -1)
    linear_multipliers = rows[sum(sizes) :][: program.bound.size].reshape(n, -1)
    # For each element, `_linear_rows` first contains upper bounds of u, u̇, ü at the start, ü at
    # the end, and the middle Bernstein coefficient of u̇, m each. Then follow as many lower bounds.
    # Both u̇ at the start and the Bernstein coefficient bound the velocity, so their multipliers are
    # added.
    of_bounds = linear_multipliers[:, : 10 * m].reshape(n, 2, 5, m)
    upper, lower = (of_bounds[:, side, 1] + of_bounds[:, side, 4] for side in (0, 1))
    return Multipliers.of_bounds(data, lower, upper, path_multipliers, frozenset(element.row_names))


def build_program(structure: NlpStructure, element: ElementModel, data: NlpData) -> Program:
    """Convert a nonlinear program to the form that the structured solver reads.

    Parameters
    ----------
    structure : NlpStructure
        Numbers of elements, segments and blocks, and kinds of constraints of the program.
    element : ElementModel
        Path constraints and cost as functions of the motion in one element (time interval).
    data : NlpData
        Parameters and bounds of the program.

    Returns
    -------
    Program
        The spline whose coefficients are the unknowns, the nonlinear constraints in groups with the
        same functions, and the linear constraints.
    """
    n, m = structure.elements, structure.coordinates
    # A spline of a motion from rest to rest contains velocities relative to the duration. A change
    # of the duration then stretches the whole motion (`Spline.stretched_from`).
    at_speed = data.lower[0, m : 2 * m].any() or data.end[m:].any()
    spline = Spline(
        "bspline" if structure.has_continuous_acceleration else "hermite",
        m,
        data.fractions,
        structure.block,
        None if at_speed else float(data.least_times.sum()),
    )
    free, _, equal = _boundary_values(structure, spline, data)
    matrix, bound = _linear_rows(structure, data)
    # One group contains the path constraints and the cost of all elements, the other one the
    # breakaway constraints. A group that would be empty is left out.
    groups = []
    if element.row_names or element.aim != "time":
        functions = _compiled_functions(element, data.element_parameters, n, "collocation")
        groups.append(RowGroup(functions, np.arange(n), data.path_bound, data.weights[1]))
    if np.isfinite(data.breakaway_bound).any():
        # A joint breaks away (starts against static friction) at the start of element k, in the
        # direction that it has in element j, for each pair (k, j). The directions σ are therefore
        # those of element j, and all other parameters are those of element k.
        element_indices, direction_indices = np.array(structure.breakaways).T
        sigma, *other_parameters = data.element_parameters
        parameters = (
            sigma[direction_indices],
            *(
                values if values.ndim == 1 else values[element_indices]
                for values in other_parameters
            ),
        )
        functions = _compiled_functions(element, parameters, len(element_indices), "breakaway")
        groups.append(RowGroup(functions, element_indices, data.breakaway_bound))
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
        smoothing=SMOOTHING_WEIGHT / data.acceleration**2,
        block_variance_weight=BLOCK_VARIANCE_WEIGHT if len(data.least_times) > 1 else 0.0,
    )


def _compiled_functions(
    element: ElementModel, parameters: tuple[Array, ...], count: int, location: Location
) -> NativeElements:
    """Return the compiled functions of several elements (time intervals).

    Parameters
    ----------
    element : ElementModel
        Path constraints, breakaway constraints and cost as functions of the motion in one element.
    parameters : tuple of arrays
        Parameter vectors of these functions, for example the limits: (size,) for a vector that all
        elements share, (count, size) otherwise.
    count : int
        Number of elements.
    location : str
        "collocation" for the path constraints and the cost, "breakaway" for the constraints on the
        torque of a joint that starts to move against static friction.

    Raises
    ------
    RuntimeError
        If the compiled part of the package is missing.
    """
    functions = native_elements(element, parameters, count, location)
    if functions is None:
        raise RuntimeError("the structured solver needs the compiled part, which is not installed")
    return functions


def _boundary_values(
    structure: NlpStructure, spline: Spline, data: NlpData
) -> tuple[Array, Array, Equalities]:
    """Convert the given positions and velocities of a motion to values of the spline's unknowns.

    A given value that equals one unknown fixes this unknown. A given value that depends on several
    unknowns becomes an equality constraint.

    Parameters
    ----------
    structure : NlpStructure
        Numbers n of elements (time intervals) and m of coordinates u, and in which elements a
        coordinate moves.
    spline : Spline
        Spline whose coefficients are the unknowns, `spline.rows` for each coordinate.
    data : NlpData
        Bounds of the program. Equal lower and upper bounds give a value.

    Returns
    -------
    free : (rows, m) mask
        True for unknowns that the given values leave free.
    values : (rows, m) array
        Values of the other unknowns. The entries of free unknowns have no meaning.
    equalities : Equalities
        Equality constraints for given values that depend on several unknowns.
    """
    m = structure.coordinates
    if spline.kind == "bspline":
        free, values, equalities = _bspline_boundary_values(structure, spline, data)
    else:
        # The unknowns are u and u̇ at the n + 1 ends of the elements, in two rows for each end. All
        # of them are given at the end of the motion.
        is_fixed = np.vstack([data.is_fixed[:, : 2 * m], np.ones((1, 2 * m), dtype=bool)])
        state_values = np.vstack([data.lower[:, : 2 * m], data.end])
        free = ~is_fixed.reshape(spline.rows, m)
        values = state_values.reshape(spline.rows, m)
        equalities = []
    index, entry, value = np.array(equalities, dtype=float).reshape(-1, 3).T
    return free, values, (index.astype(int), entry.astype(int), value)


def _bspline_boundary_values(
    structure: NlpStructure, spline: Spline, data: NlpData
) -> tuple[Array, Array, list[tuple[Any, Any, Any]]]:
    """Convert the given values of a jerk-limited motion to values of the coefficients of B-splines.

    Parameters
    ----------
    structure, spline, data
        As for `_boundary_values`.

    Returns
    -------
    free, values : (rows, m) arrays
        As for `_boundary_values`.
    equalities : list of (int, int, float)
        Equality constraints: index of the element, index of the entry of its vector z, and value of
        this entry.
    """
    n, m = structure.elements, structure.coordinates
    free = np.ones((spline.rows, m), dtype=bool)
    values = np.zeros((spline.rows, m))
    # The four coefficients of a coordinate in an element in which it rests are its position.
    for k, i in np.argwhere(~structure.moving):
        free[spline.rows_of_elements[k], i] = False
        values[spline.rows_of_elements[k], i] = data.lower[k, i]
    equalities: list[tuple[Any, Any, Any]] = []
    # u is given at both ends of the motion. If u̇ and ü are 0 there, the three outermost coefficients
    # are equal to u. Otherwise, only the outermost one is, and u̇ and ü (in `rates`) become equality
    # constraints. z contains u̇ only at the start of an element. At the end of the motion, the middle
    # Bernstein coefficient of u̇ (entry 4 m + 1 of z) replaces it. Both are equal there, because
    # ü = 0.
    start_rates = data.lower[0, m : 3 * m].reshape(2, m)
    end_rates = np.stack([data.end[m:], np.zeros(m)])
    for rows, k, position, rates, entries in (
        ([0, 1, 2], 0, data.lower[0, :m], start_rates, (m, 2 * m)),
        ([-1, -2, -3], n - 1, data.end[:m], end_rates, (4 * m + 1, 3 * m)),
    ):
        values[rows] = position
        free[rows[0]] = False
        is_moving = rates.any(axis=0)
        free[rows[1:]] &= is_moving
        equalities += [
            (k, entry + i, rate[i])
            for i in np.flatnonzero(is_moving)
            for entry, rate in zip(entries, rates, strict=True)
        ]
    return free, values, equalities + _via_equalities(structure, data)


def _via_equalities(structure: NlpStructure, data: NlpData) -> list[tuple[Any, Any, Any]]:
    """Return the equality constraints of a jerk-limited motion at its via points.

    A via point is a given point between the start and the end of the motion. For a coordinate that
    moves before and after the point, the constraints impose the given position, and the velocity 0
    if the coordinate reverses there. A coordinate that rests before or after the point needs no
    constraint, because its spline coefficients at the point are fixed already.

    Parameters
    ----------
    structure : NlpStructure
        First elements of the segments, and in which elements a coordinate moves.
    data : NlpData
        Bounds of the program. Equal lower and upper bounds fix a value.

    Returns
    -------
    list of (int, int, float)
        For each constraint: the index of the element (time interval) that begins at the point, the
        index of the entry in its vector z (u, then u̇ at the start), and the value of this entry.
    """
    m, moving = structure.coordinates, structure.moving
    # The entries 0 to m − 1 of z are u, and the entries m to 2 m − 1 are u̇. Hence entry % m is the
    # index of the coordinate.
    return [
        (k, entry, data.lower[k, entry])
        for k in structure.borders[1:]
        for entry in np.flatnonzero(data.is_fixed[k, : 2 * m])
        if moving[k - 1, entry % m] and moving[k, entry % m]
    ]


def _linear_rows(structure: NlpStructure, data: NlpData) -> tuple[Array, Array]:
    """Return the linear constraints A z ≤ b_k of the elements (time intervals) k.

    They bound u̇ at the start of an element, the middle Bernstein coefficient of u̇, ü at both ends,
    the jerk if it is limited, and u where a coordinate may reverse. u̇ is a parabola in an element,
    so it keeps a bound in the whole element if all its Bernstein coefficients do.

    Parameters
    ----------
    structure : NlpStructure
        Numbers of elements and coordinates, and kinds of constraints of the program.
    data : NlpData
        Bounds of the program.

    Returns
    -------
    matrix : (l, 5 m + 1) array
        A, with one row for each of the l constraints. Its columns are the entries of z: u, u̇, ü at
        the start, ü at the end (m entries each), the length, and the m middle Bernstein
        coefficients of u̇.
    bound : (n, l) array
        b_k, infinite where a constraint does not apply.
    """
    n, m = structure.elements, structure.coordinates
    # Rows that select the entries of z with bounds. These are all except the length.
    entries = np.eye(5 * m + 1)
    length = entries[4 * m]
    bounded = np.delete(entries, 4 * m, axis=0)
    v_min, v_max = data.velocity
    # Fixed values are not bounded.
    lower = np.hstack([np.where(data.is_fixed, -np.inf, data.lower), v_min])
    upper = np.hstack([np.where(data.is_fixed, np.inf, data.upper), v_max])
    matrix = np.vstack([bounded, -bounded])
    bound = np.hstack([upper, -lower])
    if structure.limits_jerk:
        # |ü(h) − ü(0)| ≤ jerk · h as two rows for each coordinate. They are divided by jerk / n,
        # because n h is about 1. All rows then have values of similar size.
        rise = (entries[3 * m : 4 * m] - entries[2 * m : 3 * m]) * (n / data.jerk)[:, None]
        matrix = np.vstack([matrix, rise - n * length, -rise - n * length])
        bound = np.hstack([bound, np.where(np.tile(structure.moving, 2), 0.0, np.inf)])
    return matrix, bound


def _initial_point(
    program: Program, structure: NlpStructure, data: NlpData, elements: Array
) -> Point:
    """Convert the guess of a motion to the initial point of the solver, and slow the motion down.

    The guess is slowed down by the factor `GUESS_SLOWDOWN`, because a slower motion violates fewer
    limits. It is not slowed down if the program bounds the total duration.

    Parameters
    ----------
    program : Program
        Program of the structured solver.
    structure : NlpStructure
        Numbers of elements and blocks of the program.
    data : NlpData
        Bounds of the program.
    elements : (n, 4 m + 1) array
        Elements of the guess: u, u̇, ü at the start, ü at the end (m numbers each), and length.

    Returns
    -------
    Point
        Coefficients of the spline, and durations of the blocks in scaled time. A block is a group
        of elements that share one unknown duration.
    """
    m = structure.coordinates
    # The solver must start strictly inside the bounds of the durations, so a small margin is added.
    times = np.maximum(structure.times(elements[:, -1]), 1.001 * data.least_times)
    if data.duration == (0.0, np.inf):
        elements, times = stretched(elements, GUESS_SLOWDOWN), times * GUESS_SLOWDOWN
    h = times[structure.block] * data.fractions
    # u, u̇ and ü at the ends of all elements, (n + 1, m). At an inner end, ü is the mean of its
    # values on both sides.
    pieces = as_cubics(elements)
    u = np.vstack([pieces.u, data.end[:m]])
    v = np.vstack([pieces.v, data.end[m:]])
    acceleration = np.vstack([pieces.a0[:1], (pieces.a1[:-1] + pieces.a0[1:]) / 2, pieces.a1[-1:]])
    unknowns = program.spline.unknowns(u, v, acceleration, h)
    _, values, _ = _boundary_values(structure, program.spline, data)
    return Point(np.where(program.free, unknowns, values), times)
