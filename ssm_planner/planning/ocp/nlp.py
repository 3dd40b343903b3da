"""The values of a nonlinear program: its structure, its boundary conditions, its data and its solution.

n elements, m coordinates u, b blocks, k segments; everything in scaled time. A segment lies between two borders: points, at
which u is given, or places where a joint turns back, which are free. The elements of a block share its time in fixed
proportion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from ssm_planner.interior.solve import State
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, Indices, Mask

Solver = Literal["structured", "Ipopt"]
Method = Literal["Ipopt", "structured", "confirmed", "sketched"]
"""How a problem is solved: by Ipopt; by the structured solver, or Ipopt where that does not converge; by the structured
solver, and Ipopt confirms its optimum; by the structured solver or not at all."""
LARGEST_BLOCK = 20
"""Elements of a block; more freedom than this leaves the optimisation undecided about where to put its elements."""


SAME = 1e-12
"""Bounds that differ by less are one value."""


@dataclass(frozen=True)
class NlpStructure:
    """What the expressions of a program depend on, its element model aside."""

    moves: tuple[tuple[bool, ...], ...]
    """By segment and coordinate: whether it moves there."""
    segment_sizes: tuple[int, ...]
    """Elements of each segment."""
    block_sizes: tuple[int, ...]
    """Elements of each block."""
    smooth: bool
    """ü is continuous, for jerk is limited."""
    velocity_limits: bool
    """The coordinates have velocity limits of their own."""
    joints: bool
    """The coordinates are joints: they have jerk limits of their own, and those that do not bind are smoothed."""

    def split(self, counts: Indices) -> NlpStructure:
        """The same with every element cut into so many equal parts, (n,)."""
        segments, blocks = (
            tuple(np.bincount(of, counts).astype(int).tolist()) for of in (self.segment, self.block)
        )
        return replace(self, segment_sizes=segments, block_sizes=blocks)

    @property
    def elements(self) -> int:
        """n."""
        return sum(self.segment_sizes)

    @property
    def coordinates(self) -> int:
        """m."""
        return len(self.moves[0])

    @cached_property
    def segment(self) -> Indices:
        """Segment of each element, (n,)."""
        return np.repeat(np.arange(len(self.segment_sizes)), self.segment_sizes)

    @cached_property
    def block(self) -> Indices:
        """Block of each element, (n,)."""
        return np.repeat(np.arange(len(self.block_sizes)), self.block_sizes)

    @cached_property
    def moving(self) -> Indices:
        """By element and coordinate: whether it moves there, (n, m)."""
        return np.array(self.moves)[self.segment]

    @property
    def borders(self) -> list[int]:
        """First element of each segment."""
        return [0, *np.cumsum(self.segment_sizes)[:-1].tolist()]

    @property
    def breakaways(self) -> list[tuple[int, int]]:
        """(element at whose start a joint may break away, element whose directions count), a set of rows each.

        At a border a joint may break away either in its new direction or in its old one.
        """
        return [(k, k - side) for k in self.borders for side in (0, 1) if k >= side]


@dataclass(frozen=True, eq=False)
class BoundaryConditions:
    """Where the coordinates of a motion pass."""

    points: Array
    """u at every border and at the end, (k + 1, m); NaN where it is free."""
    signs: Array
    """Direction of u in every segment, (k, m); NaN where it may be either."""
    start_velocity: Array
    end_velocity: Array
    """u̇ at both ends, (m,)."""
    start_acceleration: Array = field(default_factory=lambda: np.zeros(1))
    """ü at the start where jerk is limited, (m,)."""
    room: Array = field(default_factory=lambda: np.zeros((2, 1)))
    """Lowest and highest u where a border is free, (2, m)."""

    def bounds(
        self, structure: NlpStructure, velocity: Array, acceleration: Array
    ) -> tuple[Array, Array, tuple[Array, Array]]:
        """(lower, upper, velocity) of a NlpData, from limits (m,) on u̇ and ü.

        A coordinate that turns back at a border, or that stands on one side of it, is at rest there.
        """
        m, segment = structure.coordinates, structure.segment
        v, first, last = (slice(i * m, (i + 1) * m) for i in range(1, 4))
        signs = self.signs[segment]
        either = np.isnan(signs)
        slowest, fastest = (
            np.where(either | (side * signs > 0), side * velocity, 0.0) for side in (-1, 1)
        )
        reach = np.where(signs != 0, acceleration, 0.0)
        # a coordinate keeps its direction from border to border, so at a free one its room is its bound
        ends = np.stack([self.points[:-1], self.points[1:]])[:, segment]
        lowest, highest = (np.where(np.isnan(ends) | either, bound, ends) for bound in self.room)
        lower = np.hstack([lowest.min(axis=0), slowest, -reach, -reach])
        upper = np.hstack([highest.max(axis=0), fastest, reach, reach])
        for k, element in enumerate(structure.borders):
            given = np.flatnonzero(~np.isnan(self.points[k]))
            lower[element, given] = upper[element, given] = self.points[k, given]
            if k:
                at_rest = m + np.flatnonzero(self.signs[k] != self.signs[k - 1])
                lower[element, at_rest] = upper[element, at_rest] = 0.0
        lower[0, v] = upper[0, v] = self.start_velocity
        if structure.smooth:
            lower[0, first] = upper[0, first] = self.start_acceleration
            lower[-1, last] = upper[-1, last] = 0.0
        return lower, upper, (slowest, fastest)


@dataclass(frozen=True, eq=False)
class NlpData:
    """Parameters and bounds of one program."""

    element_parameters: tuple[Array, ...]
    """Parameters of the element model, (size,) or (n, size)."""
    fractions: Array
    """Length of every element as a share of its block, (n,)."""
    least_times: Array
    """Of every block, (b,)."""
    lower: Array
    upper: Array
    """Bounds of u, u̇, ü at the start and ü at the end of every element, (n, 4 m)."""
    velocity: tuple[Array, Array]
    """Lowest and highest u̇ within each element, (n, m)."""
    end: Array
    """u and u̇ at the end, (2 m,)."""
    acceleration: Array
    jerk: Array
    """Limits, (m,), where the coordinates are joints."""
    path_bound: Array
    """Upper bounds of each element's path constraints at its start, middle and end, (n, 3 rows): 1 − backoff."""
    breakaway_bound: Array
    """Upper bounds of the breakaway rows, (sets, rows); inf where the joint is not at rest there."""
    duration: tuple[float, float] = (0.0, np.inf)
    """Bounds of the whole duration."""
    weights: tuple[float, float] = (1.0, 0.0)
    """Of time and of the cost."""

    @property
    def given(self) -> Mask:
        """Which states of the elements have one value, (n, 4 m)."""
        return np.asarray(self.upper - self.lower <= SAME)

    def bounds_of_u_count(self, structure: NlpStructure) -> Mask:
        """Where they do, (n, m): at free borders, and of what may turn back anywhere.

        What keeps its direction is between its borders by itself.
        """
        slowest, fastest = self.velocity
        counts = (slowest < 0) & (fastest > 0)
        counts[structure.borders[1:]] = True
        return np.asarray(counts & ~self.given[:, : structure.coordinates])

    def least_cost(self, duration: tuple[float, float], time: float = 0.0) -> NlpData:
        """The same, for the least cost, and `time` times the duration, within these bounds of the duration."""
        return replace(self, duration=duration, weights=(time, 1.0))


@dataclass(frozen=True, eq=False)
class InitialPoint:
    """Where a solver starts: variables, and from an earlier solution the multipliers of variables and constraints too."""

    x: Array
    multipliers: tuple[Array, Array] | None = None
    structured: State | None = None
    """Of the structured solver."""
    near: bool = False
    """The variables are near a solution, though nothing is known of its multipliers."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A motion to begin from: elements (n, 4 m + 1) and times (b,) of the blocks."""

    elements: Array
    times: Array
    near: bool = False
    """It is near a solution."""

    @property
    def point(self) -> InitialPoint:
        """For a cold start."""
        return InitialPoint(np.append(self.elements[:, :-1].ravel(), self.times), near=self.near)

    def stretched(self, factor: float) -> Guess:
        """The same motion in `factor` times its time."""
        orders = np.repeat([0, 1, 2, 2, -1], [*[self.elements.shape[1] // 4] * 4, 1])
        return Guess(self.elements / factor ** orders.astype(float), self.times * factor)


@dataclass(frozen=True)
class Confirmation:
    """What Ipopt made of the structured solver's optima of a motion, started from them."""

    iterations: int
    """Of Ipopt, for the fastest motion and for that of least heat or effort."""
    difference: float
    """Ipopt's duration of the fastest motion over the structured solver's, less 1."""


@dataclass(frozen=True, eq=False)
class NlpSolution:
    """What a solver found; message: its return status, in Ipopt's words."""

    message: str
    structure: NlpStructure
    elements: Array
    """u, u̇, ü at the start, ü at the end, length of every element, (n, 4 m + 1)."""
    times: Array
    """Of the blocks, (b,)."""
    iterations: int
    point: InitialPoint
    """For a warm start from here."""
    solver: Solver = "Ipopt"
    objective: float = np.nan
    confirmation: Confirmation | None = None
    rest: Callable[[], NlpSolution] | None = None
    """Works out the motion that this one is about; None: it is that."""

    @property
    def status(self) -> str:
        """ "solved", "infeasible" or "not converged"."""
        if self.message in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return "solved"
        return "infeasible" if self.message == "Infeasible_Problem_Detected" else "not converged"

    @property
    def solved(self) -> bool:
        return self.status == "solved"


@dataclass(frozen=True, eq=False)
class PhaseSolution:
    """The motion of a phase as joint polynomials, or why there is none."""

    status: str
    """ "solved", "infeasible" or "not converged"."""
    message: str
    """The solver's word."""
    iterations: int = 0
    breaks: Array = field(default_factory=lambda: np.zeros(1))
    """Ends of the pieces, (n + 1,) from 0, s."""
    coefficients: Array = field(default_factory=lambda: np.zeros((0, 6, 4)))
    """(n, 6, 4)."""
    solver: str = ""
    """Which found it; "" where none was needed."""
    borders: Array = field(default_factory=lambda: np.zeros(0))
    """Instants between which no joint turns back, (k + 1,), s; those at which a free motion passes its points."""
    directions: Array = field(default_factory=lambda: np.zeros((0, 4)))
    """Of the joints between them, of a free motion, (k, 4)."""
    confirmation: Confirmation | None = None
    rest: Callable[[], PhaseSolution] | None = None
    """As of `NlpSolution`."""

    @property
    def solved(self) -> bool:
        return self.status == "solved"

    @property
    def duration(self) -> float:
        """s."""
        return float(self.breaks[-1])


def cubics(elements: Array) -> Cubic:
    """The pieces of elements (n, 4 m + 1): (n, m) each, lengths (n, 1)."""
    m = elements.shape[1] // 4
    return Cubic(*np.hsplit(elements, [m, 2 * m, 3 * m, 4 * m]))


def split(elements: Array, counts: Indices) -> Array:
    """The same motion with every element of (n, 4 m + 1) cut into so many equal parts, (n,)."""
    whole = cubics(np.repeat(elements, counts, axis=0))
    share = 1.0 / np.repeat(counts, counts)[:, None]
    index = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    start = index[:, None] * share
    return np.hstack([*whole.at(start), whole.at(start + share)[2], whole.h * share])


def blocks_of(arcs: Sequence[int]) -> tuple[int, ...]:
    """Sizes of the blocks for arcs of so many elements: an arc, or parts of it of at most LARGEST_BLOCK elements."""
    blocks: list[int] = []
    for count in arcs:
        parts = -(-count // LARGEST_BLOCK)
        blocks += [count // parts + (k < count % parts) for k in range(parts)]
    return tuple(blocks)
