"""Values of a nonlinear program: structure, boundary conditions, data and solution.

A program has n elements, m coordinates u, b blocks and k segments. All times are scaled. A segment
lies between two borders: points where u is given, or free positions where a joint reverses. The
elements of a block share its time in fixed proportion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from ssm_planner.interior.solve import State
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, Indices, Mask, frozen, record

Solver = Literal["structured", "Ipopt"]
Method = Literal["Ipopt", "structured", "confirmed", "estimated"]
"""How one attempt solves a problem. `phase_planner` chooses the next attempt if it fails.

"Ipopt": by Ipopt. "structured": by the structured solver. "confirmed": by the structured solver,
with Ipopt's confirmation of the optimum. "estimated": by the structured solver, for an estimate.
"""
LARGEST_BLOCK = 20
"""Largest number of elements of a block.

With more freedom the positions of the elements would be undetermined.
"""


@frozen
class NlpStructure:
    """Everything that the expressions of a program depend on, except for its element model."""

    moves: tuple[tuple[bool, ...], ...]
    """True where a coordinate moves, by segment and coordinate."""
    segment_sizes: tuple[int, ...]
    """Number of elements of each segment."""
    block_sizes: tuple[int, ...]
    """Number of elements of each block."""
    smooth: bool
    """True if ü is continuous, because jerk is limited."""
    velocity_limits: bool
    """True if the coordinates have velocity limits of their own."""
    joints: bool
    """True if the coordinates are joints.

    They then have jerk limits of their own, and joints that do not bind are smoothed.
    """

    def split(self, counts: Indices) -> NlpStructure:
        """Return the structure with every element cut into equal parts.

        `counts` (n,) are their numbers.
        """
        segments, blocks = (
            tuple(np.bincount(index, counts).astype(int).tolist())
            for index in (self.segment, self.block)
        )
        return replace(self, segment_sizes=segments, block_sizes=blocks)

    @property
    def elements(self) -> int:
        """Number n of elements."""
        return sum(self.segment_sizes)

    @property
    def coordinates(self) -> int:
        """Number m of coordinates."""
        return len(self.moves[0])

    @cached_property
    def segment(self) -> Indices:
        """Segment of each element, (n,)."""
        return np.repeat(np.arange(len(self.segment_sizes)), self.segment_sizes)

    @cached_property
    def block(self) -> Indices:
        """Block of each element, (n,)."""
        return np.repeat(np.arange(len(self.block_sizes)), self.block_sizes)

    def times(self, lengths: Array) -> Array:
        """Return the times (b,) of the blocks from the lengths (n,) of the elements."""
        return np.asarray(np.bincount(self.block, lengths), dtype=float)

    def variables(self, elements: Array) -> Array:
        """Return Ipopt's variables for elements (n, 4 m + 1): their states, and the times."""
        return np.append(elements[:, :-1].ravel(), self.times(elements[:, -1]))

    @cached_property
    def moving(self) -> Indices:
        """True where a coordinate moves, by element and coordinate, (n, m)."""
        return np.array(self.moves)[self.segment]

    @property
    def borders(self) -> list[int]:
        """First element of each segment."""
        return [0, *np.cumsum(self.segment_sizes)[:-1].tolist()]

    @property
    def breakaways(self) -> list[tuple[int, int]]:
        """Pairs of elements with breakaway rows.

        A joint may break away at the start of the first element in the direction of the second one.
        At a border it may do so in its new direction or in its old one.
        """
        return [(k, k - side) for k in self.borders for side in (0, 1) if k >= side]


@record
class BoundaryConditions:
    """Positions and velocities of the coordinates at borders and ends."""

    points: Array
    """u at every border and at the end, (k + 1, m). NaN where it is free."""
    signs: Array
    """Direction of u in every segment, (k, m)."""
    start_velocity: Array
    end_velocity: Array
    """u̇ at both ends, (m,) each."""
    start_acceleration: Array = field(default_factory=lambda: np.zeros(1))
    """ü at the start, if jerk is limited, (m,)."""
    ranges: Array = field(default_factory=lambda: np.zeros((2, 1)))
    """Smallest and largest u at a free border, (2, m)."""

    def bounds(
        self, structure: NlpStructure, velocity: Array, acceleration: Array
    ) -> tuple[Array, Array, tuple[Array, Array]]:
        """Return the fields lower, upper and velocity of NlpData from limits (m,) on u̇ and ü.

        A coordinate that reverses at a border, or that rests on one side of it, is at rest there.
        """
        m, segment = structure.coordinates, structure.segment
        v, a0, a1 = (slice(i * m, (i + 1) * m) for i in range(1, 4))
        signs = self.signs[segment]
        v_min, v_max = (np.where(side * signs > 0, side * velocity, 0.0) for side in (-1, 1))
        reach = np.where(signs != 0, acceleration, 0.0)
        # A coordinate keeps its direction between borders, so its range at a free border bounds it
        # everywhere.
        ends = np.stack([self.points[:-1], self.points[1:]])[:, segment]
        lowest, highest = (np.where(np.isnan(ends), bound, ends) for bound in self.ranges)
        lower = np.hstack([lowest.min(axis=0), v_min, -reach, -reach])
        upper = np.hstack([highest.max(axis=0), v_max, reach, reach])
        for k, element in enumerate(structure.borders):
            fixed = np.flatnonzero(~np.isnan(self.points[k]))
            lower[element, fixed] = upper[element, fixed] = self.points[k, fixed]
            if k:
                at_rest = m + np.flatnonzero(self.signs[k] != self.signs[k - 1])
                lower[element, at_rest] = upper[element, at_rest] = 0.0
        lower[0, v] = upper[0, v] = self.start_velocity
        if structure.smooth:
            lower[0, a0] = upper[0, a0] = self.start_acceleration
            lower[-1, a1] = upper[-1, a1] = 0.0
        return lower, upper, (v_min, v_max)


@record
class NlpData:
    """Parameters and bounds of one program."""

    element_parameters: tuple[Array, ...]
    """Parameters of the element model, (size,) or (n, size)."""
    fractions: Array
    """Length of every element as a share of its block, (n,)."""
    least_times: Array
    """Smallest time of every block, (b,)."""
    lower: Array
    upper: Array
    """Bounds of u, u̇, ü at the start and ü at the end of every element, (n, 4 m)."""
    velocity: tuple[Array, Array]
    """Smallest and largest u̇ within each element, (n, m)."""
    end: Array
    """u and u̇ at the end, (2 m,)."""
    acceleration: Array
    jerk: Array
    """Limits (m,) where the coordinates are joints."""
    path_bound: Array
    """Upper bounds of the path constraints at start, middle and end of each element, (n, 3 rows).

    They are 1 − backoff.
    """
    breakaway_bound: Array
    """Upper bounds of the breakaway rows, (sets, rows). Infinite if the joint is not at rest there.
    """
    duration: tuple[float, float] = (0.0, np.inf)
    """Bounds of the total duration."""
    brief: bool = False
    """True if a cold start of Ipopt may only take few iterations."""
    weights: tuple[float, float] = (1.0, 0.0)
    """Weights of time and of the cost."""

    @property
    def is_fixed(self) -> Mask:
        """True for states of elements with a single value, (n, 4 m)."""
        return np.asarray(self.upper - self.lower <= ROUNDING)

    def bounds_of_u_count(self, structure: NlpStructure) -> Mask:
        """Return where bounds of u are needed, (n, m).

        They are needed at free borders. A coordinate keeps its direction between its borders, so it
        stays between them by itself.
        """
        counts = np.zeros_like(self.velocity[0], dtype=bool)
        counts[structure.borders[1:]] = True
        return np.asarray(counts & ~self.is_fixed[:, : structure.coordinates])

    def least_cost(self, duration: tuple[float, float], time: float = 0.0) -> NlpData:
        """Return the data for the least cost plus `time` times the duration."""
        return replace(self, duration=duration, weights=(time, 1.0))


@frozen
class Confirmation:
    """Ipopt's results for the optima of the structured solver, from which it started."""

    iterations: int
    """Iterations of Ipopt, for the fastest motion and for that of least heat or effort."""
    difference: float
    """Ipopt's duration of the fastest motion divided by that of the structured solver, minus 1."""
    residual: float
    """Largest violation of the optimality conditions of the fastest motion, as Ipopt scales it."""


@record
class Multipliers:
    """Lagrange multipliers of a solution by element, in scaled time."""

    direction: Array
    """Multipliers of "u̇ keeps its direction", (n, m).

    They are positive where u̇ would rather be positive, and 0 where the row does not bind.
    """
    rows: Array
    """Multipliers of the path constraints at the collocation points, (n, 3 rows), not negative."""
    active: frozenset[tuple[str, int | None]]
    """Names and joints of these rows."""

    @classmethod
    def of_bounds(
        cls,
        data: NlpData,
        lower: Array,
        upper: Array,
        rows: Array,
        active: frozenset[tuple[str, int | None]],
    ) -> Multipliers:
        """Keep the multipliers of the bounds on u̇ that forbid a joint to reverse.

        `lower` and `upper` (n, m) are the multipliers of the bounds on u̇. Bounds that forbid a
        reversal are u̇ ≥ 0 where the joint moves forwards and u̇ ≤ 0 where it moves backwards. All
        other entries are zero.
        """
        v_min, v_max = data.velocity
        forward = (v_min == 0) & (v_max > 0)
        backward = (v_min < 0) & (v_max == 0)
        return cls(np.where(forward, -lower, np.where(backward, upper, 0.0)), rows, active)


@record
class NlpSolution:
    """Result of a solver. `message` is its return status in Ipopt's words."""

    message: str
    structure: NlpStructure
    elements: Array
    """u, u̇, ü at the start, ü at the end, and length of every element, (n, 4 m + 1)."""
    iterations: int
    solver: Solver = "Ipopt"
    structured_state: State | None = None
    ipopt_multipliers: tuple[Array, Array] | None = None
    """Where the solver ended. A solve of a similar program may start there."""
    objective: float = np.nan
    residual: float = np.nan
    """KKT residual at Ipopt's last iterate."""
    multipliers: Multipliers | None = None
    confirmation: Confirmation | None = None

    @property
    def status(self) -> str:
        """Status "solved", "infeasible" or "not converged"."""
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


def cubics(elements: Array) -> Cubic:
    """Return the cubics of elements (n, 4 m + 1), (n, m) each, with lengths (n, 1)."""
    m = elements.shape[1] // 4
    return Cubic(*np.hsplit(elements, [m, 2 * m, 3 * m, 4 * m]))


def stretched(elements: Array, factor: float) -> Array:
    """Return elements (n, 4 m + 1) of the same motion with its duration multiplied by `factor`."""
    pieces = cubics(elements)
    acceleration = pieces.a0 / factor**2, pieces.a1 / factor**2
    return np.hstack([pieces.u, pieces.v / factor, *acceleration, pieces.h * factor])


def split(elements: Array, counts: Indices) -> Array:
    """Return elements (n, 4 m + 1) with every one cut into equal parts.

    `counts` (n,) are their numbers.
    """
    cubic = cubics(np.repeat(elements, counts, axis=0))
    share = 1.0 / np.repeat(counts, counts)[:, None]
    index = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    start = index[:, None] * share
    return np.hstack([*cubic.evaluate(start), cubic.evaluate(start + share)[2], cubic.h * share])


def blocks_of(arcs: Sequence[int]) -> tuple[int, ...]:
    """Return the sizes of the blocks of arcs with these numbers of elements.

    A block is an arc, or a part of it with at most LARGEST_BLOCK elements.
    """
    blocks: list[int] = []
    for count in arcs:
        number = -(-count // LARGEST_BLOCK)
        blocks += [count // number + (k < count % number) for k in range(number)]
    return tuple(blocks)
