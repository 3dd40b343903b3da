"""Bounds of motor torques in tables of positions.

A table consists of rows with a time and the joint positions. It states no acceleration, but its
rows still bound the largest motor torque of every smooth motion through them. The interval between
the lower and the upper bound is called a band. The main function is `check_torque_bands`.

Three rows of a table have a second divided difference. For every smooth motion through these rows,
it is a weighted mean of the acceleration, with the same weights for all joints. While a joint keeps
its direction, its motor torque in this direction is a convex function of the load. Therefore, at
some instant the torque is at least the torque of the mean load (Jensen's inequality). This is the
lower end of the band. The limits of acceleration and jerk bound the load at every instant, which
gives the upper end. Both ends hold for every motion that keeps these limits and passes all rows
within their rounding.
"""

from collections.abc import Mapping
from itertools import product

import numpy as np

from ssm_planner.dynamics import (
    RigidBody,
    breakaway_coefficient,
    friction_coefficient,
    motorised_joints,
    moving_torque,
    output_effort,
    required_friction,
)
from ssm_planner.problem import Drive, JointAcceleration, MotorTorque, Robot, TaskLimits
from ssm_planner.trajectory import PIECES_PER_BLOCK, Trajectory, blocks
from ssm_planner.typing import Array, Mask
from ssm_planner.verification.certificate import ROUNDING_TOLERANCE, LimitCheck, Unjudged
from ssm_planner.verification.pieces import jerk_limits

WINDOW_WIDTHS = (64, 16, 4, 1)
"""Numbers of rows from the first row of a window to its middle one, and from there to its last one.

The torques of narrow windows are computed only if those of the first two widths are not decisive.
"""
BOX_POINTS = ((0, 0, 0), *product((-1, 1), repeat=3))
"""Signs of load, speed and acceleration at the centre and at the eight corners of a box."""


def check_torque_bands(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, resolution: Array, undefined: str
) -> tuple[list[LimitCheck], list[Unjudged]]:
    """Check motor torques and accelerations of a table of positions.

    A torque is judged only if its whole band is on one side of the limit. An acceleration is
    reported only if every motion through the rows exceeds its limit.

    Parameters
    ----------
    trajectory : Trajectory
        The table. All its pieces are linear.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task.
    resolution : (4,) array
        Largest rounding error of a row, rad or m.
    undefined : str
        Reason why a torque is not judged. The band of the torque is appended to it.

    Returns
    -------
    checks : list of LimitCheck
        Accelerations that certainly exceed their limit, and torques that could be judged.
    unjudged : list of Unjudged
        Other torques with their bands. The upper end of a band assumes the limits of acceleration
        and the nominal friction and payload, so it is left out if the table exceeds one of these
        limits or if the task states a range of friction or payload.
    """
    torque_limits = {
        i: robot.joints[i].limit(MotorTorque) for i, *_ in motorised_joints(robot.joints)
    }
    bounds, times = _bound_table(trajectory, robot, resolution, torque_limits)
    checks = []
    unjudged = []
    for i, joint in enumerate(robot.joints):
        acceleration = float(bounds[0, i])
        time = float(times[0, i])
        if time:  # the acceleration exceeds its limit
            limit = joint.limit(JointAcceleration)
            checks.append(LimitCheck.from_extreme(limit, acceleration, time))
    upper_bounds_hold = not checks and limits.friction is None and limits.payload is None
    for i, torque_limit in torque_limits.items():
        low, high = bounds[1:, i].tolist()
        low_time, high_time = times[1:, i].tolist()
        if low > torque_limit.high * (1 + ROUNDING_TOLERANCE):
            checks.append(LimitCheck.from_extreme(torque_limit, low, low_time))
        elif upper_bounds_hold and high <= torque_limit.high:
            checks.append(LimitCheck.from_extreme(torque_limit, high, high_time))
        else:
            band = f"{undefined}; the largest is at least {low:.3g} {torque_limit.unit}"
            if upper_bounds_hold:
                band += f" and at most {high:.3g} {torque_limit.unit}"
            unjudged.append(Unjudged(torque_limit.name, torque_limit.joint, band))
    return checks, unjudged


def _bound_table(
    trajectory: Trajectory,
    robot: Robot,
    resolution: Array,
    torque_limits: Mapping[int, MotorTorque],
) -> tuple[Array, Array]:
    """Bound the accelerations and the motor torques over a table, with windows of several widths.

    Parameters
    ----------
    trajectory : Trajectory
        The table. All its pieces are linear.
    robot : Robot
        Robot whose limits must hold.
    resolution : (4,) array
        Largest rounding error of a row, rad or m.
    torque_limits : mapping of int to MotorTorque
        Torque limits by the index of the joint. Once all torques are decided, narrower windows only
        bound the accelerations.

    Returns
    -------
    bounds : (3, 4) array
        For each joint, the acceleration and the torque that every smooth motion reaches at some
        instant, and the torque that it never exceeds. An acceleration within its limit is replaced
        by the limit.
    times : (3, 4) array
        Times of these values, s. 0 if no window gives a value.
    """
    t = trajectory.breaks
    largest_allowed = robot.accelerations * (1 + ROUNDING_TOLERANCE)
    bounds = np.array([largest_allowed, np.zeros(4), np.full(4, np.inf)])
    bound_times = np.zeros((3, 4))
    is_upper_bound = np.array([[False], [False], [True]])
    is_decided = False
    for width in WINDOW_WIDTHS:
        if 2 * width >= len(t):
            continue
        last = len(t) - 1 - width
        centres = np.append(np.arange(width, last, width), last)
        maxima = np.full((3, 4), -np.inf)
        times = np.zeros((3, 4))
        for block in blocks(len(centres), PIECES_PER_BLOCK // width):
            rows = centres[block] + [[-width], [0], [width]]
            first = rows[0, 0]
            q = trajectory.positions(t[first : rows[2, -1] + 1])
            # Number of changes of each joint position up to each row. A joint rests between two
            # rows with the same number.
            moves = np.cumsum(np.diff(q, axis=0, prepend=q[:1]) != 0, axis=0)
            at_rest = moves[rows[0] - first] == moves[rows[2] - first]
            window_times = t[rows][..., None]
            window_positions = q[rows - first]
            values = _window_bounds(
                window_times,
                window_positions,
                at_rest,
                robot,
                resolution,
                with_torques=not is_decided,
            )
            highest = values.max(axis=1)
            times = np.where(highest > maxima, t[rows[1, values.argmax(axis=1)]], times)
            maxima = np.maximum(highest, maxima)
        # Of several upper bounds, the smallest counts. Of other bounds, the largest counts.
        is_better = np.where(is_upper_bound, maxima <= bounds, maxima > bounds)
        bounds = np.where(is_better, maxima, bounds)
        bound_times = np.where(is_better, times, bound_times)
        # A band below the limit contains the torques of all narrower windows, unless the table
        # exceeds a limit of acceleration or jerk.
        is_decided = width < WINDOW_WIDTHS[0] and not any(joint.jerk for joint in robot.joints)
        for i, limit in torque_limits.items():
            low, high = bounds[1:, i].tolist()
            is_decided &= high <= limit.high and high - low < limit.high / 8
    return bounds, bound_times


def _window_bounds(
    t: Array, q: Array, at_rest: Mask, robot: Robot, resolution: Array, *, with_torques: bool
) -> Array:
    """Bound the accelerations and the motor torques within n windows.

    A window consists of three rows of the table: the first, the middle and the last row.

    Parameters
    ----------
    t : (3, n, 1) array
        Times of the first, middle and last row, s.
    q : (3, n, 4) array
        Joint positions in these rows.
    at_rest : (n, 4) array of bool
        True if all rows of the window have the same position of the joint.
    robot : Robot
        Robot whose limits must hold.
    resolution : (4,) array
        Largest rounding error of a row, rad or m.
    with_torques : bool
        True if the torques are bounded. Otherwise, they are 0 and infinite.

    Returns
    -------
    (3, n, 4) array
        The acceleration and the torque that occur at least at some instant, and the torque that no
        instant exceeds.
    """
    first_gap, last_gap = np.diff(t, axis=0)
    span = first_gap + last_gap
    largest_qdd = robot.accelerations
    # Twice the second divided difference is a weighted mean of the acceleration (module docstring).
    jump = (q[2] - q[1]) / last_gap - (q[1] - q[0]) / first_gap
    mean = 2 * jump / span
    error = 4 * resolution * (1 / first_gap + 1 / last_gap) / span
    zero = np.zeros_like(mean)
    values = np.array([np.abs(mean) - error, zero, zero])
    if not with_torques:
        values[2] = np.inf
        return values
    qd = (q[2] - q[0]) / span
    qd_error = np.where(at_rest, 0.0, largest_qdd * span / 2 + 2 * resolution / span)
    q_error = (np.abs(qd) + qd_error) * np.maximum(first_gap, last_gap) + resolution
    deviation = error + jerk_limits(robot) * span
    lowest_qdd = np.clip(mean - deviation, -largest_qdd, largest_qdd) * ~at_rest
    highest_qdd = np.clip(mean + deviation, -largest_qdd, largest_qdd) * ~at_rest
    body = RigidBody.from_robot(robot)
    mass = body.mass_matrix(q[1])
    load_without_qdd = body.inverse_dynamics(q[1], qd, zero)
    middle = (lowest_qdd + highest_qdd) / 2
    half = (highest_qdd - lowest_qdd) / 2
    slack = _bound_load_changes(body, q[1], qd, (q_error, qd_error, largest_qdd))
    for i, drive, _ in motorised_joints(robot.joints):
        mu = _extreme_friction(drive, np.abs(qd[:, i]), qd_error[:, i])
        for direction in (-1, 1):
            bands = []
            for qdd, qdd_error in ((mean, error), (middle, half)):
                load = load_without_qdd[:, i] + (mass[:, i] * qdd).sum(axis=1)
                load_error = slack[:, i] + (np.abs(mass[:, i]) * qdd_error).sum(axis=1)
                state = (load, qd[:, i], qdd[:, i])
                errors = (load_error, qd_error[:, i], qdd_error[:, i])
                bands.append(_torque_band(drive, direction, mu, state, errors))
            # The mean acceleration gives the torque that occurs at least, its range gives the
            # bounds.
            (certain_torque, _), (lowest, highest) = bands
            speed = direction * qd[:, i]
            moves = speed > qd_error[:, i]
            may_move = speed >= -qd_error[:, i]
            torques = np.array([certain_torque * moves, np.maximum(highest, -lowest) * may_move])
            values[1:, :, i] = np.maximum(values[1:, :, i], torques)
    return values


def _bound_load_changes(body: RigidBody, q: Array, qd: Array, errors: tuple[Array, ...]) -> Array:
    """Bound the change of the load of each joint within a window.

    The load is M(q) q̈ + h(q, q̇), with the mass matrix M and the effort h at zero acceleration.
    With steps Δq_i and Δq̇_i of one coordinate at a time, the bound is

        Σ_i Σ_± |h(q ± Δq_i, q̇) − h(q, q̇)| + |h(q, q̇ ± Δq̇_i) − h(q, q̇)|
                + |M(q ± Δq_i) − M(q)| q̈_max.

    Parameters
    ----------
    body : RigidBody
        Dynamics of the robot.
    q, qd : (n, 4) arrays
        Joint positions and velocities in the middle of each window.
    errors : tuple of three arrays
        Largest changes of q and of q̇, (n, 4) each, and the largest q̈, (4,).

    Returns
    -------
    (n, 4) array
        Largest changes of the loads, N·m and N.
    """
    q_error, qd_error, largest_qdd = errors
    zero = np.zeros_like(qd)
    mass = body.mass_matrix(q)
    load = body.inverse_dynamics(q, qd, zero)
    changes = zero.copy()
    # The sum over both sides is at least twice the change within the window.
    for i, side in product(range(4), (-1, 1)):
        step = side * np.eye(4)[i]
        q_nearby = q + step * q_error
        changes += np.abs(body.inverse_dynamics(q_nearby, qd, zero) - load)
        changes += np.abs(body.inverse_dynamics(q, qd + step * qd_error, zero) - load)
        changes += np.abs(body.mass_matrix(q_nearby) - mass) @ largest_qdd
    return changes


def _extreme_friction(drive: Drive, speed: Array, error: Array) -> Array:
    """Compute the smallest and the largest friction coefficient near given speeds.

    Parameters
    ----------
    drive : Drive
        Drive of the joint, with its friction.
    speed : (n,) array
        Magnitudes of the joint speed, rad/s or m/s.
    error : (n,) array
        Largest errors of these speeds.

    Returns
    -------
    (2, n) array
        Smallest coefficients of a moving joint, and largest coefficients including static friction.
    """
    friction = required_friction(drive)
    speeds = drive.ratio * np.maximum(speed + error * [[1], [-1]], 0)
    lowest = np.min(friction_coefficient(friction, speeds), axis=0)
    return np.array([lowest, np.max(breakaway_coefficient(friction, speeds), axis=0)])


def _torque_band(
    drive: Drive, direction: int, mu: Array, state: tuple[Array, ...], errors: tuple[Array, ...]
) -> tuple[Array, Array]:
    """Bound a motor torque in its direction within n boxes of load, speed and acceleration.

    The torque is convex in load, speed and acceleration, and it grows with the friction. Its
    largest value in a box is therefore at a corner. Its smallest value is at least twice the value
    at the centre minus the largest value.

    Parameters
    ----------
    drive : Drive
        Drive of the joint, with its friction.
    direction : int
        Direction of the torque and of the joint, 1 or −1.
    mu : (2, n) array
        Smallest and largest friction coefficient.
    state : tuple of three (n,) arrays
        Load (N·m or N), joint speed and joint acceleration in the centre of the box.
    errors : tuple of three (n,) arrays
        Half widths of the box in the same units.

    Returns
    -------
    lowest, highest : (n,) arrays
        Bounds of the motor torque, N·m. The lower bound uses the smallest friction coefficient,
        and the upper bound uses the largest.
    """
    values = []
    for signs in BOX_POINTS:
        load, qd, qdd = [
            centre + sign * half_width
            for centre, sign, half_width in zip(state, signs, errors, strict=True)
        ]
        effort = output_effort(drive, load, qd, qdd, direction)
        torque = moving_torque(
            drive, effort, drive.ratio * qd, drive.ratio * qdd, direction=direction, mu=mu
        )
        values.append(direction * torque)
    highest = np.max(values, axis=0)
    at_centre = values[0]
    return 2 * at_centre[0] - highest[0], highest[1]
