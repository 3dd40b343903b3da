"""Durations that no motion can beat, in closed form."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ssm_planner.planning.s_curve import rest_to_rest
from ssm_planner.problem.problem import TASK
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array

MOVES = 1e-12


def lower_bound(robot: Robot, points: Array, *, at_rest: bool = True) -> float:
    """The largest single-joint optimum through points (k + 1, 4): each joint alone, everything else ignored, s.

    A joint turns back only at the points, as the planner's joints do. at_rest: the motion begins and ends at rest; else
    only velocities bound it.
    """
    return max(_time(robot, joint, points[:, joint], at_rest) for joint in range(4))


def rate_bound(start: Array, end: Array, rates: Mapping[str, float]) -> float:
    """The time that the rates (by name in TASK) allow for the way from start to end in task coordinates, (4,), s."""
    way = np.abs(end - start)
    return max((float(way[TASK.index(name)]) / rate for name, rate in rates.items()), default=0.0)


def _time(robot: Robot, i: int, positions: Array, at_rest: bool) -> float:
    """Shortest time of one joint alone through its positions (k + 1,), s."""
    joint = robot.joints[i]
    runs = _runs(positions)
    if not at_rest:
        return sum(runs) / joint.velocity
    # where it turns back its velocity is zero, but with a jerk limit its acceleration need not be
    jerk = joint.jerk if len(runs) == 1 else None
    return sum(rest_to_rest(run, joint.velocity, joint.acceleration, jerk).duration for run in runs)


def _runs(positions: Array) -> list[float]:
    """Distances between the points where the motion turns back."""
    steps = np.diff(positions)
    steps = steps[np.abs(steps) > MOVES]
    runs: list[float] = []
    for k, step in enumerate(steps):
        if k and np.sign(step) == np.sign(steps[k - 1]):
            runs[-1] += abs(float(step))
        else:
            runs.append(abs(float(step)))
    return runs
