"""Durations that no motion can beat, in closed form."""

from __future__ import annotations

import math

import numpy as np

from ssm_planner.planning.path import StraightPath
from ssm_planner.problem.values import Robot


def rest_to_rest(distance: float, velocity: float, acceleration: float) -> float:
    """Shortest time from rest to rest over a distance ≥ 0 under velocity and acceleration limits, s.

    2√(d/a) while the velocity limit is not reached, d/v + v/a otherwise.
    """
    if distance <= velocity**2 / acceleration:
        return 2 * math.sqrt(distance / acceleration)
    return distance / velocity + velocity / acceleration


def lower_bound(robot: Robot, path: StraightPath) -> float:
    """The largest single-joint optimum: each joint alone from its first to its last value, everything else ignored, s."""
    q = path.sample(np.array([0.0, 1.0])).q
    distances = np.abs(q[1] - q[0])
    return max(
        rest_to_rest(float(d), joint.velocity, joint.acceleration)
        for d, joint in zip(distances, robot.joints, strict=True)
    )
