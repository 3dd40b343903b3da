"""The direct motion of a phase: along its given path, or freely without additional reversals.

It is the first candidate. All other kinds follow from its estimate or its failure.
"""

from collections.abc import Iterator
from typing import ClassVar

from ssm_planner.planning.candidates.candidate import PhaseCandidate, PhaseEvaluation
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.typing import record


@record
class Direct(PhaseCandidate):
    """A motion along the given path, or a free motion whose joints reverse only where they must."""

    kind: ClassVar[str] = "direct"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the direct motion at the beginning of the search."""
        if latest is None:
            yield cls(planner)

    def estimate(self, cutoff: float) -> PlannedPhase | Reason | None:
        """Return the fastest free motion before Ipopt's confirmation, if reversals may be faster.

        The search then compares this estimate with that of the candidate `reversing`. Ipopt
        confirms only the motion that is taken, and heat is reduced only in that one. Returns None
        if no other candidate can be faster, so that the motion is solved at once.
        """
        planner = self.planner
        is_fastest_wanted = planner.phase.motion.duration is None and planner.cooling is None
        has_rivals = planner.may_reverse and planner.phase.path is None and is_fastest_wanted
        return planner.free(cutoff=cutoff, fastest_only=True) if has_rivals else None

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion for the objective, confirmed by Ipopt if the planner asks for it.

        If the motion of the estimate cannot be completed, the free motion is solved anew.

        Parameters
        ----------
        cutoff : float
            Duration in s from which on a motion is of no use. A motion along a given path ignores
            it.
        estimate : PlannedPhase or None
            The motion that the method `estimate` returned.

        Returns
        -------
        PlannedPhase or Reason
            The phase with its motion, or the reason why there is none.
        """
        planner = self.planner
        if planner.phase.path is not None:
            return planner.along_path(planner.phase.path)
        if estimate is None:
            return planner.free(cutoff=cutoff)
        result = planner.best_free(estimate, cutoff)
        return planner.free(cutoff=cutoff) if isinstance(result, Reason) else result
