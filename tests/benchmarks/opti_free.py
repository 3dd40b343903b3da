"""Free motion in CasADi's Opti: cubic elements of all joints, torque rows at three points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from tests.benchmarks.motions import of_joints
from tests.benchmarks.opti_straight import POINTS, ipopt
from tests.benchmarks.peer_rows import LIMITS, free_rows

SMOOTHING = 1e-6
"""Weight of the accelerations relative to their limits.

Without it, joints that do not limit the duration are undetermined.
"""


@dataclass
class OptiFree:
    """Transcription of the free motion with all numbers as parameters.

    Every joint moves in one direction only, so the friction law is exact. The variables are q, q̇
    at the ends of the elements, q̈ at both ends of each element, and the duration. All elements
    have the same length.
    """

    opti: ca.Opti
    x: Any
    a: Any
    time: Any
    parameters: tuple[Any, ...]
    guess: float
    solved: Any = None

    @classmethod
    def build(cls, robot: Robot, count: int, options: dict[str, Any], guess: float) -> OptiFree:
        rows = free_rows(robot)
        opti = ca.Opti()
        x, a, time = opti.variable(8, count + 1), opti.variable(8, count), opti.variable()
        first, last, limits, sigma = (opti.parameter(n) for n in (4, 4, LIMITS, 4))
        h = time / count
        speed, acceleration = limits[:4], limits[4:8]
        opti.subject_to(x[:, 0] == ca.vertcat(first, ca.DM.zeros(4)))
        opti.subject_to(x[:, count] == ca.vertcat(last, ca.DM.zeros(4)))
        opti.subject_to(opti.bounded(0.01, time, 100))
        effort = 0
        for k in range(count):
            q, v, a0, a1 = x[:4, k], x[4:, k], a[:4, k], a[4:, k]
            opti.subject_to(x[:4, k + 1] == q + h * v + h**2 * (a0 / 3 + a1 / 6))
            opti.subject_to(x[4:, k + 1] == v + h * (a0 + a1) / 2)
            for value in (a0, a1):
                opti.subject_to(opti.bounded(-1, value / acceleration, 1))
                effort += h * ca.sumsqr(value / acceleration)
            for c in POINTS:
                t, rise = c * h, a1 - a0
                state = (
                    q + t * (v + t * (a0 / 2 + c * rise / 6)),
                    v + t * (a0 + c * rise / 2),
                    a0 + c * rise,
                )
                opti.subject_to(opti.bounded(0, sigma * state[1] / speed, 1))
                opti.subject_to(rows(*state, limits, sigma)[0] <= 1)
        opti.subject_to(rows(x[:4, 0], x[4:, 0], a[:4, 0], limits, sigma)[1] <= 1)
        opti.minimize(time + SMOOTHING * effort)
        opti.solver(
            "ipopt",
            {"print_time": False, **options.get("casadi", {})},
            ipopt(options.get("ipopt", {})),
        )
        return cls(opti, x, a, time, (first, last, limits, sigma), guess)

    def solve(self, first: Array, last: Array, limits: Array) -> tuple[float, int]:
        """Return duration in s and iterations.

        The guess is the last solution, or a line in time before the first solution.
        """
        opti = self.opti
        for parameter, value in zip(
            self.parameters, (first, last, limits, np.sign(last - first)), strict=True
        ):
            opti.set_value(parameter, value)
        if self.solved is None:
            share = np.linspace(0, 1, self.x.shape[1])
            opti.set_initial(self.x[:4, :], first[:, None] + share * (last - first)[:, None])
            opti.set_initial(
                self.x[4:, :], np.tile((last - first)[:, None] / self.guess, len(share))
            )
            opti.set_initial(self.time, self.guess)
        else:
            opti.set_initial(self.solved.value_variables())
        self.solved = opti.solve()
        return float(self.solved.value(self.time)), int(self.solved.stats()["iter_count"])

    def trajectory(self) -> Trajectory:
        """Return the trajectory of the last solution."""
        x, a = (np.asarray(self.solved.value(v)).T for v in (self.x, self.a))
        return of_joints(
            x[:, :4],
            x[:, 4:],
            a[:, :4],
            a[:, 4:],
            np.full(len(a), self.solved.value(self.time) / len(a)),
        )
