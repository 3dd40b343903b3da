"""Nonlinear program of every optimised motion for Ipopt, by direct transcription.

Direct transcription replaces the unknown motion by cubic polynomials on the elements (time
intervals) of a mesh, and imposes the path constraints at three instants of each element, the
collocation points. A motion along a given path has one coordinate u, the path parameter s. The
coordinates of a free motion are its moving joints. `Transcription.build` states the program, which
is the same for both kinds of motion. Only the element model differs, that is, the path constraints
and the cost as functions of the motion in one element.

Source: J. T. Betts, Practical Methods for Optimal Control and Estimation Using Nonlinear
Programming, SIAM, 2010.
"""

from collections.abc import Callable
from dataclasses import field, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import Layout
from ssm_planner.elements.compiled import MappedElements, mapped_elements
from ssm_planner.elements.element import ElementModel, element_functions
from ssm_planner.planning.ocp.ipopt import ProgramSymbols, Start, build_solvers, run_ipopt
from ssm_planner.planning.ocp.nlp import (
    Multipliers,
    NlpData,
    NlpSolution,
    NlpStructure,
)
from ssm_planner.trajectory import CubicPiece
from ssm_planner.typing import Array, frozen

SMOOTHING_WEIGHT = 3e-6
"""Weight of the term 3 ∫ (ü/limit)² dt of the joints in the objective.

The term makes the motion unique if joints could move in many ways in the same duration.
"""
BLOCK_VARIANCE_WEIGHT = 1e-5
"""Weight of the variance of the blocks' durations, each divided by its lower bound.

The term makes the mesh unique if blocks could have different durations in the same motion.
"""


@frozen
class Transcription:
    """Nonlinear program for Ipopt, for one structure of the mesh and one element model.

    The element model contains the path constraints and the cost as functions of the motion in one
    element (time interval). All numbers in `NlpData` are parameters or bounds of the program, so
    one program serves many problems.
    """

    structure: NlpStructure
    """Numbers of elements, segments and blocks, and kinds of constraints of the program."""
    element: ElementModel
    """Path constraints and cost as functions of the motion in one element."""
    solver: Callable[[Start], ca.Function] = field(compare=False)
    """Returns Ipopt's solver for a kind of start.

    The kinds are "cold" (from a guess) and "confirming" (from a solution of the structured solver).
    """
    native: MappedElements | None = field(compare=False)
    """Functions of the elements in C. None without the compiled part."""
    parameters: Layout = field(compare=False)
    """Names and positions of the parameters of the program itself, which are fields of `NlpData`.

    In the vector p of all parameters, they follow the parameters of the element model.
    """
    sizes: dict[str, int] = field(compare=False)
    """Number of constraints in every group, by name, in the order of the groups.

    The path constraints follow the last group.
    """

    @classmethod
    @lru_cache(maxsize=12)
    def build(cls, structure: NlpStructure, element: ElementModel) -> "Transcription":
        """Build the nonlinear program and its Ipopt solvers.

        The result is cached: calls with an equal structure and element model return the same
        object.

        Parameters
        ----------
        structure : NlpStructure
            Numbers of elements, segments and blocks, and kinds of constraints of the program.
        element : ElementModel
            Path constraints and cost as functions of the motion in one element (time interval).

        Returns
        -------
        Transcription
            The program. Its method `solve` starts Ipopt with the numbers of one problem.

        Notes
        -----
        A block is a group of consecutive elements that share one unknown duration in fixed
        proportion. With n elements k, m coordinates u and b blocks of duration T, the program is

            min   w_t Σ T + w_c Σ L(z_k) + 3 w_s Σ ∫ (ü/limit)² dt + w_v var(T / T_least)
            s.t.  u, u̇ continuous, ü too if jerk is limited;
                  bounds on u, u̇, ü, u⃛ and Σ T;  G(z_k) ≤ 1 − backoff

        with w_s = `SMOOTHING_WEIGHT`, w_v = `BLOCK_VARIANCE_WEIGHT`, and the weights w_t and w_c in
        `NlpData.weights`. z_k contains u, u̇, ü at the start, ü at the end, and length of element k.
        The element model gives the path constraints G and the cost L (heat or effort). Matrices
        have the shape (coordinates, elements), because CasADi maps functions over columns.
        """
        symbols = ProgramSymbols.build(structure, element)
        duration = ca.sum1(symbols.times)
        objective = symbols.p.weights[0] * duration + _regularisation(
            structure, symbols.cubic, symbols.times, symbols.p
        )

        # All constraints except the path constraints. `build_solvers` adds the path constraints and
        # the costs of the elements. The boundary conditions at the start and at the borders are
        # bounds of the variables (`BoundaryConditions`).
        constraints = {
            "dynamics": _dynamics_constraints(structure, symbols.cubic, symbols.p.end),
            # The middle Bernstein coefficient of u̇. The two outer coefficients are u̇ at both ends of
            # an element, which are variables with bounds. If all three coefficients keep a bound,
            # the parabola u̇ keeps it in the whole element.
            "velocity": _select_entries(symbols.cubic.middle_velocity, structure.moving),
            "jerk": _jerk_constraints(structure, symbols.cubic, symbols.p.jerk),
            "breakaway": _breakaway_constraints(structure, element, symbols),
            "duration": duration,
        }
        native = mapped_elements(element, structure.elements)
        solver = build_solvers(
            symbols,
            objective,
            ca.vertcat(*constraints.values()),
            functions=element_functions(element),
            native=native,
        )
        sizes = {name: rows.numel() for name, rows in constraints.items()}
        return cls(
            structure, element, solver, native=native, parameters=symbols.layout, sizes=sizes
        )

    def solve(self, data: NlpData, elements: Array, *, confirming: bool = False) -> NlpSolution:
        """Solve the nonlinear program with Ipopt.

        Parameters
        ----------
        data : NlpData
            Parameters and bounds of the program.
        elements : (n, 4 m + 1) array
            Motion at which Ipopt starts: u, u̇, ü at the start, ü at the end (m numbers each), and
            length of each element (time interval).
        confirming : bool
            True if this motion is a solution of the structured solver (`ocp.structured`), which
            Ipopt is to confirm. Other options then apply.

        Returns
        -------
        NlpSolution
            The solution, or Ipopt's status of the failure.

        Raises
        ------
        KeyboardInterrupt
            If the user interrupts Ipopt.
        """
        n, m = self.structure.elements, self.structure.coordinates
        start_kind: Start = "confirming" if confirming else "cold"
        data = data if confirming else self._with_implied_bounds(data)
        result, stats = run_ipopt(self.solver(start_kind), **self._inputs(data, elements))
        if self.native is not None:
            # Exceptions in the C functions do not pass through Ipopt. `check` raises them here.
            self.native.check()
        x, lam_x, lam_g = (result[name].full().ravel() for name in ("x", "lam_x", "lam_g"))
        # The variables are u, u̇, ü at the start and ü at the end of every element, then the
        # durations of the blocks.
        states = x[: 4 * m * n].reshape(n, 4 * m)
        times = x[4 * m * n :]
        elements = np.column_stack([states, times[self.structure.block] * data.fractions])
        return NlpSolution(
            str(stats["return_status"]),
            self.structure,
            elements,
            iterations=int(stats["iter_count"]),
            # The larger one of Ipopt's primal and dual infeasibility after the last iteration.
            residual=max(stats["iterations"][name][-1] for name in ("inf_pr", "inf_du")),
            objective=float(result["f"]),
            multipliers=self._multipliers(data, lam_x, lam_g),
        )

    def _multipliers(
        self, data: NlpData, variable_multipliers: Array, constraint_multipliers: Array
    ) -> Multipliers:
        """Select the multipliers of path constraints and directions from CasADi's multipliers.

        A direction constraint is the bound of u̇ that forbids a coordinate u to reverse.

        Parameters
        ----------
        data : NlpData
            Bounds of the program. Those of u̇ determine the directions of the coordinates.
        variable_multipliers : (4 m n + b,) array
            Multipliers of the bounds on the variables: u, u̇, ü at the start and ü at the end of
            each of n elements (m numbers each), and the durations of b blocks. They are negative at
            lower bounds.
        constraint_multipliers : (sum of `sizes` + 3 r n,) array
            Multipliers of the bounds on all constraints: the groups in the order of `sizes`, then
            the r path constraints at start, middle and end of each element. They are negative at
            lower bounds.

        Returns
        -------
        Multipliers
            Multipliers of the path constraints, (n, 3 r), and of the directions, (n, m).
        """
        n, m = self.structure.elements, self.structure.coordinates
        # Multipliers of the bounds on the middle Bernstein coefficient of u̇. They follow those of
        # the group "dynamics".
        middle = np.zeros((n, m))
        start = self.sizes["dynamics"]
        middle[self.structure.moving] = constraint_multipliers[
            start : start + self.sizes["velocity"]
        ]
        # Multipliers of the bounds on u̇ at the start of the elements, in the columns m to 2 m − 1.
        # A fixed u̇ has a multiplier too, but no bound that forbids a reversal.
        at_start = np.where(
            data.is_fixed, 0.0, variable_multipliers[: 4 * m * n].reshape(n, 4 * m)
        )[:, m : 2 * m]
        signed = np.stack([at_start, middle])
        # Both bound the velocity, so their multipliers are added. Both results are ≥ 0.
        lower, upper = (np.maximum(sign * signed, 0.0).sum(axis=0) for sign in (-1, 1))
        rows = np.maximum(constraint_multipliers[sum(self.sizes.values()) :], 0.0).reshape(n, -1)
        return Multipliers.of_bounds(data, lower, upper, rows, frozenset(self.element.row_names))

    def _with_implied_bounds(self, data: NlpData) -> NlpData:
        """Return the data with those bounds of the positions u that other constraints imply.

        In a segment (a part of the motion in which no coordinate reverses), each coordinate stays
        between its positions at both ends, because it keeps its direction. With these bounds, Ipopt
        finds a faster motion around the lens of an eye. They are left out if Ipopt confirms a
        solution, because their logarithmic barrier would move the point at which Ipopt stops.

        Parameters
        ----------
        data : NlpData
            Parameters and bounds of the program.

        Returns
        -------
        NlpData
            A copy in which the bounds of all positions are finite.
        """
        positions = slice(self.structure.coordinates)
        lower, upper = data.lower.copy(), data.upper.copy()
        for bounds, extreme in ((lower, np.minimum), (upper, np.maximum)):
            at_borders = np.vstack([bounds[self.structure.borders, positions], data.end[positions]])
            within_segments = extreme(at_borders[:-1], at_borders[1:])[self.structure.segment]
            implied = np.isinf(bounds[:, positions])
            bounds[:, positions][implied] = within_segments[implied]
        return replace(data, lower=lower, upper=upper)

    def _inputs(self, data: NlpData, elements: Array) -> dict[str, Array]:
        """Collect the arguments of CasADi's solver by their names in `casadi.nlpsol`.

        Parameters
        ----------
        data : NlpData
            Parameters and bounds of the program.
        elements : (n, 4 m + 1) array
            Motion at which the solver starts: u, u̇, ü at the start, ü at the end (m numbers each),
            and length of each element (time interval).

        Returns
        -------
        dict of arrays
            Initial values `x0` of the variables, parameters `p`, lower and upper bounds `lbx` and
            `ubx` of the variables, and lower and upper bounds `lbg` and `ubg` of the constraints.
        """
        v_min, v_max = (velocity[self.structure.moving] for velocity in data.velocity)
        # Lower and upper bounds of the groups of constraints, by the names in `sizes`.
        bounds: dict[str, tuple[Any, Any]] = {
            "dynamics": (0.0, 0.0),
            "velocity": (v_min, v_max),
            "jerk": (-np.inf, 0.0),
            "breakaway": (-np.inf, data.breakaway_bound.ravel()),
            "duration": data.duration,
        }
        path_bound = data.path_bound.ravel()
        # One bound may apply to a whole group, so it is repeated for each constraint of the group.
        lower, upper = (
            [np.broadcast_to(bounds[name][end], size) for name, size in self.sizes.items()]
            for end in (0, 1)
        )
        # The names of the parameters are those of the fields of NlpData.
        own_parameters = self.parameters.pack(
            **{name: getattr(data, name) for name in self.parameters.slices}
        )
        return {
            "x0": self.structure.variables(elements),
            "p": np.concatenate([*map(np.ravel, data.element_parameters), own_parameters]),
            "lbx": np.append(data.lower.ravel(), data.least_times),
            "ubx": np.append(data.upper.ravel(), np.full(len(data.least_times), np.inf)),
            "lbg": np.concatenate([*lower, np.full(path_bound.size, -np.inf)]),
            "ubg": np.concatenate([*upper, path_bound]),
        }


def _regularisation(structure: NlpStructure, cubic: CubicPiece, times: ca.MX, p: Any) -> ca.MX:
    """Build the two terms of the objective that make the solution unique.

    The first term is 3 SMOOTHING_WEIGHT Σ ∫ r² dt with r = ü/limit. It is 0 along a path, where
    this limit is infinite. ü is linear in an element (time interval) of length h, so 3 ∫ r² dt =
    h (r0² + r0 r1 + r1²), with r0 at the start and r1 at the end. The second term is
    BLOCK_VARIANCE_WEIGHT times the variance of T / T_least, with the duration T of each block (a
    group of elements) and its lower bound T_least.

    Parameters
    ----------
    structure : NlpStructure
        Numbers of elements, segments and blocks, and kinds of constraints of the program.
    cubic : CubicPiece
        The elements, whose fields have the shape (m, n) for m coordinates and n elements.
    times : (b,) MX
        Durations of the blocks.
    p
        Parameters of the program as attributes. Only the limits `acceleration` of ü, (m,), and the
        lower bounds `least_times` of the durations, (b,), are used.

    Returns
    -------
    MX
        The sum of both terms, a scalar.
    """
    r0, r1 = (a / ca.repmat(p.acceleration, 1, structure.elements) for a in (cubic.a0, cubic.a1))
    smoothing = ca.sum2(ca.sum1(cubic.h * (r0**2 + r0 * r1 + r1**2)))
    b, relative = times.numel(), times / p.least_times
    variance = ca.sumsqr(relative - ca.sum1(relative) / b) / b
    return SMOOTHING_WEIGHT * smoothing + BLOCK_VARIANCE_WEIGHT * variance


def _dynamics_constraints(structure: NlpStructure, cubic: CubicPiece, end: ca.MX) -> ca.MX:
    """Build the differences of u and u̇ between the end of each element and the start of the next.

    The program requires that they are 0, so u and u̇ are continuous. The end of the last element
    (time interval) is compared with the given end of the motion. If jerk is limited, the
    differences of ü are included. Otherwise ü may jump.

    Parameters
    ----------
    structure : NlpStructure
        Numbers of elements and coordinates, and in which elements a coordinate moves.
    cubic : CubicPiece
        The elements, whose fields have the shape (m, n) for m coordinates and n elements.
    end : (2 m,) MX
        Given u and u̇ at the end of the motion, m numbers each.

    Returns
    -------
    (rows,) MX
        Differences of u, of u̇, and of ü. A coordinate contributes none for elements in which it
        rests.
    """
    m, moving = structure.coordinates, structure.moving
    u_after, v_after = cubic.end
    differences = [
        _select_entries(u_after - ca.horzcat(cubic.u[:, 1:], end[:m]), moving),
        _select_entries(v_after - ca.horzcat(cubic.v[:, 1:], end[m:]), moving),
    ]
    if structure.has_continuous_acceleration:
        differences.append(
            _select_entries(cubic.a1[:, :-1] - cubic.a0[:, 1:], moving[:-1] | moving[1:])
        )
    return ca.vertcat(*differences)


def _jerk_constraints(structure: NlpStructure, cubic: CubicPiece, jerk: ca.MX) -> ca.MX:
    """Build |ü(h) − ü(0)| − jerk · h in each element as two constraints, which must be at most 0.

    Parameters
    ----------
    structure : NlpStructure
        Which coordinates move in which elements, and whether the program limits jerk.
    cubic : CubicPiece
        The elements (time intervals of length h), whose fields have the shape (m, n) for m
        coordinates and n elements.
    jerk : (m,) MX
        Limits of |u⃛|.

    Returns
    -------
    MX
        The vector of the constraints. It is empty if the program does not limit jerk.
    """
    limited = structure.moving & structure.limits_jerk
    difference = cubic.a1 - cubic.a0
    bound = ca.repmat(jerk, 1, structure.elements) * cubic.h
    return ca.vertcat(
        _select_entries(difference - bound, limited), _select_entries(-difference - bound, limited)
    )


def _breakaway_constraints(
    structure: NlpStructure, element: ElementModel, symbols: ProgramSymbols
) -> ca.MX:
    """Build the torque constraints of joints that start to move, with static friction.

    Static friction exceeds the friction in motion. The motor of a joint that starts or reverses
    must overcome it (the joint breaks away), so this instant has torque constraints of its own.

    Parameters
    ----------
    structure : NlpStructure
        Structure of the program. Each of its pairs `breakaways` contains the element (time
        interval) at whose beginning a joint may start, and the element that has the direction in
        which it starts.
    element : ElementModel
        Functions of one element. Its `breakaway` contains the friction law.
    symbols : ProgramSymbols
        Variables and parameters of the program.

    Returns
    -------
    (rows,) MX
        Constraints of all pairs, pair after pair.
    """
    sigma, *other_parameters = symbols.element_parameters
    rows = []
    for k, direction_element in structure.breakaways:
        parameters = (_parameter_column(parameter, k) for parameter in other_parameters)
        rows.append(element.breakaway(symbols.z[:, k], sigma[:, direction_element], *parameters))
    return ca.vertcat(*rows)


def clear_program_cache() -> None:
    """Delete the programs that `Transcription.build` keeps for later calls, to free memory."""
    Transcription.build.cache_clear()


def _select_entries(values: ca.MX, mask: Any) -> ca.MX:
    """Return the selected entries of a matrix as one vector.

    Parameters
    ----------
    values : (m, n) MX
        Values of m coordinates in n elements (time intervals), one column for each element.
    mask : (n, m) mask
        True for selected entries. Its axes are transposed, as in `NlpStructure.moving`.

    Returns
    -------
    (selected entries,) MX
        The entries of the first element, then those of the second one, and so on.
    """
    # `ca.vec` stacks the columns, so the mask is read row by row.
    return ca.vec(values)[np.flatnonzero(mask).tolist()]


def _parameter_column(parameter: ca.MX, k: int) -> ca.MX:
    """Return one parameter vector of element k.

    Parameters
    ----------
    parameter : (size, n) or (size, 1) MX
        Vectors of all n elements (time intervals) as columns, or one vector that all elements
        share.
    k : int
        Index of the element.

    Returns
    -------
    (size, 1) MX
        The vector.
    """
    return parameter if parameter.size2() == 1 else parameter[:, k]
