"""Motions along a straight line in task coordinates, in place of a free motion.

Task coordinates are roll, tilt, spin and depth of the tool. The planner chooses the path of a free
motion. Along a given path, only the timing is unknown, so the optimisation problem has one unknown
function instead of four. The solver may find a motion there where it finds no free motion.
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
    """A motion along a straight line in task coordinates to the target of a free motion.

    It serves if the solver has found no free motion, whose path it may choose.
    """

    line: Phase
    """The phase with the line as its given path."""

    kind: ClassVar[str] = "task line"

    @classmethod
    def suggested_after_failure(
        cls, planner: PhasePlanner, reason: Reason
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if a line in task coordinates may replace the free motion.

        The path of the phase must not be given, the robot must move in it, and no limit may forbid
        a position on the line.

        Parameters
        ----------
        planner : PhasePlanner
            The phase (an entry of the motion list with its joint positions) and its solvers.
        reason : Reason
            Reason why the direct motion was not found. It is not used, because a line may help in
            any case.

        Yields
        ------
        PhaseCandidate
            At most one candidate, that is, one way to move the phase.
        """
        phase = planner.phase
        if phase.path is None and not phase.is_at_rest:
            line = replace_by_task_line(phase)
            if line is not None:
                yield cls(planner, line)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Plan the motion along the straight line in task coordinates.

        Parameters
        ----------
        cutoff : float
            Duration in s. It is not used, because the direct motion, the faster one, has failed.
        estimate : PlannedPhase or None
            None, because this kind of candidate (way to move) is solved at once.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why planning failed.
            The reason names no limit.
        """
        assert self.line.path is not None
        result = replace(self.planner, phase=self.line).along_path(self.line.path)
        # The limit that forbids the line need not forbid other motions, so the reason must not name
        # it as the cause of the failure.
        return replace(result, limit=None) if isinstance(result, Reason) else result
