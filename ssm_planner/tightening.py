"""Stricter limits for the planner where the independent check found a limit exceeded between the planner's points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.problem.values import Array, Eye, Problem
from ssm_planner.verify.certificate import Certificate, LimitCheck

ROWS = {"velocity": 0, "motor speed": 0, "acceleration": 1, "jerk": 2, "motor torque": 3}
"""Row of the planner's table of factors, by the name of the limit."""
RATES = {"roll rate": "roll", "tilt rate": "tilt", "spin rate": "spin", "insertion speed": "depth"}
MORE = 1.5
"""Tightening per excess found."""


@dataclass(frozen=True, eq=False)
class Strictness:
    """What the planner is to keep: factors (4, 4) on the limits of the joints, and the problem with stricter limits."""

    factors: Array
    problem: Problem

    @classmethod
    def of(cls, problem: Problem) -> Strictness:
        """The limits as they are."""
        return cls(np.ones((4, len(problem.robot.joints))), problem)

    def more(self, certificate: Certificate) -> Strictness | None:
        """Stricter by what is exceeded; None where nothing that is exceeded can be tightened."""
        factors, problem, held = self.factors.copy(), self.problem, False
        names = [joint.name for joint in problem.robot.joints]
        for limit in certificate.violations:
            if limit.name in ROWS and limit.joint in names:
                factors[ROWS[limit.name], names.index(limit.joint)] *= _factor(limit)
                held = True
                continue
            stricter = _stricter(problem, limit)
            problem, held = stricter or problem, held or stricter is not None
        return Strictness(factors, problem) if held else None


def _stricter(problem: Problem, limit: LimitCheck) -> Problem | None:
    """The problem with one limit of the task tightened."""
    if limit.name in RATES and RATES[limit.name] in problem.rates:
        name = RATES[limit.name]
        return replace(problem, rates={**problem.rates, name: problem.rates[name] * _factor(limit)})
    if limit.name == "tip speed" and problem.tip_speed is not None:
        return replace(problem, tip_speed=problem.tip_speed * _factor(limit))
    eye = problem.eye
    if limit.name == "retina clearance" and eye is not None:
        return replace(problem, eye=replace(eye, clearance=eye.clearance + MORE * (limit.limit - limit.worst)))
    if limit.name == "lens clearance" and eye is not None and eye.lens is not None:
        return replace(problem, eye=_thicker(eye, MORE * (limit.limit - limit.worst)))
    name = limit.name.removesuffix(" range")
    if name in ("roll", "spin") and name in problem.limits:
        low, high = problem.limits[name]
        inwards = MORE * abs(limit.worst - limit.limit)
        narrow = (low, high - inwards) if limit.worst > high else (low + inwards, high)
        return replace(problem, limits={**problem.limits, name: narrow})
    return None


def _thicker(eye: Eye, ratio: float) -> Eye:
    """An eye whose lens asks for a ratio larger by this much."""
    assert eye.lens is not None
    return replace(eye, shaft_radius=eye.shaft_radius + ratio * float(np.min(eye.lens.semi_axes)))


def _factor(limit: LimitCheck) -> float:
    return 1 + MORE * limit.margin
