"""Free motions on which joints reverse between the points because this saves time."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import PhaseCandidate, PhaseEvaluation
from ssm_planner.planning.ocp.free import DEFAULT_ELEMENTS
from ssm_planner.planning.ocp.motion import Borders, PhaseSolution
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.reversals import borders_at_reversals, refine_directions
from ssm_planner.planning.tolerances import GAP
from ssm_planner.planning.via_velocities import MIN_SAVING, suggest_via_velocities
from ssm_planner.problem import Duration, Free
from ssm_planner.typing import record

NO_SAVING = Reason(message="no reversal saves time")


@record
class Reversing(PhaseCandidate):
    """A motion with reversals, found from the motion without them."""

    unreversed: PhaseSolution | None
    """The fastest motion without reversals. None if it is longer than the requested duration."""

    kind: ClassVar[str] = "reversing"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if the direct motion exceeds its bound enough."""
        if latest is None or latest.candidate.kind != "direct" or not _applies(planner):
            return
        if latest.failed is not None:
            if isinstance(latest.failed.limit, Duration):
                yield cls(planner, None)
        elif latest.estimate is not None and latest.result is None:
            estimate = latest.estimate
            saved = MIN_SAVING if len(planner.phase.points) > 2 else GAP
            if (1 - saved) * estimate.duration > estimate.lower_bound:
                yield cls(planner, estimate.motion)

    def _reverse_beside_points(self) -> PlannedPhase | Reason:
        """Return a motion on which joints pass beyond a point, or take a run-up to the next one."""
        turns = suggest_via_velocities(self.planner.phase)
        if turns is None:
            return NO_SAVING
        cutoff = np.inf if self.unreversed is None else (1 - MIN_SAVING) * self.unreversed.duration
        result = self.planner.free(turns, cutoff=cutoff)
        return result if isinstance(result, Reason) or result.duration < cutoff else NO_SAVING

    def estimate(self, cutoff: float) -> PlannedPhase | Reason | None:
        """Return a motion from rest to rest with the reversals that the multipliers suggest.

        It is the fastest one, on a coarse mesh, without Ipopt's confirmation.
        """
        planner = self.planner
        if len(planner.phase.points) > 2:
            return None
        quick = planner.without_duration

        def solve(borders: Borders, limit: float) -> PhaseSolution | None:
            result = quick.free(borders, cutoff=limit, count=DEFAULT_ELEMENTS)
            return None if isinstance(result, Reason) else result.motion

        initial = self.unreversed or solve(Borders(planner.phase.points), np.inf)
        faster = initial and refine_directions(planner.phase, initial, solve)
        if faster is None:
            return NO_SAVING
        return PlannedPhase(planner.phase, faster, planner.phase.lower_bound)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion with the reversals that save most."""
        if estimate is None:
            return self._reverse_beside_points()
        borders = borders_at_reversals(self.planner.phase, estimate.motion)
        solution = self.planner.free(borders, count=2 * DEFAULT_ELEMENTS)
        fast = self.planner.problem.planner == "fast" and self.planner.problem.objective == "time"
        if (
            fast
            and self.unreversed
            and (isinstance(solution, Reason) or solution.duration > cutoff)
        ):
            return estimate
        return solution


def _applies(planner: PhasePlanner) -> bool:
    """Return True for a free motion through via points, or from rest to rest."""
    phase = planner.phase
    passes_or_rests = len(phase.points) > 2 or phase.begins_and_ends_at_rest
    return planner.may_reverse and isinstance(phase.motion, Free) and passes_or_rests
