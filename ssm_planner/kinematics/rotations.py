"""Rotations about an axis by Rodrigues' formula, for NumPy batches and CasADi expressions.

Source: Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation, eq. 2.14.
"""

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


def rotation_symbolic(omega: ArrayLike, angle: Any) -> casadi.SX:
    """e^{ω̂θ} (3, 3) for a unit axis (3,) and a CasADi expression θ."""
    import casadi

    still, cosine, sine = (constant(term) for term in exponential_terms(omega))
    return still + casadi.cos(angle) * cosine + casadi.sin(angle) * sine


def constant(value: ArrayLike) -> casadi.DM:
    """A CasADi constant (rows, columns) without its zeros, and without rounding errors in their place."""
    import casadi

    matrix = np.array(value, dtype=float)
    matrix[np.abs(matrix) < 1e-15] = 0.0
    return casadi.sparsify(casadi.DM(matrix))
