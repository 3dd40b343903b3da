"""Paden–Kahan subproblems for arbitrary axes, the reference for the inverse kinematics.

All axes pass through the origin. The functions take vectors (..., 3) that broadcast. They return
least-squares solutions where no exact solution exists. Half-angle forms keep them exact where the
triangle of the axes degenerates.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.mechanism import elbow_half_angle_squares
from ssm_planner.typing import Array

TOUCHING = 1e-12
"""Relative gap below which two circles, or a line and a sphere, count as touching."""


def subproblem_1(omega: ArrayLike, p: ArrayLike, q: ArrayLike) -> Array:
    """Return the rotation angle θ (...) in (−π, π] about one axis that minimises |e^{ω̂θ} p − q|.

    θ = atan2(ωᵀ(p × q), pᵀq − (ωᵀp)(ωᵀq)). If p or q lies on the axis, every θ is a minimum and 0
    is returned. Source: Murray, Li, Sastry, §3.2, Subproblem 1.
    """
    omega, p, q = _vectors(omega=omega, p=p, q=q)
    p_around = np.cross(omega, p)
    sine = np.sum(p_around * q, axis=-1)
    cosine = np.sum(p_around * np.cross(omega, q), axis=-1)
    theta: Array = np.arctan2(sine, cosine)
    return theta


def subproblem_2(
    omega1: ArrayLike, omega2: ArrayLike, p: ArrayLike, q: ArrayLike
) -> tuple[Array, Array, NDArray[np.int_]]:
    """Return all rotations (θ1, θ2) about two subsequent axes with e^{ω̂1θ1} e^{ω̂2θ2} p = q.

    The point p turns on a circle about ω2, and q turns on a circle about ω1. A spherical triangle
    has the sides α = ∠(ω1, ω2), β = ∠(ω2, p) and φ = ∠(ω1, q). It gives θ2 = δ ± x with
    sin²(x/2) : cos²(x/2) =
    sin((φ + α − β)/2) sin((φ − α + β)/2) : sin((α + β + φ)/2) sin((α + β − φ)/2).

    Subproblem 1 then gives θ1. Only the directions of p and q matter.

    The results are θ1 (..., 2) and θ2 (..., 2), with the upper sign first, and the number of
    solutions (...). The number is 2, or 1 where the circles touch, or 0 where they do not meet.
    With 0 solutions both entries turn p to the point nearest to q. Source: Murray, Li, Sastry,
    §3.2, Subproblem 2.
    """
    omega1, omega2, p, q = _vectors(omega1=omega1, omega2=omega2, p=p, q=q)
    p, q = _directions("p", p), _directions("q", q)
    alpha, beta, phi = _angle(omega1, omega2), _angle(omega2, p), _angle(omega1, q)
    cosine2, sine2 = elbow_half_angle_squares(
        NUMPY, alpha, beta, np.cos(phi / 2.0), np.sin(phi / 2.0)
    )
    lowest = np.minimum(cosine2, sine2)
    count = np.where(lowest > TOUCHING, 2, np.where(lowest >= -TOUCHING, 1, 0))
    x = 2.0 * np.arctan2(np.sqrt(np.maximum(sine2, 0.0)), np.sqrt(np.maximum(cosine2, 0.0)))
    delta = subproblem_1(omega2, p, omega1)
    theta2 = np.stack((delta + x, delta - x), axis=-1)
    turned = _rotate(omega2[..., np.newaxis, :], theta2, p[..., np.newaxis, :])
    theta1 = subproblem_1(omega1[..., np.newaxis, :], turned, q[..., np.newaxis, :])
    return theta1, theta2, count


def subproblem_3_prime(
    v: ArrayLike, p: ArrayLike, q: ArrayLike, delta: ArrayLike
) -> tuple[Array, NDArray[np.int_]]:
    """Return all translations θ with |q − (p + v θ)| = δ, for a unit vector v and δ ≥ 0.

    With u = q − p the solution is θ = uᵀv ± √((uᵀv)² + δ² − |u|²) (paper, eq. app-3). The root is
    computed as √((δ − h)(δ + h)), where h = |u × v| is the distance of the line from q.

    The results are θ (..., 2), with the upper sign first, and the number of solutions (...). The
    number is 2, or 1 where the line touches the sphere, or 0. With 0 solutions both entries are
    uᵀv, the point of the line nearest to q.
    """
    v, p, q = _vectors(v=v, p=p, q=q)
    delta = np.asarray(delta, dtype=float)
    if np.any(delta < 0.0) or not np.all(np.isfinite(delta)):
        raise GeometryError(
            f"delta of shape {delta.shape}: distances must be finite and not negative"
        )
    u = q - p
    along = np.sum(u * v, axis=-1)
    height = np.linalg.norm(np.cross(u, v), axis=-1)
    squared = (delta - height) * (delta + height)
    touching = TOUCHING * np.maximum(delta, height) ** 2
    count = np.where(squared > touching, 2, np.where(squared >= -touching, 1, 0))
    root = np.sqrt(np.maximum(squared, 0.0))
    return np.stack((along + root, along - root), axis=-1), count


def _vectors(**arguments: ArrayLike) -> list[Array]:
    arrays = {name: np.asarray(value, dtype=float) for name, value in arguments.items()}
    for name, array in arrays.items():
        if array.ndim == 0 or array.shape[-1] != 3:
            raise GeometryError(f"{name} has shape {array.shape}: must be (..., 3)")
        if name[0] in "ov" and not np.all(np.abs(np.linalg.norm(array, axis=-1) - 1.0) <= 1e-6):
            raise GeometryError(f"{name} of shape {array.shape}: axes must be unit vectors")
    try:
        return list(np.broadcast_arrays(*arrays.values()))
    except ValueError as error:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise GeometryError(f"shapes do not fit together: {shapes}") from error


def _directions(name: str, vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if np.any(length == 0.0) or not np.all(np.isfinite(length)):
        raise GeometryError(
            f"{name} of shape {vectors.shape}: directions must be finite and not zero"
        )
    unit: Array = vectors / length
    return unit


def _angle(a: Array, b: Array) -> Array:
    angle: Array = 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return angle


def _rotate(omega: Array, theta: Array, vector: Array) -> Array:
    """Return e^{ω̂θ} applied to a vector by the formula of Rodrigues."""
    along = np.sum(omega * vector, axis=-1, keepdims=True) * omega
    cosine, sine = np.cos(theta)[..., np.newaxis], np.sin(theta)[..., np.newaxis]
    turned: Array = along + cosine * (vector - along) + sine * np.cross(omega, vector)
    return turned
