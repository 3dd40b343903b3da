"""The exact torque law of self-locking transmissions: motor torque for an output effort and a motor motion.

Mablekos-Alexiou, da Cruz, Bergeles, IEEE T-RO 37(4), 2021. Motor angle w = ratio·qd; all torques on the motor side:

    tau = J_in·wd + b_c·sgn(w) + b_v·w + γ·tan(λ + sgn(F·w)·φ)·F,    φ = atan(μ / cos θ_n)

An antibacklash screw has two half nuts spread by a preload P. The main nut carries F − P < 0, the second one
P + m₂·qdd > 0, so the branch of each follows from the sign of motion alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.dynamics.friction import friction_coefficient, friction_of
from ssm_planner.problem.drive import Drive
from ssm_planner.typing import Array

Expression = Any
"""A float, an array or a CasADi expression."""


def friction_angle(drive: Drive, mu: Expression) -> Array:
    """Equivalent friction angle φ = atan(μ / cos θ_n), rad, shape of mu."""
    return np.arctan(np.asarray(mu) / np.cos(drive.pressure_angle))


def mesh_coefficients(drive: Drive, mu: Expression) -> tuple[Expression, Expression]:
    """(γ·tan(λ + φ), γ·tan(λ − φ)): motor torque per unit of output effort, uphill and downhill.

    The second is negative when the mesh locks itself. Shape of mu; arrays or CasADi expressions, so the tangents of
    sums are written by tan φ = μ / cos θ_n. Finite while λ + φ < 90°.
    """
    gamma, tan_lead = float(drive.gamma), math.tan(drive.lead_angle)
    tan_phi = mu * (1.0 / math.cos(drive.pressure_angle))
    up = gamma * (tan_lead + tan_phi) / (1.0 - tan_lead * tan_phi)
    down = gamma * (tan_lead - tan_phi) / (1.0 + tan_lead * tan_phi)
    return up, down


def output_effort(
    drive: Drive, tau_rigid: Expression, qd: Expression, qdd: Expression, direction: Expression = None
) -> Expression:
    """Effort F that the mesh must carry, N·m (worm) or N (screws).

    F = τ_rigid + J_out·qdd + b_oc·sgn(qd) + b_ov·qd; `direction` (±1) replaces sgn(qd) at standstill.
    Floats or arrays; CasADi expressions with a given direction (a smooth sign, for instance).
    """
    sign = np.sign(qd) if direction is None else direction
    f = friction_of(drive)
    return tau_rigid + drive.output_inertia * qdd + f.b_oc * sign + f.b_ov * qd


def mesh_torque(drive: Drive, F: Expression, wd: Expression, direction: Expression, mu: Expression) -> Expression:
    """Motor torque of the mesh alone, moving in `direction` (±1): the load's part and, with two nuts, the preload's.

    γ·tan(λ ± φ)·F is written as mean·F + direction·half·|F|. Arrays or CasADi expressions.
    """
    up, down = mesh_coefficients(drive, mu)
    mean, half = 0.5 * (up + down), 0.5 * (up - down)
    if drive.kind != "antibacklash_screw":
        return mean * F + direction * half * abs(F)
    main, second = mean - direction * half, mean + direction * half
    return main * (F - drive.preload) + second * (drive.preload + drive.second_nut_mass * wd / drive.ratio)


def motor_torque(
    drive: Drive,
    F: ArrayLike,
    w: ArrayLike,
    wd: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    mu: ArrayLike | None = None,
) -> Array:
    """Motor torque of the exact law, N·m, broadcast shape of the arguments.

    F: output effort as `output_effort` gives it; w, wd: motor speed and acceleration (rad/s, rad/s²).
    direction: ±1, replaces sgn(w) (a drive at standstill about to move, or a motion whose sign is known).
    mu: replaces the friction law's μ(|w|) (`friction.mu_static` for breakaway).
    Where the direction is 0 the drive stands and holds: the result is `holding_torque`, 0 for a self-locking drive.
    """
    F, w, wd = (np.asarray(value, dtype=float) for value in (F, w, wd))
    sign = np.sign(w) if direction is None else np.asarray(direction, dtype=float)
    f = friction_of(drive)
    coefficient = friction_coefficient(f, w) if mu is None else np.asarray(mu, dtype=float)
    moving = drive.input_inertia * wd + f.b_c * sign + f.b_v * w + mesh_torque(drive, F, wd, sign, coefficient)
    if np.all(sign != 0):
        return moving
    return np.where(sign == 0, holding_torque(drive, F), moving)


def motor_torque_smooth(
    drive: Drive,
    F: Expression,
    w: Expression,
    wd: Expression,
    *,
    eps_w: float = 0.1,
    eps_F: float = 1e-3,
    direction: Expression = None,
) -> Expression:
    """The law of `motor_torque` with smooth signs, for optimisation; floats, arrays or CasADi expressions.

    sgn(w) → w / √(w² + eps_w²) and |x| → √(x² + eps²): it tends to the exact law as eps_w (rad/s) and eps_F (N·m or N)
    → 0 wherever w ≠ 0. A given `direction` (±1) keeps that sign exact. √ over-estimates |F| by at most eps_F.
    """
    f = friction_of(drive)
    speed = (w * w + eps_w * eps_w) ** 0.5
    sign = w / speed if direction is None else direction
    mu = friction_coefficient(f, speed)
    up, down = mesh_coefficients(drive, mu)
    if drive.kind == "antibacklash_screw":
        mesh = mesh_torque(drive, F, wd, sign, mu)
    else:
        mesh = 0.5 * (up + down) * F + 0.5 * (up - down) * sign * (F * F + eps_F * eps_F) ** 0.5
    return drive.input_inertia * wd + f.b_c * sign + f.b_v * w + mesh


@dataclass(frozen=True, eq=False)
class TorqueRows:
    """Motor torque in one direction of motion as two linear functions of F, wd and w.

    tau_k = slope[k]·F + inertia·wd + coulomb + viscous·w; the torque is max_k tau_k for direction +1 and min_k tau_k
    for −1, exactly. So a limit in the direction of motion is two linear rows; for the other limit either row suffices.
    """

    slope: tuple[Any, Any]
    """Two coefficients of F, each of the shape of mu."""
    inertia: Any
    coulomb: Any
    viscous: float


def motor_torque_rows(drive: Drive, direction: int, mu: ArrayLike | None = None) -> TorqueRows:
    """The rows of `TorqueRows` for motion of sign `direction` (+1 or −1).

    mu: coefficient to use (float, array or CasADi expression), default the kinetic `friction.mu`. The torque grows with
    μ in the direction of motion, so an upper bound of μ gives rows on the safe side.
    """
    if direction not in (1, -1):
        raise ValueError(f"direction must be +1 or −1, not {direction!r}")
    f = friction_of(drive)
    up, down = mesh_coefficients(drive, f.mu if mu is None else mu)
    inertia, coulomb = drive.input_inertia + 0.0 * up, direction * f.b_c + 0.0 * up
    if drive.kind == "antibacklash_screw":
        main, second = (down, up) if direction > 0 else (up, down)
        inertia = inertia + second * drive.second_nut_mass / drive.ratio
        coulomb = coulomb + drive.preload * (second - main)
        return TorqueRows((main, main), inertia, coulomb, f.b_v)
    return TorqueRows((up, down), inertia, coulomb, f.b_v)


def breakaway_torque(drive: Drive, tau_rigid: ArrayLike, direction: ArrayLike, mu: ArrayLike | None = None) -> Array:
    """Motor torque at which a drive at rest starts to move in `direction` (±1) against the effort tau_rigid.

    tau_rigid: effort on the load without the output's own friction, which is added here; mu: default mu_static.
    """
    direction = np.asarray(direction, dtype=float)
    F = output_effort(drive, np.asarray(tau_rigid, dtype=float), 0.0, 0.0, direction)
    mu = friction_of(drive).mu_static if mu is None else mu
    return friction_of(drive).b_c * direction + mesh_torque(drive, F, 0.0, direction, mu)


def holding_torque(drive: Drive, tau_rigid: ArrayLike, mu: ArrayLike | None = None) -> Array:
    """Smallest motor torque that keeps a drive at rest under the effort tau_rigid: 0 where it locks itself.

    The drive stays while the torque lies between the breakaway torques of the two directions.
    """
    lowest = breakaway_torque(drive, tau_rigid, -1.0, mu)
    highest = breakaway_torque(drive, tau_rigid, 1.0, mu)
    return np.clip(0.0, np.minimum(lowest, highest), np.maximum(lowest, highest))


def efficiency(drive: Drive, mu: ArrayLike | None = None) -> tuple[Array, Array]:
    """(forward, backward) efficiency of one mesh: output per input power, motor driving and load driving.

    1 / (ratio·γ·tan(λ + φ)) and ratio·γ·tan(λ − φ); the second is ≤ 0 for a self-locking mesh, which takes power from
    both sides. With γ and λ taken at one diameter these are tan λ / tan(λ + φ) and tan(λ − φ) / tan λ.
    """
    up, down = mesh_coefficients(drive, friction_of(drive).mu if mu is None else np.asarray(mu, dtype=float))
    return 1.0 / (drive.ratio * up), drive.ratio * down


def self_locking_margin(drive: Drive, mu: ArrayLike | None = None) -> tuple[Array, Array]:
    """(μ − cos θ_n·tan λ, φ − λ in rad): positive while the mesh locks itself, by its own friction alone."""
    mu = friction_of(drive).mu if mu is None else mu
    return mu - np.cos(drive.pressure_angle) * np.tan(drive.lead_angle), friction_angle(drive, mu) - drive.lead_angle


def nut_contact(drive: Drive, F: ArrayLike, wd: ArrayLike) -> Array:
    """Smallest contact force of the two half nuts of an antibacklash screw, N; ≤ 0 means contact is lost.

    Main nut P − F, second nut P + m₂·qdd: beyond that the law does not hold. Infinite for the other drives.
    """
    F = np.asarray(F, dtype=float)
    if drive.kind != "antibacklash_screw":
        return np.full(np.broadcast(F, wd).shape, np.inf)
    return np.minimum(drive.preload - F, drive.preload + drive.second_nut_mass * np.asarray(wd) / drive.ratio)
