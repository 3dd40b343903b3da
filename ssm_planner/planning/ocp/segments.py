"""Segments of a free motion, with their borders, directions and initial guesses.

In a free motion, the solver chooses the joint path. Every joint keeps its direction within a
segment. Two neighbouring segments meet at a border, which is a given point, a reversal of a joint,
or a passage of the port (incision) of an eye. `guesses` creates the segments, and `free_problem`
reads them.

The mesh divides a segment into elements (time intervals). A switching point is an instant at which
the acceleration of a joint (with a jerk limit: its jerk) jumps in the guess. An arc is a group of
consecutive elements between two switching points.
"""

from collections.abc import Callable, Collection, Sequence
from itertools import pairwise

import numpy as np

from ssm_planner.planning.lower_bound import SCurve
from ssm_planner.planning.ocp.mesh import MIN_ARC_SHARE
from ssm_planner.planning.ocp.nlp import NlpStructure, divide_into_blocks
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.trajectory import CubicPiece, Trajectory
from ssm_planner.typing import Array, Mask, record


@record
class SegmentGuess:
    """Initial guess of one segment of a free motion, with n elements (time intervals)."""

    elements: CubicPiece
    """q, q̇, q̈ at the start and q̈ at the end of the elements, (n, 4) each, and lengths (n, 1), s.
    """
    arcs: tuple[int, ...]
    """Number of elements of each arc, that is, between two consecutive switching points.

    A switching point is an instant at which the acceleration of a joint (with a jerk limit: its
    jerk) jumps in the guess.
    """

    @classmethod
    def sampled(cls, motion: Trajectory, instants: Array, arcs: tuple[int, ...]) -> "SegmentGuess":
        """Build a guess by sampling a motion at the ends of the elements.

        Parameters
        ----------
        motion : Trajectory
            Motion of the joints.
        instants : (n + 1,) array
            Start of the first element (time interval), and ends of all n elements, in the time of
            the motion, s.
        arcs : tuple of int
            Number of elements of each arc, that is, between two consecutive switching points. The
            sum is n.

        Returns
        -------
        SegmentGuess
            Elements with the positions, velocities and accelerations of the motion.
        """
        # The acceleration may jump at an end of an element. The value after the jump belongs to the
        # start of the next element, and the value before it (side "left") to the end of this one.
        starts, ends = motion.sample(instants[:-1]), motion.sample(instants[1:], side="left")
        lengths = np.diff(instants)[:, None]
        return cls(CubicPiece(starts.q, starts.qd, starts.qdd, ends.qdd, lengths), arcs)

    @property
    def motion(self) -> Trajectory:
        """The guess as a trajectory that begins at time 0, with one cubic for each element."""
        cubic = self.elements
        # A trajectory has polynomials of degree 5. The coefficients of t^4 and t^5 are 0.
        zeros = np.zeros_like(cubic.u)
        coefficients = [cubic.u, cubic.v, cubic.a0 / 2, cubic.jerk / 6, zeros, zeros]
        breaks = np.append(0.0, np.cumsum(cubic.h))
        return Trajectory(breaks, np.stack(coefficients, axis=1), ())

    def divided_at_position(self, joint: int, position: float) -> "list[SegmentGuess]":
        """Divide the guess into two halves, between which one joint passes a given position.

        Both halves have the same duration. The motion of the joint is scaled in each half, so that
        it has the given position in the middle. The other joints move as before.

        Parameters
        ----------
        joint : int
            Index of the joint.
        position : float
            Position of the joint between both halves, rad or m.

        Returns
        -------
        list of two SegmentGuess
            Guesses of both halves, each with its own elements (time intervals).
        """
        motion = self.motion
        middle = motion.duration / 2
        gap = MIN_ARC_SHARE * motion.duration
        switches = motion.breaks[np.cumsum(self.arcs)]
        # The number of elements per second remains about the same.
        density = sum(self.arcs) / motion.duration
        instants = np.array([0.0, middle, motion.duration])
        q_start, q_middle, q_end = motion.positions(instants)[:, joint]
        halves = []
        for start, end, q_outer in ((0.0, middle, q_start), (middle, motion.duration, q_end)):
            # Switching points close to an end of a half get no elements of their own.
            inner = switches[(switches > start + gap) & (switches < end - gap)].tolist()
            arcs, ends = divide_arcs([start, *inner, end], density)
            half = self.sampled(motion, ends, arcs)
            # The motion of the joint is scaled, so that both halves meet at the position.
            scale = (position - q_outer) / (q_middle - q_outer)
            cubic = half.elements
            cubic.u[:, joint] = q_outer + scale * (cubic.u[:, joint] - q_outer)
            for values in (cubic.v, cubic.a0, cubic.a1):
                values[:, joint] *= scale
            halves.append(half)
        return halves


def divide_arcs(
    switches: Sequence[float], density: float, least_count: int = 2
) -> tuple[tuple[int, ...], Array]:
    """Divide each arc, the time between two switching instants, into elements of equal length.

    Elements (time intervals) end at the switching instants, because a cubic polynomial cannot
    represent a jump of the acceleration within an element.

    Parameters
    ----------
    switches : sequence of k floats
        Start of the motion, switching instants, and end of the motion, s. At a switching instant,
        the acceleration of a joint (with a jerk limit: its jerk) jumps.
    density : float
        Approximate number of elements per second.
    least_count : int
        Smallest number of elements of an arc, even if it is short.

    Returns
    -------
    arcs : tuple of k − 1 integers
        Number of elements of each arc.
    ends : (n + 1,) array
        Start of the first element, and ends of all elements, s.
    """
    arcs = tuple(
        max(least_count, round(density * (end - start))) for start, end in pairwise(switches)
    )
    nodes = (
        np.linspace(start, end, count + 1)[1:]
        for (start, end), count in zip(pairwise(switches), arcs, strict=True)
    )
    return arcs, np.concatenate([switches[:1], *nodes])


def sample_curves(
    start: Array,
    curves: Sequence[SCurve | None],
    switches: Sequence[float],
    *,
    density: float,
    least_count: int = 2,
) -> SegmentGuess:
    """Build the guess of a segment from motions of the single joints in closed form.

    A segment is a part of the motion in which no joint reverses. It lies between the first and the
    last of `switches`.

    Parameters
    ----------
    start : (4,) array
        Joint positions at time 0, rad and m.
    curves : sequence of SCurve or None
        Motion of each joint from time 0. None for a joint at rest.
    switches : sequence of float
        Start of the segment, switching instants, and end of the segment, s. At a switching instant,
        the acceleration or the jerk of a joint jumps.
    density : float
        Approximate number of elements (time intervals) per second.
    least_count : int
        Smallest number of elements between two switching instants.

    Returns
    -------
    SegmentGuess
        Elements whose positions and velocities at the start, and accelerations at both ends, are
        those of the closed forms.
    """
    arcs, t = divide_arcs(switches, density, least_count)
    middle, lengths = (t[1:] + t[:-1]) / 2, np.diff(t)
    q = np.tile(start, (len(lengths), 1))
    qd, qdd_start, qdd_end = np.zeros((3, *q.shape))
    for i, curve in enumerate(curves):
        if curve is not None:
            displacement, qd[:, i], _ = curve.evaluate(t[:-1])
            q[:, i] += displacement
            # q̈ is linear in an element. Its values at both ends follow from the middle, because it
            # may jump at the ends.
            qdd = curve.evaluate(middle)[2]
            half_jump = 0.5 * lengths * curve.jerk_at(middle)
            qdd_start[:, i], qdd_end[:, i] = qdd - half_jump, qdd + half_jump
    return SegmentGuess(CubicPiece(q, qd, qdd_start, qdd_end, lengths[:, None]), arcs)


@record
class SegmentChain:
    """The k consecutive segments of a free motion, with their initial guesses.

    No joint reverses within a segment. Consecutive segments meet at a border, which is a given
    point, a reversal of a joint, or a passage of the port (incision) of an eye. The start and the
    end of the motion count as borders too.
    """

    points: Array
    """Joint positions at the borders, (k + 1, 4), rad and m."""
    fixed: Mask
    """True for positions that are given, (k + 1, 4).

    A border at which some positions are only guesses is called free. The solver determines these
    positions.
    """
    directions: Array
    """Direction +1, −1 or 0 of every joint in every segment, (k, 4)."""
    guesses: tuple[SegmentGuess, ...]
    """Guess of each segment."""
    ports: tuple[int, ...] = ()
    """Indices of the borders at which the tip passes the port of an eye.

    At such a border, the positions of joint 4 and of joints at rest are given.
    """

    @classmethod
    def joined(cls, chains: "Sequence[SegmentChain]", free: Collection[int]) -> "SegmentChain":
        """Join several chains of segments into one chain.

        Parameters
        ----------
        chains : sequence of SegmentChain
            Chains in the order of time. Each begins at the point at which the previous one ends.
        free : collection of int
            Indices of chains that begin at a free border. The positions of joints that move both
            before and after such a border are only guesses.

        Returns
        -------
        SegmentChain
            The segments of all chains.
        """
        first, *later_chains = chains
        fixed = [first.fixed.copy()]
        for k, (before, after) in enumerate(pairwise(chains), start=1):
            if k in free:
                # A joint that rests on one side of the border has a known position there.
                fixed[-1][-1] = (before.directions[-1] == 0) | (after.directions[0] == 0)
            fixed.append(after.fixed[1:].copy())
        return cls(
            np.concatenate([first.points, *(chain.points[1:] for chain in later_chains)]),
            np.concatenate(fixed),
            np.concatenate([chain.directions for chain in chains]),
            tuple(guess for chain in chains for guess in chain.guesses),
        )

    def structure(
        self, *, one_block_per_segment: bool, has_continuous_acceleration: bool
    ) -> NlpStructure:
        """Return the structure of the nonlinear program that optimises these segments.

        The program has one unknown duration for each block, a group of consecutive elements (time
        intervals). A block is a whole segment, or at most one arc. An arc lies between two
        switching points, that is, instants at which the acceleration of a joint (with a jerk limit:
        its jerk) jumps in the guess.

        Parameters
        ----------
        one_block_per_segment : bool
            True if each block is a segment. False if each block is an arc, or a part of a long arc.
        has_continuous_acceleration : bool
            True if accelerations are continuous, because jerk is limited.

        Returns
        -------
        NlpStructure
            Numbers of elements, segments and blocks, and the joints that move in each segment.
        """
        sizes = tuple(sum(guess.arcs) for guess in self.guesses)
        arcs = [count for guess in self.guesses for count in guess.arcs]
        # Joints that rest in all segments are not unknowns of the program.
        moves = self.directions[:, np.any(self.directions != 0, axis=0)] != 0
        return NlpStructure(
            moves=tuple(map(tuple, moves.tolist())),
            segment_sizes=sizes,
            block_sizes=sizes if one_block_per_segment else divide_into_blocks(arcs),
            has_continuous_acceleration=has_continuous_acceleration,
            limits_jerk=has_continuous_acceleration,
        )

    def divided_at_port(self, port: float, is_outside: Callable[[Array], bool]) -> "SegmentChain":
        """Divide every segment in which the tip passes the port of an eye into two segments.

        The port is the incision through which the tool enters. The tip passes it at a known depth,
        which depends on joint 4 alone. The distance to the retina is only limited on the inner side
        of the new border.

        Parameters
        ----------
        port : float
            Depth of the port, m. At smaller depths, the distance to the retina is not limited.
        is_outside : callable
            Takes joint positions (4,). Returns True if the tip is outside of the eye, or closer to
            the retina than allowed. Only the port permits such a position.

        Returns
        -------
        SegmentChain
            The chain with one more segment for each passage. Its field `ports` contains the indices
            of the new borders.
        """
        points, fixed, ports = [self.points[0]], [self.fixed[0]], []
        directions: list[Array] = []
        guesses: list[SegmentGuess] = []
        for k, guess in enumerate(self.guesses):
            side_directions = self._directions_around_port(k, port, is_outside)
            if len(side_directions) == 1:
                guesses.append(guess)
            else:
                # The depth is |q4|. At the port, q4 has the same sign as at the deeper end.
                deepest = self.points[k : k + 2, 3][np.abs(self.points[k : k + 2, 3]).argmax()]
                depth = float(np.copysign(port, deepest))
                guesses += guess.divided_at_position(3, depth)
                # The new border is the start of the second half. Given there are the position of
                # joint 4, and those of joints that rest on one side.
                border = guesses[-1].elements.u[0].copy()
                border[3] = depth
                ports.append(len(points))
                points.append(border)
                fixed.append((side_directions == 0).any(axis=0) | (np.arange(4) == 3))
            directions += [*side_directions]
            points.append(self.points[k + 1])
            fixed.append(self.fixed[k + 1])
        return SegmentChain(
            np.array(points), np.array(fixed), np.array(directions), tuple(guesses), tuple(ports)
        )

    def _directions_around_port(
        self, k: int, port: float, is_outside: Callable[[Array], bool]
    ) -> Array:
        """Return the directions of the joints before and after the tip passes the port of an eye.

        Joint 4 determines the depth of the tip. If the segment begins or ends exactly at the depth
        of the port, but at an orientation that only the port permits, joint 4 rests there until the
        other joints have moved. In the guess, it rests during half of the segment.

        Parameters
        ----------
        k : int
            Index of the segment.
        port : float
            Depth of the port, m.
        is_outside : callable
            Takes joint positions (4,). Returns True if the tip is outside of the eye, or closer to
            the retina than allowed. Only the port permits such a position.

        Returns
        -------
        (1, 4) or (2, 4) array
            Directions +1, −1 or 0 before and after the passage. One row if the segment need not be
            divided, because the tip does not pass the port or wait at it.
        """
        # Depths beyond the port at both ends of the segment. `shallow_end` is the index of the
        # smaller one.
        ends, directions = self.points[k : k + 2], self.directions[k : k + 1]
        depth_inside = np.abs(ends[:, 3]) - port
        shallow_end = int(depth_inside.argmin())
        at_edge = bool(abs(depth_inside[shallow_end]) <= ROUNDING_TOLERANCE)
        waits_or_passes = (
            is_outside(ends[shallow_end]) if at_edge else bool(depth_inside[shallow_end] < 0)
        )
        # Nothing is divided if the tip stays outside the eye or in its port, or stays inside.
        if depth_inside.max() <= ROUNDING_TOLERANCE or not waits_or_passes:
            return directions
        # Row 0 is the half before the border, row 1 the half after it. A joint 4 that waits at the
        # port has the direction 0 in the half beside the shallow end.
        side_directions = np.tile(directions, (2, 1))
        side_directions[shallow_end, 3] *= not at_edge
        return side_directions

    def is_within_port(self, port: float) -> Mask:
        """Return True for the segments in which the tip stays outside an eye or in its port.

        The depth is |q4|. It is monotone in a segment, so the depths at both borders decide. A
        segment that crosses the port in the guess has been divided there (`divided_at_port`).

        Parameters
        ----------
        port : float
            Depth of the port (the incision through which the tool enters), m.

        Returns
        -------
        (k,) mask
            True for the segments in which the depth is at most `port`.
        """
        depths = np.abs(self.points[:, 3])
        return np.asarray(np.maximum(depths[:-1], depths[1:]) <= port + ROUNDING_TOLERANCE)
