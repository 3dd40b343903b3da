"""Reduced costs: estimates of the time that a motion would save if a joint at rest moved instead.

The estimates are of first order. A joint that moves has Lagrange multipliers of the constraint "its
velocity keeps its direction", and these multipliers are the savings. A joint j at rest is not an
unknown of the nonlinear program, so it lacks such multipliers. Its reduced costs follow from the
path constraints G(z_k) of the elements k (time intervals) and from their multipliers λ_k:

    ℓ = Σ_k λ_kᵀ G(z_k),   c_k = ∂ℓ/∂v_k

Here v_k is the velocity q̇_j at the end k of an element. q̇_j is linear in between, and q_j is its
integral. A joint that returns to its position satisfies Σ w_k v_k = 0 with the weights w_k of the
trapezoidal rule. The steepest descent of ℓ under this condition is

    v_k = Σ c / Σ w − c_k / w_k.

Its size is the multiplier of the constraint "q̇_j = 0".
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

    The weights λ are the Lagrange multipliers of the path constraints G.

    Parameters
    ----------
    element : ElementModel
        Functions of one element (time interval), among them its r path constraints. G(z) contains
        their values at the start, in the middle and at the end of the element.
    z : (n, 4 m + 1) array
        Vectors z of n elements: u, u̇, ü at the start and ü at the end (a number for each of m
        coordinates u), and the length of the element.
    parameters : sequence of arrays
        Parameter vectors of these functions, for example the limits: (size,) for a vector that all
        elements share, otherwise (n, size).
    multipliers : (n, 3 r) array
        Multipliers λ of the r constraints at start, middle and end of each element.

    Returns
    -------
    (n, 4 m + 1) array
        ∂(λᵀ G)/∂z of each element.
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
    # Sum over the constraints r for each element k and each entry of z.
    return np.asarray(np.einsum("kr,krz->kz", multipliers, jacobians))


def steepest_descent(gradient: Array, lengths: Array) -> Array:
    """Compute in which direction, and with which saving of time, a joint at rest should move.

    The joint returns to its position at the end of the motion. Under this condition, the velocities
    v_k of the joint at the ends of the elements (time intervals) are the steepest descent of ℓ, the
    sum of the path constraints weighted by their multipliers. The module's docstring states the
    formula.

    Parameters
    ----------
    gradient : (n, 3) array
        Derivatives of ℓ with respect to q, q̇ and q̈ of the joint in each of n elements.
    lengths : (n,) array
        Lengths of the elements in scaled time.

    Returns
    -------
    (n,) array
        Mean of the two v_k at the ends of each element, times the length of the element. To first
        order, it is the time saved for each unit of the joint's velocity in this element. It is
        positive if the joint should move forwards, and negative if it should move backwards.
    """
    h, (by_position, by_velocity, by_acceleration) = lengths, gradient.T
    # The velocities v at the start and end of an element determine q̈ = (v_end − v_start) / h in it,
    # and shift the positions in all later elements by (v_start + v_end) h / 2.
    position_after = np.append(np.cumsum(by_position[::-1])[::-1], 0.0)[1:]
    at_start = by_velocity - by_acceleration / h + position_after * h / 2
    at_end = by_acceleration / h + position_after * h / 2
    # Reduced costs c_k at the n + 1 ends of the elements, and c_k / w_k. The weight w_k is half the
    # sum of the lengths of both neighbouring elements.
    costs = np.append(at_start, 0.0) + np.append(0.0, at_end)
    cost_rate = 2 * costs / (np.append(h, 0.0) + np.append(0.0, h))
    return np.asarray(h * (costs.sum() / h.sum() - (cost_rate[1:] + cost_rate[:-1]) / 2))
