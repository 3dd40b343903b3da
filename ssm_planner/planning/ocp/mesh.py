"""Meshes and guesses: where elements end, and the motion at which the optimisation begins.

A straight phase begins at the motion of TOPP-RA along its path. Its elements end where the binding
limit of that motion changes (`Mesh`). A free phase begins at a motion in closed form that keeps the
limits of velocity, acceleration and jerk and rests at every point (`closed_form_guess`).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from ssm_planner.planning.lower_bound import SCurve, rest_to_rest
from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.planning.tolerances import ROUNDING, SAME
from ssm_planner.trajectory import Cubic, Trajectory
from ssm_planner.typing import Array, Indices, record

SHORTEST_ARC = 0.01
"""Arcs shorter than this share of the duration are joined with their neighbour."""
UP_TO_SPEED = 0.5
"""Short arcs at the ends remain if ṡ reaches this share of its maximum, since slow motions spend
little time on them.
"""
FEWEST = 5
"""Number of elements of the shortest arc."""
Side = Literal["left", "right"]
"""Side of an instant."""


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


@record
class SegmentGuess:
    """Guess of one segment of a free motion, with n elements."""

    duration: float
    """Duration, s."""
    instants: Array
    """Ends of the elements, (n + 1,), s."""
    states: tuple[Array, Array, Array, Array]
    """q − start, q̇, q̈ at the start and q̈ at the end of every element, (n, joints) each."""
    arcs: tuple[int, ...]
    """Number of elements between consecutive switching points."""

    def halves(
        self, joint: int, position: float, least_count: int
    ) -> tuple[tuple[SegmentGuess, SegmentGuess], Array]:
        """Split the guess in the middle, where joint `joint` passes q − start = position.

        The joint moves faster or slower than before in each half. Returns both halves, and q −
        start where they meet, (joints,).
        """
        positions = np.append(
            self.states[0][:, joint], self._evaluate(self.instants[-1:], "left")[0][0, joint]
        )
        side, middle = np.sign(positions[-1]), self.duration / 2
        passes = float(np.interp(side * position, side * positions, self.instants))
        first_half, meeting = self._extract((0.0, middle), joint, (0.0, passes), least_count)
        second_half, _ = self._extract(
            (middle, self.duration), joint, (passes, self.duration), least_count
        )
        meeting[joint] = position
        return (first_half, second_half), meeting

    def _extract(
        self,
        span: tuple[float, float],
        joint: int,
        joint_span: tuple[float, float],
        least_count: int,
    ) -> tuple[SegmentGuess, Array]:
        """Return the guess in a span of time, with one joint taken from another span.

        The second value is q − start at the end, (joints,).
        """
        start, end = span
        gap = SHORTEST_ARC * self.duration
        switches = self.instants[np.cumsum(self.arcs)]
        switches_inside = [float(t) for t in switches if start + gap < t < end - gap]
        arcs, t = elements_between(
            [start, *switches_inside, end], sum(self.arcs) / self.duration, least_count
        )
        rate = (joint_span[1] - joint_span[0]) / (end - start)

        def states_at(instants: Array, side: Side) -> tuple[Array, ...]:
            states, of_joint = (
                self._evaluate(times, side)
                for times in (instants, joint_span[0] + rate * (instants - start))
            )
            for order in range(3):
                states[order][:, joint] = rate**order * of_joint[order][:, joint]
            return states

        q, qd, qdd_start = states_at(t[:-1], "right")
        q_end, _, qdd_end = states_at(t[1:], "left")
        return SegmentGuess(
            end - start, t - start, (q - q[0], qd, qdd_start, qdd_end), arcs
        ), q_end[-1]

    def _evaluate(self, t: Array, side: Side) -> tuple[Array, Array, Array]:
        """Return q − start, q̇ and q̈ at instants (n,), on one side of them, (n, joints) each."""
        k = np.clip(np.searchsorted(self.instants, t, side) - 1, 0, len(self.instants) - 2)
        q, qd, qdd_start, qdd_end = (state[k] for state in self.states)
        return Cubic(q, qd, qdd_start, qdd_end, np.diff(self.instants)[k, None]).at_time(
            (t - self.instants[k])[:, None]
        )


def elements_between(
    switches: Sequence[float], density: float, least_count: int
) -> tuple[tuple[int, ...], Array]:
    """Return elements between switching instants (k,), s, about `density` per second.

    Returns their numbers (k − 1,) and their ends (n + 1,), s.
    """
    arcs = tuple(
        max(least_count, round(density * (end - start))) for start, end in pairwise(switches)
    )
    nodes = (
        np.linspace(start, end, n + 1)[1:]
        for (start, end), n in zip(pairwise(switches), arcs, strict=True)
    )
    return arcs, np.concatenate([switches[:1], *nodes])


def closed_form_guess(
    displacement: Array, limits: Array, jerk: bool, count: int, least_count: int
) -> SegmentGuess:
    """Return the guess of joints that move by `displacement` (m,) from rest to rest.

    The slowest joint moves as fast as it can alone. The others move in step with it if that keeps
    their limits, and otherwise by their own fastest motion, stretched to its time. Without other
    limits this is optimal.

    Parameters
    ----------
    displacement : (m,) array
        Displacements, some of them 0, in rad and m.
    limits : (3, m) array
        Limits of velocity, acceleration and jerk.
    jerk : bool
        True if the jerk limits count.
    count : int
        Approximate number of elements.
    least_count : int
        Smallest number of elements between two switching points.
    """
    moving = np.flatnonzero(displacement)
    distances = np.abs(displacement)
    velocity, acceleration, jerks = limits.tolist()
    alone = {
        k: rest_to_rest(
            float(distances[k]), velocity[k], acceleration[k], jerks[k] if jerk else None
        )
        for k in moving
    }
    slowest_joint = max(moving, key=lambda k: alone[k].duration)
    leader = alone[slowest_joint]
    curves: list[SCurve | None] = [None] * len(displacement)
    for k in moving:
        in_step = leader.scaled(distances[k] / distances[slowest_joint])
        keeps_limits = all(
            peak <= limit * (1 + ROUNDING)
            for peak, limit in zip(in_step.peaks[: 2 + jerk], limits[:, k], strict=False)
        )
        profile = in_step if keeps_limits else alone[k].stretched(leader.duration)
        curves[k] = profile.scaled(np.sign(displacement[k]))
    return guess_of_curves(curves, leader.switches.tolist(), count / leader.duration, least_count)


def guess_of_curves(
    curves: Sequence[SCurve | None], switches: Sequence[float], density: float, least_count: int
) -> SegmentGuess:
    """Return the part of a motion between the first and last switching instant.

    Parameters
    ----------
    curves : sequence of SCurve or None
        Motion of every joint. None for a joint at rest.
    switches : sequence of float
        Switching instants, s.
    density : float
        Approximate number of elements per second.
    least_count : int
        Smallest number of elements between two switching points.
    """
    arcs, t = elements_between(switches, density, least_count)
    middle, size = (t[1:] + t[:-1]) / 2, (len(t) - 1, len(curves))
    states = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    for i, curve in enumerate(curves):
        if curve is None:
            continue
        q, qd, _ = curve.evaluate(t[:-1])
        qdd = curve.evaluate(middle)[2]
        half_rise = 0.5 * np.diff(t) * curve.jerk_at(middle)
        values = q - q[0], qd, qdd - half_rise, qdd + half_rise
        for state, value in zip(states, values, strict=True):
            state[:, i] = value
    return SegmentGuess(switches[-1] - switches[0], t - t[0], states, arcs)


def sampled_guess(motion: Trajectory, start: float, end: float, count: int) -> SegmentGuess:
    """Return the part of a motion between two instants, with `count` elements of equal length."""
    t = np.linspace(start, end, count + 1)
    left_state = motion.sample(t[:-1])
    right_state = motion.sample(t[1:], side="left")
    return SegmentGuess(
        end - start,
        t - start,
        (left_state.q - left_state.q[0], left_state.qd, left_state.qdd, right_state.qdd),
        (count,),
    )
