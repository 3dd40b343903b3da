"""Stricter limits for the planner where the independent check found a limit exceeded between the planner's points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem.limits import ContinuousTorque, Limit, MotorTorque
from ssm_planner.problem.problem import Problem
from ssm_planner.verification.certificate import Certificate

MOST_HEAT = 0.25
"""Excess of a continuous torque beyond which smaller accelerations would hardly cure it, and take for ever."""
HELPS = 0.5
"""Share of that excess that may remain after a tightening for another one to be tried."""


@dataclass(frozen=True, eq=False)
class Strictness:
    """A problem with stricter limits, which the planner is to keep."""

    problem: Problem
    heat: Mapping[str | None, float] = field(default_factory=dict)
    """Margin of the continuous torque before the last tightening, by joint."""

    def more(self, certificate: Certificate) -> Strictness | None:
        """Stricter by what is exceeded; None where nothing that is exceeded can be tightened."""
        problem, held, heat = self.problem, False, dict(self.heat)
        for found in certificate.violations:
            limits = {limit.key: limit for limit in problem.all_limits}
            limit = limits.get((found.name, found.joint))
            stricter: Limit | None
            if isinstance(limit, ContinuousTorque) and found.margin > -MOST_HEAT:
                # a smaller peak helps only where acceleration makes the heat; against friction and weight nothing does
                if found.margin < HELPS * heat.get(found.joint, -np.inf):
                    return None
                heat[found.joint] = found.margin
                peak = limits[MotorTorque.name, found.joint]
                assert isinstance(peak, MotorTorque)
                largest = min(peak.largest, _peak(certificate, peak))
                stricter = replace(peak, largest=largest).tightened(found.worst, found.limit)
            else:
                stricter = None if limit is None else limit.tightened(found.worst, found.limit)
            if stricter is not None:
                try:
                    problem, held = stricter.on(problem), True
                except ProblemError:  # a point, or the port of the eye, lies between the two bounds
                    return None
        return Strictness(problem, heat) if held else None


def _peak(certificate: Certificate, limit: MotorTorque) -> float:
    """The largest value that was found of a motor torque."""
    return max((found.worst for found in certificate.limits if (found.name, found.joint) == limit.key), default=np.inf)
