"""Motions that begin at speed: a stop in closed form, then a motion from rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import PhaseCandidate, PhaseEvaluation
from ssm_planner.planning.candidates.detour import Detour
from ssm_planner.planning.candidates.direct import Direct
from ssm_planner.planning.candidates.task_line import TaskLine
from ssm_planner.planning.feasibility import infeasible_place
from ssm_planner.planning.lower_bound import stopping_curves
from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.ocp.segments import guess_of_curves
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase, standing
from ssm_planner.planning.reason import Reason, duration_too_short
from ssm_planner.planning.retiming.paths import MotionPath
from ssm_planner.planning.retiming.retime import keeps_limits
from ssm_planner.planning.search import find_fastest
from ssm_planner.planning.tolerances import ROUNDING, SAME
from ssm_planner.problem import Robot, unchecked
from ssm_planner.trajectory import Trajectory, join
from ssm_planner.typing import Array, record

ROOM = 1.1
"""Distance that joints without jerk limits get to stop, divided by their braking distance."""
SHARES = (1.0, 0.5, 0.25)
"""Shares of their accelerations with which joints stop, tried in turn."""


@record
class StopFirst(PhaseCandidate):
    """A free motion that begins at speed, split into a stop and a motion from rest."""

    kind: ClassVar[str] = "stop first"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if a stop ends at the target, or if no direct motion was found."""
        phase = planner.phase
        if phase.path is not None or not phase.qd_start.any():
            return
        robot = phase.problem.robot
        stop = stopping_point(robot, phase.q_start, phase.qd_start, phase.qdd_start, room=1.0)
        suffices = len(phase.points) == 2 and np.abs(phase.points[1] - stop).max() <= ROUNDING
        failed = latest is not None and latest.failed and latest.candidate.kind == Direct.kind
        without_direct = next(Direct.suggested(planner, None), None) is None
        if (latest is None) if suffices or without_direct else failed:
            yield cls(planner)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return both motions, joined to one. Its name ends in "stops first"."""
        phase = self.planner.phase
        stop = self._stop()
        if isinstance(stop, Reason):
            return stop
        onward = _onward(phase, stop)
        result = standing(onward) if onward.stands else self._fastest(onward, TaskLine)
        if isinstance(result, Reason):
            return result
        resumed, duration = result.motion, phase.motion.duration
        if duration is not None:
            needed = stop.duration + resumed.duration
            if needed > duration * (1 + SAME) or not resumed.duration or phase.qd_end.any():
                return duration_too_short(phase.motion.name, duration, needed)
            resumed = resumed.slower((duration - stop.duration) / resumed.duration)
        trajectory = join([("", motion.breaks, motion.coefficients) for motion in (stop, resumed)])
        motion = replace(
            resumed,
            breaks=trajectory.breaks,
            coefficients=trajectory.coefficients,
            border_instants=np.append(
                stop.border_instants, stop.duration + resumed.border_instants[1:]
            ),
            directions=np.vstack([stop.directions, resumed.directions]),
        )
        name = f"{phase.motion.name}, stops first"
        labelled = replace(phase, motion=replace(phase.motion, name=name))
        return PlannedPhase(labelled, motion, phase.lower_bound)

    def _stop(self) -> PhaseSolution | Reason:
        """Return a stop in closed form, or one that a solver finds if limits forbid the former."""
        robot, phase = self.planner.strict, self.planner.phase
        for share in SHARES:
            stops = [_stop_in_closed_form(robot, phase, share, in_step=k) for k in (False, True)]
            usable = [stop for stop in stops if stop is not None]
            if usable:
                return min(
                    usable, key=lambda stop: stop.duration + _onward(phase, stop).lower_bound
                )
        end = stopping_point(robot, phase.q_start, phase.qd_start, phase.qdd_start)
        stopping = replace(phase, points=np.stack([phase.q_start, end]), qd_end=np.zeros(4))
        result = infeasible_place((stopping,)) or self._fastest(stopping)
        return result if isinstance(result, Reason) else result.motion

    def _fastest(self, phase: Phase, *others: type[PhaseCandidate]) -> PlannedPhase | Reason:
        """Return the fastest motion of a part of the phase, without a requested duration."""
        kinds: list[type[PhaseCandidate]] = [Direct, Detour, *others]
        untimed = replace(phase, motion=unchecked(phase.motion, duration=None))
        return find_fastest(kinds, replace(self.planner, phase=untimed), self.planner.work)[0]


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
    at_rest = np.zeros(4)
    return replace(phase, points=points, qd_start=at_rest, qdd_start=at_rest)


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
    middle = pieces.evaluate(0.5)[1]
    moves = np.abs(middle) > ROUNDING * robot.velocities
    signs = np.where(moves, np.sign(middle), 0.0)
    path = MotionPath(phase.mechanism, motion, instants / motion.duration, signs)
    stop = PhaseSolution("solved", "", 0, motion.breaks, motion.coefficients)
    stop = replace(stop, border_instants=instants, directions=signs)
    places = replace(phase, path=path), _onward(phase, stop)
    kept = keeps_limits(path, robot, phase.problem.task_limits)
    return stop if kept and infeasible_place(places) is None else None


def stopping_point(robot: Robot, q: Array, qd: Array, qdd: Array, room: float = ROOM) -> Array:
    """Return joints (4,) within their ranges at which a robot stops, with q, q̇ and q̈ (4,).

    `room` multiplies the distances of the quickest stops of joints without jerk limits.
    """
    curves = stopping_curves(robot, qd, qdd)
    way = [0.0 if curve is None else curve.distance for curve in curves]
    rooms = [room if joint.jerk is None else 1.0 for joint in robot.joints]
    low, high = np.array([joint.position for joint in robot.joints]).T
    return np.asarray(np.clip(q + np.multiply(rooms, way), low, high))
