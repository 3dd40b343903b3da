"""Jumps of a trajectory at its breaks."""

from __future__ import annotations

import numpy as np

from ssm_planner.problem.values import Array, Robot
from ssm_planner.verify.certificate import LimitCheck
from ssm_planner.verify.pieces import Pieces

JUMP = 1e-6
"""Largest jump of position (rad, m) or velocity (share of its limit) at a break."""


class Jumps:
    """Worst jumps of position and velocity of the four joints, block after block."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.worst = np.zeros((2, 4))
        self.time = np.zeros((2, 4))
        self._last: Array | None = None

    def look(self, pieces: Pieces) -> None:
        starts, ends = pieces.ends
        before, after, time = ends[:, :, :-1], starts[:, :, 1:], pieces.start[1:]
        if self._last is not None:
            before = np.concatenate([self._last[:, :, None], before], axis=2)
            after, time = starts, pieces.start
        self._last = ends[:, :, -1]
        if not len(time):
            return
        jump = np.abs(after - before)
        k = jump.argmax(axis=2)
        largest = np.take_along_axis(jump, k[:, :, None], axis=2)[:, :, 0]
        self.time = np.where(largest > self.worst, time[k], self.time)
        self.worst = np.maximum(largest, self.worst)

    def checks(self, with_velocity: bool = True) -> list[LimitCheck]:
        """Position and velocity jumps, joint by joint."""
        checks = []
        for i, joint in enumerate(self.robot.joints):
            unit = "rad" if joint.kind == "revolute" else "m"
            for k, (name, limit, per) in enumerate(
                (("position jump", JUMP, ""), ("velocity jump", JUMP * joint.velocity, "/s"))
            ):
                if k == 0 or with_velocity:
                    worst, time = float(self.worst[k, i]), float(self.time[k, i])
                    checks.append(LimitCheck(name, joint.name, worst, limit, (limit - worst) / limit, time, unit + per))
        return checks
