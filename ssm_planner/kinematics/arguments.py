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
        hint = "; split homogeneous matrices with split_homogeneous" if array.shape[-2:] == (4, 4) else ""
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


def split_homogeneous(name: str, value: ArrayLike) -> tuple[Array, Array]:
    """(R (n, 3, 3), p (n, 3)) of homogeneous matrices (n, 4, 4), or (4, 4) as a batch of one."""
    array = _floats(name, value)
    if array.shape == (4, 4):
        array = array[np.newaxis]
    if array.ndim != 3 or array.shape[1:] != (4, 4):
        raise GeometryError(f"{name} has shape {array.shape}: must be (n, 4, 4)")
    finite(name, array)
    last = np.array([0.0, 0.0, 0.0, 1.0])
    bad = np.flatnonzero(np.abs(array[:, 3] - last).max(axis=1) > 1e-12)
    if bad.size:
        columns = np.abs(array[:, :, 3] - last).max() <= 1e-12
        hint = "; it looks transposed" if columns else ""
        row = array[bad[0], 3].tolist()
        raise GeometryError(f"{name}[{bad[0]}] of shape {array.shape}: last row {row}, must be [0, 0, 0, 1]{hint}")
    return rotations(name, array[:, :3, :3]), array[:, :3, 3]


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
