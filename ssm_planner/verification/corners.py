"""How far a motion departs from the corners of its path, and how far from a corner it does so: by the tip alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

INSTANTS = 4001
"""Of a motion."""
OFF = 1e-7
"""m from its lines beyond which the tip has left them."""
SLACK = 1e-9
"""m by which it may do so farther from a corner than is allowed."""


@dataclass(frozen=True)
class CornerDeparture:
    """Of a motion that rounds its corners; m."""

    departure: float
    """Largest distance of the tip from the lines between the corners."""
    reach: float
    """Largest distance from a corner at which the tip is off these lines, where that is the most of what is allowed there."""
    allowed: float
    """At that corner."""

    @property
    def passed(self) -> bool:
        """The tip leaves its lines no farther from a corner than is allowed."""
        return self.reach <= self.allowed + SLACK


def corner_departure(
    motion: Trajectory, mechanism: Mechanism, lines: Sequence[Array], distances: Sequence[float]
) -> CornerDeparture:
    """Of a motion along the lines, each many tips (n, 3), whose ends are the corners, rounded within these distances, m."""
    from scipy.spatial import cKDTree

    t = np.linspace(motion.breaks[0], motion.breaks[-1], INSTANTS)
    tips = tip_position(mechanism, motion.sample(t).q)
    way = np.vstack([lines[0], *(line[1:] for line in lines[1:])])
    nearest = np.asarray(cKDTree(way).query(tips)[1])
    off = np.full(len(tips), np.inf)
    for first in (np.maximum(nearest - 1, 0), np.minimum(nearest, len(way) - 2)):
        start, along = way[first], way[first + 1] - way[first]
        square = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
        share = np.clip(((tips - start) * along).sum(axis=1) / square, 0.0, 1.0)
        off = np.minimum(off, np.linalg.norm(tips - start - share[:, None] * along, axis=1))
    corners = np.array([line[-1] for line in lines[:-1]])
    away = np.linalg.norm(tips[:, None] - corners, axis=2)
    corner = np.argmin(away / np.array(distances), axis=1)
    own, allowed = away[np.arange(len(tips)), corner], np.array(distances)[corner]
    left = off > OFF
    if not left.any():
        return CornerDeparture(float(off.max()), 0.0, float(min(distances)))
    worst = int(np.argmax(np.where(left, own / allowed, -1.0)))
    return CornerDeparture(float(off.max()), float(own[worst]), float(allowed[worst]))
