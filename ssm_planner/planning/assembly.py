"""Derivatives of a mesh of identical elements, assembled from those of one element.

    g(x) = [elementary rows (x); rows(z_1); …; rows(z_n)],   z = S x linear,   ∇g = …,   ∇²L = ∇²(elementary) + Sᵀ diag(H_e) S

One Jacobian and one Hessian of the element, as expanded expressions, serve every element: this is several times
faster than differentiating the mapped element, and gives the same numbers.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 300,
    "tol": 1e-8,
    "mu_init": 1e-2,
    "bound_push": 1e-2,
    "bound_frac": 1e-2,
}
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


def assemble(
    x: ca.MX, p: ca.MX, objective: ca.MX, plain: ca.MX, element: ca.Function, z: ca.MX, shared: list[ca.MX]
) -> tuple[ca.Function, ca.Function, int]:
    """Ipopt for min objective(x) subject to g = [plain(x, p); element rows of every column of z(x, p)].

    x (n, 1) variables, p parameters; z (inputs of the element, count) linear in x; shared: the element's further
    arguments, each with one column per element or a single one for all. Returns two solvers, the second for
    warm starts, and the number of rows.
    """
    count = z.size2()
    single = [i + 1 for i, argument in enumerate(shared) if argument.size2() == 1]
    jacobian, hessian = element_derivatives(element)
    rows = ca.vec(element.map("rows", "serial", count, single, [])(z, *shared))
    g = ca.vertcat(plain, rows)
    of_x = ca.jacobian(ca.vec(z), x)
    blocks = block_diagonal(jacobian.map("J", "serial", count, single, [])(z, *shared), jacobian.sparsity_out(0), count)
    jac_g = ca.vertcat(ca.jacobian(plain, x), blocks @ of_x)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    lam_plain, lam_rows = lam_g[: plain.numel()], lam_g[plain.numel() :]
    curvature = hessian.map("H", "serial", count, single, [])(z, *shared, ca.reshape(lam_rows, -1, count))
    hess = ca.hessian(lam_f * objective + ca.dot(lam_plain, plain), x)[0]
    hess += of_x.T @ block_diagonal(curvature, hessian.sparsity_out(0), count) @ of_x
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "jac_g": ca.Function("jac_g", [x, p], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("hess_lag", [x, p, lam_f, lam_g], [ca.triu(hess)]),
    }
    nlp: Any = {"x": x, "p": p, "f": objective, "g": g}
    cold, warm = (ca.nlpsol("ocp", "ipopt", nlp, {**options, "ipopt": ipopt}) for ipopt in (IPOPT, WARM))
    return cold, warm, g.numel()


def element_derivatives(element: ca.Function) -> tuple[ca.Function, ca.Function]:
    """(z, parameters…) → dense Jacobian of the rows; (z, parameters…, λ) → Hessian of λᵀ rows, with respect to z."""
    inputs = [ca.SX.sym(element.name_in(i), element.sparsity_in(i)) for i in range(element.n_in())]
    rows = element(*inputs)
    multipliers = ca.SX.sym("multipliers", rows.numel())
    jacobian = ca.Function("element_jacobian", inputs, [ca.jacobian(rows, inputs[0])])
    hessian, _ = ca.hessian(ca.dot(multipliers, rows), inputs[0])
    return jacobian, ca.Function("element_hessian", [*inputs, multipliers], [hessian])


def block_diagonal(columns: ca.MX, block: ca.Sparsity, count: int) -> ca.MX:
    """diag(B_1, …, B_n) of the blocks that a mapped Function returns side by side, keeping their sparsity."""
    pattern = ca.diagcat(*[block] * count)
    return ca.MX(pattern, ca.vec(columns).nz[:]) if pattern.nnz() else ca.MX(*pattern.shape)


def ipopt(solver: ca.Function, **arguments: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Call a solver; its answer and statistics. Raises KeyboardInterrupt where the user interrupted it."""
    answer = solver(**arguments)
    stats = solver.stats()
    if stats["return_status"] == "NonIpopt_Exception_Thrown":  # all that Ipopt tells of Ctrl-C
        raise KeyboardInterrupt
    return answer, stats
