"""Initial guesses of a free motion, from each of its points to the next one.

The guess is a closed form if the joints begin and end at rest, or at speed (`turning`). A motion
with reversals is sampled from the earlier motion that suggested the reversals.
"""

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
"""Share of the time between two points in which a joint without a jerk limit reaches its largest
acceleration.

It applies if another joint has a jerk limit, because the program then limits the jerk of all.
"""
KINEMATIC = ("velocity", "acceleration", "jerk")
"""Names of the joint limits in the order of their derivatives: q̇, q̈ and q⃛."""


def guess_between(
    start: Array,
    displacement: Array,
    speeds: Array,
    kinematic_limits: Array,
    *,
    jerk: bool,
    start_acceleration: Array,
    count: int,
    least_count: int,
) -> SegmentChain:
    """Build the guess of joints that move between two points.

    Parameters
    ----------
    start : (4,) array
        Joint positions at the first point, rad and m.
    displacement : (4,) array
        Displacements to the second point, rad and m.
    speeds : (2, 4) array
        Joint velocities q̇ at both points.
    kinematic_limits : (3, 4) array
        Limits of velocity, acceleration and jerk of the joints.
    jerk : bool
        True if the jerk limits count.
    start_acceleration : (4,) array
        Joint accelerations q̈ at the first point.
    count : int
        Approximate number of elements.
    least_count : int
        Smallest number of elements between two switching points.

    Returns
    -------
    SegmentChain
        One segment, or several if a joint must reverse because of its velocity at an end.
    """
    if not speeds.any():
        return guess_from_rest(
            start, displacement, kinematic_limits, jerk=jerk, count=count, least_count=least_count
        )
    # Constant accelerations replace jerk-limited braking in the guess.
    velocity, acceleration, _ = kinematic_limits
    brake = acceleration
    if jerk:
        brake = np.minimum(
            braking(speeds[0], start_acceleration, kinematic_limits),
            braking(speeds[1], np.zeros(4), kinematic_limits),
        )
    limits = np.stack([velocity, acceleration, brake])
    return guess_with_reversals(
        start, displacement, speeds, limits, count=count, least_count=least_count
    )


def sampled_guesses(borders: Borders, *, count: int, least_count: int) -> list[SegmentChain]:
    """Sample the guess of a motion with reversals from the motion in `borders.guess`.

    Parameters
    ----------
    borders : Borders
        Borders with the directions of the joints between them, and a motion through them.
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
        before, after = motion.sample(t[:-1]), motion.sample(t[1:], side="left")
        # Velocities against the direction of the segment are not allowed.
        velocity = np.where(before.qd * signs > 0, before.qd, 0.0)
        elements = Cubic(before.q, velocity, before.qdd, after.qdd, np.diff(t)[:, None])
        fixed = np.ones(points.shape, dtype=bool)
        chains.append(
            SegmentChain(points, fixed, signs[None], (SegmentGuess(elements, (element_count,)),))
        )
    return chains


def guess_from_rest(
    start: Array, displacement: Array, limits: Array, *, jerk: bool, count: int, least_count: int
) -> SegmentChain:
    """Build the guess of joints that move by `displacement` from rest to rest.

    The joint that needs the longest time moves as fast as it can. Another joint moves
    proportionally to it if that keeps its limits. Otherwise it makes its own fastest motion,
    stretched to the same duration. If nothing but these joint limits counts, the guess is optimal.

    Parameters
    ----------
    start : (m,) array
        Joint positions at the start, rad and m.
    displacement : (m,) array
        Displacements in rad and m. Those of joints at rest are 0.
    limits : (3, m) array
        Limits of velocity, acceleration and jerk.
    jerk : bool
        True if the jerk limits count.
    count : int
        Approximate number of elements.
    least_count : int
        Smallest number of elements between two switching points.

    Returns
    -------
    SegmentChain
        One segment with its guess.
    """
    moving = np.flatnonzero(displacement)
    distances = np.abs(displacement)
    velocity, acceleration, jerks = limits.tolist()
    # Fastest motion of each joint as if it were alone.
    fastest_curves = {
        k: rest_to_rest(
            float(distances[k]), velocity[k], acceleration[k], jerks[k] if jerk else None
        )
        for k in moving
    }
    # All joints take the time of the slowest one.
    slowest_joint = max(moving, key=lambda k: fastest_curves[k].duration)
    slowest = fastest_curves[slowest_joint]
    curves: list[SCurve | None] = [None] * len(displacement)
    for k in moving:
        proportional = slowest.scaled(distances[k] / distances[slowest_joint])
        keeps_limits = all(
            peak <= limit * (1 + ROUNDING)
            for peak, limit in zip(proportional.peaks[: 2 + jerk], limits[:, k], strict=False)
        )
        profile = proportional if keeps_limits else fastest_curves[k].stretched(slowest.duration)
        curves[k] = profile.scaled(np.sign(displacement[k]))
    guess = guess_of_curves(
        start,
        curves,
        slowest.switches.tolist(),
        density=count / slowest.duration,
        least_count=least_count,
    )
    points = np.stack([start, start + displacement])
    return SegmentChain(
        points, np.ones(points.shape, dtype=bool), np.sign(displacement[None]), (guess,)
    )


def jerk_for_all(
    limits: dict[str, Array], displacements: Array, ends: tuple[Array, Array]
) -> Array:
    """Return a jerk limit for every joint, (4,), of a robot that limits the jerk of some joints.

    A joint without a limit gets one with which it reaches its largest acceleration in a share RAMP
    of the time of the quickest displacement.

    Parameters
    ----------
    limits : dict
        Joint limits (4,) by name, in SI units. A jerk of UNLIMITED means no limit.
    displacements : (k, 4) array
        Displacements between the points, rad and m.
    ends : ((4,), (4,)) arrays
        Joint velocities q̇ at both ends.
    """
    velocity, acceleration, jerk = (limits[name] for name in KINEMATIC)
    least_durations = np.abs(displacements) / velocity + 2 * np.sqrt(
        np.abs(displacements) / acceleration
    )
    for k, speed in zip((0, -1), ends, strict=True):
        least_durations[k] += np.abs(speed) / acceleration
    ramp = RAMP * least_durations.max(axis=1).min()
    return np.where(jerk < UNLIMITED, jerk, acceleration / ramp)
