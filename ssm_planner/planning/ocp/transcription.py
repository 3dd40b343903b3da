"""The nonlinear program of every optimised motion: transcription on cubic elements.

A straight motion has one coordinate, the path parameter s. The coordinates of a free motion are its
moving joints. `Transcription.build` states the program from top to bottom. Only the element model
differs between both kinds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace
from functools import cache, lru_cache, partial
from typing import Any, Literal
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import Layout
from ssm_planner.elements.compiled import MappedElements, mapped_elements
from ssm_planner.elements.element import ElementFunctions, ElementModel, element_functions
from ssm_planner.interior.solve import LAST_BARRIER, TOLERANCE
from ssm_planner.planning.ocp.nlp import (
    InitialPoint,
    Multipliers,
    NlpData,
    NlpSolution,
    NlpStructure,
)
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, frozen

SMOOTHING = 3e-6
"""Weight of 3 ∫ (ü/limit)² dt of the joints. It determines the motion of joints that do not bind.
"""
EVEN = 1e-5
"""Weight of the variance of the blocks' times, relative to their least. It makes the mesh unique.
"""
ITERATIONS = 300
"""Largest number of iterations."""
IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-8,
    "mu_init": 1e-4,
    "bound_push": 1e-2,
    "bound_frac": 1e-2,
    # AMD ordering. By default MUMPS takes METIS on fine meshes, which makes each iteration slower.
    "mumps_pivot_order": 0,
}
FROM_BARRIER = {"bound_mult_init_method": "mu-based"}
"""First multipliers mu_init / slack.

They save a fifth of the iterations, except if jerk is limited in joints.
"""
WARM: dict[str, Any] = {
    **IPOPT,
    "mu_init": 1e-7,
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-9,
    "warm_start_bound_frac": 1e-9,
    "warm_start_slack_bound_push": 1e-9,
    "warm_start_slack_bound_frac": 1e-9,
    "warm_start_mult_bound_push": 1e-9,
}
"""Options for a start from the solution of the same problem with a few other bounds."""
CONFIRMING: dict[str, Any] = {
    **IPOPT,
    **FROM_BARRIER,
    "mu_init": TOLERANCE / LAST_BARRIER,
    "bound_push": 1e-13,
    "bound_frac": 1e-13,
    "slack_bound_push": 1e-13,
    "slack_bound_frac": 1e-13,
    # With 0 Ipopt crashes if it has to treat fixed variables as free ones.
    "bound_relax_factor": 1e-12,
    "constr_mult_init_max": 1e10,
}
"""Options for a start from a solution of the structured solver.

Its slacks and its last barrier weight give its multipliers, so the initial point is a solution for
Ipopt if it is one at all.
"""
CONFIRMING_ITERATIONS = 30
Start = Literal["cold", "warm", "confirming"]


@frozen
class Transcription:
    """Ipopt for one structure and element model.

    Every number of NlpData is a parameter or a bound.
    """

    structure: NlpStructure
    element: ElementModel
    solver: Callable[[Start], ca.Function] = field(compare=False)
    """Returns Ipopt for a start from a guess, from an earlier solution with multipliers, or from
    the structured solver's.
    """
    native: MappedElements | None = field(compare=False)
    """Functions that are evaluated in C. None without the compiled part."""
    parameters: Layout = field(compare=False)
    """Layout of the fields of NlpData that are parameters, after those of the element model."""
    sizes: dict[str, int] = field(compare=False)
    """Number of rows in every group of constraints before the path constraints, in their order."""

    @classmethod
    @lru_cache(maxsize=12)
    def build(cls, structure: NlpStructure, element: ElementModel) -> Transcription:
        """Return the program, built once for each structure and element model.

        With n elements k, m coordinates and b blocks, the program is

            min   w_t Σ T + w_c Σ L(z_k) + 3 SMOOTHING Σ ∫ (ü/limit)² dt + EVEN var(T / T_least)
            s.t.  u, u̇ continuous, ü too if jerk is limited;
                  bounds on u, u̇, ü, u⃛ and Σ T;  G(z_k) ≤ 1 − backoff

        Shapes are (coordinates, elements), because CasADi maps columns.
        """
        n = structure.elements
        m = structure.coordinates
        b = len(structure.block_sizes)

        # Variables: u, u̇, ü at the start and ü at the end of every element, and the time T of
        # every block.
        x, times = ca.MX.sym("x", 4 * m, n), ca.MX.sym("times", b)
        u, v, a0, a1 = (x[i * m : (i + 1) * m, :] for i in range(4))

        # Parameters: those of the element model, (size, n) or (size, 1), and those of the program.
        element_parameters = [
            ca.MX.sym(f"p{i}", size, n if per_element else 1)
            for i, (size, per_element) in enumerate(element.parameters)
        ]
        layout = Layout(fractions=n, end=2 * m, jerk=m, acceleration=m, weights=2, least_times=b)
        own_parameters = ca.MX.sym("p", layout.size)
        p = layout.unpack(own_parameters)

        # Elements: h_k = fraction_k T_block(k) for all coordinates, and z = [u; u̇; ü; ü; h].
        h = p.fractions.T * ca.horzcat(
            *(ca.repmat(times[i], 1, size) for i, size in enumerate(structure.block_sizes))
        )
        h_all = ca.repmat(h, m, 1)
        cubic, z = Cubic(u, v, a0, a1, h_all), ca.vertcat(x, h)

        duration = ca.sum1(times)
        objective = p.weights[0] * duration + _regularisation(structure, cubic, times, p)

        # Boundary conditions: bounds of the variables (BoundaryConditions), and static friction
        # where a joint starts.
        sigma, *other_parameters = element_parameters
        breakaway = [
            element.breakaway(
                z[:, k], sigma[:, side], *(_column(parameter, k) for parameter in other_parameters)
            )
            for k, side in structure.breakaways
        ]

        # Path constraints G(z_k) and cost L(z_k) from the element model, with exact derivatives.
        constraints = {
            "dynamics": _dynamics(structure, cubic, p.end),
            **_limits(structure, cubic, p.jerk),
            "breakaway": ca.vertcat(*breakaway),
            "duration": duration,
        }
        native = mapped_elements(element, n)
        solver = _solvers(
            x=ca.vertcat(ca.vec(x), times),
            p=ca.vertcat(*(ca.vec(parameter) for parameter in element_parameters), own_parameters),
            objective=objective,
            constraints=ca.vertcat(*constraints.values()),
            cost_weight=p.weights[1],
            z=z,
            element_parameters=element_parameters,
            functions=element_functions(element),
            native=native,
            first_options={} if structure.joints and structure.smooth else FROM_BARRIER,
            iterations=max(ITERATIONS, 2 * n),
        )
        sizes = {name: rows.numel() for name, rows in constraints.items()}
        return cls(structure, element, solver=solver, native=native, parameters=layout, sizes=sizes)

    def solve(self, data: NlpData, start: InitialPoint, *, confirming: bool = False) -> NlpSolution:
        """Solve with Ipopt from an initial point.

        The start is cold from a guess and warm from an earlier solution. `confirming` starts from a
        solution of the structured solver.
        """
        n, m = self.structure.elements, self.structure.coordinates
        if confirming:
            data = self._as_structured(data)
        inputs = tuple(
            (name, values.tobytes()) for name, values in self._inputs(data, start).items()
        )
        start_kind: Start = (
            "confirming" if confirming else "cold" if start.multipliers is None else "warm"
        )
        message, iterations, residual, objective, point = _solved(self, start_kind, inputs)
        states = point.x[: 4 * m * n].reshape(n, 4 * m)
        times = point.x[4 * m * n :]
        elements = np.column_stack([states, times[self.structure.block] * data.fractions])
        return NlpSolution(
            message,
            self.structure,
            elements,
            times,
            iterations=iterations,
            residual=residual,
            point=point,
            objective=objective,
            multipliers=self._multipliers(data, point),
        )

    def _multipliers(self, data: NlpData, point: InitialPoint) -> Multipliers:
        """Return the multipliers of the path constraints and of the directions.

        CasADi's are negative at lower bounds.
        """
        assert point.multipliers is not None
        of_x, of_g = point.multipliers
        n, m = self.structure.elements, self.structure.coordinates
        within = np.zeros((n, m))
        start = self.sizes["dynamics"]
        limited = self.structure.moving & self.structure.velocity_limits
        within[limited] = of_g[start : start + self.sizes["velocity"]]
        at_start = np.where(data.fixed, 0.0, of_x[: 4 * m * n].reshape(n, 4 * m))[:, m : 2 * m]
        signed = np.stack([at_start, within])
        lower, upper = (np.maximum(side * signed, 0.0).sum(axis=0) for side in (-1, 1))
        rows = np.maximum(of_g[sum(self.sizes.values()) :], 0.0).reshape(n, -1)
        return Multipliers.of_bounds(data, lower, upper, rows, frozenset(self.element.row_names))

    def _as_structured(self, data: NlpData) -> NlpData:
        """Return the data without bounds of u that follow from others.

        Their barrier would move the point at which Ipopt stops.
        """
        positions = slice(self.structure.coordinates)
        needed = data.bounds_of_u_count(self.structure) | data.fixed[:, positions]
        lower, upper = data.lower.copy(), data.upper.copy()
        lower[:, positions][~needed] = -np.inf
        upper[:, positions][~needed] = np.inf
        return replace(data, lower=lower, upper=upper)

    def _inputs(self, data: NlpData, start: InitialPoint) -> dict[str, Array]:
        """Return the arguments of the solver."""
        limited = self.structure.moving & self.structure.velocity_limits
        bounds = {
            "dynamics": (0.0, 0.0),
            "velocity": tuple(velocity[limited] for velocity in data.velocity),
            "jerk": (-np.inf, 0.0),
            "breakaway": (-np.inf, data.breakaway_bound.ravel()),
            "duration": data.duration,
        }
        path_bound = data.path_bound.ravel()
        lower, upper = (
            [np.broadcast_to(bounds[name][side], size) for name, size in self.sizes.items()]
            for side in (0, 1)
        )
        own_parameters = self.parameters.pack(
            **{name: getattr(data, name) for name in self.parameters.slices}
        )
        inputs = {
            "x0": start.x,
            "p": np.concatenate([*map(np.ravel, data.element_parameters), own_parameters]),
            "lbx": np.append(data.lower.ravel(), data.least_times),
            "ubx": np.append(data.upper.ravel(), np.full(len(data.least_times), np.inf)),
            "lbg": np.concatenate([*lower, np.full(path_bound.size, -np.inf)]),
            "ubg": np.concatenate([*upper, path_bound]),
        }
        if start.multipliers is not None:
            inputs["lam_x0"], inputs["lam_g0"] = start.multipliers
        return inputs


def _regularisation(structure: NlpStructure, cubic: Cubic, times: ca.MX, p: Any) -> ca.MX:
    """Return the smoothing of joints, with r = ü/limit, and the variance of the blocks' times."""
    r0, r1 = (a / ca.repmat(p.acceleration, 1, structure.elements) for a in (cubic.a0, cubic.a1))
    smoothing = (
        ca.sum2(ca.sum1(cubic.h * (r0**2 + r0 * r1 + r1**2))) if structure.joints else ca.MX(0)
    )
    b, relative = times.numel(), times / p.least_times
    variance = ca.sumsqr(relative - ca.sum1(relative) / b) / b
    return SMOOTHING * smoothing + EVEN * variance


def _dynamics(structure: NlpStructure, cubic: Cubic, end: ca.MX) -> ca.MX:
    """Return the gaps between elements, and between the last element and `end` (2 m,).

    ü may jump unless jerk is limited.
    """
    m, moving = structure.coordinates, structure.moving
    u_after, v_after = cubic.end
    gaps = [
        _select(u_after - ca.horzcat(cubic.u[:, 1:], end[:m]), moving),
        _select(v_after - ca.horzcat(cubic.v[:, 1:], end[m:]), moving),
    ]
    if structure.smooth:
        gaps.append(_select(cubic.a1[:, :-1] - cubic.a0[:, 1:], moving[:-1] | moving[1:]))
    return ca.vertcat(*gaps)


def _limits(structure: NlpStructure, cubic: Cubic, jerk: ca.MX) -> dict[str, ca.MX]:
    """Return the rows of velocity and jerk.

    They are the middle Bernstein coefficient of u̇ (the outer ones are variables), and |a1 − a0| −
    jerk h.
    """
    moving = structure.moving
    jerk_limited = moving & (structure.joints and structure.smooth)
    rise = cubic.a1 - cubic.a0
    bound = ca.repmat(jerk, 1, structure.elements) * cubic.h
    return {
        "velocity": _select(cubic.middle_velocity, moving & structure.velocity_limits),
        "jerk": ca.vertcat(
            _select(rise - bound, jerk_limited), _select(-rise - bound, jerk_limited)
        ),
    }


def _solvers(
    *,
    x: ca.MX,
    p: ca.MX,
    objective: ca.MX,
    constraints: ca.MX,
    cost_weight: ca.MX,
    z: ca.MX,
    element_parameters: list[ca.MX],
    functions: ElementFunctions,
    native: MappedElements | None,
    first_options: dict[str, Any],
    iterations: int,
) -> Callable[[Start], ca.Function]:
    """Return Ipopt for every kind of start, for elements z (4 m + 1, n).

    The program is

        min   f(x) = objective + w Σ L(z_k)
        s.t.  bounds on g(x) = [constraints; G(z_1); …; G(z_n)],  z = S x + constant.

    One Jacobian and one Hessian of the element, in C or as expanded expressions, serve every
    element. This is several times faster than differentiating the mapped element, and gives the
    same numbers. With H_k = ∇²(λ_kᵀ G + λ_f w L)(z_k),

        ∇g = [∂constraints/∂x; diag(∂G/∂z(z_k)) S],   ∇f = ∇objective + w Sᵀ [∇L(z_k)]_k,
        ∇²L = ∇²(λ_f objective + λᵀ constraints) + Sᵀ diag(H_k) S.
    """
    n, of_x = z.size2(), ca.jacobian(ca.vec(z), x)
    of_elements = partial(_of_elements, native, z, element_parameters)
    jacobians = _block_diagonal(
        of_elements(functions.jacobian), functions.jacobian.sparsity_out(0), n
    )
    g = ca.vertcat(constraints, ca.vec(of_elements(functions.rows)))
    jac_g = ca.vertcat(ca.jacobian(constraints, x), jacobians @ of_x)

    lam_f = ca.MX.sym("lam_f")
    lam_g = ca.MX.sym("lam_g", g.numel())
    lam_constraints = lam_g[: constraints.numel()]
    lam_rows = lam_g[constraints.numel() :]
    multipliers = ca.reshape(lam_rows, -1, n)
    f = objective
    same_f = objective
    grad_f = ca.gradient(objective, x)
    if functions.cost is not None and functions.gradient is not None:
        f += cost_weight * ca.sum2(of_elements(functions.cost))
        costs, slopes = of_elements(functions.gradient)
        same_f += cost_weight * ca.sum2(costs)
        grad_f += cost_weight * (of_x.T @ ca.vec(slopes))
        multipliers = ca.vertcat(multipliers, ca.repmat(lam_f * cost_weight, 1, n))
    hessians = _block_diagonal(
        of_elements(functions.hessian, multipliers), functions.hessian.sparsity_out(0), n
    )
    hess = ca.hessian(lam_f * objective + ca.dot(lam_constraints, constraints), x)[0]
    hess += of_x.T @ hessians @ of_x

    derivatives = {
        "grad_f": ca.Function("grad_f", [x, p], [same_f, grad_f], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("hess_lag", [x, p, lam_f, lam_g], [ca.triu(hess)]),
    }
    return _ipopt_by_start({"x": x, "p": p, "f": f, "g": g}, derivatives, first_options, iterations)


def _ipopt_by_start(
    nlp: dict[str, ca.MX],
    derivatives: dict[str, ca.Function],
    first_options: dict[str, Any],
    iterations: int,
) -> Callable[[Start], ca.Function]:
    """Return Ipopt for every kind of start, from a program and its derivatives."""
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "no_nlp_grad": True,  # It would only serve multipliers of p, which are not needed.
        "calc_lam_p": False,
        **derivatives,
    }
    of_ipopt: dict[Start, dict[str, Any]] = {
        "cold": {**IPOPT, **first_options, "max_iter": iterations},
        "warm": {**WARM, "max_iter": iterations},
        "confirming": {**CONFIRMING, "max_iter": CONFIRMING_ITERATIONS},
    }
    return cache(
        lambda start: ca.nlpsol("ocp", "ipopt", nlp, {**options, "ipopt": of_ipopt[start]})
    )


def _of_elements(
    native: MappedElements | None,
    z: ca.MX,
    parameters: list[ca.MX],
    function: ca.Function,
    *inputs: ca.MX,
) -> Any:
    """Return the values of a function at all elements z (4 m + 1, n), side by side."""
    if native is not None:
        return native.function(function)(z, *parameters, *inputs)
    shared = [i + 1 for i, parameter in enumerate(parameters) if parameter.size2() == 1]
    return function.map(function.name(), "serial", z.size2(), shared, [])(z, *parameters, *inputs)


Solved = tuple[str, int, float, float, InitialPoint]
"""Ipopt's message, iterations, KKT residual, objective and solution."""
Inputs = tuple[tuple[str, bytes], ...]
KEPT_SOLUTIONS = 64
"""Largest number of cached solutions of each program. They live as long as the program itself."""
_solutions: WeakKeyDictionary[Transcription, dict[tuple[Start, Inputs], Solved]] = (
    WeakKeyDictionary()
)


def _solved(transcription: Transcription, start: Start, inputs: Inputs) -> Solved:
    """Solve, or return the cached solution.

    Relaxations and second attempts repeat most of their solves.
    """
    solutions = _solutions.setdefault(transcription, {})
    key = start, inputs
    if key in solutions:
        return solutions[key]
    arguments = {name: np.frombuffer(values) for name, values in inputs}
    result, stats = ipopt(transcription.solver(start), **arguments)
    if transcription.native is not None:
        transcription.native.check()
    x, lam_x, lam_g = (result[name].full().ravel() for name in ("x", "lam_x", "lam_g"))
    if len(solutions) == KEPT_SOLUTIONS:
        del solutions[next(iter(solutions))]
    message = str(stats["return_status"])
    errors = (stats["iterations"][name][-1] for name in ("inf_pr", "inf_du"))
    point = InitialPoint(x, (lam_x, lam_g))
    solutions[key] = message, int(stats["iter_count"]), max(errors), float(result["f"]), point
    return solutions[key]


def forget_solutions() -> None:
    """Clear the cache of solutions, in order to measure how long a solve takes."""
    _solutions.clear()


def forget_programs() -> None:
    """Clear the cache of programs with their solutions, in order to free memory."""
    Transcription.build.cache_clear()


def ipopt(solver: ca.Function, **arguments: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Call a solver, and return its result and statistics.

    Raises
    ------
    KeyboardInterrupt
        If the user interrupted the solver.
    """
    result = solver(**arguments)
    stats = solver.stats()
    # Ipopt reports nothing else after Ctrl-C.
    if stats["return_status"] == "NonIpopt_Exception_Thrown":
        raise KeyboardInterrupt
    return result, stats


def _block_diagonal(columns: ca.MX, block: ca.Sparsity, count: int) -> ca.MX:
    """Return diag(B_1, …, B_n) of the blocks that a mapped Function returns side by side."""
    pattern = ca.diagcat(*[block] * count)
    return ca.MX(pattern, ca.vec(columns).nz[:]) if pattern.nnz() else ca.MX(*pattern.shape)


def _select(values: ca.MX, mask: Any) -> ca.MX:
    """Return the selected entries of a matrix (m, n), element after element. `mask` is (n, m)."""
    return ca.vec(values)[np.flatnonzero(mask).tolist()]


def _column(parameter: ca.MX, k: int) -> ca.MX:
    """Return the column of element k of a parameter."""
    return parameter if parameter.size2() == 1 else parameter[:, k]
