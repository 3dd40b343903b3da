"""One element of a mesh: limits and costs as CasADi Functions with exact derivatives.

An element is an interval of time in which the motion is a cubic. All symbols are in scaled time:

    z (4 m + 1,)   one element of m coordinates: u, u̇, ü at its start, ü at its end, its length h
    x (k,)         state at one instant, positions first
    x_c            the state at the fraction c of the length h
    p              parameters; the first is σ (4,), the direction of every joint: +1, −1 or 0
    g(x, p) ≤ 1    path constraints, one row each
    ℓ(x, p)        integrand of the cost; on the element L(z) = h Σ_c w_c ℓ(x_c) by Simpson's rule
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable
from functools import cached_property, lru_cache
from typing import ClassVar, Literal, NamedTuple, TypeVar, cast

import casadi as ca

from ssm_planner.codegen import Layout
from ssm_planner.elements.rows import (
    IndexedRow,
    Instant,
    PathConstraint,
    RowName,
    cooling_cost,
    effort_cost,
    heat_cost,
    torque_rows,
)
from ssm_planner.problem import Robot
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import keyword_record, record

COLLOCATION_POINTS = (0.0, 0.5, 1.0)
"""Fractions c of an element at which the path constraints hold.

Both ends are included, because ü may jump there.
"""
SIMPSON_WEIGHTS = (1 / 6, 4 / 6, 1 / 6)
"""Weights w_c of these points in integrals (Simpson's rule)."""
DENSE_POINTS = tuple(k / 8 for k in range(9))
"""Fractions of an element at which the refinement searches violated constraints.

They also lie between the collocation points.
"""
Aim = Literal["time", "heat", "effort", "cooling"]
"""Cost in addition to time.

"time" adds nothing, "heat" the heat of all motors, "effort" their effort, and "cooling" the
weighted heat of some motors.
"""


X = TypeVar("X", ca.SX, ca.MX)


class Parameter(NamedTuple):
    """A parameter vector of an element model.

    Attributes
    ----------
    size : int
        Its length.
    per_element : bool
        True if every element has its own values.
    """

    size: int
    per_element: bool


@keyword_record
class ElementModel(ABC):
    """Limits and costs of one kind of motion on one element.

    A subclass defines its vectors (`coordinates`, `state_size`, `positions`, `parameters`) and the
    mathematics of one instant (`state`, `instant`, `rows`). Its `key` contains all properties of
    the robot that are constants in its expressions. Every other number is a parameter. This class
    derives the Functions of CasADi. Models with the same key are equal.

    Attributes
    ----------
    robot : Robot
        The robot. Its `corners` are the extremes of a range of friction, if there is one.
    """

    robot: Robot
    active: frozenset[RowName] | None = None
    """Rows that the Functions contain. None selects all rows."""
    aim: Aim = "time"
    """Cost in addition to time."""

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
        """Return the state x_c (k,) at the fraction c of the element z (4 m + 1,)."""

    @abstractmethod
    def instant(self, x: ca.SX, *p: ca.SX) -> Instant:
        """Return the motion and the limits of the joints in state x (k,), in SI units."""

    @abstractmethod
    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Return all path constraints in state x (k,)."""

    @property
    @abstractmethod
    def all_indexed_rows(self) -> list[IndexedRow]:
        """Name, joint and index in native/elements.c of each of `rows`, in their order."""

    @property
    @abstractmethod
    def first_actuation(self) -> int:
        """Index of the first torque row in native/elements.c."""

    def __eq__(self, other: object) -> bool:
        """Return True if both models have the same Functions."""
        return isinstance(other, ElementModel) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def size(self) -> int:
        """Length of z."""
        return 4 * self.coordinates + 1

    def cubic(self, z: ca.SX) -> Cubic:
        """Return the coordinates on the element z as a cubic with coefficients (m,)."""
        m = self.coordinates
        return Cubic(*ca.vertsplit(z, [0, m, 2 * m, 3 * m, 4 * m, 4 * m + 1]))

    def collocation_states(self, z: ca.SX) -> list[ca.SX]:
        """Return the states x_c (k,) at the points `COLLOCATION_POINTS`."""
        return [self.state(z, c) for c in COLLOCATION_POINTS]

    @cached_property
    def indexed_rows(self) -> list[IndexedRow]:
        """Name, joint and index of each active row, in their order."""
        return [
            row for row in self.all_indexed_rows if self.active is None or row[:2] in self.active
        ]

    @property
    def row_names(self) -> list[RowName]:
        """Name of the limit, and joint, of each active row, in their order."""
        return [(name, joint) for name, joint, _ in self.indexed_rows]

    @cached_property
    def point(self) -> ca.Function:
        """Function (x, *p) → g (rows,) of the active rows."""
        inputs = self._symbols(self.state_size)
        return ca.Function("point", inputs, [_row_values(self._active_rows(*inputs))])

    @cached_property
    def cost(self) -> ca.Function | None:
        """Function (x, *p) → ℓ. None if only time counts.

        The effort compares the state x with the same positions at infinitely low speed.
        """
        if self.aim == "time":
            return None
        inputs = self._symbols(self.state_size)
        x, p = inputs[0], inputs[1:]
        instant = self.instant(x, *p)
        joints = self.robot.joints
        if self.aim == "effort":
            derivatives = ca.SX.zeros(self.state_size - self.positions)
            infinitely_slow = ca.vertcat(x[: self.positions], derivatives)
            value = effort_cost(instant, self.instant(infinitely_slow, *p), joints)
        elif self.aim == "heat":
            value = heat_cost(instant, joints)
        else:
            value = cooling_cost(instant, joints)
        return ca.Function("cost", inputs, [value])

    @cached_property
    def dense_rows(self) -> ca.Function:
        """Function (z, *p) → g at all points `DENSE_POINTS`, one after the other, (9 rows,)."""
        inputs = self._symbols(self.size)
        z, p = inputs[0], inputs[1:]
        values = [self.point(self.state(z, c), *p) for c in DENSE_POINTS]
        return ca.Function("between", inputs, [ca.vertcat(ca.SX(0, 1), *values)])

    @cached_property
    def breakaway(self) -> ca.Function:
        """Function (z, *p) → torque rows at the start of an element with static friction."""
        inputs = self._symbols(self.size)
        z, p = inputs[0], inputs[1:]
        instant = self.instant(self.state(z, 0.0), *p)
        rows = torque_rows(instant, self.robot, breakaway=True)
        return ca.Function("breakaway", inputs, [_row_values(rows)])

    @cached_property
    def breakaway_joints(self) -> list[int]:
        """Index of the joint for every row of `breakaway`."""
        joints = []
        for i in range(4):
            for _, _, sides in self.robot.actuations(i):
                if 1 in sides:  # A driving motor has two rows.
                    joints += [i, i]
                if -1 in sides:  # A braking motor has one row.
                    joints.append(i)
        return joints

    def parameter_symbols(self, symbol_class: type[X]) -> list[X]:
        """Return the parameters p as symbols of the given class, SX or MX."""
        return [
            symbol_class.sym(f"p{i}", parameter.size) for i, parameter in enumerate(self.parameters)
        ]

    def _active_rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Return the path constraints in state x (k,) that the Functions contain."""
        return [
            row
            for row in self.rows(x, *p)
            if self.active is None or (row.name, row.joint) in self.active
        ]

    def _symbols(self, size: int) -> list[ca.SX]:
        """Return symbols of a vector (size,) and of all parameters."""
        return [ca.SX.sym("x", size)] + self.parameter_symbols(ca.SX)


E = TypeVar("E", bound=ElementModel)


def shared_model(element: E) -> E:
    """Return an equal model that was used before, if there is one.

    CasADi then builds the Functions of equal models only once.
    """
    return cast(E, _first_equal_model(element))


@lru_cache(maxsize=32)
def _first_equal_model(element: ElementModel) -> ElementModel:
    """Return the model itself. The cache therefore returns the first of several equal models."""
    return element


def _row_values(rows: list[PathConstraint]) -> ca.SX:
    """Return the values of path constraints as a column (rows,)."""
    values = [row.value for row in rows]
    return ca.vertcat(ca.SX(0, 1), *values)


@record
class ElementFunctions:
    """Functions of (z, *p) that are evaluated on every element.

    With r rows at the 3 points of `COLLOCATION_POINTS`, the results are:

        rows       G = [g(x_c)]_c, (3 r,)
        jacobian   ∂G/∂z, (3 r, 4 m + 1)
        hessian    ∇²(λᵀ G + κ L), (4 m + 1, 4 m + 1); its last argument contains λ (3 r,), and κ if
                   there is a cost
        cost       L
        gradient   L and ∇L (4 m + 1,)

    The last two are None if only time counts.
    """

    rows: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    cost: ca.Function | None
    gradient: ca.Function | None


@lru_cache(maxsize=24)
def element_functions(element: ElementModel) -> ElementFunctions:
    """Return the rows and the cost of an element with their exact derivatives by CasADi.

    With the multipliers λ_c (r,) of the point c, and Simpson's weights w_c, they are

        G(z) = [g(x_c)]_c,   L(z) = h Σ_c w_c ℓ(x_c),   ∇²(Σ_c λ_cᵀ g(x_c) + κ L).

    Parameters
    ----------
    element : ElementModel
        The model. Equal models share their Functions.

    Returns
    -------
    ElementFunctions
    """
    z = ca.SX.sym("z", element.size)
    p = element.parameter_symbols(ca.SX)
    inputs = [z] + p
    states = element.collocation_states(z)
    rows = ca.vertcat(*[element.point(x, *p) for x in states])
    multipliers = ca.SX.sym("multipliers", rows.numel())
    lagrangian = multipliers.T @ rows
    cost = gradient = None
    if element.cost is not None:
        weighted = (w * element.cost(x, *p) for x, w in zip(states, SIMPSON_WEIGHTS, strict=True))
        integral = z[-1] * sum(weighted, start=ca.SX(0))
        kappa = ca.SX.sym("kappa")
        lagrangian += kappa * integral
        multipliers = ca.vertcat(multipliers, kappa)
        cost = ca.Function("cost", inputs, [integral])
        slope = ca.densify(ca.gradient(integral, z))
        gradient = ca.Function("gradient", inputs, [integral, slope])
    hessian = ca.hessian(lagrangian, z)[0]
    return ElementFunctions(
        ca.Function("rows", inputs, [rows]),
        ca.Function("jacobian", inputs, [ca.jacobian(rows, z)]),
        ca.Function("hessian", inputs + [multipliers], [hessian]),
        cost,
        gradient,
    )
