"""Segments of a free motion: their guesses, borders and directions.

A segment lies between two borders, which are points, reversals, or passages of the port of an eye.
Every joint keeps its direction within a segment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ssm_planner.elements.rows import UNLIMITED
from ssm_planner.planning.ocp.mesh import SegmentGuess, closed_form_guess, sampled_guess
from ssm_planner.planning.ocp.nlp import NlpStructure, blocks_of
from ssm_planner.planning.ocp.turning import SegmentGuesses, braking, guess_with_reversals
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask, record

RAMP = 5e-4
"""Share of the time between two points in which a joint without a jerk limit reaches its
acceleration.

It applies if another joint has a jerk limit.
"""
KINEMATIC = ("velocity", "acceleration", "jerk")
"""Limits of joints by the order of their derivative."""


def segment_guess(
    displacement: Array,
    speeds: Array,
    table: Array,
    *,
    per_segment: int,
    least_count: int,
    jerk: bool,
    start_acceleration: Array,
) -> SegmentGuesses:
    """Return the guess over a displacement (4,) between velocities (2, 4).

    `start_acceleration` (4,) is q̈ at its start.
    """
    start, end = speeds
    if not speeds.any():
        guess = closed_form_guess(displacement, table, jerk, per_segment, least_count)
        positions = np.stack([np.zeros(4), displacement])
        return SegmentGuesses(
            (guess,), positions, np.ones((2, 4), dtype=bool), np.sign(displacement[None])
        )
    brake = table[1]
    if jerk:
        brake = np.minimum(
            braking(start, start_acceleration, table), braking(end, np.zeros(4), table)
        )
    limits = np.stack([table[0], table[1], brake])
    return guess_with_reversals(
        displacement, (start, end), limits, count=per_segment, least_count=least_count
    )


def sampled_segments(
    motion: Trajectory,
    instants: Array,
    displacements: Array,
    directions: Array,
    *,
    count: int,
    least_count: int,
) -> list[SegmentGuesses]:
    """Return guesses for displacements (k, 4) by about `count` elements, sampled from a motion.

    `instants` (k + 1,) are the borders of the motion, s.
    """
    segments = []
    for start, end, displacement, signs in zip(
        instants[:-1], instants[1:], displacements, directions, strict=True
    ):
        n = max(2 * least_count, round(count * (end - start) / motion.duration))
        guess = sampled_guess(motion, float(start), float(end), n)
        speed = np.where(guess.states[1] * signs > 0, guess.states[1], 0.0)
        guess = replace(guess, states=(guess.states[0], speed, *guess.states[2:]))
        positions = np.stack([np.zeros(4), displacement])
        segments.append(
            SegmentGuesses((guess,), positions, np.ones((2, 4), dtype=bool), signs[None])
        )
    return segments


def jerk_for_all(
    limits: dict[str, Array], displacements: Array, ends: tuple[Array, Array]
) -> Array:
    """Return a jerk limit for every joint, (4,), if one joint has a limit.

    A joint without a limit reaches its acceleration in a share RAMP of the time of the quickest
    displacement (k, 4).
    """
    velocity, acceleration, jerk = (limits[name] for name in KINEMATIC)
    takes = np.abs(displacements) / velocity + 2 * np.sqrt(np.abs(displacements) / acceleration)
    takes[[0, -1]] += np.abs(ends) / acceleration
    ramp = RAMP * takes.max(axis=1).min()
    return np.where(jerk < UNLIMITED, jerk, acceleration / ramp)


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

        If a segment begins or ends at the edge of the port, joint 4 stands there until the others
        allow it to move on. In the guess it stands as long as it then moves. `is_outside` tells
        whether the retina's row forbids joints (4,).
        """
        points, fixed, ports = [self.points[0]], [self.fixed[0]], []
        directions: list[Array] = []
        guesses: list[SegmentGuess] = []
        for k, guess in enumerate(self.guesses):
            ends = self.points[k : k + 2]
            sides = np.tile(self.directions[k], (2, 1))
            beyond = np.abs(ends[:, 3]) - port
            inner = int(beyond.argmin())
            at_edge = bool(abs(beyond[inner]) <= ROUNDING)
            if beyond.max() > ROUNDING and (
                is_outside(ends[inner]) if at_edge else beyond[inner] < 0
            ):
                sides[inner, 3] *= not at_edge
                halves, position = guess.halves(
                    3, np.copysign(port, ends[1 - inner, 3]) - ends[0, 3], least_count
                )
                ports.append(len(points))
                points.append(ends[0] + position)
                fixed.append((sides == 0).any(axis=0) | (np.arange(4) == 3))
                guesses += halves
                directions += [*sides]
            else:
                guesses.append(guess)
                directions.append(sides[0])
            points.append(ends[1])
            fixed.append(self.fixed[k + 1])
        return SegmentChain(
            np.array(points), np.array(fixed), np.array(directions), tuple(guesses), tuple(ports)
        )

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
