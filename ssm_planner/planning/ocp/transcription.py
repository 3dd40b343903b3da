"""Nonlinear program of every optimised motion for Ipopt, by direct transcription.

Direct transcription replaces the unknown motion by cubic polynomials on the elements of a mesh, and
imposes the path constraints at a few instants of each element (collocation points). A motion along
a path has one coordinate, the path parameter s. The coordinates of a free motion are its moving
joints. `Transcription.build` states the program from top to bottom. Only the element model (the
path constraints and the cost as functions of the motion in one element) differs between both kinds
of motion.
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
    """Nonlinear program for Ipopt, for one structure and one set of element functions.

    The element functions (element model) are the path constraints and the cost of one time interval
    of the mesh. All numbers in `NlpData` are parameters or bounds, so one program serves many
    problems.
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

    In the vector p of all parameters, they follow the constants of the element functions.
    """
    sizes: dict[str, int] = field(compare=False)
    """Number of constraints in every group, by name, in the order of the groups.

    The path constraints follow the last group.
    """

    @classmethod
    @lru_cache(maxsize=12)
    def build(cls, structure: NlpStructure, element: ElementModel) -> "Transcription":
        """Build the program and its solvers. Equal structures and models share the result.

        A block is a group of consecutive elements that share one unknown duration in fixed
        proportion. With n elements k, m coordinates u and b blocks of duration T, the program is

            min   w_t Σ T + w_c Σ L(z_k) + 3 w_s Σ ∫ (ü/limit)² dt + w_v var(T / T_least)
            s.t.  u, u̇ continuous, ü too if jerk is limited;
                  bounds on u, u̇, ü, u⃛ and Σ T;  G(z_k) ≤ 1 − backoff

        with w_s = `SMOOTHING_WEIGHT`, w_v = `BLOCK_VARIANCE_WEIGHT`, and the weights w_t
        and w_c in `NlpData.weights`. z_k contains u, u̇, ü at the start, ü at the end, and
        length of element k. The path constraints G and the cost L (heat or effort) follow
        from the element model. Matrices have the shape (coordinates, elements), because
        CasADi maps functions over columns.

        Parameters
        ----------
        structure : NlpStructure
            Numbers of elements, segments and blocks, and kinds of constraints of the program.
        element : ElementModel
            Path constraints and cost as functions of the motion in one element (time interval).

        Returns
        -------
        Transcription
            The program, from which `solve` starts Ipopt with the numbers of one problem.
        """
        symbols = ProgramSymbols.build(structure, element)
        duration = ca.sum1(symbols.times)
        objective = symbols.p.weights[0] * duration + _regularisation(
            structure, symbols.cubic, symbols.times, symbols.p
        )

        # Constraints other than the path constraints, which `build_solvers` adds with the costs.
        # The boundary conditions are bounds of the variables (`BoundaryConditions`).
        constraints = {
            "dynamics": _dynamics_constraints(structure, symbols.cubic, symbols.p.end),
            **_joint_limit_constraints(structure, symbols.cubic, symbols.p.jerk),
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
            Parameters and bounds.
        elements : (n, 4 m + 1) array
            Initial point: u, u̇, ü at the start, ü at the end (m numbers each), and length of each
            element.
        confirming : bool
            True if the initial point is a solution of the structured solver.

        Returns
        -------
        NlpSolution
            The solution, or Ipopt's status of the failure.
        """
        n, m = self.structure.elements, self.structure.coordinates
        start_kind: Start = "cold"
        if confirming:
            start_kind, data = "confirming", self._without_implied_bounds(data)
        result, stats = run_ipopt(self.solver(start_kind), **self._inputs(data, elements))
        if self.native is not None:
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
            residual=max(stats["iterations"][name][-1] for name in ("inf_pr", "inf_du")),
            objective=float(result["f"]),
            multipliers=self._multipliers(data, lam_x, lam_g),
        )

    def _multipliers(
        self, data: NlpData, variable_multipliers: Array, constraint_multipliers: Array
    ) -> Multipliers:
        """Select the multipliers of path constraints and directions from CasADi's multipliers.

        Parameters
        ----------
        data : NlpData
            Bounds of the program.
        variable_multipliers : (4 m n + b,) array
            Multipliers of the bounds on the variables: u, u̇, ü at the start and ü at the end of
            each of n elements (m numbers each), and the durations of b blocks. They are negative at
            lower bounds.
        constraint_multipliers : array
            Multipliers of the bounds on all constraints, in the order of the groups in `sizes`,
            followed by the path constraints. They are negative at lower bounds.

        Returns
        -------
        Multipliers
            Multipliers of the path constraints, (n, 3 r), and of the directions, (n, m).
        """
        n, m = self.structure.elements, self.structure.coordinates
        # Multipliers of the bounds on the middle Bernstein coefficient of u̇.
        middle = np.zeros((n, m))
        start = self.sizes["dynamics"]
        limited = self.structure.moving & self.structure.velocity_limits
        middle[limited] = constraint_multipliers[start : start + self.sizes["velocity"]]
        # Those of the bounds on u̇ at the start. A fixed u̇ has a multiplier too, but it has no bound
        # that forbids a reversal.
        at_start = np.where(
            data.is_fixed, 0.0, variable_multipliers[: 4 * m * n].reshape(n, 4 * m)
        )[:, m : 2 * m]
        signed = np.stack([at_start, middle])
        lower, upper = (np.maximum(sign * signed, 0.0).sum(axis=0) for sign in (-1, 1))
        rows = np.maximum(constraint_multipliers[sum(self.sizes.values()) :], 0.0).reshape(n, -1)
        return Multipliers.of_bounds(data, lower, upper, rows, frozenset(self.element.row_names))

    def _without_implied_bounds(self, data: NlpData) -> NlpData:
        """Remove bounds of the positions u that follow from other constraints.

        A coordinate that keeps its direction stays between its positions at both ends of a segment
        (the part of a motion in which no joint reverses) anyway. The structured solver does not
        have these bounds either. When Ipopt confirms a solution of that solver, the logarithmic
        barrier of superfluous bounds would move the point at which Ipopt stops.

        Parameters
        ----------
        data : NlpData
            Parameters and bounds of the program.

        Returns
        -------
        NlpData
            A copy in which the bounds that are not needed are infinite.
        """
        positions = slice(self.structure.coordinates)
        needed = data.needs_position_bounds(self.structure) | data.is_fixed[:, positions]
        lower, upper = data.lower.copy(), data.upper.copy()
        lower[:, positions][~needed] = -np.inf
        upper[:, positions][~needed] = np.inf
        return replace(data, lower=lower, upper=upper)

    def _inputs(self, data: NlpData, elements: Array) -> dict[str, Array]:
        """Return the arguments with which CasADi calls the solver, by their names in `nlpsol`.

        Parameters
        ----------
        data : NlpData
            Parameters and bounds.
        elements : (n, 4 m + 1) array
            Initial point: u, u̇, ü at the start, ü at the end (m numbers each), and length of each
            element.

        Returns
        -------
        dict
            x0: initial variables. p: parameters. lbx, ubx: bounds of the variables. lbg, ubg:
            bounds of the constraints.
        """
        limited = self.structure.moving & self.structure.velocity_limits
        # Lower and upper bounds of the groups of constraints, by the names in `sizes`.
        bounds = {
            "dynamics": (0.0, 0.0),
            "velocity": tuple(velocity[limited] for velocity in data.velocity),
            "jerk": (-np.inf, 0.0),
            "breakaway": (-np.inf, data.breakaway_bound.ravel()),
            "duration": data.duration,
        }
        path_bound = data.path_bound.ravel()
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
    """Return the two terms of the objective that make the solution unique.

    They are 3 SMOOTHING_WEIGHT Σ ∫ r² dt with r = ü/limit, if the coordinates are joints, and
    BLOCK_VARIANCE_WEIGHT times the variance of the blocks' durations. ü is linear in an element, so
    that 3 ∫ r² dt = h (r0² + r0 r1 + r1²).

    Parameters
    ----------
    structure : NlpStructure
        Numbers of elements, segments and blocks, and kinds of constraints of the program.
    cubic : CubicPiece
        The elements, whose fields have the shape (m, n) for m coordinates and n elements.
    times : (b,) MX
        Durations of the blocks.
    p
        Parameters of the program by name. The limits `acceleration` of ü and the lower bounds
        `least_times` of the durations are used.

    Returns
    -------
    MX
        The sum of both terms, a scalar.
    """
    r0, r1 = (a / ca.repmat(p.acceleration, 1, structure.elements) for a in (cubic.a0, cubic.a1))
    smoothing = (
        ca.sum2(ca.sum1(cubic.h * (r0**2 + r0 * r1 + r1**2)))
        if structure.coordinates_are_joints
        else ca.MX(0)
    )
    b, relative = times.numel(), times / p.least_times
    variance = ca.sumsqr(relative - ca.sum1(relative) / b) / b
    return SMOOTHING_WEIGHT * smoothing + BLOCK_VARIANCE_WEIGHT * variance


def _dynamics_constraints(structure: NlpStructure, cubic: CubicPiece, end: ca.MX) -> ca.MX:
    """Return the differences of u and u̇ (and ü if jerk is limited) between neighbouring elements.

    The program requires that they are 0. The end of the last element is compared with the end of
    the motion. Without a jerk limit, ü may jump.

    Parameters
    ----------
    structure : NlpStructure
        Numbers of elements and coordinates, and in which elements a coordinate moves.
    cubic : CubicPiece
        The elements, whose fields have the shape (m, n) for m coordinates and n elements.
    end : (2 m,) MX
        u and u̇ at the end of the motion, m numbers each.

    Returns
    -------
    MX
        Differences as one vector. Coordinates at rest contribute none.
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


def _joint_limit_constraints(
    structure: NlpStructure, cubic: CubicPiece, jerk: ca.MX
) -> dict[str, ca.MX]:
    """Return the constraints of velocity and jerk, by name.

    "velocity" contains the middle Bernstein coefficient of u̇ in each element. The outer
    coefficients are u̇ at both ends, which are variables with bounds. If all three keep a bound, u̇
    keeps it in the whole element. "jerk" contains |ü(h) − ü(0)| − jerk · h as two constraints,
    which must not be positive.

    Parameters
    ----------
    structure : NlpStructure
        Which coordinates move in which elements, and which limits apply.
    cubic : CubicPiece
        The elements, whose fields have the shape (m, n) for m coordinates and n elements.
    jerk : (m,) MX
        Limits of |u⃛|.

    Returns
    -------
    dict
        Two vectors, "velocity" and "jerk". A limit that does not apply contributes no entries.
    """
    moving = structure.moving
    jerk_limited = moving & (
        structure.coordinates_are_joints and structure.has_continuous_acceleration
    )
    difference = cubic.a1 - cubic.a0
    bound = ca.repmat(jerk, 1, structure.elements) * cubic.h
    return {
        "velocity": _select_entries(cubic.middle_velocity, moving & structure.velocity_limits),
        "jerk": ca.vertcat(
            _select_entries(difference - bound, jerk_limited),
            _select_entries(-difference - bound, jerk_limited),
        ),
    }


def _breakaway_constraints(
    structure: NlpStructure, element: ElementModel, symbols: ProgramSymbols
) -> ca.MX:
    """Return the torque constraints of joints that start to move, with static friction.

    Static friction exceeds the friction in motion. The motor of a joint that starts or reverses
    must overcome it (break away), so this instant has constraints of its own.

    Parameters
    ----------
    structure : NlpStructure
        Structure of the program. Its pairs `breakaways` state the element at whose beginning a
        joint may start, and the element from which the joint takes its direction.
    element : ElementModel
        Functions of one element. Its method `breakaway` contains the friction law.
    symbols : ProgramSymbols
        Variables and parameters of the program.

    Returns
    -------
    MX
        Constraints of all pairs as one vector.
    """
    sigma, *other_parameters = symbols.element_parameters
    rows = []
    for k, direction_element in structure.breakaways:
        parameters = (_parameter_column(parameter, k) for parameter in other_parameters)
        rows.append(element.breakaway(symbols.z[:, k], sigma[:, direction_element], *parameters))
    return ca.vertcat(*rows)


def clear_program_cache() -> None:
    """Clear the cache of `Transcription.build`, in order to free memory."""
    Transcription.build.cache_clear()


def _select_entries(values: ca.MX, mask: Any) -> ca.MX:
    """Return the selected entries of a matrix as one vector, element after element.

    Parameters
    ----------
    values : (m, n) MX
        One column for each element.
    mask : (n, m) mask
        True for selected entries.
    """
    return ca.vec(values)[np.flatnonzero(mask).tolist()]


def _parameter_column(parameter: ca.MX, k: int) -> ca.MX:
    """Return a parameter vector of element k.

    Parameters
    ----------
    parameter : (size, n) or (size, 1) MX
        Vectors of all elements as columns, or one vector that all elements share.
    k : int
        Index of the element.
    """
    return parameter if parameter.size2() == 1 else parameter[:, k]
