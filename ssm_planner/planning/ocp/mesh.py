"""Mesh of a motion along a given path: the time intervals (elements) on which it is a cubic.

On a given joint path q(s), with the path parameter s from 0 to 1, only the timing s(t) is unknown.
TOPP-RA (`planning.retiming`) computes a timing quickly, and the mesh is derived from it. In this
timing s̈ jumps at every instant at which another limit becomes the binding one. The elements end at
these instants for two reasons: the optimal motion changes its binding limit near them, and the
cubic of one element cannot represent a jump of s̈.
"""

import numpy as np

from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE
from ssm_planner.typing import Array, Indices, record

MIN_ARC_SHARE = 0.01
"""Arcs shorter than this share of the duration are joined with their neighbour.

An arc is the part of the motion between two switching points, that is, instants at which another
limit becomes the binding one.
"""
MIN_ELEMENTS_PER_ARC = 5
"""Smallest number of elements of an arc."""


@record
class Mesh:
    """Division of a motion along a path into n time intervals, called elements."""

    instants: Array
    """Start of the first element, and end of every element, (n + 1,), s."""
    interval: Indices
    """For each element, the index of the interval between two reversals that contains it, (n,).

    A reversal is an instant at which any joint changes its direction. The nonlinear program has one
    unknown duration for each of these intervals, and its elements share it in fixed proportion.
    Such a group of elements is called a block (see `nlp`).
    """

    @classmethod
    def from_retiming(
        cls, guess: Retiming, knots: Array, count: int, jerk: Array | None = None
    ) -> "Mesh":
        """Build the mesh from the motion that TOPP-RA has computed along the same path.

        Borders divide the motion into arcs. There is a border at every reversal of a joint and at
        every jump of s̈, and elements end at each border. If jerk is limited, s̈ cannot jump, but
        takes some time to change (a ramp). The mesh then has one more arc behind each jump, which
        lasts as long as the ramp.

        Parameters
        ----------
        guess : Retiming
            Motion along the path, which TOPP-RA has timed on a grid of g + 1 values of s.
        knots : (k + 1,) array
            Values of s at the ends of the path and at the reversals of its joints.
        count : int
            Number of elements. The mesh has more elements if `count` is too small for
            `MIN_ELEMENTS_PER_ARC` elements in every arc.
        jerk : (g + 1,) array or None
            Largest s⃛ at the grid points of `guess`, 1/s³. None without a jerk limit.

        Returns
        -------
        Mesh
            The mesh. With a jerk limit, it may end later than `guess`, because the last ramp
            follows the end of `guess`.
        """
        times = guess.times
        reversals = np.interp(knots, guess.s, times)
        # `ends` collects the ends of the arcs: first the reversals, then the switching points. A
        # switching point is a grid point k for which the limit that binds on interval k − 1 differs
        # from the one that binds on interval k.
        speed, ends = np.sqrt(guess.speed_squared), [*reversals]
        for k in 1 + np.flatnonzero(guess.active[1:] != guess.active[:-1]):
            switch = times[k]
            nearest = np.abs(np.array(ends) - switch).min()
            if nearest > MIN_ARC_SHARE * times[-1]:
                ends.append(float(switch))
            elif nearest in (switch, times[-1] - switch):
                # Here the switching point is close to the start or the end of the motion. Its short
                # arc is kept, because s̈ is largest there. The true switching point lies between the
                # grid point k and its inner neighbour. `extra_time` estimates the time from k to
                # this point: with the mean acceleration between rest and k, the speed changes from
                # that at k to that at the neighbour.
                inner = k + (1 if nearest == switch else -1)
                acceleration = speed[k] / nearest
                extra_time = max(speed[inner] - speed[k], 0.0) / acceleration
                gap = abs(times[inner] - switch)
                ends.append(float(switch + (inner - k) * min(extra_time, gap)))
        borders = np.array(sorted(ends))
        if jerk is not None:
            borders, reversals = _with_ramps(borders, reversals, guess, jerk)
        instants = _element_ends(borders, count)
        # The middle of an element shows in which interval between two reversals the element lies.
        middles = (instants[1:] + instants[:-1]) / 2
        interval = np.clip(np.searchsorted(reversals, middles) - 1, 0, len(reversals) - 2)
        return cls(instants, interval)

    def elements(self, motion: Retiming) -> Array:
        """Sample a motion at the ends of the elements, and scale it to a duration of 1.

        The result is the initial guess of the optimisation. s̈ is constant in each element, and
        equal to the mean slope of ṡ.

        Parameters
        ----------
        motion : Retiming
            Motion along the path, which TOPP-RA has timed on a grid of s.

        Returns
        -------
        (n, 5) array
            s, ṡ, s̈ at the start, s̈ at the end, and length of each element. The unit of time is the
            duration of the motion.
        """
        scale = motion.duration
        shares = self.instants / self.instants[-1]
        s = np.interp(shares * scale, motion.times, motion.s)
        # Between two grid points, ṡ² is linear in s.
        speed = np.sqrt(np.interp(s, motion.s, motion.speed_squared)) * scale
        acceleration = np.diff(speed) / np.diff(shares)
        return np.stack([s[:-1], speed[:-1], acceleration, acceleration, np.diff(shares)], axis=1)


def _element_ends(borders: Array, count: int) -> Array:
    """Divide each arc, the time between two neighbouring borders, into elements of equal length.

    The mesh has `count` elements, or more if some arc would otherwise have fewer than
    `MIN_ELEMENTS_PER_ARC`. Most motions thus have the same number of elements and can share one
    compiled program.

    Parameters
    ----------
    borders : (k + 1,) array
        Start of the first arc, and ends of all k arcs, s.
    count : int
        Number of elements of the mesh.

    Returns
    -------
    (n + 1,) array
        Start of the first element, and ends of all n elements, s.
    """
    lengths = np.diff(borders)
    # Each arc gets the smallest number of elements. The `extra` elements that remain are shared out
    # in proportion to the lengths of the arcs. The tolerance makes exact halves round down, also if
    # the lengths contain rounding errors.
    extra = max(count - MIN_ELEMENTS_PER_ARC * len(lengths), 0)
    extra_before = np.round(np.cumsum(lengths / lengths.sum()) * extra - EQUALITY_TOLERANCE).astype(
        int
    )
    sizes = MIN_ELEMENTS_PER_ARC + np.diff(extra_before, prepend=0)
    # `borders` is longer than `sizes`, because its last entry only ends the last arc.
    starts = [
        start + length * np.arange(size) / size
        for start, length, size in zip(borders, lengths, sizes, strict=False)
    ]
    return np.append(np.concatenate(starts), borders[-1])


def _with_ramps(
    borders: Array, reversals: Array, guess: Retiming, jerk: Array
) -> tuple[Array, Array]:
    """Add a border behind each jump of s̈, at the end of the ramp that replaces the jump.

    If jerk is limited, s̈ cannot jump. A change of s̈ by Δ takes at least the time Δ / s⃛, with the
    largest s⃛ at this instant. This time is called the ramp.

    Parameters
    ----------
    borders : (k,) array
        Start of the motion, instants at which s̈ may jump, and end of the motion, s.
    reversals : (i,) array
        Start of the motion, reversals of its joints, and end of the motion, s.
    guess : Retiming
        Motion along the path, which TOPP-RA has timed on a grid of g + 1 values of s.
    jerk : (g + 1,) array
        Largest s⃛ at the grid points of `guess`, 1/s³.

    Returns
    -------
    borders : (k + number of ramps,) array
        The given borders and the ends of the ramps, s. The ramp behind the last border makes the
        motion longer.
    reversals : (i,) array
        The given instants with the new end of the motion, s.
    """
    middle = (guess.times[1:] + guess.times[:-1]) / 2
    # s̈ before and after a border is its mean over a short window, or 0 outside the motion.
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
        ramp = jump / float(np.interp(border, guess.times, jerk))
        with_ramps.append(border)
        # A very short ramp gets no arc of its own, and a ramp must end before the next border.
        if MIN_ARC_SHARE * guess.duration / 4 < ramp and border + ramp < end - window:
            with_ramps.append(border + ramp)
    return np.array(with_ramps), np.append(reversals[:-1], with_ramps[-1])
