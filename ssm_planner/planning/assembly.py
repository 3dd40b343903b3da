"""Derivatives of a mesh of identical elements, assembled from those of one element.

    f(x) = elementary f(x) + w Σ cost(z_i)
    g(x) = [elementary rows (x); rows(z_1); …; rows(z_n)],   z = S x linear
    ∇g = …,   ∇²L = ∇²(elementary) + Sᵀ diag(H_e) S

One Jacobian and one Hessian of the element, as expanded expressions, serve every element: this is several times
faster than differentiating the mapped element, and gives the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True, eq=False)
class Mesh:
    """Where the element functions are applied: z (inputs, count) linear in x, and their further arguments.

    Every further argument has one column per element, or a single one for all.
    """

    z: ca.MX
    shared: tuple[ca.MX, ...]

    @property
    def count(self) -> int:
        return int(self.z.size2())

    def map(self, function: ca.Function, *more: ca.MX) -> ca.MX:
        """The function's values at all elements side by side."""
        single = [i + 1 for i, argument in enumerate(self.shared) if argument.size2() == 1]
        return function.map(function.name(), "serial", self.count, single, [])(self.z, *self.shared, *more)


def assemble(
    x: ca.MX,
    p: ca.MX,
    objective: ca.MX,
    plain: ca.MX,
    element: ca.Function,
    mesh: Mesh,
    cost: ca.Function | None = None,
    weight: ca.MX | None = None,
) -> tuple[ca.Function, ca.Function, int]:
    """Ipopt for min objective(x) + weight Σ cost(z_i) subject to bounds on g = [plain(x, p); element rows of every z_i].

    x (n, 1) variables, p parameters. Returns two solvers, the second for warm starts, and the number of rows.
    """
    count = mesh.count
    jacobian, hessian = element_derivatives(element, cost)
    rows = ca.vec(mesh.map(element))
    g = ca.vertcat(plain, rows)
    of_x = ca.jacobian(ca.vec(mesh.z), x)
    blocks = block_diagonal(mesh.map(jacobian), jacobian.sparsity_out(0), count)
    jac_g = ca.vertcat(ca.jacobian(plain, x), blocks @ of_x)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    lam_plain, lam_rows = lam_g[: plain.numel()], lam_g[plain.numel() :]
    multipliers = ca.reshape(lam_rows, -1, count)
    gradient = ca.gradient(objective, x)
    if cost is not None and weight is not None:
        multipliers = ca.vertcat(multipliers, ca.repmat(lam_f * weight, 1, count))
        slope, _ = element_derivatives(cost)
        gradient += weight * (of_x.T @ ca.vec(ca.densify(mesh.map(slope))))
        total = objective + weight * ca.sum2(mesh.map(cost))
    else:
        total = objective
    curvature = mesh.map(hessian, multipliers)
    hess = ca.hessian(lam_f * objective + ca.dot(lam_plain, plain), x)[0]
    hess += of_x.T @ block_diagonal(curvature, hessian.sparsity_out(0), count) @ of_x
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "grad_f": ca.Function("grad_f", [x, p], [total, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("hess_lag", [x, p, lam_f, lam_g], [ca.triu(hess)]),
    }
    nlp: Any = {"x": x, "p": p, "f": total, "g": g}
    cold, warm = (ca.nlpsol("ocp", "ipopt", nlp, {**options, "ipopt": ipopt}) for ipopt in (IPOPT, WARM))
    return cold, warm, g.numel()


def element_derivatives(element: ca.Function, cost: ca.Function | None = None) -> tuple[ca.Function, ca.Function]:
    """(z, parameters…) → dense Jacobian of the rows; (z, parameters…, λ) → Hessian of λᵀ [rows; cost] by z."""
    inputs = [ca.SX.sym(element.name_in(i), element.sparsity_in(i)) for i in range(element.n_in())]
    rows = element(*inputs)
    jacobian = ca.Function("element_jacobian", inputs, [ca.jacobian(rows, inputs[0])])
    weighed = rows if cost is None else ca.vertcat(rows, cost(*inputs))
    multipliers = ca.SX.sym("multipliers", weighed.numel())
    hessian, _ = ca.hessian(ca.dot(multipliers, weighed), inputs[0])
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
