"""Motions that begin at speed: a stop, then a motion from rest."""

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import PhaseCandidate, PhaseEvaluation
from ssm_planner.planning.candidates.detour import Detour
from ssm_planner.planning.candidates.direct import Direct
from ssm_planner.planning.feasibility import infeasible_place
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.search import find_fastest
from ssm_planner.problem import Robot
from ssm_planner.trajectory import join
from ssm_planner.typing import Array, record

ROOM = 1.1
"""Distance that joints get to stop, divided by their shortest braking distance."""


@record
class StopFirst(PhaseCandidate):
    """A free motion that begins at speed, split into a stop and a motion from rest."""

    kind: ClassVar[str] = "stop first"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if no direct motion was found."""
        if latest is None or latest.failed is None or latest.candidate.kind != "direct":
            return
        phase = planner.phase
        if phase.path is None and phase.qd_start.any() and phase.motion.duration is None:
            yield cls(planner)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return both motions, joined to one. Its name ends in "stops first"."""
        planner, phase = self.planner, self.planner.phase
        stop = stopping_point(planner.problem.robot, phase.q_start, phase.qd_start)
        at_rest = np.zeros(4)
        stopping = replace(phase, points=np.stack([phase.q_start, stop]), qd_end=at_rest)
        points = np.vstack([stop, phase.points[1:]])
        onward = replace(phase, points=points, qd_start=at_rest, qdd_start=at_rest)
        reason = infeasible_place((stopping, onward))
        if reason is not None:
            return reason
        motions = []
        kinds: list[type[PhaseCandidate]] = [Direct, Detour]
        for stage in (stopping, onward):
            result, _ = find_fastest(kinds, replace(planner, phase=stage), planner.work)
            if isinstance(result, Reason):
                return result
            motions.append(result.motion)
        stopped, resumed = motions
        trajectory = join([("", motion.breaks, motion.coefficients) for motion in motions])
        motion = replace(
            resumed,
            breaks=trajectory.breaks,
            coefficients=trajectory.coefficients,
            border_instants=np.append(
                stopped.border_instants, stopped.duration + resumed.border_instants[1:]
            ),
            directions=np.vstack([stopped.directions, resumed.directions]),
        )
        name = f"{phase.motion.name}, stops first"
        labelled = replace(phase, motion=replace(phase.motion, name=name))
        return PlannedPhase(labelled, motion, phase.lower_bound)


def stopping_point(robot: Robot, q: Array, qd: Array) -> Array:
    """Return the joints (4,) at which a robot stops that has joints q and velocities qd, (4,)."""
    strongest = robot.accelerations
    return np.asarray(q + ROOM * qd * np.abs(qd) / (2 * strongest))
