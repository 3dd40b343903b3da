"""Compute controlled stops from many instants of a motion, with their certificate.

A controlled stop brings all joints to rest with working motors, for example after a stop command.
The module `verification.stops` computes the motions of the stops. This module checks them, and
contains the class of the result.
"""

import numpy as np

from ssm_planner.problem import Robot, TaskLimits
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, JsonObject, record
from ssm_planner.verification import Certificate, StopMotions, check_stops, quickest_stops
from ssm_planner.verification.stops import INSTANTS as INSTANTS

MAX_INSTANTS = 100_000
"""Largest number of instants, whose motions need some gigabytes."""


@record
class Stops:
    """Quickest controlled stops from n instants of a motion, with their certificate.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> stops = ssm.controlled_stops("results/tilt_insert", instants=10)
    >>> stops.time.shape, bool(stops.duration.max() < 1.0)
    ((10,), True)
    """

    time: Array
    """Instants (n,) in s from the start of the motion."""
    duration: Array
    """Time (n,) in s until all joints rest."""
    travel: Array
    """Largest distance (n,) of the tip from its position at the beginning of the stop, m."""
    certificate: Certificate
    """Certificate of all stops together with the limits of the motion itself."""
    _stop_motions: StopMotions
    """Motions of the stops."""

    @property
    def motions(self) -> tuple[Trajectory | None, ...]:
        """Trajectory of the stop from each instant, or None if all joints already rest."""
        return self._stop_motions.motions

    @property
    def passed(self) -> bool:
        """True if every stop keeps every limit."""
        return self.certificate.passed

    def to_dict(self) -> JsonObject:
        """Convert the result to the content of the key `stops` of plan.json.

        Returns
        -------
        dict
            The arrays of all stops, the limits of the certificate, and the stop that takes longest
            ("longest") and the stop in which the tip moves farthest ("farthest"), in SI units.
        """
        slowest_stop = int(np.argmax(self.duration))
        longest_travel = int(np.argmax(self.travel))
        return {
            "passed": self.passed,
            "longest": {
                "time": float(self.time[slowest_stop]),
                "duration": float(self.duration[slowest_stop]),
            },
            "farthest": {
                "time": float(self.time[longest_travel]),
                "travel": float(self.travel[longest_travel]),
            },
            "limits": [limit.to_dict() for limit in self.certificate.limits],
            "time": self.time.tolist(),
            "duration": self.duration.tolist(),
            "travel": self.travel.tolist(),
        }


def controlled_stops(
    motion: Trajectory,
    robot: Robot,
    limits: TaskLimits | None = None,
    instants: int | Array = INSTANTS,
) -> Stops:
    """Compute the quickest stops of a motion from n instants, and check them.

    The stops follow the path of the motion, unless the jerk of a joint is limited. In this case,
    every joint stops by itself.

    Parameters
    ----------
    motion : Trajectory
        Motion that is stopped.
    robot : Robot
        Robot that performs the motion.
    limits : TaskLimits, optional
        Limits of the task. The default is the ranges of the robot.
    instants : int or (n,) array
        Number of instants, or times (s) from the start of the motion at which stops begin.

    Returns
    -------
    Stops
        Durations and travels of the stops, with their certificate.
    """
    limits = TaskLimits(robot.limits) if limits is None else limits
    motions = quickest_stops(motion, robot, instants, limits)
    certificate = check_stops(motions, motion, robot, limits)
    return Stops(motions.time, motions.duration, motions.travel, certificate, motions)
