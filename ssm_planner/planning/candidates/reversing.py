"""Free motions on which joints reverse between the points because this saves time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import Attempt, Candidate
from ssm_planner.planning.ocp.nlp import PhaseSolution, Reversals
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phase_task import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.reversals import ELEMENTS, FINAL_ELEMENTS, GAIN, refine_directions
from ssm_planner.planning.via_velocities import PAYS, passing_turns
from ssm_planner.problem.limits import Duration
from ssm_planner.problem.motion import Free

NONE_PAYS = Reason(None, None, None, None, "no reversal saves time")


@dataclass(frozen=True, eq=False)
class Reversing(Candidate):
    """A motion with reversals, found from the motion without them."""

    without: PlannedPhase | None
    """The direct motion. None if it is longer than the requested duration."""

    kind: ClassVar[str] = "reversing"

    @classmethod
    def suggested(cls, planner: PhasePlanner, attempt: Attempt | None) -> Iterator[Candidate]:
        """Yield the candidate if the direct motion exceeds its bound enough."""
        if attempt is None or attempt.candidate.kind != "direct" or not planner.may_reverse:
            return
        phase = planner.phase
        outcome = attempt.result or attempt.estimate
        has_via_points = len(phase.points) > 2
        if not isinstance(phase.motion, Free) or not (
            has_via_points or phase.begins_and_ends_at_rest
        ):
            return
        if isinstance(outcome, Reason):
            if isinstance(outcome.limit, Duration):
                yield cls(planner, None)
        elif outcome is not None and attempt.result is None:
            saved = PAYS if has_via_points else GAIN
            if (1 - saved) * outcome.duration > outcome.lower_bound:
                yield cls(planner, outcome)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion with the reversals that save most."""
        if len(self.planner.phase.points) > 2:
            return self._beside_points()
        return self._between_rests(cutoff)

    def _beside_points(self) -> PlannedPhase | Reason:
        """Return a motion on which joints pass beyond a point, or take a run-up to the next one."""
        turns = passing_turns(self.planner.problem, self.planner.phase)
        if turns is None:
            return NONE_PAYS
        cutoff = np.inf if self.without is None else (1 - PAYS) * self.without.duration
        result = self.planner.free(turns, cutoff=cutoff)
        return result if isinstance(result, Reason) or result.duration < cutoff else NONE_PAYS

    def _between_rests(self, cutoff: float) -> PlannedPhase | Reason:
        """Return a motion from rest to rest with the reversals that the multipliers suggest."""
        planner, without = self.planner, self.without
        quick = planner.for_time.unconfirmed
        solved: list[PlannedPhase] = []

        def solve(reversals: Reversals, limit: float) -> PhaseSolution | None:
            result = quick.free(reversals, cutoff=limit, count=ELEMENTS)
            if isinstance(result, Reason):
                return None
            solved.append(result)
            return result.motion

        of_time = planner.problem.objective == "time" and planner.phase.motion.duration is None
        if without is not None and (of_time or without.motion.continuation is not None):
            initial: PhaseSolution | None = without.motion
        else:
            initial = solve(Reversals(planner.phase.points), np.inf)
        reversals = None if initial is None else refine_directions(planner.phase, initial, solve)
        if reversals is None:
            return NONE_PAYS
        solution = planner.free(reversals, count=FINAL_ELEMENTS)
        duration = np.inf if without is None else without.duration
        if not of_time or (not isinstance(solution, Reason) and solution.duration < duration):
            return solution
        return (
            replace(solved[-1], phase=planner.phase)
            if planner.problem.planner == "fast"
            else NONE_PAYS
        )
