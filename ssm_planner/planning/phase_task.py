"""The planning task of one phase, and the planned phase."""

from __future__ import annotations

from dataclasses import field

from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.work import Work
from ssm_planner.problem import Problem, Robot
from ssm_planner.typing import Array, record


@record
class PlannedPhase:
    """A phase with its motion and a lower bound of its duration."""

    phase: Phase
    motion: PhaseSolution
    lower_bound: float
    """Duration that no motion within the same limits can beat, s."""

    @property
    def duration(self) -> float:
        """Duration of the motion, s."""
        return self.motion.duration

    @property
    def turns_back(self) -> bool:
        """True for a free motion from rest to rest whose joints reverse between its points."""
        phase = self.phase
        return (
            phase.path is None
            and phase.begins_and_ends_at_rest
            and len(self.motion.border_instants) > len(phase.points)
        )


@record
class PhaseTask:
    """Requirements on the motion of a phase."""

    strict: Robot
    """The robot with the limits that the motion must keep.

    They may be tighter than those of the problem.
    """
    phase: Phase
    cooling: Array | None = None
    """Weights (4,) of the motors' heat relative to time. None: heat does not count."""
    approximate: bool = False
    """True if an estimate of the duration by the structured solver in few rounds suffices."""
    may_reverse: bool = True
    """True if joints may reverse where they need not."""
    work: Work = field(default_factory=Work)

    @property
    def problem(self) -> Problem:
        """Problem of the phase."""
        return self.phase.problem
