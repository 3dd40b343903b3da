"""Durations that no motion can beat, in closed form."""

from __future__ import annotations

import numpy as np

from ssm_planner.planning.profile import rest_to_rest
from ssm_planner.problem.values import Array, Robot


def lower_bound(robot: Robot, first: Array, last: Array) -> float:
    """The largest single-joint optimum from first to last (4,): each joint alone, everything else ignored, s."""
    return max(joint_times(robot, first, last), default=0.0)


def joint_times(robot: Robot, first: Array, last: Array) -> list[float]:
    """Shortest time of each joint alone, s."""
    times = []
    for distance, joint in zip(np.abs(last - first), robot.joints, strict=True):
        moves = distance > 1e-12
        profile = rest_to_rest(float(distance), joint.velocity, joint.acceleration, joint.jerk) if moves else None
        times.append(0.0 if profile is None else profile.duration)
    return times
