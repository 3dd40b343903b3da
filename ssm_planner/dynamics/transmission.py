"""The exact torque law of self-locking transmissions: motor torque for an output effort and a motor motion.

Mablekos-Alexiou, da Cruz, Bergeles, IEEE T-RO 37(4), 2021. Motor angle w = ratio·qd; all torques on the motor side:

    tau = J_in·wd + b_c·sgn(w) + b_v·w + γ·tan(λ + sgn(F·w)·φ)·F,    φ = atan(μ / cos θ_n)

An antibacklash screw has two half nuts spread by a preload P. The main nut carries F − P < 0, the second one
P + m₂·qdd > 0, so the branch of each follows from the sign of motion alone.

Direct drives, gears, belts, cables and ball screws have efficiencies η₊ and η₋ instead of a thread: the motor gives
F/(ratio·η₊) while the load opposes motion, and feels η₋·F/ratio while the load drives. These two slopes are those of a
thread with a lead angle of 45° (`of_efficiencies`), so that the same rows, exact in the direction of power, hold for all.

Solved for the acceleration the law is piecewise linear: along the branch on which the load opposes motion the motor turns
`effective_inertia(...)[0]`, along the other one `effective_inertia(...)[1]`, which friction can make negative when the load's
inertia is large (J_in·ratio < γ·|tan(λ − φ)|·M). Then a rigid drive with the load ahead of it has no unique motion: it may
run ahead or jam at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY, namespace_of
from ssm_planner.dynamics.friction import breakaway_coefficient, friction_coefficient, friction_of
from ssm_planner.problem.drive import Drive
from ssm_planner.typing import Array, Expression


def friction_angle(drive: Drive, mu: Expression) -> Array:
    """Equivalent friction angle φ = atan(μ / cos θ_n), rad, shape of mu."""
    return np.arctan(np.asarray(mu) / np.cos(drive.pressure_angle))


def mesh_coefficients(drive: Drive, mu: Expression) -> tuple[Expression, Expression]:
    """(γ·tan(λ + φ), γ·tan(λ − φ)): motor torque per unit of output effort, uphill and downhill.

    The second is negative when the mesh locks itself. Shape of mu; arrays or CasADi expressions, so the tangents of
    sums are written by tan φ = μ / cos θ_n. Finite while λ + φ < 90°.
    """
    tan_lead, tan_phi = drive.lead_slope, mu * drive.wedging
    up = (tan_lead + tan_phi) * drive.gamma / (1.0 - tan_lead * tan_phi)
    down = (tan_lead - tan_phi) * drive.gamma / (1.0 + tan_lead * tan_phi)
    return up, down


def of_efficiencies(ratio: float, forwards: float, backwards: float) -> tuple[float, float]:
    """(γ, μ) of the thread with λ = 45° and θ_n = 0 whose slopes are 1/(ratio·forwards) and backwards/ratio.

    forwards, backwards: efficiencies, above 0 and up to 1.
    γ·(1 + μ)/(1 − μ) and γ·(1 − μ)/(1 + μ), so γ² is the product of the slopes and ((1 + μ)/(1 − μ))² their quotient.
    """
    root = math.sqrt(forwards * backwards)
    return math.sqrt(backwards / forwards) / ratio, (1.0 - root) / (1.0 + root)


def output_effort(
    drive: Drive,
    tau_rigid: Expression,
    qd: Expression,
    qdd: Expression,
    direction: Expression = None,
) -> Expression:
    """Effort F that the mesh must carry, N·m (worm) or N (screws).

    F = τ_rigid + J_out·qdd + b_oc·sgn(qd) + b_ov·qd; `direction` (±1) replaces sgn(qd) at standstill.
    """
    sign = namespace_of(qd).sign(qd) if direction is None else direction
    f = friction_of(drive)
    return tau_rigid + drive.output_inertia * qdd + f.b_oc * sign + f.b_ov * qd


@dataclass(frozen=True, eq=False)
class TorqueRows:
    """Motor torque in one direction of motion as two linear functions of F, wd and w.

    tau_k = slope[k]·F + inertia·wd + coulomb + viscous·w; the torque is max_k tau_k for direction +1 and min_k tau_k
    for −1, exactly. So a limit in the direction of motion is two linear rows; for the other limit either row suffices.
    """

    slope: tuple[Expression, Expression]
    """Two coefficients of F, each of the shape of mu."""
    inertia: Expression
    coulomb: Expression
    viscous: float

    def torque(self, carried: Expression, w: Expression, wd: Expression) -> Expression:
        """Motor torque, N·m, while the mesh takes carried = slope[k]·F; w, wd: motor speed and acceleration."""
        return carried + self.inertia * wd + self.coulomb + self.viscous * w


def motor_torque_rows(
    drive: Drive, direction: Expression, mu: Expression | None = None
) -> TorqueRows:
    """The rows of `TorqueRows` for motion of sign `direction` (±1).

    mu: coefficient to use, default the kinetic `friction.mu`. The torque grows with μ in the direction of motion, so an
    upper bound of μ gives rows on the safe side.
    """
    if isinstance(direction, int) and direction not in (1, -1):
        raise ValueError(f"direction must be +1 or −1, not {direction!r}")
    f = friction_of(drive)
    up, down = mesh_coefficients(drive, f.mu if mu is None else mu)
    if drive.kind != "antibacklash_screw":
        return TorqueRows((up, down), drive.input_inertia, f.b_c * direction, f.b_v)
    xp = namespace_of(direction, mu)
    # the main nut carries F − P, the second one P + m₂·qdd: each on the branch that the direction alone decides
    main, second = xp.where(direction > 0, down, up), xp.where(direction > 0, up, down)
    inertia = drive.input_inertia + second * drive.second_nut_mass / drive.ratio
    return TorqueRows(
        (main, main), inertia, f.b_c * direction + drive.preload * (second - main), f.b_v
    )


def moving_torque(
    drive: Drive,
    F: Expression,
    w: Expression,
    wd: Expression,
    *,
    direction: Expression,
    mu: Expression,
) -> Expression:
    """Motor torque of a drive that moves, or is about to move, in `direction` (±1): the larger or smaller row."""
    rows = motor_torque_rows(drive, direction, mu)
    xp = namespace_of(F, w, wd, direction, mu)
    first, second = (slope * F for slope in rows.slope)
    carried = xp.where(direction > 0, xp.maximum(first, second), xp.minimum(first, second))
    return rows.torque(carried, w, wd)


def motor_torque(
    drive: Drive,
    F: Expression,
    w: Expression,
    wd: Expression,
    *,
    direction: Expression | None = None,
    mu: Expression | None = None,
) -> Expression:
    """Motor torque of the exact law, N·m, broadcast shape of the arguments: floats, arrays or CasADi expressions.

    F: output effort as `output_effort` gives it; w, wd: motor speed and acceleration (rad/s, rad/s²).
    direction: ±1, replaces sgn(w) (a drive at standstill about to move, or a motion whose sign is known).
    mu: replaces the friction law's μ(|w|) (`friction.mu_static` for breakaway).
    Where the direction is 0 the drive stands and holds: the result is `holding_torque`, 0 for a self-locking drive.
    """
    xp = namespace_of(F, w, wd, direction, mu)
    sign = xp.sign(w) if direction is None else direction
    coefficient = friction_coefficient(friction_of(drive), w) if mu is None else mu
    moving = moving_torque(drive, F, w, wd, direction=sign, mu=coefficient)
    if xp is NUMPY and np.all(sign != 0):
        return moving
    return xp.where(sign == 0, holding_torque(drive, F), moving)


def breakaway_torque(
    drive: Drive, tau_rigid: Expression, direction: Expression, mu: Expression | None = None
) -> Expression:
    """Motor torque at which a drive at rest starts to move in `direction` (±1) against the effort tau_rigid.

    tau_rigid: effort on the load without the output's own friction, which is added here; mu: default mu_static.
    """
    F = output_effort(drive, tau_rigid, 0.0, 0.0, direction)
    mu = friction_of(drive).mu_static if mu is None else mu
    return moving_torque(drive, F, 0.0, 0.0, direction=direction, mu=mu)


def holding_torque(drive: Drive, tau_rigid: Expression, mu: Expression | None = None) -> Expression:
    """Smallest motor torque that keeps a drive at rest under the effort tau_rigid: 0 where it locks itself.

    The drive stays while the torque lies between the breakaway torques of the two directions.
    """
    down, up = (breakaway_torque(drive, tau_rigid, direction, mu) for direction in (-1, 1))
    xp = namespace_of(down, up)
    return xp.minimum(xp.maximum(0.0, xp.minimum(down, up)), xp.maximum(down, up))


def self_locking_margin(drive: Drive, mu: ArrayLike | None = None) -> tuple[Array, Array]:
    """(μ − cos θ_n·tan λ, φ − λ in rad), shape of mu: positive while the mesh locks itself, by its own friction alone."""
    mu = friction_of(drive).mu if mu is None else mu
    return mu - np.cos(drive.pressure_angle) * np.tan(drive.lead_angle), friction_angle(
        drive, mu
    ) - drive.lead_angle


def nut_contact(drive: Drive, F: ArrayLike, wd: ArrayLike) -> Array:
    """Smallest contact force of the two half nuts of an antibacklash screw, N; ≤ 0 means contact is lost.

    F: output effort, N; wd: motor acceleration, rad/s²; the result has their broadcast shape. Main nut P − F, second nut
    P + m₂·qdd: beyond that the law does not hold. Infinite for the other drives.
    """
    F = np.asarray(F, dtype=float)
    if drive.kind != "antibacklash_screw":
        return np.full(np.broadcast(F, wd).shape, np.inf)
    return np.minimum(
        drive.preload - F, drive.preload + drive.second_nut_mass * np.asarray(wd) / drive.ratio
    )


def effective_inertia(
    drive: Drive, mu: Expression | None = None, direction: Expression = 1
) -> tuple[Expression, Expression]:
    """Inertia at the motor shaft, kg·m², (load opposing, load driving); shape of mu, default the kinetic coefficient.

    J_in + γ·tan(λ ± φ)·J_out / ratio. An antibacklash screw, both of whose nuts count, has one for each direction (±1).
    """
    rows = motor_torque_rows(drive, direction, mu)
    output = drive.output_inertia / drive.ratio
    opposing, driving = (rows.inertia + slope * output for slope in rows.slope)
    return opposing, driving


def always_unique(drive: Drive) -> bool:
    """Whether every torque gives this drive one motion: its effective inertia is positive at the largest friction."""
    largest = breakaway_coefficient(friction_of(drive))
    return all(
        inertia > 0
        for direction in (1, -1)
        for inertia in effective_inertia(drive, largest, direction)
    )


def motor_acceleration(
    drive: Drive,
    tau: Expression,
    w: Expression,
    load: Expression,
    direction: Expression,
    mu: Expression,
) -> tuple[Expression, Expression]:
    """(wd, F), rad/s² and N·m or N: acceleration and mesh effort of a drive that moves in `direction` (±1).

    tau, w: motor torque and speed; load: effort on the output besides its inertia and friction. Solves
    motor_torque(F, w, wd) = tau with F = load + J_out·wd/ratio + friction; meaningful where `always_unique`.
    """
    rows = motor_torque_rows(drive, direction, mu)
    effort = output_effort(drive, load, w / drive.ratio, 0.0, direction)
    inertias = effective_inertia(drive, mu, direction)
    opposed, driven = (
        (tau - rows.torque(slope * effort, w, 0.0)) / inertia
        for slope, inertia in zip(rows.slope, inertias, strict=True)
    )
    output = drive.output_inertia / drive.ratio
    xp = namespace_of(opposed, driven, direction)
    wd = xp.where(direction * (effort + output * opposed) >= 0, opposed, driven)
    return wd, effort + output * wd
