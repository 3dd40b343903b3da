"""Search for reversals of joints that make a free motion faster (direction refinement).

On a free motion, the solver chooses the path between the given points. The motion is divided at
*borders*: positions at which joints may reverse. Between two borders, the optimal control problem
fixes the direction of every joint, so that friction enters exactly.

At the optimum, Lagrange multipliers show where the other direction would save time. They belong to
the constraint that a joint keeps its direction, in each element (time interval) of the mesh. For
joints at rest, reduced costs show the same. `DirectionMultipliers` contains both. A joint can save
time in this way if it moves out and back, or takes a run-up, and thereby relieves a limit that
slows the motion down.

`refine_directions` repeats one round. It reverses the directions where the multipliers are large,
inserts a border at every change of direction, and solves the motion again. The solver then chooses
the positions of these borders. The rounds end when no sum of multipliers exceeds
`MULTIPLIER_TOLERANCE`, when a round saves less than the share `GAP`, or when a solve fails.
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

The sum is taken over a run, that is, over consecutive elements (time intervals) in which the
multipliers have the same sign. To first order, it is the share of the duration that the reversal
saves. The true saving is smaller, so the value is 10 times `GAP`, the smallest saving that counts.
Twice the value makes a motion of the benchmark 0.016 % longer (`results/constants.md`).
"""
REVERSAL_SHARE = 0.2
"""Share of the largest sum of a run. Other runs above it are reversed in the same round.

A run is a series of consecutive elements in which the multipliers of a joint have the same sign.
Smaller sums may vanish once the directions of the larger ones are reversed, and every border makes
the program larger. The value is a compromise between the number of rounds and the size of the
program. Half of it changes the work, but no duration, of the first problem of the benchmark that
reacts (`results/constants.md`).
"""
NEGLIGIBLE_SHARE = 1e-3
"""Share of the largest sum of multipliers below which a single multiplier counts as 0.

An interior-point solver leaves small multipliers on constraints that do not bind.
"""


def refine_directions(
    phase: Phase, motion: PhaseSolution, solve: Callable[[Borders, float], PhaseSolution | None]
) -> PhaseSolution | None:
    """Search for a faster free motion by reversing joints where the multipliers suggest it.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).
    motion : PhaseSolution
        Its fastest motion without additional reversals, with the multipliers of the directions.
    solve : callable
        Called with borders and a duration in s. Returns the fastest motion with these borders, or
        None if the solver fails. Only a motion shorter than the given duration is of use. The
        solver may return a longer one unfinished, and the search then discards it.

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
    """Suggest reversals of joints from the multipliers of a free motion.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).
    motion : PhaseSolution
        Its motion with the multipliers of the directions.

    Returns
    -------
    Borders or None
        Points and reversals between which no joint reverses, with the motion as the guess of the
        next solve. None without multipliers, if no sum of multipliers is large enough,
        or if the new directions of the joints equal the old ones.
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
    """Convert the ends and reversals of a free motion to borders for another solve.

    A border is a position at which joints may reverse. No joint reverses between two consecutive
    borders. The next solve divides the time into elements (intervals) that end at the borders, and
    it starts from the given motion.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion), with two points.
    motion : PhaseSolution
        Its motion with the multipliers of the directions.
    directions : (n, 4) array or None
        New directions of the joints in the n elements of `motion`: +1, −1 or 0. None: those of the
        motion.

    Returns
    -------
    Borders
        Both points of the phase, and the positions at which a direction changes. Only the latter
        may be moved by the solver.
    """
    multipliers, guess = motion.direction_multipliers, motion.trajectory
    assert multipliers is not None
    if directions is None:
        directions = multipliers.directions
    instants = _reversal_instants(multipliers, directions)
    middles = (instants[1:] + instants[:-1]) / 2
    # A middle between instants i and i + 1 lies in element i. searchsorted returns i + 1.
    elements = np.searchsorted(multipliers.instants, middles) - 1
    # At both ends, exact positions replace those of the motion, which have rounding errors.
    points = guess.sample(instants).q
    points[[0, -1]] = phase.points
    free = tuple(range(1, len(points) - 1))
    return Borders(points, free, directions[elements], guess=(guess, instants))


def _reversed_directions(multipliers: DirectionMultipliers) -> Array:
    """Reverse the directions of joints where the multipliers show a saving.

    The sign of a multiplier is the direction in which the joint should move. A run is a series of
    consecutive elements (time intervals) in which a joint has multipliers of one sign. The joint
    takes this direction during the run if the sum of the |multipliers| is at least
    `MULTIPLIER_TOLERANCE`, and at least the share `REVERSAL_SHARE` of the largest sum of all runs.

    Parameters
    ----------
    multipliers : DirectionMultipliers
        Directions and multipliers of the n elements.

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
    # The optimal control problem gives a moving joint a direction in every element. A joint that
    # rested so far takes it from its multipliers, also where their sum is below the threshold.
    # Elements without a sign take the sign of the next element that has one, or else the last sign.
    started = ~multipliers.directions.any(axis=0) & directions.any(axis=0)
    for joint in np.flatnonzero(started).tolist():
        signed = np.flatnonzero(signs[:, joint])
        following = np.searchsorted(signed, np.arange(len(signs))).clip(max=len(signed) - 1)
        directions[:, joint] = signs[signed[following], joint]
    return directions


def _runs_of_equal_sign(signs: Array) -> list[tuple[int, int]]:
    """Find the runs of equal nonzero signs.

    Parameters
    ----------
    signs : (n,) array
        Signs +1, −1 or 0.

    Returns
    -------
    list of (int, int)
        First index of each run, and the index after its last one.
    """
    borders = [0, *(np.flatnonzero(np.diff(signs)) + 1).tolist(), len(signs)]
    return [(start, end) for start, end in pairwise(borders) if signs[start]]


def _reversal_instants(multipliers: DirectionMultipliers, directions: Array) -> Array:
    """Return the instants between which no joint changes its direction.

    They include the start and the end of the motion. A change of direction is
    left out if it is closer to another of these instants than the share `MIN_SEGMENT_SHARE` of the
    duration, because the solver needs some time between two borders.

    Parameters
    ----------
    multipliers : DirectionMultipliers
        Instants of the n elements (time intervals) and of the points of the motion.
    directions : (n, 4) array
        Directions of the joints in the elements: +1, −1 or 0.

    Returns
    -------
    (k + 1,) array
        Increasing instants, s. They bound k intervals. The first and the last instant are the ends
        of the motion.
    """
    instants = multipliers.instants
    gap = MIN_SEGMENT_SHARE * instants[-1]
    changes = instants[1:-1][np.any(directions[1:] != directions[:-1], axis=1)]
    borders = instants[[0, -1]].tolist()
    for instant in changes:
        # `borders` also contains the changes that were kept before.
        if np.abs(np.array(borders) - instant).min() > gap:
            borders.append(float(instant))
    return np.array(sorted(borders))
