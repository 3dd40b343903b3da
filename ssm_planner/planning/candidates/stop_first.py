"""Motions of a robot that already moves: first a stop, then a motion from rest.

The stop has a closed form, which takes milliseconds without iterations. The motion after it begins
at rest. Solvers find such a motion more often than a direct one, which begins at speed.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ssm_planner.planning.candidates.candidate import PhaseCandidate
from ssm_planner.planning.candidates.in_parts import InParts, InTurn
from ssm_planner.planning.candidates.task_line import TaskLine
from ssm_planner.planning.feasibility import check_places
from ssm_planner.planning.lower_bound import stopping_curves
from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.ocp.segments import sample_curves
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.paths import MotionPath
from ssm_planner.planning.retiming.retime import keeps_limits
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.problem import Robot
from ssm_planner.typing import Array, record

STOP_DISTANCE_FACTOR = 1.1
"""Distance in which joints without jerk limits stop, divided by their shortest distance.

If the target were at the shortest distance, full braking would be the only motion that does not
pass the target. The longer distance leaves the solver a choice, for example if a motor cannot brake
as hard as its joint may.
"""
ACCELERATION_SHARES = (1.0, 0.5, 0.25, 0.1)
"""Shares of the acceleration limits with which the joints brake, tried in this order.

The first share with which the stop keeps all limits is taken. Smaller shares are for weak motors
with heavy rotors, which cannot brake as hard as the limits of the joints allow.
"""


@record
class StopFirst(InParts):
    """A free motion that begins at speed, with a stop first and then a motion from rest.

    It serves if no direct motion was found. The planner chooses the path of a free motion.
    """

    kind: ClassVar[str] = "stop first"
    label: ClassVar[str] = "stops first"

    @classmethod
    def suggested_after_failure(
        cls, planner: PhasePlanner, reason: Reason
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if the path is not given and the motion begins at speed.

        Parameters
        ----------
        planner : PhasePlanner
            The phase (an entry of the motion list with its joint positions) and its solvers.
        reason : Reason
            Reason why the direct motion was not found. It is not used, because this kind may help
            in any case.

        Yields
        ------
        PhaseCandidate
            At most one candidate, that is, one way to move the phase.
        """
        if planner.phase.path is None and planner.phase.qd_start.any():
            yield cls(planner)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Plan the stop and the motion after it, and join them into one motion.

        The motion after the stop may be of any kind that can begin at rest, also a line in task
        coordinates, or one in which some joints move before the others.

        Parameters
        ----------
        cutoff : float
            Duration in s. It is not used, because both parts are always planned completely.
        estimate : PlannedPhase or None
            None, because this kind of candidate (way to move) is solved at once.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why the stop or
            the motion after it failed.
        """
        phase = self.planner.phase
        for share in ACCELERATION_SHARES:
            stop = _stop_in_closed_form(self.planner.strict, phase, share)
            if stop is not None:
                return self._append_part(stop, _remaining_phase(phase, stop), TaskLine, InTurn)
        return Reason(message="no stop within the limits")


def _remaining_phase(phase: Phase, stop: PhaseSolution) -> Phase:
    """Return the part of a phase that follows a stop.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses. It begins at speed.
    stop : PhaseSolution
        Motion in which the robot stops.

    Returns
    -------
    Phase
        Phase that begins at rest where the stop ends, and leads through the remaining points. If
        the stop ends at the only remaining point, the robot rests in this phase.
    """
    end = stop.trajectory.positions(stop.breaks[-1:])
    return phase.from_rest(np.vstack([end, phase.points[1:]]))


def _stop_in_closed_form(robot: Robot, phase: Phase, share: float) -> PhaseSolution | None:
    """Build the motion in which each joint stops as soon as it can, and check its limits.

    Parameters
    ----------
    robot : Robot
        The robot with the limits that the stop must keep.
    phase : Phase
        Entry of the motion list whose path the solver chooses. It begins at speed.
    share : float
        Share of the acceleration limits that the joints use.

    Returns
    -------
    PhaseSolution or None
        The stop. None if a limit forbids the stop itself, or one of the points that follow it.
    """
    curves = stopping_curves(robot, phase.qd_start, phase.qdd_start, share)
    switches = np.unique(
        np.concatenate([curve.switching_times for curve in curves if curve is not None])
    )
    # Instants at which the acceleration of any joint changes, without repetitions by rounding.
    instants = switches[np.append(True, np.diff(switches) > ROUNDING_TOLERANCE)]
    guess = sample_curves(phase.q_start, curves, instants.tolist(), density=0.0, least_count=1)
    motion, middle = guess.motion, guess.elements.evaluate(0.5)
    # Directions of the joints in the middle of each piece. Rounding gives joints at rest a small
    # velocity, which must not count as motion.
    signs = np.sign(np.round(middle[1] / robot.velocities, 9))
    path = MotionPath(phase.mechanism, motion, motion.breaks / motion.duration, signs)
    stop = PhaseSolution(
        "solved",
        "",
        breaks=motion.breaks,
        coefficients=motion.coefficients,
        border_instants=motion.breaks,
        directions=signs,
    )
    parts = replace(phase, path=path), _remaining_phase(phase, stop)
    is_permitted = keeps_limits(path, robot, phase.problem.task_limits)
    return stop if is_permitted and check_places(parts) is None else None


def stopping_point(robot: Robot, q: Array, qd: Array, qdd: Array) -> Array:
    """Return joint positions at which a moving robot can come to rest soon.

    A joint with a jerk limit stops in its shortest distance. The other joints have
    `STOP_DISTANCE_FACTOR` times this distance. Positions outside of the range of a joint are moved
    to its end.

    Parameters
    ----------
    robot : Robot
        The robot.
    q, qd, qdd : (4,) arrays
        Joint positions, velocities and accelerations at the beginning, in rad, rad/s and rad/s²
        (joint 4: m, m/s and m/s²).

    Returns
    -------
    (4,) array
        Joint positions, rad and m.
    """
    curves = stopping_curves(robot, qd, qdd)
    distances = [0.0 if curve is None else curve.distance for curve in curves]
    margins = [STOP_DISTANCE_FACTOR if joint.jerk is None else 1.0 for joint in robot.joints]
    low, high = np.array([joint.position for joint in robot.joints]).T
    return np.asarray(np.clip(q + np.multiply(margins, distances), low, high))
