"""Checks of array arguments: every fault names the argument, its shape and what is needed."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.errors import GeometryError
from ssm_planner.typing import Array

ROTATION_TOLERANCE = 1e-6
"""Largest entry of RᵀR − 1 that still counts as a rotation."""


def batch(name: str, value: ArrayLike, width: int) -> Array:
    """Rows of `width` finite numbers: (n, width), or (width,) as a batch of one."""
    array = _floats(name, value)
    if array.ndim == 1 and array.shape[0] == width:
        array = array[np.newaxis]
    if array.ndim != 2 or array.shape[1] != width:
        hint = f"; it looks transposed: pass {name}.T" if array.ndim == 2 and array.shape[0] == width else ""
        raise GeometryError(f"{name} has shape {array.shape}: must be (n, {width}){hint}")
    finite(name, array)
    return array


def matrices(name: str, value: ArrayLike) -> Array:
    """Matrices (n, 3, 3), or (3, 3) as a batch of one; contiguous, entries not checked."""
    array = _floats(name, value)
    if array.shape == (3, 3):
        array = array[np.newaxis]
    if array.ndim != 3 or array.shape[1:] != (3, 3):
        hint = "; of homogeneous matrices pass [:, :3, :3] and [:, :3, 3]" if array.shape[-2:] == (4, 4) else ""
        raise GeometryError(f"{name} has shape {array.shape}: must be (n, 3, 3){hint}")
    return np.ascontiguousarray(array)


def rotations(name: str, value: ArrayLike) -> Array:
    """Rotation matrices (n, 3, 3), or (3, 3) as a batch of one."""
    array = matrices(name, value)
    finite(name, array)
    fault = np.abs(np.swapaxes(array, 1, 2) @ array - np.eye(3)).max(axis=(1, 2))
    mirrored = np.linalg.det(array) < 0.0
    bad = np.flatnonzero((fault > ROTATION_TOLERANCE / 4.0) | mirrored)
    if bad.size:
        i = int(bad[0])
        what = "its determinant is -1 (a reflection)" if mirrored[i] else f"RᵀR differs from 1 by {fault[i]:.2g}"
        raise GeometryError(f"{name}[{i}] of shape {array.shape} is not a rotation: {what}")
    return array


def finite(name: str, array: Array) -> None:
    """Refuse NaN and infinity in an array of any shape. Raises GeometryError naming the index."""
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise GeometryError(f"{name} of shape {array.shape} is not finite at {list(index)}: {array[index]}")


def _floats(name: str, value: ArrayLike) -> Array:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise GeometryError(f"{name} is not an array of numbers: {error}") from error
