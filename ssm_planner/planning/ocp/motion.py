"""Motion of a phase in SI units: joint polynomials, directions and reversals of the joints.

A phase is an entry of the problem's motion list with its joint positions. It usually begins and
ends at rest. `free` and `straight` return its motion as a `PhaseSolution`. `DirectionMultipliers`
show where reversals of joints would save time. From them, `reversals` proposes `Borders` at which
joints may reverse in the next solution.
"""

from dataclasses import field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ssm_planner.planning.ocp.nlp import Confirmation, NlpSolution
from ssm_planner.planning.ocp.refinement import RefinedMotion
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record


@record
class DirectionMultipliers:
    """Time that a free motion would save, to first order, if its joints left their directions.

    In an optimised motion, every joint keeps its direction between two borders, that is, positions
    at which joints may reverse. A large multiplier shows where a further reversal would save time.
    `FreeProblem.direction_multipliers` computes the values from the Lagrange multipliers of the
    optimal control problem, for a motion with n elements (time intervals).
    """

    instants: Array
    """Start of the first element, and ends of all elements, (n + 1,), s."""
    directions: Array
    """Direction of each joint in each element: +1, −1, or 0 if it does not move, (n, 4)."""
    values: Array
    """Savings of each joint in each element, as shares of the duration, (n, 4).

    |value| is the saving if the joint moved with its largest velocity during the element, against
    its direction. The sign of the value is the direction of this movement. A joint at rest may have
    either sign.
    """

    @property
    def largest_joint_sum(self) -> float:
        """Largest saving by one joint: the largest of the four joints' sums of |values|.

        The sum is taken over all elements (time intervals). It is a share of the duration.
        """
        return float(np.abs(self.values).sum(axis=0).max(initial=0.0))


@record
class Borders:
    """Positions of a free motion at which joints may reverse, with its start and end.

    Between two consecutive borders no joint reverses, unless its velocities there (`via_velocity`)
    force it to. The borders are the given points, and positions that an earlier motion or a test
    suggests.
    """

    points: Array
    """Joint positions at the borders, (k + 1, 4), rad and m."""
    free: tuple[int, ...] = ()
    """Indices of the borders whose positions are only guesses. The solver determines them."""
    directions: Array | None = None
    """Directions of the joints between the borders: +1, −1 or 0, (k, 4).

    None: the signs of the displacements from border to border.
    """
    via_velocity: Array | None = None
    """Joint velocities q̇ of the guess at the inner borders, (k − 1, 4), rad/s and m/s. None: 0.

    A velocity that is not 0 may force its joint to reverse before or behind the border.
    """
    guess: tuple[Trajectory, Array] | None = None
    """A motion through the borders, and the instants at which it passes them, (k + 1,), s."""

    @cached_property
    def displacements(self) -> Array:
        """Displacements of the joints from each border to the next one, (k, 4), rad and m.

        A joint rests between two borders whose positions differ only by rounding.
        """
        displacements = np.diff(self.points, axis=0)
        displacements[np.abs(displacements) <= ROUNDING_TOLERANCE] = 0.0
        return displacements


@record
class PhaseSolution:
    """Motion of a phase (entry of the motion list) as joint polynomials, or status of a failure.

    After a failure, the fields that describe the motion are empty.
    """

    status: str
    """Status "solved", "infeasible" or "not converged"."""
    message: str
    """Message of the solver, see `NlpSolution.message`."""
    iterations: int = 0
    """Number of iterations of the solver."""
    breaks: Array = field(default_factory=lambda: np.zeros(1))
    """Start and ends of the n polynomial pieces, (n + 1,), s. The first entry is 0."""
    coefficients: Array = field(default_factory=lambda: np.zeros((0, 6, 4)))
    """Coefficients of the quintic pieces, (n, 6, 4), with the axes piece, power and joint.

    The powers are those of the time since the start of the piece.
    """
    solver: str = ""
    """Name of the solver that found the motion. Empty if none was needed."""
    border_instants: Array = field(default_factory=lambda: np.zeros(0))
    """Instants between which no joint reverses, (k + 1,), s.

    They include the start, the end, and the passages of the given points.
    """
    directions: Array = field(default_factory=lambda: np.zeros((0, 4)))
    """Directions of the joints between the borders of a free motion, (k, 4)."""
    direction_multipliers: DirectionMultipliers | None = None
    """Estimated savings of a free motion by further reversals of joints. None if unknown."""
    confirmation: Confirmation | None = None
    """Ipopt's confirmation of the optimum. None without it."""
    refined: RefinedMotion | None = None
    """Final refinement of the fastest motion, from which `free.find_best_free` continues.

    None if the motion is already the best one for the objective.
    """

    @classmethod
    def from_solver(cls, solution: NlpSolution, **motion: Any) -> "PhaseSolution":
        """Build the motion of a phase from the solution of its nonlinear program.

        Parameters
        ----------
        solution : NlpSolution
            Solution, or the status of the failure.
        **motion
            Values of the fields that describe the motion in SI units. None are given after a
            failure.

        Returns
        -------
        PhaseSolution
            The given fields, with the status, the message, the number of iterations and the
            confirmation of the solution.
        """
        return cls(
            solution.status,
            solution.message,
            solution.iterations,
            solver=solution.solver,
            confirmation=solution.confirmation,
            **motion,
        )

    @property
    def trajectory(self) -> Trajectory:
        """The motion as a trajectory without named phases."""
        return Trajectory(self.breaks, self.coefficients, ())

    @property
    def solved(self) -> bool:
        """True if there is a motion."""
        return self.status == "solved"

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.breaks[-1])

    def slower(self, factor: float) -> "PhaseSolution":
        """Stretch the motion in time along the same path.

        All velocities are divided by the factor. Velocities at both ends therefore remain only in a
        motion from rest to rest.

        Parameters
        ----------
        factor : float
            Ratio of the new duration to the old one. It may also be below 1.

        Returns
        -------
        PhaseSolution
            The stretched motion. The instants of its borders and savings are stretched too.
        """
        savings = self.direction_multipliers
        if savings is not None:
            savings = replace(savings, instants=savings.instants * factor)
        return replace(
            self,
            breaks=self.breaks * factor,
            # The coefficient of t^k is divided by factor^k.
            coefficients=self.coefficients / factor ** np.arange(6.0)[:, None],
            border_instants=self.border_instants * factor,
            direction_multipliers=savings,
        )

    @property
    def reversal_multiplier(self) -> float | None:
        """Time that further reversals of one joint would save, as a share of the duration.

        It is an estimate of first order: for each joint, the savings in all elements (time
        intervals) of the motion are added, and the largest of the four sums counts. None for a
        motion along a given path, or if the savings are unknown.
        """
        return (
            None
            if self.direction_multipliers is None
            else self.direction_multipliers.largest_joint_sum
        )
