"""Motions around the eye: the tool is drawn back, swings, and is inserted again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import PhaseCandidate, PhaseEvaluation
from ssm_planner.planning.feasibility import nearest_to_eye
from ssm_planner.planning.ocp.motion import Borders
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phase_task import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.problem import LensClearance, RetinaClearance
from ssm_planner.typing import record

DEPTHS = (0.7, 0.55, 0.4, 0.85, 0.25)
"""Depths to which the guess draws the tool back, divided by the smaller depth of both ends.

The candidates try them in this order.
"""


@record
class Detour(PhaseCandidate):
    """A free motion on which the joints reverse once, so that the tool passes retina or lens."""

    share: int
    """Index of the depth in DEPTHS."""

    kind: ClassVar[str] = "detour"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the first detour if the eye blocks the direct motion, and the next if one fails."""
        if (
            latest is None
            or latest.failed is None
            or planner.approximate
            or len(planner.phase.points) != 2
        ):
            return
        if isinstance(latest.candidate, Detour):
            if latest.candidate.share + 1 < len(DEPTHS):
                yield cls(planner, latest.candidate.share + 1)
        elif latest.candidate.kind == "direct" and isinstance(
            latest.failed.limit, (RetinaClearance, LensClearance)
        ):
            yield from [cls(planner, 0)] if planner.phase.path is None else []

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return a motion with one reversal.

        The guess of the reversal is where the direct motion comes nearest to the eye, with the tool
        drawn back.
        """
        planner = self.planner
        start, end = planner.phase.points
        over = nearest_to_eye(planner.phase)
        depth = DEPTHS[self.share] * min(start[3], end[3], key=abs)
        over_eye = Borders(np.stack([start, np.append(over[:3], depth), end]), (1,))
        return planner.free(over_eye)
