"""A trajectory of straight pieces between points: what can be said of its speed and acceleration.

Its velocity jumps at every point, so it has no acceleration, and torques are not defined. But whatever smooth motion
passes through three points has somewhere an acceleration of at least the jump of the mean velocity by the mean length of
the two intervals (mean value theorem; at the ends of the motion, which rests there, the interval outside has no length).
So a jump that the acceleration limit does not allow is a violation, however the points are joined.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.kinematics.tool_speeds import tool_speed
from ssm_planner.problem.limits import Jump, SpeedLimit
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.certificate import LimitCheck
from ssm_planner.verification.limits import Quantity
from ssm_planner.verification.pieces import BLOCK

FINEST = 1e-12
"""rad or m: positions are never taken to be known better."""


def linear_limits(
    trajectory: Trajectory, robot: Robot, resolution: Array, judged: Mapping[Quantity, LimitCheck]
) -> tuple[list[LimitCheck], list[str]]:
    """The limits with speeds judged within the rounding of the points, velocity jumps, and what is not defined.

    resolution (4,): largest rounding error of a point, rad or m; a speed or jump that rounding alone can explain does
    not count.
    """
    resolution = np.maximum(resolution, FINEST)
    length = np.diff(trajectory.breaks)
    found = [_within_rounding(of, limit, trajectory, robot, resolution) for of, limit in judged.items()]
    for i, joint in enumerate(robot.joints):
        velocity = np.concatenate([[0.0], trajectory.coefficients[:, 1, i], [0.0]])
        mean = (np.append(length, 0.0) + np.append(0.0, length)) / 2
        slack = 2 * resolution[i] * (np.append(1 / length, 0.0) + np.append(0.0, 1 / length))
        jump = np.maximum(np.abs(np.diff(velocity)) - slack, 0.0)
        allowed = joint.acceleration * mean
        k = int(np.argmax(jump / allowed))
        limit = Jump(joint.name, float(allowed[k]), joint.kind == "prismatic", derivative=1)
        worst, time = float(jump[k]), float(trajectory.breaks[k])
        found.append(LimitCheck.of(limit, worst, time))
    undefined = "acceleration, jerk, motor torque and continuous torque: "
    undefined += "not defined on straight pieces (linear interpolation); "
    undefined += "velocity jumps are held against what the acceleration limit allows within one interval"
    notes = [undefined]
    if resolution.max() > FINEST:
        notes.append("speeds and jumps that the rounding of the positions can explain are not counted")
    return found, notes


def _within_rounding(
    of: Quantity, limit: LimitCheck, trajectory: Trajectory, robot: Robot, resolution: Array
) -> LimitCheck:
    """Speed limits without the part of the speed that rounding of the points can explain."""
    wrong = 2 * resolution / np.diff(trajectory.breaks)[:, None]
    speeds = trajectory.coefficients[:, 1]
    if of.limit.order != 1:
        return limit
    if of.order is None:
        return _of_tool(of, limit, trajectory=trajectory, robot=robot, speeds=speeds, wrong=wrong)
    i, scale = of.index, abs(of.scale)
    speed = scale * np.maximum(np.abs(speeds[:, i]) - wrong[:, i], 0.0)
    k = int(np.argmax(speed))
    return _replaced(limit, float(speed[k]), float(trajectory.breaks[k]))


def _of_tool(
    of: Quantity, limit: LimitCheck, trajectory: Trajectory, robot: Robot, speeds: Array, wrong: Array
) -> LimitCheck:
    """A speed of the tool, at the start of every piece and at the worst instant found.

    speeds, wrong (pieces, 4): of the joints, and their errors.
    """
    if limit.passed:
        return limit
    mechanism = Mechanism.from_geometry(robot.geometry)

    def values(q: Array, qd: Array) -> Array:
        if isinstance(of.limit, SpeedLimit):
            return tool_speed(type(of.limit), mechanism, q, qd)
        return np.abs(task_rates(mechanism, q, qd)[:, of.index])

    def unexplained(q: Array, piece: Indices) -> Array:
        explained = sum(values(q, np.eye(4)[i] * wrong[piece]) for i in range(4))
        return np.maximum(values(q, speeds[piece]) - explained, 0.0)

    # the two pieces that meet where the worst was found, if it is at a point
    there = np.array([limit.time])
    near = np.concatenate([trajectory.piece_of(there, side) for side in ("left", "right")])
    found = unexplained(trajectory.sample_pieces(near, limit.time - trajectory.breaks[near]).q, near)
    worst, time = float(found.max()), limit.time
    for first in range(0, len(speeds), BLOCK):
        block = np.arange(first, min(first + BLOCK, len(speeds)))
        q = trajectory.coefficients[block, 0]
        # what does not count without the rounding needs no second look
        more = values(q, speeds[block]) > worst
        if not more.any():
            continue
        found = unexplained(q[more], block[more])
        k = int(np.argmax(found))
        if found[k] > worst:
            worst, time = float(found[k]), float(trajectory.breaks[block[more][k]])
    return _replaced(limit, worst, time)


def _replaced(limit: LimitCheck, worst: float, time: float) -> LimitCheck:
    margin = (limit.limit - worst) / limit.limit
    return dataclasses.replace(limit, worst=worst, margin=margin, time=time)
