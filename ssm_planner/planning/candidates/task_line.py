"""Motions along a straight line in task coordinates, in place of a free motion.

The program along a given path has one unknown function instead of four. It may converge where the
program of the free motion fails.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

from ssm_planner.planning.candidates.candidate import FallbackCandidate, PhaseCandidate
from ssm_planner.planning.feasibility import replace_by_task_line
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.typing import record


@record
class TaskLine(FallbackCandidate):
    """The motion along a straight line in task coordinates to the target of a free motion.

    It serves if no free motion, whose path the solver chooses, was found.
    """

    line: Phase
    """The phase with the line as its given path."""

    kind: ClassVar[str] = "task line"

    @classmethod
    def suggested_after_failure(
        cls, planner: PhasePlanner, reason: Reason
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if the free motion may be replaced by a line.

        The phase must be free and must move, and no limit may forbid a place on the line.

        Parameters
        ----------
        planner : PhasePlanner
            The phase (an entry of the motion list with its joint positions) and its solvers.
        reason : Reason
            Reason why the direct motion was not found. It is not used.

        Yields
        ------
        PhaseCandidate
            At most one candidate.
        """
        phase = planner.phase
        if phase.path is None and not phase.is_at_rest:
            line = replace_by_task_line(phase)
            if line is not None:
                yield cls(planner, line)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion along the line."""
        assert self.line.path is not None
        result = replace(self.planner, phase=self.line).along_path(self.line.path)
        # The limit that forbids the line need not forbid other motions, so the reason names none.
        return replace(result, limit=None) if isinstance(result, Reason) else result
