"""Forward dynamics of one drive: the acceleration that a motor torque gives, effective inertia, standstill.

The inverse law of model/transmission.py solved for the acceleration. It is piecewise linear: along the branch on which
the load opposes motion the motor turns `effective_inertia(...)[0]`, along the other one `effective_inertia(...)[1]`,
which friction can make negative when the load's inertia is large (J_in·ratio < γ·|tan(λ − φ)|·M). Then a rigid drive
with the load ahead of it has no unique motion: it may run ahead or jam at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.transmission import (
    Expression,
    breakaway_torque,
    mesh_coefficients,
    mesh_torque,
    output_effort,
)
from ssm_planner.problem.drive import Drive

Outcome = Literal["unique", "none", "several"]


@dataclass(frozen=True)
class Slip:
    """Acceleration of a sliding drive at one instant."""

    wd: float
    """Motor acceleration, rad/s²; NaN where no motion satisfies the law."""
    effort: float
    """F that the mesh carries, N·m or N."""
    outcome: Outcome


def with_load(drive: Drive, load_inertia: float) -> Drive:
    """The drive with the inertia of a load fixed to its output (kg·m² or kg)."""
    return replace(drive, output_inertia=drive.output_inertia + load_inertia)


def effective_inertia(drive: Drive, mu: Expression = None) -> tuple[Expression, Expression]:
    """Inertia at the motor shaft, kg·m², (load opposing, load driving); shape of mu, default the kinetic coefficient.

    J_in + γ·tan(λ ± φ)·J_out / ratio. For an antibacklash screw (moving forwards, backwards), both nuts counted.
    mu: a float, an array or a CasADi expression.
    """
    mu = friction_of(drive).mu if mu is None else mu
    up, down = mesh_coefficients(drive, mu)
    output, second = drive.output_inertia / drive.ratio, drive.second_nut_mass / drive.ratio
    if drive.kind == "antibacklash_screw":
        return (
            drive.input_inertia + down * output + up * second,
            drive.input_inertia + up * output + down * second,
        )
    return drive.input_inertia + up * output, drive.input_inertia + down * output


def always_unique(drive: Drive) -> bool:
    """Whether every torque gives this drive one motion: its effective inertia is positive at the largest friction."""
    f = friction_of(drive)
    return bool(min(effective_inertia(drive, max(f.mu + f.mu_stribeck, f.mu_static))) > 0.0)


def slip_acceleration(drive: Drive, tau: float, w: float, load: float, direction: int, mu: float) -> Slip:
    """Acceleration of a drive that moves (or starts to move) in `direction` (±1) under the motor torque tau, N·m.

    load: effort on the output besides its inertia and friction; the inertia of the load belongs to the drive
    (`with_load`). Solves motor_torque(F, w, wd) = tau with F = load + J_out·wd/ratio + friction.
    """
    f = friction_of(drive)
    effort = float(output_effort(drive, load, w / drive.ratio, 0.0, direction))
    left = tau - f.b_c * direction - f.b_v * w
    inertias = effective_inertia(drive, mu)
    output = drive.output_inertia / drive.ratio
    if drive.kind == "antibacklash_screw":
        wd = (left - float(mesh_torque(drive, effort, 0.0, direction, mu))) / float(inertias[0 if direction > 0 else 1])
        return Slip(wd, effort + output * wd, "unique")
    found = []
    for side, slope, inertia in zip((1, -1), mesh_coefficients(drive, mu), inertias, strict=True):
        if inertia == 0:
            continue
        wd = (left - slope * effort) / float(inertia)
        carried = effort + output * wd
        if carried * direction * side >= 0:
            found.append((wd, carried))
    if not found:
        return Slip(float("nan"), float("nan"), "none")
    wd, carried = found[0]
    return Slip(float(wd), float(carried), "unique" if len(found) == 1 or found[0] == found[1] else "several")


def breaks_away(drive: Drive, tau: float, load: float, mu_static: float) -> int:
    """Direction (±1) in which a drive at rest starts to move under the motor torque tau, 0 where it stays."""
    if tau > breakaway_torque(drive, load, 1.0, mu_static):
        return 1
    if tau < breakaway_torque(drive, load, -1.0, mu_static):
        return -1
    return 0


def friction_power(drive: Drive, w: float, effort: float, direction: int, mu: float, wd: float = 0.0) -> float:
    """Power that mesh, bearings and output friction turn into heat, W, ≥ 0 in motion."""
    f = friction_of(drive)
    qd = w / drive.ratio
    transmitted = effort * qd
    if drive.kind == "antibacklash_screw":
        transmitted += drive.second_nut_mass * wd / drive.ratio * qd
    mesh = float(mesh_torque(drive, effort, wd, direction, mu)) * w - transmitted
    return mesh + f.b_c * direction * w + f.b_v * w * w + (f.b_oc * direction + f.b_ov * qd) * qd
