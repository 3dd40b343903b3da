"""Optimal control problem of a free motion, in which the solver chooses the joint path.

Borders divide the motion into segments. A border is a given point, another position at which a
joint reverses, or a passage of an eye's port (the incision through which the tool enters). Every
joint moves in one direction within a segment, so its position lies between those at both borders,
and the sign of its friction is known. A joint that moves on in its direction passes a border at
speed. A joint that reverses at a border, or that rests on one side of it, has velocity 0 there.

The unknowns are the joint positions, velocities and accelerations. Limits of velocity, acceleration
and jerk bound them directly. All other limits are path constraints: motor torque, tool speeds,
rates of task coordinates, ranges of roll and spin, and the limits of the eye. The nonlinear program
contains only the path constraints that the motion comes close to (the active ones).

`free.solve_free` builds and solves the problem.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.elements.element import shared_model
from ssm_planner.elements.free_element import (
    RANGE_LIMITED_COORDINATES,
    RATE_LIMITED_COORDINATES,
    FreeElement,
)
from ssm_planner.elements.rows import (
    UNLIMITED,
    tool_limits,
)
from ssm_planner.kinematics import (
    retina_constraint,
    task_from_joints,
    task_of_joints,
    tip_position,
)
from ssm_planner.planning.ocp.guesses import KINEMATIC_LIMITS
from ssm_planner.planning.ocp.motion import DirectionMultipliers, PhaseSolution
from ssm_planner.planning.ocp.nlp import (
    BoundaryConditions,
    Multipliers,
    NlpData,
    NlpSolution,
    as_cubics,
)
from ssm_planner.planning.ocp.problem import OcpProblem
from ssm_planner.planning.ocp.reduced_costs import constraint_gradient, steepest_descent
from ssm_planner.planning.ocp.segments import SegmentChain
from ssm_planner.planning.phases import reversal_ranges
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, ROUNDING_TOLERANCE
from ssm_planner.problem import TASK_COORDINATES, RetinaClearance
from ssm_planner.trajectory import quintic_coefficients
from ssm_planner.typing import Array, Indices, Mask, keyword_record

MIN_LENGTH_UNIT = 0.05
"""Smallest unit of length of a joint.

It is a share of the distance that the joint would cover at full velocity in the duration of the
guess. `FreeProblem.unit` explains the unit of length.
"""


@keyword_record
class FreeProblem(OcpProblem):
    """Optimal control problem of a free motion with k segments and m moving joints.

    A segment is a part of the motion in which no joint reverses. Its borders are given points,
    reversals of joints, or passages of an eye's port (incision). The mesh divides the motion into n
    elements (time intervals). The unknown coordinates are u = (q − q0)/d, with the first point q0
    and the unit of length d of each joint. Scaled units are those of u and of `time_scale`.
    """

    chain: SegmentChain
    """Segments of the motion with their borders, directions and guesses."""

    @cached_property
    def moving(self) -> Indices:
        """Indices (m,) of the joints that move. They are the coordinates of the program."""
        return np.flatnonzero(self.directions.any(axis=0))

    @cached_property
    def unit(self) -> Array:
        """Distance d in rad or m that a joint travels when its coordinate u changes by 1, (4,).

        d is the largest distance of the joint between two neighbouring borders in the guess. The
        positions at some borders are only guesses, and this distance may then be much too small. d
        is therefore at least the share `MIN_LENGTH_UNIT` of the distance at full velocity.
        """
        extent = np.abs(np.diff(self.chain.points, axis=0)).max(axis=0)
        return np.maximum(extent, MIN_LENGTH_UNIT * self.joint_limits["velocity"] * self.time_scale)

    @cached_property
    def ranges(self) -> Array:
        """Smallest and largest positions at which joints may reverse, (2, 4), rad and m."""
        # Borders at which all positions are given.
        points = self.chain.points[self.chain.fixed.all(axis=1)]
        return reversal_ranges(self.phase, points)

    @property
    def boundary(self) -> BoundaryConditions:
        """Positions and velocities of the m coordinates at borders and ends, in scaled units.

        Borders are the positions at which joints may change their direction. A position that the
        solver determines is NaN.
        """
        start, end = (self.scaled(speed, 1) for speed in (self.phase.qd_start, self.phase.qd_end))
        points = self.scaled(
            np.where(self.chain.fixed, self.chain.points, np.nan) - self.chain.points[0], 0
        )
        ranges = self.scaled(self.ranges - self.chain.points[0], 0)
        start_acceleration = self.scaled(self.phase.qdd_start, 2)
        return BoundaryConditions(
            points,
            self.directions[:, self.moving],
            start,
            end,
            start_acceleration=start_acceleration,
            ranges=ranges,
        )

    @property
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of |u̇|, |ü| and |u⃛| in scaled units, (m,) each."""
        velocity, acceleration, jerk = (
            self.scaled(self.joint_limits[name], order)
            for order, name in enumerate(KINEMATIC_LIMITS, 1)
        )
        return velocity, acceleration, jerk

    @property
    def guess(self) -> Array:
        """Elements (time intervals) of the initial guess in scaled units, (n, 4 m + 1).

        A row contains u, u̇, ü at the start and ü at the end of an element (a number for each of the
        m moving joints), and the length of the element.
        """
        # One array (elements of the segment, 4 m) for each segment.
        states = []
        for guess in self.chain.guesses:
            motion = guess.elements
            position = self.scaled(motion.u - self.chain.points[0], 0)
            accelerations = self.scaled(motion.a0, 2), self.scaled(motion.a1, 2)
            states.append(np.hstack([position, self.scaled(motion.v, 1), *accelerations]))
        return np.column_stack([np.vstack(states), self.lengths])

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """Return the parameters and bounds of the nonlinear program on the present mesh.

        The base class provides most of them. A velocity that is given at the start or the end of
        the motion may already be at a limit. The path constraints at this instant therefore have no
        backoff, but a tolerance for rounding.

        Parameters
        ----------
        elements : (n, 4 m + 1) array
            Latest motion: u, u̇, ü at the start, ü at the end (m numbers each), and length of each
            element (time interval).
        backoff : (n, active constraints) array
            Amount by which the bound of each path constraint of the program is lowered in each
            element.

        Returns
        -------
        NlpData
            All numbers of the program.
        """
        base = super().data(elements, backoff)
        bound = base.path_bound.copy()
        # The columns of `bound` are the constraints at the start, in the middle and at the end of
        # an element. The slices are views, so an assignment to `at_end` changes `bound`.
        constraint_count = backoff.shape[1]
        ends = (
            (self.phase.qd_start, bound[0, :constraint_count]),
            (self.phase.qd_end, bound[-1, -constraint_count:]),
        )
        for velocity, at_end in ends:
            if velocity.any():
                # An infinite bound belongs to a constraint that does not apply.
                at_end[np.isfinite(at_end)] = 1 + EQUALITY_TOLERANCE
        return replace(base, path_bound=bound)

    def scaled(self, values: Array, order: int) -> Array:
        """Convert joint positions or their time derivatives to the scaled coordinates u.

        Parameters
        ----------
        values : (…, 4) array
            q − q0 in rad and m, or one of its derivatives with respect to time in s.
        order : int
            Order of the derivative, 0 for positions.

        Returns
        -------
        (…, m) array
            The same derivative of u = (q − q0)/d with respect to scaled time, for the m moving
            joints.
        """
        return (values * self.time_scale**order / self.unit)[..., self.moving]

    @property
    def element_model(self) -> FreeElement:
        """Functions of one element (time interval), with all path constraints that it can have.

        They are the limits of task coordinates, tool speeds, the eye, and motor torques.
        """
        problem = self.phase.problem
        return FreeElement(
            robot=problem.robot,
            mechanism=self.phase.mechanism,
            moving=tuple(self.moving.tolist()),
            eye=problem.eye,
        )

    @cached_property
    def ignored_rows(self) -> Mask:
        """True where one of r path constraints does not apply to an element, (n, r).

        The only such constraint is the distance to the retina. It is not limited while the tip is
        outside the eye or in its port, that is, in the incision through which the tool enters.
        """
        mask, eye = super().ignored_rows.copy(), self.phase.problem.eye
        if eye is not None:
            retina = self.row_names.index((RetinaClearance.name, None))
            mask[:, retina] = self.chain.is_within_port(eye.port)[self.structure.segment]
        return mask

    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return the parameter vectors of the functions that evaluate one element (time interval).

        Parameters
        ----------
        elements : (n, 4 m + 1) array
            Latest motion. It is not used, because the parameters of a free motion do not depend on
            it. Those of a motion along a path do (`OcpProblem.element_parameters`).

        Returns
        -------
        sigma : (n, 4) array
            Direction of each joint in each element: +1, −1 or 0.
        parameters : (size,) array
            Start, units and limits in the order of `FreeElement.layout`, the same for all elements.
        """
        return self.sigma, self._parameters

    @cached_property
    def _parameters(self) -> Array:
        """Parameter vector of the element functions, (size,), in the order of `FreeElement.layout`.

        The functions of one element (time interval) give its path constraints and its cost. They
        receive this vector in addition to the directions of the joints. It contains the start
        position, the units of the unknowns, and the limits of joints, tool and task coordinates.
        """
        problem = self.phase.problem
        # Smallest and largest angle of each coordinate, (2, 2). The element functions take the
        # centre and half the width of each range.
        ranges = np.array(
            [
                problem.ranges.get(name, (-UNLIMITED, UNLIMITED))
                for name in RANGE_LIMITED_COORDINATES
            ]
        )
        return FreeElement.layout.pack(
            q0=self.chain.points[0],
            d=self.unit,
            **self.joint_limits,
            **tool_limits(problem.speeds),
            range_centre=ranges.mean(axis=1) + self._whole_turns,
            range_half_width=(ranges[:, 1] - ranges[:, 0]) / 2,
            rate=[problem.rates.get(name, UNLIMITED) for name in RATE_LIMITED_COORDINATES],
            retina_easing=self._retina_easing,
            time_scale=self.time_scale,
        )

    @property
    def _whole_turns(self) -> Array:
        """Whole turns in rad by which the ranges of roll and spin are shifted, (2,).

        There is one value for each of `RANGE_LIMITED_COORDINATES`. At the first point, a range
        refers to an angle in (−π, π]. The path constraints compute the angle with `task_of_joints`,
        which does not reduce it to this interval. The shift is the difference of both angles.
        """
        start = self.chain.points[0]
        unwrapped = task_of_joints(NUMPY, self.phase.mechanism, tuple(start))
        wrapped = task_from_joints(self.phase.mechanism, start[None])
        return np.array(
            [
                float(unwrapped[k]) - wrapped[0, k]
                for k in map(TASK_COORDINATES.index, RANGE_LIMITED_COORDINATES)
            ]
        )

    @property
    def _retina_easing(self) -> float:
        """Amount by which the retina's constraint is relaxed, so that it allows all given points.

        The constraint is the dimensionless value of `retina_constraint`. It must not be positive.
        Rounding may make it slightly positive at a given point inside the eye. The tests before
        planning still accept such a point. Without the relaxation, the program would have no
        solution.
        """
        if self.phase.problem.eye is None:
            return 0.0
        # The depth of the tip depends on joint 4 alone. Only points whose positions are all given
        # count.
        in_eye = np.abs(self.chain.points[:, 3]) > self.phase.problem.eye.port + ROUNDING_TOLERANCE
        points = self.chain.points[self.chain.fixed.all(axis=1) & in_eye]
        constraint_values = retina_constraint(
            NUMPY, self.phase.problem.eye, tip_position(self.phase.mechanism, points).T
        )
        return float(constraint_values.max(initial=0.0))

    def direction_multipliers(self, solution: NlpSolution) -> DirectionMultipliers | None:
        """Estimate how much time reversals of joints, or motions of resting joints, could save.

        The estimate is of first order. For a moving joint, it follows from the Lagrange multipliers
        of the constraint "u̇ keeps its direction". For a joint at rest, it follows from the reduced
        costs (module `reduced_costs`).

        Parameters
        ----------
        solution : NlpSolution
            Solution of the nonlinear program.

        Returns
        -------
        DirectionMultipliers or None
            Savings as shares of the duration, for each joint and each element (time interval). None
            if the solver provides no multipliers.

        Notes
        -----
        With the multiplier λ_jk of joint j in element k, the velocity limit V_j and the duration T,
        the saving is V_j λ_jk / T.
        """
        multipliers = solution.multipliers
        structure = solution.structure
        if multipliers is None:
            return None
        lengths = solution.elements[:, -1]
        directions = self.directions[structure.segment]
        velocity = self.joint_limits["velocity"] * self.time_scale
        # A multiplier is the saving for each unit of u̇. Its product with the limit of u̇ is the
        # saving if the joint moved at its largest velocity.
        values = np.zeros((structure.elements, 4))
        values[:, self.moving] = multipliers.direction * (
            velocity[self.moving] / self.unit[self.moving]
        )
        # Joints at rest lack such multipliers, so their savings follow from reduced costs.
        standing = np.setdiff1d(np.arange(4), self.moving)
        if standing.size and multipliers.rows.any():
            gradient = self._gradient_of_all_joints(solution, multipliers)
            for i in standing:
                values[:, i] = velocity[i] * steepest_descent(gradient[:, :, i], lengths)
        instants = np.append(0.0, np.cumsum(lengths))
        return DirectionMultipliers(instants * self.time_scale, directions, values / lengths.sum())

    def _gradient_of_all_joints(self, solution: NlpSolution, multipliers: Multipliers) -> Array:
        """Compute the gradient of λᵀ G, the path constraints G weighted by their multipliers λ.

        The derivatives with respect to joints at rest are included, although the program has no
        unknowns for them.

        Parameters
        ----------
        solution : NlpSolution
            Solution of the nonlinear program with n elements (time intervals).
        multipliers : Multipliers
            Its multipliers, and the names of the path constraints to which they belong.

        Returns
        -------
        (n, 3, 4) array
            Derivatives with respect to q, q̇ and q̈ of each of the four joints in each element, for
            positions in rad and m and for scaled time.
        """
        elements, orders = solution.elements, np.arange(4)
        # Vectors z with u, u̇, ü at the start and ü at the end of all four joints, and the length.
        # The columns of joint i are i, 4 + i, 8 + i and 12 + i. They are 0 for joints at rest.
        element_variables = np.zeros((len(elements), 17))
        element_variables[:, np.add.outer(4 * orders, self.moving).ravel()] = elements[:, :-1]
        element_variables[:, -1] = elements[:, -1]
        element = shared_model(
            replace(self.element_model, moving=(0, 1, 2, 3), active=multipliers.active)
        )
        sigma = self.directions[solution.structure.segment]
        gradient = constraint_gradient(
            element, element_variables, (sigma, self._parameters), multipliers.rows
        )
        # Derivatives with respect to q, q̇, q̈ at the start and q̈ at the end, (n, 4, 4). The last
        # axis is the joint. A constant q̈ changes both values of q̈, so their derivatives are added.
        by_state = gradient[:, :-1].reshape(-1, 4, 4) / self.unit
        return np.stack([by_state[:, 0], by_state[:, 1], by_state[:, 2] + by_state[:, 3]], axis=1)

    def result(self, solution: NlpSolution) -> PhaseSolution:
        """Convert a solution of the nonlinear program to joint polynomials in SI units.

        The result has one quintic polynomial of each joint for each element (time interval).
        Neighbouring polynomials have exactly the same position and velocity at their common end.

        Parameters
        ----------
        solution : NlpSolution
            Solution in scaled units.

        Returns
        -------
        PhaseSolution
            The motion, or the status and message of the failure.
        """
        if not solution.solved:
            return PhaseSolution.from_solver(solution)
        count = len(solution.elements)
        pieces = as_cubics(solution.elements)
        boundary = self.boundary

        def joints(values: Array, order: int) -> Array:
            """Convert values of the coordinates u, or of a time derivative, to those of the joints.

            The function reads the number of elements from the enclosing method.

            Parameters
            ----------
            values : (n, m) array
                u, or one of its derivatives with respect to scaled time.
            order : int
                Order of the derivative, 0 for u.

            Returns
            -------
            (n, 4) array
                q in rad and m, or the same derivative with respect to time in s.
            """
            expanded = np.zeros((count, 4))
            expanded[:, self.moving] = values * self.unit[self.moving] / self.time_scale**order
            return expanded + (self.chain.points[0] if order == 0 else 0.0)

        breaks = np.concatenate([[0.0], np.cumsum(solution.elements[:, -1] * self.time_scale)])
        # Every element ends in the state in which the next one begins, so that both agree exactly.
        next_states = (
            np.vstack([pieces.u[1:], boundary.points[-1]]),
            np.vstack([pieces.v[1:], boundary.end_velocity]),
        )
        coefficients = quintic_coefficients(
            np.diff(breaks),
            (joints(pieces.u, 0), joints(pieces.v, 1), joints(pieces.a0, 2)),
            (joints(next_states[0], 0), joints(next_states[1], 1), joints(pieces.a1, 2)),
        )
        # Later steps do not treat a passage of the port as a border, so the segments before and
        # after it are joined. Their directions can be added, because a joint never reverses at the
        # port.
        border_indices = [k for k in range(len(self.chain.points)) if k not in self.chain.ports]
        border_instants = breaks[[*solution.structure.borders, count]][border_indices]
        directions = np.sign(np.add.reduceat(self.directions, border_indices[:-1]))
        return PhaseSolution.from_solver(
            solution,
            breaks=breaks,
            coefficients=coefficients,
            border_instants=border_instants,
            directions=directions,
            direction_multipliers=self.direction_multipliers(solution),
        )
