"""Reduced costs of joints at rest: the time that a motion would save if a joint moved.

The savings are of first order. A moving joint has the multipliers λ of "u̇ keeps its direction" at
the optimum. A joint j at rest has no multiplier, because it is not an unknown of the program. Its reduced
costs follow from the multipliers of the path constraints, ℓ(q) = Σ_k λ_kᵀ G(z_k). Let q̇_j be
linear between its values v_k at the ends of the elements, and let q_j be its integral. The reduced
costs are c_k = ∂ℓ/∂v_k. A joint that returns to its position satisfies Σ w_k v_k = 0 with the
weights w_k of the trapezoidal rule. The steepest descent of ℓ under this condition is v_k =
mean(c/w) − c_k / w_k. Its size is the multiplier of "q̇_j = 0".
"""

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
    """Compute the gradient of λᵀ G, the weighted sum of the path constraints, for every element.

    Parameters
    ----------
    element : ElementModel
        Element model with r path constraints G(z).
    z : (n, size of z) array
        States and lengths of the elements.
    parameters : sequence of arrays
        Parameters of the element model, (size,) or (n, size) each.
    multipliers : (n, 3 r) array
        Multipliers λ at start, middle and end of each element.

    Returns
    -------
    (n, size of z) array
        ∂(λᵀ G)/∂z.
    """
    native = native_elements(element, parameters, len(z))
    if native is not None:
        return np.asarray(np.einsum("kr,krz->kz", multipliers, native.call("jacobian", z)))
    per_element = (
        values if values.ndim == 2 else np.broadcast_to(values, (len(z), len(values)))
        for values in parameters
    )
    return call(_gradient_function(element), z, *per_element, multipliers)[0]


@lru_cache(maxsize=8)
def _gradient_function(element: ElementModel) -> ca.Function:
    """Build the CasADi Function that evaluates ∂(λᵀ G)/∂z of one element.

    Its arguments are the element's vector z, the parameters of the element model, and the
    multipliers λ of the path constraints G.
    """
    rows = element_functions(element).rows
    z, *p = (ca.MX.sym(rows.name_in(i), rows.sparsity_in(i)) for i in range(rows.n_in()))
    multipliers = ca.MX.sym("multipliers", rows.size1_out(0))
    gradient = ca.gradient(ca.dot(multipliers, rows(z, *p)), z)
    return ca.Function("gradient", [z, *p, multipliers], [ca.densify(gradient)])


def steepest_descent(gradient: Array, lengths: Array) -> Array:
    """Compute the direction in which a joint at rest should move in order to save time.

    The joint's velocity in the middle of each element is mean(c/w) − c/w, with the costs c and the
    weights w of the module's docstring.

    Parameters
    ----------
    gradient : (n, 3) array
        Derivatives of ℓ with respect to q, q̇ and q̈ of the joint.
    lengths : (n,) array
        Lengths of the elements in scaled time.

    Returns
    -------
    (n,) array
        Velocity times length of each element. It is positive if the joint should move forwards.
    """
    h, (by_position, by_velocity, by_acceleration) = lengths, gradient.T
    # A velocity within an element also shifts the positions in all later elements.
    position_after = np.append(np.cumsum(by_position[::-1])[::-1], 0.0)[1:]
    at_start = by_velocity - by_acceleration / h + position_after * h / 2
    at_end = by_acceleration / h + position_after * h / 2
    costs = np.append(at_start, 0.0) + np.append(0.0, at_end)
    cost_rate = 2 * costs / (np.append(h, 0.0) + np.append(0.0, h))
    return np.asarray(h * (costs.sum() / h.sum() - (cost_rate[1:] + cost_rate[:-1]) / 2))
