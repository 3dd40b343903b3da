"""Limits and costs of one element of a mesh, as CasADi Functions with exact derivatives.

The mesh divides a motion into intervals of time, called elements. In an element, every coordinate u
is a cubic polynomial of time. `ElementModel` is the base class of two models. The coordinates of
`FreeElement` are joints, and the only coordinate of `StraightElement` is the parameter of a path.
`element_functions` returns the functions that the solvers evaluate. They use these symbols:

    z (4 m + 1,)   one element of m coordinates: u, u̇, ü at its start, ü at its end, its length h
    x (k,)         state at one instant, positions first
    x_c            the state at the fraction c of the length h
    p              parameters; the first is σ (4,), the direction of every joint: +1, −1 or 0
    g(x, p) ≤ 1    path constraints, which are the limits of the motion; each is one row of g
    ℓ(x, p)        integrand of the cost
    L(z)           cost of the element, L = h Σ_c w_c ℓ(x_c) by Simpson's rule with the weights w_c

All of them are in scaled time, which is time divided by a unit of about the duration of the motion.
A program is the optimisation problem on all elements.
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
from ssm_planner.trajectory import CubicPiece
from ssm_planner.typing import keyword_record, record

COLLOCATION_POINTS = (0.0, 0.5, 1.0)
"""Fractions c of an element at which the optimisation problem imposes the path constraints.

Two neighbouring elements both impose them at their common end, because ü may jump there.
"""
SIMPSON_WEIGHTS = (1 / 6, 4 / 6, 1 / 6)
"""Weights w_c of `COLLOCATION_POINTS` in the integral of the cost (Simpson's rule)."""
DENSE_POINTS = tuple(k / 8 for k in range(9))
"""Fractions of an element at which the planner looks for violated constraints after a solve.

They include the collocation points, and three points between each pair of them.
"""
Aim = Literal["time", "heat", "effort", "cooling"]
"""Cost ℓ that is minimised in addition to the duration of a motion.

"time" adds no cost. "heat" adds the heat of all motors (`rows.heat_cost`). "effort" adds the torque
that the speed of the motion needs (`rows.effort_cost`). "cooling" adds the heat of the motors with
one weight for each motor (`rows.cooling_cost`), for problems in which some motors get too hot.
"""


Symbol = TypeVar("Symbol", ca.SX, ca.MX)


class Parameter(NamedTuple):
    """Size of one of the parameter vectors p of an element model."""

    size: int
    """Length of the vector."""
    per_element: bool
    """True if every element has its own values, False if all elements share them."""


@keyword_record
class ElementModel(ABC):
    """Limits and costs of one kind of motion on one element (interval of time) of a mesh.

    A subclass defines the sizes of its vectors (`coordinates`, `state_size`, `position_count`,
    `parameters`) and the mathematics of one instant (`state`, `instant`, `rows`). This class
    derives CasADi Functions from them. Some properties of the robot are constants in these
    Functions. The `key` of a model contains all of them. Every other number is a parameter. Models
    with the same key are equal and share their Functions, which take long to build.
    """

    robot: Robot
    """The robot. If its friction or payload is a range, its `corners` are the extremes."""
    active: frozenset[RowName] | None = None
    """Names and joints of the active rows, that is, the path constraints in the Functions.

    None selects all rows.
    """
    aim: Aim = "time"
    """Cost that is minimised in addition to the duration."""

    state_size: ClassVar[int]
    """Length k of the state x."""
    position_count: ClassVar[int]
    """Number of positions in the state x, which are its first entries."""
    layout: ClassVar[Layout]
    """Names and lengths of the entries of the last parameter vector."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Sizes of the parameter vectors p, in their order."""

    @property
    @abstractmethod
    def key(self) -> tuple[Hashable, ...]:
        """Values that determine the Functions. Models with the same key are equal."""

    @property
    @abstractmethod
    def coordinates(self) -> int:
        """Number m of coordinates."""

    @abstractmethod
    def state(self, z: ca.SX, c: float) -> ca.SX:
        """Build the expression of the state at one instant of an element.

        Parameters
        ----------
        z : (4 m + 1,) casadi.SX
            Vector that describes the element (an interval of time).
        c : float
            Fraction of the length of the element, from 0 to 1.

        Returns
        -------
        (k,) casadi.SX
            State x_c.
        """

    @abstractmethod
    def instant(self, x: ca.SX, *p: ca.SX) -> Instant:
        """Build the expressions of the motion and the limits of the joints in one state.

        Parameters
        ----------
        x : (k,) casadi.SX
            State.
        *p : casadi.SX
            Parameter vectors with the sizes in `parameters`.

        Returns
        -------
        Instant
            Expressions in SI units.
        """

    @abstractmethod
    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Build the path constraints (rows) in one state.

        Parameters
        ----------
        x : (k,) casadi.SX
            State.
        *p : casadi.SX
            Parameter vectors with the sizes in `parameters`.

        Returns
        -------
        list of PathConstraint
            All path constraints, also those that are not active.
        """

    @property
    @abstractmethod
    def all_indexed_rows(self) -> list[IndexedRow]:
        """Name, joint and index of each of `rows`, in their order.

        The index is that of the row in native/elements.c, which numbers all rows that such a model
        can have.
        """

    @property
    @abstractmethod
    def first_actuation(self) -> int:
        """Index of the first row (path constraint) of a torque in native/elements.c."""

    def __eq__(self, other: object) -> bool:
        """Return True if both models have the same key, and thus the same Functions."""
        return isinstance(other, ElementModel) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def size(self) -> int:
        """Length 4 m + 1 of z."""
        return 4 * self.coordinates + 1

    def cubic(self, z: ca.SX) -> CubicPiece:
        """Return the coordinates on an element as a cubic polynomial of time.

        Parameters
        ----------
        z : (4 m + 1,) casadi.SX
            Vector that describes the element (an interval of time).

        Returns
        -------
        CubicPiece
            Polynomial whose coefficients have the shape (m,).
        """
        m = self.coordinates
        return CubicPiece(*ca.vertsplit(z, [0, m, 2 * m, 3 * m, 4 * m, 4 * m + 1]))

    def collocation_states(self, z: ca.SX) -> list[ca.SX]:
        """Build the states at the collocation points of an element.

        These are the `COLLOCATION_POINTS`: start, middle and end.

        Parameters
        ----------
        z : (4 m + 1,) casadi.SX
            Vector that describes the element (an interval of time).

        Returns
        -------
        list of (k,) casadi.SX
            One state x_c for each point.
        """
        return [self.state(z, c) for c in COLLOCATION_POINTS]

    @cached_property
    def indexed_rows(self) -> list[IndexedRow]:
        """Name, joint and index in native/elements.c of each active row (path constraint) of g."""
        return [
            row for row in self.all_indexed_rows if self.active is None or row[:2] in self.active
        ]

    @property
    def row_names(self) -> list[RowName]:
        """Name and joint of each active row (path constraint), in the order of g."""
        return [(name, joint) for name, joint, _ in self.indexed_rows]

    @cached_property
    def point(self) -> ca.Function:
        """Function (x, *p) → g (rows,), the values of the active path constraints in one state."""
        inputs = self._symbols(self.state_size)
        return ca.Function("point", inputs, [_row_values(self._active_rows(*inputs))])

    @cached_property
    def cost(self) -> ca.Function | None:
        """Function (x, *p) → ℓ, the integrand of the cost. None if only time counts.

        x is the state of the joints, and p are the parameter vectors. For the aim "effort", the
        cost compares the motor torques with those of an infinitely slow motion through the same
        positions.
        """
        if self.aim == "time":
            return None
        inputs = self._symbols(self.state_size)
        x, p = inputs[0], inputs[1:]
        instant = self.instant(x, *p)
        joints = self.robot.joints
        if self.aim == "effort":
            # The same positions with velocities and accelerations of 0.
            derivatives = ca.SX.zeros(self.state_size - self.position_count)
            infinitely_slow = ca.vertcat(x[: self.position_count], derivatives)
            value = effort_cost(instant, self.instant(infinitely_slow, *p), joints)
        elif self.aim == "heat":
            value = heat_cost(instant, joints)
        else:
            value = cooling_cost(instant, joints)
        return ca.Function("cost", inputs, [value])

    @cached_property
    def dense_rows(self) -> ca.Function:
        """Function (z, *p) → g at all 9 `DENSE_POINTS`, one point after the other, (9 rows,)."""
        inputs = self._symbols(self.size)
        z, p = inputs[0], inputs[1:]
        values = [self.point(self.state(z, c), *p) for c in DENSE_POINTS]
        return ca.Function("between", inputs, [ca.vertcat(ca.SX(0, 1), *values)])

    @cached_property
    def breakaway(self) -> ca.Function:
        """Function (z, *p) → torque rows at the start of an element, with static friction.

        These rows are the torque limits at the instant at which joints at rest start to move.
        """
        inputs = self._symbols(self.size)
        z, p = inputs[0], inputs[1:]
        instant = self.instant(self.state(z, 0.0), *p)
        rows = torque_rows(instant, self.robot, breakaway=True)
        return ca.Function("breakaway", inputs, [_row_values(rows)])

    @cached_property
    def breakaway_joints(self) -> list[int]:
        """Index of the joint for every row of `breakaway`, in the order of the rows."""
        joints = []
        for i in range(4):
            for _, _, sides in self.robot.actuations(i):
                if 1 in sides:  # A driving motor has two rows.
                    joints += [i, i]
                if -1 in sides:  # A braking motor has one row.
                    joints.append(i)
        return joints

    def parameter_symbols(self, symbol_class: type[Symbol]) -> list[Symbol]:
        """Create symbols of the parameter vectors p.

        Parameters
        ----------
        symbol_class : type
            casadi.SX or casadi.MX.

        Returns
        -------
        list of casadi.SX or casadi.MX
            One symbol for each parameter vector.
        """
        return [
            symbol_class.sym(f"p{i}", parameter.size) for i, parameter in enumerate(self.parameters)
        ]

    def _active_rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Build the active path constraints in one state, which the Functions contain.

        Parameters
        ----------
        x : (k,) casadi.SX
            State.
        *p : casadi.SX
            Parameter vectors.

        Returns
        -------
        list of PathConstraint
            The active constraints, in the order of g.
        """
        return [
            row
            for row in self.rows(x, *p)
            if self.active is None or (row.name, row.joint) in self.active
        ]

    def _symbols(self, size: int) -> list[ca.SX]:
        """Create the symbols of the inputs of a Function.

        Parameters
        ----------
        size : int
            Length of the first input, a state x or a vector z.

        Returns
        -------
        list of casadi.SX
            First input, and parameter vectors p.
        """
        return [ca.SX.sym("x", size)] + self.parameter_symbols(ca.SX)


Model = TypeVar("Model", bound=ElementModel)


def shared_model(element: Model) -> Model:
    """Return the first model that was equal to a given one, so that both share their Functions.

    A model builds its Functions when they are first needed, and keeps them. Equal models would
    build the same Functions. The cache remembers the last 32 models.

    Parameters
    ----------
    element : ElementModel
        A model.

    Returns
    -------
    ElementModel
        The equal model that was created first, or `element` itself.
    """
    return cast(Model, _first_equal_model(element))


@lru_cache(maxsize=32)
def _first_equal_model(element: ElementModel) -> ElementModel:
    """Return the model itself, or an equal model of an earlier call from the cache.

    The cache takes equal models for the same argument. It therefore returns the result of the first
    call, which is the first of these models.
    """
    return element


def _row_values(rows: list[PathConstraint]) -> ca.SX:
    """Stack the values of path constraints in one column.

    Parameters
    ----------
    rows : list of PathConstraint
        The constraints.

    Returns
    -------
    (rows,) casadi.SX
        Their values. The column is empty without constraints.
    """
    values = [row.value for row in rows]
    return ca.vertcat(ca.SX(0, 1), *values)


@record
class ElementFunctions:
    """Functions of (z, *p) that the solvers evaluate on every element, for r active rows.

    The module's docstring explains the symbols.
    """

    rows: ca.Function
    """G = [g(x_c)]_c, the r rows at each of the 3 points of `COLLOCATION_POINTS`, (3 r,)."""
    jacobian: ca.Function
    """∂G/∂z, (3 r, 4 m + 1)."""
    hessian: ca.Function
    """∇²(λᵀ G + κ L) with respect to z, (4 m + 1, 4 m + 1).

    The last argument contains the multipliers λ (3 r,), followed by κ if there is a cost L.
    """
    cost: ca.Function | None
    """L. None if only time counts."""
    gradient: ca.Function | None
    """L, and ∇L (4 m + 1,). None if only time counts."""


@lru_cache(maxsize=24)
def element_functions(element: ElementModel) -> ElementFunctions:
    """Build the CasADi Functions of the rows and the cost of an element, and of their derivatives.

    Parameters
    ----------
    element : ElementModel
        The model. Equal models share their Functions.

    Returns
    -------
    ElementFunctions
        The Functions.

    Notes
    -----
    With the Lagrange multipliers λ_c (r,) of the point c, and Simpson's weights w_c, the Functions
    compute
        G(z) = [g(x_c)]_c,   L(z) = h Σ_c w_c ℓ(x_c),   ∇²(Σ_c λ_cᵀ g(x_c) + κ L).
    """
    z = ca.SX.sym("z", element.size)
    p = element.parameter_symbols(ca.SX)
    inputs = [z] + p
    # G, and its part λᵀ G of the Lagrangian.
    states = element.collocation_states(z)
    rows = ca.vertcat(*[element.point(x, *p) for x in states])
    multipliers = ca.SX.sym("multipliers", rows.numel())
    lagrangian = multipliers.T @ rows
    cost = gradient = None
    if element.cost is not None:
        # The cost L, and its part κ L of the Lagrangian.
        weighted = (w * element.cost(x, *p) for x, w in zip(states, SIMPSON_WEIGHTS, strict=True))
        # The last entry of z is the length h of the element.
        integral = z[-1] * sum(weighted, start=ca.SX(0))
        kappa = ca.SX.sym("kappa")
        lagrangian += kappa * integral
        multipliers = ca.vertcat(multipliers, kappa)
        cost = ca.Function("cost", inputs, [integral])
        cost_gradient = ca.densify(ca.gradient(integral, z))
        gradient = ca.Function("gradient", inputs, [integral, cost_gradient])
    hessian = ca.hessian(lagrangian, z)[0]
    return ElementFunctions(
        ca.Function("rows", inputs, [rows]),
        ca.Function("jacobian", inputs, [ca.jacobian(rows, z)]),
        ca.Function("hessian", inputs + [multipliers], [hessian]),
        cost,
        gradient,
    )
