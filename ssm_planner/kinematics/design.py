"""The design question in closed form: which (α, β) reach a tilt range?

|φ| runs from |α − β| to α + β, folded at π (paper, eq. 9). So a range with a = min |φ| and b = max |φ| is reached by
all (α, β) with |α − β| ≤ a and b ≤ α + β ≤ 2π − b: a rectangle whose sides are at 45° to the α and β axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.workspace import magnitude_range, tilt_magnitudes
from ssm_planner.typing import Array

ROUNDING = 1e-12
"""rad by which a corner of a region may fall outside it."""


@dataclass(frozen=True, eq=False)
class DesignRegion:
    """All (α, β) whose workspace holds a tilt range with a margin; rad."""

    tilt_range: tuple[float, float]
    margin: float
    vertices: Array
    """(4, 2): corners (α, β) in order, the smallest α first; (0, 2) where nothing reaches the range."""

    @property
    def empty(self) -> bool:
        """Nothing reaches the range with the margin."""
        return len(self.vertices) == 0

    @property
    def smallest_alpha(self) -> tuple[float, float]:
        """The (α, β) of smallest α, the most compact; (nan, nan) if the region is empty."""
        return (math.nan, math.nan) if self.empty else (float(self.vertices[0, 0]), float(self.vertices[0, 1]))

    def contains(self, alpha: float, beta: float) -> bool:
        """Does (α, β) reach the range with the margin?"""
        return design_margin(alpha, beta, self.tilt_range) >= self.margin - ROUNDING


def design_region(tilt_low: float, tilt_high: float, margin: float = 0.0) -> DesignRegion:
    """All (α, β) that reach the signed tilts [tilt_low, tilt_high], rad, with `margin` rad beyond either end.

    The corner of smallest α is ((b − a)/2 + margin, (a + b)/2): (30°, 110°) for (−140°, −80°). A range that passes
    through φ = 0 needs α = β. Without margin that corner has the ends of the range on the workspace boundary, where
    joint speed is unbounded: a design to be built needs a margin.
    """
    low, high = magnitude_range("tilt range", (tilt_low, tilt_high))
    if not 0.0 <= margin <= math.pi:
        raise GeometryError(f"margin = {margin!r}: must be in [0, pi] rad")
    difference, least = low - margin, high + margin
    if difference < 0.0 or least > math.pi:
        return DesignRegion((tilt_low, tilt_high), margin, np.empty((0, 2)))
    most = 2.0 * math.pi - least
    corners = ((least, -difference), (least, difference), (most, difference), (most, -difference))
    vertices = np.array([((total + gap) / 2.0, (total - gap) / 2.0) for total, gap in corners])
    return DesignRegion((tilt_low, tilt_high), margin, vertices)


def design_margin(alpha: float, beta: float, tilt_range: tuple[float, float]) -> float:
    """Tilt, rad, by which the workspace of (α, β) goes beyond both ends of a range; negative: not reached."""
    for name, angle in (("alpha", alpha), ("beta", beta)):
        if not 0.0 <= angle <= math.pi:
            raise GeometryError(f"{name} = {angle!r}: an angle between axes, in [0, pi] rad; degrees are not meant")
    low, high = magnitude_range("tilt_range", tilt_range)
    nearest, farthest = tilt_magnitudes(alpha, beta)
    return min(low - nearest, farthest - high)
