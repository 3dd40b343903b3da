"""Free motions on which joints reverse between the given points to save time.

The planner chooses the path of a free motion. It first computes the direct motion, whose joints
reverse only where they must. Without via points (given points between start and end), the
Lagrange multipliers of the direct motion suggest further reversals (`reversals.py`). If there are
via points, closed forms suggest velocities at these points. A joint that passes a via point at such
a velocity must reverse before or after it (`via_velocities.py`).
"""

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
"""Reason of a candidate whose reversals do not shorten the direct motion enough."""


@record
class Reversing(PhaseCandidate):
    """A free motion with more reversals than necessary, which the direct motion suggests."""

    unreversed: PhaseSolution | None
    """The direct motion, whose joints reverse only where they must.

    None if it takes longer than the requested duration.
    """

    kind: ClassVar[str] = "reversing"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if reversals may shorten the direct motion enough.

        This is possible if the estimated duration of the direct motion exceeds its lower bound by a
        share of `GAP`, or of `MIN_SAVING` if there are via points. The candidate is also yielded if
        the direct motion takes longer than the requested duration.

        Parameters
        ----------
        planner : PhasePlanner
            The phase (an entry of the motion list with its joint positions) and its solvers.
        latest : Evaluation or None
            The candidate that the search has just estimated or solved, with its result. Only the
            direct motion suggests reversals. None at the beginning.

        Yields
        ------
        PhaseCandidate
            At most one candidate, that is, one way to move the phase.
        """
        phase = planner.phase
        passes_or_rests = len(phase.points) > 2 or phase.begins_and_ends_at_rest
        applies = planner.may_reverse and isinstance(phase.motion, Free) and passes_or_rests
        if latest is None or latest.candidate.kind != "direct" or not applies:
            return
        if latest.failed is not None:
            if isinstance(latest.failed.limit, Duration):
                yield cls(planner, None)
        elif latest.estimate is not None and latest.result is None:
            direct = latest.estimate
            saving = MIN_SAVING if len(phase.points) > 2 else GAP
            if (1 - saving) * direct.duration > direct.lower_bound:
                yield cls(planner, direct.motion)

    def _reverse_beside_points(self) -> PlannedPhase | Reason:
        """Return a motion on which joints reverse just before or after the via points.

        A joint that reverses exactly at a via point must stop there. It may save time to pass the
        point at speed and to reverse beyond it, or to move backwards before the point in order to
        accelerate towards it.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion. `NO_SAVING` if the motion is not
            shorter than the direct one by the share `MIN_SAVING` of its duration.
        """
        borders = suggest_via_velocities(self.planner.phase)
        if borders is None:
            return NO_SAVING
        cutoff = np.inf if self.unreversed is None else (1 - MIN_SAVING) * self.unreversed.duration
        result = self.planner.free(borders, cutoff=cutoff)
        return result if isinstance(result, Reason) or result.duration < cutoff else NO_SAVING

    def estimate(self, cutoff: float) -> PlannedPhase | Reason | None:
        """Return the fastest motion with the reversals that the Lagrange multipliers suggest.

        The multipliers tell how much time a joint would save by moving against its direction
        (`reversals.py`). The motion is solved on a coarse mesh, without Ipopt's confirmation.

        Parameters
        ----------
        cutoff : float
            Duration in s. A motion that takes at least as long is of no use. The method does not
            use it, because each round of `refine_directions` has a cutoff of its own, which follows
            from the motion of the previous round.

        Returns
        -------
        PlannedPhase, Reason or None
            The phase (entry of the motion list) with its estimated motion, or the reason
            `NO_SAVING`. None for a phase with via points, whose reversals are solved at once.
        """
        planner = self.planner
        if len(planner.phase.points) > 2:
            return None
        quick = planner.without_duration

        def solve(borders: Borders, limit: float) -> PhaseSolution | None:
            """Return the fastest motion whose joints reverse only at `borders`, or None.

            None means that the solver failed. The solver may give up on a motion that takes longer
            than `limit`, in s.
            """
            result = quick.free(borders, cutoff=limit, count=DEFAULT_ELEMENTS)
            return None if isinstance(result, Reason) else result.motion

        initial = self.unreversed or solve(Borders(planner.phase.points), np.inf)
        faster = initial and refine_directions(planner.phase, initial, solve)
        if faster is None:
            return NO_SAVING
        return PlannedPhase(planner.phase, faster, planner.phase.lower_bound)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion that is best for the objective, with the reversals of the estimate.

        It is solved with twice as many elements (intervals of time) as the estimate.

        Parameters
        ----------
        cutoff : float
            Duration in s. A motion that takes at least as long is of no use. The method does not
            use it, because the estimate is shorter.
        estimate : PlannedPhase or None
            The motion that the method `estimate` returned. None for a phase with via points.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why reversals give
            none.
        """
        if estimate is None:
            return self._reverse_beside_points()
        borders = borders_at_reversals(self.planner.phase, estimate.motion)
        return self.planner.free(borders, count=2 * DEFAULT_ELEMENTS)
