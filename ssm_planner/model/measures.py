"""Measures along the workspace: distance to the boundary, singular value, joint speed that a tilt speed needs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssm_planner.errors import GeometryError
from ssm_planner.model.forward import space_jacobian
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.namespace import NUMPY
from ssm_planner.model.triangle import elbow_squares
from ssm_planner.model.workspace import check_branch, tilt_magnitudes

Array = NDArray[np.float64]


def boundary_distance(mechanism: Mechanism, tilt: ArrayLike) -> Array:
    """Angle, rad, from tilts of any shape to the nearer end of the workspace; negative outside."""
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    magnitude = np.abs(_tilts(tilt))
    distance: Array = np.minimum(magnitude - low, high - magnitude)
    return distance


def smallest_singular_value(mechanism: Mechanism, q: ArrayLike) -> Array:
    """σ_min (n,) of the angular part of the space Jacobian, its columns the three revolute axes; q (n, 4).

    Without unit; 0 at the workspace boundary, where the axes lie in one plane. It depends on θ2 alone.
    """
    values = np.linalg.svd(space_jacobian(mechanism, q)[:, 3:, :3], compute_uv=False)
    return np.asarray(values[:, 2], dtype=float)


def joint_speed_per_tilt_speed(mechanism: Mechanism, tilt: ArrayLike, branch: int) -> Array:
    """(dθ1/dφ, dθ2/dφ, dθ3/dφ) at constant roll and spin; tilts (...) to (..., 3).

    With x = θ2 − δ and P, E of triangle.py:
    dθ2/dφ = sin φ / (sin α sin β sin x),  dθ1/dφ = E / (sin α sin x sin φ),  dθ3/dφ = −P / (sin β sin x sin φ),
    for the |φ| of the home side. Infinite at the workspace boundary, NaN outside.
    """
    alpha, beta = mechanism.alpha, mechanism.beta
    tilts = _tilts(tilt)
    half = np.abs(tilts) / 2.0
    c2, s2 = elbow_squares(NUMPY, alpha, beta, np.cos(half), np.sin(half))
    # at a tilt that is the end of the interval, rounding must not decide between infinite and outside
    c2, s2 = (np.where((part < 0.0) & (part > -1e-15), 0.0, part) for part in (c2, s2))
    with np.errstate(divide="ignore", invalid="ignore"):
        product = math.sin(alpha) * math.sin(beta)
        sin_x = check_branch(branch) * 2.0 * np.sqrt(c2 * s2) / product
        sin_x = np.where((c2 < 0.0) | (s2 < 0.0), np.nan, sin_x)
        on_t = (math.sin(alpha - beta) * c2 + math.sin(alpha + beta) * s2) / product
        toward = (math.sin(alpha - beta) * c2 - math.sin(alpha + beta) * s2) / product
        sine = np.sin(np.abs(tilts))
        first = toward / (math.sin(alpha) * sin_x * sine)
        second = sine / (product * sin_x)
        third = -on_t / (math.sin(beta) * sin_x * sine)
    side = np.where(tilts < 0.0, -1.0, 1.0)
    speeds: Array = np.stack((first, second, third), axis=-1) * side[..., np.newaxis]
    return speeds


def _tilts(value: ArrayLike) -> Array:
    tilts = np.asarray(value, dtype=float)
    if not np.all(np.abs(tilts) <= math.pi + 1e-9):
        raise GeometryError(f"tilt of shape {tilts.shape}: must be finite and in [-pi, pi] rad, not degrees")
    return tilts
