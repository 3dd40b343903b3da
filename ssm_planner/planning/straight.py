"""From s(t) along a path to joint polynomials."""

from __future__ import annotations

import numpy as np

from ssm_planner.model.trajectory import hermite
from ssm_planner.planning.path import StraightPath
from ssm_planner.planning.straight_ocp import PathMotion
from ssm_planner.problem.values import Array

SUBDIVISION = 4
"""Quintic pieces per element: the path between their ends is then followed to about 1e-9 rad."""


def joint_pieces(
    path: StraightPath, motion: PathMotion, subdivision: int = SUBDIVISION, end_speed: float = 0.0
) -> tuple[Array, Array]:
    """Quintic joint polynomials that follow the path: exact q, q̇, q̈ at both ends of every piece.

    end_speed: ṡ at the end, 1/s. Returns breaks (m + 1,) and coefficients (m, 6, 4).
    """
    elements = motion.elements
    share = np.arange(subdivision) / subdivision
    starts = np.concatenate([[0.0], np.cumsum(elements[:, 4])])
    breaks = np.append((starts[:-1, None] + elements[:, 4:] * share).ravel(), starts[-1])
    ends = [_joint_state(path, elements, share + offset, end_speed) for offset in (0.0, 1.0 / subdivision)]
    return breaks, hermite(breaks, ends[0], ends[1])


def _joint_state(path: StraightPath, elements: Array, share: Array, end_speed: float) -> tuple[Array, Array, Array]:
    """q, q̇, q̈ at the given shares of every element, (n · shares, 4) each."""
    s0, v0, a0, a1, h = (column[:, None] for column in elements.T)
    t = share * h
    rise = a1 - a0
    s = np.clip(s0 + t * (v0 + t * (a0 / 2 + share * rise / 6)), 0.0, 1.0).ravel()
    speed = (v0 + t * (a0 + share * rise / 2)).ravel()[:, None]
    acceleration = (a0 + share * rise).ravel()[:, None]
    if share[-1] == 1.0:  # without the solver's rounding
        s[-1], speed[-1] = 1.0, end_speed
    at = path.sample(s)
    return at.q, at.dq * speed, at.ddq * speed**2 + at.dq * acceleration
