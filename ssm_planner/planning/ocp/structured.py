"""The program of `transcription`, solved by the structured interior point (`interior`), which knows that it is a chain.

The dynamics hold by construction and limits of ü and jerk are linear in an element, so the only equalities left are where a
coordinate passes a point, or stands there, of a jerk-limited motion of several segments, and a given duration.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from ssm_planner.interior.problem import Point, Program, RowGroup
from ssm_planner.interior.solve import BARRIER, SUPERLINEAR, TOLERANCE, solve
from ssm_planner.interior.spline import Spline
from ssm_planner.planning.kept import SameObject, kept
from ssm_planner.planning.ocp.element import ElementModel
from ssm_planner.planning.ocp.natively import native_elements
from ssm_planner.planning.ocp.nlp import InitialPoint, NlpData, NlpSolution, NlpStructure, cubics
from ssm_planner.planning.ocp.transcription import EVEN, SMOOTHING
from ssm_planner.typing import Array, Indices

ITERATIONS = 200
"""At most, each way; then Ipopt solves."""
SLOWLY = 1.2
"""Exponent of the barrier where the usual one does not converge; the first one of motions with several times and
without jerk limits, on which the usual one fails more often and takes more iterations."""
PATIENT = 1.2, 1.1, 1.3
"""Exponents of the barrier where a row has a rounded edge, as that of the lens: one or another passes it."""
SLOWER = 1.2
"""By how much a guess is slowed down: fewer of its rows are exceeded then."""
NEAR_BARRIER, NEAR_SLOWER = 3e-6, 1.05
"""The barrier's first weight, and the same of a guess that is near a solution: larger ones lead away from it."""
NOT_CONVERGED = "Structured_Solver_Not_Converged"
OFF_CENTRE = 1e-3
"""Share by which slack times multiplier may be off the last barrier's weight where Ipopt is to start from it."""
Equalities = tuple[Indices, Indices, Array]
_NONE: Equalities = np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0)


def solve_structured(
    structure: NlpStructure,
    element: ElementModel,
    data: NlpData,
    start: InitialPoint,
    *,
    iterations: int = ITERATIONS,
    switching: bool = False,
    centred: bool = False,
    tolerance: float = TOLERANCE,
) -> NlpSolution:
    """Solution from a guess, or from the structured solution of a neighbour; its status says whether it converged.

    Where a neighbour's multipliers mislead, its motion alone is tried as a start. Several ways of lowering the barrier are
    tried unless fewer iterations are allowed than usual; switching: a row has a rounded edge, at which it takes patience.
    centred: Ipopt is to find its multipliers from the slacks. tolerance: of the stopping test.
    """
    asked = _Asked(iterations, switching, centred, tolerance)
    begin = start.x.tobytes(), start.near, SameObject(start.structured)
    key = structure, element, _content(data), begin, asked
    return kept(key, lambda: _solved(structure, element, data, start, asked))


class _Asked(NamedTuple):
    """How it is to be solved, as for `solve_structured`."""

    iterations: int
    switching: bool
    centred: bool
    tolerance: float


def _content(data: NlpData) -> tuple[object, ...]:
    """All that it holds, to compare."""
    values = (getattr(data, each.name) for each in fields(data))
    return tuple(_comparable(value) for value in values)


def _comparable(value: Any) -> Any:
    return (
        tuple(map(_comparable, value))
        if isinstance(value, tuple)
        else getattr(value, "tobytes", lambda: value)()
    )


def _solved(
    structure: NlpStructure,
    element: ElementModel,
    data: NlpData,
    start: InitialPoint,
    asked: _Asked,
) -> NlpSolution:
    program, warm, used = program_of(structure, element, data), start.structured, 0
    begin = _point(program, structure, data, start.x)
    near = _point(program, structure, data, start.x, NEAR_SLOWER) if start.near else None
    ways: tuple[float, ...] = PATIENT if asked.switching else (SUPERLINEAR, SLOWLY)
    if not asked.switching and not structure.smooth and len(data.least_times) > 1:
        ways = ways[::-1]
    if asked.iterations < ITERATIONS:
        ways = ways[:1]
    for superlinear in ways if warm is None and near is None else (ways[0], *ways):
        outcome = solve(
            program,
            near or begin,
            warm=warm,
            iterations=asked.iterations,
            tolerance=asked.tolerance,
            superlinear=superlinear,
            barrier=BARRIER if near is None else NEAR_BARRIER,
            off_centre=OFF_CENTRE if asked.centred else np.inf,
        )
        used += outcome.iterations
        if outcome.converged:
            break
        warm = near = None
    m, state = structure.coordinates, outcome.state
    elements, times = outcome.z[:, : 4 * m + 1], state.point.times
    x = np.append(elements[:, :-1].ravel(), times)
    point = InitialPoint(x, structured=state)
    return NlpSolution(
        "Solve_Succeeded" if outcome.converged else NOT_CONVERGED,
        structure,
        elements,
        times,
        iterations=used,
        point=point,
        solver="structured",
        objective=outcome.objective,
    )


def program_of(structure: NlpStructure, element: ElementModel, data: NlpData) -> Program:
    """The program of this structure, element model and data."""
    n, m = structure.elements, structure.coordinates
    # the whole motion is stretched with its times, unless it begins or ends at speed
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
        at, side = np.array(structure.breakaways).T
        sigma, *others = data.element_parameters
        parameters = sigma[side], *(values if values.ndim == 1 else values[at] for values in others)
        groups.append(_group(element, parameters, at, data.breakaway_bound, breakaway=True))
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
    """The rows and the cost of a model, or its breakaway rows."""
    native = native_elements(
        element, parameters, len(elements), "breakaway" if breakaway else "collocation"
    )
    if native is None:
        raise RuntimeError("the structured solver is in the compiled part, which is not there")
    return RowGroup({}, parameters, elements, bound, cost_weight=cost_weight, native=native)


def _boundary(
    structure: NlpStructure, spline: Spline, data: NlpData
) -> tuple[Array, Array, Equalities]:
    """Which unknowns are free, (rows, m), the values of the others, and what else is given of the elements' states."""
    n, m = structure.elements, structure.coordinates
    same = np.vstack([data.given[:, : 2 * m], np.ones((1, 2 * m), dtype=bool)])
    given = np.vstack([data.lower[:, : 2 * m], data.end])
    if spline.kind == "hermite":
        return ~same.reshape(spline.rows, m), given.reshape(spline.rows, m), _NONE
    free, values = np.ones((spline.rows, m), dtype=bool), np.zeros((spline.rows, m))
    moving = structure.moving
    for k, i in np.argwhere(~moving):
        free[spline.local[k], i], values[spline.local[k], i] = False, given[k, i]
    equal: list[tuple[Any, Any, Any]] = []
    # ends: u given, ü = 0; u̇ = 0, or at speed
    for rows, k, speed, entries in (
        ((0, 1, 2), 0, given[0, m:], (m, 2 * m)),
        ((-1, -2, -3), n - 1, given[-1, m:], (4 * m + 1, 3 * m)),
    ):
        values[list(rows)] = given[k + (k > 0), :m]
        free[rows[0]] = False
        free[list(rows[1:])] &= speed != 0
        for i in np.flatnonzero(speed):
            equal += [(k, entries[0] + i, speed[i]), (k, entries[1] + i, 0.0)]
    # points on the way, which the coordinate comes from and leaves
    for k in structure.borders[1:]:
        equal += [
            (k, e, given[k, e])
            for e in np.flatnonzero(same[k])
            if moving[k - 1, e % m] and moving[k, e % m]
        ]
    if not equal:
        return free, values, _NONE
    at, entry, value = np.array(equal).T
    return free, values, (at.astype(int), entry.astype(int), value)


def _linear_rows(structure: NlpStructure, data: NlpData) -> tuple[Array, Array]:
    """A (l, 5 m + 1) and bounds (n, l) of u̇ at the start and between, ü and jerk; of u where it is free to turn back."""
    n, m = structure.elements, structure.coordinates
    counts, (slowest, _) = data.bounds_of_u_count(structure), data.velocity
    first = 0 if counts.any() else m
    chosen = np.r_[first : 4 * m, 4 * m + 1 : 5 * m + 1]
    one = np.eye(5 * m + 1)[chosen]
    counts = np.hstack([counts, ~data.given[:, m:]])
    between = data.velocity if structure.velocity_limits else (slowest, np.full((n, m), np.inf))
    lower, upper = (
        np.hstack([np.where(counts, bound, sign * np.inf)[:, first:], middle])
        for sign, bound, middle in zip((-1, 1), (data.lower, data.upper), between, strict=True)
    )
    matrix, bound = np.vstack([one, -one]), np.hstack([upper, -lower])
    if structure.smooth and structure.joints:
        rise = np.zeros((m, 5 * m + 1))
        rise[:, 2 * m : 3 * m], rise[:, 3 * m : 4 * m] = (
            np.diag(-n / data.jerk),
            np.diag(n / data.jerk),
        )
        fall = -rise
        rise[:, 4 * m] = fall[:, 4 * m] = -n
        matrix = np.vstack([matrix, rise, fall])
        bound = np.hstack([bound, np.where(np.tile(structure.moving, 2), 0.0, np.inf)])
    return matrix, bound


def _point(
    program: Program, structure: NlpStructure, data: NlpData, x: Array, slower: float = SLOWER
) -> Point:
    """Unknowns of a guess (variables of `transcription`), slowed down."""
    n, m = structure.elements, structure.coordinates
    states, times = x[: 4 * m * n].reshape(n, 4 * m), x[4 * m * n :]
    times = np.maximum(times, 1.001 * data.least_times)
    if data.duration == (0.0, np.inf):
        orders = np.repeat([0, 1, 2, 2], m)
        states, times = states / slower**orders, times * slower
    h = times[structure.block] * data.fractions
    pieces = cubics(np.column_stack([states, h]))
    u, v = np.vstack([pieces.u, data.end[:m]]), np.vstack([pieces.v, data.end[m:]])
    acceleration = np.vstack([pieces.a0[:1], (pieces.a1[:-1] + pieces.a0[1:]) / 2, pieces.a1[-1:]])
    c = program.spline.unknowns(u, v, acceleration, h)
    _, values, _ = _boundary(structure, program.spline, data)
    return Point(np.where(program.free, c, values), times)
