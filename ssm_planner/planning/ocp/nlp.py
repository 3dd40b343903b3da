"""Values that describe a nonlinear program: structure, boundary conditions, data and solution.

The optimal control problems (`free_problem`, `straight`) create these values. The solvers
(`transcription` with Ipopt, `structured`) read them. All modules of this package use these terms:

- Element: one of the n time intervals of the mesh. In it, each of the m coordinates u (the path
  parameter s, or the moving joints) is a cubic polynomial of time. Arrays of elements have the
  shape (n, 4 m + 1). A row contains u, u̇, ü at the start of the element and ü at its end (m numbers
  each), and the length of the element, that is, its duration.
- Border: a point where u is given, or a free position, which the solver chooses, where a joint
  reverses. Borders divide the elements into k segments. A coordinate keeps its direction in a
  segment.
- Block: a group of consecutive elements. The duration of each of the b blocks is an unknown, and
  the elements of a block share it in fixed proportion.
- Path constraint (row): a function of the motion at one instant that must not exceed 1.
- Element model (`elements.element.ElementModel`): the functions that give the path constraints and
  the cost of one element.

All lengths and times are scaled: u by units of length, and time by about the duration of the
motion.
"""

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from ssm_planner.interior.solve import State
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.trajectory import CubicPiece
from ssm_planner.typing import Array, Indices, Mask, frozen, record

Solver = Literal["structured", "Ipopt"]
"""Name of a solver."""
Method = Literal["Ipopt", "structured", "confirmed", "estimated"]
"""Solution method of one attempt. `phase_planner` chooses another one if the attempt fails.

"Ipopt": by Ipopt alone. "structured": by the structured solver (`ocp.structured`). "confirmed": by
the structured solver, then Ipopt confirms the optimum. "estimated": by the structured solver, only
to estimate the duration.
"""
MAX_BLOCK_ELEMENTS = 20
"""Largest number of elements of a block.

An arc is the part of a motion between two instants at which the acceleration of a joint (with a
jerk limit: its jerk) jumps in the guess. An arc with more elements is divided into several blocks,
whose durations may differ.
"""


@frozen
class NlpStructure:
    """Numbers of elements, segments and blocks, and the kinds of constraints of a program.

    Elements are the time intervals of the mesh. Segments are parts of the motion in which no
    coordinate reverses. Blocks are groups of elements that share one unknown duration. Together
    with the functions of one element (the element model), the structure determines all expressions
    of the program. Programs with the same structure and element model therefore share their
    compiled functions, for all values of their limits and positions.
    """

    moves: tuple[tuple[bool, ...], ...]
    """For each segment, a tuple with True for each coordinate that moves in it."""
    segment_sizes: tuple[int, ...]
    """Number of elements of each segment."""
    block_sizes: tuple[int, ...]
    """Number of elements of each block."""
    has_continuous_acceleration: bool
    """True if ü is continuous, because jerk is limited."""
    limits_jerk: bool
    """True if |u⃛| is bounded by linear constraints. Along a path, path constraints limit jerk."""

    def with_divided_elements(self, counts: Indices) -> "NlpStructure":
        """Return the structure with elements divided into equal parts.

        The numbers of segments and blocks remain. A segment or a block gets as many elements (time
        intervals) as its present elements have parts.

        Parameters
        ----------
        counts : (n,) int array
            Number of parts of each element. An element with one part is not divided.

        Returns
        -------
        NlpStructure
            The structure of the finer mesh.
        """
        segments, blocks = (
            tuple(np.bincount(index, counts).astype(int).tolist())
            for index in (self.segment, self.block)
        )
        return replace(self, segment_sizes=segments, block_sizes=blocks)

    @property
    def elements(self) -> int:
        """Number n of elements (time intervals)."""
        return sum(self.segment_sizes)

    @property
    def coordinates(self) -> int:
        """Number m of coordinates: 1 along a path, otherwise the number of moving joints."""
        return len(self.moves[0])

    @cached_property
    def segment(self) -> Indices:
        """For each element (time interval), the index of its segment, (n,).

        A segment is a part of the motion in which no coordinate reverses.
        """
        return np.repeat(np.arange(len(self.segment_sizes)), self.segment_sizes)

    @cached_property
    def block(self) -> Indices:
        """For each element (time interval), the index of its block, (n,).

        A block is a group of elements that share one unknown duration.
        """
        return np.repeat(np.arange(len(self.block_sizes)), self.block_sizes)

    def times(self, lengths: Array) -> Array:
        """Sum the lengths of the elements of each block, which gives the durations of the blocks.

        Parameters
        ----------
        lengths : (n,) array
            Lengths of the elements (time intervals).

        Returns
        -------
        (b,) array
            Durations of the blocks, in the same unit of time.
        """
        return np.asarray(np.bincount(self.block, lengths), dtype=float)

    def variables(self, elements: Array) -> Array:
        """Convert the elements of a motion to the vector of variables of Ipopt's program.

        The vector contains u and u̇ at the start and ü at both ends of every element (time
        interval), then the durations of the blocks. The lengths of the elements are not variables,
        because they follow from these durations.

        Parameters
        ----------
        elements : (n, 4 m + 1) array
            u, u̇, ü at the start, ü at the end (m numbers each), and length of every element.

        Returns
        -------
        (4 m n + b,) array
            Four numbers for each of the m coordinates in each of the n elements, and b durations.
        """
        return np.append(elements[:, :-1].ravel(), self.times(elements[:, -1]))

    @cached_property
    def moving(self) -> Indices:
        """True where a coordinate moves in an element (time interval), (n, m)."""
        return np.array(self.moves)[self.segment]

    @property
    def borders(self) -> list[int]:
        """Index of the first element of each segment.

        A segment is a part of the motion in which no coordinate reverses. The first index is 0, the
        start of the motion.
        """
        return [0, *np.cumsum(self.segment_sizes)[:-1].tolist()]

    @property
    def breakaways(self) -> list[tuple[int, int]]:
        """Pairs (k, j) of elements (time intervals) that define the breakaway constraints.

        A breakaway constraint limits the torque of a motor whose joint overcomes static friction at
        the start of element k, in the direction that the joint has in element j. At a border
        between two segments, the direction may be the new one (j = k) or the old one (j = k − 1).
        At the start of the motion, there is only the new one.
        """
        return [(k, k - side) for k in self.borders for side in (0, 1) if k >= side]


@record
class BoundaryConditions:
    """Positions and velocities of the m coordinates at the borders and ends of k segments.

    A segment is a part of the motion in which no coordinate u reverses. Two segments meet at a
    border.
    """

    points: Array
    """u at the start, at every border and at the end, (k + 1, m). NaN where the solver finds it."""
    signs: Array
    """Direction +1, −1 or 0 of u in every segment, (k, m)."""
    start_velocity: Array
    end_velocity: Array
    """u̇ at the start and at the end, (m,) each."""
    start_acceleration: Array = field(default_factory=lambda: np.zeros(1))
    """ü at the start, (m,). It is only given if jerk is limited."""
    ranges: Array = field(default_factory=lambda: np.zeros((2, 1)))
    """Smallest and largest u at a free border (where `points` is NaN), (2, m)."""

    def bounds(
        self, structure: NlpStructure, velocity: Array, acceleration: Array
    ) -> tuple[Array, Array, tuple[Array, Array]]:
        """Compute the bounds of the variables of all elements, and those of u̇ within the elements.

        The bounds impose the given positions and velocities, the limits of u̇ and ü, and the
        directions of the coordinates. They also impose velocity 0 at a border on each coordinate
        that reverses there or rests on one side of it.

        Parameters
        ----------
        structure : NlpStructure
            Numbers of elements and segments of the program, and which coordinates move.
        velocity, acceleration : (m,) or (n, m) arrays
            Limits of |u̇| and |ü|. Infinite without a limit.

        Returns
        -------
        lower, upper : (n, 4 m) arrays
            Smallest and largest u, u̇, ü at the start and ü at the end of every element. A given
            value has equal bounds, and a value without bounds has infinite ones.
        velocity : tuple of two (n, m) arrays
            Smallest and largest u̇ within each element (time interval). One of them is 0 for a
            coordinate that moves, and both are 0 for a coordinate that rests.
        """
        m, segment = structure.coordinates, structure.segment
        # Columns of u̇, of ü at the start and of ü at the end of an element.
        v, a0, a1 = (slice(i * m, (i + 1) * m) for i in range(1, 4))
        signs = self.signs[segment]
        # v_min is −velocity for a coordinate that moves backwards and 0 for any other. v_max is
        # velocity for a coordinate that moves forwards and 0 for any other.
        v_min, v_max = (np.where(sign * signs > 0, sign * velocity, 0.0) for sign in (-1, 1))
        limit = np.where(signs != 0, acceleration, 0.0)
        # A coordinate keeps its direction within a segment, so it stays between its positions at
        # both borders of the segment. Positions within the segment are therefore unbounded, except
        # those of a coordinate at rest.
        lowest, highest = (
            np.where(signs != 0, unbounded, self.points[segment]) for unbounded in (-np.inf, np.inf)
        )
        lower = np.hstack([lowest, v_min, -limit, -limit])
        upper = np.hstack([highest, v_max, limit, limit])
        for k, element in enumerate(structure.borders):
            # The range of reversals bounds the positions at free borders.
            lower[element, :m], upper[element, :m] = (
                np.where(np.isnan(self.points[k]), bound, self.points[k]) for bound in self.ranges
            )
            if k:
                # Columns of u̇ of the coordinates whose direction changes at this border.
                at_rest = m + np.flatnonzero(self.signs[k] != self.signs[k - 1])
                lower[element, at_rest] = upper[element, at_rest] = 0.0
        lower[0, v] = upper[0, v] = self.start_velocity
        if structure.has_continuous_acceleration:
            # With limited jerk, ü is given at the start, and 0 at the end of the motion.
            lower[0, a0] = upper[0, a0] = self.start_acceleration
            lower[-1, a1] = upper[-1, a1] = 0.0
        return lower, upper, (v_min, v_max)


@record
class NlpData:
    """All numbers of a nonlinear program: its parameters and its bounds.

    The symbols n (elements), m (coordinates u) and b (blocks) are those of the module's docstring.
    """

    element_parameters: tuple[Array, ...]
    """Parameter vectors of the element model, for example limits and directions of joints.

    Each vector has the shape (size,) if all elements share it, otherwise (n, size).
    """
    fractions: Array
    """Length of every element as a share of its block, (n,)."""
    least_times: Array
    """Smallest duration of every block, (b,), which keeps elements from shrinking to nothing."""
    lower: Array
    upper: Array
    """Lower and upper bounds of u, u̇, ü at the start and ü at the end of every element, (n, 4 m).
    """
    velocity: tuple[Array, Array]
    """Smallest and largest u̇ within each element, (n, m) each."""
    end: Array
    """u and u̇ at the end of the motion, (2 m,)."""
    acceleration: Array
    jerk: Array
    """Limits of |ü| and |u⃛|, (m,) each. They are infinite for the path parameter."""
    path_bound: Array
    """Upper bounds of r path constraints at start, middle and end of each element, (n, 3 r).

    They are 1 − backoff. The backoff is a margin that `refinement` chooses, so that the motion
    keeps the limit between these instants too.
    """
    breakaway_bound: Array
    """Upper bounds of the breakaway constraints, (pairs, rows).

    A breakaway constraint limits the motor torque of a joint that starts to move against static
    friction. Each pair (element k, element j) of `NlpStructure.breakaways` is a possible start: at
    the beginning of element k, in the direction of element j. The rows are the motors' constraints
    at this start. The bounds are infinite for joints that do not start to move there.
    """
    duration: tuple[float, float] = (0.0, np.inf)
    """Smallest and largest duration of the motion."""
    weights: tuple[float, float] = (1.0, 0.0)
    """Weights of the duration and of the cost (heat or effort of the motors) in the objective."""

    @property
    def is_fixed(self) -> Mask:
        """True where `lower` and `upper` agree up to rounding, which fixes a value, (n, 4 m)."""
        return np.asarray(self.upper - self.lower <= ROUNDING_TOLERANCE)


@frozen
class Confirmation:
    """Result of Ipopt after a start at the optimum of the structured solver, to confirm it."""

    iterations: int
    """Iterations of Ipopt. They include those for the motion of least heat or effort."""
    difference: float
    """Ipopt's duration of the fastest motion divided by that of the structured solver, minus 1."""
    residual: float
    """Largest violation of the optimality conditions of the fastest motion, as Ipopt scales it."""


@record
class Multipliers:
    """Lagrange multipliers of a solution in every element, in scaled time.

    A multiplier is the rate at which the objective would decrease if its constraint were relaxed.
    """

    direction: Array
    """Multipliers of the constraints "u̇ keeps its direction", (n, m).

    They are positive where a positive u̇ would shorten the motion, negative where a negative one
    would, and 0 where the constraint does not bind.
    """
    rows: Array
    """Multipliers of r path constraints at start, middle and end of each element, (n, 3 r), ≥ 0."""
    active: frozenset[tuple[str, int | None]]
    """Names and joints of the r path constraints."""

    @classmethod
    def of_bounds(
        cls,
        data: NlpData,
        lower: Array,
        upper: Array,
        rows: Array,
        active: frozenset[tuple[str, int | None]],
    ) -> "Multipliers":
        """Build the multipliers of a solution from the multipliers of its bounds on u̇.

        Only the bounds that forbid a reversal count: u̇ ≥ 0 where a coordinate moves forwards, and
        u̇ ≤ 0 where it moves backwards. The sign of a result is the direction in which the
        coordinate should move.

        Parameters
        ----------
        data : NlpData
            Bounds of the program.
        lower, upper : (n, m) arrays
            Multipliers of the lower and upper bounds on u̇, ≥ 0.
        rows : (n, 3 r) array
            Multipliers of the r path constraints at start, middle and end of each element, ≥ 0.
        active : frozenset
            Names and joints of the r path constraints.

        Returns
        -------
        Multipliers
            The multipliers of the directions and of the path constraints.
        """
        # A direction is known from the bound of u̇ that is 0.
        v_min, v_max = data.velocity
        forward = (v_min == 0) & (v_max > 0)
        backward = (v_min < 0) & (v_max == 0)
        return cls(np.where(forward, -lower, np.where(backward, upper, 0.0)), rows, active)


@record
class NlpSolution:
    """Result of a solver: the motion in scaled units, or the status of the failure."""

    message: str
    """Return status of the solver, for example Ipopt's "Solve_Succeeded", or `NOT_CONVERGED`."""
    structure: NlpStructure
    """Structure of the program that was solved."""
    elements: Array
    """u, u̇, ü at the start, ü at the end, and length of every element, (n, 4 m + 1)."""
    iterations: int
    """Number of iterations of the solver."""
    solver: Solver = "Ipopt"
    """Name of the solver."""
    structured_state: State | None = None
    """Final state of the structured solver, at which a solve of a similar program may start."""
    objective: float = np.nan
    """Value of the objective at the solution."""
    residual: float = np.nan
    """Violation of the optimality (KKT) conditions at Ipopt's last iterate."""
    multipliers: Multipliers | None = None
    """Lagrange multipliers of the path constraints and directions."""
    confirmation: Confirmation | None = None
    """Ipopt's confirmation of the optimum. None without it."""

    @property
    def status(self) -> str:
        """Outcome: "solved", "infeasible" (no motion near Ipopt's start) or "not converged"."""
        if self.message in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return "solved"
        return "infeasible" if self.message == "Infeasible_Problem_Detected" else "not converged"

    @property
    def solved(self) -> bool:
        """True if the solver found a motion."""
        return self.status == "solved"

    @property
    def duration(self) -> float:
        """Duration in scaled time."""
        return float(self.elements[:, -1].sum())


def as_cubics(elements: Array) -> CubicPiece:
    """Convert an array of elements (time intervals) to cubic polynomials.

    Parameters
    ----------
    elements : (n, 4 m + 1) array
        u, u̇, ü at the start, ü at the end (m numbers each), and length of every element.

    Returns
    -------
    CubicPiece
        Its fields u, v, a0 and a1 have the shape (n, m), and the lengths h the shape (n, 1).
    """
    m = elements.shape[1] // 4
    return CubicPiece(*np.hsplit(elements, [m, 2 * m, 3 * m, 4 * m]))


def stretched(elements: Array, factor: float) -> Array:
    """Stretch a motion in time, so that its duration is multiplied by a factor.

    The positions do not change. Velocities are divided by the factor, and accelerations by its
    square.

    Parameters
    ----------
    elements : (n, 4 m + 1) array
        u, u̇, ü at the start, ü at the end (m numbers each), and length of every element (time
        interval) of the motion.
    factor : float
        Ratio of the new duration to the old one.

    Returns
    -------
    (n, 4 m + 1) array
        Elements of the stretched motion, in the same form.
    """
    pieces = as_cubics(elements)
    acceleration = pieces.a0 / factor**2, pieces.a1 / factor**2
    return np.hstack([pieces.u, pieces.v / factor, *acceleration, pieces.h * factor])


def divide_elements(elements: Array, counts: Indices) -> Array:
    """Divide elements into equal parts without a change of the motion.

    Parameters
    ----------
    elements : (n, 4 m + 1) array
        u, u̇, ü at the start, ü at the end (m numbers each), and length of every element (time
        interval).
    counts : (n,) int array
        Number of parts of each element. An element with one part is not divided.

    Returns
    -------
    (sum of counts, 4 m + 1) array
        The parts of all elements, in the order of time and in the same form.
    """
    cubic = as_cubics(np.repeat(elements, counts, axis=0))
    # For each part: its length as a share of the element, its index 0, 1, … within the element, and
    # its start as a share of the element.
    part = 1.0 / np.repeat(counts, counts)[:, None]
    index = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    start = index[:, None] * part
    return np.hstack([*cubic.evaluate(start), cubic.evaluate(start + part)[2], cubic.h * part])


def divide_into_blocks(arcs: Sequence[int]) -> tuple[int, ...]:
    """Divide arcs into blocks with at most `MAX_BLOCK_ELEMENTS` elements, as equally as possible.

    An arc is the part of a motion between two switching points, that is, instants at which the
    acceleration of a joint (with a jerk limit: its jerk) jumps in the guess. A block is a group of
    elements (time intervals) whose duration is one unknown of the program.

    Parameters
    ----------
    arcs : sequence of int
        Number of elements of each arc, in the order of time.

    Returns
    -------
    tuple of int
        Number of elements of each block, in the order of time.
    """
    blocks: list[int] = []
    for count in arcs:
        # Number of blocks of the arc, rounded up. The first blocks get the remainder.
        parts = -(-count // MAX_BLOCK_ELEMENTS)
        blocks += [count // parts + (k < count % parts) for k in range(parts)]
    return tuple(blocks)
