"""Ipopt for a program: options for every kind of start, and exact sparse derivatives."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, Literal

import casadi as ca

from ssm_planner.elements.compiled import MappedElements
from ssm_planner.elements.element import ElementFunctions
from ssm_planner.interior.solve import LAST_BARRIER, TOLERANCE
from ssm_planner.planning.ocp.nlp import NlpStructure
from ssm_planner.typing import record

Start = Literal["cold", "brief", "warm", "confirming"]
"""Start from a guess, from a guess with few iterations, from an earlier solution with its
multipliers, or from a solution of the structured solver.
"""
ITERATIONS = 300
"""Largest number of iterations of a cold or warm start."""
COMMON_OPTIONS = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-8,
    # AMD ordering. By default MUMPS takes METIS on fine meshes, which makes each iteration slower.
    "mumps_pivot_order": 0,
}
BRIEF = 4800
"""Largest product of iterations and elements of a brief start.

Of 20 motions that began at speed, 17 took at most 65 iterations. Failures take up to 300.
"""
OPTIONS: dict[Start, dict[str, Any]] = {
    "cold": {"mu_init": 1e-4, "bound_push": 1e-2, "bound_frac": 1e-2},
    "warm": {
        "mu_init": 1e-7,
        "warm_start_init_point": "yes",
        "warm_start_bound_push": 1e-9,
        "warm_start_bound_frac": 1e-9,
        "warm_start_slack_bound_push": 1e-9,
        "warm_start_slack_bound_frac": 1e-9,
        "warm_start_mult_bound_push": 1e-9,
    },
    # The slacks and the last barrier weight of the structured solver give its multipliers, so the
    # initial point is a solution for Ipopt if it is one at all.
    "confirming": {
        "max_iter": 30,
        "bound_mult_init_method": "mu-based",
        "mu_init": TOLERANCE / LAST_BARRIER,
        "bound_push": 1e-13,
        "bound_frac": 1e-13,
        "slack_bound_push": 1e-13,
        "slack_bound_frac": 1e-13,
        # With 0 Ipopt crashes if it has to treat fixed variables as free ones.
        "bound_relax_factor": 1e-12,
        "constr_mult_init_max": 1e10,
    },
}
"""Options of Ipopt by the kind of start, in addition to COMMON_OPTIONS."""


@record
class IpoptProgram:
    """A program with n elements, without its path constraints G(z_k) and costs L(z_k).

    It is min objective + w Σ L(z_k), subject to bounds on the constraints and G(z_k) ≤ 1.
    """

    structure: NlpStructure
    x: ca.MX
    """Variables."""
    p: ca.MX
    """Parameters."""
    objective: ca.MX
    constraints: ca.MX
    cost_weight: ca.MX
    """Weight w."""
    z: ca.MX
    """Elements, (4 m + 1, n). They are linear in x."""
    element_parameters: list[ca.MX]
    """Parameters of the element model, (size, n) or (size, 1) each."""


def build_solvers(
    program: IpoptProgram, functions: ElementFunctions, native: MappedElements | None
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
    x, p, z = program.x, program.p, program.z
    objective, constraints, weight = program.objective, program.constraints, program.cost_weight
    n, of_x = z.size2(), ca.jacobian(ca.vec(z), x)
    of_elements = partial(_of_elements, native, z, program.element_parameters)
    jacobians = _block_diagonal(
        of_elements(functions.jacobian), functions.jacobian.sparsity_out(0), n
    )
    g = ca.vertcat(constraints, ca.vec(of_elements(functions.rows)))
    jac_g = ca.vertcat(ca.jacobian(constraints, x), jacobians @ of_x)

    f, grad_f = objective, ca.gradient(objective, x)
    lam_f = ca.MX.sym("lam_f")
    lam_g = ca.MX.sym("lam_g", g.numel())
    lam_constraints, lam_rows = ca.vertsplit(lam_g, [0, constraints.numel(), g.numel()])
    multipliers = ca.reshape(lam_rows, -1, n)
    if functions.cost is not None and functions.gradient is not None:
        f += weight * ca.sum2(of_elements(functions.cost))
        _, slopes = of_elements(functions.gradient)
        grad_f += weight * (of_x.T @ ca.vec(slopes))
        multipliers = ca.vertcat(multipliers, ca.repmat(lam_f * weight, 1, n))
    hessians = _block_diagonal(
        of_elements(functions.hessian, multipliers), functions.hessian.sparsity_out(0), n
    )
    hess = ca.hessian(lam_f * objective + ca.dot(lam_constraints, constraints), x)[0]
    hess += of_x.T @ hessians @ of_x
    nlp = {"x": x, "p": p, "f": f, "g": g}
    hess_lag = ca.Function("hess_lag", [x, p, lam_f, lam_g], [ca.triu(hess)])
    return _ipopt_by_start(program.structure, nlp, grad_f, jac_g=jac_g, hess_lag=hess_lag)


def _ipopt_by_start(
    structure: NlpStructure,
    nlp: dict[str, ca.MX],
    grad_f: ca.MX,
    *,
    jac_g: ca.MX,
    hess_lag: ca.Function,
) -> Callable[[Start], ca.Function]:
    """Return Ipopt for every kind of start, from a program and its derivatives."""
    x, p, f, g = nlp.values()
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "no_nlp_grad": True,  # It would only serve multipliers of p, which are not needed.
        "calc_lam_p": False,
        "grad_f": ca.Function("grad_f", [x, p], [f, grad_f], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": hess_lag,
    }

    def build(start: Start) -> ca.Function:
        elements, options_of = structure.elements, start
        iterations = max(ITERATIONS, 2 * elements)
        if start == "brief":
            iterations, options_of = BRIEF // elements, "cold"
        ipopt_options = {**COMMON_OPTIONS, "max_iter": iterations, **OPTIONS[options_of]}
        # First multipliers mu_init / slack save a fifth of the iterations, except if jerk is
        # limited in joints.
        if options_of == "cold" and not (structure.joints and structure.smooth):
            ipopt_options["bound_mult_init_method"] = "mu-based"
        return ca.nlpsol("ocp", "ipopt", nlp, {**options, "ipopt": ipopt_options})

    return cache(build)


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
