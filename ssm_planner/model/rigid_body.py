"""Rigid-body dynamics of the four bodies: τ = M(q) q̈ + C(q, q̇) q̇ + g(q), symbolic and numeric.

One recursion (Newton–Euler about the RCM) written in CasADi; every number in the program comes from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ssm_planner.model.functions import call
from ssm_planner.problem.values import Array, Body, Geometry, Robot


def inverse_dynamics_symbolic(
    geometry: Geometry, bodies: tuple[Body, ...], gravity: Array, q: ca.SX, qd: ca.SX, qdd: ca.SX
) -> ca.SX:
    """Joint efforts that produce qdd at (q, qd); (4,) each, rad, m, N·m, N.

    All three revolute axes pass through the origin, so body 1 to 3 never translate; body 4 slides along ω3.
    Newton–Euler in base coordinates with moments about the RCM (Murray, Li, Sastry, ch. 4); gravity enters as an
    acceleration −g of the base.
    """
    axes = [ca.DM(geometry.omega1), ca.DM(geometry.omega2), ca.DM(geometry.omega3)]
    rotation = ca.SX.eye(3)
    omega = ca.SX.zeros(3)
    omega_dot = ca.SX.zeros(3)
    base_acceleration = -ca.DM(gravity)
    world_axes = []
    forces = []
    moments = []
    for i, body in enumerate(bodies):
        offset = ca.SX.zeros(3)
        offset_acceleration = ca.SX.zeros(3)
        if i < 3:
            axis = rotation @ axes[i]
            # ω̇ gains ω × (axis q̇) because the axis itself turns with the bodies before it
            omega_dot = omega_dot + axis * qdd[i] + ca.cross(omega, axis) * qd[i]
            omega = omega + axis * qd[i]
            rotation = rotation @ _rotation(axes[i], q[i])
        else:
            axis = rotation @ axes[2]
            offset = axis * q[3]
            offset_acceleration = (
                axis * qdd[3]
                + 2 * ca.cross(omega, axis) * qd[3]
                + ca.cross(omega_dot, offset)
                + ca.cross(omega, ca.cross(omega, offset))
            )
        world_axes.append(axis)
        to_base = rotation @ ca.DM(body.frame)
        com = to_base @ ca.DM(body.com)
        acceleration = (
            base_acceleration + offset_acceleration + ca.cross(omega_dot, com) + ca.cross(omega, ca.cross(omega, com))
        )
        inertia = to_base @ ca.DM(inertia_about_com(body)) @ to_base.T
        force = body.mass * acceleration
        forces.append(force)
        moments.append(inertia @ omega_dot + ca.cross(omega, inertia @ omega) + ca.cross(offset + com, force))
    tau = [ca.dot(world_axes[i], _total(moments[i:])) for i in range(3)]
    tau.append(ca.dot(world_axes[3], forces[3]))
    return ca.vertcat(*tau)


def inertia_about_com(body: Body) -> Array:
    """Inertia tensor about the centre of mass in the body frame, kg·m², (3, 3) (parallel-axis theorem)."""
    c = body.com
    return np.asarray(body.inertia - body.mass * (c @ c * np.eye(3) - np.outer(c, c)))


@dataclass(frozen=True, eq=False)
class RigidBody:
    """Numeric rigid-body dynamics of one robot, vectorised over samples."""

    geometry: Geometry
    bodies: tuple[Body, ...]
    gravity: Array

    @classmethod
    def from_robot(cls, robot: Robot) -> RigidBody:
        return cls(robot.geometry, robot.bodies, robot.gravity)

    def inverse_dynamics(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Joint efforts (n, 4) at q, qd, qdd (n, 4)."""
        return call(self._inverse_dynamics, q, qd, qdd)[0]

    def gravity_load(self, q: Array) -> Array:
        """Efforts (n, 4) that hold the robot still at q (n, 4)."""
        zero = np.zeros_like(q)
        return self.inverse_dynamics(q, zero, zero)

    def mass_matrix(self, q: Array) -> Array:
        """M(q), (n, 4, 4), symmetric, for q (n, 4)."""
        return call(self._mass_matrix, q)[0].reshape(-1, 4, 4)

    def energy(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """Kinetic and potential energy, J, (n,) each; the potential is zero with all masses at the RCM."""
        kinetic, potential = call(self._energy, q, qd)
        return kinetic[:, 0], potential[:, 0]

    def symbolic(self, q: ca.SX, qd: ca.SX, qdd: ca.SX) -> ca.SX:
        return inverse_dynamics_symbolic(self.geometry, self.bodies, self.gravity, q, qd, qdd)

    @cached_property
    def _inverse_dynamics(self) -> ca.Function:
        q, qd, qdd = (ca.SX.sym(name, 4) for name in ("q", "qd", "qdd"))
        return ca.Function("inverse_dynamics", [q, qd, qdd], [self.symbolic(q, qd, qdd)], ["q", "qd", "qdd"], ["tau"])

    @cached_property
    def _mass_matrix(self) -> ca.Function:
        q, qdd = ca.SX.sym("q", 4), ca.SX.sym("qdd", 4)
        tau = self.symbolic(q, ca.SX.zeros(4), qdd)
        return ca.Function("mass_matrix", [q], [ca.vec(ca.densify(ca.jacobian(tau, qdd)))])

    @cached_property
    def _energy(self) -> ca.Function:
        q, qd = ca.SX.sym("q", 4), ca.SX.sym("qd", 4)
        mass_matrix = ca.reshape(self._mass_matrix(q), 4, 4)
        kinetic = ca.dot(qd, mass_matrix @ qd) / 2
        return ca.Function("energy", [q, qd], [kinetic, self._potential(q)])

    def _potential(self, q: ca.SX) -> ca.SX:
        rotation = ca.SX.eye(3)
        axes = (self.geometry.omega1, self.geometry.omega2, self.geometry.omega3)
        potential = ca.SX(0)
        for i, body in enumerate(self.bodies):
            if i < 3:
                rotation = rotation @ _rotation(ca.DM(axes[i]), q[i])
            com = rotation @ ca.DM(body.frame @ body.com)
            if i == 3:
                com += rotation @ ca.DM(axes[2]) * q[3]
            potential -= body.mass * ca.dot(ca.DM(self.gravity), com)
        return potential


def _rotation(axis: ca.DM, angle: ca.SX) -> ca.SX:
    """e^{ω̂θ} for a unit axis (Rodrigues; Murray, Li, Sastry eq. 2.14)."""
    hat = ca.skew(axis)
    return ca.SX.eye(3) + hat * ca.sin(angle) + (hat @ hat) * (1 - ca.cos(angle))


def _total(terms: list[ca.SX]) -> ca.SX:
    total = ca.SX.zeros(3)
    for term in terms:
        total += term
    return total
