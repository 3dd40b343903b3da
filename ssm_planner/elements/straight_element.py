"""Element model of a motion along a path: the coordinate is the path parameter s ∈ [0, 1].

The state is x = (s, ṡ, s̈, s⃛, ṡ_b) in scaled time. In the velocity rows, ṡ_b replaces ṡ. The
joints follow the path q(s), with primes for derivatives with respect to s:

    q̇ = q' ṡ,   q̈ = q'' ṡ² + q' s̈,   q⃛ = q''' ṡ³ + 3 q'' ṡ s̈ + q' s⃛,
    τ_rigid = A(s) s̈ + B(s) ṡ² + C(s)

The functions q', A, B, C and the tool speeds |J(q) q'| are smooth. On one element, they are
replaced by polynomials of degree `FIT_DEGREE` (a *fit*), so the optimisation evaluates no
kinematics.

Every joint keeps its direction within an element, so the friction law is exact.
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
from ssm_planner.kinematics import JACOBIANS
from ssm_planner.typing import keyword_record

FIT_DEGREE = 6
"""Degree of the polynomials in a fit."""


@keyword_record
class StraightElement(ElementModel):
    """Path constraints of a robot along any path.

    Its parameters are σ (4,), the fit of the path (`fit_layout`), and the limits (`layout`).

    Attributes
    ----------
    jerk : bool
        Include the rows of the jerk.
    """

    jerk: bool

    coordinates = 1
    state_size = 5
    positions = 1
    layout = Layout(**LIMIT_SIZES, time_scale=1)
    """Layout of the limits, and of the length of a scaled second, s."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sizes of σ, of the fit and of the limits."""
        return (
            Parameter(4, True),
            Parameter(fit_layout(len(self.robot.loads)).size, True),
            Parameter(self.layout.size, False),
        )

    @cached_property
    def key(self) -> tuple[Hashable, ...]:
        """Key of the kind of motion, the robot, the rows and the cost."""
        return "straight", robot_key(self.robot), self.jerk, self.active, self.aim

    def state(self, z: ca.SX, c: float) -> ca.SX:
        """Return s, ṡ, s̈, s⃛ and ṡ at the fraction c of an element, (5,)."""
        cubic = self.cubic(z)
        s, speed, acceleration = cubic.evaluate(c)
        return ca.vertcat(s, speed, acceleration, cubic.jerk, speed)

    def collocation_states(self, z: ca.SX) -> list[ca.SX]:
        """Return the collocation states with the Bernstein coefficients of ṡ as ṡ_b.

        The velocity ṡ is a parabola within an element. If its three Bernstein coefficients keep a
        bound, ṡ keeps it on the whole element.
        """
        start, middle, end = super().collocation_states(z)
        middle[4] = self.cubic(z).middle_velocity
        return [start, middle, end]

    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Return the kinematic rows and the torque rows."""
        instant = self.instant(x, *p)
        rows = kinematic_rows(instant, self.robot.joints, self.jerk)
        return rows + torque_rows(instant, self.robot)

    @property
    def first_actuation(self) -> int:
        """Index of the first torque row, after the rows of speeds and joints."""
        return len(JACOBIANS) + 4 * ROWS_PER_JOINT

    @cached_property
    def all_indexed_rows(self) -> list[IndexedRow]:
        """Name, joint and index of each row, in the order of `rows`."""
        torques = indexed_torque_rows(self.robot, self.first_actuation)
        return indexed_kinematic_rows(self.robot, self.jerk) + torques

    def instant(self, x: ca.SX, *p: ca.SX) -> Instant:
        """Return the motion and the limits of the joints from the fit of the path."""
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
    """Return the layout of the quantities that a fit contains.

    These are q', A, B and C of the four joints, and the tool speeds at ṡ = 1. A, B and C occur once
    for each of the `loads` payloads.
    """
    return Layout(
        dq=4, inertia=4 * loads, velocity=4 * loads, gravity=4 * loads, speeds=len(JACOBIANS)
    )


@cache
def fit_layout(loads: int) -> Layout:
    """Return the layout of a fit on [centre − half_width, centre + half_width] in s.

    It contains the coefficients of `curves_layout` with respect to ξ⁰, ξ¹, …, with
    ξ = (s − centre)/half_width.
    """
    return Layout(centre=1, half_width=1, coefficients=(FIT_DEGREE + 1) * curves_layout(loads).size)


def path_derivatives(
    parameters: ca.SX, s: ca.SX, loads: int, jerk: bool
) -> tuple[SimpleNamespace, ca.SX, ca.SX]:
    """Evaluate a fit at s.

    Parameters
    ----------
    parameters : casadi.SX, (size,)
        Values of `fit_layout`.
    s : casadi.SX
        Path parameter.
    loads : int
        Number of payloads.
    jerk : bool
        Evaluate q''' as well. Otherwise it is 0.

    Returns
    -------
    curves : SimpleNamespace
        The quantities of `curves_layout`.
    ddq, dddq : casadi.SX, (4,)
        q'' and q'''.
    """
    fit = fit_layout(loads).unpack(parameters)
    curves = curves_layout(loads)
    xi = (s - fit.centre) / fit.half_width
    coefficients = ca.reshape(fit.coefficients, curves.size, FIT_DEGREE + 1)
    slope = _differentiate_polynomials(coefficients[curves.slices["dq"], :])
    ddq = _evaluate_polynomials(slope, xi) / fit.half_width
    dddq = ca.SX.zeros(4)
    if jerk:
        dddq = _evaluate_polynomials(_differentiate_polynomials(slope), xi) / fit.half_width**2
    return curves.unpack(_evaluate_polynomials(coefficients, xi)), ddq, dddq


def _evaluate_polynomials(coefficients: ca.SX, xi: ca.SX) -> ca.SX:
    """Evaluate polynomials at xi by Horner's rule.

    Parameters
    ----------
    coefficients : casadi.SX, (curves, powers)
        Coefficients of xi⁰, xi¹, …
    xi : casadi.SX
        Points at which the polynomials are evaluated.

    Returns
    -------
    casadi.SX, (curves,)
    """
    value = coefficients[:, -1]
    for k in range(coefficients.size2() - 2, -1, -1):
        value = value * xi + coefficients[:, k]
    return value


def _differentiate_polynomials(coefficients: ca.SX) -> ca.SX:
    """Return the coefficients (curves, powers − 1) of the derivatives of polynomials."""
    return ca.horzcat(*[k * coefficients[:, k] for k in range(1, coefficients.size2())])
