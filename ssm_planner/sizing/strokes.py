"""One joint back and forth at full acceleration, full speed, full deceleration: a trajectory in closed form."""

from __future__ import annotations

import math

import numpy as np

from ssm_planner.model.trajectory import DEGREE, Phase, Trajectory
from ssm_planner.problem.motorisation import Stroke
from ssm_planner.problem.values import JOINTS, Array


def back_and_forth(stroke: Stroke) -> Trajectory:
    """From centre − reach to centre + reach and back, all other joints held; two phases, "forth" and "back".

    Each way is a trapezoid of speed, or a triangle where the distance is too short to reach full speed.
    """
    joint = JOINTS.index(stroke.joint)
    times, distance = _timing(2 * stroke.reach, stroke.velocity, stroke.acceleration), 2 * stroke.reach
    home = np.array(stroke.home, dtype=float)
    home[joint] = stroke.centre - stroke.reach
    forth = _way(home, joint, times, stroke.acceleration)
    turned = home.copy()
    turned[joint] += distance
    back = _way(turned, joint, times, -stroke.acceleration)
    breaks = np.concatenate([[0.0], np.cumsum(np.concatenate([times, times]))])
    middle, end = float(breaks[len(times)]), float(breaks[-1])
    phases = (Phase("forth", 0.0, middle), Phase("back", middle, end))
    return Trajectory(breaks, np.concatenate([forth, back]), phases)


def _timing(distance: float, velocity: float, acceleration: float) -> Array:
    """Durations of accelerating, cruising (left out where there is none) and decelerating, s."""
    ramp = velocity / acceleration
    cruise = distance / velocity - ramp
    if cruise <= 0:
        ramp = math.sqrt(distance / acceleration)
        return np.array([ramp, ramp])
    return np.array([ramp, cruise, ramp])


def _way(start: Array, joint: int, times: Array, acceleration: float) -> Array:
    """Coefficients (pieces, 6, 4) of one way, from rest to rest."""
    signs = np.array([1.0, -1.0]) if len(times) == 2 else np.array([1.0, 0.0, -1.0])
    coefficients = np.zeros((len(times), DEGREE + 1, len(start)))
    coefficients[:, 0] = start
    position, velocity = start[joint], 0.0
    for i, (sign, time) in enumerate(zip(signs, times, strict=True)):
        bend = sign * acceleration
        coefficients[i, :3, joint] = position, velocity, bend / 2
        position += velocity * time + bend * time**2 / 2
        velocity += bend * time
    return coefficients
