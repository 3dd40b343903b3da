"""Evaluate the exact torque law of self-locking transmissions.

Source: Mablekos-Alexiou, da Cruz, Bergeles, IEEE T-RO 37(4), 2021. With the motor speed
w = ratio·q̇, the motor acceleration wd = ratio·q̈ and the effort F that the mesh carries on the
output side (`output_effort`), the motor torque is

    tau = J_in·wd + b_c·sgn(w) + b_v·w + γ·tan(λ + sgn(F·w)·φ)·F,    φ = atan(μ / cos θ_n)

J_in is the inertia on the motor shaft, b_c and b_v are the Coulomb and the viscous friction of its
bearings, γ is the lever arm of the mesh, λ the lead angle, φ the friction angle, μ the friction
coefficient, and θ_n the pressure angle of the thread in its normal section. The mesh is the pair of
sliding parts, such as worm and wheel or screw and nut.

An antibacklash screw has two half nuts that a preload P pushes apart. The main nut carries F − P <
0, and the second nut, whose mass is m₂, carries P + m₂·q̈ > 0. The direction of motion alone
therefore selects the branch of each nut, that is, the sign before φ.

Direct drives, gears, belts, cables and ball screws have efficiencies η₊ and η₋ instead of a thread.
The motor supplies F/(ratio·η₊) while the load opposes the motion, and receives η₋·F/ratio while the
load drives it. A thread with a lead angle of 45° has the same two slopes
(`thread_from_efficiencies`), so the same equations apply to all drives.

A gear stage between motor and drive multiplies the torque of the mesh by 1/(ratio·efficiency) while
that torque opposes the motion, and by backward_efficiency/ratio while it drives the motor. Inertia
and bearing friction act on the motor shaft.

The law is piecewise linear in the acceleration. The motor accelerates the first inertia that
`effective_inertia` returns while the load opposes the motion, and the second one while the load
drives it. Friction can make the second inertia negative if the inertia M of the load is large
(J_in·ratio < γ·|tan(λ − φ)|·M). The motion of a rigid drive with such a load is not unique: it may
continue or jam at once.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen import NUMPY, namespace_of
from ssm_planner.dynamics.friction import friction_coefficient, required_friction
from ssm_planner.problem import Drive
from ssm_planner.typing import Array, Expression, record


def friction_angle(drive: Drive, mu: Expression) -> Array:
    """Compute the friction angle of the mesh.

    The friction angle is φ = atan(μ / cos θ_n).

    θ_n is the pressure angle of the thread in its normal section (`drive.pressure_angle`). A thread
    with friction behaves like one without friction whose lead angle is larger by φ
    (Mablekos-Alexiou, da Cruz and Bergeles, 2021).

    Parameters
    ----------
    drive : Drive
        Drive with a thread.
    mu : float or array
        Friction coefficient μ of the mesh.

    Returns
    -------
    array with the shape of mu
        Friction angles (rad).
    """
    return np.arctan(np.asarray(mu) / np.cos(drive.pressure_angle))


def mesh_coefficients(drive: Drive, mu: Expression) -> tuple[Expression, Expression]:
    """Compute the motor torque per unit of output effort for an opposing and a driving load.

    The coefficients are γ·tan(λ + φ) while the load opposes the motion, and γ·tan(λ − φ) while the
    load drives it. λ is the lead angle, φ the friction angle of `friction_angle`, and γ the lever
    arm of the mesh, for example half of the diameter of a screw. The second coefficient is negative
    if the mesh is self-locking (φ > λ). The tangents of sums are evaluated with tan φ = μ / cos
    θ_n:

        tan(λ ± φ) = (tan λ ± tan φ) / (1 ∓ tan λ tan φ).

    Gear stages between motor and drive multiply the coefficients as the text at the top of this
    module describes.

    Parameters
    ----------
    drive : Drive
        Drive with its geometry and gear stages.
    mu : float, array or expression
        Friction coefficient μ of the mesh. The result is finite while λ + φ < 90°.

    Returns
    -------
    uphill, downhill : with the shape of mu
        Coefficients for an opposing and for a driving load (N·m of the motor per N·m or N).
    """
    tan_lead = drive.lead_slope
    tan_phi = mu * drive.wedging
    uphill = (tan_lead + tan_phi) * drive.gamma / (1.0 - tan_lead * tan_phi)
    downhill = (tan_lead - tan_phi) * drive.gamma / (1.0 + tan_lead * tan_phi)
    for stage in drive.stages.values():
        uphill = uphill * stage.forwards
        # The torque of a self-locking mesh opposes the motion even if the load drives it.
        downhill = namespace_of(mu).minimum(downhill * stage.forwards, downhill * stage.backwards)
    return uphill, downhill


def thread_from_efficiencies(
    ratio: float, forwards: float, backwards: float
) -> tuple[float, float]:
    """Compute the lever arm γ and the friction coefficient μ of a thread that replaces a gear.

    The thread has the lead angle λ = 45° and the pressure angle θ_n = 0, so its motor torque per
    output effort is γ·(1 + μ)/(1 − μ) for an opposing load and γ·(1 − μ)/(1 + μ) for a driving
    load. For the gear, these slopes are 1/(ratio·forwards) and backwards/ratio. The result makes
    both equal: the product of the slopes of the thread is γ², and their quotient is ((1 + μ)/(1 −
    μ))².

    Parameters
    ----------
    ratio : float
        Motor speed divided by joint speed (rad/rad or rad/m).
    forwards, backwards : float
        Efficiencies in (0, 1] while the motor drives the load, and while the load drives the motor.

    Returns
    -------
    gamma, mu : float
        Lever arm γ and friction coefficient μ.
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
    """Compute the effort that the mesh carries on the output side.

        F = τ_rigid + J_out·q̈ + b_oc·sgn(q̇) + b_ov·q̇

    (Mablekos-Alexiou, da Cruz and Bergeles, 2021.) J_out is the inertia of the output side of the
    drive, and b_oc and b_ov are the Coulomb and the viscous friction of its bearings.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    tau_rigid : float, array or expression
        Effort τ_rigid of the rigid bodies, gravity and external loads (N·m or N).
    qd, qdd : float, array or expression
        Velocity q̇ (rad/s or m/s) and acceleration q̈ (rad/s² or m/s²) of the joint.
    direction : float, array or expression, optional
        Value ±1 that replaces sgn(q̇) for a joint at standstill.

    Returns
    -------
    float, array or expression
        Effort F (N·m for a revolute joint, N for a sliding one).
    """
    sign = namespace_of(qd).sign(qd) if direction is None else direction
    friction = required_friction(drive)
    return tau_rigid + drive.output_inertia * qdd + friction.b_oc * sign + friction.b_ov * qd


@record
class TorqueRows:
    """Motor torque in one direction of motion, as two linear functions of F, wd and w.

    F is the effort in the mesh, and wd and w are acceleration and speed of the motor. The functions
    are tau_k = slope[k]·F + inertia·wd + coulomb + viscous·w for k = 0 and 1. The torque is exactly
    max_k tau_k for the direction +1 and min_k tau_k for −1. A torque limit in the direction of
    motion therefore consists of two linear inequalities, called rows. For the limit in the other
    direction, either row suffices.
    """

    slope: tuple[Expression, Expression]
    """Two coefficients of F, each with the shape of mu."""
    inertia: Expression
    """Inertia at constant effort, kg·m². It includes the second nut of an antibacklash screw."""
    coulomb: Expression
    """Torque that depends on the direction alone, N·m."""
    viscous: float
    """Viscous friction coefficient b_v of the bearings, N·m·s/rad."""

    def torque(self, carried: Expression, w: Expression, wd: Expression) -> Expression:
        """Compute the motor torque of one row.

        Parameters
        ----------
        carried : float, array or expression
            Torque of the mesh, slope[k]·F, N·m.
        w, wd : float, array or expression
            Motor speed (rad/s) and acceleration (rad/s²).

        Returns
        -------
        float, array or expression
            Torque, N·m.
        """
        return carried + self.inertia * wd + self.coulomb + self.viscous * w


def motor_torque_rows(
    drive: Drive, direction: Expression, mu: Expression | None = None
) -> TorqueRows:
    """Compute the two linear functions whose maximum or minimum is the motor torque.

    The planner uses them as linear limits of the torque. The torque grows with the friction
    coefficient μ in the direction of motion, so an upper bound of μ is conservative.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    direction : int, array or expression
        Direction of motion, ±1.
    mu : float, array or expression, optional
        Friction coefficient μ of the mesh. The default is the kinetic coefficient `friction.mu`.

    Returns
    -------
    TorqueRows
        Coefficients of both functions.

    Raises
    ------
    ValueError
        If `direction` is an int other than ±1.
    """
    if isinstance(direction, int) and direction not in (1, -1):
        raise ValueError(f"direction must be +1 or −1, not {direction!r}")
    friction = required_friction(drive)
    uphill, downhill = mesh_coefficients(drive, friction.mu if mu is None else mu)
    if not drive.two_nuts:
        return TorqueRows(
            (uphill, downhill), drive.input_inertia, friction.b_c * direction, friction.b_v
        )
    xp = namespace_of(direction, mu)
    # The main nut carries F − P, and the second nut P + m₂·qdd. The direction alone selects the
    # branch of each nut.
    main = xp.where(direction > 0, downhill, uphill)
    secondary = xp.where(direction > 0, uphill, downhill)
    inertia = drive.input_inertia + secondary * drive.second_nut_mass / drive.ratio
    return TorqueRows(
        (main, main),
        inertia,
        friction.b_c * direction + drive.preload * (secondary - main),
        friction.b_v,
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
    """Compute the motor torque of a drive that moves, or starts to move, in a given direction.

    It is the larger of both functions of `TorqueRows` for the direction +1, and the smaller one for
    −1.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    F : float, array or expression
        Effort in the mesh, see `output_effort`.
    w, wd : float, array or expression
        Motor speed (rad/s) and acceleration (rad/s²).
    direction : int, array or expression
        Direction of motion, ±1.
    mu : float, array or expression
        Friction coefficient of the mesh.

    Returns
    -------
    float, array or expression
        Torque, N·m.
    """
    rows = motor_torque_rows(drive, direction, mu)
    xp = namespace_of(F, w, wd, direction, mu)
    uphill = rows.slope[0] * F
    downhill = rows.slope[1] * F
    carried = xp.where(direction > 0, xp.maximum(uphill, downhill), xp.minimum(uphill, downhill))
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
    """Compute the motor torque of the exact law, which is stated at the top of this module.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    F : float, array or expression
        Output effort, see `output_effort`.
    w, wd : float, array or expression
        Motor speed (rad/s) and acceleration (rad/s²).
    direction : float, array or expression, optional
        ±1 replaces sgn(w), for example for a drive at standstill that is about to move. With 0 the
        drive holds, and the result is `holding_torque`, which is 0 for a self-locking drive.
    mu : float, array or expression, optional
        Friction coefficient of the mesh, for example `friction.mu_static` at breakaway. The default
        is the coefficient of the friction law at the speed w.

    Returns
    -------
    float, array or expression
        Torque, N·m. The arguments broadcast.
    """
    xp = namespace_of(F, w, wd, direction, mu)
    sign = xp.sign(w) if direction is None else direction
    coefficient = friction_coefficient(required_friction(drive), w) if mu is None else mu
    moving = moving_torque(drive, F, w, wd, direction=sign, mu=coefficient)
    if xp is NUMPY and np.all(sign != 0):
        return moving
    return xp.where(sign == 0, holding_torque(drive, F), moving)


def breakaway_torque(
    drive: Drive, tau_rigid: Expression, direction: Expression, mu: Expression | None = None
) -> Expression:
    """Compute the motor torque at which a drive at rest starts to move in a given direction.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    tau_rigid : float, array or expression
        Effort of the load without the friction on the output side, which is added (N·m or N).
    direction : int, array or expression
        Direction of the start, ±1.
    mu : float, array or expression, optional
        Friction coefficient of the mesh. The default is the static coefficient
        `friction.mu_static`.

    Returns
    -------
    float, array or expression
        Torque, N·m.
    """
    F = output_effort(drive, tau_rigid, 0.0, 0.0, direction)
    mu = required_friction(drive).mu_static if mu is None else mu
    return moving_torque(drive, F, 0.0, 0.0, direction=direction, mu=mu)


def holding_torque(drive: Drive, tau_rigid: Expression, mu: Expression | None = None) -> Expression:
    """Compute the motor torque of smallest magnitude that keeps a drive at rest under a load.

    A drive stays at rest while the torque lies between the breakaway torques of both directions.
    For a self-locking drive, 0 lies between them, so the holding torque is 0.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    tau_rigid : float, array or expression
        Effort of the load (N·m or N).
    mu : float, array or expression, optional
        Friction coefficient of the mesh. The default is the static coefficient
        `friction.mu_static`.

    Returns
    -------
    float, array or expression
        Torque, N·m.
    """
    lower = breakaway_torque(drive, tau_rigid, -1, mu)
    upper = breakaway_torque(drive, tau_rigid, 1, mu)
    xp = namespace_of(lower, upper)
    # The value of [lower, upper] that is nearest to 0. Jamming can exchange both ends.
    return xp.minimum(xp.maximum(0.0, xp.minimum(lower, upper)), xp.maximum(lower, upper))


def self_locking_margin(drive: Drive, mu: ArrayLike | None = None) -> tuple[Array, Array]:
    """Compute by how much a mesh exceeds the condition of self-locking.

    A mesh is self-locking if its friction angle φ exceeds the lead angle λ, which is equivalent to
    μ > cos θ_n·tan λ with the friction coefficient μ and the pressure angle θ_n. The two margins
    are μ − cos θ_n·tan λ and φ − λ. Both are positive for a self-locking mesh.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    mu : array_like, optional
        Friction coefficient μ of the mesh. The default is the kinetic coefficient.

    Returns
    -------
    coefficient_margin, angle_margin : arrays with the shape of mu
        Margin of the coefficient (dimensionless), and margin of the angle (rad).
    """
    mu = required_friction(drive).mu if mu is None else mu
    coefficient_margin = mu - np.cos(drive.pressure_angle) * np.tan(drive.lead_angle)
    angle_margin = friction_angle(drive, mu) - drive.lead_angle
    return coefficient_margin, angle_margin


def nut_contact_force(drive: Drive, F: ArrayLike, wd: ArrayLike) -> Array:
    """Compute the smaller contact force of the two half nuts of an antibacklash screw.

    With the preload P, the effort F, and the mass m₂ and acceleration q̈ of the second nut, the
    main nut carries P − F and the second nut P + m₂·q̈. If a force is ≤ 0, this nut loses contact,
    and the torque law does not hold.

    Parameters
    ----------
    drive : Drive
        Drive with its preload and the mass of the second nut.
    F : array_like
        Output effort (N), see `output_effort`.
    wd : array_like
        Motor acceleration (rad/s²). Its shape and that of F broadcast.

    Returns
    -------
    array with the broadcast shape
        Contact forces (N). They are infinite for a drive with one nut.
    """
    F = np.asarray(F, dtype=float)
    if not drive.two_nuts:
        return np.full(np.broadcast(F, wd).shape, np.inf)
    qdd = np.asarray(wd) / drive.ratio
    return np.minimum(drive.preload - F, drive.preload + drive.second_nut_mass * qdd)


def effective_inertia(
    drive: Drive, mu: Expression | None = None, direction: Expression = 1
) -> tuple[Expression, Expression]:
    """Compute the inertia at the motor shaft for an opposing and for a driving load.

    The torque law is piecewise linear in the motor acceleration, and its slopes are

        J_in + γ·tan(λ + φ)·J_out / ratio   while the load opposes the motion,
        J_in + γ·tan(λ − φ)·J_out / ratio   while the load drives it,

    with the inertia J_in of the motor side, the inertia J_out of the output side, and the
    coefficients of `mesh_coefficients`. The slopes of an antibacklash screw include its second nut.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    mu : float, array or expression, optional
        Friction coefficient of the mesh. The default is the kinetic coefficient.
    direction : float, array or expression, optional
        Direction of motion, ±1. It matters only for a drive with two nuts.

    Returns
    -------
    opposing, driving : with the shape of mu
        Inertias (kg·m²). The second one may be negative.
    """
    rows = motor_torque_rows(drive, direction, mu)
    output = drive.output_inertia / drive.ratio
    return rows.inertia + rows.slope[0] * output, rows.inertia + rows.slope[1] * output


def motor_acceleration(
    drive: Drive,
    tau: Expression,
    w: Expression,
    load: Expression,
    direction: Expression,
    mu: Expression,
) -> tuple[Expression, Expression]:
    """Compute the acceleration of a moving drive from its motor torque.

    The function solves motor_torque(F, w, wd) = tau for wd, where the effort F = load +
    J_out·wd/ratio + friction depends on wd as well. J_out is the inertia of the output side of the
    drive, and "friction" is that of its bearings. The solution is unique if the effective inertia
    at the largest friction is positive.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    tau, w : array or expression
        Motor torque in N·m and motor speed in rad/s.
    load : array or expression
        Effort on the output without its inertia and friction, N·m or N.
    direction : array or expression
        Direction of motion, ±1.
    mu : array or expression
        Friction coefficient of the mesh.

    Returns
    -------
    acceleration, effort : array or expression
        Motor acceleration wd (rad/s²), and effort F in the mesh (N·m or N).
    """
    rows = motor_torque_rows(drive, direction, mu)
    effort = output_effort(drive, load, w / drive.ratio, 0.0, direction)
    opposing_inertia, driving_inertia = effective_inertia(drive, mu, direction)
    opposed = (tau - rows.torque(rows.slope[0] * effort, w, 0.0)) / opposing_inertia
    driven = (tau - rows.torque(rows.slope[1] * effort, w, 0.0)) / driving_inertia
    output = drive.output_inertia / drive.ratio
    xp = namespace_of(opposed, driven, direction)
    # The first solution holds if its effort opposes the motion.
    wd = xp.where(direction * (effort + output * opposed) >= 0, opposed, driven)
    return wd, effort + output * wd
