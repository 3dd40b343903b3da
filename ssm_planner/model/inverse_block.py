"""The inner loop of inverse kinematics: one block of tool poses, both branches, at a few dozen operations each.

subproblems.py holds the Paden–Kahan subproblems for any axes; here they are written out in the frame (ω1, t, n), where
most of their terms are constants of the mechanism, and without a sine or cosine.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ssm_planner.model.arguments import ROTATION_TOLERANCE
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.namespace import NUMPY
from ssm_planner.model.triangle import elbow_squares
from ssm_planner.model.workspace import tilt_magnitudes

Array = NDArray[np.float64]

BRANCHES = (1, -1)
ALIGNED = 1e-14
"""Distance of two unit vectors below which it is their angle, to the last digit."""
LEVER = 1e-3
"""Where tip and orientation of a target contradict each other, m of tip error that weigh as much as 1 rad."""


def solve_block(
    mech: Mechanism, w: Array, z: Array, p: Array, joints: Array, orientation_error: Array, tip_error: Array
) -> None:
    """Write joints (n, 2, 4) and errors (n,) of one block.

    The rows of w, z and p (3, n) are components along ω1, t, n: z of the tool axis, p of the tip, w of the tool
    direction at right angles to it that θ2 = δ, θ1 = θ3 = 0 put in the plane of ω1 and ω2, toward ω1 as seen from ω2.
    """
    along = _dot(p, z)
    u = _unit(along * p + LEVER**2 * z)
    cosine2, sine2 = _elbow(mech, u)
    theta4 = _dot(p, u)
    tip_error[:] = np.sqrt(_square(p - theta4 * u))
    chord = np.sqrt(_square(z - u))
    orientation_error[:] = chord
    if chord.max() > ALIGNED:
        middle = z + u
        length2 = _square(middle)
        orientation_error[:] = 2.0 * np.arctan2(chord, np.sqrt(length2))
        # the smallest rotation that takes z to u takes w along
        w = w - 2.0 * _dot(u, w) / np.maximum(length2, 1e-300) * middle

    # Subproblem 2: θ2 from the triangle, θ1 from the azimuths of e^{ω̂2θ2} ω3 and of u about ω1
    c, s = np.sqrt(cosine2), np.sqrt(sine2)
    x = 2.0 * np.arctan2(s, c)
    twice = 2.0 * (s * c)
    on_t = math.sin(mech.alpha - mech.beta) * cosine2 + math.sin(mech.alpha + mech.beta) * sine2
    on_n = math.sin(mech.beta) * twice
    tt, tn, nt, nn = on_t * u[1], on_t * u[2], on_n * u[1], on_n * u[2]
    turned = (tt - nn, tn + nt), (tt + nn, tn - nt)
    size = np.sqrt(turned[0][0] ** 2 + turned[0][1] ** 2)
    free = size == 0.0
    size[free] = 1.0

    # Subproblem 1 about ω3, with w, turned back by θ1, in the frame (ω2, toward ω1, −n)
    cos_x, w_along, w_across = cosine2 - sine2, math.cos(mech.alpha) * w[0], math.sin(mech.alpha) * w[0]
    scale = math.sin(mech.beta) * (cosine2 + sine2)
    rows = np.empty((2, 4, len(x)))
    for k, (branch, (cosine, sine)) in enumerate(zip(BRANCHES, turned, strict=True)):
        cosine[free] = 1.0
        c1, s1 = cosine / size, sine / size
        w1, w2 = c1 * w[1] + s1 * w[2], c1 * w[2] - s1 * w[1]
        h0, h1 = w_along + math.sin(mech.alpha) * w1, w_across - math.cos(mech.alpha) * w1
        sin_x = twice if branch > 0 else -twice
        at_zero = math.cos(mech.beta) * (cos_x * h1 - sin_x * w2) - scale * h0
        np.arctan2(sine, cosine, out=rows[k, 0])
        np.add(mech.delta, branch * x, out=rows[k, 1])
        np.arctan2(-(cos_x * w2 + sin_x * h1), at_zero, out=rows[k, 2])
        rows[k, 3] = theta4
    joints[:] = np.moveaxis(rows, 2, 0)


def _elbow(mech: Mechanism, u: Array) -> tuple[Array, Array]:
    """(C², S²) of unit pointings u (3, n), each of which is moved into the workspace, in place, if it is outside."""
    around = u[1] ** 2 + u[2] ** 2
    sine, cosine = np.sqrt((u[0] - 1.0) ** 2 + around), np.sqrt((u[0] + 1.0) ** 2 + around)
    cosine2, sine2 = elbow_squares(NUMPY, mech.alpha, mech.beta, cosine, sine)
    outside = np.flatnonzero(np.minimum(cosine2, sine2) < 0.0)
    if outside.size:
        tilt = 2.0 * np.arctan2(sine[outside], cosine[outside])
        tilt = np.clip(tilt, *tilt_magnitudes(mech.alpha, mech.beta))
        azimuth = np.arctan2(u[2, outside], u[1, outside])
        u[:, outside] = np.cos(tilt), np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth)
        squares = elbow_squares(NUMPY, mech.alpha, mech.beta, np.cos(tilt / 2.0), np.sin(tilt / 2.0))
        cosine2[outside], sine2[outside] = (np.maximum(square, 0.0) for square in squares)
    return cosine2, sine2


def are_rotations(columns: Array) -> bool:
    """Are the columns x, y, z (9, n) orthonormal and right-handed? No, if one is NaN."""
    x, y, z = columns[0:3], columns[3:6], columns[6:9]
    defect = (_square(x) - 1.0) ** 2 + (_square(y) - 1.0) ** 2 + _dot(x, y) ** 2
    defect += (x[1] * y[2] - x[2] * y[1] - z[0]) ** 2
    defect += (x[2] * y[0] - x[0] * y[2] - z[1]) ** 2
    defect += (x[0] * y[1] - x[1] * y[0] - z[2]) ** 2
    return bool(defect.max() <= ROTATION_TOLERANCE**2)


def _dot(a: Array, b: Array) -> Array:
    """Inner products of columns, (3, n) and (3, n) to (n,)."""
    product: Array = a[0] * b[0]
    product += a[1] * b[1]
    product += a[2] * b[2]
    return product


def _square(a: Array) -> Array:
    """Squared lengths of columns."""
    return _dot(a, a)


def _unit(a: Array) -> Array:
    """Columns scaled to length 1."""
    return a / np.sqrt(_square(a))
