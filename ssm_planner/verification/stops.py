"""From every instant of a motion the quickest controlled stop along its path.

The path of a motion is q(s) with s its own time, so that the motion itself is ṡ = 1. A stop slows ṡ down to 0:
q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ². Every limit of an acceleration or a motor torque bounds s̈ from below at (s, ṡ); the stop takes
the largest of these bounds. Standing still and the motion itself both keep all limits, and so does every slower motion
between them (the limits are convex in ṡ²), so that the largest bound never leads into a state without an answer, and no stop
along the path within the limits goes less far. Speeds only become smaller.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_coefficient, friction_of
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque_rows, output_effort
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.trajectory import Trajectory, hermite
from ssm_planner.typing import Array, Indices, Mask

INSTANTS = 1000
STEP, MOST_STEPS = 2e-3, 8
"""Largest interval of the path on which s̈ is constant, s of the motion."""
BACKOFF = 1e-3
"""Share by which the limits of a stop are smaller: s̈ jumps between two intervals, and joints go on by polynomials."""
NEAR = 2e-4
"""An instant as near to a break of the motion as this is taken there, s: rounding spoils accelerations of shorter pieces."""
RESTS = 1e-9
"""A joint slower than this share of its velocity limit rests."""


@dataclass(frozen=True, eq=False)
class StopMotions:
    """The quickest stops from n instants of a motion."""

    time: Array
    """(n,), s from the motion's start."""
    duration: Array
    """(n,), s until all joints rest."""
    travel: Array
    """(n,): largest distance of the tip from where it was, m."""
    motions: tuple[Trajectory | None, ...]
    """One for each instant; None where all joints rest already."""
    ends: bool
    """The motion ends at rest; where it does not, a stop may go on to its end and still move there."""


@dataclass(frozen=True, eq=False)
class _Path:
    """The path at both ends of its m intervals: arrays (2, m, 4), the first of them just after the interval's start."""

    s: Array
    """Nodes, (m + 1,)."""
    q: Array
    dq: Array
    ddq: Array
    load: tuple[Array, Array, Array]
    """Of efforts a s̈ + b ṡ² + c."""
    rests: Mask
    """(m + 1,): all joints rest in the motion."""

    @classmethod
    def of(cls, motion: Trajectory, robot: Robot, instants: Array) -> _Path:
        breaks = motion.breaks - motion.breaks[0]
        behind = np.clip(np.searchsorted(breaks, instants), 1, len(breaks) - 1)
        near = np.minimum(np.abs(breaks[behind] - instants), np.abs(breaks[behind - 1] - instants)) < NEAR
        nodes = np.union1d(breaks, instants[~near])
        ways = np.diff(nodes)
        steps = np.clip(np.ceil(ways / STEP - 1e-9), 1, MOST_STEPS).astype(int)
        of = np.repeat(np.arange(len(ways)), steps)
        part = np.arange(len(of)) - (np.cumsum(steps) - steps)[of]
        s = np.append(part * (ways / steps)[of] + nodes[of], nodes[-1])
        ends = [motion.sample(motion.breaks[0] + s[:-1], "right"), motion.sample(motion.breaks[0] + s[1:], "left")]
        q, dq, ddq = (np.stack([getattr(end, name) for end in ends]) for name in ("q", "qd", "qdd"))
        body = RigidBody.from_robot(robot)
        load = tuple(each.reshape(q.shape) for each in body.path_load(*(x.reshape(-1, 4) for x in (q, dq, ddq))))
        slow = RESTS * np.array([joint.velocity for joint in robot.joints])
        rests = np.append(np.all(np.abs(dq[0]) <= slow, axis=1), np.all(np.abs(dq[1, -1]) <= slow))
        return cls(s, q, dq=dq, ddq=ddq, load=(load[0], load[1], load[2]), rests=rests)


def quickest_stops(motion: Trajectory, robot: Robot, instants: int | Array = INSTANTS) -> StopMotions:
    """From every one of n instants, or of given times (n,), s from the start."""
    times = np.linspace(0.0, motion.duration, instants) if isinstance(instants, int) else np.asarray(instants, float)
    path = _Path.of(motion, robot, times)
    first = np.clip(np.searchsorted((path.s[1:] + path.s[:-1]) / 2, times), 0, len(path.s) - 1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # where a bound is none
        motions = _stops(path, robot, first)
    duration, travel = np.zeros(len(times)), np.zeros(len(times))
    moving = [(k, found) for k, found in enumerate(motions) if found is not None]
    if moving:
        lasting = np.array([found.breaks[-1] - found.breaks[-2] for _, found in moving])[:, None] ** np.arange(6)
        ends = np.einsum("nk,nkj->nj", lasting, np.stack([found.coefficients[-1] for _, found in moving]))
        q = np.concatenate(
            [
                part
                for (_, found), end in zip(moving, ends, strict=True)
                for part in (found.coefficients[:, 0], end[None])
            ]
        )
        places, begin = tip_position(Mechanism.from_geometry(robot.geometry), q), 0
        for k, found in moving:
            way = places[begin : begin + len(found.breaks)]
            begin += len(found.breaks)
            duration[k], travel[k] = found.duration, float(np.linalg.norm(way - way[0], axis=1).max())
    return StopMotions(path.s[first], duration, travel, motions, ends=bool(path.rests[-1]))


def _stops(path: _Path, robot: Robot, first: Indices) -> tuple[Trajectory | None, ...]:
    """A motion for each stop from the nodes `first` (n,); None where all joints rest. All stops go on node by node together.

    A stop that the path is too short for goes on to its end, where it still moves.
    """
    last = len(path.s) - 1
    stop, k = np.arange(len(first)), first.copy()
    x: Array = np.ones(len(first))
    rows: list[tuple[Any, ...]] = []
    while len(stop):
        going = ~path.rests[k] & (k < last) & (x > 0)
        stop, k, x = stop[going], k[going], x[going]
        length = path.s[k + 1] - path.s[k]
        u = _least(path, robot, k, x, length, ends=False)
        ends = x + 2 * u * length <= 0
        if ends.any():
            u[ends] = np.maximum(u[ends], _least(path, robot, k[ends], x[ends], length[ends], ends=True))
            ends = x + 2 * u * length <= 0
        after = np.where(ends, 0.0, x + 2 * u * length)
        way = np.where(ends, x / np.where(ends, -2 * u, 1.0), length)
        rows.append((stop, k, x, u, after, way))
        k, x = k + 1, after
    return _motions(path, len(first), [np.concatenate(column) for column in zip(*rows, strict=True)])


def _least(path: _Path, robot: Robot, k: Indices, x: Array, length: Array, *, ends: bool) -> Array:
    """The least s̈ (n,) ≤ 0 on the intervals k (n,) that begin at ṡ² = x, at both ends of each; ends: ṡ is 0 at its end."""
    still = np.zeros(len(k))
    # at one end of an interval ṡ² is that of the start, or nothing, and grows by s̈
    places = [(0, x, still), (1, still, still), (0, still, still)] if ends else [(0, x, still), (1, x, 2 * length)]
    at = np.repeat([end for end, *_ in places], len(k)), np.tile(k, len(places))
    square, grows = (np.concatenate([place[i] for place in places]) for i in (1, 2))
    # q̈ = a s̈ + b
    a, b = path.dq[at] + grows[:, None] * path.ddq[at], path.ddq[at] * square[:, None]
    limit = np.sign(a) * np.array([joint.acceleration * (1 - BACKOFF) for joint in robot.joints])
    bounds = [np.where(a == 0, -np.inf, -(limit + b) / a).max(axis=1)]
    for i, joint in enumerate(robot.joints):
        if joint.drive is not None and joint.motor is not None:
            bounds.append(_torque_bound(path, joint, (*at, i), (a[:, i], b[:, i]), square=square, grows=grows))
    return np.minimum(np.max(bounds, axis=0).reshape(len(places), -1).max(axis=0), 0.0)


def _above(slope: Array, value: Array, limit: float) -> Array:
    """The least u (n,) with slope · u + value ≤ limit; −∞ where only a largest one follows."""
    return np.where(slope < 0, (limit - value) / slope, -np.inf)


def _torque_bound(
    path: _Path,
    joint: Joint,
    at: tuple[Indices, Indices, int],
    qdd: tuple[Array, Array],
    *,
    square: Array,
    grows: Array,
) -> Array:
    """The least s̈ (n,) at which a motor keeps its largest torque in both directions, by the two rows of the friction law."""
    drive, motor = joint.drive, joint.motor
    if drive is None or motor is None:
        return np.full(len(square), -np.inf)
    inertia, velocity, gravity = (each[at] for each in path.load)
    speed, sigma = path.dq[at] * np.sqrt(square), np.sign(path.dq[at])
    rows = motor_torque_rows(drive, sigma, friction_coefficient(friction_of(drive), drive.ratio * speed))
    limit = motor.max_torque * (1 - BACKOFF)

    def torques(u: float) -> list[Array]:
        """In the direction of motion, by both rows."""
        acceleration = qdd[0] * u + qdd[1]
        rigid = inertia * u + velocity * (square + grows * u) + gravity
        effort = np.asarray(output_effort(drive, rigid, speed, acceleration, sigma))
        motion = drive.ratio * speed, drive.ratio * acceleration
        return [np.asarray(sigma * rows.torque(np.asarray(slope) * effort, *motion)) for slope in rows.slope]

    driving, braking = np.full(len(square), -np.inf), np.full(len(square), np.inf)
    for begins, after in zip(torques(0.0), torques(1.0), strict=True):
        rises = after - begins
        driving = np.maximum(driving, _above(rises, begins, limit))
        # either row is a lower bound of the torque in the direction of motion
        braking = np.minimum(braking, _above(-rises, -begins, limit))
    found = np.maximum(driving, braking)
    return np.where(sigma == 0, -np.inf, found)


def _motions(path: _Path, count: int, columns: list[Array]) -> tuple[Trajectory | None, ...]:
    """The rows (stop, interval, ṡ² before, s̈, ṡ² after, way), all of them (m,), as one motion for each stop."""
    order = np.argsort(columns[0], kind="stable")
    stop, k, x, u, after, way = (column[order] for column in columns)
    k = k.astype(int)
    dt = 2 * way / (np.sqrt(x) + np.sqrt(after))
    # where a stop ends within an interval the path there follows from both its ends
    h = path.s[k + 1] - path.s[k]
    between = hermite(
        np.concatenate([[0.0], np.cumsum(h)]),
        *(tuple(getattr(path, name)[end, k] for name in ("q", "dq", "ddq")) for end in (0, 1)),
    )
    powers = way[:, None] ** np.arange(6)
    q = np.einsum("mkj,mk->mj", between, powers)
    dq = np.einsum("mkj,mk->mj", between[:, 1:] * np.arange(1, 6)[:, None], powers[:, :5])
    begin = (
        path.q[0, k],
        path.dq[0, k] * np.sqrt(x)[:, None],
        path.dq[0, k] * u[:, None] + path.ddq[0, k] * x[:, None],
    )
    finish = (q, dq * np.sqrt(after)[:, None], dq * u[:, None] + path.ddq[1, k] * after[:, None])
    edges = np.searchsorted(stop, np.arange(count + 1))
    coefficients = hermite(np.concatenate([[0.0], np.cumsum(dt)]), begin, finish)
    motions: list[Trajectory | None] = []
    for first, end in pairwise(edges):
        if first == end:
            motions.append(None)
            continue
        breaks = np.concatenate([[0.0], np.cumsum(dt[first:end])])
        motions.append(Trajectory(breaks, coefficients[first:end].copy(), ()))
    return tuple(motions)
