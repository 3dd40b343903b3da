"""Mesh of a motion along a given path, that is, its division into intervals of time (elements).

The mesh follows the motion of TOPP-RA along the same path, which is fast to compute. In this motion
s̈ jumps where another limit becomes the binding one. The elements end at these instants, because
the optimal motion switches near them, and a cubic cannot represent a jump of s̈ within an element.
"""

import numpy as np

from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE
from ssm_planner.typing import Array, Indices, record

MIN_ARC_SHARE = 0.01
"""Arcs shorter than this share of the duration are joined with their neighbour.

An arc is the time between two switching points, at which another limit becomes binding.
"""
MIN_ELEMENTS_PER_ARC = 5
"""Smallest number of elements of an arc."""


@record
class Mesh:
    """Division of a motion along a path into n time intervals, called elements."""

    instants: Array
    """Ends of the elements, (n + 1,), s."""
    interval: Indices
    """Index of the interval between two reversals of joints that contains each element, (n,).

    The elements of an interval share its duration in fixed proportion, so an interval is a block of
    the program (see `nlp`).
    """

    @classmethod
    def from_retiming(
        cls, guess: Retiming, knots: Array, count: int, jerk: Array | None = None
    ) -> "Mesh":
        """Build a mesh for a motion of TOPP-RA.

        The mesh has a border at every jump of s̈. The time between two borders is called an arc. If
        jerk is limited, s̈ needs time to change. The mesh then has an additional arc, a ramp, behind
        every jump, as in the jerk-limited motion of a single joint.

        Parameters
        ----------
        guess : Retiming
            Motion along the path whose timing TOPP-RA has computed on a grid of s.
        knots : (k + 1,) array
            Values of s at the ends of the path and at the reversals of its joints.
        count : int
            Number of elements. The mesh has more if there are too many arcs.
        jerk : (n + 1,) array or None
            Largest s⃛ at the n + 1 grid points of `guess`, 1/s³. None without a jerk limit.

        Returns
        -------
        Mesh
            The mesh. With a jerk limit, its end may be later than that of the motion, because of
            the last ramp.
        """
        times = guess.times
        reversals = np.interp(knots, guess.s, times)
        # The active limit changes between two intervals at a switching point.
        speed, ends = np.sqrt(guess.speed_squared), [*reversals]
        for k in 1 + np.flatnonzero(guess.active[1:] != guess.active[:-1]):
            switch = times[k]
            nearest = np.abs(np.array(ends) - switch).min()
            if nearest > MIN_ARC_SHARE * times[-1]:
                ends.append(float(switch))
            elif nearest in (switch, times[-1] - switch):
                # A short arc at the start or end remains, because s̈ is largest there. The motion
                # reaches its speed between two grid points, k and its inner neighbour.
                # `extra_time` estimates when, with the acceleration up to k.
                inner = k + (1 if nearest == switch else -1)
                acceleration = speed[k] / nearest
                extra_time = max(speed[inner] - speed[k], 0.0) / acceleration
                gap = abs(times[inner] - switch)
                ends.append(float(switch + (inner - k) * min(extra_time, gap)))
        borders = np.array(sorted(ends))
        if jerk is not None:
            borders, reversals = _with_ramps(borders, reversals, guess, jerk)
        instants = _element_ends(borders, count)
        middles = (instants[1:] + instants[:-1]) / 2
        interval = np.clip(np.searchsorted(reversals, middles) - 1, 0, len(reversals) - 2)
        return cls(instants, interval)

    def elements(self, motion: Retiming) -> Array:
        """Return the elements of a motion as the first guess of the program, for a duration of 1.

        Parameters
        ----------
        motion : Retiming
            Motion along the path whose timing TOPP-RA has computed on a grid of s.

        Returns
        -------
        (n, 5) array
            s, ṡ, s̈ at the start, s̈ at the end, and length of each element.
        """
        scale = motion.duration
        shares = self.instants / self.instants[-1]
        s = np.interp(shares * scale, motion.times, motion.s)
        speed = np.sqrt(np.interp(s, motion.s, motion.speed_squared)) * scale
        acceleration = np.diff(speed) / np.diff(shares)
        return np.stack([s[:-1], speed[:-1], acceleration, acceleration, np.diff(shares)], axis=1)


def _element_ends(borders: Array, count: int) -> Array:
    """Divide the time between each pair of borders (an arc) into elements of equal length.

    There are `count` elements in all, or more if an arc would otherwise have less than
    `MIN_ELEMENTS_PER_ARC`. The number is thus the same for most motions, so that one compiled
    program serves many of them.

    Parameters
    ----------
    borders : (k + 1,) array
        Ends of the arcs, s.
    count : int
        Number of elements.

    Returns
    -------
    (n + 1,) array
        Ends of the elements, s.
    """
    lengths = np.diff(borders)
    extra = max(count - MIN_ELEMENTS_PER_ARC * len(lengths), 0)
    extra_before = np.round(np.cumsum(lengths / lengths.sum()) * extra - EQUALITY_TOLERANCE).astype(
        int
    )
    sizes = MIN_ELEMENTS_PER_ARC + np.diff(extra_before, prepend=0)
    starts = [
        start + length * np.arange(size) / size
        for start, length, size in zip(borders, lengths, sizes, strict=False)
    ]
    return np.append(np.concatenate(starts), borders[-1])


def _with_ramps(
    borders: Array, reversals: Array, guess: Retiming, jerk: Array
) -> tuple[Array, Array]:
    """Add a border behind each jump of s̈, where the ramp ends that limited jerk requires.

    Parameters
    ----------
    borders : (k,) array
        Instants of the jumps and of both ends, s.
    reversals : (i,) array
        Start, reversals and end of the motion, s.
    guess : Retiming
        Motion along the path whose timing TOPP-RA has computed on a grid of s.
    jerk : (n + 1,) array
        Largest s⃛ at the grid points of `guess`, 1/s³.

    Returns
    -------
    borders, reversals : arrays
        Both with a later end of the motion, because the last ramp makes it longer.
    """
    middle = (guess.times[1:] + guess.times[:-1]) / 2
    # s̈ before and after a jump is the mean over a short window.
    window = MIN_ARC_SHARE / 2 * guess.duration
    ends = np.append(borders[1:], np.inf)
    with_ramps = []
    for border, end in zip(borders, ends, strict=True):
        previous = guess.acceleration[(middle < border) & (middle > border - window)]
        following = guess.acceleration[(middle > border) & (middle < border + window)]
        jump = abs(
            (following.mean() if len(following) else 0.0)
            - (previous.mean() if len(previous) else 0.0)
        )
        # The largest s⃛ determines how long the change of s̈ takes.
        ramp = jump / float(np.interp(border, guess.times, jerk))
        with_ramps.append(border)
        if MIN_ARC_SHARE * guess.duration / 4 < ramp and border + ramp < end - window:
            with_ramps.append(border + ramp)
    return np.array(with_ramps), np.append(reversals[:-1], with_ramps[-1])
