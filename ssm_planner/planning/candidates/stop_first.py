"""Motions that begin at speed: a stop in closed form, then a motion from rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import PhaseCandidate, PhaseEvaluation
from ssm_planner.planning.candidates.direct import Direct
from ssm_planner.planning.candidates.in_parts import InParts, InTurn
from ssm_planner.planning.candidates.task_line import TaskLine
from ssm_planner.planning.feasibility import infeasible_place
from ssm_planner.planning.lower_bound import stopping_curves
from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.ocp.segments import guess_of_curves
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.paths import MotionPath
from ssm_planner.planning.retiming.retime import keeps_limits
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.problem import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record

ROOM = 1.1
"""Distance that joints without jerk limits get to stop, divided by their braking distance."""
SHARES = (1.0, 0.5, 0.25, 0.1)
"""Shares of their accelerations with which joints stop, tried in turn.

Weak motors with heavy rotors cannot brake as hard as the joints may.
"""


@record
class StopFirst(InParts):
    """A free motion that begins at speed, split into a stop and a motion from rest."""

    kind: ClassVar[str] = "stop first"
    label: ClassVar[str] = "stops first"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if no direct motion was found, or if none is tried."""
        phase = planner.phase
        if phase.path is not None or not phase.qd_start.any():
            return
        failed = latest is not None and latest.failed and latest.candidate.kind == Direct.kind
        if failed if any(Direct.suggested(planner, None)) else latest is None:
            yield cls(planner)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return both motions, joined to one."""
        stop = self._stop()
        if stop is None:
            return Reason(message="no stop within the limits")
        return self._followed(stop, _onward(self.planner.phase, stop), TaskLine, InTurn)

    def _stop(self) -> PhaseSolution | None:
        """Return a stop within the limits after which the target may be reached soonest."""
        robot, phase = self.planner.strict, self.planner.phase
        for share in SHARES:
            stops = [_stop_in_closed_form(robot, phase, share, in_step=k) for k in (False, True)]
            usable = [stop for stop in stops if stop is not None]
            if usable:
                return min(
                    usable, key=lambda stop: stop.duration + _onward(phase, stop).lower_bound
                )
        return None


@record
class DirectByIpopt(Direct):
    """The direct motion by Ipopt, which is slower, after the stop and the motion from rest."""

    kind: ClassVar[str] = "direct by Ipopt"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate after a stop was tried, unless Ipopt has failed already."""
        tried = latest is not None and latest.candidate.kind == StopFirst.kind
        if tried and not (planner.approximate or planner.by_ipopt_alone):
            yield cls(planner)

    def estimate(self, cutoff: float) -> None:
        """Return None, because the solution is as cheap."""

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion."""
        return self.planner.free(cutoff=cutoff, by_ipopt=True)


def _onward(phase: Phase, stop: PhaseSolution) -> Phase:
    """Return the rest of a phase after a stop."""
    end = Trajectory(stop.breaks, stop.coefficients, ()).positions(stop.breaks[-1:])
    points = np.vstack([end, phase.points[1:]])
    if len(points) == 2 and np.abs(np.diff(points, axis=0)).max() <= ROUNDING:
        points[1] = points[0]
    return phase.part(points)


def _stop_in_closed_form(
    robot: Robot, phase: Phase, share: float, *, in_step: bool
) -> PhaseSolution | None:
    """Return the stop by `stopping_curves`, or None if limits forbid it or the way onward."""
    curves = stopping_curves(robot, phase.qd_start, phase.qdd_start, share, in_step=in_step)
    switches = np.unique(np.concatenate([item.switches for item in curves if item is not None]))
    instants = switches[np.append(True, np.diff(switches) > ROUNDING)]
    pieces = guess_of_curves(
        phase.q_start, curves, instants.tolist(), density=0.0, least_count=1
    ).elements
    still = np.zeros_like(pieces.u)
    coefficients = [pieces.u, pieces.v, pieces.a0 / 2, pieces.jerk / 6, still, still]
    motion = Trajectory(instants, np.stack(coefficients, axis=1), ())
    # Joints that rest have a velocity by rounding.
    signs = np.sign(np.round(pieces.evaluate(0.5)[1] / robot.velocities, 9))
    path = MotionPath(phase.mechanism, motion, instants / motion.duration, signs)
    stop = PhaseSolution(
        "solved",
        "",
        breaks=instants,
        coefficients=motion.coefficients,
        border_instants=instants,
        directions=signs,
    )
    places = replace(phase, path=path), _onward(phase, stop)
    kept = keeps_limits(path, robot, phase.problem.task_limits)
    return stop if kept and infeasible_place(places) is None else None


def stopping_point(robot: Robot, q: Array, qd: Array, qdd: Array) -> Array:
    """Return joints (4,) within their ranges at which a robot stops, with q, q̇ and q̈ (4,).

    Joints without jerk limits get some ROOM.
    """
    curves = stopping_curves(robot, qd, qdd)
    way = [0.0 if curve is None else curve.distance for curve in curves]
    rooms = [ROOM if joint.jerk is None else 1.0 for joint in robot.joints]
    low, high = np.array([joint.position for joint in robot.joints]).T
    return np.asarray(np.clip(q + np.multiply(rooms, way), low, high))
