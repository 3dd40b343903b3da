"""Simulated motions of the arm with energies, and a test whether the drives determine them."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ssm_planner.dynamics.friction import breakaway_coefficient, required_friction
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import effective_inertia
from ssm_planner.kinematics.rotations import rotation_symbolic
from ssm_planner.problem import Drive
from ssm_planner.simulation.drive import inertia_at_motor
from ssm_planner.simulation.plant import ENERGY, MOTOR, QD, ArmPlant, Q, W
from ssm_planner.typing import Array

NOT_UNIQUE = (
    "the effective inertia with the load driving is negative: a rigid drive has no unique motion"
)


@dataclass(frozen=True)
class ArmMotion:
    """A simulated motion at n instants. Joint and motor quantities are (n, 4), energies (n,).

    Motor quantities are NaN for joints without a drive.
    """

    time: Array
    """Instants (n,), s."""
    q: Array
    qd: Array
    motor_angle: Array
    w: Array
    """Motor speed, rad/s."""
    tau: Array
    """Motor torque during the period that begins at each instant, N·m."""
    work: Array
    """Energy since the start from the motors and from prescribed accelerations, J."""
    friction_loss: Array
    """Energy that friction has dissipated since the start, J."""
    damping_loss: Array
    """Energy that the dampers have dissipated since the start, J."""
    kinetic: Array
    potential: Array
    """Energy of gravity and of the springs, J."""
    status: str
    """`done`, or the reason why the motion is invalid."""


def arm_motion(plant: ArmPlant, time: Array, x: Array, tau: Array) -> ArmMotion:
    """Return the motion with energies from states (n, 28) and torques (n, 4) at times (n,)."""
    driven = list(plant.driven)
    kinetic, potential = energy(plant.body, x[:, Q], x[:, QD])
    for k in driven:
        drive = plant.drive(k)
        motor, w = x[:, MOTOR][:, k], x[:, W][:, k]
        kinetic = kinetic + 0.5 * inertia_at_motor(drive) * w**2
        stretch = np.asarray(plant.compliance.deflection(k, motor / drive.ratio - x[:, k]))
        potential = potential + 0.5 * plant.compliance.stiffness[k] * stretch**2
    work, locked_work, friction_loss, damping_loss = x[:, ENERGY].T
    columns = {name: np.full((len(x), 4), np.nan) for name in ("motor", "w", "tau")}
    for name, values in (("motor", x[:, MOTOR]), ("w", x[:, W]), ("tau", tau)):
        columns[name][:, driven] = values[:, driven]
    status = "done" if all(always_unique(plant.drive(k)) for k in driven) else NOT_UNIQUE
    return ArmMotion(
        time=time,
        q=x[:, Q],
        qd=x[:, QD],
        motor_angle=columns["motor"],
        w=columns["w"],
        tau=columns["tau"],
        work=work + locked_work,
        friction_loss=friction_loss,
        damping_loss=damping_loss,
        kinetic=kinetic,
        potential=potential,
        status=status if np.all(np.isfinite(x)) else "diverged",
    )


def always_unique(drive: Drive) -> bool:
    """Return whether every torque gives this drive exactly one motion.

    This holds if its effective inertia is positive at the largest friction.
    """
    friction = breakaway_coefficient(required_friction(drive))
    return all(
        inertia > 0
        for direction in (1, -1)
        for inertia in effective_inertia(drive, friction, direction)
    )


def energy(body: RigidBody, q: Array, qd: Array) -> tuple[Array, Array]:
    """Return the kinetic and the potential energy (n,) in J.

    The potential energy is zero for all masses at the remote centre.
    """
    kinetic = np.einsum("ni,nij,nj->n", qd, body.mass_matrix(q), qd) / 2
    joints = ca.SX.sym("q", 4)
    axes = (body.geometry.omega1, body.geometry.omega2, body.geometry.omega3)
    turn, potential = ca.SX.eye(3), ca.SX(0)
    for i, part in enumerate(body.bodies):
        if i < 3:
            turn = turn @ rotation_symbolic(axes[i], joints[i])
        com = turn @ ca.DM(part.frame @ part.com)
        if i == 3:
            com += turn @ ca.DM(axes[2]) * joints[3]
        potential -= part.mass * ca.dot(ca.DM(body.gravity), com)
    function = ca.Function("potential", [joints], [potential])
    return kinetic, function(q.T).full()[0]


def energy_error(motion: ArmMotion) -> float:
    """Return the largest error of the energy balance, relative to the largest of the energies.

    The error is |work − (kinetic + potential + dissipated)|.
    """
    stored = motion.kinetic + motion.potential
    lost = motion.friction_loss + motion.damping_loss
    error = motion.work - (stored - stored[0]) - lost
    scale = max(float(np.abs(x).max()) for x in (motion.work, lost, stored - stored[0]))
    return float(np.abs(error).max() / scale) if scale > 1e-12 else 0.0
