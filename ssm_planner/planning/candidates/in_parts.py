"""Free motions in two parts, with a rest between them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import PhaseCandidate, PhaseEvaluation
from ssm_planner.planning.candidates.detour import Detour
from ssm_planner.planning.candidates.direct import Direct
from ssm_planner.planning.feasibility import infeasible_place
from ssm_planner.planning.motor_strength import motor_too_weak
from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase, standing
from ssm_planner.planning.reason import Reason, duration_too_short
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.planning.search import find_fastest
from ssm_planner.planning.tolerances import SAME
from ssm_planner.problem import MotorTorque, unchecked
from ssm_planner.trajectory import join
from ssm_planner.typing import Array, record

SHARES = (1.0, 0.5)
"""Shares of their displacements that joints move in the first part."""
MOST = 4
"""Largest number of orders of the joints that are tried."""


class InParts(PhaseCandidate):
    """A free motion in two parts."""

    label: ClassVar[str]
    """End of the name of the phase."""

    def _fastest(self, phase: Phase, *others: type[PhaseCandidate]) -> PlannedPhase | Reason:
        """Return the fastest motion of a part, without a requested duration."""
        kinds: list[type[PhaseCandidate]] = [Direct, Detour, *others]
        untimed = replace(phase, motion=unchecked(phase.motion, duration=None))
        return find_fastest(kinds, replace(self.planner, phase=untimed), self.planner.work)[0]

    def _followed(
        self, first: PhaseSolution, onward: Phase, *others: type[PhaseCandidate]
    ) -> PlannedPhase | Reason:
        """Return the phase with the second part after the first one.

        The second part takes longer if a duration is requested.
        """
        phase = self.planner.phase
        result = standing(onward) if onward.stands else self._fastest(onward, *others)
        if isinstance(result, Reason):
            return result
        resumed, duration = result.motion, phase.motion.duration
        if duration is not None:
            needed = first.duration + resumed.duration
            if needed > duration * (1 + SAME) or not resumed.duration or phase.qd_end.any():
                return duration_too_short(phase.motion.name, duration, needed)
            resumed = resumed.slower((duration - first.duration) / resumed.duration)
        trajectory = join([("", motion.breaks, motion.coefficients) for motion in (first, resumed)])
        motion = replace(
            resumed,
            breaks=trajectory.breaks,
            coefficients=trajectory.coefficients,
            border_instants=np.append(
                first.border_instants, first.duration + resumed.border_instants[1:]
            ),
            directions=np.vstack([first.directions, resumed.directions]),
        )
        labelled = unchecked(phase.motion, name=f"{phase.motion.name}, {self.label}")
        return PlannedPhase(replace(phase, motion=labelled), motion, phase.lower_bound)


@record
class InTurn(InParts):
    """A free motion from rest to rest in which some joints go first, to relieve a weak motor."""

    between: Array
    """Joints at the rest, (4,)."""

    kind: ClassVar[str] = "in turn"
    label: ClassVar[str] = "in turn"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the shortest orders in which every motor is strong enough at the ends of both parts."""
        if latest is None or latest.failed is None or latest.candidate.kind != Direct.kind:
            return
        phase = planner.phase
        by_motor = isinstance(latest.failed.limit, MotorTorque) and phase.begins_and_ends_at_rest
        if phase.path is not None or len(phase.points) != 2 or not by_motor:
            return
        start, end = phase.points
        ways = np.array(list(product((0.0, 1.0), repeat=4))) * (end - start)
        points = np.unique(np.vstack([start + share * ways for share in SHARES]), axis=0)
        orders = [cls(planner, point) for point in points if _relieves(_parts(phase, point))]
        yield from sorted(orders, key=lambda order: order.bound)[:MOST]

    @property
    def bound(self) -> float:
        """Duration that no motion with this rest can beat, s."""
        return sum(part.lower_bound for part in _parts(self.planner.phase, self.between))

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return both motions, joined to one."""
        first, last = _parts(self.planner.phase, self.between)
        result = self._fastest(first)
        return result if isinstance(result, Reason) else self._followed(result.motion, last)


def _parts(phase: Phase, between: Array) -> tuple[Phase, Phase]:
    """Return the parts of a phase before and after joints (4,)."""
    start, end = phase.points
    first = phase.part(np.stack([start, between]), to_end=False)
    return first, phase.part(np.stack([between, end]))


def _relieves(parts: tuple[Phase, Phase]) -> bool:
    """Return True if both parts move, and motors and places do not forbid them."""
    if any(part.stands for part in parts) or infeasible_place(parts) is not None:
        return False
    paths = (PolylinePath(part.mechanism, part.points) for part in parts)
    return not any(map(motor_too_weak, parts, paths))
