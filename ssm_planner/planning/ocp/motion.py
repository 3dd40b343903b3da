"""Motion of a phase in SI units: joint polynomials, directions and reversals of the joints.

A phase is a part of a mission from one stop to the next. `free` and `straight` return its motion as
a `PhaseSolution`. `reversals` reads the direction multipliers of a solution, and proposes `Borders`
at which joints may reverse in the next one.
"""

from dataclasses import field, replace
from typing import Any

import numpy as np

from ssm_planner.planning.ocp.nlp import Confirmation, NlpSolution
from ssm_planner.planning.ocp.refinement import RefinedMotion
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record


@record
class DirectionMultipliers:
    """Time that a motion would save, to first order, if its joints left their directions.

    In an optimised motion, every joint keeps its direction between two borders. A large multiplier
    shows where a reversal would save time. `FreeProblem.direction_multipliers` computes the values
    from the Lagrange multipliers of the optimal control problem, for a motion with n elements (time
    intervals).
    """

    instants: Array
    """Ends of the elements, (n + 1,), s."""
    directions: Array
    """Directions of the joints: +1, −1, or 0 for a joint that does not move, (n, 4)."""
    values: Array
    """Savings as a share of the duration, (n, 4).

    The joint moves against its direction with its largest velocity during the element. A joint
    without a direction moves either way.
    """
    points: Array
    """Instants at which the motion passes the given points, its ends included, (k,), s."""

    @property
    def largest_joint_sum(self) -> float:
        """Largest of the four joints' sums of |values| over the elements."""
        return float(np.abs(self.values).sum(axis=0).max(initial=0.0))


@record
class Borders:
    """Positions of a free motion at which joints may reverse, its start and end included.

    No joint reverses between two consecutive borders. The borders are the given points, and
    positions that an earlier motion or a test in closed form suggests.
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
    """Joint velocities q̇ of the guess at the inner borders, (k − 1, 4). None: 0.

    They decide between which borders joints reverse.
    """
    guess: tuple[Trajectory, Array] | None = None
    """A motion through the borders, and the instants at which it passes them, (k + 1,), s."""


@record
class PhaseSolution:
    """Motion of a phase (entry of the motion list) as joint polynomials, or status of a failure."""

    status: str
    """Status "solved", "infeasible" or "not converged"."""
    message: str
    """Message of the solver, see `NlpSolution.message`."""
    iterations: int = 0
    """Number of iterations of the solver."""
    breaks: Array = field(default_factory=lambda: np.zeros(1))
    """Ends of the pieces, (n + 1,) from 0, s."""
    coefficients: Array = field(default_factory=lambda: np.zeros((0, 6, 4)))
    """Coefficients of the quintic pieces by powers of the time since their start, (n, 6, 4)."""
    solver: str = ""
    """Name of the solver that found the motion. Empty if none was needed."""
    border_instants: Array = field(default_factory=lambda: np.zeros(0))
    """Instants between which no joint reverses, (k + 1,), s. They include those of the points."""
    directions: Array = field(default_factory=lambda: np.zeros((0, 4)))
    """Directions of the joints between the borders of a free motion, (k, 4)."""
    direction_multipliers: DirectionMultipliers | None = None
    """Savings of a free motion if its joints left their directions. None if they are unknown."""
    confirmation: Confirmation | None = None
    """Ipopt's confirmation of the optimum. None without it."""
    refined: RefinedMotion | None = None
    """Refinement of the fastest motion. None if the motion is already best for its objective."""

    @classmethod
    def from_solver(cls, solution: NlpSolution, **motion: Any) -> "PhaseSolution":
        """Build the result from the solution of a program.

        Parameters
        ----------
        solution : NlpSolution
            Solution, or the status of the failure.
        **motion
            Fields that describe the motion in SI units. Empty after a failure.

        Returns
        -------
        PhaseSolution
            The motion with the status, message and iterations of the solver.
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
        """The motion as a trajectory."""
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
        """Return the motion along the same path with its duration multiplied by `factor`.

        Only a motion from rest to rest keeps its velocities at both ends.

        Parameters
        ----------
        factor : float
            Ratio of the new duration to the old one. It may also be below 1.

        Returns
        -------
        PhaseSolution
            The motion. Its borders and multipliers belong to the new instants.
        """
        savings = self.direction_multipliers
        if savings is not None:
            savings = replace(
                savings,
                instants=savings.instants * factor,
                points=savings.points * factor,
            )
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
        """Time that the motion would save if one joint reversed, as a share of the duration.

        It is an estimate of first order: the largest of the four joints' sums of the savings in all
        elements (time intervals) of the motion. None for a motion along a path.
        """
        return (
            None
            if self.direction_multipliers is None
            else self.direction_multipliers.largest_joint_sum
        )
