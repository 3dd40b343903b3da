"""Segments of a free motion: their borders, directions and guesses.

A segment lies between two borders, which are points, reversals, or passages of the port of an eye.
Every joint keeps its direction within a segment.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from ssm_planner.planning.lower_bound import SCurve
from ssm_planner.planning.ocp.mesh import SHORTEST_ARC
from ssm_planner.planning.ocp.nlp import NlpStructure, blocks_of
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, Mask, record


@record
class SegmentGuess:
    """Guess of one segment of a free motion, with n elements."""

    elements: Cubic
    """q, q̇, and q̈ at both ends of the elements, (n, 4) each, with their lengths (n, 1), s."""
    arcs: tuple[int, ...]
    """Number of elements between consecutive switching points."""

    @property
    def instants(self) -> Array:
        """Ends of the elements, (n + 1,), s."""
        return np.append(0.0, np.cumsum(self.elements.h))

    def halves(
        self, joint: int, position: float, least_count: int
    ) -> tuple[SegmentGuess, SegmentGuess]:
        """Split the guess in the middle, where joint `joint` shall pass a position.

        The joint moves faster or slower than before in each half.
        """
        instants = self.instants
        duration = float(instants[-1])
        positions = np.append(self.elements.u[:, joint], self.elements.end[0][-1, joint])
        sense = np.sign(positions[-1] - positions[0])
        passes = float(np.interp(sense * position, sense * positions, instants))
        return (
            self._part((0.0, duration / 2), joint, (0.0, passes), least_count),
            self._part((duration / 2, duration), joint, (passes, duration), least_count),
        )

    def _part(
        self,
        span: tuple[float, float],
        joint: int,
        joint_span: tuple[float, float],
        least_count: int,
    ) -> SegmentGuess:
        """Return the guess in a span of time, with one joint taken from another span."""
        start, end = span
        instants = self.instants
        gap = SHORTEST_ARC * instants[-1]
        switches = instants[np.cumsum(self.arcs)]
        inner = switches[(switches > start + gap) & (switches < end - gap)]
        density = sum(self.arcs) / float(instants[-1])
        arcs, t = elements_between([start, *inner.tolist(), end], density, least_count)
        rate = (joint_span[1] - joint_span[0]) / (end - start)
        states = self._states(t)
        joint_states = self._states(joint_span[0] + rate * (t - start))
        for state, joint_state, order in zip(states, joint_states, (0, 1, 2, 2), strict=True):
            state[:, joint] = rate**order * joint_state[:, joint]
        return SegmentGuess(Cubic(*states, np.diff(t)[:, None]), arcs)

    def _states(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Return q, q̇, and q̈ at the start and at the end between instants t (n + 1,), (n, 4)."""
        q, qd, qdd_start = self._states_at(t[:-1], "right")
        *_, qdd_end = self._states_at(t[1:], "left")
        return q, qd, qdd_start, qdd_end

    def _states_at(self, t: Array, side: Literal["left", "right"]) -> tuple[Array, Array, Array]:
        """Return q, q̇ and q̈ on one side of instants t (n,), (n, 4) each."""
        instants, motion = self.instants, self.elements
        k = np.searchsorted(instants[1:-1], t, side)
        pieces = Cubic(motion.u[k], motion.v[k], motion.a0[k], motion.a1[k], motion.h[k])
        return pieces.at_time((t - instants[k])[:, None])


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


def guess_of_curves(
    start: Array,
    curves: Sequence[SCurve | None],
    switches: Sequence[float],
    *,
    density: float,
    least_count: int,
) -> SegmentGuess:
    """Return the part of a motion between the first and last switching instant.

    Parameters
    ----------
    start : (m,) array
        Joints at time 0.
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
    middle, lengths = (t[1:] + t[:-1]) / 2, np.diff(t)
    q = np.tile(start, (len(lengths), 1))
    qd, qdd_start, qdd_end = np.zeros((3, *q.shape))
    for i, curve in enumerate(curves):
        if curve is not None:
            displacement, qd[:, i], _ = curve.evaluate(t[:-1])
            q[:, i] += displacement
            qdd = curve.evaluate(middle)[2]
            half_rise = 0.5 * lengths * curve.jerk_at(middle)
            qdd_start[:, i], qdd_end[:, i] = qdd - half_rise, qdd + half_rise
    return SegmentGuess(Cubic(q, qd, qdd_start, qdd_end, lengths[:, None]), arcs)


@record
class SegmentChain:
    """The k segments of a free motion, and its guess."""

    points: Array
    """Joints at the borders, (k + 1, 4)."""
    fixed: Mask
    """True where these are fixed, (k + 1, 4)."""
    directions: Array
    """Direction of every joint in every segment, (k, 4)."""
    guesses: tuple[SegmentGuess, ...]
    ports: tuple[int, ...] = ()
    """Borders at which the tip passes the port of an eye. Joint 4 alone is fixed there."""

    @classmethod
    def joined(cls, chains: Sequence[SegmentChain], free: Collection[int]) -> SegmentChain:
        """Return one chain of several. Each begins at the point where the previous one ends.

        The positions at the ends of the chains before those numbered `free` are only guesses.
        """
        first, *others = chains
        fixed = [first.fixed.copy()]
        for k, (before, after) in enumerate(pairwise(chains), start=1):
            if k in free:
                # A joint that rests on one side of a border stays where it is.
                fixed[-1][-1] = (before.directions[-1] == 0) | (after.directions[0] == 0)
            fixed.append(after.fixed[1:].copy())
        return cls(
            np.concatenate([first.points, *(chain.points[1:] for chain in others)]),
            np.concatenate(fixed),
            np.concatenate([chain.directions for chain in chains]),
            tuple(guess for chain in chains for guess in chain.guesses),
        )

    def structure(self, *, one_time_per_segment: bool, smooth: bool) -> NlpStructure:
        """Return the structure of the program. With `one_time_per_segment`, each segment has one time."""
        sizes = tuple(sum(guess.arcs) for guess in self.guesses)
        arcs = [n for guess in self.guesses for n in guess.arcs]
        moves = self.directions[:, np.any(self.directions != 0, axis=0)] != 0
        return NlpStructure(
            moves=tuple(map(tuple, moves.tolist())),
            segment_sizes=sizes,
            block_sizes=sizes if one_time_per_segment else blocks_of(arcs),
            smooth=smooth,
            velocity_limits=True,
            joints=True,
        )

    def cut_at(
        self, port: float, is_outside: Callable[[Array], bool], least_count: int
    ) -> SegmentChain:
        """Insert a border where joint 4 passes the port. The retina's row only holds beyond it.

        `is_outside` tells whether the retina's row forbids joints (4,).
        """
        points, fixed, ports = [self.points[0]], [self.fixed[0]], []
        directions: list[Array] = []
        guesses: list[SegmentGuess] = []
        for k, guess in enumerate(self.guesses):
            sides = self._sides_of_port(k, port, is_outside)
            if len(sides) == 1:
                guesses.append(guess)
            else:
                deepest = self.points[k : k + 2, 3][np.abs(self.points[k : k + 2, 3]).argmax()]
                depth = float(np.copysign(port, deepest))
                guesses += guess.halves(3, depth, least_count)
                meeting = guesses[-1].elements.u[0].copy()
                meeting[3] = depth
                ports.append(len(points))
                points.append(meeting)
                fixed.append((sides == 0).any(axis=0) | (np.arange(4) == 3))
            directions += [*sides]
            points.append(self.points[k + 1])
            fixed.append(self.fixed[k + 1])
        return SegmentChain(
            np.array(points), np.array(fixed), np.array(directions), tuple(guesses), tuple(ports)
        )

    def _sides_of_port(self, k: int, port: float, is_outside: Callable[[Array], bool]) -> Array:
        """Return the directions (1 or 2, 4) of segment k, before and after joint 4 passes the port.

        If the segment begins or ends at the edge of the port, joint 4 rests there until the others
        allow it to move on. In the guess it rests for as long as it then moves.
        """
        ends, directions = self.points[k : k + 2], self.directions[k : k + 1]
        beyond = np.abs(ends[:, 3]) - port
        inner = int(beyond.argmin())
        at_edge = bool(abs(beyond[inner]) <= ROUNDING)
        waits_or_passes = is_outside(ends[inner]) if at_edge else bool(beyond[inner] < 0)
        if beyond.max() <= ROUNDING or not waits_or_passes:
            return directions
        sides = np.tile(directions, (2, 1))
        sides[inner, 3] *= not at_edge
        return sides

    def within(self, port: float) -> Mask:
        """Return the segments (k,) in which the depth of the tip is at most `port`, m.

        The depth of a point that is not fixed is unknown. Within a segment, the depth only grows or
        only shrinks. A point is therefore at most as deep as its neighbour if the depth grows
        towards the neighbour. Two passes, forwards and backwards, carry the depths of the fixed
        points to all others.
        """
        depths = np.abs(self.points[:, 3])
        upper = np.where(self.fixed[:, 3], depths, np.inf)
        grows = np.diff(depths)
        for k in [*range(len(grows)), *reversed(range(len(grows)))]:
            if grows[k] >= 0:
                upper[k] = min(upper[k : k + 2])
            if grows[k] <= 0:
                upper[k + 1] = min(upper[k : k + 2])
        return np.asarray(np.maximum(upper[:-1], upper[1:]) <= port + ROUNDING)
