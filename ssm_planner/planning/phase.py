"""One entry of the motion list, placed: task coordinates and joints at both ends."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.problem.problem import Motion
from ssm_planner.typing import Array


@dataclass(frozen=True, eq=False)
class Phase:
    """One entry of the motion list; start and end in task coordinates, (4,)."""

    motion: Motion
    start: Array
    end: Array
    points: Array
    """Joints at the start, at the points passed without stopping, and at the end, (k + 1, 4)."""
    path: StraightPath | None
    """None for a dwell and for a free motion."""
    first_speed: Array = field(default_factory=lambda: np.zeros(4))
    last_speed: Array = field(default_factory=lambda: np.zeros(4))
    """q̇ at both ends, (4,)."""

    @property
    def first(self) -> Array:
        return np.asarray(self.points[0])

    @property
    def last(self) -> Array:
        return np.asarray(self.points[-1])

    @property
    def straight(self) -> StraightPath:
        if self.path is None:
            raise ValueError(f"{self.motion.name} is no straight motion")
        return self.path

    @property
    def branch(self) -> int | None:
        return None if self.path is None else self.path.branch
