"""Closed-form inverse kinematics of tool poses, an independent solution for tests and benchmarks.

Paden–Kahan subproblem 3′ gives θ4, subproblem 2 gives θ1 and θ2, and subproblem 1 gives θ3 (paper,
§II-C). `_solve_block` solves them in the frame (ω1, t, n), in which most terms are constants. The
package itself plans in task coordinates (`kinematics/inverse.py`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.inverse import (
    BRANCHES,
    TARGETS_PER_BLOCK,
    _check_axes_not_parallel,
    _select_solutions,
)
from ssm_planner.kinematics.mechanism import Mechanism, elbow_half_angle_squares, tilt_magnitudes
from ssm_planner.kinematics.rotations import check_rows, rotation
from ssm_planner.kinematics.solutions import Solutions
from ssm_planner.trajectory import blocks
from ssm_planner.typing import Array

ALIGNED = 1e-14
"""Distance of two unit vectors below which the distance equals their angle within rounding."""
LEVER = 1e-3
"""Tip error in m that weighs as much as an orientation error of 1 rad.

The weight matters for targets whose tip and orientation contradict each other.
"""
ROTATION_TOLERANCE = 1e-6
"""Largest Frobenius norm of the defect of a matrix that counts as a rotation."""


def inverse(
    mechanism: Mechanism,
    rotations: ArrayLike,
    positions: ArrayLike,
    *,
    limits: ArrayLike | None = None,
    reference: ArrayLike | None = None,
) -> Solutions:
    """Return the joints of tool poses on both branches.

    The orientation selects one of the two translations θ4 = ±|p| of subproblem 3′. If p is off the
    tool axis R e_z, no joints reach the pose exactly. The solution then uses the pointing v that
    minimises |p − θ4 v|² + LEVER² |v − R e_z|² with θ4 = pᵀR e_z, and finally θ4 = pᵀv. At depth 0
    only the orientation counts. A pointing outside the workspace is moved to the boundary at the
    same roll, which is the nearest one that subproblem 2 reaches.

    Parameters
    ----------
    mechanism : Mechanism
    rotations : (n, 3, 3)
        Orientation R of the tool in the base frame.
    positions : (n, 3)
        Tip position p in m.
    limits : (4, 2), optional
        Joint limits that mark the solutions, see `mark_within_limits`.
    reference : (4,) or (n, 4), optional
        Joints that order the solutions, see `sort_by_distance`.

    Raises
    ------
    GeometryError
        If the lengths differ or a matrix is not a rotation.
    """
    _check_axes_not_parallel(mechanism)
    matrix = np.ascontiguousarray(rotations, dtype=float).reshape(-1, 3, 3)
    p = check_rows("positions", positions, 3)
    if len(p) != len(matrix):
        raise GeometryError(
            f"rotations of shape {matrix.shape} and positions of shape {p.shape}: not of one length"
        )
    n = len(p)
    joints = np.empty((n, 2, 4))
    orientation_error = np.empty(n)
    tip_error = np.empty(n)
    # columns of frameᵀ R Rz(−tool_angle), as one product with the entries of R
    spin = rotation((0.0, 0.0, 1.0), -mechanism.tool_angle)
    to_frame = np.einsum("ik,cj->jkic", mechanism.frame, spin).reshape(9, 9)
    flat = matrix.reshape(n, 9)
    for block in blocks(n, TARGETS_PER_BLOCK):
        columns = to_frame @ flat[block].T
        if not _are_rotations(columns):
            raise GeometryError("rotations: a matrix is not a rotation")
        tips = mechanism.frame.T @ p[block].T
        joints[block], orientation_error[block], tip_error[block] = _solve_block(
            mechanism, columns[0:3], columns[6:9], tips
        )
    return _select_solutions(joints, orientation_error, tip_error, limits, reference)


def _solve_block(mech: Mechanism, w: Array, z: Array, p: Array) -> tuple[Array, Array, Array]:
    """Solve n poses in the three steps of the paper, §II-C.

    Components come first in all arrays so that every operation runs over contiguous rows.

    Parameters
    ----------
    mech : Mechanism
    w, z, p : (3, n)
        Components along ω1, t and n. z is the tool axis and p the tip. w = g_d g_0⁻¹ p_3 as in
        the third step of the paper. p_3 is perpendicular to the tool. The joints θ1 = θ3 = 0,
        θ2 = δ put it into the plane of ω1 and ω2, on the side of ω1.

    Returns
    -------
    joints : (n, 2, 4)
    orientation_error, tip_error : (n,)
    """
    # θ4: Subproblem 3′ (eq. 13). |θ4| = |p|, and the tool axis gives the sign.
    u = _unit(_dot(p, z) * p + LEVER**2 * z)
    c2, s2 = _elbow(mech, u)
    theta4 = _dot(p, u)
    tip_error = np.sqrt(_square(p - theta4 * u))
    w, orientation_error = _carried_along(w, z, u)

    # θ2: Subproblem 2 (eq. 14), e^{ω̂1θ1} e^{ω̂2θ2} ω3 = u.
    # The triangle ω1, ω2, u gives x = ±(θ2 − δ).
    c = np.sqrt(c2)
    s = np.sqrt(s2)
    x = 2.0 * np.arctan2(s, c)
    cos_x = c2 - s2
    sin_x = 2.0 * (s * c)
    on_t = math.sin(mech.alpha - mech.beta) * c2 + math.sin(mech.alpha + mech.beta) * s2
    joints = np.empty((2, 4, len(x)))
    for (theta1, theta2, theta3, depth), branch in zip(joints, BRANCHES, strict=True):
        np.add(mech.delta, branch * x, out=theta2)
        depth[:] = theta4

        # θ1: the angle about ω1 from e^{ω̂2θ2} ω3 = cos φ ω1 + P t + Q n to u.
        sin_branch = branch * sin_x
        on_n = -math.sin(mech.beta) * sin_branch
        cosine = on_t * u[1] + on_n * u[2]
        sine = on_t * u[2] - on_n * u[1]
        size = np.sqrt(cosine**2 + sine**2)
        any_angle = size == 0.0
        cosine[any_angle] = size[any_angle] = 1.0
        np.arctan2(sine, cosine, out=theta1)

        # θ3: Subproblem 1 (eq. 15), e^{ω̂3θ3} p_3 = q_3 = e^{−ω̂2θ2} e^{−ω̂1θ1} w. The first step
        # computes the components of e^{−ω̂1θ1} w along t and n.
        cosine /= size
        sine /= size
        w_t = cosine * w[1] + sine * w[2]
        w_n = cosine * w[2] - sine * w[1]
        # The second step computes the components along ω2, g and n.
        # The vector g = sin α ω1 − cos α t points from ω2 toward ω1.
        w_omega2 = math.cos(mech.alpha) * w[0] + math.sin(mech.alpha) * w_t
        w_g = math.sin(mech.alpha) * w[0] - math.cos(mech.alpha) * w_t
        # The third step rotates by −x about ω2.
        # It gives the components along p_3 and along ω3 × p_3.
        pointing = (
            math.cos(mech.beta) * (cos_x * w_g - sin_branch * w_n) - math.sin(mech.beta) * w_omega2
        )
        np.arctan2(-(cos_x * w_n + sin_branch * w_g), pointing, out=theta3)
    return np.moveaxis(joints, 2, 0), orientation_error, tip_error


def _elbow(mech: Mechanism, u: Array) -> tuple[Array, Array]:
    """Return cos² and sin² of half the elbow angle x, (n,), for unit directions of the tool u.

    u is (3, n). Directions outside the workspace are replaced in u by the nearest ones on its
    boundary.
    """
    around = u[1] ** 2 + u[2] ** 2
    sine, cosine = (
        np.sqrt((u[0] - 1.0) ** 2 + around),
        np.sqrt((u[0] + 1.0) ** 2 + around),
    )  # 2 sin(φ/2), 2 cos(φ/2)
    c2, s2 = elbow_half_angle_squares(NUMPY, mech.alpha, mech.beta, cosine, sine)
    outside = np.flatnonzero(np.minimum(c2, s2) < 0.0)
    if outside.size:
        tilt = 2.0 * np.arctan2(sine[outside], cosine[outside])
        tilt = np.clip(tilt, *tilt_magnitudes(mech.alpha, mech.beta))
        azimuth = np.arctan2(u[2, outside], u[1, outside])
        u[:, outside] = np.cos(tilt), np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth)
        squares = elbow_half_angle_squares(
            NUMPY, mech.alpha, mech.beta, 2.0 * np.cos(tilt / 2.0), 2.0 * np.sin(tilt / 2.0)
        )
        c2[outside], s2[outside] = (np.maximum(square, 0.0) for square in squares)
    scale = 1.0 / (4.0 * math.sin(mech.alpha) * math.sin(mech.beta))
    return scale * c2, scale * s2


def _carried_along(w: Array, z: Array, u: Array) -> tuple[Array, Array]:
    """Apply the smallest rotation that takes z to u to the vectors w (3, n).

    z and u are unit vectors (3, n). Returns the rotated vectors and the angles (n,).
    """
    chord = np.sqrt(_square(z - u))
    if chord.max() <= ALIGNED:
        return w, chord
    middle = z + u
    length2 = _square(middle)
    return w - 2.0 * _dot(u, w) / np.maximum(length2, 1e-300) * middle, 2.0 * np.arctan2(
        chord, np.sqrt(length2)
    )


def _are_rotations(columns: Array) -> bool:
    """Return whether all matrices with columns x, y, z (9, n) are orthonormal and right-handed.

    The result is False if a value is NaN.
    """
    x = columns[0:3]
    y = columns[3:6]
    z = columns[6:9]
    defect = (_square(x) - 1.0) ** 2 + (_square(y) - 1.0) ** 2 + _dot(x, y) ** 2
    defect += (x[1] * y[2] - x[2] * y[1] - z[0]) ** 2
    defect += (x[2] * y[0] - x[0] * y[2] - z[1]) ** 2
    defect += (x[0] * y[1] - x[1] * y[0] - z[2]) ** 2
    return bool(defect.max() <= ROTATION_TOLERANCE**2)


def _dot(a: Array, b: Array) -> Array:
    """Return the inner products (n,) of columns (3, n)."""
    product = a[0] * b[0]
    product += a[1] * b[1]
    product += a[2] * b[2]
    return product


def _square(a: Array) -> Array:
    """Return the squared lengths (n,) of columns (3, n)."""
    return _dot(a, a)


def _unit(a: Array) -> Array:
    """Return the columns (3, n) scaled to length 1."""
    return a / np.sqrt(_square(a))
