"""Initial guesses of a free motion, from each of its points to the next one.

In a free motion, the solver chooses the joint path between given points. A guess is the motion at
which the solver of the optimal control problem begins. It follows from a motion of each joint alone
in closed form (`joint_profile`). If an earlier solution has suggested reversals of joints, the
guess is sampled from this earlier motion.
"""

from itertools import pairwise

import numpy as np

from ssm_planner.planning.ocp.joint_profile import JointProfile
from ssm_planner.planning.ocp.motion import Borders
from ssm_planner.planning.ocp.segments import SegmentChain, SegmentGuess, sample_curves
from ssm_planner.typing import Array

MIN_SEGMENT_SHARE = 4e-3
"""Smallest time between two reversals in a guess, as a share of the duration.

The solver may reduce this time to the share `problem.MIN_BLOCK_SHARE`.
"""
KINEMATIC_LIMITS = ("velocity", "acceleration", "jerk")
"""Names of the joint limits in the order of their derivatives: q̇, q̈ and q⃛."""


def guess_between(
    start: Array,
    displacement: Array,
    speeds: Array,
    limits: Array,
    initial_acceleration: Array | None = None,
    *,
    count: int,
) -> SegmentChain:
    """Build the guess of a motion between two points from motions of the single joints.

    All joints take the duration of the slowest one. The velocity of a joint at a point may force it
    to reverse between the points. If jerk is limited, so may its acceleration at the first point.
    The reversals of all joints, in the order of time, divide the motion into segments, in which no
    joint reverses.

    Parameters
    ----------
    start : (4,) array
        Joint positions at the first point, rad and m.
    displacement : (4,) array
        Displacements of the joints to the second point, rad and m.
    speeds : (2, 4) array
        Joint velocities q̇ at both points, rad/s and m/s.
    limits : (3, 4) array
        Limits of velocity, acceleration and jerk of the joints, in SI units. The jerk is infinite
        without a limit.
    initial_acceleration : (4,) array, optional
        Joint accelerations q̈ at the first point, rad/s² and m/s², by default 0. They only count if
        the jerk is limited.
    count : int
        Approximate number of mesh elements (time intervals) between the points.

    Returns
    -------
    SegmentChain
        The segments between the reversals, with their guesses. One segment if no joint reverses.
    """
    accelerations = np.zeros(len(start)) if initial_acceleration is None else initial_acceleration
    joints = displacement.tolist(), map(tuple, speeds.T.tolist()), limits.T, accelerations.tolist()
    profiles = [JointProfile.from_limits(*joint) for joint in zip(*joints, strict=True)]
    slowest = max(profiles, key=lambda profile: profile.duration)
    duration = slowest.duration
    curves = [
        profile.with_duration(duration) if profile.is_moving else None for profile in profiles
    ]
    borders, directions = _reversals_in_order(profiles, duration)
    switches = slowest.with_duration(duration).switching_times.tolist()
    # The solver shifts the reversals in time anyway, so a switching point close to a reversal gets
    # no elements of its own. A motion from rest to rest keeps all switching points.
    gap = MIN_SEGMENT_SHARE * duration if speeds.any() else 0.0
    guesses = []
    for begin, end in pairwise(borders):
        instants = [begin]
        for switch in switches:
            if instants[-1] + gap < switch < end - gap:
                instants.append(switch)
        guesses.append(
            sample_curves(
                start,
                curves,
                [*instants, end],
                density=count / borders[-1],
            )
        )
    # Positions at the borders of the segments. At inner borders, only those of joints that rest
    # during the whole motion are given. The others are guesses.
    points = np.array([*(guess.elements.u[0] for guess in guesses), start + displacement])
    fixed = np.tile([not profile.is_moving for profile in profiles], (len(borders), 1))
    fixed[[0, -1]] = True
    return SegmentChain(points, fixed, directions, tuple(guesses))


def _reversals_in_order(profiles: list[JointProfile], duration: float) -> tuple[list[float], Array]:
    """Collect the reversals of all joints in the order of time, and the directions between them.

    Parameters
    ----------
    profiles : list of m JointProfile
        Motion of each joint between two points, with its reversals.
    duration : float
        Common duration of the motions, s.

    Returns
    -------
    borders : list of k + 1 floats
        Start, reversals and end of the motion, s. Neighbours have a distance of at least
        `MIN_SEGMENT_SHARE` times the duration, so the last border may lie after `duration`.
    directions : (k, m) array
        Direction +1, −1 or 0 of each joint between two neighbouring borders.
    """
    # Instants of the reversals with the indices of their joints. `reversal_times` counts the first
    # ones from the start (side 0) and the last one from the end (side 1).
    reversals = [
        (t if side == 0 else max(duration - t, 0.0), i)
        for i, profile in enumerate(profiles)
        for side, times in enumerate(profile.reversal_times)
        for t in times
    ]
    borders = [0.0]
    # Each reversal near the start changes the sign. If their number is odd, the joint first moves
    # against its peak velocity.
    directions = [
        [
            profile.sign * (-1.0) ** len(profile.reversal_times[0]) if profile.is_moving else 0.0
            for profile in profiles
        ]
    ]
    # At each reversal, a segment begins in which one joint has the opposite direction.
    for t, i in sorted(reversals):
        borders.append(max(t, borders[-1] + MIN_SEGMENT_SHARE * duration))
        directions.append(directions[-1].copy())
        directions[-1][i] *= -1
    borders.append(max(duration, borders[-1] + MIN_SEGMENT_SHARE * duration))
    return borders, np.array(directions)


def sampled_guesses(borders: Borders, *, count: int) -> list[SegmentChain]:
    """Make the initial guess of a motion from an earlier motion whose joints reverse elsewhere.

    The earlier motion is sampled. Velocities against the new directions of the joints become 0.

    Parameters
    ----------
    borders : Borders
        The points of the motion, and its reversals. No joint reverses between two neighbouring
        borders. Its fields `guess` (a motion through the borders) and `directions` (of the joints
        between the borders) must be given.
    count : int
        Approximate number of mesh elements (time intervals) of the whole motion.

    Returns
    -------
    list of SegmentChain
        A chain with one segment for each pair of neighbouring borders.
    """
    assert borders.guess is not None
    assert borders.directions is not None
    motion, instants = borders.guess
    chains = []
    for k, (start, end) in enumerate(pairwise(instants)):
        signs, points = borders.directions[k], borders.points[k : k + 2]
        element_count = max(4, round(count * (end - start) / motion.duration))
        t = np.linspace(start, end, element_count + 1)
        guess = SegmentGuess.sampled(motion, t, (element_count,))
        # A change of this array changes the guess.
        velocity = guess.elements.v
        velocity[velocity * signs <= 0] = 0.0
        fixed = np.ones(points.shape, dtype=bool)
        chains.append(SegmentChain(points, fixed, signs[None], (guess,)))
    return chains
