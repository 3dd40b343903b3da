"""Straight motion in rockit with the states s and ṡ and the first-order control s̈."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from tests.benchmarks.motions import along_path
from tests.benchmarks.opti_straight import ipopt
from tests.benchmarks.peer_rows import LIMITS, straight_rows


@dataclass
class RockitStraight:
    """Transcription of the straight motion by multiple shooting with all numbers as parameters.

    s̈ is continuous and linear in each interval.
    """

    ocp: Any
    signals: tuple[Any, Any, Any]
    parameters: tuple[Any, ...]
    solved: Any = None

    @classmethod
    def build(
        cls, robot: Robot, path: StraightPath, count: int, options: dict[str, Any], guess: float
    ) -> RockitStraight:
        """Build the program. Branch and joint directions of `path` hold for all targets."""
        import rockit

        rows = straight_rows(robot, path.mechanism, path.branch, path.directions[1][0].tolist())
        ocp = rockit.Ocp(T=rockit.FreeTime(guess))
        s, speed, acceleration = ocp.state(), ocp.state(), ocp.control(order=1)
        ocp.set_der(s, speed)
        ocp.set_der(speed, acceleration)
        start, end, limits = (ocp.parameter(n) for n in (4, 4, LIMITS))
        ocp.add_objective(ocp.T)
        for at_end, value in ((ocp.at_t0, 0), (ocp.at_tf, 1)):
            ocp.subject_to(at_end(s) == value)
            ocp.subject_to(at_end(speed) == 0)
        ocp.subject_to(speed >= 0)
        usage, breakaway = rows(s, speed, acceleration, start, end, limits)
        ocp.subject_to(usage <= 1, grid="integrator")
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
        ocp.set_initial(s, ocp.t / ocp.T)
        ocp.set_initial(speed, 1 / ocp.T)
        return cls(ocp, (s, speed, acceleration), (start, end, limits))

    def solve(self, start: Array, end: Array, limits: Array) -> tuple[float, int]:
        """Return duration in s and iterations.

        Every solve starts from a line in time, because setting samples of a solution costs rockit
        more.
        """
        for parameter, value in zip(self.parameters, (start, end, limits), strict=True):
            self.ocp.set_value(parameter, value)
        self.solved = self.ocp.solve()
        return float(self.solved.value(self.ocp.T)), int(self.solved.stats["iter_count"])

    def trajectory(self, path: StraightPath) -> Trajectory:
        """Return the trajectory of the last solution along the path for which it was solved."""
        s, v, a = (
            np.asarray(self.solved.sample(signal, grid="control")[1]) for signal in self.signals
        )
        h = np.full(len(s) - 1, float(self.solved.value(self.ocp.T)) / (len(s) - 1))
        return along_path(path, np.column_stack([s[:-1], v[:-1], a[:-1], a[1:], h]))
