"""Reduced costs of joints at rest: the time that a motion would save if a joint moved.

The savings are of first order. At an optimum, a moving joint has Lagrange multipliers of the
constraint "u̇ keeps its direction". A joint j at rest has none, because it is not an unknown of the
program. Its reduced costs follow from the multipliers λ_k of the path constraints G(z_k) of the
elements k, with the function ℓ = Σ_k λ_kᵀ G(z_k). Let q̇_j be linear between its values v_k at the
ends of the elements, and let q_j be its integral. The reduced costs are c_k = ∂ℓ/∂v_k. A joint that
returns to its position satisfies Σ w_k v_k = 0 with the weights w_k of the trapezoidal rule. The
steepest descent of ℓ under this condition is v_k = mean − c_k / w_k, with the mean Σ c / Σ w. Its
size is the multiplier of "q̇_j = 0".
"""

from collections.abc import Sequence

import numpy as np

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
        Functions of one element (time interval), among them its r path constraints G(z).
    z : (n, size of z) array
        Vectors z of the elements: u, u̇, ü at the start, ü at the end (a number for each coordinate
        u of the motion), and the length of the element.
    parameters : sequence of arrays
        Constants of these functions, such as limits: (size,) for one vector that all elements
        share, otherwise (n, size).
    multipliers : (n, 3 r) array
        Multipliers λ of the r constraints at start, middle and end of each element.

    Returns
    -------
    (n, size of z) array
        ∂(λᵀ G)/∂z.
    """
    n, size = z.shape
    native = native_elements(element, parameters, n)
    if native is not None:
        jacobians = native.call("jacobian", z)
    else:
        columns = (np.broadcast_to(values, (n, values.shape[-1])).T for values in parameters)
        # CasADi returns the matrices of all elements side by side.
        matrices = element_functions(element).jacobian.map(n)(z.T, *columns)
        jacobians = matrices.full().reshape(-1, n, size).swapaxes(0, 1)
    return np.asarray(np.einsum("kr,krz->kz", multipliers, jacobians))


def steepest_descent(gradient: Array, lengths: Array) -> Array:
    """Compute the direction in which a joint at rest should move in order to save time.

    The function computes the velocities v_k of the module's docstring at the ends of the elements,
    and from them the velocity in the middle of each element.

    Parameters
    ----------
    gradient : (n, 3) array
        Derivatives of ℓ with respect to q, q̇ and q̈ of the joint.
    lengths : (n,) array
        Lengths of the elements in scaled time.

    Returns
    -------
    (n,) array
        Velocity in the middle of each element, times its length. It is positive if the joint
        should move forwards.
    """
    h, (by_position, by_velocity, by_acceleration) = lengths, gradient.T
    # The velocities v at the start and end of an element determine q̈ = (v_end − v_start) / h in it,
    # and shift the positions in all later elements by (v_start + v_end) h / 2.
    position_after = np.append(np.cumsum(by_position[::-1])[::-1], 0.0)[1:]
    at_start = by_velocity - by_acceleration / h + position_after * h / 2
    at_end = by_acceleration / h + position_after * h / 2
    # Reduced costs c_k at the n + 1 ends of the elements, and c_k / w_k.
    costs = np.append(at_start, 0.0) + np.append(0.0, at_end)
    cost_rate = 2 * costs / (np.append(h, 0.0) + np.append(0.0, h))
    return np.asarray(h * (costs.sum() / h.sum() - (cost_rate[1:] + cost_rate[:-1]) / 2))
