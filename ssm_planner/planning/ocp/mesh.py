"""Mesh of a motion along a path. Its elements end where the binding limit of TOPP-RA changes."""

from __future__ import annotations

import numpy as np

from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.planning.tolerances import SAME
from ssm_planner.typing import Array, Indices, record

SHORTEST_ARC = 0.01
"""Arcs shorter than this share of the duration are joined with their neighbour."""
UP_TO_SPEED = 0.5
"""Short arcs at the ends remain if ṡ reaches this share of its maximum, since slow motions spend
little time on them.
"""
FEWEST = 5
"""Number of elements of the shortest arc."""


@record
class Mesh:
    """n elements between instants (n + 1,), and the interval of each, (n,).

    An interval is the stretch between two reversals. The elements of an interval share its time in
    fixed proportion, so intervals are the blocks of the program.
    """

    instants: Array
    interval: Indices

    @property
    def interval_sizes(self) -> tuple[int, ...]:
        """Number of elements of each interval."""
        return tuple(np.bincount(self.interval).tolist())

    @classmethod
    def from_retiming(
        cls, guess: Retiming, knots: Array, count: int, jerk: Array | None = None
    ) -> Mesh:
        """Return a mesh of at least `count` elements along a retimed motion.

        `jerk` (n + 1,) is the largest s⃛ at the grid points, if jerk is limited. Every jump of s̈
        then gets the time that it needs, taken from the arc after it, as in the jerk-limited motion
        of a single joint.
        """
        times = guess.times
        turns = np.interp(knots, guess.s, times)
        speed, ends = np.sqrt(guess.speed_squared), [*turns]
        for k in 1 + np.flatnonzero(guess.active[1:] != guess.active[:-1]):
            switch = times[k]
            nearest = np.abs(np.array(ends) - switch).min()
            if nearest > SHORTEST_ARC * times[-1]:
                ends.append(float(switch))
            elif speed[k] >= UP_TO_SPEED * speed.max() and nearest in (switch, times[-1] - switch):
                # The motion is up to speed between two grid points.
                inner = k + (1 if nearest == switch else -1)
                pull = speed[k] / nearest
                gained = max(speed[inner] - speed[k], 0.0) / pull
                gap = abs(times[inner] - switch)
                ends.append(float(switch + (inner - k) * min(gained, gap)))
        borders = np.array(sorted(ends))
        if jerk is not None:
            borders, turns = _with_ramps(borders, turns, guess, jerk)
        instants = _element_ends(borders, count)
        return cls(instants, _interval(instants, turns))

    def elements(self, motion: Retiming) -> Array:
        """Return s, ṡ, s̈ at both ends and length of the elements, (n, 5), for a duration of 1."""
        scale = motion.duration
        shares = self.instants / self.instants[-1]
        s = np.interp(shares * scale, motion.times, motion.s)
        speed = np.sqrt(np.interp(s, motion.s, motion.speed_squared)) * scale
        acceleration = np.diff(speed) / np.diff(shares)
        return np.stack([s[:-1], speed[:-1], acceleration, acceleration, np.diff(shares)], axis=1)


def _interval(instants: Array, turns: Array) -> Indices:
    """Return the interval between reversals of each element."""
    middles = (instants[1:] + instants[:-1]) / 2
    return np.clip(np.searchsorted(turns, middles) - 1, 0, len(turns) - 2)


def _element_ends(borders: Array, count: int) -> Array:
    """Return the ends (n + 1,) of elements of equal length in every arc between borders.

    There are `count` elements in all, or more if each arc would otherwise have less than FEWEST.
    The number is the same for most motions, so one compiled program serves many of them.
    """
    lengths = np.diff(borders)
    to_share = max(count - FEWEST * len(lengths), 0)
    shared = np.round(np.cumsum(lengths / lengths.sum()) * to_share - SAME).astype(int)
    sizes = FEWEST + np.diff(shared, prepend=0)
    starts = [
        start + length * np.arange(n) / n
        for start, length, n in zip(borders, lengths, sizes, strict=False)
    ]
    return np.append(np.concatenate(starts), borders[-1])


def _with_ramps(borders: Array, turns: Array, guess: Retiming, jerk: Array) -> tuple[Array, Array]:
    """Add a border behind each jump of s̈, and shift the reversals along.

    The motion becomes longer by the last ramp.
    """
    middle = (guess.times[1:] + guess.times[:-1]) / 2
    acceleration = np.diff(guess.speed_squared) / (2 * np.diff(guess.s))
    window = SHORTEST_ARC / 2 * guess.duration
    ends = np.append(borders[1:], np.inf)
    result = []
    for border, end in zip(borders, ends, strict=True):
        previous = acceleration[(middle < border) & (middle > border - window)]
        following = acceleration[(middle > border) & (middle < border + window)]
        jump = abs(
            (following.mean() if len(following) else 0.0)
            - (previous.mean() if len(previous) else 0.0)
        )
        ramp = jump / float(np.interp(border, guess.times, jerk))
        result.append(border)
        if SHORTEST_ARC * guess.duration / 4 < ramp and border + ramp < end - window:
            result.append(border + ramp)
    return np.array(result), np.append(turns[:-1], result[-1])
