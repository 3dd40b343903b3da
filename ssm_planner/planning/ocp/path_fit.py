"""Polynomials in s that approximate a path and its load near each element of a mesh.

The functions of one element (`elements.straight_element.StraightElement`), which give its path
constraints and its cost, receive these polynomials as constants. The optimisation thus evaluates no
kinematics.
"""

from functools import cache

import numpy as np

from ssm_planner.dynamics import RigidBody
from ssm_planner.elements.straight_element import FIT_DEGREE
from ssm_planner.kinematics import SPEED_JACOBIANS, tool_speed
from ssm_planner.planning.retiming.paths import JointPath
from ssm_planner.typing import Array

MIN_FIT_HALF_WIDTH = 0.004
"""Smallest half width of the interval of a fit, in units of the path parameter s ∈ [0, 1].

The optimisation moves an element along the path. A short element thus remains in its interval.
"""


def fit_path(path: JointPath, bodies: tuple[RigidBody, ...], low: Array, high: Array) -> Array:
    """Fit polynomials to a path, its load and its tool speeds near each element.

    The fitted curves are the derivatives dq/ds of the joints, the coefficients of the load in s
    (`RigidBody.path_load`), and the speeds of the tool at ṡ = 1. Each polynomial interpolates its
    curve at Chebyshev nodes. The interval of the fit is twice as wide as the element, but stays on
    one smooth piece of the path.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    bodies : tuple of RigidBody
        Rigid-body models of the arm, one for each load.
    low, high : (n,) arrays
        Values of s at both ends of the elements.

    Returns
    -------
    (n, size) array
        Fit of each element in the order of `straight_element.fit_layout`: centre and half width of
        the interval, and the coefficients of ξ^0, ξ^1, … with ξ = (s − centre) / half width.
    """
    middle, breaks = (low + high) / 2, path.breaks
    piece = np.clip(np.searchsorted(breaks, middle) - 1, 0, len(breaks) - 2)
    piece_start, piece_end = breaks[piece], breaks[piece + 1]
    half_width = np.minimum(
        np.maximum(high - low, MIN_FIT_HALF_WIDTH), (piece_end - piece_start) / 2
    )
    centre = np.clip(middle, piece_start + half_width, piece_end - half_width)
    nodes, inverse_powers = _chebyshev_nodes()
    samples = path.sample((centre[:, None] + half_width[:, None] * nodes).ravel())
    loads = zip(
        *(body.path_load(samples.q, samples.dq, samples.ddq) for body in bodies), strict=True
    )
    speeds = np.column_stack(
        [
            tool_speed(speed_class, path.mechanism, samples.q, samples.dq)
            for speed_class in SPEED_JACOBIANS
        ]
    )
    curves = np.hstack([samples.dq, *(matrix for matrices in loads for matrix in matrices), speeds])
    # The polynomial with coefficients a_nd has the value Σ_d ξ_j^d a_nd at node j of element n.
    coefficients = np.einsum(
        "dj,njk->ndk",
        inverse_powers,
        np.ascontiguousarray(curves).reshape(len(low), FIT_DEGREE + 1, -1),
    )
    return np.hstack([centre[:, None], half_width[:, None], coefficients.reshape(len(low), -1)])


@cache
def _chebyshev_nodes() -> tuple[Array, Array]:
    """Return the nodes of a fit, and the matrix that turns values there into coefficients.

    The nodes ξ_j (FIT_DEGREE + 1,) are Chebyshev nodes. The matrix is the inverse of the matrix of
    powers ξ_j^d.
    """
    nodes = np.cos(np.pi * (2 * np.arange(FIT_DEGREE + 1) + 1) / (2 * (FIT_DEGREE + 1)))
    return nodes, np.linalg.inv(np.vander(nodes, increasing=True))
