"""Direction refinement: open joint directions where their multipliers ask for it.

A free motion is solved with a fixed direction of every joint between two borders, so that friction
enters exactly. At the optimum, the multipliers of "q̇ keeps its direction" show in which elements a
joint would rather move the other way. The reduced costs show the same for joints that stand
(`DirectionMultipliers`). A joint that moves out and back, or that takes a run-up, can relieve a
limit that binds. The directions are opened there, the instants of reversal become borders with free
positions, and the motion is solved again. This ends when no sum of multipliers exceeds MULTIPLIER,
when a round saves less than GAP, or when a solve fails.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from ssm_planner.planning.ocp.motion import Borders, DirectionMultipliers, PhaseSolution
from ssm_planner.planning.ocp.turning import LEAST_SEGMENT
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.tolerances import GAP
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask

MULTIPLIER = 1e-3
"""Sum of the multipliers of one joint over a stretch of time above which its direction is opened.

While the sum over the entire motion is smaller for every joint, no stretch is examined.
"""
THRESHOLD = 0.2
"""Share of the largest sum above which stretches are opened together."""
NEGLIGIBLE = 1e-3
"""Share of the largest multiplier, or of a joint's largest velocity, that counts as 0."""


def refine_directions(
    phase: Phase, motion: PhaseSolution, solve: Callable[[Borders, float], PhaseSolution | None]
) -> PhaseSolution | None:
    """Return the fastest motion found with reversals, or None if none saves time.

    Parameters
    ----------
    phase : Phase
        The free phase.
    motion : PhaseSolution
        Its fastest motion without additional reversals.
    solve : callable
        Returns the fastest motion with given reversals, or None if the solver fails. Its second
        argument is the duration in s from which on a motion is of no use.

    Returns
    -------
    PhaseSolution or None
        The motion.
    """
    incumbent = motion
    while (borders := suggest_reversals(phase, incumbent)) is not None:
        cutoff = (1 - GAP) * incumbent.duration
        faster = solve(borders, cutoff)
        if faster is None or faster.duration >= cutoff:
            break
        incumbent = faster
    return None if incumbent is motion else incumbent


def suggest_reversals(phase: Phase, motion: PhaseSolution) -> Borders | None:
    """Return the reversals that the multipliers of a free motion suggest.

    None if no multiplier exceeds the tolerance.
    """
    multipliers = motion.direction_multipliers
    if multipliers is None or multipliers.largest_sum <= MULTIPLIER:
        return None
    guess = Trajectory(motion.breaks, motion.coefficients, ())
    middles = (multipliers.instants[1:] + multipliers.instants[:-1]) / 2
    speed = np.abs(guess.sample(middles).qd)
    directions = _opened(multipliers, speed <= NEGLIGIBLE * speed.max(axis=0))
    if np.array_equal(directions, multipliers.directions):
        return None
    return _reversals(phase, multipliers, directions, guess)


def current_reversals(phase: Phase, motion: PhaseSolution) -> Borders:
    """Return the reversals of a motion, to solve it again on a mesh made for it."""
    multipliers = motion.direction_multipliers
    assert multipliers is not None
    guess = Trajectory(motion.breaks, motion.coefficients, ())
    return _reversals(phase, multipliers, multipliers.directions, guess)


def _reversals(
    phase: Phase, multipliers: DirectionMultipliers, directions: Array, guess: Trajectory
) -> Borders:
    """Return reversals with borders where `directions` (n, 4) change. The guess is a motion."""
    instants = _borders(multipliers, directions)
    is_point = np.isclose(instants[:, None], multipliers.points).any(axis=1)
    middles = np.searchsorted(multipliers.instants, (instants[1:] + instants[:-1]) / 2) - 1
    points = guess.sample(instants).q
    points[is_point] = phase.points
    free = tuple(np.flatnonzero(~is_point).tolist())
    return Borders(points, free, directions[middles], guess=(guess, instants))


def _opened(multipliers: DirectionMultipliers, at_rest: Mask) -> Array:
    """Return directions (n, 4), opened in the stretches whose multipliers exceed the tolerance.

    `at_rest` (n, 4) is True where joints rest. A stretch is extended while its joint rests.
    """
    directions = multipliers.directions.copy()
    signs = np.sign(
        np.where(
            np.abs(multipliers.values) > NEGLIGIBLE * multipliers.largest_sum,
            multipliers.values,
            0.0,
        )
    )
    stretches = [
        (joint, start, stop, float(np.abs(values[start:stop]).sum()))
        for joint, values in enumerate(multipliers.values.T)
        for start, stop in _stretches(signs[:, joint])
    ]
    largest = max((size for *_, size in stretches), default=0.0)
    threshold = max(MULTIPLIER, THRESHOLD * largest)
    for joint, start, stop, size in stretches:
        if size >= threshold:
            low, end = _extended(start, stop, at_rest[:, joint] & (signs[:, joint] == 0))
            directions[low:end, joint] = signs[start, joint]
    for joint in range(4):
        if not multipliers.directions[:, joint].any() and directions[:, joint].any():
            directions[:, joint] = _fill_zeros(signs[:, joint])
    return directions


def _stretches(signs: Array) -> list[tuple[int, int]]:
    """Return first element and end of every run of equal nonzero signs (n,)."""
    edges = [0, *(np.flatnonzero(np.diff(signs)) + 1).tolist(), len(signs)]
    return [(start, end) for start, end in pairwise(edges) if signs[start]]


def _extended(start: int, end: int, allowed: Mask) -> tuple[int, int]:
    """Extend the elements from `start` to `end` by neighbours that are allowed, (n,)."""
    while start > 0 and allowed[start - 1]:
        start -= 1
    while end < len(allowed) and allowed[end]:
        end += 1
    return start, end


def _fill_zeros(directions: Array) -> Array:
    """Return directions (n,) in which zeros take the next nonzero value, or the last one."""
    nonzero = np.flatnonzero(directions)
    if not nonzero.size:
        return directions
    following = np.minimum(np.searchsorted(nonzero, np.arange(len(directions))), len(nonzero) - 1)
    return np.asarray(directions[nonzero[following]])


def _borders(multipliers: DirectionMultipliers, directions: Array) -> Array:
    """Return the instants between which no direction changes, (k + 1,), s.

    The times of the points are always included. A change of direction within the share
    LEAST_SEGMENT of the motion from another of these instants is left out.
    """
    instants, points = multipliers.instants, multipliers.points
    gap = LEAST_SEGMENT * instants[-1]
    changes = instants[1:-1][np.any(directions[1:] != directions[:-1], axis=1)]
    borders = points.tolist()
    for instant in changes:
        if np.abs(np.array(borders) - instant).min() > gap:
            borders.append(float(instant))
    return np.array(sorted(borders))
