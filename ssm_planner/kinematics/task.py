"""Convert between task coordinates (roll, tilt, spin, depth) and joints in closed form.

The module `mechanism` explains the symbols. `joints_of_task`, `task_of_joints` and
`task_rates_of_joints` contain each equation once, for NumPy arrays and CasADi expressions; the
argument `xp` selects the library. The other functions apply them to NumPy batches (n, 4) or, if
their names end with _symbolic, to CasADi vectors (4, 1).
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen import NUMPY, Namespace, casadi_namespace
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.mechanism import (
    Mechanism,
    azimuths,
    elbow_half_angle_squares,
    tilt_magnitude,
)
from ssm_planner.kinematics.rotations import check_rows, rotation
from ssm_planner.kinematics.solutions import FULL_TURN, nearest_turn
from ssm_planner.typing import Array

if TYPE_CHECKING:
    import casadi

FourComponents = Sequence[Any] | Array
"""The four task coordinates or joint quantities: arrays of one shape, or CasADi expressions."""


def joints_of_task(
    xp: Namespace, mechanism: Mechanism, task: FourComponents, branch: Any
) -> tuple[Any, ...]:
    """Compute the joint positions for task coordinates on one branch (paper, §II-C).

    With the roll ψ, the tilt φ, the spin σ and the symbols of the module `mechanism`,

        θ1 = ψ − ζ − side · π/2 + h
        θ2 = δ + 2 atan2(branch · S, C)
        θ3 = σ + η − spin_offset − h
        θ4 = insertion_sign · depth.

    `elbow_half_angle_squares` gives C² and S² for the tilt, and `azimuths` gives ζ and η. The angle
    h is 0 if φ has the sign `side` of the home tilt, and π otherwise, because (ψ, φ, σ) is the same
    pose as (ψ + π, −φ, σ − π). The result is continuous along any path on the branch, because the
    formulas do not reduce roll and spin to one turn.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    mechanism : Mechanism
        Axes and tool frame.
    task : four arrays or expressions
        Roll, tilt and spin (rad), and depth (m).
    branch : int, array or expression
        Sign of sin(θ2 − δ), +1 or −1, which selects one of the two solutions.

    Returns
    -------
    theta1, theta2, theta3, theta4 : array or expression
        Joint positions (rad, and m for joint 4), each with the shape of the task coordinates. For a
        tilt outside the workspace, CasADi expressions are NaN, and arrays contain the θ2 of the
        nearer end of the tilt range.
    """
    roll, tilt, spin, depth = task
    mech = mechanism
    cosine2, sine2 = elbow_half_angle_squares(
        xp, mech.alpha, mech.beta, xp.cos(tilt / 2.0), xp.sin(tilt / 2.0)
    )
    c = xp.sqrt(xp.nonnegative(cosine2))
    s = branch * xp.sqrt(xp.nonnegative(sine2))
    zeta, eta = azimuths(xp, mech.alpha, mech.beta, c, s)
    half_turn = xp.where(tilt * mech.side >= 0.0, 0.0, math.pi)
    theta1 = roll - zeta - mech.side * math.pi / 2.0 + half_turn
    theta2 = mech.delta + 2.0 * xp.arctan2(s, c)
    theta3 = spin + eta - mech.spin_offset - half_turn
    return theta1, theta2, theta3, mech.insertion_sign * depth


def task_of_joints(xp: Namespace, mechanism: Mechanism, q: FourComponents) -> tuple[Any, ...]:
    """Compute the task coordinates of joint positions.

    With the azimuths ζ and η of `azimuths` and the magnitude |φ| of `tilt_magnitude`,

        roll = θ1 + ζ + side · π/2
        tilt = side · |φ|
        spin = θ3 − η + spin_offset
        depth = insertion_sign · θ4,

    where `side` is the sign of the home tilt. The formulas do not reduce roll and spin to one turn.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    mechanism : Mechanism
        Axes and tool frame.
    q : four arrays or expressions
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    roll, tilt, spin, depth : array or expression
        Task coordinates (rad, and m for the depth). The tilt has the sign of the home tilt.
    """
    theta1, theta2, theta3, theta4 = q
    x = theta2 - mechanism.delta
    zeta, eta = azimuths(xp, mechanism.alpha, mechanism.beta, xp.cos(x / 2.0), xp.sin(x / 2.0))
    roll = theta1 + zeta + mechanism.side * math.pi / 2.0
    tilt = mechanism.side * tilt_magnitude(xp, mechanism.alpha, mechanism.beta, x)
    return roll, tilt, theta3 - eta + mechanism.spin_offset, mechanism.insertion_sign * theta4


def task_rates_of_joints(
    xp: Namespace, mechanism: Mechanism, q: FourComponents, qd: FourComponents
) -> tuple[Any, ...]:
    """Compute the time derivatives of the task coordinates.

    With x = θ2 − δ, the tilt φ and the azimuths ζ and η, the derivatives follow from

        P = sin(α − β) cos²(x/2) + sin(α + β) sin²(x/2),
        E = sin(α − β) cos²(x/2) − sin(α + β) sin²(x/2),
        Q = sin β sin x,   P² + Q² = sin² φ:

        dφ/dx = sin α sin β sin x / sin φ   on the home side,
        dζ/dx = −E sin β / sin² φ,
        dη/dx = −P sin α / sin² φ.

    The rates grow without bound towards a tilt of 0 or 180°, where roll and spin are the same
    rotation. Exactly at such a tilt, the contribution of joint 2 is not defined. The function then
    divides by 1 in place of sin² φ, which is exact if joint 2 is at rest.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    mechanism : Mechanism
        Axes and tool frame.
    q : four arrays or expressions
        Joint positions (rad, and m for joint 4).
    qd : four arrays or expressions
        Joint velocities (rad/s, and m/s for joint 4).

    Returns
    -------
    roll_rate, tilt_rate, spin_rate, depth_rate : array or expression
        Rates of the task coordinates (rad/s, and m/s for the depth).
    """
    mech = mechanism
    speed1, speed2, speed3, speed4 = qd
    x = q[1] - mech.delta
    c = xp.cos(x / 2.0)
    s = xp.sin(x / 2.0)
    sine_x = 2.0 * s * c
    # P and E of the docstring are the sum and the difference of these terms.
    inner_term = xp.sin(mech.alpha - mech.beta) * (c * c)
    outer_term = xp.sin(mech.alpha + mech.beta) * (s * s)
    tilt_sine2 = (inner_term + outer_term) ** 2 + (2.0 * xp.sin(mech.beta) * s * c) ** 2
    tilt_sine2 = xp.where(tilt_sine2 > 0.0, tilt_sine2, 1.0)
    roll = speed1 - xp.sin(mech.beta) * (inner_term - outer_term) / tilt_sine2 * speed2
    tilt_slope = mech.side * xp.sin(mech.alpha) * xp.sin(mech.beta) * sine_x / xp.sqrt(tilt_sine2)
    tilt = tilt_slope * speed2
    spin = speed3 + xp.sin(mech.alpha) * (inner_term + outer_term) / tilt_sine2 * speed2
    return roll, tilt, spin, mech.insertion_sign * speed4


def roll_and_tilt(
    xp: Namespace, mechanism: Mechanism, pointing: Any, around: Any
) -> tuple[Any, Any]:
    """Compute the roll and the tilt of a tool that points in a given direction.

    The tool axis is cos φ ω1 + sin φ (sin ψ t − cos ψ n) with the roll ψ, the tilt φ and the
    vectors of the module `mechanism`. The components x, y and z of a direction along ω1, t and n
    therefore give

        ψ = atan2(side · y, −side · z),   φ = side · atan2(√(y² + z²), x),

    where `side` is the sign of the home tilt.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    mechanism : Mechanism
        Axes and tool frame.
    pointing : three arrays or expressions
        Components x, y and z of the direction in `mechanism.frame`. Its length does not matter.
    around : array or expression
        √(y² + z²). If it is zero, the direction does not determine the roll.

    Returns
    -------
    roll, tilt : array or expression
        Roll ψ and tilt φ (rad). The tilt has the sign of the home tilt.
    """
    side = mechanism.side
    axial, y, z = pointing
    return xp.arctan2(side * y, -side * z), side * xp.arctan2(around, axial)


def check_task(name: str, value: ArrayLike) -> Array:
    """Check task coordinates, and return them as an array with one row for each point.

    Parameters
    ----------
    name : str
        Name of the argument. The error message contains it.
    value : (4,) or (n, 4) array-like
        Roll, tilt and spin (rad), and depth (m).

    Returns
    -------
    (n, 4) array
        The same coordinates. A single point becomes one row.

    Raises
    ------
    GeometryError
        If the shape is wrong, a value is not finite, or a tilt is outside [−π, π].
    """
    task = check_rows(name, value, 4)
    # The tolerance permits a rounded π.
    rows = np.flatnonzero(np.abs(task[:, 1]) > math.pi + 1e-9)
    if rows.size:
        raise GeometryError(
            f"{name}[{rows[0]}, 1] of shape {task.shape}: tilt = {task[rows[0], 1]:.6g} rad, must "
            "be in [-pi, pi] rad; degrees are not meant"
        )
    return task


def task_from_joints(mechanism: Mechanism, q: ArrayLike, near: ArrayLike | None = None) -> Array:
    """Compute the task coordinates of joint positions, with roll and spin reduced to one turn.

    Two triples of roll, tilt and spin describe the same pose: (ψ, φ, σ) and (ψ + π, −φ, σ + π). The
    result is the one whose tilt has the sign of the home tilt.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (4,) or (n, 4) array
        Joint positions (rad, and m for joint 4).
    near : (4,) or (n, 4) array, optional
        Task coordinates (rad, and m for the depth) to which roll and spin are moved by whole turns
        as close as possible. Without them, roll and spin are in (−π, π].

    Returns
    -------
    (n, 4) array
        Roll, tilt and spin (rad), and depth (m).

    Raises
    ------
    GeometryError
        If a shape is wrong or a value is not finite.
    """
    q = check_rows("q", q, 4)
    task = np.stack(task_of_joints(NUMPY, mechanism, q.T), axis=1)
    centre = np.zeros((1, 4)) if near is None else check_rows("near", near, 4)
    for column in (0, 2):
        task[:, column] = nearest_turn(task[:, column], centre[:, column])
    return task


def task_rates(mechanism: Mechanism, q: ArrayLike, qd: ArrayLike) -> Array:
    """Compute the rates of the task coordinates for joint positions and velocities.

    See the equations of `task_rates_of_joints`. The rates of roll and spin grow without bound as
    the tilt approaches 0 or 180°, where both are the same rotation.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (n, 4) array
        Joint positions (rad, and m for joint 4).
    qd : (n, 4) array
        Joint velocities (rad/s, and m/s for joint 4).

    Returns
    -------
    (n, 4) array
        Rates of roll, tilt, spin and depth (rad/s, and m/s for the depth).
    """
    q = check_rows("q", q, 4)
    qd = check_rows("qd", qd, 4)
    return np.stack(task_rates_of_joints(NUMPY, mechanism, q.T, qd.T), axis=1)


def pose_from_task(mechanism: Mechanism, task: ArrayLike) -> tuple[Array, Array]:
    """Compute the tool pose for task coordinates.

    The tool first turns about its own axis by the spin σ, then tilts by φ about the axis t, and
    then rolls by ψ about ω1. With the home roll ψ_h, the home tilt φ_h and the tool frame R_0 at q
    = 0 (`tool_home`), the orientation R and the tip position p are

        R = e^{ω̂1 ψ} e^{t̂ φ} e^{−t̂ φ_h} e^{−ω̂1 ψ_h} R_0 Rz(σ)
        p = θ4 e^{ω̂1 ψ} e^{t̂ φ} ω1   with θ4 = insertion_sign · depth.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    task : (n, 4) array
        Roll, tilt and spin (rad), and depth (m). The tilt may have either sign.

    Returns
    -------
    R : (n, 3, 3) array
        Rotations from the tool frame to the base frame.
    p : (n, 3) array
        Tip positions in the base frame (m).
    """
    task = check_task("task", task)
    pointing = rotation(mechanism.omega1, task[:, 0]) @ rotation(mechanism.tilt_axis, task[:, 1])
    spin = rotation((0.0, 0.0, 1.0), task[:, 2])
    theta4 = mechanism.insertion_sign * task[:, 3:]
    return pointing @ mechanism.tool_on_omega1 @ spin, (pointing @ mechanism.omega1) * theta4


def tip_from_task(mechanism: Mechanism, task: Array) -> Array:
    """Compute the tip positions for task coordinates.

    The result is the position p of `pose_from_task`. With the roll ψ, the tilt φ and the rows a, b
    and c of `Mechanism.tip_axes`, it is

        p = insertion_sign · depth · (cos φ a + sin φ (cos ψ b + sin ψ c)).

    This formula needs no rotation matrices, because the tilt axis is perpendicular to ω1.

    Parameters
    ----------
    mechanism : Mechanism
        Axes of the robot.
    task : (n, 4) array
        Roll, tilt and spin (rad), and depth (m). The spin does not matter.

    Returns
    -------
    (n, 3) array
        Tip positions in the base frame (m).
    """
    roll, tilt, _, depth = np.ascontiguousarray(task.T)
    axial, across, normal = mechanism.tip_axes[:, :, None]
    # The rows are contiguous in memory, which makes the operations fast.
    lateral = np.cos(roll) * across + np.sin(roll) * normal
    pointing = np.cos(tilt) * axial + np.sin(tilt) * lateral
    return (mechanism.insertion_sign * depth * pointing).T


def joints_from_task_symbolic(
    mechanism: Mechanism, task: "casadi.SX", branch: int, reference: Any | None = None
) -> "casadi.SX":
    """Return the joint positions for task coordinates on one branch as a CasADi expression.

    See the equations of `joints_of_task`.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    task : (4, 1) expression
        Roll, tilt and spin (rad), and depth (m).
    branch : int
        Sign of sin(θ2 − δ), +1 or −1. The angle δ (`Mechanism.delta`) is the θ2 with the smallest
        angle between ω1 and the tool axis.
    reference : (4, 1) array or expression, optional
        Joint positions (rad, and m for joint 4). Each revolute joint is moved by whole turns as
        close as possible to its reference.

    Returns
    -------
    (4, 1) expression
        Joint positions (rad, and m for joint 4). Without a reference, they are continuous along any
        path inside the workspace. They are NaN outside the workspace. At its boundary, their
        derivatives are infinite, because the mechanism is singular there.
    """
    import casadi  # It takes long to import.

    joints = list(joints_of_task(casadi_namespace(), mechanism, casadi.vertsplit(task), branch))
    if reference is not None:
        for i in range(3):
            turns = casadi.floor((reference[i] - joints[i]) / FULL_TURN + 0.5)
            joints[i] = joints[i] + FULL_TURN * turns
    return casadi.vertcat(*joints)


def task_of_tip_symbolic(
    mechanism: Mechanism, tip: "casadi.SX", roll: "casadi.SX", spin: "casadi.SX"
) -> "casadi.SX":
    """Return the task coordinates of a tool whose tip is at a given point as a CasADi expression.

    The tip determines roll, tilt and depth by `roll_and_tilt`, but not the spin. The roll is
    computed relative to the argument `roll`, so that atan2 has no jump close to this angle.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    tip : (3, 1) expression
        Tip position in the base frame (m). The tip is beyond the remote centre (depth > 0).
    roll : expression
        Angle (rad). The resulting roll is within half a turn of it.
    spin : expression
        Spin of the tool (rad).

    Returns
    -------
    (4, 1) expression
        Roll, tilt and spin (rad), and depth (m).
    """
    import casadi  # It takes long to import.

    axial, y, z = casadi.vertsplit(mechanism.insertion_sign * casadi.DM(mechanism.frame.T) @ tip)
    # In a frame that is rolled by `roll`, the result is near the angle 0.
    rolled_y = casadi.cos(roll) * y + casadi.sin(roll) * z
    rolled_z = casadi.cos(roll) * z - casadi.sin(roll) * y
    around = casadi.sqrt(rolled_y * rolled_y + rolled_z * rolled_z)
    roll_offset, tilt = roll_and_tilt(
        casadi_namespace(), mechanism, (axial, rolled_y, rolled_z), around
    )
    return casadi.vertcat(roll + roll_offset, tilt, spin, casadi.norm_2(tip))


def roll_of_tip(mechanism: Mechanism, tip: Array) -> float:
    """Compute the roll of a tool whose tip is at a given point beyond the remote centre.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    tip : (3,) array
        Tip position in the base frame (m), with depth > 0.

    Returns
    -------
    float
        Roll in [−π, π] (rad).
    """
    pointing = mechanism.insertion_sign * (mechanism.frame.T @ tip)
    around = np.hypot(pointing[1], pointing[2])
    roll, _ = roll_and_tilt(NUMPY, mechanism, pointing, around)
    return float(roll)


def task_from_joints_symbolic(mechanism: Mechanism, q: "casadi.SX") -> "casadi.SX":
    """Return the task coordinates of joint positions as a CasADi expression.

    See the equations of `task_of_joints`.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (4, 1) expression
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    (4, 1) expression
        Roll, tilt and spin (rad), and depth (m). The tilt has the sign of the home tilt. Roll and
        spin are not reduced to one turn.
    """
    import casadi  # It takes long to import.

    return casadi.vertcat(*task_of_joints(casadi_namespace(), mechanism, casadi.vertsplit(q)))


def task_rates_symbolic(mechanism: Mechanism, q: "casadi.SX", qd: "casadi.SX") -> "casadi.SX":
    """Return the rates of the task coordinates as a CasADi expression.

    See the equations of `task_rates_of_joints`, which hold on both branches.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (4, 1) expression
        Joint positions (rad, and m for joint 4).
    qd : (4, 1) expression
        Joint velocities (rad/s, and m/s for joint 4).

    Returns
    -------
    (4, 1) expression
        Rates of roll, tilt, spin and depth (rad/s, and m/s for the depth).
    """
    import casadi  # It takes long to import.

    positions = casadi.vertsplit(q)
    velocities = casadi.vertsplit(qd)
    rates = task_rates_of_joints(casadi_namespace(), mechanism, positions, velocities)
    return casadi.vertcat(*rates)


def joint_rates(mechanism: Mechanism, q: Array, rate: Array) -> Array:
    """Compute the joint velocities that change the task coordinates at given rates.

    The function solves J q̇ = rate, where J is the matrix (4, 4) of the derivatives of the task
    coordinates with respect to the joint positions (`task_rates`). Velocities below 1e-12 times the
    largest one are rounding errors, and become zero. Rates of zero give velocities of exactly zero,
    also where J is singular.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (4,) array
        Joint positions (rad, and m for joint 4).
    rate : (4,) array
        Rates of roll, tilt, spin and depth (rad/s, and m/s for the depth).

    Returns
    -------
    (4,) array
        Joint velocities (rad/s, and m/s for joint 4).
    """
    if not np.any(rate):
        return np.zeros(4)
    jacobian = task_rates(mechanism, np.tile(q, (4, 1)), np.eye(4)).T
    qd = np.asarray(np.linalg.solve(jacobian, rate), dtype=float)
    qd[np.abs(qd) < 1e-12 * np.abs(qd).max()] = 0.0
    return qd
