"""Compare the velocity and torque offsets of EPOS4 setpoints with their target positions.

Each setpoint of the mode csp consists of a target position, a velocity offset and a torque offset.
The drive may use the two offsets as feed-forward. Offsets that do not belong to the positions would
then move the robot away from the checked motion. `offset_checks` therefore bounds the offsets by
the velocities and torques that the positions allow. A stream is the table of all setpoints of one
drive.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from ssm_planner.dynamics import RigidBody, drive_torque
from ssm_planner.problem import FeedForward, Joint, MotorTorque, Robot
from ssm_planner.trajectory import PIECES_PER_BLOCK, blocks
from ssm_planner.typing import Array, Mask, record
from ssm_planner.verification import LimitCheck

NEIGHBOUR_INTERVALS = 2
"""Number of intervals on each side of a setpoint from which its acceleration may come."""
REST_FRICTION_STATES = ((1.0, True), (-1.0, False), (-1.0, True), (0.0, False))
"""Possible friction of a joint at rest: pairs of direction (±1, or 0 if held) and breakaway flag.

They apply in addition to the friction of a motion that continues in the positive direction.
"""
FULL_ACCELERATION_PERIOD = 0.004
"""Period between setpoints, s, in which an acceleration of any size may begin and end unnoticed.

For shorter periods, the share of the acceleration limit that may be hidden decreases in proportion.
Near rest, it is the whole limit at any period, because the motion itself may be that short.
"""


@record
class Offsets:
    """Velocity and torque offsets (feed-forward) of one joint at n setpoints.

    Both have the sign of the joint's direction.
    """

    velocity: Array
    """Velocity offset (n,), rad/s or m/s."""
    torque: Array
    """Torque offset (n,), N·m at the motor, in the direction of the joint."""
    velocity_rounding: float
    """Largest rounding error of a velocity offset, rad/s or m/s."""
    torque_rounding: float
    """Largest rounding error of a torque offset, N·m."""


def offset_checks(
    robot: Robot, t: Array, q: Array, resolution: Array, offsets: dict[int, Offsets]
) -> Iterator[LimitCheck]:
    """Yield checks that the velocity and torque offsets of the drives agree with the positions.

    A velocity offset may differ from the mean velocities of the positions before and after its
    setpoint by the change that the acceleration limit allows between two setpoints. A torque offset
    must be a torque that the motor needs for an acceleration that the positions have near the
    setpoint. It must also keep the torque limit of the motor.

    Parameters
    ----------
    robot : Robot
        Robot that performs the motion.
    t : (n,) array
        Times of the setpoints, s.
    q : (n, 4) array
        Positions of joints 1 to 3 in rad, and of joint 4 in m.
    resolution : (4,) array
        Largest rounding error of each position, in the unit of the position.
    offsets : dict[int, Offsets]
        Velocity and torque offsets by index of the joint.

    Yields
    ------
    LimitCheck
        First the check of the velocity offset of each joint with offsets. Then two checks per
        joint: of its torque offset, and of its motor torque.
    """
    slopes = np.diff(q, axis=0) / np.diff(t)[:, None]
    qd = stream_velocities(t, q, offsets)
    for i, offset in offsets.items():
        yield _velocity_check(robot.joints[i], t, slopes[:, i], offset, float(resolution[i]))
    low, high = _motor_torque_range(robot, t, q, qd, offsets)
    for i, offset in offsets.items():
        joint = robot.joints[i]
        beyond = np.maximum(offset.torque - high[:, i], low[:, i] - offset.torque)
        k = int(np.argmax(beyond))
        # Tolerance: the rounding errors, and 0.1 % of the largest possible torque.
        allowed = 2 * offset.torque_rounding + 1e-3 * float(np.abs(high[:, i]).max())
        limit = FeedForward(joint.name, allowed, of_torque=True)
        yield LimitCheck.from_extreme(limit, max(float(beyond[k]), 0.0), float(t[k]))
        torque = np.maximum(np.abs(offset.torque) - offset.torque_rounding, 0.0)
        k = int(np.argmax(torque))
        yield LimitCheck.from_extreme(joint.limit(MotorTorque), float(torque[k]), float(t[k]))


def stream_velocities(t: Array, q: Array, offsets: dict[int, Offsets]) -> Array:
    """Return the joint velocities at the setpoints of an export.

    The velocity of a joint with velocity offsets is its offset. The velocity of any other joint is
    the difference quotient of its positions.

    Parameters
    ----------
    t : (n,) array
        Times of the setpoints, s.
    q : (n, 4) array
        Joint positions, rad and m.
    offsets : dict[int, Offsets]
        Velocity and torque offsets by index of the joint.

    Returns
    -------
    (n, 4) array
        Joint velocities, rad/s and m/s.
    """
    qd = np.gradient(q, t, axis=0)
    for i, offset in offsets.items():
        qd[:, i] = offset.velocity
    return qd


def _velocity_check(
    joint: Joint, t: Array, slope: Array, offset: Offsets, rounding: float
) -> LimitCheck:
    """Check that each velocity offset is possible next to the slopes of the positions.

    The slope of the positions is the mean velocity over the interval between two setpoints. With
    the length h of the interval and the acceleration limit q̈_max of the joint, it differs from the
    velocity at the ends of the interval by at most q̈_max h / 2, apart from rounding.

    Parameters
    ----------
    joint : Joint
        Joint with its limit of the acceleration q̈_max.
    t : (n,) array
        Times of the setpoints, s.
    slope : (n − 1,) array
        Slopes of the positions between the setpoints, rad/s or m/s.
    offset : Offsets
        Offsets of the axis of the joint.
    rounding : float
        Largest rounding error of a position, rad or m.

    Returns
    -------
    LimitCheck
        Result at the setpoint with the largest ratio of the error to the allowed error.
    """
    h = np.diff(t)
    # The factor 1 + 1e-6 covers the rounding of floating-point numbers.
    allowed = joint.acceleration * (1 + 1e-6) * h / 2 + 2 * rounding / h + offset.velocity_rounding
    start_error = np.abs(offset.velocity[:-1] - slope)
    end_error = np.abs(offset.velocity[1:] - slope)
    errors = np.maximum(start_error, end_error)
    k = int(np.argmax(errors / allowed))
    limit = FeedForward(joint.name, float(allowed[k]), prismatic=joint.slides)
    return LimitCheck.from_extreme(limit, float(errors[k]), float(t[k]))


def _motor_torque_range(
    robot: Robot, t: Array, q: Array, qd: Array, offsets: dict[int, Offsets]
) -> tuple[Array, Array]:
    """Return the lowest and the highest possible motor torque at each setpoint.

    The range covers every combination of accelerations that the joints may have near the setpoint.
    For a joint at rest, it also covers every state of friction.

    Parameters
    ----------
    robot : Robot
        Robot that performs the motion.
    t : (n,) array
        Times of the setpoints, s.
    q, qd : (n, 4) arrays
        Positions and velocities: rad and rad/s for joints 1 to 3, m and m/s for joint 4.
    offsets : dict[int, Offsets]
        Velocity and torque offsets by index of the joint. Only joints with offsets have a finite
        range.

    Returns
    -------
    lowest, highest : (n, 4) arrays
        Motor torques, N·m.

    Notes
    -----
    The motor torque of a joint depends on its own acceleration and on its effort, which contains
    the accelerations of all joints. It is evaluated at both ends of the range of the own
    acceleration, with the other accelerations at the lowest, middle and highest effort, and at the
    middle of both ranges.
    """
    rounding = np.array([offsets[i].velocity_rounding if i in offsets else 0.0 for i in range(4)])
    standing = np.abs(qd) <= 1e-6 * robot.velocities + rounding
    # The motor torque is monotonic in each acceleration, except where its effort changes sign.
    own, other = np.array([*product((-1, 1), (-1, 0, 1)), (0, 0)]).T[:, :, None]
    body = RigidBody.from_robot(robot)
    # The values of a joint are adjacent in memory, because drives are evaluated joint by joint.
    low, high = np.full((2, 4, len(t)), np.nan)
    for block in blocks(len(t), PIECES_PER_BLOCK // 8):
        # Accelerations near a setpoint also depend on its neighbours.
        first = max(block.start - NEIGHBOUR_INTERVALS, 0)
        rows = slice(first, block.stop + NEIGHBOUR_INTERVALS)
        inner = slice(block.start - first, block.stop - first)
        bounds = _acceleration_bounds(robot, t[rows], qd[rows], rounding, standing=standing[rows])
        lowest, highest = (bound[inner].T for bound in bounds)
        mass = body.mass_matrix(q[block]).T
        middle = (lowest + highest) / 2
        half = (highest - lowest) / 2
        # The effort is an affine function of the accelerations, with the mass matrix as factor.
        effort = body.inverse_dynamics(q[block], qd[block], middle.T).T
        effects = np.abs(mass) * half
        for i in offsets:
            drive = robot.joints[i].drive
            assert drive is not None
            own_effect = effects[i, i]
            other_effect = effects[i].sum(axis=0) - own_effect
            tau = effort[i] + own * own_effect + other * other_effect
            at_rest = standing[block, i]
            velocity, qdd = qd[block, i], middle[i] + own * half[i]
            direction = np.where(at_rest, 1.0, np.sign(velocity))
            torque, _ = drive_torque(drive, tau, velocity, qdd, direction, breakaway=False)
            resting = tau[:, at_rest], velocity[at_rest], qdd[:, at_rest]
            torques = [
                drive_torque(drive, *resting, sign, breakaway=breaks_away)[0]
                for sign, breaks_away in REST_FRICTION_STATES
            ]
            for bound, extreme in ((low[i, block], np.min), (high[i, block], np.max)):
                extreme(torque, axis=0, out=bound)
                bound[at_rest] = extreme([bound[at_rest], extreme(torques, axis=(0, 1))], axis=0)
    return low.T, high.T


def _acceleration_bounds(
    robot: Robot, t: Array, qd: Array, rounding: Array, *, standing: Mask
) -> tuple[Array, Array]:
    """Bound the accelerations of the joints near each setpoint.

    Parameters
    ----------
    robot : Robot
        Robot with the acceleration limits.
    t : (n,) array
        Times of the setpoints, s.
    qd : (n, 4) array
        Velocities of joints 1 to 3 in rad/s, and of joint 4 in m/s.
    rounding : (4,) array
        Largest rounding errors of these velocities.
    standing : (n, 4) array of bool
        True for joints at rest.

    Returns
    -------
    lowest, highest : (n, 4) arrays
        Accelerations of joints 1 to 3 in rad/s², and of joint 4 in m/s². The range always contains
        0.

    Notes
    -----
    The mean accelerations of the `NEIGHBOUR_INTERVALS` intervals before and after a setpoint lie in
    the range. An acceleration that begins and ends between two setpoints does not appear in these
    means. Therefore, the range is widened by a share of the acceleration limit: the whole limit
    near rest, otherwise the period divided by `FULL_ACCELERATION_PERIOD`, at most 1. Rounding both
    ends of an interval of length h changes its mean acceleration by up to 2 · rounding / h. The
    range never exceeds the acceleration limit.
    """
    h = np.diff(t)
    mean = np.diff(qd, axis=0) / h[:, None]
    n = len(t)
    low = np.full((n, 4), np.inf)
    high = np.full((n, 4), -np.inf)
    near_rest = standing.copy()
    for shift in range(-NEIGHBOUR_INTERVALS, NEIGHBOUR_INTERVALS):
        interval = np.clip(np.arange(n) + shift, 0, n - 2)
        near_rest |= standing[interval] | standing[interval + 1]
        low = np.minimum(low, mean[interval])
        high = np.maximum(high, mean[interval])
    limit = robot.accelerations
    share = np.where(near_rest, 1.0, min(1.0, float(h.max()) / FULL_ACCELERATION_PERIOD))
    pad = limit * share + 2 * rounding / h.min()
    # A drive that holds its position needs no acceleration, so the range always includes 0.
    lowest = np.clip(low - pad, -limit, 0.0)
    highest = np.clip(high + pad, 0.0, limit)
    return lowest, highest
