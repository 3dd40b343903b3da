"""How a motion keeps to what is asked of its path, by the tip alone: how it rounds corners, where its speed is constant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ssm_planner.kinematics.forward import tip_position, tool_speed
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.limits import TipSpeed
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

INSTANTS = 4001
"""Of a motion."""
OFF = 1e-7
"""m from its lines beyond which the tip has left them."""
CONSTANT, LOOKS = 1e-6, 8
"""Share by which a constant speed of the tip may be off, and looks in every piece of a motion."""
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


@dataclass(frozen=True)
class ConstantStretch:
    """Of a motion whose tip keeps a speed, but for ramps at its ends."""

    start: float
    end: float
    """s from the start of the motion."""
    error: float
    """Largest share by which the speed is off between these."""

    @property
    def passed(self) -> bool:
        """The speed is constant to CONSTANT."""
        return self.error <= CONSTANT


def constant_stretch(motion: Trajectory, mechanism: Mechanism, speed: float) -> ConstantStretch:
    """Of a motion that is to keep a speed of the tip, m/s: from where it first has it, to where it last does.

    A motion that never has it has no such stretch, and an error of 1.
    """
    share = np.arange(LOOKS) / LOOKS
    t = (motion.breaks[:-1, None] + share * np.diff(motion.breaks)[:, None]).ravel()
    samples = motion.sample(np.append(t, motion.breaks[-1]))
    off = np.abs(tool_speed(TipSpeed, mechanism, samples.q, samples.qd) / speed - 1)
    at_speed = np.flatnonzero(off <= CONSTANT)
    if len(at_speed) < LOOKS:
        return ConstantStretch(0.0, 0.0, 1.0)
    first, last = at_speed[0], at_speed[-1]
    start, end = (float(samples.t[k] - motion.breaks[0]) for k in (first, last))
    return ConstantStretch(start, end, float(off[first : last + 1].max()))
