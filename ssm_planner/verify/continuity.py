"""Jumps of a trajectory at its breaks."""

from __future__ import annotations

import numpy as np

from ssm_planner.problem.values import Array, Robot
from ssm_planner.verify.certificate import LimitCheck
from ssm_planner.verify.pieces import Pieces

JUMP = 1e-6
"""Largest jump of position (rad, m), or of velocity or acceleration (share of its limit), at a break."""


class Jumps:
    """Worst jumps of position, velocity and acceleration of the four joints, block after block."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.worst = np.zeros((3, 4))
        self.time = np.zeros((3, 4))
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

    def checks(self, straight: bool = False) -> list[LimitCheck]:
        """Joint by joint; of acceleration where the jerk is limited. straight: of position alone."""
        checks = []
        for i, joint in enumerate(self.robot.joints):
            unit = "rad" if joint.kind == "revolute" else "m"
            rows = [("position jump", JUMP, "")]
            if not straight:
                rows.append(("velocity jump", JUMP * joint.velocity, "/s"))
            if not straight and joint.jerk is not None:
                rows.append(("acceleration jump", JUMP * joint.acceleration, "/s²"))
            for order, (name, limit, per) in enumerate(rows):
                worst, time = float(self.worst[order, i]), float(self.time[order, i])
                checks.append(LimitCheck(name, joint.name, worst, limit, (limit - worst) / limit, time, unit + per))
        return checks
