"""Values that describe the motion of a phase in SI units: its polynomials, directions and reversals."""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from ssm_planner.planning.ocp.nlp import Confirmation
from ssm_planner.planning.ocp.refinement import RefinedMotion
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record


@record
class DirectionMultipliers:
    """First-order savings of a motion if joints left their directions, for n elements."""

    instants: Array
    """Ends of the elements, (n + 1,), s."""
    directions: Array
    """Directions of the joints: +1, −1, or 0 for a joint that does not move, (n, 4)."""
    values: Array
    """Savings (n, 4) as a share of the duration.

    They are divided by the velocity against the direction as a share of the joint's limit.
    """
    points: Array
    """Instants at which the motion passes the given points, (k,), s."""

    @property
    def largest_sum(self) -> float:
        """Largest sum of |values| over the elements, among the joints."""
        return float(np.abs(self.values).sum(axis=0).max(initial=0.0))


@record
class Borders:
    """Borders at which joints may reverse on a free motion."""

    points: Array
    """Joints at the borders, (k + 1, 4)."""
    free: tuple[int, ...] = ()
    """Indices of the borders whose positions are only guesses."""
    directions: Array | None = None
    """Directions of the joints between the borders, (k, 4). None: from border to border."""
    via_velocity: Array | None = None
    """q̇ at the via points, (k − 1, 4), if they determine between which points joints reverse."""
    guess: tuple[Trajectory, Array] | None = None
    """A motion through the borders, and its instants there, (k + 1,), s."""


@record
class PhaseSolution:
    """Motion of a phase as joint polynomials, or the status of a failure."""

    status: str
    """Status "solved", "infeasible" or "not converged"."""
    message: str
    """Message of the solver."""
    iterations: int = 0
    breaks: Array = field(default_factory=lambda: np.zeros(1))
    """Ends of the pieces, (n + 1,) from 0, s."""
    coefficients: Array = field(default_factory=lambda: np.zeros((0, 6, 4)))
    """Coefficients of the quintic pieces, (n, 6, 4)."""
    solver: str = ""
    """Name of the solver that found the motion. Empty if none was needed."""
    border_instants: Array = field(default_factory=lambda: np.zeros(0))
    """Instants between which no joint reverses, (k + 1,), s. They include those of the points."""
    directions: Array = field(default_factory=lambda: np.zeros((0, 4)))
    """Directions of the joints between the borders of a free motion, (k, 4)."""
    direction_multipliers: DirectionMultipliers | None = None
    """Multipliers of the directions of a free motion."""
    confirmation: Confirmation | None = None
    refined: RefinedMotion | None = None
    """The refinement of the fastest motion, if the motion for the objective is still to be found."""

    @property
    def solved(self) -> bool:
        """True if there is a motion."""
        return self.status == "solved"

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.breaks[-1])

    def slower(self, factor: float) -> PhaseSolution:
        """Return the same motion from rest to rest with its duration multiplied by `factor`."""
        multipliers = self.direction_multipliers
        if multipliers is not None:
            multipliers = replace(
                multipliers,
                instants=multipliers.instants * factor,
                points=multipliers.points * factor,
            )
        return replace(
            self,
            breaks=self.breaks * factor,
            coefficients=self.coefficients / factor ** np.arange(6.0)[:, None],
            border_instants=self.border_instants * factor,
            direction_multipliers=multipliers,
        )

    @property
    def reversal_multiplier(self) -> float | None:
        """Largest sum of the remaining multipliers of one joint's direction over the motion.

        None for a motion along a path.
        """
        return (
            None if self.direction_multipliers is None else self.direction_multipliers.largest_sum
        )
