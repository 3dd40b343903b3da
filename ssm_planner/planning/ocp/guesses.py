"""Initial guesses of a free motion, from each of its points to the next one.

A guess is the motion at which the solver of the optimal control problem begins. It follows from
the closed forms of the single joints (`joint_profile`). If an earlier solution has suggested
reversals of joints, the guess is sampled from this earlier motion.
"""

from itertools import pairwise

import numpy as np

from ssm_planner.elements.rows import UNLIMITED
from ssm_planner.planning.ocp.joint_profile import JointProfile
from ssm_planner.planning.ocp.motion import Borders
from ssm_planner.planning.ocp.segments import SegmentChain, SegmentGuess, sample_curves
from ssm_planner.typing import Array

MIN_SEGMENT_SHARE = 4e-3
"""Smallest time between two reversals in a guess, as a share of the duration.

The solver may reduce this time to the share `problem.MIN_BLOCK_SHARE`.
"""
ACCELERATION_RAMP_SHARE = 5e-4
"""Time in which a joint without a jerk limit reaches its largest acceleration.

It is a share of the time between two points. It applies if another joint has a jerk limit, because
the program then limits the jerk of all joints.
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
    least_count: int,
) -> SegmentChain:
    """Build the guess of a motion between two points.

    All joints take the duration of the slowest one. If a joint must reverse because of its velocity
    at an end, the reversals of all joints, ordered in time, divide the motion into segments.

    Parameters
    ----------
    start : (m,) array
        Joint positions at the first point, rad and m.
    displacement : (m,) array
        Displacements to the second point, rad and m.
    speeds : (2, m) array
        Joint velocities q̇ at both points.
    limits : (3, m) array
        Limits of velocity, acceleration and jerk of the joints.
    initial_acceleration : (m,) array, optional
        Joint accelerations q̈ at the first point, by default 0. They only count if the jerk is
        limited.
    count : int
        Approximate number of elements.
    least_count : int
        Smallest number of elements between two switching points, that is, instants at which the
        acceleration (with a jerk limit: the jerk) of the slowest joint jumps.

    Returns
    -------
    SegmentChain
        Segments between the reversals of all joints.
    """
    accelerations = np.zeros(len(start)) if initial_acceleration is None else initial_acceleration
    profiles = [
        JointProfile.from_limits(
            float(displacement[k]),
            (float(speeds[0, k]), float(speeds[1, k])),
            limits[:, k],
            float(accelerations[k]),
        )
        for k in range(len(start))
    ]
    slowest = max(profiles, key=lambda profile: profile.duration)
    duration = slowest.duration
    curves = [
        profile.with_duration(duration) if profile.is_moving else None for profile in profiles
    ]
    borders, directions = _reversals_in_order(profiles, duration)
    switches = slowest.with_duration(duration).switching_times.tolist()
    # The solver determines the instants of the reversals, so it needs no elements close to them.
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
                least_count=least_count,
            )
        )
    # The positions of joints that rest are given, all others only at both ends.
    points = np.array([*(guess.elements.u[0] for guess in guesses), start + displacement])
    fixed = np.tile([not profile.is_moving for profile in profiles], (len(borders), 1))
    fixed[[0, -1]] = True
    return SegmentChain(points, fixed, directions, tuple(guesses))


def _reversals_in_order(profiles: list[JointProfile], duration: float) -> tuple[list[float], Array]:
    """Return the borders between segments in the order of time, and the directions of the joints.

    Parameters
    ----------
    profiles : list of JointProfile
        Motions of the m joints.
    duration : float
        Duration of the motion, s.

    Returns
    -------
    borders : list of k + 1 floats
        Start, reversals and end of the motion, s. Neighbours have a distance of at least
        `MIN_SEGMENT_SHARE` times the duration.
    directions : (k, m) array
        Direction +1, −1 or 0 of each joint between two borders.
    """
    reversals = [
        (t if side == 0 else max(duration - t, 0.0), i)
        for i, profile in enumerate(profiles)
        for side, times in enumerate(profile.reversal_times)
        for t in times
    ]
    borders = [0.0]
    directions = [
        [
            profile.sign * (-1.0) ** len(profile.reversal_times[0]) if profile.is_moving else 0.0
            for profile in profiles
        ]
    ]
    # Each reversal begins a segment in which one joint has the other direction.
    for t, i in sorted(reversals):
        borders.append(max(t, borders[-1] + MIN_SEGMENT_SHARE * duration))
        directions.append(directions[-1].copy())
        directions[-1][i] *= -1
    borders.append(max(duration, borders[-1] + MIN_SEGMENT_SHARE * duration))
    return borders, np.array(directions)


def sampled_guesses(borders: Borders, *, count: int, least_count: int) -> list[SegmentChain]:
    """Build the guess of a motion with reversals from the earlier motion in `borders.guess`.

    Parameters
    ----------
    borders : Borders
        Positions (points and reversals) between which no joint reverses, with the directions of the
        joints between them, and a motion through them.
    count : int
        Approximate number of elements in all.
    least_count : int
        Half the smallest number of elements between two borders.

    Returns
    -------
    list of SegmentChain
        One segment for each pair of neighbouring borders.
    """
    assert borders.guess is not None
    assert borders.directions is not None
    motion, instants = borders.guess
    chains = []
    for k, (start, end) in enumerate(pairwise(instants)):
        signs, points = borders.directions[k], borders.points[k : k + 2]
        element_count = max(2 * least_count, round(count * (end - start) / motion.duration))
        t = np.linspace(start, end, element_count + 1)
        guess = SegmentGuess.sampled(motion, t, (element_count,))
        # Velocities against the direction of the segment are not allowed.
        velocity = guess.elements.v
        velocity[velocity * signs <= 0] = 0.0
        fixed = np.ones(points.shape, dtype=bool)
        chains.append(SegmentChain(points, fixed, signs[None], (guess,)))
    return chains


def jerk_limits_of_all_joints(
    limits: dict[str, Array], displacements: Array, ends: tuple[Array, Array]
) -> Array:
    """Return jerk limits for all joints of a robot that limits the jerk of some joints.

    The program limits the jerk of either all joints or none. A joint without a limit gets one with
    which it reaches its largest acceleration in the share `ACCELERATION_RAMP_SHARE` of the shortest
    time between two points, which hardly slows it down.

    Parameters
    ----------
    limits : dict
        Joint limits (4,) by name, in SI units. A jerk of `UNLIMITED` means no limit.
    displacements : (k, 4) array
        Displacements between the points, rad and m.
    ends : ((4,), (4,)) arrays
        Joint velocities q̇ at the start and at the end of the motion.

    Returns
    -------
    (4,) array
        Limits of jerk, rad/s³ and m/s³.
    """
    velocity, acceleration, jerk = (limits[name] for name in KINEMATIC_LIMITS)
    least_durations = np.abs(displacements) / velocity + 2 * np.sqrt(
        np.abs(displacements) / acceleration
    )
    for k, speed in zip((0, -1), ends, strict=True):
        least_durations[k] += np.abs(speed) / acceleration
    ramp = ACCELERATION_RAMP_SHARE * least_durations.max(axis=1).min()
    return np.where(jerk < UNLIMITED, jerk, acceleration / ramp)
