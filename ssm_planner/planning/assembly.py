"""Derivatives of a mesh of identical elements, assembled from those of one element.

    f(x) = elementary f(x) + w Σ cost(z_i)
    g(x) = [elementary rows (x); rows(z_1); …; rows(z_n)],   z = S x linear
    ∇g = …,   ∇²L = ∇²(elementary) + Sᵀ diag(H_e) S

One Jacobian and one Hessian of the element, as expanded expressions, serve every element: this is several times
faster than differentiating the mapped element, and gives the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 300,
    "tol": 1e-8,
    "mu_init": 1e-4,
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
"""From the answer to the same problem with a few limits moved."""
COLLOCATION = (0.0, 0.5, 1.0)
"""Where in an element the limits are kept; both ends, because the acceleration may jump there."""
SIMPSON = (1 / 6, 4 / 6, 1 / 6)
"""Shares of the element's length that the points stand for in integrals."""


class Stage(Protocol):
    """One element of a motion: z = (u, u̇, ü at its start, ü at its end of m coordinates, length), scaled time."""

    @property
    def size(self) -> int:
        """Length of z."""

    @property
    def arguments(self) -> tuple[tuple[int, bool], ...]:
        """Length of each further argument, and whether every element has its own. The first are the directions."""

    def states(self, z: ca.SX) -> list[ca.SX]:
        """What the limits depend on, at the points COLLOCATION."""

    @property
    def point(self) -> ca.Function:
        """(state, *arguments) → rows ≤ 1."""

    @property
    def cost(self) -> ca.Function | None:
        """(state, *arguments) → the integrand of the objective, where it is not time alone."""


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
    stage: Stage,
    mesh: Mesh,
    weight: ca.MX,
) -> tuple[ca.Function, ca.Function]:
    """Ipopt for min objective(x) + weight Σ cost(z_i) subject to bounds on g = [plain(x, p); element rows of every z_i].

    x (n, 1) variables, p parameters. Returns two solvers, the second for warm starts.
    """
    count = mesh.count
    element = element_functions(stage)
    rows = ca.vec(mesh.map(element.rows))
    g = ca.vertcat(plain, rows)
    of_x = ca.jacobian(ca.vec(mesh.z), x)
    blocks = block_diagonal(mesh.map(element.jacobian), element.jacobian.sparsity_out(0), count)
    jac_g = ca.vertcat(ca.jacobian(plain, x), blocks @ of_x)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    lam_plain, lam_rows = lam_g[: plain.numel()], lam_g[plain.numel() :]
    multipliers = ca.reshape(lam_rows, -1, count)
    total, gradient = objective, ca.gradient(objective, x)
    if element.cost is not None and element.gradient is not None:
        total += weight * ca.sum2(mesh.map(element.cost))
        gradient += weight * (of_x.T @ ca.vec(mesh.map(element.gradient)))
        multipliers = ca.vertcat(multipliers, ca.repmat(lam_f * weight, 1, count))
    curvature = mesh.map(element.hessian, multipliers)
    hess = ca.hessian(lam_f * objective + ca.dot(lam_plain, plain), x)[0]
    hess += of_x.T @ block_diagonal(curvature, element.hessian.sparsity_out(0), count) @ of_x
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "grad_f": ca.Function("grad_f", [x, p], [total, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("hess_lag", [x, p, lam_f, lam_g], [ca.triu(hess)]),
    }
    nlp: Any = {"x": x, "p": p, "f": total, "g": g}
    cold, warm = (ca.nlpsol("ocp", "ipopt", nlp, {**options, "ipopt": ipopt}) for ipopt in (IPOPT, WARM))
    return cold, warm


@dataclass(frozen=True, eq=False)
class ElementFunctions:
    """Functions of (z, *arguments): rows at all points, their Jacobian by z; cost ∫ of the integrand and its gradient, where there is one.

    hessian takes the rows' multipliers and the cost's too.
    """

    rows: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    cost: ca.Function | None
    gradient: ca.Function | None


def element_functions(stage: Stage) -> ElementFunctions:
    """Exact derivatives of an element by the chain rule through the state at each point.

    The derivatives of the state's functions are taken once, by few variables; those of the state by z are those of a
    polynomial. Differentiating the whole element by z instead makes expressions several times as large.
    """
    z = ca.SX.sym("z", stage.size)
    arguments = [ca.SX.sym(f"argument{i}", size) for i, (size, _) in enumerate(stage.arguments)]
    states = stage.states(z)
    size = states[0].numel()
    count = stage.point.size1_out(0)
    point = _PointDerivatives.of(stage, size)
    lam, lam_cost = ca.SX.sym("multipliers", count * len(states)), ca.SX.sym("cost_multiplier")
    of_cost = ca.gradient(z[-1], z)
    rows, jacobian = [], []
    cost, gradient, hessian = ca.SX(0), ca.SX.zeros(stage.size), ca.SX(stage.size, stage.size)
    for c, (state, share) in enumerate(zip(states, SIMPSON, strict=True)):
        slope = ca.jacobian(state, z)
        rows.append(stage.point(state, *arguments))
        jacobian.append(point.jacobian(state, *arguments) @ slope)
        weight = share * z[-1]
        own = lam[c * count : (c + 1) * count]
        curvature, pull = point.hessian(state, *arguments, own, weight * lam_cost)
        hessian += slope.T @ curvature @ slope + _bend(state, z, pull)
        if stage.cost is not None:
            value, value_slope = stage.cost(state, *arguments), point.cost_gradient(state, *arguments)
            along = slope.T @ value_slope
            cost += weight * value
            gradient += weight * along + share * value * of_cost
            cross = share * lam_cost * (of_cost @ along.T)
            hessian += cross + cross.T
    inputs = [z, *arguments]
    costs = stage.cost is not None
    multipliers = [ca.vertcat(lam, lam_cost)] if costs else [lam]
    if not costs:
        hessian = ca.substitute(hessian, lam_cost, 0)
    return ElementFunctions(
        ca.Function("rows", inputs, [ca.vertcat(*rows)]),
        ca.Function("jacobian", inputs, [ca.vertcat(*jacobian)]),
        ca.Function("hessian", [*inputs, *multipliers], [hessian]),
        ca.Function("cost", inputs, [cost]) if costs else None,
        ca.Function("gradient", inputs, [ca.densify(gradient)]) if costs else None,
    )


@dataclass(frozen=True, eq=False)
class _PointDerivatives:
    """Functions of (state, *arguments): Jacobian of the rows; Hessian and gradient of λᵀ rows + κ cost; gradient of cost."""

    jacobian: ca.Function
    hessian: ca.Function
    cost_gradient: ca.Function

    @classmethod
    def of(cls, stage: Stage, size: int) -> _PointDerivatives:
        state = ca.SX.sym("state", size)
        inputs = [state, *(ca.SX.sym(f"argument{i}", n) for i, (n, _) in enumerate(stage.arguments))]
        rows = stage.point(*inputs)
        cost = ca.SX(0) if stage.cost is None else stage.cost(*inputs)
        lam, kappa = ca.SX.sym("lam", rows.numel()), ca.SX.sym("kappa")
        hessian, gradient = ca.hessian(ca.dot(lam, rows) + kappa * cost, state)
        return cls(
            ca.Function("point_jacobian", inputs, [ca.jacobian(rows, state)]),
            ca.Function("point_hessian", [*inputs, lam, kappa], [hessian, gradient]),
            ca.Function("cost_gradient", inputs, [ca.gradient(cost, state)]),
        )


def _bend(state: ca.SX, z: ca.SX, pull: ca.SX) -> ca.SX:
    """Σ pull_k ∇² state_k by z."""
    held = ca.SX.sym("pull", state.numel())
    return ca.substitute(ca.hessian(ca.dot(held, state), z)[0], held, pull)


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
