"""Guesses of a free motion: its segments from point to point.

Between rest and rest, and at speed (`turning`), the guess is a closed form. A motion with reversals
is sampled from the motion that suggested them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ssm_planner.elements.rows import UNLIMITED
from ssm_planner.planning.lower_bound import SCurve, rest_to_rest
from ssm_planner.planning.ocp.motion import Borders
from ssm_planner.planning.ocp.segments import SegmentChain, SegmentGuess, guess_of_curves
from ssm_planner.planning.ocp.turning import braking, guess_with_reversals
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array

RAMP = 5e-4
"""Share of the time between two points in which a joint without a jerk limit reaches its
acceleration.

It applies if another joint has a jerk limit.
"""
KINEMATIC = ("velocity", "acceleration", "jerk")
"""Limits of joints by the order of their derivative."""


def guess_between(
    start: Array,
    displacement: Array,
    speeds: Array,
    table: Array,
    *,
    jerk: bool,
    start_acceleration: Array,
    count: int,
    least_count: int,
) -> SegmentChain:
    """Return the guess from joints `start` over a displacement (4,) between velocities (2, 4).

    `table` (3, 4) contains the limits KINEMATIC, and `start_acceleration` (4,) is q̈ at the start.
    """
    if not speeds.any():
        return guess_from_rest(
            start, displacement, table, jerk=jerk, count=count, least_count=least_count
        )
    velocity, acceleration, _ = table
    brake = acceleration
    if jerk:
        brake = np.minimum(
            braking(speeds[0], start_acceleration, table), braking(speeds[1], np.zeros(4), table)
        )
    limits = np.stack([velocity, acceleration, brake])
    return guess_with_reversals(
        start, displacement, speeds, limits, count=count, least_count=least_count
    )


def sampled_guesses(borders: Borders, *, count: int, least_count: int) -> list[SegmentChain]:
    """Return the segments of a motion with reversals by about `count` elements in all."""
    assert borders.guess is not None
    assert borders.directions is not None
    motion, instants = borders.guess
    chains = []
    for k, (start, end) in enumerate(pairwise(instants)):
        signs, points = borders.directions[k], borders.points[k : k + 2]
        n = max(2 * least_count, round(count * (end - start) / motion.duration))
        t = np.linspace(start, end, n + 1)
        before, after = motion.sample(t[:-1]), motion.sample(t[1:], side="left")
        speed = np.where(before.qd * signs > 0, before.qd, 0.0)
        elements = Cubic(before.q, speed, before.qdd, after.qdd, np.diff(t)[:, None])
        fixed = np.ones(points.shape, dtype=bool)
        chains.append(SegmentChain(points, fixed, signs[None], (SegmentGuess(elements, (n,)),)))
    return chains


def guess_from_rest(
    start: Array, displacement: Array, limits: Array, *, jerk: bool, count: int, least_count: int
) -> SegmentChain:
    """Return the guess of joints that move by `displacement` (m,) from rest to rest.

    The slowest joint moves as fast as it can alone. The others move in step with it if that keeps
    their limits, and otherwise by their own fastest motion, stretched to its time. Without other
    limits this is optimal.

    Parameters
    ----------
    start : (m,) array
        Joints at the start.
    displacement : (m,) array
        Displacements, some of them 0, in rad and m.
    limits : (3, m) array
        Limits of velocity, acceleration and jerk.
    jerk : bool
        True if the jerk limits count.
    count : int
        Approximate number of elements.
    least_count : int
        Smallest number of elements between two switching points.
    """
    moving = np.flatnonzero(displacement)
    distances = np.abs(displacement)
    velocity, acceleration, jerks = limits.tolist()
    alone = {
        k: rest_to_rest(
            float(distances[k]), velocity[k], acceleration[k], jerks[k] if jerk else None
        )
        for k in moving
    }
    slowest_joint = max(moving, key=lambda k: alone[k].duration)
    leader = alone[slowest_joint]
    curves: list[SCurve | None] = [None] * len(displacement)
    for k in moving:
        in_step = leader.scaled(distances[k] / distances[slowest_joint])
        keeps_limits = all(
            peak <= limit * (1 + ROUNDING)
            for peak, limit in zip(in_step.peaks[: 2 + jerk], limits[:, k], strict=False)
        )
        profile = in_step if keeps_limits else alone[k].stretched(leader.duration)
        curves[k] = profile.scaled(np.sign(displacement[k]))
    guess = guess_of_curves(
        start,
        curves,
        leader.switches.tolist(),
        density=count / leader.duration,
        least_count=least_count,
    )
    points = np.stack([start, start + displacement])
    return SegmentChain(
        points, np.ones(points.shape, dtype=bool), np.sign(displacement[None]), (guess,)
    )


def jerk_for_all(
    limits: dict[str, Array], displacements: Array, ends: tuple[Array, Array]
) -> Array:
    """Return a jerk limit for every joint, (4,), if one joint has a limit.

    A joint without a limit reaches its acceleration in a share RAMP of the time of the quickest
    displacement (k, 4).
    """
    velocity, acceleration, jerk = (limits[name] for name in KINEMATIC)
    takes = np.abs(displacements) / velocity + 2 * np.sqrt(np.abs(displacements) / acceleration)
    for k, speed in zip((0, -1), ends, strict=True):
        takes[k] += np.abs(speed) / acceleration
    ramp = RAMP * takes.max(axis=1).min()
    return np.where(jerk < UNLIMITED, jerk, acceleration / ramp)
