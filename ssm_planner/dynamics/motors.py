"""Compute direction, torque and effort of every drive in a motion, by the exact friction law.

`motor_motion` evaluates sampled motions, and `motor_torque_symbolic` gives the same quantities as
CasADi expressions. Friction opposes the motion, so both need the direction in which each joint
moves, or starts to move, from `motion_directions`. The effort in the mesh is the torque or force
between the two sliding parts of a drive, such as worm and wheel, on the output side.
"""

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from ssm_planner.codegen import namespace_of
from ssm_planner.dynamics.friction import (
    breakaway_coefficient,
    friction_coefficient,
    required_friction,
)
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.problem import Drive, Joint, Motor, Robot
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array, Expression, record

REST_FRACTION = 1e-9
"""Fraction of the velocity limit below which a joint counts as resting."""


def motorised_joints(joints: Sequence[Joint]) -> Iterator[tuple[int, Drive, Motor]]:
    """Yield the joints that have a drive and a motor.

    Parameters
    ----------
    joints : sequence of Joint
        Joints of a robot.

    Yields
    ------
    index : int
        Index of the joint.
    drive, motor : Drive, Motor
        Its drive and its motor.
    """
    for i, joint in enumerate(joints):
        if joint.drive is not None and joint.motor is not None:
            yield i, joint.drive, joint.motor


def joints_without_motor(joints: Sequence[Joint]) -> list[int]:
    """Return the indices of the joints that lack a drive or a motor.

    Parameters
    ----------
    joints : sequence of Joint
        Joints of a robot.

    Returns
    -------
    list of int
        Indices in ascending order.
    """
    complete = {i for i, *_ in motorised_joints(joints)}
    return [i for i in range(len(joints)) if i not in complete]


@record
class MotorMotion:
    """Motion of the motor shafts at n instants, with one column for each joint.

    Columns of joints without a drive are NaN.

    Attributes
    ----------
    angle, speed, acceleration : (n, 4) arrays
        Angle (rad), speed (rad/s) and acceleration (rad/s²) of the motor.
    torque : (n, 4) array
        Motor torque, N·m.
    effort : (n, 4) array
        Effort in the mesh, N·m, or N for a sliding joint.
    """

    angle: Array
    speed: Array
    acceleration: Array
    torque: Array
    effort: Array


def motor_motion(
    robot: Robot, body: RigidBody, samples: Samples, direction: Array, breakaway: Array
) -> MotorMotion:
    """Compute the motion and the torque of every motor for n samples of a joint motion.

    Parameters
    ----------
    robot : Robot
        Robot that performs the motion.
    body : RigidBody
        Dynamics of the robot.
    samples : Samples
        Sampled motion.
    direction : (n, 4)
        Direction of each joint, +1 or −1, or 0 for a joint that rests while its drive holds it.
        See `motion_directions`.
    breakaway : (n, 4) bool
        True where the joint starts to move, so that the static friction coefficient applies.

    Returns
    -------
    MotorMotion
        Angle, speed, acceleration and torque of each motor, and the effort in its mesh.
    """
    tau = body.inverse_dynamics(samples.q, samples.qd, samples.qdd)
    ratio = np.array(
        [np.nan if joint.drive is None else joint.drive.ratio for joint in robot.joints]
    )
    torque = np.full(tau.shape, np.nan)
    effort = np.full(tau.shape, np.nan)
    for i, joint in enumerate(robot.joints):
        if joint.drive is not None:
            torque[:, i], effort[:, i] = drive_torque(
                joint.drive,
                tau[:, i],
                samples.qd[:, i],
                samples.qdd[:, i],
                direction[:, i],
                breakaway=breakaway[:, i],
            )
    return MotorMotion(ratio * samples.q, ratio * samples.qd, ratio * samples.qdd, torque, effort)


def motor_torque_symbolic(
    robot: Robot, q: ca.SX, qd: ca.SX, qdd: ca.SX, direction: ca.SX, breakaway: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Build CasADi expressions of the motor torques of a robot.

    Parameters
    ----------
    robot : Robot
        Robot with its drives.
    q, qd, qdd : (4,)
        Joint positions, velocities and accelerations in rad, rad/s and rad/s² (joint 4: m, m/s and
        m/s²).
    direction : (4,)
        Direction of each joint, +1 or −1, or 0 for a joint that rests while its drive holds it.
    breakaway : (4,)
        1 for a joint that starts to move, so that the static friction coefficient applies, else 0.

    Returns
    -------
    tau, torque, effort : (4,)
        Efforts of the rigid bodies (N·m, N), motor torques (N·m) and efforts in the mesh (N·m, N).
        Torques and mesh efforts of joints without a drive are 0.
    """
    tau = RigidBody.from_robot(robot).symbolic(q, qd, qdd)
    torque = ca.SX.zeros(4)
    effort = ca.SX.zeros(4)
    for i, joint in enumerate(robot.joints):
        if joint.drive is not None:
            torque[i], effort[i] = drive_torque(
                joint.drive, tau[i], qd[i], qdd[i], direction[i], breakaway=breakaway[i]
            )
    return tau, torque, effort


def drive_torque(
    drive: Drive,
    tau_rigid: Expression,
    qd: Expression,
    qdd: Expression,
    direction: Expression,
    *,
    breakaway: Expression,
) -> tuple[Expression, Expression]:
    """Compute the motor torque and the mesh effort of one drive.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    tau_rigid : array or expression
        Effort of the rigid bodies on the joint, N·m or N.
    qd : array or expression
        Velocity of the joint, rad/s or m/s.
    qdd : array or expression
        Acceleration of the joint, rad/s² or m/s².
    direction : array or expression
        +1, −1, or 0 for a drive that holds.
    breakaway : array or expression
        True or 1 where the drive starts to move, so that the static friction coefficient applies.

    Returns
    -------
    torque, effort : array or expression with the shape of qd
        Motor torque (N·m), and effort in the mesh (N·m or N).
    """
    friction = required_friction(drive)
    # Speed and acceleration of the motor.
    w = drive.ratio * qd
    wd = drive.ratio * qdd
    select = namespace_of(breakaway, qd).where
    mu = select(breakaway, breakaway_coefficient(friction, w), friction_coefficient(friction, w))
    effort = output_effort(drive, tau_rigid, qd, qdd, direction)
    return motor_torque(drive, effort, w, wd, direction=direction, mu=mu), effort


def motion_directions(robot: Robot, samples: Samples, side: int) -> tuple[Array, Array]:
    """Determine in which direction every joint moves, and whether it starts from rest.

    Parameters
    ----------
    robot : Robot
        Robot with the limits of its joints.
    samples : Samples
        Motion at n instants.
    side : int
        For joints at rest, +1 selects the instant just after each sample, and −1 the instant just
        before it, see `joint_direction`.

    Returns
    -------
    direction : (n, 4) array
        +1, −1, or 0 for a joint that does not move.
    breakaway : (n, 4) array
        True or 1 where the joint is at rest and starts.
    """
    direction = []
    breakaway = []
    for i, joint in enumerate(robot.joints):
        sign, starts = joint_direction(
            joint, samples.qd[:, i], samples.qdd[:, i], samples.qddd[:, i], side
        )
        direction.append(sign)
        breakaway.append(starts)
    return np.stack(direction, axis=1), np.stack(breakaway, axis=1)


def motion_directions_symbolic(
    robot: Robot, qd: ca.SX, qdd: ca.SX, qddd: ca.SX, side: int
) -> tuple[ca.SX, ca.SX]:
    """Build CasADi expressions of the direction of every joint and of whether it starts from rest.

    Parameters
    ----------
    robot : Robot
        Robot with the limits of its joints.
    qd, qdd, qddd : (4,)
        Joint velocities, accelerations and jerks in rad/s, rad/s² and rad/s³ (joint 4: m/s, m/s²
        and m/s³).
    side : int
        For joints at rest, +1 selects the instant just after, and −1 the one just before, see
        `joint_direction`.

    Returns
    -------
    direction, breakaway : (4,)
        +1, −1, or 0 for a joint that does not move, and 1 for a joint that starts from rest, else
        0.
    """
    direction = ca.SX.zeros(4)
    breakaway = ca.SX.zeros(4)
    for i, joint in enumerate(robot.joints):
        direction[i], breakaway[i] = joint_direction(joint, qd[i], qdd[i], qddd[i], side)
    return direction, breakaway


def joint_direction(
    joint: Joint, qd: Expression, qdd: Expression, qddd: Expression, side: int
) -> tuple[Expression, Expression]:
    """Determine in which direction a joint moves, and whether it starts from rest.

    For a joint at rest, the acceleration or the jerk determines the direction.

    Parameters
    ----------
    joint : Joint
        Joint with its limits, which define the speeds that count as rest.
    qd, qdd, qddd : float, array or expression
        Velocity (rad/s or m/s), acceleration (rad/s² or m/s²) and jerk (rad/s³ or m/s³) of the
        joint.
    side : int
        For a joint at rest, +1 selects the direction just after the instant, where a start has
        static friction. −1 selects the direction just before it, at which the joint may arrive.

    Returns
    -------
    direction : float, array or expression
        +1, −1, or 0 for a joint that does not move.
    starts : bool, array or expression
        True if the joint is at rest and starts.
    """
    xp = namespace_of(qd, qdd, qddd)
    max_velocity = joint.velocity
    max_acceleration = joint.acceleration
    is_at_rest = abs(qd) <= REST_FRACTION * max_velocity
    # Just after or before a rest, the velocity has the sign of ±acceleration. If the acceleration
    # is zero as well, it has the sign of the jerk.
    has_jerk = abs(qddd) > REST_FRACTION * max_acceleration**2 / max_velocity
    accelerates = abs(qdd) > REST_FRACTION * max_acceleration
    jerk_direction = xp.where(has_jerk, xp.sign(qddd), 0.0)
    rest_direction = xp.where(accelerates, side * xp.sign(qdd), jerk_direction)
    direction = xp.where(is_at_rest, rest_direction, xp.sign(qd))
    return direction, xp.where(is_at_rest, (direction != 0) * (side > 0), False)
