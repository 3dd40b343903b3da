"""The motion between the points without additional reversals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from ssm_planner.planning.candidates.candidate import Attempt, Candidate
from ssm_planner.planning.ocp.free import FINER_ELEMENTS
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phase_task import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.paths import PolylinePath


@dataclass(frozen=True, eq=False)
class Direct(Candidate):
    """A motion along the given path, or a free motion whose joints reverse only where they must."""

    kind: ClassVar[str] = "direct"

    @classmethod
    def suggested(cls, planner: PhasePlanner, attempt: Attempt | None) -> Iterator[Candidate]:
        """Yield the direct motion at the beginning of the search."""
        if attempt is None:
            yield cls(planner)

    def estimate(self, cutoff: float) -> PlannedPhase | Reason | None:
        """Return a free motion whose refinement stopped early, if another candidate may be faster.

        The comparison then costs less, because the slower motion need not be refined to the end.
        """
        planner = self.planner
        has_rivals = planner.may_reverse and planner.phase.path is None and planner.trades_time_only
        return self._free(cutoff, stop_early=True) if has_rivals else None

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion, refined to the end."""
        planner = self.planner
        if planner.phase.path is not None:
            return planner.along_path(planner.phase.path)
        if estimate is None:
            return self._free(cutoff)
        if estimate.motion.continuation is None:
            return estimate
        line = PolylinePath(planner.mechanism, planner.phase.points)
        result = planner.phase_result(line, estimate.motion.continuation())
        return self._free(cutoff) if isinstance(result, Reason) else result

    def _free(self, cutoff: float, *, stop_early: bool = False) -> PlannedPhase | Reason:
        """Return a free motion. If none is found on the usual mesh, try a finer one."""
        result = self.planner.free(cutoff=cutoff, stop_early=stop_early)
        if isinstance(result, Reason) and result.limit is None and not self.planner.estimate_only:
            return self.planner.free(count=FINER_ELEMENTS)
        return result
