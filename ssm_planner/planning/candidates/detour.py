"""Motions past the retina or the lens of the eye.

The tool is drawn back, swings to its new direction, and is inserted again.
"""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import FallbackCandidate, PhaseCandidate
from ssm_planner.planning.feasibility import joints_nearest_to_eye
from ssm_planner.planning.ocp.motion import Borders
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.problem import LensClearance, RetinaClearance
from ssm_planner.typing import record

RETRACTION_SHARES = (0.7, 0.55, 0.4, 0.85, 0.25)
"""Depths to which the tool is drawn back, as shares of the smaller depth of both ends.

They are tried in this order until one gives a motion. Each depth is only the guess from which the
solver starts. The solver determines the final depth.
"""


@record
class Detour(FallbackCandidate):
    """A free motion on which joints reverse once, so that the tool passes the retina or the lens.

    The planner chooses the path of a free motion.
    """

    kind: ClassVar[str] = "detour"

    @classmethod
    def suggested_after_failure(
        cls, planner: PhasePlanner, reason: Reason
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if the eye blocks the direct free motion between two points.

        Parameters
        ----------
        planner : PhasePlanner
            The phase (an entry of the motion list with its joint positions) and its solvers.
        reason : Reason
            Reason why the direct motion was not found. Its limit tells whether retina or lens block
            the motion.

        Yields
        ------
        PhaseCandidate
            At most one candidate, that is, one way to move the phase.
        """
        phase = planner.phase
        between_two_points = phase.path is None and len(phase.points) == 2
        by_eye = isinstance(reason.limit, (RetinaClearance, LensClearance))
        if between_two_points and by_eye and not planner.approximate:
            yield cls(planner)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return a motion with one position between start and end at which joints may reverse.

        The solver moves this position to where the motion becomes fastest. The initial guess has
        the joint angles at which the direct motion comes nearest to the retina or lens, with the
        tool drawn back to one of the depths in `RETRACTION_SHARES`.

        Parameters
        ----------
        cutoff : float
            Duration in s. A motion that takes at least as long is of no use. It is not used,
            because the direct motion, the only faster one, has already failed.
        estimate : PlannedPhase or None
            None, because this kind of candidate (way to move) is solved at once.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason of the last attempt
            if no depth in `RETRACTION_SHARES` gives one.
        """
        start, end = self.planner.phase.points
        nearest = joints_nearest_to_eye(self.planner.phase)
        for share in RETRACTION_SHARES:
            # Joint 4 inserts the tool. Its position is 0 if the tip is at the remote centre.
            depth = share * min(start[3], end[3], key=abs)
            retracted = np.append(nearest[:3], depth)
            # (1,) is the index of the retracted position, which the solver may move.
            result = self.planner.free(Borders(np.stack([start, retracted, end]), (1,)))
            if not isinstance(result, Reason):
                break
        return result
