"""Optimal control problem of a free phase: the solver chooses the joint path.

Every joint moves in one direction between two borders. Positions thus lie between those of the
borders, and the friction law is exact. A joint that continues in its direction passes a point at
speed. A joint that reverses at a point, or rests on one side of it, is at rest there. Limits of
velocity, acceleration and jerk hold by construction. Motor torque, tip speed, rates, ranges of roll
and spin, and the eye are path constraints, which are active where they come near their limits.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.elements.element import shared
from ssm_planner.elements.free_element import RATED, WATCHED, FreeElement
from ssm_planner.elements.rows import UNLIMITED, RowName, tool_limits, tool_names, torque_names
from ssm_planner.kinematics import (
    Mechanism,
    retina_row,
    task_from_joints,
    task_of_joints,
    tip_position,
)
from ssm_planner.planning.ocp.guesses import KINEMATIC
from ssm_planner.planning.ocp.motion import DirectionMultipliers, PhaseSolution
from ssm_planner.planning.ocp.nlp import (
    BoundaryConditions,
    Multipliers,
    NlpData,
    NlpSolution,
    cubics,
)
from ssm_planner.planning.ocp.problem import OcpProblem
from ssm_planner.planning.ocp.reduced_costs import constraint_gradient, steepest_descent
from ssm_planner.planning.ocp.segments import SegmentChain
from ssm_planner.planning.phases import reversal_ranges
from ssm_planner.planning.tolerances import ROUNDING, SAME
from ssm_planner.problem import TASK, Problem, RetinaClearance, TaskRange, TaskRate
from ssm_planner.trajectory import hermite
from ssm_planner.typing import Array, Indices, Mask, keyword_record

LEAST_UNIT = 0.05
"""Smallest unit of a joint that may reverse, as a share of its way at full velocity."""


@keyword_record
class FreeProblem(OcpProblem):
    """Problem with k segments between points, reversals, and passages of the port."""

    problem: Problem
    mechanism: Mechanism
    chain: SegmentChain
    speeds: tuple[Array, Array]
    """q̇ at both ends, (4,) each."""
    start_acceleration: Array
    """q̈ at the start if jerk is limited, (4,)."""

    @cached_property
    def moving(self) -> Indices:
        """Indices of the joints that are coordinates, (m,)."""
        return np.flatnonzero(np.any(self.directions != 0, axis=0))

    @cached_property
    def unit(self) -> Array:
        """Length d of u = 1 for each joint, (4,)."""
        extent = np.abs(np.diff(self.chain.points, axis=0)).max(axis=0)
        if self.chain.fixed.all():
            return np.asarray(extent)
        return np.maximum(extent, LEAST_UNIT * self.joint_limits["velocity"] * self.time_scale)

    @cached_property
    def ranges(self) -> Array:
        """Ranges in which joints may reverse, (2, 4)."""
        return reversal_ranges(
            self.problem, self.mechanism, self.chain.points[self.chain.fixed.all(axis=1)]
        )

    @property
    def boundary(self) -> BoundaryConditions:
        """Boundary conditions in scaled coordinates and time."""
        start, end = (self.scaled(speed, 1) for speed in self.speeds)
        points = self.scaled(
            np.where(self.chain.fixed, self.chain.points, np.nan) - self.chain.points[0], 0
        )
        ranges = self.scaled(self.ranges - self.chain.points[0], 0)
        start_acceleration = self.scaled(self.start_acceleration, 2)
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
        """Limits of u̇, ü and u⃛ in scaled time, (m,) each."""
        velocity, acceleration, jerk = (
            self.scaled(self.joint_limits[name], order) for order, name in enumerate(KINEMATIC, 1)
        )
        return velocity, acceleration, jerk

    @property
    def guess(self) -> Array:
        """Elements of the guesses of all segments, one after the other, (n, 4 m + 1)."""
        states = []
        for guess in self.chain.guesses:
            motion = guess.elements
            values = motion.u - self.chain.points[0], motion.v, motion.a0, motion.a1
            scaled = (
                self.scaled(value, order) for value, order in zip(values, (0, 1, 2, 2), strict=True)
            )
            states.append(np.hstack([*scaled]))
        return np.column_stack([np.vstack(states), self.lengths])

    def data(self, elements: Array, backoff: Array) -> NlpData:
        """Return parameters and bounds of the program.

        At an end with a given velocity, rows may be at their limit up to rounding.
        """
        base = super().data(elements, backoff)
        bound = base.path_bound.copy()
        rows = backoff.shape[1]
        if self.speeds[0].any():
            bound[0, :rows] = np.where(np.isfinite(bound[0, :rows]), 1 + SAME, np.inf)
        if self.speeds[1].any():
            bound[-1, -rows:] = np.where(np.isfinite(bound[-1, -rows:]), 1 + SAME, np.inf)
        # The robot may stop first instead.
        brief = self.problem.planner == "fast" and bool(self.speeds[0].any())
        return replace(base, path_bound=bound, brief=brief)

    def scaled(self, values: Array, order: int) -> Array:
        """Return a derivative of q − q0 (…, 4) as that of u (…, m) with respect to scaled time."""
        return (values * self.time_scale**order / np.where(self.unit > 0, self.unit, 1.0))[
            ..., self.moving
        ]

    @cached_property
    def complete_element(self) -> FreeElement:
        """The element model with the rows that limits and the eye require."""
        problem = self.problem
        rows: set[RowName] = {
            (TaskRange.name_of(name), None) for name in WATCHED if name in problem.ranges
        }
        rows |= {(TaskRate.name_of(name), None) for name in RATED if name in problem.rates}
        rows |= tool_names(problem.speeds, ())
        if problem.eye is not None:
            rows |= {(limit.name, None) for limit in problem.eye.limits}
        rows = rows.union(*(torque_names(problem.robot, int(i)) for i in self.moving))
        return shared(
            FreeElement(
                robot=problem.robot,
                mechanism=self.mechanism,
                moving=tuple(self.moving.tolist()),
                active=frozenset(rows),
                eye=problem.eye,
            )
        )

    @cached_property
    def ignored_rows(self) -> Mask:
        """True for rows that do not count in an element, (n, r)."""
        mask = super().ignored_rows.copy()
        if self.problem.eye is not None:
            mask[:, self.row_names.index((RetinaClearance.name, None))] = self.at_port(
                self.problem.eye.port
            )
        return mask

    def at_port(self, port: float) -> Mask:
        """Return the elements in which the tip stays within the port, (n,)."""
        return self.chain.within(port)[self.structure.segment]

    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return σ and the parameters of the element model."""
        return self.sigma, self._parameters

    @cached_property
    def _parameters(self) -> Array:
        problem = self.problem
        ranges = np.array([problem.ranges.get(name, (-UNLIMITED, UNLIMITED)) for name in WATCHED])
        return FreeElement.layout.pack(
            q0=self.chain.points[0],
            d=self.unit,
            **self.joint_limits,
            **tool_limits(problem.speeds),
            range_centre=ranges.mean(axis=1) + self._whole_turns,
            range_half_width=(ranges[:, 1] - ranges[:, 0]) / 2,
            rate=[problem.rates.get(name, UNLIMITED) for name in RATED],
            retina_easing=self._retina_easing,
            time_scale=self.time_scale,
        )

    @property
    def _whole_turns(self) -> Array:
        """Differences between WATCHED at the first point and the closed form that the rows use."""
        start = self.chain.points[0]
        unwrapped = task_of_joints(NUMPY, self.mechanism, tuple(start))
        wrapped = task_from_joints(self.mechanism, start[None])
        return np.array([float(unwrapped[k]) - wrapped[0, k] for k in map(TASK.index, WATCHED)])

    @property
    def _retina_easing(self) -> float:
        """Amount by which the retina's row forbids one of the points.

        The tolerance of the limit allows it.
        """
        if self.problem.eye is None:
            return 0.0
        in_eye = np.abs(self.chain.points[:, 3]) > self.problem.eye.port + ROUNDING
        points = self.chain.points[self.chain.fixed.all(axis=1) & in_eye]
        rows = retina_row(NUMPY, self.problem.eye, tip_position(self.mechanism, points).T)
        return float(rows.max(initial=0.0))

    def direction_multipliers(self, solution: NlpSolution) -> DirectionMultipliers | None:
        """Return first-order savings of the motion if joints left their directions."""
        multipliers = solution.multipliers
        structure = solution.structure
        if multipliers is None:
            return None
        lengths = solution.elements[:, -1]
        directions = self.directions[structure.segment]
        velocity = self.joint_limits["velocity"] * self.time_scale
        values = np.zeros((structure.elements, 4))
        values[:, self.moving] = multipliers.direction * (
            velocity[self.moving] / self.unit[self.moving]
        )
        standing = np.setdiff1d(np.arange(4), self.moving)
        if standing.size and multipliers.rows.any():
            gradient = self._gradient_of_all_joints(solution, multipliers)
            for i in standing:
                values[:, i] = velocity[i] * steepest_descent(gradient[:, :, i], lengths)
        instants = np.append(0.0, np.cumsum(lengths))
        is_point = [
            k not in self.chain.ports and bool(fixed.all())
            for k, fixed in enumerate(self.chain.fixed)
        ]
        points = instants[[*structure.borders, structure.elements]][is_point]
        return DirectionMultipliers(
            instants * self.time_scale,
            directions,
            values / lengths.sum(),
            points=points * self.time_scale,
        )

    def _gradient_of_all_joints(self, solution: NlpSolution, multipliers: Multipliers) -> Array:
        """Return ∂(λᵀ G)/∂(q, q̇, q̈) of every joint, in scaled time, (n, 3, 4)."""
        elements, orders = solution.elements, np.arange(4)
        unit = np.where(self.unit > 0, self.unit, 1.0)
        z = np.zeros((len(elements), 17))
        z[:, np.add.outer(4 * orders, self.moving).ravel()] = elements[:, :-1]
        z[:, -1] = elements[:, -1]
        element = shared(
            replace(self.complete_element, moving=(0, 1, 2, 3), active=multipliers.active)
        )
        parameters = self._parameters.copy()
        parameters[FreeElement.layout.slices["d"]] = unit
        sigma = self.directions[solution.structure.segment]
        gradient = constraint_gradient(element, z, (sigma, parameters), multipliers.rows)
        by_state = gradient[:, :-1].reshape(-1, 4, 4) / unit
        return np.stack([by_state[:, 0], by_state[:, 1], by_state[:, 2] + by_state[:, 3]], axis=1)

    def result(self, solution: NlpSolution) -> PhaseSolution:
        """Return the solution as joint polynomials.

        Neighbours share position and velocity exactly.
        """
        if not solution.solved:
            return PhaseSolution(
                solution.status, solution.message, solution.iterations, solver=solution.solver
            )
        n = len(solution.elements)
        pieces = cubics(solution.elements)
        boundary = self.boundary

        def joints(values: Array, order: int) -> Array:
            expanded = np.zeros((n, 4))
            expanded[:, self.moving] = values * self.unit[self.moving] / self.time_scale**order
            return expanded + (self.chain.points[0] if order == 0 else 0.0)

        breaks = np.concatenate([[0.0], np.cumsum(solution.elements[:, -1] * self.time_scale)])
        next_states = (
            np.vstack([pieces.u[1:], boundary.points[-1]]),
            np.vstack([pieces.v[1:], boundary.end_velocity]),
        )
        coefficients = hermite(
            breaks,
            (joints(pieces.u, 0), joints(pieces.v, 1), joints(pieces.a0, 2)),
            (joints(next_states[0], 0), joints(next_states[1], 1), joints(pieces.a1, 2)),
        )
        indices = [k for k in range(len(self.chain.points)) if k not in self.chain.ports]
        borders = breaks[[*solution.structure.borders, n]][indices]
        directions = np.sign(np.add.reduceat(self.directions, indices[:-1]))
        return PhaseSolution(
            "solved",
            solution.message,
            solution.iterations,
            breaks,
            coefficients,
            solver=solution.solver,
            border_instants=borders,
            directions=directions,
            direction_multipliers=self.direction_multipliers(solution),
            confirmation=solution.confirmation,
        )
