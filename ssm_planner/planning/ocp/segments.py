"""Segments of a free motion, with their borders, directions and initial guesses.

Every joint keeps its direction within a segment. Two neighbouring segments meet at a border, which
is a given point, a reversal of a joint, or a passage of the port (incision) of an eye. `guesses`
creates the segments, and `free_problem` reads them.

The mesh divides a segment into elements (time intervals). An arc is a group of consecutive elements
between two switching points, that is, instants at which the acceleration of a joint jumps in the
guess (with a jerk limit: at which its jerk jumps).
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

    At a switching point, the acceleration of a joint jumps in the guess, or its jerk.
    """

    @classmethod
    def sampled(cls, motion: Trajectory, instants: Array, arcs: tuple[int, ...]) -> "SegmentGuess":
        """Sample the guess from a motion.

        Parameters
        ----------
        motion : Trajectory
            Motion of the joints.
        instants : (n + 1,) array
            Ends of the elements, s.
        arcs : tuple of int
            Number of elements of each arc (between two switching points). Their sum is n.

        Returns
        -------
        SegmentGuess
            Elements with the positions, velocities and accelerations of the motion.
        """
        starts, ends = motion.sample(instants[:-1]), motion.sample(instants[1:], side="left")
        lengths = np.diff(instants)[:, None]
        return cls(CubicPiece(starts.q, starts.qd, starts.qdd, ends.qdd, lengths), arcs)

    @property
    def motion(self) -> Trajectory:
        """The guess as joint polynomials, which begin at time 0."""
        cubic = self.elements
        zeros = np.zeros_like(cubic.u)
        coefficients = [cubic.u, cubic.v, cubic.a0 / 2, cubic.jerk / 6, zeros, zeros]
        breaks = np.append(0.0, np.cumsum(cubic.h))
        return Trajectory(breaks, np.stack(coefficients, axis=1), ())

    def divided_at_position(
        self, joint: int, position: float, least_count: int
    ) -> "tuple[SegmentGuess, SegmentGuess]":
        """Divide the guess into halves of equal duration, between which a joint passes a position.

        The motion of this joint is compressed in time in one half and stretched in the other one,
        so that the joint has the given position in the middle.

        Parameters
        ----------
        joint : int
            Index of the joint.
        position : float
            Position of the joint between both halves, rad or m.
        least_count : int
            Smallest number of elements of an arc (between two switching points).

        Returns
        -------
        first, second : SegmentGuess
            Both halves.
        """
        motion = self.motion
        duration = motion.duration
        positions = motion.positions(motion.breaks)[:, joint]
        direction = np.sign(positions[-1] - positions[0])
        passing_time = float(np.interp(direction * position, direction * positions, motion.breaks))
        middle = duration / 2
        return (
            self._part_during((0.0, middle), joint, (0.0, passing_time), least_count),
            self._part_during((middle, duration), joint, (passing_time, duration), least_count),
        )

    def _part_during(
        self,
        span: tuple[float, float],
        joint: int,
        joint_span: tuple[float, float],
        least_count: int,
    ) -> "SegmentGuess":
        """Return the guess during an interval, with the motion of one joint from another interval.

        Parameters
        ----------
        span : (float, float)
            Start and end of the interval in the time of the guess, s.
        joint : int
            Index of the joint whose motion is taken from another interval.
        joint_span : (float, float)
            Start and end of the interval from which this joint's motion is taken, s. The motion is
            stretched or compressed in time to the duration of `span`.
        least_count : int
            Smallest number of elements of an arc (between two switching points).

        Returns
        -------
        SegmentGuess
            The guess during `span`.
        """
        (start, end), motion = span, self.motion
        gap = MIN_ARC_SHARE * motion.duration
        switches = motion.breaks[np.cumsum(self.arcs)]
        inner_switches = switches[(switches > start + gap) & (switches < end - gap)]
        density = sum(self.arcs) / motion.duration
        arcs, t = divide_arcs([start, *inner_switches.tolist(), end], density, least_count)
        rate = (joint_span[1] - joint_span[0]) / (end - start)
        result = self.sampled(motion, t, arcs)
        stretched = self.sampled(motion, joint_span[0] + rate * (t - start), arcs).elements
        for name, order in (("u", 0), ("v", 1), ("a0", 2), ("a1", 2)):
            values = getattr(stretched, name)[:, joint]
            getattr(result.elements, name)[:, joint] = rate**order * values
        return result


def divide_arcs(
    switches: Sequence[float], density: float, least_count: int
) -> tuple[tuple[int, ...], Array]:
    """Divide the arcs between switching instants into elements of equal length.

    The elements end at the switching instants, because a cubic polynomial cannot represent a jump
    of the acceleration within an element.

    Parameters
    ----------
    switches : sequence of k floats
        Start, switching instants and end, s. The acceleration of a joint (with a jerk limit: its
        jerk) jumps at each switching instant.
    density : float
        Approximate number of elements per second.
    least_count : int
        Smallest number of elements of an arc, even if it is short.

    Returns
    -------
    arcs : tuple of k − 1 integers
        Number of elements of each arc.
    ends : (n + 1,) array
        Ends of the elements, s.
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
    least_count: int,
) -> SegmentGuess:
    """Sample the guess of a segment from motions of the joints in closed form.

    The segment lies between the first and the last switching instant.

    Parameters
    ----------
    start : (m,) array
        Joint positions at time 0, rad and m.
    curves : sequence of SCurve or None
        Motion of every joint from time 0. None for a joint at rest.
    switches : sequence of float
        Switching instants, s.
    density : float
        Approximate number of elements per second.
    least_count : int
        Smallest number of elements of an arc between two switching instants.

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
            qdd = curve.evaluate(middle)[2]
            half_jump = 0.5 * lengths * curve.jerk_at(middle)
            qdd_start[:, i], qdd_end[:, i] = qdd - half_jump, qdd + half_jump
    return SegmentGuess(CubicPiece(q, qd, qdd_start, qdd_end, lengths[:, None]), arcs)


@record
class SegmentChain:
    """The k consecutive segments of a free motion, with their initial guesses.

    No joint reverses within a segment. Consecutive segments meet at a border, which is a given
    point, a reversal of a joint, or a passage of the port (incision) of an eye.
    """

    points: Array
    """Joint positions at the borders, (k + 1, 4), rad and m."""
    fixed: Mask
    """True for positions that are given, (k + 1, 4).

    False for positions that are only guesses, at a free border. The solver determines them.
    """
    directions: Array
    """Direction +1, −1 or 0 of every joint in every segment, (k, 4)."""
    guesses: tuple[SegmentGuess, ...]
    """Guess of each segment."""
    ports: tuple[int, ...] = ()
    """Indices of borders at which the tip passes the port of an eye. Only joint 4 is fixed there.
    """

    @classmethod
    def joined(cls, chains: "Sequence[SegmentChain]", free: Collection[int]) -> "SegmentChain":
        """Join several chains into one. Each begins at the point at which the previous one ends.

        Parameters
        ----------
        chains : sequence of SegmentChain
            Chains in the order of time.
        free : collection of int
            Indices of chains that begin at a free border. The positions of joints that move before
            and after such a border are only guesses.

        Returns
        -------
        SegmentChain
            The segments of all chains.
        """
        first, *later_chains = chains
        fixed = [first.fixed.copy()]
        for k, (before, after) in enumerate(pairwise(chains), start=1):
            if k in free:
                # A joint that rests on one side of a border stays where it is.
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

        Parameters
        ----------
        one_block_per_segment : bool
            True if the duration of a segment is one unknown. Otherwise each arc (between two jumps
            of a joint's acceleration in the guess) is a block, whose duration is an unknown.
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
            velocity_limits=True,
            coordinates_are_joints=True,
        )

    def divided_at_port(
        self, port: float, is_outside: Callable[[Array], bool], least_count: int
    ) -> "SegmentChain":
        """Divide every segment in which the tip passes the port of an eye.

        The depth of the tip depends on joint 4 alone. The distance to the retina is only limited on
        the inner side of the new border.

        Parameters
        ----------
        port : float
            Depth of the port, m.
        is_outside : callable
            Returns True if the tip, at joint positions (4,), is closer to the retina than allowed.
            Only the port permits such a position.
        least_count : int
            Smallest number of elements of an arc (between two switching points).

        Returns
        -------
        SegmentChain
            The chain with one more segment for each passage. `ports` contains the new borders.
        """
        points, fixed, ports = [self.points[0]], [self.fixed[0]], []
        directions: list[Array] = []
        guesses: list[SegmentGuess] = []
        for k, guess in enumerate(self.guesses):
            side_directions = self._directions_around_port(k, port, is_outside)
            if len(side_directions) == 1:
                guesses.append(guess)
            else:
                # Joint 4 has the sign of the deeper end at the port.
                deepest = self.points[k : k + 2, 3][np.abs(self.points[k : k + 2, 3]).argmax()]
                depth = float(np.copysign(port, deepest))
                guesses += guess.divided_at_position(3, depth, least_count)
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
        """Return the directions of the joints before and after joint 4 passes the port.

        If the segment begins or ends at the edge of the port, joint 4 rests there until the other
        joints allow it to move on. In the guess it rests during half of the segment.

        Parameters
        ----------
        k : int
            Index of the segment.
        port : float
            Depth of the port, m.
        is_outside : callable
            Returns True if the tip, at joint positions (4,), is closer to the retina than allowed.
            Only the port permits such a position.

        Returns
        -------
        (1, 4) or (2, 4) array
            Directions +1, −1 or 0. One row if joint 4 neither passes the port nor rests at it.
        """
        ends, directions = self.points[k : k + 2], self.directions[k : k + 1]
        depth_inside = np.abs(ends[:, 3]) - port
        shallow_end = int(depth_inside.argmin())
        at_edge = bool(abs(depth_inside[shallow_end]) <= ROUNDING_TOLERANCE)
        waits_or_passes = (
            is_outside(ends[shallow_end]) if at_edge else bool(depth_inside[shallow_end] < 0)
        )
        if depth_inside.max() <= ROUNDING_TOLERANCE or not waits_or_passes:
            return directions
        side_directions = np.tile(directions, (2, 1))
        side_directions[shallow_end, 3] *= not at_edge
        return side_directions

    def is_within_port(self, port: float) -> Mask:
        """Determine the segments in which the tip certainly stays outside the eye or in its port.

        The depth is only known at borders with fixed positions, but it only grows or only shrinks
        within a segment (between two borders). If it grows from one border to the next, the depth
        at the second border is an upper bound of the depth at the first. Two passes, forwards and
        backwards, carry the upper bounds to all borders. The program does not limit the distance to
        the retina in these segments.

        Parameters
        ----------
        port : float
            Depth of the port, m.

        Returns
        -------
        (k,) mask
            True for the segments in which the depth is at most `port`.
        """
        depths = np.abs(self.points[:, 3])
        upper_bounds = np.where(self.fixed[:, 3], depths, np.inf)
        increase = np.diff(depths)
        for k in [*range(len(increase)), *reversed(range(len(increase)))]:
            if increase[k] >= 0:
                upper_bounds[k] = min(upper_bounds[k : k + 2])
            if increase[k] <= 0:
                upper_bounds[k + 1] = min(upper_bounds[k : k + 2])
        return np.asarray(
            np.maximum(upper_bounds[:-1], upper_bounds[1:]) <= port + ROUNDING_TOLERANCE
        )
