"""Search for reversals of joints that make a free motion faster (direction refinement).

A free motion is divided at *borders*: positions at which joints may reverse. Between two borders,
the optimal control problem fixes the direction of every joint, so that friction enters exactly. At
the optimum, the Lagrange multipliers of the constraints "q̇ keeps its direction" show in which
elements of the mesh (time intervals) a joint should move the other way. For joints at rest, the
reduced costs show the same. `DirectionMultipliers` contains both. A joint that moves out and back,
or that takes a run-up, can relieve a limit that binds.

`refine_directions` repeats one round: it reverses the directions where the multipliers are large,
inserts a border at every change of direction, and solves the motion again. The solver then chooses
the positions of these borders. The rounds end when no sum of multipliers exceeds
`MULTIPLIER_TOLERANCE`, when a round saves less than `GAP`, or when a solve fails.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from ssm_planner.planning.ocp.guesses import MIN_SEGMENT_SHARE
from ssm_planner.planning.ocp.motion import Borders, DirectionMultipliers, PhaseSolution
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.tolerances import GAP
from ssm_planner.typing import Array

MULTIPLIER_TOLERANCE = 1e-3
"""Sum of the multipliers of one joint above which its direction is reversed, as a share of the
duration.

The sum is taken over a run, that is, over consecutive elements in which the multipliers have the
same sign. To first order, it is the share of the duration that the reversal would save. Smaller
sums rarely lead to a motion that is shorter by `GAP`.
"""
REVERSAL_SHARE = 0.2
"""Share of the largest sum of a run. Other runs above it are reversed in the same round.

Smaller sums may vanish after the larger ones have been acted upon, and every border makes the
program larger.
"""
NEGLIGIBLE_SHARE = 1e-3
"""Share of the largest sum of multipliers below which a single multiplier counts as 0.

An interior-point solver leaves small multipliers on constraints that do not bind.
"""


def refine_directions(
    phase: Phase, motion: PhaseSolution, solve: Callable[[Borders, float], PhaseSolution | None]
) -> PhaseSolution | None:
    """Search for a faster motion with additional reversals of joints.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).
    motion : PhaseSolution
        Its fastest motion without additional reversals, with the multipliers of the directions.
    solve : callable
        Returns the fastest motion with given borders, or None if the solver fails. Its second
        argument is a duration in s from which on a motion is of no use.

    Returns
    -------
    PhaseSolution or None
        The fastest motion that the search has found. None if no reversal saves time.
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
    """Suggest reversals from the multipliers of a free motion.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).
    motion : PhaseSolution
        Its motion with the multipliers of the directions.

    Returns
    -------
    Borders or None
        Points and reversals between which no joint reverses, with the motion as guess. None if no
        sum of multipliers is large enough.
    """
    multipliers = motion.direction_multipliers
    if multipliers is None or multipliers.largest_joint_sum <= MULTIPLIER_TOLERANCE:
        return None
    directions = _reversed_directions(multipliers)
    if np.array_equal(directions, multipliers.directions):
        return None
    return borders_at_reversals(phase, motion, directions)


def borders_at_reversals(
    phase: Phase, motion: PhaseSolution, directions: Array | None = None
) -> Borders:
    """Return the points and reversals of a free motion as borders, with the motion as guess.

    The next solve then has a mesh whose elements end at the reversals.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).
    motion : PhaseSolution
        Its motion with the multipliers of the directions.
    directions : (n, 4) array or None
        New directions of the joints in the elements: +1, −1 or 0. None: those of the motion.

    Returns
    -------
    Borders
        The points of the phase, and the positions at which a direction changes. The solver chooses
        the latter.
    """
    multipliers, guess = motion.direction_multipliers, motion.trajectory
    assert multipliers is not None
    if directions is None:
        directions = multipliers.directions
    instants = _reversal_instants(multipliers, directions)
    is_point = np.isclose(instants[:, None], multipliers.points).any(axis=1)
    middles = (instants[1:] + instants[:-1]) / 2
    # Index of the element that contains the middle between two borders.
    elements = np.searchsorted(multipliers.instants, middles) - 1
    points = guess.sample(instants).q
    points[is_point] = phase.points
    free = tuple(np.flatnonzero(~is_point).tolist())
    return Borders(points, free, directions[elements], guess=(guess, instants))


def _reversed_directions(multipliers: DirectionMultipliers) -> Array:
    """Reverse the directions of joints where the multipliers show a saving.

    A run (consecutive elements in which a joint has multipliers of one sign) is reversed if the sum
    of its multipliers is at least `MULTIPLIER_TOLERANCE`, and at least the share `REVERSAL_SHARE`
    of the largest sum.

    Parameters
    ----------
    multipliers : DirectionMultipliers
        Directions and multipliers of the n elements (time intervals).

    Returns
    -------
    (n, 4) array
        New directions of the joints in the elements: +1, −1 or 0.
    """
    directions = multipliers.directions.copy()
    counts = np.abs(multipliers.values) > NEGLIGIBLE_SHARE * multipliers.largest_joint_sum
    signs = np.where(counts, np.sign(multipliers.values), 0.0)
    runs = [
        (joint, start, stop, float(np.abs(values[start:stop]).sum()))
        for joint, values in enumerate(multipliers.values.T)
        for start, stop in _runs_of_equal_sign(signs[:, joint])
    ]
    largest = max((saving for *_, saving in runs), default=0.0)
    threshold = max(MULTIPLIER_TOLERANCE, REVERSAL_SHARE * largest)
    for joint, start, stop, saving in runs:
        if saving >= threshold:
            directions[start:stop, joint] = signs[start, joint]
    # A joint that rested has a direction in every element, if it moves at all.
    for joint in range(4):
        if not multipliers.directions[:, joint].any() and directions[:, joint].any():
            directions[:, joint] = _fill_zeros(signs[:, joint])
    return directions


def _runs_of_equal_sign(signs: Array) -> list[tuple[int, int]]:
    """Return the bounds of each run of equal nonzero signs (n,), as indices of a slice."""
    borders = [0, *(np.flatnonzero(np.diff(signs)) + 1).tolist(), len(signs)]
    return [(start, end) for start, end in pairwise(borders) if signs[start]]


def _fill_zeros(directions: Array) -> Array:
    """Replace zeros in the directions of a joint by its next nonzero direction.

    Zeros at the end take the last nonzero direction.

    Parameters
    ----------
    directions : (n,) array
        Directions +1, −1 or 0 of the joint in the elements (time intervals) of a motion.

    Returns
    -------
    (n,) array
        Directions without zeros, unless all of them are 0.
    """
    nonzero = np.flatnonzero(directions)
    if not nonzero.size:
        return directions
    following = np.minimum(np.searchsorted(nonzero, np.arange(len(directions))), len(nonzero) - 1)
    return np.asarray(directions[nonzero[following]])


def _reversal_instants(multipliers: DirectionMultipliers, directions: Array) -> Array:
    """Return the instants between which no joint changes its direction.

    They include the instants at which the motion passes its points. A change of direction is left
    out if it is closer to another of these instants than the share `MIN_SEGMENT_SHARE` of the
    duration, because the solver needs segments of some length.

    Parameters
    ----------
    multipliers : DirectionMultipliers
        Instants of the n elements and of the points of the motion.
    directions : (n, 4) array
        Directions of the joints in the elements: +1, −1 or 0.

    Returns
    -------
    (k + 1,) array
        Increasing instants, s. The first and the last one are the ends of the motion.
    """
    instants, points = multipliers.instants, multipliers.points
    gap = MIN_SEGMENT_SHARE * instants[-1]
    changes = instants[1:-1][np.any(directions[1:] != directions[:-1], axis=1)]
    borders = points.tolist()
    for instant in changes:
        if np.abs(np.array(borders) - instant).min() > gap:
            borders.append(float(instant))
    return np.array(sorted(borders))
