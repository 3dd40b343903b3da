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
"""Four arrays of one shape, or four expressions."""


def joints_of_task(
    xp: Namespace, mechanism: Mechanism, task: FourComponents, branch: Any
) -> tuple[Any, ...]:
    """Compute the joint positions for task coordinates on one branch.

    The result is continuous along any path on the branch, because roll and spin are not wrapped.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    mechanism : Mechanism
        Axes and tool frame.
    task : four arrays or expressions
        Roll, tilt and spin in rad, depth in m.
    branch : int, array or expression
        Sign of sin(θ2 − δ), +1 or −1.

    Returns
    -------
    (θ1, θ2, θ3, θ4)
        Joint positions in rad and m, each with the shape of the task coordinates.
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

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    mechanism : Mechanism
        Axes and tool frame.
    q : four arrays or expressions
        Joint positions, rad and m.

    Returns
    -------
    (roll, tilt, spin, depth)
        Task coordinates in rad and m. The tilt has the sign of the home tilt. Roll and spin are not
        wrapped.
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
    """Compute the time derivatives of the task coordinates of `task_of_joints`.

    With x = θ2 − δ, the azimuths ζ and η, and P, Q and E of the module `mechanism`, where P² + Q² =
    sin² φ:

        dφ/dx = sin α sin β sin x / sin φ   on the home side
        dζ/dx = −E sin β / sin² φ
        dη/dx = −P sin α / sin² φ

    The rates grow without bound towards a tilt of 0 or 180°, where roll and spin are the same
    rotation. Exactly at such a tilt, the result is the derivative for θ2 at rest.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    mechanism : Mechanism
        Axes and tool frame.
    q, qd : four arrays or expressions each
        Joint positions in rad and m, and joint velocities.

    Returns
    -------
    tuple of four
        Rates of roll, tilt, spin and depth, rad/s and m/s.
    """
    mech = mechanism
    speed1, speed2, speed3, speed4 = qd
    x = q[1] - mech.delta
    c = xp.cos(x / 2.0)
    s = xp.sin(x / 2.0)
    minus = xp.sin(mech.alpha - mech.beta) * (c * c)
    plus = xp.sin(mech.alpha + mech.beta) * (s * s)
    sine2 = (minus + plus) ** 2 + (2.0 * xp.sin(mech.beta) * s * c) ** 2
    sine2 = xp.where(sine2 > 0.0, sine2, 1.0)
    sine_x = 2.0 * s * c
    roll = speed1 - xp.sin(mech.beta) * (minus - plus) / sine2 * speed2
    tilt_slope = mech.side * xp.sin(mech.alpha) * xp.sin(mech.beta) * sine_x / xp.sqrt(sine2)
    tilt = tilt_slope * speed2
    spin = speed3 + xp.sin(mech.alpha) * (minus + plus) / sine2 * speed2
    return roll, tilt, spin, mech.insertion_sign * speed4


def roll_and_tilt(
    xp: Namespace, mechanism: Mechanism, pointing: Any, around: Any
) -> tuple[Any, Any]:
    """Return roll and tilt in rad of a tool that points in a given direction.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    mechanism : Mechanism
        Axes and tool frame.
    pointing : three arrays or expressions
        Components x, y and z of the direction in `mechanism.frame`. Its length does not matter.
    around : array or expression
        √(y² + z²), which must not be zero.
    """
    side = mechanism.side
    axial, y, z = pointing
    return xp.arctan2(side * y, -side * z), side * xp.arctan2(around, axial)


def check_task(name: str, value: ArrayLike) -> Array:
    """Check task coordinates, and return them as rows (n, 4), rad and m.

    `name` is the name of the argument in messages.

    Raises
    ------
    GeometryError
        If the shape is wrong, a value is not finite, or a tilt is outside [−π, π].
    """
    task = check_rows(name, value, 4)
    rows = np.flatnonzero(np.abs(task[:, 1]) > math.pi + 1e-9)
    if rows.size:
        raise GeometryError(
            f"{name}[{rows[0]}, 1] of shape {task.shape}: tilt = {task[rows[0], 1]:.6g} rad, must "
            "be in [-pi, pi] rad; degrees are not meant"
        )
    return task


def task_from_joints(mechanism: Mechanism, q: ArrayLike, near: ArrayLike | None = None) -> Array:
    """Compute the task coordinates of joint positions, with wrapped roll and spin.

    Two sets of task coordinates describe the same pose: (ψ, φ, σ) and (ψ + π, −φ, σ + π) for roll,
    tilt and spin. The result is the one whose tilt has the sign of the home tilt.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (n, 4)
        Joint positions, rad and m.
    near : (4,) or (n, 4), optional
        Task coordinates next to which roll and spin are shifted by whole turns. Without them, roll
        and spin are in (−π, π].

    Returns
    -------
    (n, 4)
        Roll, tilt, spin in rad and depth in m.
    """
    q = check_rows("q", q, 4)
    task = np.stack(task_of_joints(NUMPY, mechanism, q.T), axis=1)
    centre = np.zeros((1, 4)) if near is None else check_rows("near", near, 4)
    for column in (0, 2):
        task[:, column] = nearest_turn(task[:, column], centre[:, column])
    return task


def task_rates(mechanism: Mechanism, q: ArrayLike, qd: ArrayLike) -> Array:
    """Return the rates of roll, tilt, spin and depth (n, 4) in rad/s and m/s.

    The rates of roll and spin grow without bound as the tilt approaches 0 or 180°, where both are
    the same rotation.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q, qd : (n, 4)
        Joint positions in rad and m, and joint velocities.
    """
    q = check_rows("q", q, 4)
    qd = check_rows("qd", qd, 4)
    return np.stack(task_rates_of_joints(NUMPY, mechanism, q.T, qd.T), axis=1)


def pose_from_task(mechanism: Mechanism, task: ArrayLike) -> tuple[Array, Array]:
    """Compute the tool pose for task coordinates.

    With roll ψ, tilt φ, spin σ, and the home roll ψ_h and home tilt φ_h, the orientation is R =
    e^{ω̂1 ψ} e^{t̂ φ} e^{−t̂ φ_h} e^{−ω̂1 ψ_h} R_0 Rz(σ), where R_0 is `tool_home`.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    task : (n, 4)
        Roll, tilt and spin in rad, depth in m. The tilt may have either sign.

    Returns
    -------
    R : (n, 3, 3)
        Rotations from the tool frame to the base frame.
    p : (n, 3)
        Tip positions in the base frame, m.
    """
    task = check_task("task", task)
    pointing = rotation(mechanism.omega1, task[:, 0]) @ rotation(mechanism.tilt_axis, task[:, 1])
    spin = rotation((0.0, 0.0, 1.0), task[:, 2])
    theta4 = mechanism.insertion_sign * task[:, 3:]
    return pointing @ mechanism.tool_on_omega1 @ spin, (pointing @ mechanism.omega1) * theta4


def tip_from_task(mechanism: Mechanism, task: Array) -> Array:
    """Return the tip positions (n, 3) in m for task coordinates (n, 4), rad and m.

    The result is that of `pose_from_task` without the orientation. The formula is shorter because
    the tilt axis is perpendicular to ω1.
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
    """Return the joint positions (4, 1) for task coordinates on one branch, in CasADi.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    task : (4, 1)
        Roll, tilt and spin in rad, depth in m. Roll and spin are not wrapped.
    branch : int
        Sign of sin(θ2 − δ), +1 or −1. δ (`mechanism.delta`) is the θ2 with the largest cos φ.
    reference : (4, 1), optional
        Joint positions, rad and m. Each revolute joint is moved next to its reference by whole
        turns.

    Returns
    -------
    (4, 1) expression
        Joint positions in rad and m, which are continuous along any path inside the workspace. They
        are NaN outside. Their derivatives are infinite at the boundary, like those of the
        mechanism.
    """
    import casadi

    joints = list(joints_of_task(casadi_namespace(), mechanism, casadi.vertsplit(task), branch))
    if reference is not None:
        for i in range(3):
            turns = casadi.floor((reference[i] - joints[i]) / FULL_TURN + 0.5)
            joints[i] = joints[i] + FULL_TURN * turns
    return casadi.vertcat(*joints)


def task_of_tip_symbolic(
    mechanism: Mechanism, tip: "casadi.SX", roll: "casadi.SX", spin: "casadi.SX"
) -> "casadi.SX":
    """Return the task coordinates (4, 1) of a tool whose tip is at a given point, in CasADi.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    tip : (3, 1)
        Tip position in the base frame, m. The tip is beyond the remote centre (depth > 0).
    roll : expression
        The resulting roll is within half a turn of this angle, rad.
    spin : expression
        Spin of the tool, rad, which the tip does not determine.
    """
    import casadi

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
    """Return the roll in rad of a tool whose tip is at a point (3,) beyond the remote centre, m."""
    pointing = mechanism.insertion_sign * (mechanism.frame.T @ tip)
    around = np.hypot(pointing[1], pointing[2])
    roll, _ = roll_and_tilt(NUMPY, mechanism, pointing, around)
    return float(roll)


def task_from_joints_symbolic(mechanism: Mechanism, q: "casadi.SX") -> "casadi.SX":
    """Return roll, tilt, spin and depth (4, 1) for joint positions (4, 1), in CasADi.

    The tilt has the sign of the home tilt. Roll and spin are not wrapped.
    """
    import casadi

    return casadi.vertcat(*task_of_joints(casadi_namespace(), mechanism, casadi.vertsplit(q)))


def task_rates_symbolic(mechanism: Mechanism, q: "casadi.SX", qd: "casadi.SX") -> "casadi.SX":
    """Return the rates of roll, tilt, spin and depth (4, 1) in rad/s and m/s, in CasADi.

    `q` and `qd` (4, 1) are joint positions and joint velocities on either branch.
    """
    import casadi

    positions = casadi.vertsplit(q)
    velocities = casadi.vertsplit(qd)
    rates = task_rates_of_joints(casadi_namespace(), mechanism, positions, velocities)
    return casadi.vertcat(*rates)


def joint_rates(mechanism: Mechanism, q: Array, rate: Array) -> Array:
    """Return the joint velocities (4,) that change the task coordinates at given rates.

    The result is exactly zero for rates of zero, also where the Jacobian is singular.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (4,)
        Joint positions, rad and m.
    rate : (4,)
        Rates of roll, tilt, spin and depth, rad/s and m/s.
    """
    if not np.any(rate):
        return np.zeros(4)
    jacobian = task_rates(mechanism, np.tile(q, (4, 1)), np.eye(4)).T
    qd = np.asarray(np.linalg.solve(jacobian, rate), dtype=float)
    qd[np.abs(qd) < 1e-12 * np.abs(qd).max()] = 0.0
    return qd
