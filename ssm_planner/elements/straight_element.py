"""Element model of a motion along a given path, whose coordinate is the path parameter s ∈ [0, 1].

The joints follow the path q(s). With primes for derivatives with respect to s,

    q̇ = q' ṡ,   q̈ = q'' ṡ² + q' s̈,   q⃛ = q''' ṡ³ + 3 q'' ṡ s̈ + q' s⃛,
    τ_rigid = A(s) s̈ + B(s) ṡ² + C(s),

where τ_rigid are the joint torques without friction. The functions q', A, B, C and the tool speeds
|J(q) q'| at ṡ = 1 (J: Jacobian) are called curves. An element is an interval of time in which s is
a cubic polynomial of time. On each element, polynomials of degree `FIT_DEGREE` in s replace the
curves, so the optimisation evaluates no kinematics. The polynomials of an element are called its
*fit*, and `planning.ocp.path_fit` computes them.

The state is x = (s, ṡ, s̈, s⃛, ṡ_b) in scaled time. ṡ_b replaces ṡ in the velocity rows, see
`StraightElement.collocation_states`. Every joint keeps its direction within an element, so the
friction law is exact.
"""

from collections.abc import Hashable
from functools import cache, cached_property
from types import SimpleNamespace

import casadi as ca

from ssm_planner.codegen import Layout
from ssm_planner.elements.element import ElementModel, Parameter
from ssm_planner.elements.rows import (
    LIMIT_SIZES,
    ROWS_PER_JOINT,
    IndexedRow,
    Instant,
    PathConstraint,
    indexed_kinematic_rows,
    indexed_torque_rows,
    kinematic_rows,
    robot_key,
    torque_rows,
)
from ssm_planner.kinematics import SPEED_JACOBIANS
from ssm_planner.typing import keyword_record

FIT_DEGREE = 6
"""Degree of the polynomials that replace the curves. native/elements.c is compiled for it."""


@keyword_record
class StraightElement(ElementModel):
    """Path constraints of a robot whose joints follow a given path.

    The parameter vectors are the directions σ (4,) of the joints, the polynomials that approximate
    the path (`fit_layout`), and the limits (`layout`).
    """

    jerk: bool
    """True if the limits of the jerk are path constraints."""

    coordinates = 1
    state_size = 5
    position_count = 1
    layout = Layout(**LIMIT_SIZES, time_scale=1)
    """Names and lengths of the limits, and of the unit of scaled time `time_scale`, s."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sizes of the directions σ, of the polynomials of the path, and of the limits."""
        return (
            Parameter(4, True),
            Parameter(fit_layout(len(self.robot.loads)).size, True),
            Parameter(self.layout.size, False),
        )

    @cached_property
    def key(self) -> tuple[Hashable, ...]:
        """Kind of motion, key of the robot, presence of jerk rows, active rows and cost.

        Models with the same key share their CasADi Functions.
        """
        return "straight", robot_key(self.robot), self.jerk, self.active, self.aim

    def state(self, z: ca.SX, c: float) -> ca.SX:
        """Build the expression of the state at one instant of an element.

        Parameters
        ----------
        z : (5,) casadi.SX
            Vector that describes the element (an interval of time) with one coordinate, the path
            parameter s.
        c : float
            Fraction of the length of the element, from 0 to 1.

        Returns
        -------
        (5,) casadi.SX
            s, ṡ, s̈, s⃛ and ṡ_b. Here ṡ_b is equal to ṡ.
        """
        cubic = self.cubic(z)
        s, speed, acceleration = cubic.evaluate(c)
        return ca.vertcat(s, speed, acceleration, cubic.jerk, speed)

    def collocation_states(self, z: ca.SX) -> list[ca.SX]:
        """Build the states at the collocation points, with Bernstein coefficients of ṡ as ṡ_b.

        The velocity ṡ is a parabola in time within an element. It is nowhere larger than the
        largest of its three Bernstein coefficients. The velocity rows bound these coefficients, so
        that they hold in the whole element. The outer coefficients are ṡ at both ends.

        Parameters
        ----------
        z : (5,) casadi.SX
            Vector that describes the element (an interval of time).

        Returns
        -------
        list of three (5,) casadi.SX
            States at the start, in the middle and at the end.
        """
        start, middle, end = super().collocation_states(z)
        # Entry 4 of a state is ṡ_b.
        middle[4] = self.cubic(z).middle_velocity
        return [start, middle, end]

    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Build the path constraints (rows) in one state.

        Parameters
        ----------
        x : (5,) casadi.SX
            State: s, ṡ, s̈, s⃛ and ṡ_b.
        *p : casadi.SX
            Directions σ (4,) of the joints, polynomials of the path, and limits.

        Returns
        -------
        list of PathConstraint
            Rows of tool speeds and of the joints' velocity, stop, acceleration and jerk, followed
            by torque rows.
        """
        instant = self.instant(x, *p)
        rows = kinematic_rows(instant, self.robot.joints, self.jerk)
        return rows + torque_rows(instant, self.robot)

    @property
    def first_actuation(self) -> int:
        """Index of the first row (path constraint) of a torque in native/elements.c.

        The rows before it are those of the tool speeds and the kinematic rows of four joints.
        """
        return len(SPEED_JACOBIANS) + 4 * ROWS_PER_JOINT

    @cached_property
    def all_indexed_rows(self) -> list[IndexedRow]:
        """Name, joint and index in native/elements.c of each of `rows` (path constraints)."""
        torques = indexed_torque_rows(self.robot, self.first_actuation)
        return indexed_kinematic_rows(self.robot, self.jerk) + torques

    def instant(self, x: ca.SX, *p: ca.SX) -> Instant:
        """Build the expressions of the motion and the limits of the joints in one state.

        The kinematics and the load of the robot follow from the polynomials that replace the path.
        The module's docstring contains the equations.

        Parameters
        ----------
        x : (5,) casadi.SX
            State: s, ṡ, s̈, s⃛ and ṡ_b.
        *p : casadi.SX
            Directions σ (4,) of the joints, polynomials of the path, and limits.

        Returns
        -------
        Instant
            Expressions in SI units.
        """
        sigma, fit_parameters, packed = p
        parameters = self.layout.unpack(packed)
        scale = parameters.time_scale
        speed = x[1] / scale
        acceleration = x[2] / scale**2
        jerk = x[3] / scale**3
        bound_speed = x[4] / scale
        path, ddq, dddq = path_derivatives(fit_parameters, x[0], len(self.robot.loads), self.jerk)
        return Instant(
            qd=path.dq * speed,
            qd_hull=path.dq * bound_speed,
            qdd=ddq * speed**2 + path.dq * acceleration,
            qddd=dddq * speed**3 + 3 * ddq * speed * acceleration + path.dq * jerk,
            tau_rigid=path.inertia * acceleration + path.velocity * speed**2 + path.gravity,
            speeds=path.speeds * bound_speed,
            sigma=sigma,
            limits=parameters,
        )


@cache
def curves_layout(loads: int) -> Layout:
    """Return the names and sizes of the curves, which are functions of the path parameter s.

    Parameters
    ----------
    loads : int
        Number of payloads for which the motion is planned.

    Returns
    -------
    Layout
        q' (`dq`), A (`inertia`), B (`velocity`) and C (`gravity`) of the four joints, and the tool
        speeds at ṡ = 1 (`speeds`). The module's docstring defines them. A, B and C occur once for
        each payload.
    """
    return Layout(
        dq=4, inertia=4 * loads, velocity=4 * loads, gravity=4 * loads, speeds=len(SPEED_JACOBIANS)
    )


@cache
def fit_layout(loads: int) -> Layout:
    """Return the names and sizes of the numbers that describe the polynomials of one element.

    The polynomials (the *fit*) replace the curves on an interval of s. They are polynomials of
    ξ = (s − centre)/half_width, which runs from −1 to 1 on the interval.

    Parameters
    ----------
    loads : int
        Number of payloads for which the motion is planned.

    Returns
    -------
    Layout
        `centre` and `half_width` of the interval, and `coefficients`. The latter contain the
        coefficients of ξ⁰ for all curves in the order of `curves_layout`, then those of ξ¹, and so
        on.
    """
    return Layout(centre=1, half_width=1, coefficients=(FIT_DEGREE + 1) * curves_layout(loads).size)


def path_derivatives(
    parameters: ca.SX, s: ca.SX, loads: int, jerk: bool
) -> tuple[SimpleNamespace, ca.SX, ca.SX]:
    """Evaluate the polynomials that replace a path, and the derivatives q'' and q'''.

    Parameters
    ----------
    parameters : (size,) casadi.SX
        The polynomials, in the order of `fit_layout`.
    s : casadi.SX
        Path parameter.
    loads : int
        Number of payloads for which the motion is planned.
    jerk : bool
        True if q''' is evaluated. Otherwise it is 0.

    Returns
    -------
    curves : SimpleNamespace
        Values of the curves by their names in `curves_layout`.
    ddq, dddq : (4,) casadi.SX
        q'' and q'''.
    """
    fit = fit_layout(loads).unpack(parameters)
    curves = curves_layout(loads)
    xi = (s - fit.centre) / fit.half_width
    coefficients = ca.reshape(fit.coefficients, curves.size, FIT_DEGREE + 1)
    dq_derivative = _differentiate_polynomials(coefficients[curves.slices["dq"], :])
    # The divisor converts a derivative with respect to ξ to one with respect to s.
    ddq = _evaluate_polynomials(dq_derivative, xi) / fit.half_width
    dddq = ca.SX.zeros(4)
    if jerk:
        dddq = (
            _evaluate_polynomials(_differentiate_polynomials(dq_derivative), xi) / fit.half_width**2
        )
    return curves.unpack(_evaluate_polynomials(coefficients, xi)), ddq, dddq


def _evaluate_polynomials(coefficients: ca.SX, xi: ca.SX) -> ca.SX:
    """Evaluate several polynomials at the same argument ξ by Horner's rule.

    Parameters
    ----------
    coefficients : (curves, powers) casadi.SX
        Coefficients of ξ⁰, ξ¹, … of each polynomial.
    xi : casadi.SX
        Argument ξ.

    Returns
    -------
    (curves,) casadi.SX
        Values of the polynomials.
    """
    value = coefficients[:, -1]
    for k in range(coefficients.size2() - 2, -1, -1):
        value = value * xi + coefficients[:, k]
    return value


def _differentiate_polynomials(coefficients: ca.SX) -> ca.SX:
    """Compute the coefficients of the derivatives of several polynomials.

    Parameters
    ----------
    coefficients : (curves, powers) casadi.SX
        Coefficients of ξ⁰, ξ¹, … of each polynomial.

    Returns
    -------
    (curves, powers − 1) casadi.SX
        Coefficients of the derivatives with respect to ξ.
    """
    return ca.horzcat(*[k * coefficients[:, k] for k in range(1, coefficients.size2())])
