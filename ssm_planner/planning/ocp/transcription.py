"""The nonlinear program behind every optimised motion: direct transcription on a mesh of cubic elements.

A straight motion has one coordinate, the path parameter s; a free one its moving joints. `Transcription.of` states the
program from top to bottom; only the element model differs between the two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from typing import Any, Literal
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import Layout
from ssm_planner.interior.solve import LAST_BARRIER, TOLERANCE
from ssm_planner.planning.ocp.element import ElementFunctions, ElementModel, element_functions
from ssm_planner.planning.ocp.natively import MappedElements, mapped_elements
from ssm_planner.planning.ocp.nlp import InitialPoint, NlpData, NlpSolution, NlpStructure
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array

SMOOTHING = 3e-6
"""Weight of 3 ∫ (ü/limit)² dt of joints: decides how those move that do not bind."""
EVEN = 1e-5
"""Weight of the variance of the blocks' times, each relative to its least: decides where several meshes do as well."""
ITERATIONS, HEAT_ITERATIONS, COOLING_ITERATIONS = 300, 150, 150
"""At most; the least heat, and less of it, are given up sooner, for the fastest motion is at hand."""
JOINT_ITERATIONS, LEAST_ITERATIONS = 6e4, 200
"""Times elements and joints of a free motion, at most: one or two seconds; and those that are always allowed."""
IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-8,
    "mu_init": 1e-4,
    "bound_push": 1e-2,
    "bound_frac": 1e-2,
    "mumps_pivot_order": 0,  # AMD; by itself MUMPS takes METIS on fine meshes, for which each iteration takes longer
}
FROM_BARRIER = {"bound_mult_init_method": "mu-based"}
"""First multipliers of mu_init / slack: a fifth fewer iterations than from 1, but where jerk is limited in joints."""
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
"""From the solution of the same problem with a few bounds moved."""
CONFIRMING: dict[str, Any] = {
    **IPOPT,
    **FROM_BARRIER,
    "mu_init": TOLERANCE / LAST_BARRIER,
    "bound_push": 1e-13,
    "bound_frac": 1e-13,
    "slack_bound_push": 1e-13,
    "slack_bound_frac": 1e-13,
    "bound_relax_factor": 1e-12,  # at 0 Ipopt crashes where it has to treat fixed variables as free ones
    "constr_mult_init_max": 1e10,
}
"""From a solution of the structured solver: its slacks as they are and its last barrier give its multipliers, so that the
start is Ipopt's solution too, if it is one."""
CONFIRMING_ITERATIONS = 30
Start = Literal["cold", "warm", "confirming"]


@dataclass(frozen=True)
class Transcription:
    """Ipopt for one structure and element model; every number of NlpData is a parameter or a bound."""

    structure: NlpStructure
    element: ElementModel
    solver: Callable[[Start], ca.Function] = field(compare=False)
    """For a start from a guess, from an earlier solution with its multipliers, or from the structured solver's."""
    native: MappedElements | None = field(compare=False)
    """What it evaluates in C; None: nothing."""
    parameters: Layout = field(compare=False)
    """Fields of NlpData that are parameters, after those of the element model."""
    sizes: dict[str, int] = field(compare=False)
    """Rows of every group of constraints before the path constraints, in their order."""

    @classmethod
    @lru_cache(maxsize=12)
    def of(cls, structure: NlpStructure, element: ElementModel) -> Transcription:
        """The program, built once for each structure and element model, to be solved from a guess by `solve`.

        With n elements k, m coordinates and b blocks

            min   w_t Σ T + w_c Σ L(z_k) + 3 SMOOTHING Σ ∫ (ü/limit)² dt + EVEN var(T / T_least)
            s.t.  u, u̇ continuous, ü too where jerk is limited;  bounds on u, u̇, ü, u⃛ and Σ T;  G(z_k) ≤ 1 − backoff

        Shapes are (coordinates, elements), as CasADi maps columns.
        """
        n, m, b = structure.elements, structure.coordinates, len(structure.block_sizes)
        moving = structure.moving

        # variables: u, u̇, ü at the start and ü at the end of every element; time T of every block
        x, times = ca.MX.sym("x", 4 * m, n), ca.MX.sym("times", b)
        u, v, a0, a1 = (x[i * m : (i + 1) * m, :] for i in range(4))

        # parameters: those of the element model, (size, n) or (size, 1); the program's own
        element_parameters = [
            ca.MX.sym(f"p{i}", size, n if per_element else 1)
            for i, (size, per_element) in enumerate(element.parameters)
        ]
        layout = Layout(fractions=n, end=2 * m, jerk=m, acceleration=m, weights=2, least_times=b)
        own_parameters = ca.MX.sym("p", layout.size)
        p = layout.unpack(own_parameters)
        end_u, end_v = p.end[:m], p.end[m:]

        # elements: h_k = fraction_k T_block(k), the same for all coordinates; z = [u; u̇; ü; ü; h]
        h = p.fractions.T * ca.horzcat(
            *(ca.repmat(times[i], 1, size) for i, size in enumerate(structure.block_sizes))
        )
        h_all = ca.repmat(h, m, 1)
        cubic, z = Cubic(u, v, a0, a1, h_all), ca.vertcat(x, h)

        # objective: duration; smoothing, r = ü/limit being linear in an element; variance of the blocks' times
        duration = ca.sum1(times)
        r0, r1 = (a / ca.repmat(p.acceleration, 1, n) for a in (a0, a1))
        smoothing = (
            ca.sum2(ca.sum1(h_all * (r0**2 + r0 * r1 + r1**2))) if structure.joints else ca.MX(0)
        )
        relative = times / p.least_times
        variance = ca.sumsqr(relative - ca.sum1(relative) / b) / b
        objective = p.weights[0] * duration + SMOOTHING * smoothing + EVEN * variance

        # dynamics: an element ends where the next one starts, the last at `end`; ü jumps unless jerk is limited
        u_after, v_after = cubic.end
        dynamics = [
            _where(u_after - ca.horzcat(u[:, 1:], end_u), moving),
            _where(v_after - ca.horzcat(v[:, 1:], end_v), moving),
        ]
        if structure.smooth:
            dynamics.append(_where(a1[:, :-1] - a0[:, 1:], moving[:-1] | moving[1:]))

        # limits of the coordinates: the middle Bernstein coefficient of u̇ (the outer ones are variables); |a1 − a0| ≤ jerk h
        velocity = _where(cubic.middle_velocity, moving & structure.velocity_limits)
        jerk_limited = moving & (structure.joints and structure.smooth)
        rise, most = a1 - a0, ca.repmat(p.jerk, 1, n) * h_all
        jerk = ca.vertcat(_where(rise - most, jerk_limited), _where(-rise - most, jerk_limited))

        # boundary conditions: bounds of the variables (BoundaryConditions), and static friction where a joint starts
        sigma, *others = element_parameters
        breakaway = [
            element.breakaway(z[:, k], sigma[:, side], *(_of(parameter, k) for parameter in others))
            for k, side in structure.breakaways
        ]

        # path constraints G(z_k) and cost L(z_k): by the element model, with exact derivatives
        constraints = {
            "dynamics": ca.vertcat(*dynamics),
            "velocity": velocity,
            "jerk": jerk,
            "breakaway": ca.vertcat(*breakaway),
            "duration": duration,
        }
        native = mapped_elements(element, n)
        most = max(ITERATIONS, 2 * n)
        if structure.joints:
            most = int(max(LEAST_ITERATIONS, min(ITERATIONS, JOINT_ITERATIONS / (n * m))))
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
            first={} if structure.joints and structure.smooth else FROM_BARRIER,
            iterations={"heat": HEAT_ITERATIONS, "cooling": COOLING_ITERATIONS}.get(
                element.aim, most
            ),
        )
        sizes = {name: rows.numel() for name, rows in constraints.items()}
        return cls(structure, element, solver=solver, native=native, parameters=layout, sizes=sizes)

    def solve(self, data: NlpData, start: InitialPoint, *, confirming: bool = False) -> NlpSolution:
        """Ipopt's solution from a guess, warm from an earlier solution's point, or confirming the structured solver's."""
        n, m = self.structure.elements, self.structure.coordinates
        if confirming:
            data = self._as_structured(data)
        inputs = tuple(
            (name, values.tobytes()) for name, values in self._inputs(data, start).items()
        )
        way: Start = "confirming" if confirming else "cold" if start.multipliers is None else "warm"
        message, iterations, objective, point = _solved(self, way, inputs)
        states, times = point.x[: 4 * m * n].reshape(n, 4 * m), point.x[4 * m * n :]
        elements = np.column_stack([states, times[self.structure.block] * data.fractions])
        return NlpSolution(
            message,
            self.structure,
            elements,
            times,
            iterations=iterations,
            point=point,
            objective=objective,
        )

    def _as_structured(self, data: NlpData) -> NlpData:
        """Without the bounds of u that follow from others: their barrier moves the point at which Ipopt stops."""
        positions = slice(self.structure.coordinates)
        kept = data.bounds_of_u_count(self.structure) | data.given[:, positions]
        lower, upper = data.lower.copy(), data.upper.copy()
        lower[:, positions][~kept], upper[:, positions][~kept] = -np.inf, np.inf
        return replace(data, lower=lower, upper=upper)

    def _inputs(self, data: NlpData, start: InitialPoint) -> dict[str, Array]:
        """Arguments of the solver."""
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
    first: dict[str, Any],
    iterations: int,
) -> Callable[[Start], ca.Function]:
    """Ipopt for every kind of start, on the program with the elements z (4 m + 1, n) and their parameters:

        min f(x) = objective + w Σ L(z_k)  subject to bounds on  g(x) = [constraints; G(z_1); …; G(z_n)],  z = S x + constant

    One Jacobian and one Hessian of the element, in C or as expanded expressions, serve every element: this is several times
    faster than differentiating the mapped element, and gives the same numbers. With H_k = ∇²(λ_kᵀ G + λ_f w L)(z_k):

        ∇g = [∂constraints/∂x; diag(∂G/∂z(z_k)) S],   ∇f = ∇objective + w Sᵀ [∇L(z_k)]_k
        ∇²L = ∇²(λ_f objective + λᵀ constraints) + Sᵀ diag(H_k) S
    """
    n, of_x = z.size2(), ca.jacobian(ca.vec(z), x)
    for_all = [i + 1 for i, parameter in enumerate(element_parameters) if parameter.size2() == 1]

    def of_elements(function: ca.Function, *more: ca.MX) -> Any:
        """The function's values at all elements side by side."""
        mapped = (
            function.map(function.name(), "serial", n, for_all, [])
            if native is None
            else native.function(function)
        )
        return mapped(z, *element_parameters, *more)

    jacobians = _block_diagonal(
        of_elements(functions.jacobian), functions.jacobian.sparsity_out(0), n
    )
    g = ca.vertcat(constraints, ca.vec(of_elements(functions.rows)))
    jac_g = ca.vertcat(ca.jacobian(constraints, x), jacobians @ of_x)

    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    lam_constraints, lam_rows = lam_g[: constraints.numel()], lam_g[constraints.numel() :]
    multipliers = ca.reshape(lam_rows, -1, n)
    f, same_f, grad_f = objective, objective, ca.gradient(objective, x)
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

    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "no_nlp_grad": True,  # for the multipliers of p, which nobody asks for
        "calc_lam_p": False,
        "grad_f": ca.Function("grad_f", [x, p], [same_f, grad_f], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("hess_lag", [x, p, lam_f, lam_g], [ca.triu(hess)]),
    }
    nlp: Any = {"x": x, "p": p, "f": f, "g": g}
    of_ipopt: dict[Start, dict[str, Any]] = {
        "cold": {**IPOPT, **first, "max_iter": iterations},
        "warm": {**WARM, "max_iter": iterations},
        "confirming": {**CONFIRMING, "max_iter": CONFIRMING_ITERATIONS},
    }
    return cache(
        lambda start: ca.nlpsol("ocp", "ipopt", nlp, {**options, "ipopt": of_ipopt[start]})
    )


Solved = tuple[str, int, float, InitialPoint]
"""Ipopt's message, iterations, objective and solution."""
Inputs = tuple[tuple[str, bytes], ...]
KEPT_SOLUTIONS = 64
"""Of each program, for as long as the program itself is kept."""
_solutions: WeakKeyDictionary[Transcription, dict[tuple[Start, Inputs], Solved]] = (
    WeakKeyDictionary()
)


def _solved(transcription: Transcription, start: Start, inputs: Inputs) -> Solved:
    """Kept from an earlier call or solved: trials of relaxations and second attempts ask for most of them again."""
    kept = _solutions.setdefault(transcription, {})
    asked = start, inputs
    if asked in kept:
        return kept[asked]
    arguments = {name: np.frombuffer(values) for name, values in inputs}
    result, stats = ipopt(transcription.solver(start), **arguments)
    if transcription.native is not None:
        transcription.native.check()
    x, lam_x, lam_g = (result[name].full().ravel() for name in ("x", "lam_x", "lam_g"))
    if len(kept) == KEPT_SOLUTIONS:
        del kept[next(iter(kept))]
    message, iterations = str(stats["return_status"]), int(stats["iter_count"])
    kept[asked] = message, iterations, float(result["f"]), InitialPoint(x, (lam_x, lam_g))
    return kept[asked]


def forget_solutions() -> None:
    """Solve again what has been solved already: for measuring how long it takes."""
    _solutions.clear()


def forget_programs() -> None:
    """Free the memory of the programs kept, with their solutions."""
    Transcription.of.cache_clear()


def ipopt(solver: ca.Function, **arguments: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Call a solver; its result and statistics. Raises KeyboardInterrupt where the user interrupted it."""
    result = solver(**arguments)
    stats = solver.stats()
    if stats["return_status"] == "NonIpopt_Exception_Thrown":  # all that Ipopt tells of Ctrl-C
        raise KeyboardInterrupt
    return result, stats


def _block_diagonal(columns: ca.MX, block: ca.Sparsity, count: int) -> ca.MX:
    """diag(B_1, …, B_n) of the blocks that a mapped Function returns side by side, keeping their sparsity."""
    pattern = ca.diagcat(*[block] * count)
    return ca.MX(pattern, ca.vec(columns).nz[:]) if pattern.nnz() else ca.MX(*pattern.shape)


def _where(values: ca.MX, chosen: Any) -> ca.MX:
    """The chosen entries of a matrix (m, n), element after element; chosen (n, m)."""
    return ca.vec(values)[np.flatnonzero(chosen).tolist()]


def _of(parameter: ca.MX, k: int) -> ca.MX:
    """Its column of element k."""
    return parameter if parameter.size2() == 1 else parameter[:, k]
