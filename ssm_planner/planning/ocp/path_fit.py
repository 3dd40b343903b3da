"""Polynomials that approximate a given joint path and its torques near each element of a mesh.

The path is q(s) with the path parameter s from 0 to 1, and an element is a time interval of the
motion along it. The functions that give the path constraints and the cost of an element
(`elements.straight_element.StraightElement`) receive the polynomials in s as parameters. The
optimisation therefore evaluates no kinematics and no dynamics of the arm.
"""

from functools import cache

import numpy as np
from numpy.polynomial.chebyshev import chebpts1

from ssm_planner.dynamics import RigidBody
from ssm_planner.elements.straight_element import FIT_DEGREE
from ssm_planner.kinematics import SPEED_JACOBIANS, tool_speed
from ssm_planner.planning.retiming.paths import JointPath
from ssm_planner.typing import Array

MIN_FIT_HALF_WIDTH = 0.004
"""Smallest half width of the interval of a fit, in units of the path parameter s ∈ [0, 1].

The optimisation moves the elements along the path. The interval around a short element must be wide
enough to contain the element after such a move.
"""


def fit_path(path: JointPath, bodies: tuple[RigidBody, ...], low: Array, high: Array) -> Array:
    """Fit polynomials in s to the slope, the torques and the tool speeds of a path.

    Each element (time interval) gets polynomials of its own. The fitted functions of s are called
    curves:

    - the slopes dq/ds of the joints,
    - the coefficients A, B and C of the joint torques without friction, A s̈ + B ṡ² + C
      (`RigidBody.path_load`),
    - the speeds of the tool at ṡ = 1.

    Each polynomial equals its curve at the Chebyshev nodes of an interval of s. The interval is
    twice as wide as the element, but stays within one smooth piece of the path.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    bodies : tuple of RigidBody
        Rigid-body models of the arm, one for each payload.
    low, high : (n,) arrays
        Values of s at both ends of the n elements.

    Returns
    -------
    (n, size) array
        Fit of each element in the order of `straight_element.fit_layout`: centre and half width of
        the interval, then the coefficients of ξ⁰ for all curves, those of ξ¹, and so on, with
        ξ = (s − centre) / half width.
    """
    middle, breaks = (low + high) / 2, path.breaks
    # Index of the smooth piece of the path that contains each element.
    piece = np.clip(np.searchsorted(breaks, middle) - 1, 0, len(breaks) - 2)
    piece_start, piece_end = breaks[piece], breaks[piece + 1]
    half_width = np.minimum(
        np.maximum(high - low, MIN_FIT_HALF_WIDTH), (piece_end - piece_start) / 2
    )
    centre = np.clip(middle, piece_start + half_width, piece_end - half_width)
    nodes, inverse_powers = _chebyshev_nodes()
    samples = path.sample((centre[:, None] + half_width[:, None] * nodes).ravel())
    # A of all payloads, then B of all payloads, then C of all payloads, as in `curves_layout`.
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
    # The polynomial of element n with the coefficients a_nd has the value Σ_d ξ_j^d a_nd at node j.
    # The inverse of the matrix ξ_j^d therefore turns the values of a curve into coefficients.
    coefficients = np.einsum(
        "dj,njk->ndk",
        inverse_powers,
        np.ascontiguousarray(curves).reshape(len(low), FIT_DEGREE + 1, -1),
    )
    return np.hstack([centre[:, None], half_width[:, None], coefficients.reshape(len(low), -1)])


@cache
def _chebyshev_nodes() -> tuple[Array, Array]:
    """Return the nodes of a fit, and the matrix that turns values at them into coefficients.

    Returns
    -------
    nodes : (d + 1,) array
        Chebyshev nodes ξ_j = cos(π (2 j + 1)/(2 d + 2)) between −1 and 1, with d = FIT_DEGREE.
        Interpolation at these nodes keeps the error small in the whole interval.
    inverse_powers : (d + 1, d + 1) array
        Inverse of the matrix of the powers ξ_j^0, …, ξ_j^d. Its product with the values of a
        polynomial at the nodes gives the coefficients of the polynomial.
    """
    nodes = np.asarray(chebpts1(FIT_DEGREE + 1))
    return nodes, np.asarray(np.linalg.inv(np.vander(nodes, increasing=True)))
