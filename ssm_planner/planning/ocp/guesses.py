"""The first guess of a free motion, in closed form: it keeps velocity, acceleration and jerk limits of every joint.

It rests at every point. Between two of them the slowest joint moves as fast as it can alone; the others move in step with it
where that keeps their limits, else by their own fastest motion stretched to its time. So between two points, without
torque, tip speed and range limits, the guess is already optimal.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ssm_planner.planning.lower_bound import SCurve, rest_to_rest
from ssm_planner.planning.ocp.mesh import Mesh
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.planning.retiming.retime import retime
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array

SLACK = 1 + 1e-12
ROUGH = 200
"""Grid intervals of the re-timed guess."""


@dataclass(frozen=True, eq=False)
class FreeGuess:
    """One segment: duration in s; instants (n + 1,) in s; q − start, q̇, q̈ start, q̈ end of every element, (n, joints)."""

    duration: float
    instants: Array
    states: tuple[Array, Array, Array, Array]
    arcs: tuple[int, ...]
    """Elements between two switching points."""


def guess(way: Array, limits: Array, jerk: bool, count: int, fewest: int) -> FreeGuess:
    """For joints that move by `way` (m,), some of them by 0, under limits (3, m): velocity, acceleration, jerk.

    About `count` elements, at least `fewest` between two switching points.
    """
    moving = np.flatnonzero(way)
    distances = np.abs(way)
    alone = {k: _alone(distances[k], limits[:, k], jerk) for k in moving}
    slowest = max(moving, key=lambda k: alone[k].duration)
    leader = alone[slowest]
    instants, arcs = [np.zeros(1)], []
    for start, end in pairwise(leader.switches):
        n = max(fewest, round(count * (end - start) / leader.duration))
        arcs.append(n)
        instants.append(np.linspace(start, end, n + 1)[1:])
    t = np.concatenate(instants)
    middle = (t[1:] + t[:-1]) / 2
    shape = len(middle), len(way)
    states = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for k in moving:
        in_step = leader.scaled(distances[k] / distances[slowest])
        fits = all(peak <= limit * SLACK for peak, limit in zip(in_step.peaks[: 2 + jerk], limits[:, k], strict=False))
        profile = in_step if fits else alone[k].stretched(leader.duration)
        position, velocity, _ = profile.at(t)
        here = profile.at(middle)[2]
        half = 0.5 * np.diff(t) * profile.jerk_at(middle)
        for state, value in zip(states, (position[:-1], velocity[:-1], here - half, here + half), strict=True):
            state[:, k] = np.sign(way[k]) * value
    return FreeGuess(leader.duration, t, states, tuple(arcs))


def retimed(robot: Robot, limits: TaskLimits, path: PolylinePath, count: int) -> FreeGuess | None:
    """The same for a straight line in joint space at TOPP-RA's pace, which keeps torques, rates and tip speed too."""
    motion = retime(path, robot, ROUGH, limits)
    if not motion.solved:
        return None
    mesh = Mesh.along(motion, path.directions[0], count)
    share, *rates = mesh.guess(motion).T
    way = path.points[-1] - path.points[0]
    orders = (1, 2, 2)
    states = [share, *(rate / motion.duration**order for rate, order in zip(rates, orders, strict=True))]
    position, velocity, begin, end = (state[:, None] * way for state in states)
    instants = mesh.instants
    return FreeGuess(motion.duration, instants, (position, velocity, begin, end), (len(instants) - 1,))


def _alone(distance: float, limits: Array, jerk: bool) -> SCurve:
    return rest_to_rest(float(distance), float(limits[0]), float(limits[1]), float(limits[2]) if jerk else None)
