"""The values of a nonlinear program: its shape, the course that its coordinates take, its numbers and its answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ssm_planner.typing import Array, Indices

LARGEST_BLOCK = 20
"""Elements of a block; more freedom than this leaves the optimisation undecided about where to put its elements."""


@dataclass(frozen=True)
class NlpStructure:
    """What the structure of a program depends on, its stage aside."""

    moves: tuple[tuple[bool, ...], ...]
    """By segment and coordinate: whether it moves there."""
    share: tuple[int, ...]
    """Elements of each segment."""
    blocks: tuple[int, ...]
    """Elements of each block; the elements of a block share its time in fixed proportion."""
    smooth: bool
    """The acceleration is continuous."""
    hull: bool
    """The coordinates have velocity limits of their own."""
    joints: bool
    """The coordinates are joints: jerk limits of their own, and idle ones smoothed."""

    def split(self, chosen: Array, parts: int) -> NlpStructure:
        """The same with the chosen elements (n,) cut into equal parts."""
        counts = np.where(chosen, parts, 1)
        share, blocks = (tuple(np.bincount(index, counts).astype(int).tolist()) for index in (self.segment, self.block))
        return replace(self, share=share, blocks=blocks)

    @property
    def elements(self) -> int:
        return sum(self.share)

    @property
    def coordinates(self) -> int:
        return len(self.moves[0])

    @property
    def segment(self) -> Indices:
        """Segment of each element, (n,)."""
        return np.repeat(np.arange(len(self.share)), self.share)

    @property
    def block(self) -> Indices:
        """Block of each element, (n,)."""
        return np.repeat(np.arange(len(self.blocks)), self.blocks)

    @property
    def moving(self) -> Indices:
        """By element and coordinate: whether it moves there, (n, m)."""
        return np.array(self.moves)[self.segment]

    @property
    def borders(self) -> list[int]:
        """First element of each segment."""
        return [0, *np.cumsum(self.share)[:-1].tolist()]

    @property
    def starts(self) -> list[tuple[int, int]]:
        """(element, element whose directions count) of every set of breakaway rows: a joint may turn back either way."""
        return [(k, k - side) for k in self.borders for side in (0, 1) if k >= side]


@dataclass(frozen=True, eq=False)
class BoundaryConditions:
    """Where the coordinates of a motion pass: m coordinates, k segments."""

    points: Array
    """u at every border, (k + 1, m)."""
    signs: Array
    """Direction of u in every segment, (k, m)."""
    start_speed: Array
    end_speed: Array
    """u̇ at both ends, (m,)."""

    def bounds(
        self, shape: NlpStructure, speed: Array, acceleration: Array
    ) -> tuple[Array, Array, tuple[Array, Array]]:
        """(lower, upper, speed) of a NlpData, from limits (m,) on u̇ and ü.

        A coordinate that turns back at a border, or that stands on one side of it, is at rest there.
        """
        m, at = shape.coordinates, shape.segment
        signs = self.signs[at]
        low, high = np.where(signs < 0, -speed, 0.0), np.where(signs > 0, speed, 0.0)
        reach = np.where(signs != 0, acceleration, 0.0)
        u = np.stack([self.points[:-1], self.points[1:]])[:, at]
        lower = np.hstack([u.min(axis=0), low, -reach, -reach])
        upper = np.hstack([u.max(axis=0), high, reach, reach])
        for k, element in enumerate(shape.borders):
            lower[element, :m] = upper[element, :m] = self.points[k]
            if k:
                columns = m + np.flatnonzero(self.signs[k] != self.signs[k - 1])
                lower[element, columns] = upper[element, columns] = 0.0
        lower[0, m : 2 * m] = upper[0, m : 2 * m] = self.start_speed
        if shape.smooth:
            lower[0, 2 * m : 3 * m] = upper[0, 2 * m : 3 * m] = 0.0
            lower[-1, 3 * m :] = upper[-1, 3 * m :] = 0.0
        return lower, upper, (low, high)


@dataclass(frozen=True, eq=False)
class NlpData:
    """The numbers of one program, in scaled time; n elements, m coordinates, k segments."""

    arguments: tuple[Array, ...]
    """The stage's further arguments, (length,) or (n, length)."""
    fractions: Array
    """Length of every element as a share of its block, (n,)."""
    times: Array
    """Least time of every block, (b,)."""
    lower: Array
    upper: Array
    """Bounds of u, u̇, ü, ü, (n, 4 m)."""
    speed: tuple[Array, Array]
    """Lowest and highest u̇ within each element, (n, m)."""
    end: Array
    """u and u̇ at the end, (2 m,)."""
    acceleration: Array
    jerk: Array
    """Limits, (m,), where the coordinates are joints."""
    allowed: Array
    """What each element's rows may reach, (n, rows)."""
    starting: Array
    """What the breakaway rows may reach, (sets, rows); inf where the joint is not at rest there."""
    time: tuple[float, float] = (0.0, np.inf)
    """Bounds of the whole duration."""
    weights: tuple[float, float] = (1.0, 0.0)
    """Of time and of the cost."""

    @property
    def parameters(self) -> tuple[Array, ...]:
        """All that the program takes beside the stage's arguments, in its order."""
        weights = np.array(self.weights)
        return self.fractions, self.end, self.jerk, self.acceleration, weights, self.times

    def within(self, time: tuple[float, float]) -> NlpData:
        """The same, for the least cost within these bounds of the duration."""
        return replace(self, time=time, weights=(0.0, 1.0))


@dataclass(frozen=True, eq=False)
class NlpSolution:
    """elements (n, 4 m + 1): u, u̇, ü, ü, length in scaled time; times (b,) of the blocks; point: what a warm start takes."""

    message: str
    shape: NlpStructure
    elements: Array
    times: Array
    iterations: int
    point: dict[str, Any]

    @property
    def status(self) -> str:
        """ "solved", "infeasible" or "not converged"."""
        if self.message in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return "solved"
        if self.message == "Infeasible_Problem_Detected":
            return "infeasible"
        return "not converged"

    @property
    def solved(self) -> bool:
        return self.status == "solved"


def blocks_of(arcs: Sequence[int]) -> tuple[int, ...]:
    """Blocks for arcs of so many elements: an arc, or parts of it of at most LARGEST_BLOCK elements."""
    blocks: list[int] = []
    for count in arcs:
        parts = -(-count // LARGEST_BLOCK)
        blocks += [count // parts + (k < count % parts) for k in range(parts)]
    return tuple(blocks)


def split(elements: Array, chosen: Array, parts: int) -> Array:
    """The same motion with the chosen elements (n,) of (n, 4 m + 1) cut into equal parts."""
    m = elements.shape[1] // 4
    counts = np.where(chosen, parts, 1)
    whole = np.repeat(elements, counts, axis=0)
    u, v, a0, a1 = (whole[:, k * m : (k + 1) * m] for k in range(4))
    share = 1.0 / np.repeat(counts, counts)
    index = np.arange(len(whole)) - np.repeat(np.cumsum(counts) - counts, counts)
    begin, t = (index * share)[:, None], (index * share * whole[:, -1])[:, None]
    rise = a1 - a0
    states = (
        u + t * (v + t * (a0 / 2 + begin * rise / 6)),
        v + t * (a0 + begin * rise / 2),
        a0 + begin * rise,
        a0 + (begin + share[:, None]) * rise,
    )
    return np.column_stack([*states, whole[:, -1] * share])
