"""Speed and acceleration of a trajectory that consists of linear pieces between points.

Its velocity jumps at every point, so acceleration and torque are undefined. However, every smooth
motion through three points has at some instant at least a certain acceleration: the jump of the
mean velocity divided by the mean length of both intervals (mean value theorem). At the ends of the
motion, which rests there or has a declared speed, the outer interval has no length. A jump that
exceeds the
acceleration limit is therefore a violation for every way to join the points.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from ssm_planner.kinematics import Mechanism, task_rates, tool_speed
from ssm_planner.problem import Jump, Robot, SpeedLimit, TaskLimits
from ssm_planner.trajectory import DEGREE, Trajectory, blocks
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.certificate import LimitCheck, Unjudged
from ssm_planner.verification.ends import declared_velocities
from ssm_planner.verification.limits import Quantity
from ssm_planner.verification.pieces import BLOCK

FINEST = 1e-12
"""Best accuracy of positions that is ever assumed, rad or m."""
EXCUSED = 1e-3
"""Relative excess of a speed that the rounding of the points excuses."""


def linear_limits(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    resolution: Array,
    checks: Mapping[Quantity, LimitCheck],
) -> tuple[list[LimitCheck], list[str], list[Unjudged]]:
    """Return the limits of a trajectory that consists of linear pieces.

    Velocity jumps that the rounding of the points can explain do not count. A speed that exceeds
    its limit although rounding can explain the excess is not judged (third result). The second
    result has notes. resolution (4,): largest rounding error of a point, rad or m.
    """
    resolution = np.maximum(resolution, FINEST)
    first, last = declared_velocities(trajectory, robot, limits)
    speeds = _Speeds(robot, resolution, first)
    for block in blocks(len(trajectory.breaks) - 1, BLOCK):
        speeds.look(trajectory.breaks[block.start : block.stop + 1], trajectory.pieces(block))
    speeds.end(last)
    results, unjudged = [], []
    for quantity, limit in checks.items():
        result = _within_rounding(quantity, limit, trajectory, robot, speeds)
        if result.passed and limit.margin < -EXCUSED:
            reason = f"{-100 * limit.margin:.3g} % above the limit, which rounding may explain"
            unjudged.append(Unjudged(limit.name, limit.joint, reason))
        results.append(result)
    results += speeds.checks()
    note = "velocity may jump by as much as the acceleration limit allows within one interval"
    if resolution.max() > FINEST:
        note += ", less what the rounding of the positions can explain"
    return results, [note], unjudged


class _Speeds:
    """Collect joint speeds on linear pieces and jumps between them, less the possible rounding."""

    def __init__(self, robot: Robot, resolution: Array, start: Array) -> None:
        self.robot = robot
        self.resolution = resolution
        self.allowed = robot.accelerations
        self.fastest = np.zeros(4)
        self.fastest_time = np.zeros(4)
        self.share = np.full(4, -np.inf)
        """Worst jump over what is allowed there; (worst, allowed, time) of it."""
        self.worst = np.zeros((3, 4))
        self._before = start
        self._length = 0.0
        self._time = 0.0

    def look(self, breaks: Array, coefficients: Array) -> None:
        """Update the fastest speeds and the worst jumps with the next pieces of the motion.

        Rounding moves each end of a piece by at most the resolution, so it explains a speed of two
        resolutions over the length of the piece.

        breaks: start of each piece and end of the last one (m + 1,), s. coefficients: powers of the
        time since the start of the piece, for each joint (m, 6, 4).
        """
        length = np.diff(breaks)
        speed = np.maximum(np.abs(coefficients[:, 1]) - 2 * self.resolution / length[:, None], 0.0)
        maximum = speed.max(axis=0)
        k = speed.argmax(axis=0)
        self.fastest_time = np.where(maximum > self.fastest, breaks[k], self.fastest_time)
        self.fastest = np.maximum(maximum, self.fastest)
        orders = np.arange(1, DEGREE + 1)
        ends = np.einsum(
            "mk,mkj->mj", orders * length[:, None] ** (orders - 1), coefficients[:, 1:]
        )
        previous = np.concatenate([self._before[None], ends[:-1]])
        self._jumps(
            breaks[:-1], np.append(self._length, length[:-1]), length, coefficients[:, 1] - previous
        )
        self._before = ends[-1]
        self._length = float(length[-1])
        self._time = float(breaks[-1])

    def end(self, velocity: Array) -> None:
        """Add the end of the motion with the velocity q̇ (4,)."""
        time, length = np.array([[self._time], [self._length]])
        self._jumps(time, length, np.zeros(1), (velocity - self._before)[None])

    def _jumps(self, time: Array, length_before: Array, length_after: Array, jump: Array) -> None:
        """Add jumps (n, 4) at times (n,) between intervals of the given lengths.

        A length is 0 outside the motion.
        """
        inverse_before, inverse_after = (
            np.divide(1.0, x, out=np.zeros_like(x), where=x > 0)
            for x in (length_before, length_after)
        )
        inverse = inverse_before + inverse_after
        jump = np.maximum(np.abs(jump) - 2 * self.resolution * inverse[:, None], 0.0)
        allowed = self.allowed * ((length_before + length_after) / 2)[:, None]
        share = jump / allowed
        k = share.argmax(axis=0)
        joints = np.arange(4)
        worse = share[k, joints] > self.share
        self.worst = np.where(
            worse, np.array([jump[k, joints], allowed[k, joints], time[k]]), self.worst
        )
        self.share = np.where(worse, share[k, joints], self.share)

    def checks(self) -> list[LimitCheck]:
        """Return the velocity jumps of each joint."""
        checks = []
        for i, joint in enumerate(self.robot.joints):
            worst, allowed, time = self.worst[:, i].tolist()
            limit = Jump(joint.name, allowed, joint.slides, derivative=1)
            checks.append(LimitCheck.from_extreme(limit, worst, time))
        return checks


def _within_rounding(
    quantity: Quantity, limit: LimitCheck, trajectory: Trajectory, robot: Robot, speeds: _Speeds
) -> LimitCheck:
    """Judge speed limits without the part of the speed that rounding of the points can explain."""
    if quantity.limit.order != 1:
        return limit
    if quantity.order is None:
        return _of_tool(quantity, limit, trajectory, robot, speeds.resolution)
    if trajectory.pieces(_meeting_at(trajectory, limit.time))[:, 2:].any():
        return limit  # of points with velocities: nothing is explained by rounding
    scale = abs(quantity.scale)
    i = quantity.index
    fastest = float(speeds.fastest[i]), float(speeds.fastest_time[i])
    if not limit.passed:
        bound = limit.limit / scale
        fastest = max(fastest, _longer_windows(trajectory, i, bound, float(speeds.resolution[i])))
    return _replaced(limit, scale * fastest[0], fastest[1])


def _longer_windows(
    trajectory: Trajectory, i: int, bound: float, resolution: float
) -> tuple[float, float]:
    """Return the mean speed of joint i, less rounding, over a window, and the start of the window.

    A motion with |q̇| ≤ bound passes all points within their rounding if and only if
    |q(t) − q(s)| ≤ bound (t − s) + 2 resolution for all points s < t (McShane's extension). The
    window exceeds this by most, so its mean speed is above the bound if and only if such a motion
    does not exist. It ends where q(t) − bound t is farthest above its lowest earlier value.
    """
    t = trajectory.breaks
    q = np.concatenate([trajectory.positions(t[block])[:, i] for block in blocks(len(t), BLOCK)])
    best = (0.0, 0.0, 0.0)
    for direction in (1.0, -1.0):
        ahead = direction * q - bound * (t - t[0])
        rise = ahead - np.minimum.accumulate(ahead)
        last = int(rise.argmax())
        first = int(ahead[: last + 1].argmin())
        if rise[last] > best[0]:
            speed = (abs(q[last] - q[first]) - 2 * resolution) / (t[last] - t[first])
            best = float(rise[last]), float(speed), float(t[first])
    return best[1:]


def _of_tool(
    quantity: Quantity, limit: LimitCheck, trajectory: Trajectory, robot: Robot, resolution: Array
) -> LimitCheck:
    """Judge a tool speed at the start of every piece and at the worst sampled instant."""
    if limit.passed:
        return limit
    mechanism = Mechanism.from_robot(robot)

    def values(q: Array, qd: Array) -> Array:
        if isinstance(quantity.limit, SpeedLimit):
            return tool_speed(type(quantity.limit), mechanism, q, qd)
        return np.abs(task_rates(mechanism, q, qd)[:, quantity.index])

    def unexplained(q: Array, speeds: Array, index: Indices) -> Array:
        wrong = 2 * resolution / (trajectory.breaks[index + 1] - trajectory.breaks[index])[:, None]
        rounding = sum(values(q, np.eye(4)[i] * wrong) for i in range(4))
        return np.maximum(values(q, speeds) - rounding, 0.0)

    pieces = _meeting_at(trajectory, limit.time)
    q_worst = trajectory.sample_pieces(pieces, limit.time - trajectory.breaks[pieces]).q
    speeds_left = unexplained(q_worst, trajectory.pieces(pieces)[:, 1], pieces)
    highest = float(speeds_left.max())
    time = limit.time
    for block in blocks(len(trajectory.breaks) - 1, BLOCK):
        coefficients = trajectory.pieces(block)
        q = coefficients[:, 0]
        speeds = coefficients[:, 1]
        # what does not count without the rounding needs no second look
        faster = values(q, speeds) > highest
        if not faster.any():
            continue
        index = block.start + np.flatnonzero(faster)
        speeds_left = unexplained(q[faster], speeds[faster], index)
        k = int(np.argmax(speeds_left))
        if speeds_left[k] > highest:
            highest = float(speeds_left[k])
            time = float(trajectory.breaks[index[k]])
    return _replaced(limit, highest, time)


def _meeting_at(trajectory: Trajectory, time: float) -> Indices:
    """Return the two pieces that meet at a time, or twice the piece that contains it."""
    return np.concatenate([trajectory.piece_of(np.array([time]), s) for s in ("left", "right")])


def _replaced(limit: LimitCheck, value: float, time: float) -> LimitCheck:
    margin = (limit.limit - value) / limit.limit
    return dataclasses.replace(limit, worst=value, margin=margin, time=time)
