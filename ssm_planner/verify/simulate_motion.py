"""The compliance of a simulated arm, and its motion with the energies that went where."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.problem.values import Array


@dataclass(frozen=True, eq=False)
class Compliance:
    """Spring and damper between each drive and its joint, (4,): N·m/rad and N·m·s/rad, N/m and N·s/m for joint 4."""

    stiffness: Array
    damping: Array

    @classmethod
    def of_frequency(
        cls,
        body: RigidBody,
        q: Array,
        frequency: tuple[float, float, float, float] = (30.0, 30.0, 30.0, 100.0),
        damping_ratio: float = 0.3,
    ) -> Compliance:
        """Stiffness from the natural frequency (Hz) of each joint with its drive locked, at q (4,).

        The default figures are assumptions, not measurements.
        """
        inertia = np.diag(body.mass_matrix(np.reshape(q, (1, 4)))[0])
        omega = 2.0 * math.pi * np.asarray(frequency)
        return cls(inertia * omega**2, 2.0 * damping_ratio * inertia * omega)


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """A simulated motion at the control instants: arrays (n,) and (n, 4), SI; motor columns are NaN without a drive."""

    time: Array
    q: Array
    qd: Array
    motor_angle: Array
    w: Array
    tau: Array
    """Motor torque during the period that begins at each instant."""
    work: Array
    """Energy put in by the motors, and by what moves the joints without a drive, since the start, J."""
    friction_loss: Array
    damping_loss: Array
    kinetic: Array
    potential: Array
    """Of gravity and of the springs, J."""
    status: str
    """`done`, or what makes the motion worthless."""

    @property
    def energy_error(self) -> float:
        """Largest |work − (kinetic + potential + dissipated)| over the largest of these."""
        stored = self.kinetic + self.potential
        lost = self.friction_loss + self.damping_loss
        error = self.work - (stored - stored[0]) - lost
        scale = max(float(np.abs(x).max()) for x in (self.work, lost, stored - stored[0]))
        return float(np.abs(error).max() / scale) if scale > 1e-12 else 0.0
