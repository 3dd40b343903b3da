"""Points of a map that stand apart from their neighbours, found without assuming any friction law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssm_planner.typing import Array

BEYOND = 5.0
"""Robust standard deviations between a point and its neighbours' line that make it an outlier."""

LEAST = 0.005
"""Least deviation assumed, as a share of the torque range: what a bend of the map looks like between its points."""

_KEEP = 3.0
_FEWEST = 5


@dataclass(frozen=True)
class Outlier:
    index: int
    distance: float
    """Measured torque − torque on the line through its neighbours, N·m."""
    weight: float
    """Factor of its residual in a fit, < 1."""


def find_outliers(w: Array, tau: Array) -> list[Outlier]:
    """Isolated points of a torque–velocity map sorted by speed (points,).

    Every point is compared with the line through its two nearest neighbours of the same direction. A law that fits
    badly makes no outliers, since neighbours then deviate alike. Fewer than five points in a direction show nothing.
    """
    left = np.ones(len(w), dtype=bool)
    found: list[Outlier] = []
    for _ in range(len(w) // 4):
        score, distance, deviation = _scores(w, tau, left)
        worst = int(np.argmax(np.abs(score)))
        if not np.abs(score[worst]) > BEYOND:
            break
        left[worst] = False
        weight = _KEEP * deviation / max(abs(distance[worst]), 1e-300)
        found.append(Outlier(worst, float(distance[worst]), float(min(1.0, weight))))
    return sorted(found, key=lambda outlier: outlier.index)


def _scores(w: Array, tau: Array, left: Array) -> tuple[Array, Array, float]:
    """Distance of every point left from its neighbours' line, over its expected deviation; and torque deviation."""
    distance, spread = np.full(len(w), np.nan), np.ones(len(w))
    for sign in (-1.0, 1.0):
        side = np.flatnonzero(left & (np.sign(w) == sign))
        if len(side) < _FEWEST:
            continue
        for place, k in enumerate(side):
            a, b = _neighbours(side, place)
            share = 0.5 if w[a] == w[b] else (w[k] - w[a]) / (w[b] - w[a])
            distance[k] = tau[k] - (1 - share) * tau[a] - share * tau[b]
            spread[k] = np.sqrt(1.0 + (1 - share) ** 2 + share**2)
    known = np.isfinite(distance)
    if not known.any():
        return np.zeros(len(w)), np.zeros(len(w)), 0.0
    deviation = 1.4826 * float(np.median(np.abs(distance[known] / spread[known])))
    deviation = max(deviation, LEAST * float(np.ptp(tau)), 1e-300)
    score = np.where(known, distance / (spread * deviation), 0.0)
    return score, np.where(known, distance, 0.0), deviation


def _neighbours(side: NDArray[np.intp], place: int) -> tuple[int, int]:
    if place == 0:
        return int(side[1]), int(side[2])
    if place == len(side) - 1:
        return int(side[-3]), int(side[-2])
    return int(side[place - 1]), int(side[place + 1])
