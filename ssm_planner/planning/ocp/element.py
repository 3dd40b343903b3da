"""One element of a mesh: what an optimisation needs of its limits and costs, with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

COLLOCATION = (0.0, 0.5, 1.0)
"""Where in an element the limits are kept; both ends, because the acceleration may jump there."""
SIMPSON = (1 / 6, 4 / 6, 1 / 6)
"""Shares of the element's length that the points stand for in integrals."""


class ElementModel(Protocol):
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
    """Functions of (z, *arguments): rows at all points, their Jacobian by z; where there is a cost, it and its gradient too.

    hessian takes the rows' multipliers and the cost's too. gradient returns cost and gradient.
    """

    rows: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    cost: ca.Function | None
    gradient: ca.Function | None


def element_functions(stage: ElementModel) -> ElementFunctions:
    """Exact derivatives of an element by the chain rule through the state at each point.

    The derivatives of the state's functions are taken once, by few variables, and called at every point: what is evaluated
    again and again then stays in the processor's cache. Those of the state by z are those of a polynomial.
    """
    point = _Point.of(stage)
    chain = _Chain.of(stage, point)
    z = ca.MX.sym("z", stage.size)
    arguments = [ca.MX.sym(f"argument{i}", size) for i, (size, _) in enumerate(stage.arguments)]
    states = [[state, *arguments] for state in chain.states(z)]
    count, costs = stage.point.size1_out(0), stage.cost is not None
    lam = ca.MX.sym("multipliers", count * len(states) + costs)
    lam_cost = lam[-1] if costs else ca.MX(0)
    inputs = [z, *arguments]
    jacobians = [point.jacobian(*at) for at in states]
    bends: list[ca.MX] = []
    for c, (at, share) in enumerate(zip(states, SIMPSON, strict=True)):
        bends += point.hessian(*at, lam[c * count : (c + 1) * count], share * z[-1] * lam_cost)
    cost = gradient = None
    if stage.cost is not None:
        slopes = [part for at in states for part in point.gradient(*at)]
        integral = ca.MX(0)
        for at, share in zip(states, SIMPSON, strict=True):
            integral += share * z[-1] * stage.cost(*at)
        cost = ca.Function("cost", inputs, [integral])
        gradient = ca.Function("gradient", inputs, list(chain.gradient(z, *slopes)))
    return ElementFunctions(
        ca.Function("rows", inputs, [ca.vertcat(*(stage.point(*at) for at in states))]),
        ca.Function("jacobian", inputs, [chain.jacobian(z, *jacobians)]),
        ca.Function("hessian", [*inputs, lam], [chain.hessian(z, lam_cost, *bends)]),
        cost,
        gradient,
    )


@dataclass(frozen=True, eq=False)
class _Point:
    """Functions of (state, *arguments): Jacobian of the rows; cost and its gradient.

    hessian takes λ and κ too: Hessian and gradient of λᵀ rows + κ cost, then cost and its gradient.
    """

    jacobian: ca.Function
    gradient: ca.Function
    hessian: ca.Function

    @classmethod
    def of(cls, stage: ElementModel) -> _Point:
        state = ca.SX.sym("state", stage.point.size1_in(0))
        inputs = [state, *(ca.SX.sym(f"argument{i}", n) for i, (n, _) in enumerate(stage.arguments))]
        # the cost is made of the same torques as the rows: they are to be differentiated once
        values: Any = [stage.point(*inputs), ca.SX(0) if stage.cost is None else stage.cost(*inputs)]
        rows, cost = ca.cse(values)
        lam, kappa = ca.SX.sym("lam", rows.numel()), ca.SX.sym("kappa")
        hessian, gradient = ca.hessian(ca.dot(lam, rows) + kappa * cost, state)
        cost_and_gradient = [cost, ca.gradient(cost, state)]
        return cls(
            ca.Function("point_jacobian", inputs, [ca.jacobian(rows, state)]),
            ca.Function("point_gradient", inputs, cost_and_gradient),
            ca.Function("point_hessian", [*inputs, lam, kappa], [hessian, gradient, *cost_and_gradient]),
        )


@dataclass(frozen=True, eq=False)
class _Chain:
    """What the points' derivatives make of those by z: Functions of z and, point after point, of what `_Point` returns."""

    states: ca.Function
    jacobian: ca.Function
    gradient: ca.Function
    hessian: ca.Function

    @classmethod
    def of(cls, stage: ElementModel, point: _Point) -> _Chain:
        z, lam_cost = ca.SX.sym("z", stage.size), ca.SX.sym("cost_multiplier")
        of_length = ca.gradient(z[-1], z)
        states = stage.states(z)
        jacobians, bends, values = [], [], []
        by_z, hessian, cost, gradient = [], ca.SX(stage.size, stage.size), ca.SX(0), ca.SX.zeros(stage.size)
        for state, share in zip(states, SIMPSON, strict=True):
            slope = ca.jacobian(state, z)
            (jacobian,), (value, value_slope) = _symbols(point.jacobian), _symbols(point.gradient)
            curvature, pull, *_ = _symbols(point.hessian)
            by_z.append(jacobian @ slope)
            along = slope.T @ value_slope
            cost += share * z[-1] * value
            gradient += share * (z[-1] * along + value * of_length)
            cross = share * lam_cost * (of_length @ along.T)
            bend = ca.hessian(ca.dot(pull, state), z)[0]
            hessian += slope.T @ curvature @ slope + bend + cross + cross.T
            jacobians.append(jacobian)
            values += [value, value_slope]
            bends += [curvature, pull, value, value_slope]
        return cls(
            ca.Function("states", [z], states),
            ca.Function("jacobian_by_z", [z, *jacobians], [ca.vertcat(*by_z)]),
            ca.Function("gradient_by_z", [z, *values], [cost, ca.densify(gradient)]),
            ca.Function("hessian_by_z", [z, lam_cost, *bends], [hessian]),
        )


def _symbols(function: ca.Function) -> list[ca.SX]:
    """What a Function returns, as symbols."""
    return [ca.SX.sym(function.name_out(i), function.sparsity_out(i)) for i in range(function.n_out())]
