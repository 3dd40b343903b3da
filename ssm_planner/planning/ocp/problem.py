"""Base class of the optimal control problems of free motions and of motions along a path.

An optimal control problem becomes a nonlinear program on a mesh of elements (`nlp`). The base class
provides the data of this program, and evaluates path constraints between the instants at which the
program imposes them. The subclasses are `free_problem.FreeProblem` and the problem of `straight`.
"""

from abc import ABC, abstractmethod
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from ssm_planner.elements.compiled import rows_between
from ssm_planner.elements.element import (
    COLLOCATION_POINTS,
    DENSE_POINTS,
    Aim,
    ElementModel,
    shared_model,
)
from ssm_planner.elements.rows import RowName
from ssm_planner.planning.ocp.nlp import BoundaryConditions, Method, NlpData, NlpStructure
from ssm_planner.planning.work import Work
from ssm_planner.typing import Array, Indices, Mask, keyword_record

MIN_BLOCK_SHARE = 0.01
"""Smallest duration of a block, as a share of its duration in the guess.

It prevents elements of length 0, in which accelerations would be undetermined.
"""


@keyword_record
class OcpProblem(ABC):
    """An optimal control problem with n elements, k segments, b blocks and r path constraints.

    Elements are the time intervals of the mesh, segments the parts of the motion in which no
    coordinate reverses, and blocks the groups of elements that share one unknown duration (`nlp`).
    A path constraint (also called a row) is a function of the motion at one instant that must not
    exceed 1. The element model contains the functions that give the path constraints and the cost
    of one element. A subclass provides this model with its constants, the limits of the coordinates
    and the boundary conditions.
    """

    structure: NlpStructure
    """Numbers of elements, segments and blocks, and kinds of constraints of the program."""
    lengths: Array
    """Length of every element in the guess in scaled time, (n,)."""
    joint_limits: dict[str, Array]
    """Limits of joints and motors that the motion must keep, from `rows.joint_limits`."""
    time_scale: float
    """Unit of scaled time, s."""
    directions: Array
    """Direction of every joint in every segment: +1, −1 or 0, (k, 4)."""
    starts_at_rest: Array
    """True for joints that are at rest at the start of the motion, (4,)."""
    method: Method = "Ipopt"
    """Solution method: "Ipopt", "structured", "confirmed" or "estimated".

    `nlp.Method` explains these values.
    """
    work: Work = field(default_factory=Work)
    """Counter of the computational work."""

    @property
    @abstractmethod
    def boundary(self) -> BoundaryConditions:
        """Positions and velocities of the coordinates at borders and ends, in scaled time."""

    @property
    @abstractmethod
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of velocity u̇, acceleration ü and jerk u⃛ of the coordinates in scaled time.

        Each has the shape (m,) or (n, m), and is infinite without a limit.
        """

    @property
    @abstractmethod
    def complete_element(self) -> ElementModel:
        """Element model with all r path constraints that the motion must keep."""

    @abstractmethod
    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return the constants with which the functions of one element are evaluated.

        Such constants are limits, directions of joints, and polynomials that approximate a path.

        Parameters
        ----------
        elements : (n, 4 m + 1) array
            u, u̇, ü at the start, ü at the end (m numbers each), and length of each element. A model
            that approximates a path does so near the positions u.

        Returns
        -------
        tuple of arrays
            (size,) for a vector that all elements share, otherwise (n, size).
        """

    def element(self, active: frozenset[RowName], aim: Aim) -> ElementModel:
        """Return the functions of one element with some of the path constraints and with a cost.

        Parameters
        ----------
        active : frozenset
            Names and joints of those path constraints that are part of the program.
        aim : str
            Cost in addition to time: "time" (none), "heat" or "cooling" (heat of the motors without
            or with weights), or "effort" (torque that the speed needs).

        Returns
        -------
        ElementModel
            The model. Equal models are the same object, so that their functions are compiled once.
        """
        return shared_model(replace(self.complete_element, active=active, aim=aim))

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """Return the parameters and bounds of the nonlinear program on the present mesh.

        Parameters
        ----------
        elements : (n, 4 m + 1) array
            Latest motion: u, u̇, ü at the start, ü at the end (m numbers each), and length of each
            element.
        backoff : (n, active constraints) array
            Reduction of the bound of every active path constraint in every element. It makes the
            motion keep the limit between the instants at which the program imposes it.

        Returns
        -------
        NlpData
            All numbers of the program.
        """
        velocity, acceleration, jerk = self.limits
        # Durations of the blocks in the guess.
        boundary, times = self.boundary, self.structure.times(self.lengths)
        lower, upper, v_bounds = boundary.bounds(self.structure, velocity, acceleration)
        return NlpData(
            element_parameters=self.element_parameters(elements),
            fractions=self.lengths / times[self.structure.block],
            least_times=MIN_BLOCK_SHARE * times,
            lower=lower,
            upper=upper,
            velocity=v_bounds,
            end=np.concatenate([boundary.points[-1], boundary.end_velocity]),
            acceleration=acceleration,
            jerk=jerk,
            # The bounds are the same at all collocation points of an element.
            path_bound=np.tile(1.0 - backoff, (1, len(COLLOCATION_POINTS))),
            breakaway_bound=self._breakaway_bound(),
        )

    def with_divided_elements(self, counts: Indices) -> "OcpProblem":
        """Return the problem on a finer mesh, in which every element is divided into equal parts.

        Parameters
        ----------
        counts : (n,) int array
            Number of parts of each element. 1 leaves it as it is.
        """
        lengths = np.repeat(self.lengths / counts, counts)
        return replace(
            self, structure=self.structure.with_divided_elements(counts), lengths=lengths
        )

    def with_single_block(self, lengths: Array) -> "OcpProblem":
        """Return the problem with all elements in one block.

        The elements of a block have durations in fixed proportions, so the total duration is then
        the only unknown time of the problem.

        Parameters
        ----------
        lengths : (n,) array
            Lengths of the elements. They keep their proportions.
        """
        structure = replace(self.structure, block_sizes=(len(lengths),))
        return replace(self, structure=structure, lengths=lengths)

    @property
    def has_free_borders(self) -> bool:
        """True if the solver determines positions at some borders between segments.

        Such borders are reversals of joints, and passages of the port (incision) of an eye.
        """
        return bool(np.isnan(self.boundary.points).any())

    @property
    def always_active(self) -> frozenset[RowName]:
        """Names and joints of path constraints that are always part of the program.

        The others become part of it when a guess or a solution comes close to their limits.
        """
        return frozenset()

    @property
    def sigma(self) -> Array:
        """Direction σ of every joint in every element: +1, −1 or 0, (n, 4)."""
        return np.asarray(self.directions[self.structure.segment])

    @cached_property
    def row_names(self) -> list[RowName]:
        """Names and joints of all r path constraints, in the order of their values."""
        return self.complete_element.row_names

    @property
    def ignored_rows(self) -> Mask:
        """True where a path constraint does not apply to an element, (n, r)."""
        return np.zeros((self.structure.elements, len(self.row_names)), dtype=bool)

    def row_maxima(self, elements: Array) -> Array:
        """Return the largest value of each path constraint in each element of a motion.

        The program imposes path constraints only at three instants of each element (time interval),
        so the motion may exceed a limit between them. Here, the constraints are evaluated at the
        nine `DENSE_POINTS` of each element. A parabola through the largest value and its neighbours
        estimates the maximum.

        Parameters
        ----------
        elements : (n, 4 m + 1) array
            u, u̇, ü at the start, ü at the end (m numbers each), and length of each element.

        Returns
        -------
        (n, r) array
            Values above 1 violate the limit, and −∞ stands for a constraint that does not apply.
        """
        n = len(elements)
        if not self.row_names:
            return np.zeros((n, 0))
        values = rows_between(self.complete_element, elements, self.element_parameters(elements))
        peaks = parabolic_peak(values.reshape(n, len(DENSE_POINTS), -1).transpose(0, 2, 1))
        return np.where(self.ignored_rows, -np.inf, peaks)

    def _breakaway_bound(self) -> Array:
        """Return the upper bounds of the constraints on joints that start against static friction.

        Each pair (element k, element j) of `NlpStructure.breakaways` is a possible start at the
        beginning of element k, in the direction that the joint has in element j. A bound is 1 for a
        joint that starts or reverses at the beginning of element k and moves in element j. It is
        infinite for other joints.

        Returns
        -------
        (pairs, rows) array
            Bounds. Each row belongs to a motor's constraint (`ElementModel.breakaway_joints`).
        """
        sigma = self.sigma
        joints = self.complete_element.breakaway_joints
        bounds = []
        for k, j in self.structure.breakaways:
            starts = sigma[k] != sigma[k - 1] if k else self.starts_at_rest
            bounds.append(np.where(starts & (sigma[j] != 0), 1.0, np.inf)[joints])
        return np.array(bounds)


def parabolic_peak(values: Array) -> Array:
    """Estimate the maximum of sampled curves by parabolas.

    Each parabola passes through the largest sample of a curve and its two neighbours.

    Parameters
    ----------
    values : (…, n) array
        n ≥ 3 evenly spaced samples of each curve.

    Returns
    -------
    (…,) array
        Maximum of each parabola, but at least the largest sample.
    """
    count = values.shape[-1]
    rows = values.reshape(-1, count)
    peak = rows.max(axis=1)
    # Index of the largest sample in the flattened array, or of its inner neighbour at an end.
    middle = np.clip(rows.argmax(axis=1), 1, count - 2) + np.arange(len(rows)) * count
    previous, centre, following = (rows.ravel()[middle + k] for k in (-1, 0, 1))
    slope = (following - previous) / 2
    curvature = following - 2 * centre + previous
    with np.errstate(divide="ignore", invalid="ignore"):
        # The vertex of the parabola, at most one sample away. A straight line has no vertex.
        offset = np.clip(np.nan_to_num(-slope / curvature), -1.0, 1.0)
    return np.asarray(
        np.maximum(peak, centre + offset * (slope + offset * curvature / 2)).reshape(
            values.shape[:-1]
        )
    )
