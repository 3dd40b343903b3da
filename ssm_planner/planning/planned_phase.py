"""A phase with its motion."""

from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.phases import Phase
from ssm_planner.typing import record


@record
class PlannedPhase:
    """A phase with its motion and a lower bound of its duration."""

    phase: Phase
    motion: PhaseSolution
    lower_bound: float
    """Duration in s that no motion within the same limits can beat."""

    @property
    def duration(self) -> float:
        """Duration of the motion, s."""
        return self.motion.duration
