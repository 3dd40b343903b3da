"""The direct motion of a phase (an entry of the motion list).

It follows the given path of the phase. If the phase is a free motion, whose path the planner
chooses, its joints reverse only where they must. The search tries it first. The estimate of the
direct motion, or its failure, then suggests candidates of other kinds.
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
        """Yield the direct motion at the beginning of the search, that is, if `latest` is None."""
        if latest is None:
            yield cls(planner)

    def estimate(self, cutoff: float) -> PlannedPhase | Reason | None:
        """Return the fastest free motion without Ipopt's confirmation, if reversals may save time.

        The search compares this estimate with that of the candidate `reversing`. It completes only
        the faster of both, because Ipopt's confirmation and the reduction of heat take long.

        Parameters
        ----------
        cutoff : float
            Duration in s. A motion that takes at least as long is of no use.

        Returns
        -------
        PlannedPhase, Reason or None
            The phase with the approximate motion, or the reason why planning failed. None if no
            other candidate can be faster, so that the motion is completed at once.
        """
        planner = self.planner
        is_fastest_wanted = planner.phase.motion.duration is None and planner.cooling is None
        has_rivals = planner.may_reverse and planner.phase.path is None and is_fastest_wanted
        return planner.free(cutoff=cutoff, fastest_only=True) if has_rivals else None

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion that is best for the objective of the problem.

        If the planner of the problem is `optimal`, Ipopt confirms the motion. If the estimate cannot
        be completed to a motion, the free motion is solved again from the beginning.

        Parameters
        ----------
        cutoff : float
            Duration in s. A free motion that takes at least as long is of no use, so its solver may
            give up. A motion along a given path is always completed.
        estimate : PlannedPhase or None
            The approximate motion from the method `estimate`.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why planning failed.
        """
        planner = self.planner
        if planner.phase.path is not None:
            return planner.along_path(planner.phase.path)
        if estimate is None:
            return planner.free(cutoff=cutoff)
        result = planner.best_free(estimate, cutoff)
        return planner.free(cutoff=cutoff) if isinstance(result, Reason) else result
