"""Compute joint efforts and motor torques for users of the library."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.arguments import checked
from ssm_planner.dynamics import motors
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics import check_rows
from ssm_planner.problem import Robot
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array


@checked
def inverse_dynamics(robot: Robot, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
    """Compute the joint efforts that move the rigid bodies.

    The efforts are τ = M(q) q̈ + C(q, q̇) q̇ + g(q), with the mass matrix M, the Coriolis and
    centrifugal effort C q̇, and the effort of gravity g.

    They are computed by the recursive Newton–Euler algorithm (Featherstone, Rigid Body Dynamics
    Algorithms, 2008, §5.3). Friction and the inertia of the motors are not included. See
    `motor_torque`.

    Parameters
    ----------
    robot : Robot
        Robot whose bodies move.
    q, qd, qdd : (4,) or (n, 4)
        Joint positions, velocities and accelerations in rad, rad/s and rad/s² (joint 4: m, m/s and
        m/s²).

    Returns
    -------
    (4,) or (n, 4) array
        Efforts in N·m, and in N for the translation.

    Raises
    ------
    GeometryError
        If a shape is wrong or a value is not finite.

    Examples
    --------
    >>> from ssm_planner import inverse_dynamics, load_robot
    >>> efforts = inverse_dynamics(load_robot("vitreoretinal"), [0, 0, 0, 0], [0] * 4, [0] * 4)
    >>> efforts.shape
    (4,)
    """
    samples = _samples(q, qd, qdd)
    efforts = RigidBody.from_robot(robot).inverse_dynamics(samples.q, samples.qd, samples.qdd)
    return efforts if np.ndim(q) == 2 else efforts[0]


@checked
def motor_torque(robot: Robot, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
    """Return the motor torques of a joint motion, with the friction of the drives.

    A joint at rest that accelerates starts with static friction. A joint without velocity and
    acceleration is held by its self-locking drive, and its motor torque is 0.

    Parameters
    ----------
    robot : Robot
        Robot with drives.
    q, qd, qdd : (4,) or (n, 4)
        Joint positions, velocities and accelerations in rad, rad/s and rad/s² (joint 4: m, m/s and
        m/s²).

    Returns
    -------
    (4,) or (n, 4) array
        Torques in N·m. NaN for joints without a drive.

    Raises
    ------
    GeometryError
        If a shape is wrong or a value is not finite.

    Examples
    --------
    >>> from ssm_planner import load_robot, motor_torque
    >>> robot = load_robot("vitreoretinal")
    >>> motor_torque(robot, [0, 0, 0, 0], [0] * 4, [0] * 4)[:2].tolist()
    [0.0, 0.0]
    """
    samples = _samples(q, qd, qdd)
    body = RigidBody.from_robot(robot)
    direction, breakaway = motors.motion_directions(robot, samples, 1)
    torque = motors.motor_motion(robot, body, samples, direction, breakaway).torque
    return torque if np.ndim(q) == 2 else torque[0]


def _samples(q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Samples:
    """Convert the arguments of a public function to samples without times and jerks.

    Parameters
    ----------
    q, qd, qdd : (4,) or (n, 4) array-like
        Joint positions, velocities and accelerations in rad, rad/s and rad/s² (joint 4: m, m/s and
        m/s²).

    Returns
    -------
    Samples
        n samples. Their times and jerks are 0.

    Raises
    ------
    GeometryError
        If a shape is wrong, a value is not finite, or the arguments differ in length.
    """
    rows = [check_rows(name, x, 4) for name, x in (("q", q), ("qd", qd), ("qdd", qdd))]
    if len({len(values) for values in rows}) > 1:
        lengths = ", ".join(str(len(values)) for values in rows)
        raise GeometryError(f"q, qd and qdd have different lengths: {lengths}")
    return Samples(np.zeros(len(rows[0])), rows[0], rows[1], rows[2], np.zeros_like(rows[0]))
