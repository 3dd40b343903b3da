"""The mesh of a straight phase: elements that end where TOPP-RA's motion switches from one binding limit to the next."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.typing import Array, Indices

SHORTEST_ARC = 0.01
"""Arcs shorter than this share of the duration join their neighbour."""
FEWEST = 5
"""Elements of the shortest arc."""
LOOKS = 33
DEGREE = 6
"""Of the fits of s̈ within an arc."""
EDGE = 0.02
"""Share of an arc at either end that its fit leaves out: there the guess is between two arcs."""
EVEN = 1.5
"""Share of the mean density that every place gets."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Elements between the instants (n + 1,).

    interval (n,): the stretch between turning points that each lies in; block (n,): those that share their time.
    """

    instants: Array
    interval: Indices
    block: Indices

    def split(self, chosen: Array, parts: int) -> Mesh:
        """The same with the chosen elements (n,) cut into equal parts."""
        counts = np.where(chosen, parts, 1)
        lengths = np.repeat(np.diff(self.instants) / counts, counts)
        instants = np.concatenate([self.instants[:1], self.instants[0] + np.cumsum(lengths)])
        return Mesh(instants, np.repeat(self.interval, counts), np.repeat(self.block, counts))

    @property
    def share(self) -> tuple[int, ...]:
        """Elements of each interval."""
        return tuple(np.bincount(self.interval).tolist())

    @property
    def blocks(self) -> tuple[int, ...]:
        """Elements of each block."""
        return tuple(np.bincount(self.block).tolist())

    @property
    def times(self) -> Array:
        """Duration of each block, (b,), in all 1."""
        return np.bincount(self.block, np.diff(self.instants)) / float(self.instants[-1])

    @property
    def fractions(self) -> Array:
        """Length of every element as a share of its block, (n,)."""
        lengths = np.diff(self.instants)
        return np.asarray(lengths / np.bincount(self.block, lengths)[self.block])

    @classmethod
    def along(cls, guess: Retiming, knots: Array, count: int, jerk: Array | None = None) -> Mesh:
        """`count` elements, or a few more, along a re-timed motion whose joints turn back at the knots s_k.

        jerk: largest s⃛ at the grid points of the motion, (n + 1,), where jerk is limited: then every jump of s̈ gets the
        time that it needs, taken from the arc after it, as in the jerk-limited motion of a single joint.
        """
        times = guess.times
        turns = np.interp(knots, guess.s, times)
        duration = times[-1]
        ends = list(turns)
        for switch in times[1:-1][guess.active[1:] != guess.active[:-1]]:
            if np.min(np.abs(np.array(ends) - switch)) > SHORTEST_ARC * duration:
                ends.append(float(switch))
        borders = np.array(sorted(ends))
        if jerk is not None:
            borders, turns = _with_ramps(borders, turns, guess, jerk)
            duration = borders[-1]
        pieces = _pieces(borders, _bend(guess, borders), count)
        instants = np.append(np.concatenate(pieces), duration)
        interval = np.clip(np.searchsorted(turns, (instants[1:] + instants[:-1]) / 2) - 1, 0, len(turns) - 2)
        return cls(instants, interval, interval)

    def guess(self, motion: Retiming) -> Array:
        """s, ṡ and s̈ at both ends of the elements, (n, 4), of the re-timed motion; time scaled to a duration of 1."""
        scale = motion.duration
        shares = self.instants / self.instants[-1]
        s = np.interp(shares * scale, motion.times, motion.s)
        speed = np.sqrt(np.interp(s, motion.s, motion.speed_squared)) * scale
        acceleration = np.diff(speed) / np.diff(shares)
        return np.stack([s[:-1], speed[:-1], acceleration, acceleration], axis=1)


def _pieces(borders: Array, bend: Array, count: int) -> list[Array]:
    """Starts of the elements of every arc: `count` in all, or FEWEST for each where that is more.

    s̈ is linear within an element, which costs h² |d²s̈/dt²|: elements are short where √|d²s̈/dt²| (`bend`, at LOOKS points
    of every arc) is large. Their number is the same for most motions, so that a compiled program serves many of them.
    """
    lengths = np.diff(borders)
    shape = np.linspace(0.0, 1.0, LOOKS)
    weight = np.trapezoid(bend, shape, axis=1) * lengths
    even = weight.sum() / lengths.sum()
    bend = bend + (EVEN * even if even > 0 else 1.0)
    weight = np.trapezoid(bend, shape, axis=1) * lengths
    total = max(count, FEWEST * len(lengths))
    ends = np.round(np.cumsum(weight / weight.sum()) * (total - FEWEST * len(lengths))).astype(int)
    pieces = []
    for start, length, density, more in zip(borders, lengths, bend, np.diff(ends, prepend=0), strict=False):
        gone = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2)])
        share = FEWEST + int(more)
        pieces.append(start + length * np.interp(np.arange(share) / share, gone / gone[-1], shape))
    return pieces


def _bend(guess: Retiming, borders: Array) -> Array:
    """√|d²s̈/dt²| at LOOKS points of every arc, (arcs, LOOKS), from smooth fits of the guess's s̈."""
    acceleration = np.diff(guess.speed_squared) / (2 * np.diff(guess.s))
    middle = (guess.times[1:] + guess.times[:-1]) / 2
    bends = []
    for start, end in pairwise(borders):
        inside = (middle > start + EDGE * (end - start)) & (middle < end - EDGE * (end - start))
        if np.count_nonzero(inside) < 4 * DEGREE:
            bends.append(np.zeros(LOOKS))
            continue
        fit = np.polynomial.Chebyshev.fit(middle[inside], acceleration[inside], DEGREE)
        look = np.clip(np.linspace(start, end, LOOKS), *fit.domain)
        bends.append(np.sqrt(np.abs(fit.deriv(2)(look))))
    return np.array(bends)


def _with_ramps(borders: Array, turns: Array, guess: Retiming, jerk: Array) -> tuple[Array, Array]:
    """Borders with one more behind each jump of s̈, and the turning points moved along; the motion grows by the last ramp."""
    acceleration = np.diff(guess.speed_squared) / (2 * np.diff(guess.s))
    middle = (guess.times[1:] + guess.times[:-1]) / 2
    window = SHORTEST_ARC / 2 * guess.duration
    ends = np.append(borders[1:], np.inf)
    result = []
    for border, end in zip(borders, ends, strict=True):
        before = acceleration[(middle < border) & (middle > border - window)]
        after = acceleration[(middle > border) & (middle < border + window)]
        jump = abs((after.mean() if len(after) else 0.0) - (before.mean() if len(before) else 0.0))
        ramp = jump / float(np.interp(border, guess.times, jerk))
        result.append(border)
        if SHORTEST_ARC * guess.duration / 4 < ramp and border + ramp < end - window:
            result.append(border + ramp)
    return np.array(result), np.append(turns[:-1], result[-1])
