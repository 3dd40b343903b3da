"""Bands of motor torques in tables of positions.

A smooth motion through three rows has the second divided difference of the rows as a weighted mean
of its acceleration, with weights that are the same for all joints. While a joint keeps its
direction, its motor torque in this direction is a convex function of the load. Some torque is
therefore at least the torque of the mean load (Jensen's inequality). In the other direction, the
limits of acceleration and jerk bound the load at every instant. Both ends of the band hold for
every motion that keeps these limits and passes all rows within their rounding.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ssm_planner.dynamics import (
    RigidBody,
    breakaway_coefficient,
    friction_coefficient,
    friction_of,
    motorised,
    moving_torque,
    output_effort,
)
from ssm_planner.problem import (
    Drive,
    JointAcceleration,
    Limit,
    MotorTorque,
    Robot,
    TaskLimits,
)
from ssm_planner.trajectory import BLOCK, Trajectory, blocks
from ssm_planner.typing import Array, Mask
from ssm_planner.verification.certificate import TOLERANCE, LimitCheck, Unjudged

WIDTHS = (1, 4, 16, 64)
"""Numbers of rows between the rows of a difference."""
CORNERS = ((0, 0, 0), *product((-1, 1), repeat=3))


def torque_bands(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, resolution: Array, undefined: str
) -> tuple[list[LimitCheck], list[Unjudged]]:
    """Judge the motor torques of a table of positions, and accelerations that are certain.

    A torque is judged if its whole band is on one side of the limit. Other bands are stated in the
    second result, after `undefined`. resolution (4,): largest rounding error of a row, rad or m.
    """
    t = trajectory.breaks
    q = np.concatenate([trajectory.positions(t[block]) for block in blocks(len(t), BLOCK)])
    moves = np.cumsum(np.diff(q, axis=0, prepend=q[:1]) != 0, axis=0)
    # Acceleration and torque that some instant has at least, and torque that no instant exceeds.
    best = np.array([robot.accelerations * (1 + TOLERANCE), np.zeros(4), np.full(4, np.inf)])
    when = np.zeros((3, 4))
    for width in (width for width in WIDTHS if 2 * width < len(t)):
        centres = np.union1d(np.arange(width, len(t) - width, width), len(t) - 1 - width)
        window_values = []
        for block in blocks(len(centres), BLOCK):
            rows = centres[block] + [[-width], [0], [width]]
            at_rest = moves[rows[0]] == moves[rows[2]]
            window_values.append(
                _of_windows(t[rows][..., None], q[rows], at_rest, robot, resolution)
            )
        values = np.concatenate(window_values, axis=1)
        extreme = values.max(axis=1)
        better = extreme * [[1], [1], [-1]] > best * [[1], [1], [-1]]
        best = np.where(better, extreme, best)
        when = np.where(better, t[centres[values.argmax(axis=1)]], when)
    checks, unjudged = [], []
    for i, joint in enumerate(robot.joints):
        if when[0, i]:
            limit: Limit = joint.limit(JointAcceleration)
            checks.append(LimitCheck.from_extreme(limit, float(best[0, i]), float(when[0, i])))
    certain = not checks and limits.friction is None and limits.payload is None
    for i, *_ in motorised(robot.joints):
        limit = robot.joints[i].limit(MotorTorque)
        low, high = best[1:, i].tolist()
        violated = low > limit.high * (1 + TOLERANCE)
        if violated or (certain and high <= limit.high):
            worst, time = (low, when[1, i]) if violated else (high, when[2, i])
            checks.append(LimitCheck.from_extreme(limit, worst, float(time)))
        else:
            band = f"{undefined}; the largest is from {low:.3g} to {high:.3g} {limit.unit}"
            unjudged.append(Unjudged(limit.name, limit.joint, band))
    return checks, unjudged


def _of_windows(t: Array, q: Array, at_rest: Mask, robot: Robot, resolution: Array) -> Array:
    """Return the values of n windows, (3, n, 4).

    They are the acceleration and the torque that some instant has at least, and the torque that no
    instant exceeds. t (3, n, 1), q (3, n, 4): first, middle and last row of each window. at_rest
    (n, 4): all rows of the joint are equal.
    """
    before, after = np.diff(t, axis=0)
    span, inverse = before + after, 1 / before + 1 / after
    largest_qdd = robot.accelerations
    jump = (q[2] - q[1]) / after - (q[1] - q[0]) / before
    mean, error = 2 * jump / span, 4 * resolution * inverse / span
    qd = (q[2] - q[0]) / span
    qd_error = np.where(at_rest, 0.0, largest_qdd * span / 2 + 2 * resolution / span)
    q_error = (np.abs(qd) + qd_error) * np.maximum(before, after) + resolution
    jerk = np.array([np.inf if joint.jerk is None else joint.jerk for joint in robot.joints])
    ends = [
        np.clip(mean + side * (error + jerk * span), -largest_qdd, largest_qdd) * ~at_rest
        for side in (-1, 1)
    ]
    body = RigidBody.from_robot(robot)
    still = np.zeros_like(qd)
    mass, rest = body.mass_matrix(q[1]), body.inverse_dynamics(q[1], qd, still)
    middle, half = (ends[0] + ends[1]) / 2, (ends[1] - ends[0]) / 2
    values = np.array([np.abs(mean) - error, still, still])
    slack = _load_changes(body, q[1], qd, (q_error, qd_error, largest_qdd))
    for i, drive, _ in motorised(robot.joints):
        mu = _extreme_friction(drive, np.abs(qd[:, i]), qd_error[:, i])
        for direction in (-1, 1):
            bands = []
            for qdd, qdd_error in ((mean, error), (middle, half)):
                load = rest[:, i] + (mass[:, i] * qdd).sum(axis=1)
                load_error = slack[:, i] + (np.abs(mass[:, i]) * qdd_error).sum(axis=1)
                state = (load, qd[:, i], qdd[:, i])
                errors = (load_error, qd_error[:, i], qdd_error[:, i])
                bands.append(_band(drive, direction, mu, state, errors))
            (sure, _), (least, most) = bands
            speed = direction * qd[:, i]
            moves = speed > qd_error[:, i]
            may_move = speed >= -qd_error[:, i]
            torques = np.array([sure * moves, np.maximum(most, -least) * may_move])
            values[1:, :, i] = np.maximum(values[1:, :, i], torques)
    return values


def _load_changes(body: RigidBody, q: Array, qd: Array, errors: tuple[Array, ...]) -> Array:
    """Return how much the load of a joint can change with q, q̇ and the mass matrix, (n, 4).

    q, qd (n, 4): middle of each window. errors: largest changes of q and q̇, and the largest q̈.
    """
    q_error, qd_error, largest_qdd = errors
    still = np.zeros_like(qd)
    mass, rest = body.mass_matrix(q), body.inverse_dynamics(q, qd, still)
    changes = still.copy()
    # The sum over both sides is at least twice the change within the window.
    for i, side in product(range(4), (-1, 1)):
        step = side * np.eye(4)[i]
        other = q + step * q_error
        changes += np.abs(body.inverse_dynamics(other, qd, still) - rest)
        changes += np.abs(body.inverse_dynamics(q, qd + step * qd_error, still) - rest)
        changes += np.abs(body.mass_matrix(other) - mass) @ largest_qdd
    return changes


def _extreme_friction(drive: Drive, speed: Array, error: Array) -> Array:
    """Return the smallest and the largest friction coefficient near joint speeds (n,), (2, n)."""
    friction = friction_of(drive)
    speeds = drive.ratio * np.maximum(speed + error * [[1], [-1]], 0)
    lowest = np.min(friction_coefficient(friction, speeds), axis=0)
    return np.array([lowest, np.max(breakaway_coefficient(friction, speeds), axis=0)])


def _band(
    drive: Drive, direction: int, mu: Array, state: tuple[Array, ...], errors: tuple[Array, ...]
) -> tuple[Array, Array]:
    """Return bounds (n,) of a motor torque in its direction.

    It is convex in load, speed and acceleration (each n,), and grows with the friction. mu (2, n):
    smallest and largest coefficient.
    """
    values = []
    for corner in CORNERS:
        load, qd, qdd = (x + side * e for x, side, e in zip(state, corner, errors, strict=True))
        carried = output_effort(drive, load, qd, qdd, direction)
        motor = drive.ratio * qd, drive.ratio * qdd
        values.append(direction * moving_torque(drive, carried, *motor, direction=direction, mu=mu))
    most = np.max(values, axis=0)
    return 2 * values[0][0] - most[0], most[1]
