"""What the motor torque is spent on: accelerating, carrying the load, and friction.

Without friction the law of model/transmission.py is linear in load and acceleration, so it divides into parts; friction is
the rest: tau = tau_lossless(inertia) + tau_lossless(load) + bearings + (mesh with friction − mesh without).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.value import unchecked
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.typing import Array


@dataclass(frozen=True, eq=False)
class TorqueBreakdown:
    """Parts of the motor torque (n,), N·m; their sum is the torque."""

    input_inertia: Array
    """Accelerating the motor shaft with all that turns on it."""
    output_inertia: Array
    """Accelerating the bodies and the output side of the drive."""
    load: Array
    """Gravity, Coriolis and centrifugal effort."""
    mesh_friction: Array
    """Sliding in the mesh: what the mesh takes beyond a mesh without friction. At rest it holds the load."""
    bearing_friction: Array
    """Bearings of the input side, and those of the output side carried through a mesh without friction."""
    at_peak: dict[str, float]
    """The parts at the instant of the largest torque, N·m."""
    rms: dict[str, float]
    """RMS of each part over the motion, N·m."""

    def parts(self) -> Iterator[tuple[str, Array]]:
        """Name and part."""
        for name in PARTS:
            yield name, getattr(self, name)

    def to_dict(self) -> dict[str, dict[str, float]]:
        return {name: {"at_peak": self.at_peak[name], "rms": self.rms[name]} for name in PARTS}


PARTS = ("input_inertia", "output_inertia", "load", "mesh_friction", "bearing_friction")


def torque_split(load: JointLoad, drive: Drive | None = None) -> TorqueBreakdown:
    """The parts of the motor torque of a joint, with its own drive or another one."""
    drive = drive or load.drive
    moving, zero = load.direction != 0, np.zeros_like(load.t)
    lossless, rough = _without_friction(drive), _with_bearings_only(drive)
    w, wd, way = load.speed(drive), load.acceleration(drive), np.where(moving, load.direction, 1.0)
    carried = output_effort(lossless, load.inertia, zero, load.qdd, way)
    rubbing = output_effort(drive, zero, load.qd, zero, load.direction)
    # an antibacklash nut accelerates with wd, so its lossless preload (which cancels) and inertia come with the input
    input_inertia = motor_torque(lossless, zero, zero, wd, direction=way)
    output_inertia = _mesh(lossless, carried, way)
    held = _mesh(lossless, load.velocity + load.gravity, way)
    bearing = np.where(moving, motor_torque(rough, rubbing, w, zero, direction=way), 0.0)
    total = load.torque(drive)
    effort = load.effort(drive)
    without = np.where(moving, motor_torque(rough, effort, w, wd, direction=way), _mesh(lossless, effort, way))
    parts = {
        "input_inertia": input_inertia,
        "output_inertia": output_inertia,
        "load": held,
        "mesh_friction": total - without,
        "bearing_friction": bearing,
    }
    peak = int(np.argmax(np.abs(total)))
    return TorqueBreakdown(
        **parts,
        at_peak={name: float(part[peak]) for name, part in parts.items()},
        rms={name: float(load.rms(part)) for name, part in parts.items()},
    )


def _mesh(lossless: Drive, effort: Array, direction: Array) -> Array:
    zero = np.zeros_like(effort)
    return motor_torque(lossless, effort, zero, zero, direction=direction)


def _without_friction(drive: Drive) -> Drive:
    bare = unchecked(friction_of(drive), mu=0.0, mu_static=0.0, mu_stribeck=0.0, b_c=0.0, b_v=0.0, b_oc=0.0, b_ov=0.0)
    return unchecked(drive, friction=bare)


def _with_bearings_only(drive: Drive) -> Drive:
    return unchecked(drive, friction=unchecked(friction_of(drive), mu=0.0, mu_static=0.0, mu_stribeck=0.0))
