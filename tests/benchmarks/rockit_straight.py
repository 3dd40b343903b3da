"""The straight motion written in rockit: ṡ and s̈ as states and control, limits on the integrator's grid."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.problem.values import Array, Robot

from opti_straight import ipopt
from peer_rows import LIMITS, straight_rows


@dataclass
class RockitStraight:
    """One transcription by multiple shooting, all numbers being parameters. s̈ is constant in each interval."""

    ocp: Any
    signals: tuple[Any, Any, Any]
    start: Any
    end: Any
    limits: Any
    solved: Any = None

    @classmethod
    def build(
        cls, robot: Robot, mechanism: Mechanism, branch: int, sigma: Array, count: int, options: dict[str, Any]
    ) -> RockitStraight:
        import rockit

        rows = straight_rows(robot, mechanism, branch, sigma.tolist())
        ocp = rockit.Ocp(T=rockit.FreeTime(2.0))
        s, speed = ocp.state(), ocp.state()
        acceleration = ocp.control(order=options.get("order", 0))
        ocp.set_der(s, speed)
        ocp.set_der(speed, acceleration)
        start, end, limits = ocp.parameter(4), ocp.parameter(4), ocp.parameter(LIMITS)
        ocp.add_objective(ocp.T)
        ocp.subject_to(ocp.at_t0(s) == 0)
        ocp.subject_to(ocp.at_t0(speed) == 0)
        ocp.subject_to(ocp.at_tf(s) == 1)
        ocp.subject_to(ocp.at_tf(speed) == 0)
        ocp.subject_to(speed >= 0)
        here, breakaway = rows(s, speed, acceleration, start, end, limits)
        ocp.subject_to(here <= 1, grid="integrator")
        ocp.subject_to(ocp.at_t0(breakaway) <= 1)
        ocp.solver("ipopt", {"print_time": False, **options.get("casadi", {}), "ipopt": ipopt(options.get("ipopt", {}))})
        ocp.method(rockit.MultipleShooting(N=count, M=2, intg="rk"))
        ocp.set_initial(s, ocp.t / ocp.T)
        ocp.set_initial(speed, 1 / ocp.T)
        return cls(ocp, (s, speed, acceleration), start, end, limits)

    def solve(self, start: Array, end: Array, limits: Array, guess: float) -> tuple[float, int, str]:
        """Duration, iterations and Ipopt's word; from the last solution, else from a line in time."""
        ocp = self.ocp
        for parameter, value in ((self.start, start), (self.end, end), (self.limits, limits)):
            ocp.set_value(parameter, value)
        if self.solved is None:
            ocp.set_initial(ocp.T, guess)
        else:
            for signal in self.signals:
                ocp.set_initial(signal, self.solved.sample(signal, grid="control")[1])
            ocp.set_initial(ocp.T, float(self.solved.value(ocp.T)))
        self.solved = ocp.solve()
        stats = self.solved.stats
        return float(self.solved.value(ocp.T)), int(stats["iter_count"]), str(stats["return_status"])
