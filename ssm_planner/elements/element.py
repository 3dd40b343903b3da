"""One element of a mesh: limits and costs as CasADi Functions with exact derivatives.

Symbols, all in scaled time:

    z (4 m + 1,)   one element of m coordinates: u, u̇, ü at its start, ü at its end, its length h
    x (k,)         state at one instant, positions first; x_c is the state at the share c of h
    p              parameters; the first is σ (4,), the direction of every joint: +1, −1 or 0
    g(x, p) ≤ 1    path constraints, one row each
    ℓ(x, p)        integrand of the cost; on the element L(z) = h Σ_c w_c ℓ(x_c) by Simpson's rule
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar, cast

import casadi as ca

from ssm_planner.codegen.vectorised import Layout
from ssm_planner.elements.rows import (
    Instant,
    PathConstraint,
    RowName,
    RowPlace,
    cooling,
    effort,
    heat,
    torque_rows,
)
from ssm_planner.problem import Robot
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import keyword_record, record

COLLOCATION = (0.0, 0.5, 1.0)
"""Shares c of an element at which the path constraints hold.

Both ends are included, because ü may jump there.
"""
SIMPSON = (1 / 6, 4 / 6, 1 / 6)
"""Weights w_c of these points in integrals."""
DENSE = tuple(k / 8 for k in range(9))
"""Shares of an element at which violated constraints are searched between the collocation points.
"""
Aim = Literal["time", "heat", "effort", "cooling"]
"""Cost in addition to time.

"time": none, "heat": heat of all motors, "effort": effort, "cooling": weighted heat of some motors.
"""


X = TypeVar("X", ca.SX, ca.MX)


class Parameter(NamedTuple):
    """Length of a parameter vector, and whether every element has its own values."""

    size: int
    per_element: bool


@keyword_record
class ElementModel(ABC):
    """Limits and costs of one kind of motion on one element.

    A subclass defines its vectors (`coordinates`, `state_size`, `positions`, `parameters`) and the
    mathematics of one instant (`state`, `instant`, `rows`). Robot properties that are constants in
    its expressions belong into its `key`, and every other number is a parameter. This class derives
    the Functions. Models with the same key are equal.
    """

    robot: Robot
    active: frozenset[RowName] | None = None
    """Rows that the Functions contain. None: all."""
    aim: Aim = "time"

    state_size: ClassVar[int]
    """Length k of the state x."""
    positions: ClassVar[int]
    """Number of positions among the entries of x."""
    layout: ClassVar[Layout]
    """Layout of the last parameter."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Sizes of the parameters p."""

    @property
    @abstractmethod
    def key(self) -> tuple[Hashable, ...]:
        """Key of the model. Models with the same key have the same Functions."""

    @property
    @abstractmethod
    def coordinates(self) -> int:
        """Number m of coordinates."""

    @abstractmethod
    def state(self, z: ca.SX, c: float) -> ca.SX:
        """Return the state x_c."""

    @abstractmethod
    def instant(self, x: ca.SX, *p: ca.SX) -> Instant:
        """Return motion and limits of the joints in state x, in SI units."""

    @abstractmethod
    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Return all path constraints in state x."""

    @property
    @abstractmethod
    def all_rows(self) -> list[RowPlace]:
        """Names, joints and indices in native/elements.c of all `rows`, in their order."""

    @property
    @abstractmethod
    def first_actuation(self) -> int:
        """Index of the first torque row in native/elements.c."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ElementModel) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def size(self) -> int:
        """Length of z."""
        return 4 * self.coordinates + 1

    def cubic(self, z: ca.SX) -> Cubic:
        """Return the coordinates on the element z as a cubic, (m,) each."""
        m = self.coordinates
        return Cubic(*ca.vertsplit(z, [0, m, 2 * m, 3 * m, 4 * m, 4 * m + 1]))

    def collocation_states(self, z: ca.SX) -> list[ca.SX]:
        """Return the states at the points COLLOCATION."""
        return [self.state(z, c) for c in COLLOCATION]

    @cached_property
    def row_places(self) -> list[RowPlace]:
        """Names, joints and indices of the active rows, in their order."""
        return [row for row in self.all_rows if self.active is None or row[:2] in self.active]

    @property
    def row_names(self) -> list[RowName]:
        """Name of the limit, and joint, of every active row, in their order."""
        return [(name, joint) for name, joint, _ in self.row_places]

    @cached_property
    def point(self) -> ca.Function:
        """Function (x, *p) → g (rows,)."""
        inputs = self._symbols(self.state_size)
        return ca.Function("point", inputs, [_column(self._active_rows(*inputs))])

    @cached_property
    def cost(self) -> ca.Function | None:
        """Function (x, *p) → ℓ. None if only time counts."""
        if self.aim == "time":
            return None
        x, *p = self._symbols(self.state_size)
        instant, joints = self.instant(x, *p), self.robot.joints
        if self.aim != "effort":
            return ca.Function(
                "cost", [x, *p], [(heat if self.aim == "heat" else cooling)(instant, joints)]
            )
        endlessly_slow = ca.vertcat(
            x[: self.positions], ca.SX.zeros(self.state_size - self.positions)
        )
        return ca.Function(
            "cost", [x, *p], [effort(instant, self.instant(endlessly_slow, *p), joints)]
        )

    @cached_property
    def dense_rows(self) -> ca.Function:
        """Function (z, *p) → g at all points DENSE, one after the other."""
        z, *p = self._symbols(self.size)
        values = [self.point(self.state(z, c), *p) for c in DENSE]
        return ca.Function("between", [z, *p], [ca.vertcat(ca.SX(0, 1), *values)])

    @cached_property
    def breakaway(self) -> ca.Function:
        """Function (z, *p) → torque rows at the start of an element with static friction."""
        z, *p = self._symbols(self.size)
        instant = self.instant(self.state(z, 0.0), *p)
        return ca.Function(
            "breakaway", [z, *p], [_column(torque_rows(instant, self.robot, breakaway=True))]
        )

    @cached_property
    def breakaway_joints(self) -> list[int]:
        """Joint of every row of `breakaway`."""
        return [
            i
            for i in range(4)
            for _, _, sides in self.robot.actuations(i)
            for _ in range(2 * (1 in sides) + (-1 in sides))
        ]

    def parameter_symbols(self, symbol_class: type[X]) -> list[X]:
        """Return the parameters p as symbols of the given class, SX or MX."""
        return [
            symbol_class.sym(f"p{i}", parameter.size) for i, parameter in enumerate(self.parameters)
        ]

    def _active_rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Return the active path constraints in state x."""
        return [
            row
            for row in self.rows(x, *p)
            if self.active is None or (row.name, row.joint) in self.active
        ]

    def _symbols(self, size: int) -> list[ca.SX]:
        """Return symbols of a vector and of all parameters."""
        return [ca.SX.sym("x", size), *self.parameter_symbols(ca.SX)]


E = TypeVar("E", bound=ElementModel)


def shared(element: E) -> E:
    """Return the equal model that was used last, so that its Functions are built once."""
    return cast(E, _recent(element))


@lru_cache(maxsize=32)
def _recent(element: ElementModel) -> ElementModel:
    """Return the model itself. The cache returns the first of several equal models."""
    return element


def _column(rows: list[PathConstraint]) -> ca.SX:
    """Return the values of path constraints as a column."""
    return ca.vertcat(ca.SX(0, 1), *(row.value for row in rows))


@record
class ElementFunctions:
    """Functions of (z, *p) that are evaluated on every element, with r rows at 3 points.

    `rows` gives G = [g(x_c)]_c (3 r,) and `jacobian` ∂G/∂z (3 r, 4 m + 1). With a cost, `cost`
    gives L, and `gradient` gives L and ∇L. `hessian` also takes the multipliers λ (3 r,), followed
    by κ with a cost, and gives ∇²(λᵀ G + κ L).
    """

    rows: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    cost: ca.Function | None
    gradient: ca.Function | None


@lru_cache(maxsize=24)
def element_functions(element: ElementModel) -> ElementFunctions:
    """Return exact derivatives of an element by the chain rule through the state at each point.

    With X_c = ∂x_c/∂z (k, 4 m + 1), the unit vector e_h of h, and the Lagrangian φ_c(x) = λ_cᵀ g(x)
    + κ w_c h ℓ(x) of the point c,

        ∂G/∂z         = [∂g/∂x(x_c) X_c]_c
        ∇L            = Σ_c w_c (h X_cᵀ ∇ℓ + ℓ e_h)
        ∇²(λᵀG + κL)  = Σ_c X_cᵀ ∇²φ_c X_c + Σ_i (∂φ_c/∂x_i) ∇²x_c,i
                        + κ w_c (e_h (X_cᵀ ∇ℓ)ᵀ + (X_cᵀ ∇ℓ) e_hᵀ).

    The derivatives with respect to x are taken once, with few variables, and called at every point
    (`_point_derivatives`). The code that is evaluated repeatedly thus stays in the processor's
    cache. x_c(z) is a polynomial with cheap derivatives (`_chain_rule`).
    """
    by_x = _point_derivatives(element)
    states, jacobian_by_z, gradient_by_z, hessian_by_z = _chain_rule(element, *by_x)
    jacobian, gradient_by_x, hessian = by_x
    z = ca.MX.sym("z", element.size)
    p = element.parameter_symbols(ca.MX)
    inputs = [z, *p]
    points = [(x, *p) for x in states(z)]
    r, h = element.point.size1_out(0), z[-1]
    multipliers = ca.MX.sym("multipliers", r * len(points) + (element.cost is not None))
    kappa = multipliers[-1] if element.cost is not None else ca.MX(0)

    rows = [element.point(*point) for point in points]
    jacobians = [jacobian(*point) for point in points]
    curvatures: list[ca.MX] = []
    for c, (point, w) in enumerate(zip(points, SIMPSON, strict=True)):
        curvatures += hessian(*point, multipliers[c * r : (c + 1) * r], w * h * kappa)
    cost = gradient = None
    if element.cost is not None:
        integral = ca.MX(0)
        for point, w in zip(points, SIMPSON, strict=True):
            integral += w * h * element.cost(*point)
        slopes = [value for point in points for value in gradient_by_x(*point)]
        cost = ca.Function("cost", inputs, [integral])
        gradient = ca.Function("gradient", inputs, list(gradient_by_z(z, *slopes)))
    return ElementFunctions(
        ca.Function("rows", inputs, [ca.vertcat(*rows)]),
        ca.Function("jacobian", inputs, [jacobian_by_z(z, *jacobians)]),
        ca.Function("hessian", [*inputs, multipliers], [hessian_by_z(z, kappa, *curvatures)]),
        cost,
        gradient,
    )


def _point_derivatives(element: ElementModel) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return three Functions of (x, *p): ∂g/∂x (r, k); ℓ and ∇ℓ (k,); and second derivatives.

    The last one also takes λ_c (r,) and a factor f, and returns ∇²φ (k, k) and ∇φ (k,) of φ = λ_cᵀ
    g + f ℓ, then ℓ and ∇ℓ.
    """
    x = ca.SX.sym("x", element.state_size)
    inputs = [x, *element.parameter_symbols(ca.SX)]
    # The cost consists of the same torques as the rows, which should be differentiated once.
    values: Any = [
        element.point(*inputs),
        ca.SX(0) if element.cost is None else element.cost(*inputs),
    ]
    g, cost = ca.cse(values)
    lam, factor = ca.SX.sym("lam", g.numel()), ca.SX.sym("factor")
    hessian, gradient = ca.hessian(ca.dot(lam, g) + factor * cost, x)
    cost_and_gradient = [cost, ca.gradient(cost, x)]
    return (
        ca.Function("point_jacobian", inputs, [ca.jacobian(g, x)]),
        ca.Function("point_gradient", inputs, cost_and_gradient),
        ca.Function(
            "point_hessian", [*inputs, lam, factor], [hessian, gradient, *cost_and_gradient]
        ),
    )


def _chain_rule(
    element: ElementModel, *point: ca.Function
) -> tuple[ca.Function, ca.Function, ca.Function, ca.Function]:
    """Return Functions that turn derivatives with respect to x_c into those with respect to z.

    They give the states x_c of z, ∂G/∂z, (L, ∇L) and ∇²(λᵀG + κL). Their arguments are z, for the
    last one also κ, and the results of `_point_derivatives` (point), point after point.
    """
    z, kappa = ca.SX.sym("z", element.size), ca.SX.sym("kappa")
    h, e_h = z[-1], ca.gradient(z[-1], z)
    states = element.collocation_states(z)
    inputs: tuple[list[ca.SX], ...] = ([z], [z], [z, kappa])
    jacobian, cost, gradient, hessian = (
        [],
        ca.SX(0),
        ca.SX.zeros(z.numel()),
        ca.SX(z.numel(), z.numel()),
    )
    for x, w in zip(states, SIMPSON, strict=True):
        of_z = ca.jacobian(x, z)
        (g_of_x,), (value, cost_of_x), (phi_of_xx, phi_of_x, *_) = symbols = [
            *map(_result_symbols, point)
        ]
        jacobian.append(g_of_x @ of_z)
        cost_of_z = of_z.T @ cost_of_x
        cost += w * h * value
        gradient += w * (h * cost_of_z + value * e_h)
        through_length = w * kappa * (e_h @ cost_of_z.T)
        through_state = ca.hessian(ca.dot(phi_of_x, x), z)[0]
        hessian += of_z.T @ phi_of_xx @ of_z + through_state + through_length + through_length.T
        symbols[2][2:] = symbols[1]
        for collected, symbol_list in zip(inputs, symbols, strict=True):
            collected += symbol_list
    return (
        ca.Function("states", [z], states),
        ca.Function("jacobian_by_z", inputs[0], [ca.vertcat(*jacobian)]),
        ca.Function("gradient_by_z", inputs[1], [cost, ca.densify(gradient)]),
        ca.Function("hessian_by_z", inputs[2], [hessian]),
    )


def _result_symbols(function: ca.Function) -> list[ca.SX]:
    """Return the results of a Function as symbols of the same sparsity."""
    return [
        ca.SX.sym(function.name_out(i), function.sparsity_out(i)) for i in range(function.n_out())
    ]
