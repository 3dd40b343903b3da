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

from ssm_planner.planning.ocp.element import ElementFunctions

IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-8,
    "mu_init": 1e-4,
    "bound_push": 1e-2,
    "bound_frac": 1e-2,
    "mumps_pivot_order": 0,  # AMD; by itself MUMPS takes METIS on fine meshes, for which each iteration takes longer
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
"""From the answer to the same problem with a few limits moved."""


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

    def map(self, function: ca.Function, *more: ca.MX) -> Any:
        """The function's values at all elements side by side."""
        single = [i + 1 for i, argument in enumerate(self.shared) if argument.size2() == 1]
        return function.map(function.name(), "serial", self.count, single, [])(self.z, *self.shared, *more)


def assemble(
    x: ca.MX,
    p: ca.MX,
    objective: ca.MX,
    plain: ca.MX,
    element: ElementFunctions,
    mesh: Mesh,
    weight: ca.MX,
    iterations: int,
) -> tuple[ca.Function, ca.Function]:
    """Ipopt for min objective(x) + weight Σ cost(z_i) subject to bounds on g = [plain(x, p); element rows of every z_i].

    x (n, 1) variables, p parameters. Returns two solvers, the second for warm starts.
    """
    count = mesh.count
    rows = ca.vec(mesh.map(element.rows))
    g = ca.vertcat(plain, rows)
    of_x = ca.jacobian(ca.vec(mesh.z), x)
    blocks = block_diagonal(mesh.map(element.jacobian), element.jacobian.sparsity_out(0), count)
    jac_g = ca.vertcat(ca.jacobian(plain, x), blocks @ of_x)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    lam_plain, lam_rows = lam_g[: plain.numel()], lam_g[plain.numel() :]
    multipliers = ca.reshape(lam_rows, -1, count)
    total, same_total, gradient = objective, objective, ca.gradient(objective, x)
    if element.cost is not None and element.gradient is not None:
        total += weight * ca.sum2(mesh.map(element.cost))
        costs, slopes = mesh.map(element.gradient)
        same_total += weight * ca.sum2(costs)
        gradient += weight * (of_x.T @ ca.vec(slopes))
        multipliers = ca.vertcat(multipliers, ca.repmat(lam_f * weight, 1, count))
    curvature = mesh.map(element.hessian, multipliers)
    hess = ca.hessian(lam_f * objective + ca.dot(lam_plain, plain), x)[0]
    hess += of_x.T @ block_diagonal(curvature, element.hessian.sparsity_out(0), count) @ of_x
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "no_nlp_grad": True,  # for the multipliers of p, which nobody asks for
        "calc_lam_p": False,
        "grad_f": ca.Function("grad_f", [x, p], [same_total, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("hess_lag", [x, p, lam_f, lam_g], [ca.triu(hess)]),
    }
    nlp: Any = {"x": x, "p": p, "f": total, "g": g}
    cold, warm = (
        ca.nlpsol("ocp", "ipopt", nlp, {**options, "ipopt": {**ipopt, "max_iter": iterations}})
        for ipopt in (IPOPT, WARM)
    )
    return cold, warm


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
