"""Free motions in two parts with a rest between the parts.

A free motion is one whose path the planner chooses. `InTurn` moves some joints before the others.
`StopFirst` (in stop_first.py) stops first, and then moves from rest. Their common base class
`InParts` plans the parts and joins them.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import FallbackCandidate, PhaseCandidate
from ssm_planner.planning.candidates.detour import Detour
from ssm_planner.planning.candidates.direct import Direct
from ssm_planner.planning.feasibility import check_places
from ssm_planner.planning.motor_strength import check_motor_torque
from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase, planned_rest
from ssm_planner.planning.reason import Reason, short_duration_reason
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.planning.search import find_fastest
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE
from ssm_planner.problem import MotorTorque, unchecked_copy
from ssm_planner.trajectory import join_sections
from ssm_planner.typing import Array, record

DISPLACEMENT_SHARES = (1.0, 0.5)
"""Shares of their displacement that the joints that move first cover before the rest.

Each motor must be strong enough at both ends of both parts. A rest after half of the displacement
may meet this condition where a rest after all of it does not.
"""
MAX_ORDERS = 4
"""Largest number of positions of the rest that are tried. Each of them costs two optimisations."""


class InParts(FallbackCandidate):
    """A free motion that consists of two motions (parts) with a rest between them."""

    label: ClassVar[str]
    """Text that is added to the name of the motion, so that a report shows how it moves."""

    def _plan_part(self, phase: Phase, *others: type[PhaseCandidate]) -> PlannedPhase | Reason:
        """Search the fastest motion of one part.

        Direct motions and detours around the eye are tried, and the kinds in `others`.

        Parameters
        ----------
        phase : Phase
            The part, as a phase (entry of the motion list) of its own. Its requested duration is
            ignored, because it is that of both parts.
        *others : types of PhaseCandidate
            Further kinds of candidates, that is, ways to move the part.

        Returns
        -------
        PlannedPhase or Reason
            The part with its motion, or the reason why it has none.
        """
        kinds: list[type[PhaseCandidate]] = [Direct, Detour, *others]
        untimed = replace(phase, motion=unchecked_copy(phase.motion, duration=None))
        return find_fastest(kinds, replace(self.planner, phase=untimed), self.planner.work)[0]

    def _append_part(
        self, first: PhaseSolution, onward: Phase, *others: type[PhaseCandidate]
    ) -> PlannedPhase | Reason:
        """Plan the second part, and join both parts into one motion.

        If the phase has a requested duration, the second part is slowed down to reach it.

        Parameters
        ----------
        first : PhaseSolution
            Motion of the first part.
        onward : Phase
            Second part, which begins where the first one ends.
        *others : types of PhaseCandidate
            Further kinds of candidates (ways to move) for the second part.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with both parts as one motion. A reason states why
            there is no second part, or that the parts cannot be made to take the requested
            duration.
        """
        phase = self.planner.phase
        result = planned_rest(onward) if onward.is_at_rest else self._plan_part(onward, *others)
        if isinstance(result, Reason):
            return result
        second, duration = result.motion, phase.motion.duration
        if duration is not None:
            needed = first.duration + second.duration
            # A rest cannot be slowed down. The same applies to a motion that must end with a given
            # velocity.
            if (
                needed > duration * (1 + EQUALITY_TOLERANCE)
                or not second.duration
                or phase.qd_end.any()
            ):
                return short_duration_reason(phase.motion.name, duration, needed)
            second = second.slower((duration - first.duration) / second.duration)
        trajectory = join_sections(
            [("", motion.breaks, motion.coefficients) for motion in (first, second)]
        )
        # A border is an instant at which joints may reverse. The rest between the parts is the last
        # border of the first part and the first border of the second one, but it occurs only once.
        motion = replace(
            second,
            breaks=trajectory.breaks,
            coefficients=trajectory.coefficients,
            border_instants=np.append(
                first.border_instants, first.duration + second.border_instants[1:]
            ),
            directions=np.vstack([first.directions, second.directions]),
        )
        labelled = unchecked_copy(phase.motion, name=f"{phase.motion.name}, {self.label}")
        return PlannedPhase(replace(phase, motion=labelled), motion, phase.lower_bound)


@record
class InTurn(InParts):
    """A free motion from rest to rest in which some joints move before the others.

    It serves if a motor is too weak for the direct motion. The load of a motor depends on the
    positions of other joints, so the motor may be strong enough after another joint has moved.
    """

    between: Array
    """Joint positions at the rest between the two parts, (4,), rad and m."""

    kind: ClassVar[str] = "in turn"
    label: ClassVar[str] = "in turn"

    @classmethod
    def suggested_after_failure(
        cls, planner: PhasePlanner, reason: Reason
    ) -> Iterator[PhaseCandidate]:
        """Yield motions in two parts if a motor is too weak for the direct motion.

        The candidates differ in the joints that move first, and in the share of their displacement
        that these joints cover before the rest. A candidate is yielded only if every motor is
        strong enough at the ends of both parts.

        Parameters
        ----------
        planner : PhasePlanner
            The phase (an entry of the motion list with its joint positions) and its solvers.
        reason : Reason
            Reason why the direct motion was not found. Its limit tells whether a motor is too weak.

        Yields
        ------
        InTurn
            At most `MAX_ORDERS` candidates (ways to move), those with the smallest lower bounds
            first.
        """
        phase = planner.phase
        is_too_weak = isinstance(reason.limit, MotorTorque)
        between_points = phase.path is None and len(phase.points) == 2
        if not (is_too_weak and between_points and phase.begins_and_ends_at_rest):
            return
        start, end = phase.points
        # Each row contains the displacements of one of the 16 subsets of the joints, and 0 for the
        # other joints.
        displacements = np.array(list(product((0.0, 1.0), repeat=4))) * (end - start)
        points = np.unique(
            np.vstack([start + share * displacements for share in DISPLACEMENT_SHARES]), axis=0
        )
        orders = [cls(planner, point) for point in points]
        orders = [order for order in orders if _are_feasible(order.parts)]
        yield from sorted(orders, key=lambda order: order.bound)[:MAX_ORDERS]

    @cached_property
    def parts(self) -> tuple[Phase, Phase]:
        """Parts of the phase before and after the rest.

        The first part ends at rest. The second part begins at rest and ends as the phase does.
        """
        phase = self.planner.phase
        first = phase.from_rest(np.stack([phase.points[0], self.between]), to_end=False)
        return first, phase.from_rest(np.stack([self.between, phase.points[1]]))

    @property
    def bound(self) -> float:
        """Duration that no motion with a rest at `between` can beat, s."""
        return sum(part.lower_bound for part in self.parts)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Plan the motions of both parts, and join them into one.

        Parameters
        ----------
        cutoff : float
            Duration in s. It is not used, because both parts are always planned completely.
        estimate : PlannedPhase or None
            None, because this kind of candidate (way to move) is solved at once.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why a part has none.
        """
        first, last = self.parts
        result = self._plan_part(first)
        return result if isinstance(result, Reason) else self._append_part(result.motion, last)


def _are_feasible(parts: tuple[Phase, Phase]) -> bool:
    """Return True if no simple check excludes a motion of one of both parts.

    Each part must move a joint, no limit may forbid the joint positions at its ends, and every
    motor must be strong enough there.

    Parameters
    ----------
    parts : tuple of two Phase
        The parts before and after the rest, in the order of time.
    """
    if any(part.is_at_rest for part in parts) or check_places(parts) is not None:
        return False
    paths = (PolylinePath(part.mechanism, part.points) for part in parts)
    return not any(map(check_motor_torque, parts, paths))
