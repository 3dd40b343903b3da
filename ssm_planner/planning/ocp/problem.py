"""Base class of the optimal control problems of free motions and of motions along a path.

An optimal control problem asks for the motion of least duration or cost that keeps all limits. On a
mesh of time intervals (elements), it becomes a nonlinear program (`nlp`). `OcpProblem` provides the
numbers of this program, and evaluates the limits between the instants at which the program imposes
them. The subclasses are `free_problem.FreeProblem` and the problem of the module `straight`.
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
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.work import Work
from ssm_planner.typing import Array, Indices, Mask, keyword_record

MIN_BLOCK_SHARE = 0.01
"""Smallest duration of a block, as a share of its duration in the guess.

It prevents elements of length 0, in which accelerations would be undetermined.
"""


@keyword_record
class OcpProblem(ABC):
    """An optimal control problem with n elements, k segments, b blocks and r path constraints.

    The module `nlp` explains these terms:

    - An element is a time interval of the mesh. In it, each coordinate u is a cubic polynomial.
    - A segment is a part of the motion in which no coordinate reverses.
    - A block is a group of consecutive elements that share one unknown duration.
    - A path constraint (row) is a function of the motion at one instant that must not exceed 1.

    The element model contains the functions that give the path constraints and the cost of one
    element. A subclass provides this model, the parameters of its functions, the limits of the
    coordinates, and the boundary conditions.
    """

    phase: Phase
    """The phase with its problem, requested duration, and velocities at both ends."""
    structure: NlpStructure
    """Numbers of elements, segments and blocks, and kinds of constraints of the program."""
    lengths: Array
    """Length of every element in the guess in scaled time, (n,)."""
    joint_limits: dict[str, Array]
    """Limits of joints and motors by the names in `rows.LIMIT_SIZES`, (4,) each, in SI units.

    `rows.joint_limits` collects them.
    """
    time_scale: float
    """Unit of scaled time, s. It is about the duration of the motion."""
    directions: Array
    """Direction of every joint in every segment: +1, −1 or 0, (k, 4)."""
    method: Method = "Ipopt"
    """Solution method: "Ipopt", "structured", "confirmed" or "estimated".

    `nlp.Method` explains these values.
    """
    work: Work = field(default_factory=Work)
    """Counter of the computational work."""

    @property
    def requested_duration(self) -> float | None:
        """Requested duration of the phase in scaled time. None: as short as possible."""
        duration = self.phase.motion.duration
        return None if duration is None else duration / self.time_scale

    @property
    @abstractmethod
    def boundary(self) -> BoundaryConditions:
        """Positions and velocities of the coordinates at borders and ends, in scaled time.

        A border lies between two segments, that is, parts of the motion in which no coordinate
        reverses.
        """

    @property
    @abstractmethod
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of |u̇|, |ü| and |u⃛| of the m coordinates u, in scaled time.

        Each has the shape (m,), or (n, m) if it differs between the n elements (time intervals). An
        entry is infinite without a limit.
        """

    @property
    @abstractmethod
    def element_model(self) -> ElementModel:
        """Functions of one element (time interval), with all path constraints that it can have."""

    @abstractmethod
    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return the parameter vectors of the functions that evaluate one element.

        The parameters contain limits and directions of joints. For a given path, they also contain
        polynomials that approximate the path.

        Parameters
        ----------
        elements : (n, 4 m + 1) array
            Latest motion: u, u̇, ü at the start, ü at the end (m numbers each), and length of each
            element (time interval). The polynomials approximate the path near the positions u.

        Returns
        -------
        tuple of arrays
            One array for each parameter vector: (size,) if all elements share it, otherwise
            (n, size).
        """

    @cached_property
    def complete_element(self) -> ElementModel:
        """Functions of one element (time interval), with all r path constraints of the motion.

        A path constraint belongs to the motion if the problem states its limit.
        """
        problem = self.phase.problem
        of_tool = {limit.name for limit in problem.task_limits.all_limits}
        of_joints = [{limit.name for limit in joint.limits} for joint in problem.robot.joints]
        # The index of a torque constraint is joint + 4 k, so its remainder is the joint.
        rows = frozenset(
            (name, index)
            for name, index in self.element_model.row_names
            if name in of_tool or (index is not None and name in of_joints[index % 4])
        )
        return shared_model(replace(self.element_model, active=rows))

    def element(self, active: frozenset[RowName], aim: Aim) -> ElementModel:
        """Return the functions of one element with selected path constraints and with a cost.

        A path constraint is a function of the motion at one instant that must not exceed 1.

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
            The functions. Equal models are the same object, so that their functions are compiled
            once.
        """
        return shared_model(replace(self.complete_element, active=active, aim=aim))

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """Return the parameters and bounds of the nonlinear program on the present mesh.

        Parameters
        ----------
        elements : (n, 4 m + 1) array
            Latest motion: u, u̇, ü at the start, ü at the end (m numbers each), and length of each
            element (time interval).
        backoff : (n, active constraints) array
            Amount by which the bound of each active path constraint is lowered in each element. The
            program imposes a limit only at three instants of an element, and the lower bound makes
            the motion keep it in between. A constraint is active if it is part of the program.

        Returns
        -------
        NlpData
            All numbers of the program.
        """
        velocity, acceleration, jerk = self.limits
        # `times` are the durations of the blocks (groups of elements) in the guess.
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
        """Return the problem on a finer mesh, in which elements are divided into equal parts.

        Parameters
        ----------
        counts : (n,) int array
            Number of parts of each element (time interval). An element with one part stays as it
            is.

        Returns
        -------
        OcpProblem
            The same problem with sum(counts) elements.
        """
        lengths = np.repeat(self.lengths / counts, counts)
        return replace(
            self, structure=self.structure.with_divided_elements(counts), lengths=lengths
        )

    def with_single_block(self, lengths: Array) -> "OcpProblem":
        """Return the problem with the total duration as its only unknown time.

        All elements (time intervals) then belong to one block, a group of elements whose durations
        have fixed proportions.

        Parameters
        ----------
        lengths : (n,) array
            Lengths of the elements in scaled time, which determine these proportions.

        Returns
        -------
        OcpProblem
            The same problem with one block.
        """
        structure = replace(self.structure, block_sizes=(len(lengths),))
        return replace(self, structure=structure, lengths=lengths)

    @property
    def always_active(self) -> frozenset[RowName]:
        """Names and joints of path constraints that are always part of the program.

        A path constraint is a function of the motion that must not exceed 1. The others become part
        of the program when a guess comes close to their limits or a solution exceeds them.
        """
        return frozenset()

    @property
    def sigma(self) -> Array:
        """Direction σ of every joint in every element (time interval): +1, −1 or 0, (n, 4)."""
        return np.asarray(self.directions[self.structure.segment])

    @cached_property
    def row_names(self) -> list[RowName]:
        """Names and joints of all r path constraints, in the order of their values.

        A path constraint is a function of the motion at one instant that must not exceed 1.
        """
        return self.complete_element.row_names

    @property
    def ignored_rows(self) -> Mask:
        """True where a path constraint does not apply to an element (time interval), (n, r).

        In this class all constraints apply everywhere.
        """
        return np.zeros((self.structure.elements, len(self.row_names)), dtype=bool)

    def row_maxima(self, elements: Array) -> Array:
        """Estimate the largest value of each path constraint in each element of a motion.

        A path constraint is a function of the motion at one instant that must not exceed 1. The
        program imposes it only at three instants of each element (time interval), so the motion may
        exceed a limit between them. This method evaluates the constraints at the nine
        `DENSE_POINTS` of each element. The estimate is the peak of the parabola through the largest
        value and its two neighbours.

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
        # `values` has the shape (n, 9 r). `parabolic_peak` needs the nine samples as its last axis.
        peaks = parabolic_peak(values.reshape(n, len(DENSE_POINTS), -1).transpose(0, 2, 1))
        return np.where(self.ignored_rows, -np.inf, peaks)

    def _breakaway_bound(self) -> Array:
        """Return the upper bounds of the breakaway constraints.

        A breakaway constraint limits the motor torque of a joint that starts to move against static
        friction. Each pair (element k, element j) of `NlpStructure.breakaways` is a possible start:
        at the beginning of element k, in the direction that the joint has in element j. The bound
        is 1 for a joint that moves in element j, and that changes its direction (or begins the
        motion from rest) at the beginning of element k. It is infinite for other joints.

        Returns
        -------
        (pairs, rows) array
            Bounds. Each column belongs to one constraint of a motor, in the order of
            `ElementModel.breakaway_joints`.
        """
        sigma = self.sigma
        joints = self.complete_element.breakaway_joints
        bounds = []
        for k, j in self.structure.breakaways:
            # A joint starts where its direction changes, and at the start of the motion (k = 0) if
            # it is at rest there.
            starts = sigma[k] != sigma[k - 1] if k else self.phase.qd_start == 0.0
            bounds.append(np.where(starts & (sigma[j] != 0), 1.0, np.inf)[joints])
        return np.array(bounds)


def parabolic_peak(values: Array) -> Array:
    """Estimate the maximum of each sampled curve by a parabola.

    The parabola passes through the largest sample of the curve and its two neighbours. If the
    largest sample is the first or the last one, the parabola passes through the three samples at
    this end.

    Parameters
    ----------
    values : (…, n) array
        n ≥ 3 evenly spaced samples of each curve.

    Returns
    -------
    (…,) array
        Maximum of each parabola within its three samples, but at least the largest sample.
    """
    middle = np.clip(values.argmax(axis=-1), 1, values.shape[-1] - 2)[..., None]
    previous, centre, following = (
        np.take_along_axis(values, middle + k, axis=-1)[..., 0] for k in (-1, 0, 1)
    )
    slope = (following - previous) / 2
    curvature = following - 2 * centre + previous
    with np.errstate(divide="ignore", invalid="ignore"):
        # Distance of the vertex from the middle sample, in steps between samples. It is limited to
        # one step. A straight line lacks a vertex, so its division by 0 gives 0 or ±1 here.
        offset = np.clip(np.nan_to_num(-slope / curvature), -1.0, 1.0)
    vertex = centre + offset * (slope + offset * curvature / 2)
    return np.asarray(np.maximum(values.max(axis=-1), vertex))
