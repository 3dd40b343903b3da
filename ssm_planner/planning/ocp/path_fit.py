"""Polynomials that approximate a path and its load near the elements of a mesh.

They are the parameters of `elements.straight_element.StraightElement`.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ssm_planner.dynamics import RigidBody
from ssm_planner.elements.straight_element import DEGREE
from ssm_planner.kinematics import JACOBIANS, tool_speed
from ssm_planner.planning.retiming.paths import JointPath
from ssm_planner.typing import Array

NARROWEST = 0.004
"""Smallest half width of a fit in s. It leaves room for the optimisation to move an element."""


def fit(path: JointPath, bodies: tuple[RigidBody, ...], low: Array, high: Array) -> Array:
    """Fit polynomials to the curves of a path on the elements [low, high], (n,) each, in s.

    The curves are the derivatives of the joints, the coefficients of the dynamics and the speeds of
    the tool. Returns one row for each element, (n, size of `fit_of`): centre and half width of the
    fitted interval, and the coefficients. The interval reaches beyond the element by half its
    width, but stays on the smooth piece of the path.
    """
    middle, breaks = (low + high) / 2, path.breaks
    index = np.clip(np.searchsorted(breaks, middle) - 1, 0, len(breaks) - 2)
    low_break, high_break = breaks[index], breaks[index + 1]
    half_width = np.minimum(np.maximum(high - low, NARROWEST), (high_break - low_break) / 2)
    centre = np.clip(middle, low_break + half_width, high_break - half_width)
    chebyshev, inverse = _nodes()
    samples = path.sample((centre[:, None] + half_width[:, None] * chebyshev).ravel())
    load = zip(
        *(body.path_load(samples.q, samples.dq, samples.ddq) for body in bodies), strict=True
    )
    speeds = np.column_stack(
        [
            tool_speed(speed_class, path.mechanism, samples.q, samples.dq)
            for speed_class in JACOBIANS
        ]
    )
    curves = np.hstack([samples.dq, *(matrix for matrices in load for matrix in matrices), speeds])
    # Node j of element n has the values Σ_d ξ_j^d a_nd.
    coefficients = np.einsum(
        "dj,njk->ndk", inverse, np.ascontiguousarray(curves).reshape(len(low), DEGREE + 1, -1)
    )
    return np.hstack([centre[:, None], half_width[:, None], coefficients.reshape(len(low), -1)])


@cache
def _nodes() -> tuple[Array, Array]:
    """Return the nodes ξ_j (DEGREE + 1,) of a fit, and the inverse of their powers ξ_j^d."""
    chebyshev = np.cos(np.pi * (2 * np.arange(DEGREE + 1) + 1) / (2 * (DEGREE + 1)))
    return chebyshev, np.linalg.inv(np.vander(chebyshev, increasing=True))
