"""Largest value between samples, by parabolas."""

from __future__ import annotations

import numpy as np

from ssm_planner.problem.values import Array


def peaks(values: Array) -> Array:
    """Largest value over the last axis (evenly spaced samples, at least 3) of the parabolas through the largest one.

    Returns an array without the last axis; never less than the largest sample.
    """
    last = values.shape[-1] - 1
    best = np.argmax(values, axis=-1)[..., None]
    middle = np.clip(best, 1, last - 1)
    left, here, right = (np.take_along_axis(values, middle + k, axis=-1) for k in (-1, 0, 1))
    slope, bend = (right - left) / 2, right - 2 * here + left
    with np.errstate(divide="ignore", invalid="ignore"):
        where = np.clip(np.nan_to_num(-slope / bend), -1.0, 1.0)
    vertex = here + where * (slope + where * bend / 2)
    return np.maximum(values.max(axis=-1), vertex[..., 0])
