"""The spherical triangle ω1, ω2, tool, and the Paden–Kahan subproblems that inverse kinematics is made of.

All axes pass through the origin (the remote centre). All forms are half-angle forms: atan2 of products, no acos, no
difference of nearly equal numbers, so that they are exact where the triangle degenerates.

The triangle has the sides α (ω1 to ω2), β (ω2 to tool) and |φ| (ω1 to tool); its angle at ω2 is |x|, x = θ2 − δ.
With c = cos(x/2) and s = sin(x/2):
    cos φ = cos(α − β) c² + cos(α + β) s²,     the paper's f(θ2), eq. 4
    e^{ω̂2 θ2} ω3 = cos φ ω1 + P t + Q n,        P = sin(α − β) c² + sin(α + β) s²,   Q = −2 sin β s c
Seen from the tool, ω1 lies at the angle η = atan2(F, E) about the tool axis, counted from its place at θ2 = δ:
    E = sin(α − β) c² − sin(α + β) s²,   F = −2 sin α s c
so roll = θ1 + ζ ± 90° with ζ = atan2(Q, P), and spin = θ3 − η + constant: tilt depends on θ2 alone, roll and spin
are θ1 and θ3 plus functions of θ2. The functions of the triangle serve NumPy arrays and CasADi expressions (`xp`).

The subproblems take vectors (..., 3) that broadcast and return least-squares solutions where there is no exact one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssm_planner.codegen.namespace import NUMPY, Namespace
from ssm_planner.errors import GeometryError
from ssm_planner.typing import Array

TOUCHING = 1e-12
"""Relative gap below which two circles, or a line and a sphere, count as touching."""


def tilt_magnitude(xp: Namespace, alpha: Any, beta: Any, x: Any) -> Any:
    """|φ| of x = θ2 − δ, in [0, π] (paper, eq. 4), to full accuracy at both ends."""
    c, s = xp.cos(x / 2.0), xp.sin(x / 2.0)
    less, more = (alpha - beta) / 2.0, (alpha + beta) / 2.0
    sine2 = xp.sin(less) ** 2 * (c * c) + xp.sin(more) ** 2 * (s * s)
    cosine2 = xp.cos(less) ** 2 * (c * c) + xp.cos(more) ** 2 * (s * s)
    return 2.0 * xp.arctan2(xp.sqrt(sine2), xp.sqrt(cosine2))


def elbow_squares(xp: Namespace, alpha: Any, beta: Any, cosine: Any, sine: Any) -> tuple[Any, Any]:
    """(C², S²), proportional to cos²(x/2) and sin²(x/2), of the cosine and sine of φ/2.

    C² = sin((α + β + φ)/2) sin((α + β − φ)/2) and S² = sin((φ + α − β)/2) sin((φ − α + β)/2): each vanishes at its end
    of the workspace and is negative beyond it. Their sum is sin α sin β times the scale of (cosine, sine) squared.
    """
    less, more = (alpha - beta) / 2.0, (alpha + beta) / 2.0
    far_a, far_b = xp.sin(more) * cosine, xp.cos(more) * sine
    near_a, near_b = xp.cos(less) * sine, xp.sin(less) * cosine
    return (far_a + far_b) * (far_a - far_b), (near_a + near_b) * (near_a - near_b)


def azimuths(xp: Namespace, alpha: Any, beta: Any, c: Any, s: Any) -> tuple[Any, Any]:
    """(ζ, η) of c and s, which may carry a common positive factor; continuous on a branch."""
    minus, plus = xp.sin(alpha - beta) * (c * c), xp.sin(alpha + beta) * (s * s)
    cross = -2.0 * (s * c)
    zeta = xp.arctan2(xp.sin(beta) * cross, minus + plus)
    eta = xp.arctan2(xp.sin(alpha) * cross, minus - plus)
    return zeta, eta


def subproblem_1(omega: ArrayLike, p: ArrayLike, q: ArrayLike) -> Array:
    """Rotation about one axis: the θ (...) in (−π, π] that minimises |e^{ω̂θ} p − q|.

    θ = atan2(ωᵀ(p × q), pᵀq − (ωᵀp)(ωᵀq)). With p or q on the axis every θ does, and 0 is returned.
    Source: Murray, Li, Sastry, §3.2, Subproblem 1.
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
    """Rotations about two subsequent axes: all (θ1, θ2) with e^{ω̂1θ1} e^{ω̂2θ2} p = q.

    p turns on a circle about ω2, q on one about ω1; with the sides α = ∠(ω1, ω2), β = ∠(ω2, p), φ = ∠(ω1, q) of a
    spherical triangle, θ2 = δ ± x and sin²(x/2) : cos²(x/2) =
    sin((φ + α − β)/2) sin((φ − α + β)/2) : sin((α + β + φ)/2) sin((α + β − φ)/2);
    Subproblem 1 then gives θ1. Only the directions of p and q matter.
    Returns θ1 (..., 2), θ2 (..., 2), upper sign first, and the number of solutions (...): 2, 1 where the circles
    touch, or 0 where they do not meet; then both entries turn p to the place nearest to q.
    Source: Murray, Li, Sastry, §3.2, Subproblem 2.
    """
    omega1, omega2, p, q = _vectors(omega1=omega1, omega2=omega2, p=p, q=q)
    p, q = _directions("p", p), _directions("q", q)
    alpha, beta, phi = _angle(omega1, omega2), _angle(omega2, p), _angle(omega1, q)
    cosine2, sine2 = elbow_squares(NUMPY, alpha, beta, np.cos(phi / 2.0), np.sin(phi / 2.0))
    lowest = np.minimum(cosine2, sine2)
    count = np.where(lowest > TOUCHING, 2, np.where(lowest >= -TOUCHING, 1, 0))
    x = 2.0 * np.arctan2(np.sqrt(np.maximum(sine2, 0.0)), np.sqrt(np.maximum(cosine2, 0.0)))
    delta = subproblem_1(omega2, p, omega1)
    theta2 = np.stack((delta + x, delta - x), axis=-1)
    turned = _rotate(omega2[..., np.newaxis, :], theta2, p[..., np.newaxis, :])
    theta1 = subproblem_1(omega1[..., np.newaxis, :], turned, q[..., np.newaxis, :])
    return theta1, theta2, count


def subproblem_3_prime(v: ArrayLike, p: ArrayLike, q: ArrayLike, delta: ArrayLike) -> tuple[Array, NDArray[np.int_]]:
    """Translation to a given distance: all θ with |q − (p + v θ)| = δ, for a unit v and δ ≥ 0.

    With u = q − p: θ = uᵀv ± √((uᵀv)² + δ² − |u|²) (paper, eq. app-3), where the root is taken as
    √((δ − h)(δ + h)) with the line's distance h = |u × v| from q.
    Returns θ (..., 2), upper sign first, and the number of solutions (...): 2, 1 where the line touches the sphere, or
    0; then both entries are uᵀv, the point of the line nearest to q.
    """
    v, p, q = _vectors(v=v, p=p, q=q)
    delta = np.asarray(delta, dtype=float)
    if np.any(delta < 0.0) or not np.all(np.isfinite(delta)):
        raise GeometryError(f"delta of shape {delta.shape}: distances must be finite and not negative")
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
        raise GeometryError(f"{name} of shape {vectors.shape}: directions must be finite and not zero")
    unit: Array = vectors / length
    return unit


def _angle(a: Array, b: Array) -> Array:
    angle: Array = 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return angle


def _rotate(omega: Array, theta: Array, vector: Array) -> Array:
    """e^{ω̂θ} applied to a vector (Rodrigues)."""
    along = np.sum(omega * vector, axis=-1, keepdims=True) * omega
    cosine, sine = np.cos(theta)[..., np.newaxis], np.sin(theta)[..., np.newaxis]
    turned: Array = along + cosine * (vector - along) + sine * np.cross(omega, vector)
    return turned
