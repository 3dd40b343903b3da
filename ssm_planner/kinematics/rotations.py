"""Rotations and twists (v, omega) of Murray, Li and Sastry."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.typing import Array

if TYPE_CHECKING:
    import casadi


def hat(omega: ArrayLike) -> Array:
    """The matrix of ω × ·; (..., 3) to (..., 3, 3)."""
    omega = np.asarray(omega, dtype=float)
    x, y, z = omega[..., 0], omega[..., 1], omega[..., 2]
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def exponential_terms(omega: ArrayLike) -> Array:
    """E with e^{ω̂θ} = E[0] + cos θ E[1] + sin θ E[2] for a unit ω (Rodrigues); (3,) to (3, 3, 3)."""
    omega = np.asarray(omega, dtype=float)
    along = np.outer(omega, omega)
    return np.stack((along, np.eye(3) - along, hat(omega)))


def rotation(omega: ArrayLike, angle: ArrayLike) -> Array:
    """e^{ω̂θ} for one unit axis (3,) and angles of any shape (...); returns (..., 3, 3)."""
    angle = np.asarray(angle, dtype=float)
    monomials = np.stack((np.ones_like(angle), np.cos(angle), np.sin(angle)), axis=-1)
    return np.tensordot(monomials, exponential_terms(omega), axes=1)


def rotation_angle(rotations: ArrayLike) -> Array:
    """Angle of rotations (..., 3, 3), in [0, π] and accurate at both ends; returns (...)."""
    matrix = np.asarray(rotations, dtype=float)
    skew = matrix - np.swapaxes(matrix, -1, -2)
    sine = np.sqrt(skew[..., 2, 1] ** 2 + skew[..., 0, 2] ** 2 + skew[..., 1, 0] ** 2)
    angle: Array = np.arctan2(sine, np.trace(matrix, axis1=-2, axis2=-1) - 1.0)
    return angle


def adjoint(rotations: ArrayLike, positions: ArrayLike) -> Array:
    """Ad_g of g = (R, p) on twists (v, omega): (..., 3, 3) and (..., 3) to (..., 6, 6)."""
    rotations = np.asarray(rotations, dtype=float)
    out = np.zeros((*rotations.shape[:-2], 6, 6))
    out[..., :3, :3] = rotations
    out[..., 3:, 3:] = rotations
    out[..., :3, 3:] = hat(positions) @ rotations
    return out


def rotation_symbolic(omega: ArrayLike, angle: Any) -> casadi.SX:
    """e^{ω̂θ} (3, 3) for a unit axis (3,) and a CasADi expression θ."""
    import casadi

    still, cosine, sine = (constant(term) for term in exponential_terms(omega))
    return still + casadi.cos(angle) * cosine + casadi.sin(angle) * sine


def constant(value: ArrayLike) -> casadi.DM:
    """A CasADi constant without its zeros, and without rounding errors in their place."""
    import casadi

    matrix = np.array(value, dtype=float)
    matrix[np.abs(matrix) < 1e-15] = 0.0
    return casadi.sparsify(casadi.DM(matrix))
