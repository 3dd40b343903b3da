"""The paper's Table I: theoretical and measured tilt range, recomputed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.workspace import tilt_interval

MEASURED = (math.radians(-138.6), math.radians(-79.5))
"""The tilt interval measured on the prototype (paper, Table I)."""
PAPER = (math.radians(-140.0), math.radians(-80.0))
"""The theoretical interval as the paper prints it, with β rounded to 110°."""


@dataclass(frozen=True)
class TiltRow:
    """One row of the table; rad."""

    name: str
    theoretical: float
    measured: float
    paper: float
    """The theoretical value that the paper prints."""

    @property
    def agreement(self) -> float:
        """1 − |theoretical − measured| / |theoretical|."""
        return 1.0 - abs(self.theoretical - self.measured) / abs(self.theoretical)


def tilt_table(mechanism: Mechanism, measured: tuple[float, float] = MEASURED) -> tuple[TiltRow, TiltRow, TiltRow]:
    """Rows of extent, lower and upper end of the tilt range of a mechanism beside a measured interval, rad."""
    low, high = tilt_interval(mechanism)
    return (
        TiltRow("tilt range", high - low, measured[1] - measured[0], PAPER[1] - PAPER[0]),
        TiltRow("lower end", low, measured[0], PAPER[0]),
        TiltRow("upper end", high, measured[1], PAPER[1]),
    )
