"""One straight phase from path to joint polynomials: TOPP-RA, optimal control, conversion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.model.trajectory import hermite
from ssm_planner.planning.ocp import OcpResult, PathMotion, solve_straight
from ssm_planner.planning.path import StraightPath
from ssm_planner.planning.retiming import Retiming
from ssm_planner.problem.values import Array, Robot

SUBDIVISION = 4
"""Quintic pieces per element: the path between their ends is then followed to about 1e-9 rad."""


@dataclass(frozen=True, eq=False)
class StraightPhase:
    """One planned phase; breaks (m + 1,) from 0 and coefficients (m, 6, 4) as in model/trajectory.py."""

    path: StraightPath
    retiming: Retiming
    ocp: OcpResult
    breaks: Array
    coefficients: Array

    @property
    def duration(self) -> float:
        return float(self.breaks[-1])


def plan_straight(
    robot: Robot, path: StraightPath, retiming: Retiming, tip_speed: float | None = None, tighten: Array | None = None
) -> StraightPhase:
    """Plan one phase along the path from TOPP-RA's motion; arguments as for `solve_straight`."""
    result = solve_straight(robot, path, retiming, tip_speed, tighten)
    breaks, coefficients = joint_pieces(path, result.motion)
    return StraightPhase(path, retiming, result, breaks, coefficients)


def joint_pieces(path: StraightPath, motion: PathMotion, subdivision: int = SUBDIVISION) -> tuple[Array, Array]:
    """Quintic joint polynomials that follow the path: exact q, q̇, q̈ at both ends of every piece.

    Returns breaks (m + 1,) and coefficients (m, 6, 4).
    """
    elements = motion.elements
    share = np.arange(subdivision) / subdivision
    starts = np.concatenate([[0.0], np.cumsum(elements[:, 4])])
    breaks = np.append((starts[:-1, None] + elements[:, 4:] * share).ravel(), starts[-1])
    ends = [_joint_state(path, elements, share + offset) for offset in (0.0, 1.0 / subdivision)]
    return breaks, hermite(breaks, ends[0], ends[1])


def _joint_state(path: StraightPath, elements: Array, share: Array) -> tuple[Array, Array, Array]:
    """q, q̇, q̈ at the given shares of every element, (n · shares, 4) each."""
    s0, v0, a0, a1, h = (column[:, None] for column in elements.T)
    t = share * h
    rise = a1 - a0
    s = np.clip(s0 + t * (v0 + t * (a0 / 2 + share * rise / 6)), 0.0, 1.0).ravel()
    speed = (v0 + t * (a0 + share * rise / 2)).ravel()[:, None]
    acceleration = (a0 + share * rise).ravel()[:, None]
    if share[-1] == 1.0:  # at rest at the end, without the solver's rounding
        s[-1], speed[-1] = 1.0, 0.0
    at = path.sample(s)
    return at.q, at.dq * speed, at.ddq * speed**2 + at.dq * acceleration
