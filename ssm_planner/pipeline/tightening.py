"""Stricter limits for the planner where the independent check found a limit exceeded between the planner's points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate, LimitCheck
from ssm_planner.verification.sampled_extremes import CONTINUOUS

TORQUE = 3
ROWS = {"velocity": 0, "motor speed": 0, "acceleration": 1, "jerk": 2, "motor torque": TORQUE}
"""Row of the planner's table of factors, by the name of the limit."""
MOST_HEAT = 0.25
"""Excess of a continuous torque beyond which smaller accelerations would hardly cure it, and take for ever."""
HELPS = 0.5
"""Share of that excess that may remain after a tightening for another one to be tried."""
MORE = 1.5
"""Tightening per excess found."""


@dataclass(frozen=True, eq=False)
class Strictness:
    """What the planner is to keep: factors (4, 4) on the limits of the joints, and the problem with stricter limits."""

    factors: Array
    problem: Problem
    heat: Mapping[str, float] = field(default_factory=dict)
    """Margin of the continuous torque before the last tightening, by joint."""

    @classmethod
    def of(cls, problem: Problem) -> Strictness:
        """The limits as they are."""
        return cls(np.ones((4, len(problem.robot.joints))), problem)

    def more(self, certificate: Certificate) -> Strictness | None:
        """Stricter by what is exceeded; None where nothing that is exceeded can be tightened."""
        factors, problem, held, heat = self.factors.copy(), self.problem, False, dict(self.heat)
        names = [joint.name for joint in problem.robot.joints]
        for limit in certificate.violations:
            if limit.name in ROWS and limit.joint in names:
                factors[ROWS[limit.name], names.index(limit.joint)] *= _factor(limit)
                held = True
                continue
            if limit.name == CONTINUOUS and limit.joint in names and limit.margin > -MOST_HEAT:
                # a smaller peak helps only where acceleration makes the heat; against friction and weight nothing does
                if limit.margin < HELPS * heat.get(limit.joint, -np.inf):
                    return None
                heat[limit.joint] = limit.margin
                i = names.index(limit.joint)
                factors[TORQUE, i] = min(factors[TORQUE, i], _share_of_peak(certificate, limit.joint)) * _factor(limit)
                held = True
                continue
            stricter = _stricter(problem, limit)
            problem, held = stricter or problem, held or stricter is not None
        return Strictness(factors, problem, heat) if held else None


def _stricter(problem: Problem, found: LimitCheck) -> Problem | None:
    """The problem with one limit of the task tightened."""
    for limit in problem.all_limits:
        if limit.key == (found.name, found.joint):
            stricter = limit.tightened(found.worst, found.limit)
            return None if stricter is None else stricter.on(problem)
    return None


def _share_of_peak(certificate: Certificate, joint: str | None) -> float:
    """The largest torque of a motor as a share of what it may give for a short time."""
    peaks = (limit for limit in certificate.limits if (limit.name, limit.joint) == ("motor torque", joint))
    return max((peak.worst / peak.limit for peak in peaks), default=1.0)


def _factor(limit: LimitCheck) -> float:
    """1 + MORE·margin for a small excess, never 0 for a large one: (limit / worst)^MORE."""
    return float((1 - limit.margin) ** -MORE)
