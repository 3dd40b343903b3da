"""One element of a mesh: what an optimisation needs of its limits and costs, with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca

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
class ElementFunctions:
    """Functions of (z, *arguments): rows at all points, their Jacobian by z; the cost and its gradient, where there is one.

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
