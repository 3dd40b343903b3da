"""A way to stop from everywhere: from every instant of a motion the quickest controlled stop along its path, certified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check_stops
from ssm_planner.verification.stops import INSTANTS as INSTANTS
from ssm_planner.verification.stops import StopMotions, quickest_stops


@dataclass(frozen=True, eq=False)
class Stops:
    """The quickest controlled stops from n instants of a motion."""

    time: Array
    """(n,), s from the motion's start."""
    duration: Array
    """(n,), s until all joints rest."""
    travel: Array
    """(n,): largest distance of the tip from where it was, m."""
    certificate: Certificate
    """Of all stops together, with the limits of the motion itself."""
    _found: StopMotions
    """What they are made of."""

    @property
    def motions(self) -> tuple[Trajectory | None, ...]:
        """One for each instant; None where all joints rest already."""
        return self._found.motions

    @property
    def passed(self) -> bool:
        """Every stop keeps every limit."""
        return self.certificate.passed

    def to_dict(self) -> dict[str, Any]:
        """`stops` in plan.json; SI."""
        longest, farthest = int(np.argmax(self.duration)), int(np.argmax(self.travel))
        return {
            "passed": self.passed,
            "longest": {
                "time": float(self.time[longest]),
                "duration": float(self.duration[longest]),
            },
            "farthest": {
                "time": float(self.time[farthest]),
                "travel": float(self.travel[farthest]),
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
    """The quickest stop along the path from every one of n instants, or of given times (n,), s from the start."""
    limits = TaskLimits(robot.limits) if limits is None else limits
    found = quickest_stops(motion, robot, instants)
    certificate = check_stops(found, motion, robot, limits)
    return Stops(found.time, found.duration, found.travel, certificate, found)
