"""Base class of the optimal control problems: the data of a program, and its rows on the true path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from ssm_planner.elements.compiled import rows_between
from ssm_planner.elements.element import COLLOCATION, DENSE, Aim, ElementModel, shared
from ssm_planner.elements.rows import RowName
from ssm_planner.planning.ocp.nlp import BoundaryConditions, Method, NlpData, NlpStructure
from ssm_planner.planning.work import Work
from ssm_planner.typing import Array, Indices, Mask, keyword_record

SHORTEST = 0.01
"""Smallest time of a block, as a share of the guess's."""


@keyword_record
class OcpProblem(ABC):
    """An optimal control problem with n elements, k segments, b blocks and r path rows.

    A subclass provides the element models and their parameters.
    """

    structure: NlpStructure
    lengths: Array
    """Length of every element in the guess, (n,), in scaled time."""
    joint_limits: dict[str, Array]
    """Result of `rows.joint_limits` for the robot whose limits the motion must keep."""
    time_scale: float
    """Length of a scaled second, s."""
    directions: Array
    """Direction of every joint in every segment: +1, −1 or 0, (k, 4)."""
    starting: Array
    """True for joints that begin the motion at rest, (4,)."""
    method: Method = "Ipopt"
    """Solution method."""
    work: Work = field(default_factory=Work)

    @property
    @abstractmethod
    def boundary(self) -> BoundaryConditions:
        """Positions and velocities at borders and ends, in scaled time."""

    @property
    @abstractmethod
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of u̇, ü and u⃛ of the coordinates in scaled time, (m,) each.

        Infinite without a limit.
        """

    @property
    @abstractmethod
    def complete_element(self) -> ElementModel:
        """Element model with all r rows that this problem may need."""

    @abstractmethod
    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return the parameters of the element model near elements (n, 4 m + 1), each (size,) or
        (n, size).
        """

    def element(self, active: frozenset[RowName], aim: Aim) -> ElementModel:
        """Return the element model with the active rows."""
        return shared(replace(self.complete_element, active=active, aim=aim))

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """Return the program's parameters and bounds near elements.

        `backoff` is (n, active rows).
        """
        velocity, acceleration, jerk = self.limits
        boundary, times = self.boundary, self.structure.times(self.lengths)
        lower, upper, v_bounds = boundary.bounds(self.structure, velocity, acceleration)
        return NlpData(
            element_parameters=self.element_parameters(elements),
            fractions=self.lengths / times[self.structure.block],
            least_times=SHORTEST * times,
            lower=lower,
            upper=upper,
            velocity=v_bounds,
            end=np.concatenate([boundary.points[-1], boundary.end_velocity]),
            acceleration=acceleration,
            jerk=jerk,
            path_bound=np.tile(1.0 - backoff, (1, len(COLLOCATION))),
            breakaway_bound=self._breakaway_bound(),
        )

    def with_cut_elements(self, counts: Indices) -> OcpProblem:
        """Return the problem with every element cut into equal parts.

        `counts` (n,) are their numbers.
        """
        lengths = np.repeat(self.lengths / counts, counts)
        return replace(self, structure=self.structure.split(counts), lengths=lengths)

    def with_one_time(self, lengths: Array) -> OcpProblem:
        """Return the problem with one time for all elements, with proportional lengths (n,)."""
        structure = replace(self.structure, block_sizes=(len(lengths),))
        return replace(self, structure=structure, lengths=lengths)

    @property
    def has_free_borders(self) -> bool:
        """True if borders are unknown: reversals, or passages of the port of an eye."""
        return bool(np.isnan(self.boundary.points).any())

    @property
    def always_active(self) -> frozenset[RowName]:
        """Rows that are active for every value in the guess."""
        return frozenset()

    @property
    def sigma(self) -> Array:
        """Directions σ of the joints in every element, (n, 4)."""
        return np.asarray(self.directions[self.structure.segment])

    @cached_property
    def row_names(self) -> list[RowName]:
        """Names of all r rows."""
        return self.complete_element.row_names

    @property
    def ignored_rows(self) -> Mask:
        """True for rows that do not count in an element, (n, r)."""
        return np.zeros((self.structure.elements, len(self.row_names)), dtype=bool)

    @cached_property
    def _row_cache(self) -> list[tuple[Array, Array]]:
        """Elements for which `row_maxima` was called last, and its result."""
        return []

    def row_maxima(self, elements: Array) -> Array:
        """Return the largest value of every row in every element on the true path, (n, r)."""
        n = len(elements)
        if not self.row_names:
            return np.zeros((n, 0))
        if self._row_cache and np.array_equal(self._row_cache[0][0], elements):
            return self._row_cache[0][1]
        rows = rows_between(self.complete_element, elements, self.element_parameters(elements))
        peaks = parabolic_peak(rows.reshape(n, len(DENSE), -1).transpose(0, 2, 1))
        maxima = np.where(self.ignored_rows, -np.inf, peaks)
        maxima.setflags(write=False)
        self._row_cache[:] = [(elements.copy(), maxima)]
        return maxima

    def _breakaway_bound(self) -> Array:
        """Return upper bounds of the breakaway rows, (sets, rows).

        They are 1 for joints that start or reverse there, and infinite for the others.
        """
        sigma = self.sigma
        joints = self.complete_element.breakaway_joints
        bounds = []
        for k, side in self.structure.breakaways:
            turning = sigma[k] != sigma[k - 1] if k else self.starting
            bounds.append(np.where(turning & (sigma[side] != 0), 1.0, np.inf)[joints])
        return np.array(bounds)


def parabolic_peak(values: Array) -> Array:
    """Return the maximum over the last axis of the parabolas through the largest samples.

    The axis (…, n) holds n ≥ 3 evenly spaced samples. The result (…,) is not below the largest
    sample.
    """
    count = values.shape[-1]
    rows = values.reshape(-1, count)
    peak = rows.max(axis=1)
    middle = np.clip(rows.argmax(axis=1), 1, count - 2) + np.arange(len(rows)) * count
    previous, centre, following = (rows.ravel()[middle + k] for k in (-1, 0, 1))
    slope = (following - previous) / 2
    bend = following - 2 * centre + previous
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.clip(np.nan_to_num(-slope / bend), -1.0, 1.0)
    return np.asarray(
        np.maximum(peak, centre + offset * (slope + offset * bend / 2)).reshape(values.shape[:-1])
    )
