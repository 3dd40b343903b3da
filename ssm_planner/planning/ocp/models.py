"""The two element models: timing along a path, and joints of a free motion.

Straight: the coordinate is the path parameter s ∈ [0, 1]. The state is x = (s, ṡ, s̈, s⃛, ṡ_b) in
scaled time, where ṡ_b replaces ṡ in the velocity rows. The joints follow the path q(s), with primes
for derivatives with respect to s:

    q̇ = q' ṡ,   q̈ = q'' ṡ² + q' s̈,   q⃛ = q''' ṡ³ + 3 q'' ṡ s̈ + q' s⃛,
    τ_rigid = A(s) s̈ + B(s) ṡ² + C(s)

q', A, B, C and the tool speeds |J(q) q'| are smooth. On the short stretch of one element, a
polynomial through Chebyshev points represents them to many digits, so the optimisation evaluates no
kinematics. A fit is renewed if a solution has left its range.

Free: the coordinates are those of the moving joints, u = (q − q0) / d with d > 0. The state is x =
(u, u̇, ü) of all four joints, (12,), in scaled time.

In both models every joint keeps its direction within an element, so the friction law is exact.
"""

from __future__ import annotations

import pickle
from collections.abc import Hashable
from functools import cache, cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.namespace import casadi_namespace
from ssm_planner.codegen.vectorised import Layout
from ssm_planner.dynamics import RigidBody
from ssm_planner.kinematics import (
    JACOBIANS,
    Mechanism,
    eye_rows,
    task_from_joints_symbolic,
    task_rates_symbolic,
    tip_position_symbolic,
    tool_speed,
)
from ssm_planner.planning.ocp.constraints import (
    JOINT_ROWS,
    LIMITS,
    Instant,
    PathConstraint,
    RowPlace,
    joint_places,
    kinematic_rows,
    robot_key,
    speed_rows,
    torque_places,
    torque_rows,
)
from ssm_planner.planning.ocp.element import ElementModel, Parameter
from ssm_planner.planning.retiming.paths import JointPath
from ssm_planner.problem import TASK, Eye, LensClearance, RetinaClearance, TaskRange, TaskRate
from ssm_planner.typing import Array, keyword_record

DEGREE = 6
"""Degree of the polynomials."""
NARROWEST = 0.004
"""Smallest half width of a fit in s. It leaves room for the optimisation to move an element."""
WIDER = 2.0
"""Largest ratio of the width of a fit to that of a new one."""
WATCHED = ("roll", "spin")
"""Task coordinates that may leave their range between two points inside it.

Tilt and depth depend on one joint each.
"""
RATED = ("roll", "tilt", "spin")
"""Task coordinates whose rate is not proportional to that of one joint."""


@keyword_record
class StraightElement(ElementModel):
    """Path constraints of a robot along any path, with p = (σ (4,), `fit_of`, layout).

    `jerk` selects the jerk rows.
    """

    jerk: bool

    coordinates = 1
    state_size = 5
    positions = 1
    layout = Layout(**LIMITS, time_scale=1)
    """Limits, and the length of a scaled second, s."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sizes of σ, of the fit and of the limits."""
        return (
            Parameter(4, True),
            Parameter(fit_of(len(self.robot.loads)).size, True),
            Parameter(self.layout.size, False),
        )

    @cached_property
    def key(self) -> tuple[Hashable, ...]:
        return "straight", robot_key(self.robot), self.jerk, self.active, self.aim

    def state(self, z: ca.SX, c: float) -> ca.SX:
        """Return s, ṡ, s̈, s⃛ and ṡ at the share c of an element."""
        cubic = self.cubic(z)
        s, speed, acceleration = cubic.evaluate(c)
        return ca.vertcat(s, speed, acceleration, cubic.jerk, speed)

    def collocation_states(self, z: ca.SX) -> list[ca.SX]:
        """Return the collocation states with the Bernstein coefficients of ṡ as ṡ_b.

        If they keep a bound, ṡ keeps it on the whole element.
        """
        start, middle, end = super().collocation_states(z)
        middle[4] = self.cubic(z).middle_velocity
        return [start, middle, end]

    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Return the kinematic rows and the torque rows."""
        instant = self.instant(x, *p)
        return [
            *kinematic_rows(instant, self.robot.joints, self.jerk),
            *torque_rows(instant, self.robot),
        ]

    @property
    def first_actuation(self) -> int:
        return len(JACOBIANS) + 4 * JOINT_ROWS

    @cached_property
    def all_rows(self) -> list[RowPlace]:
        return [
            *joint_places(self.robot, self.jerk),
            *torque_places(self.robot, self.first_actuation),
        ]

    def instant(self, x: ca.SX, *p: ca.SX) -> Instant:
        """Return motion and limits of the joints from the fits of the path."""
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
def curves_of(loads: int) -> Layout:
    """Return the layout of the fitted quantities.

    These are q', A, B and C of the joints with every load, and the tool speeds at ṡ = 1.
    """
    return Layout(
        dq=4, inertia=4 * loads, velocity=4 * loads, gravity=4 * loads, speeds=len(JACOBIANS)
    )


@cache
def fit_of(loads: int) -> Layout:
    """Return the layout of a fit on [centre ± half_width] in s.

    It contains the coefficients of `curves_of` with respect to ξ⁰, ξ¹, …, where ξ = (s − centre) /
    half_width.
    """
    return Layout(centre=1, half_width=1, coefficients=(DEGREE + 1) * curves_of(loads).size)


def path_derivatives(
    parameters: ca.SX, s: ca.SX, loads: int, jerk: bool
) -> tuple[SimpleNamespace, ca.SX, ca.SX]:
    """Evaluate a fit at s: `curves_of`, q'' (4,) and q''' (4,), which is 0 without `jerk`."""
    fit_ = fit_of(loads).unpack(parameters)
    curves = curves_of(loads)
    xi = (s - fit_.centre) / fit_.half_width
    coefficients = ca.reshape(fit_.coefficients, curves.size, DEGREE + 1)
    slope = _derivative(coefficients[curves.slices["dq"], :])
    second_derivative = _horner(slope, xi) / fit_.half_width
    third_derivative = (
        _horner(_derivative(slope), xi) / fit_.half_width**2 if jerk else ca.SX.zeros(4)
    )
    return curves.unpack(_horner(coefficients, xi)), second_derivative, third_derivative


def fit(path: JointPath, bodies: tuple[RigidBody, ...], low: Array, high: Array) -> Array:
    """Fit polynomials to the curves of a path on the elements [low, high], (n,) each, in s.

    The curves are the derivatives of the joints, the coefficients of the dynamics and the speeds of
    the tool. Returns one row for each element, (n, size of `fit_of`): centre and half width of the
    fitted interval, and the coefficients. The interval reaches beyond the element by half its
    width, but stays on the smooth piece of the path.
    """
    middle, breaks = (low + high) / 2, path.breaks
    index = np.clip(np.searchsorted(breaks, middle) - 1, 0, len(breaks) - 2)
    low_break, high_break = breaks[index], breaks[index + 1]
    half_width = np.minimum(np.maximum(high - low, NARROWEST), (high_break - low_break) / 2)
    centre = np.clip(middle, low_break + half_width, high_break - half_width)
    chebyshev, inverse = _nodes()
    samples = path.sample((centre[:, None] + half_width[:, None] * chebyshev).ravel())
    load = zip(
        *(body.path_load(samples.q, samples.dq, samples.ddq) for body in bodies), strict=True
    )
    speeds = np.column_stack(
        [
            tool_speed(speed_class, path.mechanism, samples.q, samples.dq)
            for speed_class in JACOBIANS
        ]
    )
    curves = np.hstack([samples.dq, *(matrix for matrices in load for matrix in matrices), speeds])
    # Node j of element n has the values Σ_d ξ_j^d a_nd.
    coefficients = np.einsum(
        "dj,njk->ndk", inverse, np.ascontiguousarray(curves).reshape(len(low), DEGREE + 1, -1)
    )
    return np.hstack([centre[:, None], half_width[:, None], coefficients.reshape(len(low), -1)])


@cache
def _nodes() -> tuple[Array, Array]:
    """Return the nodes ξ_j (DEGREE + 1,) of a fit, and the inverse of their powers ξ_j^d."""
    chebyshev = np.cos(np.pi * (2 * np.arange(DEGREE + 1) + 1) / (2 * (DEGREE + 1)))
    return chebyshev, np.linalg.inv(np.vander(chebyshev, increasing=True))


def fits_hold(parameters: Array, low: Array, high: Array) -> Array:
    """Return whether fits are valid on [low, high] (n,), and not much too wide, (n,)."""
    centre, half_width = parameters[:, 0], parameters[:, 1]
    contained = (low >= centre - half_width) & (high <= centre + half_width)
    return np.asarray(contained & (half_width <= WIDER * np.maximum(high - low, NARROWEST)))


def _horner(coefficients: ca.SX, xi: ca.SX) -> ca.SX:
    """Evaluate polynomials with coefficients (curves, powers) at xi by Horner's rule."""
    value = coefficients[:, -1]
    for k in range(coefficients.size2() - 2, -1, -1):
        value = value * xi + coefficients[:, k]
    return value


def _derivative(coefficients: ca.SX) -> ca.SX:
    """Return the coefficients of the derivatives."""
    return ca.horzcat(*(k * coefficients[:, k] for k in range(1, coefficients.size2())))


@keyword_record
class FreeElement(ElementModel):
    """Path constraints of a robot and an eye for moving joints, with p = (σ (4,), layout)."""

    mechanism: Mechanism
    moving: tuple[int, ...]
    eye: Eye | None = None

    state_size = 12
    positions = 4
    layout = Layout(
        q0=4,
        d=4,
        **LIMITS,
        range_centre=len(WATCHED),
        range_half_width=len(WATCHED),
        rate=len(RATED),
        retina_easing=1,
        time_scale=1,
    )
    """First point and unit of the coordinates, limits, ranges of WATCHED, and rates of RATED.

    `retina_easing` is the amount by which the retina's row may exceed 1. `time_scale` is the length
    of a scaled second, s.
    """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sizes of σ and of the limits."""
        return Parameter(4, True), Parameter(self.layout.size, False)

    @cached_property
    def key(self) -> tuple[Hashable, ...]:
        return (
            "free",
            robot_key(self.robot),
            self.moving,
            self.active,
            pickle.dumps(self._seen),
            self.aim,
        )

    @property
    def coordinates(self) -> int:
        """Number of moving joints."""
        return len(self.moving)

    def state(self, z: ca.SX, c: float) -> ca.SX:
        """Return u, u̇ and ü of all joints at the share c of an element."""
        x = ca.SX.zeros(12)
        for order, values in enumerate(self.cubic(z).evaluate(c)):
            x[[4 * order + joint for joint in self.moving]] = values
        return x

    def instant(self, x: ca.SX, *p: ca.SX) -> Instant:
        """Return motion and limits of the joints."""
        sigma, packed = p
        limits = self.layout.unpack(packed)
        q, qd, qdd = _joints(x, limits)
        # The norm has no derivative at rest, so squares are compared.
        limits.speeds = limits.speeds**2
        return Instant(
            qd=qd,
            qd_hull=qd,
            qdd=qdd,
            qddd=ca.SX.zeros(4),
            tau_rigid=ca.vertcat(
                *(RigidBody.from_robot(load).symbolic(q, qd, qdd) for load in self.robot.loads)
            ),
            speeds=ca.vertcat(*(ca.sumsqr(jacobian(q) @ qd) for jacobian in self._jacobians)),
            sigma=sigma,
            limits=limits,
        )

    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Return the rows of tool speeds, torques, ranges, rates and the eye."""
        instant = self.instant(x, *p)
        parameters = self.layout.unpack(p[1])
        q, qd, _ = _joints(x, parameters)
        rows = [*speed_rows(instant), *torque_rows(instant, self.robot)]
        rows += range_rows(self.mechanism, q, parameters) + rate_rows(
            self.mechanism, q, qd, parameters
        )
        return (
            rows
            if self._seen is None
            else rows + seen_rows(self._seen, self.mechanism, q, parameters.retina_easing)
        )

    @property
    def first_actuation(self) -> int:
        return len(JACOBIANS) + 2 * (len(WATCHED) + len(RATED)) + 2

    @cached_property
    def all_rows(self) -> list[RowPlace]:
        rows: list[RowPlace] = [
            (speed_class.name, None, k) for k, speed_class in enumerate(JACOBIANS)
        ]
        names = [TaskRange.name_of(name) for name in WATCHED] + [
            TaskRate.name_of(name) for name in RATED
        ]
        task_rows = [
            (name, None, len(JACOBIANS) + 2 * k + side)
            for k, name in enumerate(names)
            for side in (0, 1)
        ]
        rows += [*torque_places(self.robot, self.first_actuation), *task_rows]
        if self._seen is not None:
            rows.append((RetinaClearance.name, None, self.first_actuation - 2))
            rows += [(LensClearance.name, None, self.first_actuation - 1)] * (
                self._seen.lens is not None
            )
        return rows

    @property
    def _seen(self) -> Eye | None:
        """The eye if one of its rows is active, else None."""
        rows = set() if self.eye is None else {(limit.name, None) for limit in self.eye.limits}
        return self.eye if self.active is None or rows & self.active else None

    @cached_property
    def _jacobians(self) -> list[ca.Function]:
        """Functions q (4,) → J (k, 4) of all tool speeds."""
        q = ca.SX.sym("q", 4)
        return [
            ca.Function("jacobian", [q], [jacobian(self.mechanism, q)])
            for jacobian in JACOBIANS.values()
        ]


def range_rows(mechanism: Any, q: ca.SX, parameters: SimpleNamespace) -> list[PathConstraint]:
    """Return the rows of the ranges of WATCHED. `parameters` are those of `FreeElement.layout`."""
    rows, task = [], task_from_joints_symbolic(mechanism, q)
    for k, name in enumerate(WATCHED):
        value = (task[TASK.index(name)] - parameters.range_centre[k]) / parameters.range_half_width[
            k
        ]
        rows += [PathConstraint(TaskRange.name_of(name), None, side * value) for side in (1, -1)]
    return rows


def rate_rows(
    mechanism: Any, q: ca.SX, qd: ca.SX, parameters: SimpleNamespace
) -> list[PathConstraint]:
    """Return the rows of the rates of RATED."""
    rows, rates = [], task_rates_symbolic(mechanism, q, qd)
    for k, name in enumerate(RATED):
        value = rates[TASK.index(name)] / parameters.rate[k]
        rows += [PathConstraint(TaskRate.name_of(name), None, side * value) for side in (1, -1)]
    return rows


def seen_rows(eye: Any, mechanism: Any, q: ca.SX, easing: ca.SX) -> list[PathConstraint]:
    """Return the rows of the eye. `easing` is the amount by which the retina's row may exceed 1."""
    tip, rows = tip_position_symbolic(mechanism, q), []
    for name, value in eye_rows(casadi_namespace(), eye, (tip[0], tip[1], tip[2])).items():
        rows.append(
            PathConstraint(name, None, value + 1 - (easing if name == RetinaClearance.name else 0))
        )
    return rows


def _joints(x: ca.SX, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return q, q̇ and q̈ in SI units, (4,) each, from the state and the parameters."""
    return p.q0 + p.d * x[:4], p.d * x[4:8] / p.time_scale, p.d * x[8:12] / p.time_scale**2
