"""Free motion in rockit with the states q and q̇ and the first-order control q̈."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from tests.benchmarks.motions import of_joints
from tests.benchmarks.opti_free import SMOOTHING
from tests.benchmarks.opti_straight import ipopt
from tests.benchmarks.peer_rows import LIMITS, free_rows


@dataclass
class RockitFree:
    """Transcription of the free motion by multiple shooting with all numbers as parameters.

    q̈ is continuous and linear in each interval.
    """

    ocp: Any
    signals: tuple[Any, Any, Any]
    parameters: tuple[Any, ...]
    solved: Any = None

    @classmethod
    def build(cls, robot: Robot, count: int, options: dict[str, Any], guess: float) -> RockitFree:
        import rockit

        rows = free_rows(robot)
        ocp = rockit.Ocp(T=rockit.FreeTime(guess))
        q, qd, qdd = ocp.state(4), ocp.state(4), ocp.control(4, order=1)
        ocp.set_der(q, qd)
        ocp.set_der(qd, qdd)
        first, last, limits, sigma = (ocp.parameter(n) for n in (4, 4, LIMITS, 4))
        acceleration = qdd / limits[4:8]
        ocp.add_objective(ocp.T + SMOOTHING * ocp.integral(ca.sumsqr(acceleration)))
        for at_end, value in ((ocp.at_t0, first), (ocp.at_tf, last)):
            ocp.subject_to(at_end(q) == value)
            ocp.subject_to(at_end(qd) == 0)
        ocp.subject_to((acceleration <= 1) >= -1)
        ocp.subject_to((sigma * qd / limits[:4] <= 1) >= 0)
        torque, breakaway = rows(q, qd, qdd, limits, sigma)
        ocp.subject_to(torque <= 1, grid="integrator")
        ocp.subject_to(ocp.at_t0(breakaway) <= 1)
        ocp.solver(
            "ipopt",
            {
                "print_time": False,
                **options.get("casadi", {}),
                "ipopt": ipopt(options.get("ipopt", {})),
            },
        )
        ocp.method(rockit.MultipleShooting(N=count, M=2, intg="rk"))
        ocp.set_initial(q, first + (last - first) * ocp.t / ocp.T)
        ocp.set_initial(qd, (last - first) / ocp.T)
        return cls(ocp, (q, qd, qdd), (first, last, limits, sigma))

    def solve(self, first: Array, last: Array, limits: Array) -> tuple[float, int]:
        """Return duration in s and iterations. Every solve starts from lines in time."""
        for parameter, value in zip(
            self.parameters, (first, last, limits, np.sign(last - first)), strict=True
        ):
            self.ocp.set_value(parameter, value)
        self.solved = self.ocp.solve()
        return float(self.solved.value(self.ocp.T)), int(self.solved.stats["iter_count"])

    def trajectory(self) -> Trajectory:
        """Return the trajectory of the last solution."""
        q, qd, qdd = (
            np.asarray(self.solved.sample(signal, grid="control")[1]) for signal in self.signals
        )
        n = len(q) - 1
        return of_joints(
            q, qd, qdd[:-1], qdd[1:], np.full(n, float(self.solved.value(self.ocp.T)) / n)
        )
