"""Reduced costs of standing joints: what a motion would save, to first order, if the joint moved.

A moving joint has the multipliers λ of "u̇ keeps its direction" at the optimum. A standing joint j
has none, because it is not an unknown of the program. Its reduced costs follow from the multipliers
of the path constraints, ℓ(q) = Σ_k λ_kᵀ G(z_k). Let q̇_j be linear between its values v_k at the
ends of the elements, and q_j its integral. The reduced costs are c_k = ∂ℓ/∂v_k. A joint that
returns to where it stood has Σ w_k v_k = 0 with the weights w_k of the trapezoidal rule. The
steepest descent under this condition is v_k = mean(c/w) − c_k / w_k, and its size is the multiplier
of "q̇_j = 0".
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import call
from ssm_planner.elements.compiled import native_elements
from ssm_planner.elements.element import ElementModel, element_functions
from ssm_planner.typing import Array


def constraint_gradient(
    element: ElementModel, z: Array, parameters: Sequence[Array], multipliers: Array
) -> Array:
    """Return ∂(λᵀ G)/∂z of every element, (n, size of z); multipliers λ (n, 3 rows)."""
    native = native_elements(element, parameters, len(z))
    if native is not None:
        return np.asarray(np.einsum("kr,krz->kz", multipliers, native.call("jacobian", z)))
    of_each = (
        values if values.ndim == 2 else np.broadcast_to(values, (len(z), len(values)))
        for values in parameters
    )
    return call(_gradient_function(element), z, *of_each, multipliers)[0]


@lru_cache(maxsize=8)
def _gradient_function(element: ElementModel) -> ca.Function:
    """Return a Function of (z, *p, λ) that gives ∂(λᵀ G)/∂z of one element."""
    rows = element_functions(element).rows
    z, *p = (ca.MX.sym(rows.name_in(i), rows.sparsity_in(i)) for i in range(rows.n_in()))
    multipliers = ca.MX.sym("multipliers", rows.size1_out(0))
    gradient = ca.gradient(ca.dot(multipliers, rows(z, *p)), z)
    return ca.Function("gradient", [z, *p, multipliers], [ca.densify(gradient)])


def steepest_descent(gradient: Array, lengths: Array) -> Array:
    """Return w (mean(c/w) − c/w) of one standing joint in the middle of every element, (n,).

    Parameters
    ----------
    gradient : (n, 3) array
        Derivatives of ℓ with respect to q, q̇ and q̈ of the joint.
    lengths : (n,) array
        Lengths of the elements.
    """
    h, (by_u, by_v, by_a) = lengths, gradient.T
    later = np.append(np.cumsum(by_u[::-1])[::-1], 0.0)[1:]
    at_start = by_v - by_a / h + later * h / 2
    at_end = by_a / h + later * h / 2
    costs = np.append(at_start, 0.0) + np.append(0.0, at_end)
    by_time = 2 * costs / (np.append(h, 0.0) + np.append(0.0, h))
    return np.asarray(h * (costs.sum() / h.sum() - (by_time[1:] + by_time[:-1]) / 2))
