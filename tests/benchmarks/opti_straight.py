"""Straight motion in CasADi's Opti: cubic elements of s(t), limits at three points of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from tests.benchmarks.motions import along_path
from tests.benchmarks.peer_rows import LIMITS, straight_rows

POINTS = (0.0, 0.5, 1.0)
TOLERANCE = 1e-8


@dataclass
class OptiStraight:
    """Transcription of the straight motion with all numbers as parameters.

    `solve` can be called again with other numbers. The variables are s, ṡ at the ends of the
    elements, s̈ at both ends of each element, and the duration. All elements have the same length.
    """

    opti: ca.Opti
    x: Any
    a: Any
    time: Any
    parameters: tuple[Any, ...]
    guess: float
    solved: Any = None

    @classmethod
    def build(
        cls, robot: Robot, path: StraightPath, count: int, options: dict[str, Any], guess: float
    ) -> OptiStraight:
        """Build the program. Branch and joint directions of `path` hold for all targets."""
        rows = straight_rows(robot, path.mechanism, path.branch, path.directions[1][0].tolist())
        opti = ca.Opti()
        x, a, time = opti.variable(2, count + 1), opti.variable(2, count), opti.variable()
        start, end, limits = (opti.parameter(n) for n in (4, 4, LIMITS))
        opti.minimize(time)
        h = time / count
        opti.subject_to(x[:, 0] == 0)
        opti.subject_to(x[:, count] == ca.vertcat(1, 0))
        opti.subject_to(opti.bounded(0.01, time, 100))
        opti.subject_to(ca.vec(x[1, :]) >= 0)
        for k in range(count):
            s, v, a0, a1 = x[0, k], x[1, k], a[0, k], a[1, k]
            opti.subject_to(x[0, k + 1] == s + h * v + h**2 * (a0 / 3 + a1 / 6))
            opti.subject_to(x[1, k + 1] == v + h * (a0 + a1) / 2)
            for c in POINTS:
                t, rise = c * h, a1 - a0
                state = (
                    s + t * (v + t * (a0 / 2 + c * rise / 6)),
                    v + t * (a0 + c * rise / 2),
                    a0 + c * rise,
                )
                opti.subject_to(rows(*state, start, end, limits)[0] <= 1)
        opti.subject_to(rows(0, 0, a[0, 0], start, end, limits)[1] <= 1)
        opti.solver(
            "ipopt",
            {"print_time": False, **options.get("casadi", {})},
            ipopt(options.get("ipopt", {})),
        )
        return cls(opti, x, a, time, (start, end, limits), guess)

    def solve(self, start: Array, end: Array, limits: Array) -> tuple[float, int]:
        """Return duration in s and iterations.

        The guess is the last solution, or a line in time before the first solution.
        """
        opti = self.opti
        for parameter, value in zip(self.parameters, (start, end, limits), strict=True):
            opti.set_value(parameter, value)
        if self.solved is None:
            opti.set_initial(self.x[0, :], np.linspace(0, 1, self.x.shape[1]))
            opti.set_initial(self.x[1, :], 1 / self.guess)
            opti.set_initial(self.time, self.guess)
        else:
            opti.set_initial(self.solved.value_variables())
        self.solved = opti.solve()
        return float(self.solved.value(self.time)), int(self.solved.stats()["iter_count"])

    def trajectory(self, path: StraightPath) -> Trajectory:
        """Return the trajectory of the last solution along the path for which it was solved."""
        x, a, time = (np.asarray(self.solved.value(v)) for v in (self.x, self.a, self.time))
        n = a.shape[1]
        return along_path(
            path, np.column_stack([x[0, :n], x[1, :n], a[0], a[1], np.full(n, float(time) / n)])
        )


def ipopt(more: dict[str, Any]) -> dict[str, Any]:
    return {"print_level": 0, "sb": "yes", "tol": TOLERANCE, "max_iter": 1000, **more}
