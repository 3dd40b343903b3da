"""Path and load near every element as polynomials in s, so that the optimisation evaluates no kinematics.

q'(s) and the load τ_rigid = A(s) s̈ + B(s) ṡ² + C(s) are smooth; over the short stretch of one element a polynomial through
Chebyshev points gives them to many digits. The fit is renewed where a solution has left it.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.planning.retiming.constraints import PathLoad
from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.typing import Array

DEGREE = 6
CURVES = 17
"""q', A, B and C of four joints, and |dp/ds| of the tip."""
NARROWEST = 0.004
"""Smallest half width of a fit in s: room for the optimisation to move an element."""
WIDER = 2.0
"""By how much a fit may be wider than a new one would be."""
LOCAL = 2 + CURVES * (DEGREE + 1)
"""Length of one element's parameters: centre, half width, coefficients."""


@dataclass(frozen=True, eq=False)
class PathFit:
    """Symbolic view of one element's parameters (LOCAL,)."""

    parameters: ca.SX

    def at(self, s: ca.SX, jerk: bool) -> tuple[ca.SX, ca.SX, ca.SX, list[ca.SX], ca.SX]:
        """q', q'', q''' (zero unless jerk), each (4,), [A, B, C] and |dp/ds| at s."""
        centre, half = self.parameters[0], self.parameters[1]
        xi = (s - centre) / half
        coefficients = ca.reshape(self.parameters[2:], CURVES, DEGREE + 1)
        values = _horner(coefficients, xi)
        slope = _derivative(coefficients[:4, :])
        first = _horner(slope, xi) / half
        second = _horner(_derivative(slope), xi) / half**2 if jerk else ca.SX.zeros(4)
        return values[:4], first, second, [values[4 * k : 4 * k + 4] for k in (1, 2, 3)], values[16]


def fit(path: StraightPath, body: RigidBody, low: Array, high: Array) -> Array:
    """Parameters (n, LOCAL) of elements that cover [low, high] (n,) in s.

    Fits reach beyond the element by half its width, but stay on the path.
    """
    centre = (low + high) / 2
    half = np.maximum(high - low, NARROWEST)
    nodes = np.cos(np.pi * (2 * np.arange(DEGREE + 1) + 1) / (2 * (DEGREE + 1)))
    centre = np.clip(centre, half, 1 - half)
    samples = path.sample((centre[:, None] + half[:, None] * nodes).ravel())
    load = PathLoad.along(body, samples)
    tip = np.linalg.norm(path.tip_slope(samples), axis=1, keepdims=True)
    values = np.hstack([samples.dq, load.inertia, load.velocity, load.gravity, tip])
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    coefficients = np.einsum("dk,nkc->ndc", inverse, values.reshape(len(low), DEGREE + 1, CURVES))
    return np.hstack([centre[:, None], half[:, None], coefficients.reshape(len(low), -1)])


def serves(parameters: Array, low: Array, high: Array) -> Array:
    """Whether fits (n, LOCAL) hold on [low, high] (n,), and are not much wider than they need to be."""
    centre, half = parameters[:, 0], parameters[:, 1]
    inside = (low >= centre - half) & (high <= centre + half)
    return np.asarray(inside & (half <= WIDER * np.maximum(high - low, NARROWEST)))


def _horner(coefficients: ca.SX, xi: ca.SX) -> ca.SX:
    value = coefficients[:, -1]
    for k in range(coefficients.size2() - 2, -1, -1):
        value = value * xi + coefficients[:, k]
    return value


def _derivative(coefficients: ca.SX) -> ca.SX:
    return ca.horzcat(*(k * coefficients[:, k] for k in range(1, coefficients.size2())))
