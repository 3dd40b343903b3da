"""Where along a motion a limit is active."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ssm_planner.problem.values import Array

NEAR = 0.005
"""A limit is active where the value is within this share of it, of a range within half this share of its width."""
GAP = 0.01
"""Stretches nearer to each other than this, s, are one."""


def active_stretches(
    t: Array, values: Array, low: float, high: float, size: float | None = None
) -> Iterator[tuple[float, float, int]]:
    """(start, end, side) of each stretch of values (n,) at a limit; t (n,) in s, side +1 at high and −1 at low.

    size: of the limit, where it is not its value.
    """
    for side, end in ((1, high), (-1, low)):
        if np.isfinite(end):
            near = NEAR * (abs(end) if size is None else size)
            if np.isfinite(low) and np.isfinite(high):
                near = NEAR / 2 * (high - low)
            with np.errstate(invalid="ignore"):
                at = side * (end - values) <= near
            for start, stop in _runs(t, at):
                yield start, stop, side


def _runs(t: Array, at: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Start and end time of each run of true values, those close together joined."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], at.astype(int), [0]))))
    runs: list[tuple[float, float]] = []
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        start, end = float(t[first]), float(t[after - 1])
        if runs and start - runs[-1][1] < GAP:
            start = runs.pop()[0]
        runs.append((start, end))
    return runs
