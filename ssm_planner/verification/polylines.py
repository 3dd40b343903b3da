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

from ssm_planner.kinematics.forward import tool_speed
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.problem.limits import Jump, SpeedLimit
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import DEGREE, Trajectory
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.certificate import LimitCheck
from ssm_planner.verification.ends import declared_velocities
from ssm_planner.verification.limits import Quantity
from ssm_planner.verification.pieces import BLOCK

FINEST = 1e-12
"""Best accuracy of positions that is ever assumed, rad or m."""


def linear_limits(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    resolution: Array,
    judged: Mapping[Quantity, LimitCheck],
) -> tuple[list[LimitCheck], list[str]]:
    """Return the limits of a trajectory that consists of linear pieces.

    Speeds and velocity jumps that the rounding of the points can explain do not count. The second
    result lists what is undefined. resolution (4,): largest rounding error of a point, rad or m.
    """
    resolution = np.maximum(resolution, FINEST)
    speeds = _Speeds(robot, resolution, declared_velocities(trajectory, robot, limits)[0])
    for first in range(0, len(trajectory.breaks) - 1, BLOCK):
        block = slice(first, min(first + BLOCK, len(trajectory.breaks) - 1))
        speeds.look(trajectory.breaks[block.start : block.stop + 1], trajectory.pieces(block))
    speeds.end(declared_velocities(trajectory, robot, limits)[1])
    found = [_within_rounding(of, limit, trajectory, robot, speeds) for of, limit in judged.items()]
    found += speeds.checks()
    undefined = "acceleration, jerk, motor torque and continuous torque: "
    undefined += "not defined on straight pieces (linear interpolation); "
    undefined += (
        "velocity jumps are held against what the acceleration limit allows within one interval"
    )
    notes = [undefined]
    if resolution.max() > FINEST:
        notes.append(
            "speeds and jumps that the rounding of the positions can explain are not counted"
        )
    return found, notes


class _Speeds:
    """Collect joint speeds on linear pieces and jumps between them, less the possible rounding."""

    def __init__(self, robot: Robot, resolution: Array, start: Array) -> None:
        self.robot, self.resolution = robot, resolution
        self.allowed = np.array([joint.acceleration for joint in robot.joints])
        self.fastest, self.fastest_time = np.zeros(4), np.zeros(4)
        self.share = np.full(4, -np.inf)
        """Worst jump over what is allowed there; (worst, allowed, time) of it."""
        self.worst = np.zeros((3, 4))
        self._before, self._length, self._time = start, 0.0, 0.0

    def look(self, breaks: Array, coefficients: Array) -> None:
        """Add pieces between breaks (m + 1,) with coefficients (m, 6, 4)."""
        length = np.diff(breaks)
        speed = np.maximum(np.abs(coefficients[:, 1]) - 2 * self.resolution / length[:, None], 0.0)
        largest, k = speed.max(axis=0), speed.argmax(axis=0)
        self.fastest_time = np.where(largest > self.fastest, breaks[k], self.fastest_time)
        self.fastest = np.maximum(largest, self.fastest)
        orders = np.arange(1, DEGREE + 1)
        ends = np.einsum(
            "mk,mkj->mj", orders * length[:, None] ** (orders - 1), coefficients[:, 1:]
        )
        before = np.concatenate([self._before[None], ends[:-1]])
        self._jumps(
            breaks[:-1], np.append(self._length, length[:-1]), length, coefficients[:, 1] - before
        )
        self._before, self._length, self._time = ends[-1], float(length[-1]), float(breaks[-1])

    def end(self, velocity: Array) -> None:
        """Add the end of the motion with the velocity q̇ (4,)."""
        last, none = np.array([self._length]), np.zeros(1)
        self._jumps(np.array([self._time]), last, none, (velocity - self._before)[None])

    def _jumps(self, time: Array, before: Array, after: Array, jump: Array) -> None:
        """Add jumps (n, 4) at times (n,) between intervals of the given lengths.

        A length is 0 outside the motion.
        """
        first, second = (
            np.divide(1.0, x, out=np.zeros_like(x), where=x > 0) for x in (before, after)
        )
        inverse: Array = first + second
        jump = np.maximum(np.abs(jump) - 2 * self.resolution * inverse[:, None], 0.0)
        allowed = self.allowed * ((before + after) / 2)[:, None]
        share = jump / allowed
        k = share.argmax(axis=0)
        each = np.arange(4)
        worse = share[k, each] > self.share
        self.worst = np.where(
            worse, np.array([jump[k, each], allowed[k, each], time[k]]), self.worst
        )
        self.share = np.where(worse, share[k, each], self.share)

    def checks(self) -> list[LimitCheck]:
        """Return the velocity jumps of each joint."""
        checks = []
        for i, joint in enumerate(self.robot.joints):
            worst, allowed, time = self.worst[:, i].tolist()
            limit = Jump(joint.name, allowed, joint.kind == "prismatic", derivative=1)
            checks.append(LimitCheck.of(limit, worst, time))
        return checks


def _within_rounding(
    of: Quantity, limit: LimitCheck, trajectory: Trajectory, robot: Robot, speeds: _Speeds
) -> LimitCheck:
    """Judge speed limits without the part of the speed that rounding of the points can explain."""
    if of.limit.order != 1:
        return limit
    if of.order is None:
        return _of_tool(of, limit, trajectory, robot, resolution=speeds.resolution)
    there = np.concatenate(
        [trajectory.piece_of(np.array([limit.time]), side) for side in ("left", "right")]
    )
    if trajectory.pieces(there)[
        :, 2:
    ].any():  # of points with velocities: nothing is explained by rounding
        return limit
    speed = abs(of.scale) * float(speeds.fastest[of.index])
    return _replaced(limit, speed, float(speeds.fastest_time[of.index]))


def _of_tool(
    of: Quantity, limit: LimitCheck, trajectory: Trajectory, robot: Robot, resolution: Array
) -> LimitCheck:
    """Judge a tool speed at the start of every piece and at the worst sampled instant."""
    if limit.passed:
        return limit
    mechanism = Mechanism.from_geometry(robot.geometry)

    def values(q: Array, qd: Array) -> Array:
        if isinstance(of.limit, SpeedLimit):
            return tool_speed(type(of.limit), mechanism, q, qd)
        return np.abs(task_rates(mechanism, q, qd)[:, of.index])

    def unexplained(q: Array, speeds: Array, piece: Indices) -> Array:
        wrong = 2 * resolution / (trajectory.breaks[piece + 1] - trajectory.breaks[piece])[:, None]
        explained = sum(values(q, np.eye(4)[i] * wrong) for i in range(4))
        return np.maximum(values(q, speeds) - explained, 0.0)

    # the two pieces that meet where the worst was found, if it is at a point
    there = np.array([limit.time])
    near = np.concatenate([trajectory.piece_of(there, side) for side in ("left", "right")])
    at = trajectory.sample_pieces(near, limit.time - trajectory.breaks[near]).q
    found = unexplained(at, trajectory.pieces(near)[:, 1], near)
    worst, time = float(found.max()), limit.time
    for first in range(0, len(trajectory.breaks) - 1, BLOCK):
        block = np.arange(first, min(first + BLOCK, len(trajectory.breaks) - 1))
        coefficients = trajectory.pieces(slice(first, first + len(block)))
        q, speeds = coefficients[:, 0], coefficients[:, 1]
        # what does not count without the rounding needs no second look
        more = values(q, speeds) > worst
        if not more.any():
            continue
        found = unexplained(q[more], speeds[more], block[more])
        k = int(np.argmax(found))
        if found[k] > worst:
            worst, time = float(found[k]), float(trajectory.breaks[block[more][k]])
    return _replaced(limit, worst, time)


def _replaced(limit: LimitCheck, worst: float, time: float) -> LimitCheck:
    margin = (limit.limit - worst) / limit.limit
    return dataclasses.replace(limit, worst=worst, margin=margin, time=time)
