"""A phase (one entry of the motion list) with its motion.

The candidates of a phase, that is, the ways to move it, return this value. `planner.join_phases`
joins the motions of all phases to the trajectory of a problem.
"""

import numpy as np

from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.phases import Phase
from ssm_planner.trajectory import rest_coefficients
from ssm_planner.typing import record


@record
class PlannedPhase:
    """A phase (entry of the motion list) with its motion and a lower bound on its duration."""

    phase: Phase
    """The phase with its problem and its points."""
    motion: PhaseSolution
    """Its motion as joint polynomials."""
    lower_bound: float
    """Duration in s that no motion within the same limits can beat."""

    @property
    def duration(self) -> float:
        """Duration of the motion, s."""
        return self.motion.duration


def planned_rest(phase: Phase) -> PlannedPhase:
    """Return the motion of a phase in which the robot rests.

    It takes the requested duration of the phase. Without one, its duration is 0, and its motion
    contains no pieces.

    Parameters
    ----------
    phase : Phase
        A dwell, or a motion whose target is the present position.

    Returns
    -------
    PlannedPhase
        The phase with its motion. The lower bound is the duration itself.
    """
    duration = phase.motion.duration or 0.0
    motion = (np.array([0.0, duration]), rest_coefficients(phase.q_start)) if duration else ()
    return PlannedPhase(phase, PhaseSolution("solved", "", 0, *motion), duration)
