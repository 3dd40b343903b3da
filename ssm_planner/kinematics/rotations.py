"""Compute rotations by Rodrigues' formula in NumPy and CasADi, and check array arguments.

An error of a check names the argument, its shape and the required shape. Source: Murray, Li,
Sastry, A Mathematical Introduction to Robotic Manipulation, eq. 2.14.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.errors import GeometryError
from ssm_planner.typing import Array

if TYPE_CHECKING:
    import casadi


def cross_product_matrix(omega: ArrayLike) -> Array:
    """Return the matrix ω̂ (..., 3, 3) of the cross product: ω̂ a = ω × a, for ω (..., 3)."""
    omega = np.asarray(omega, dtype=float)
    x = omega[..., 0]
    y = omega[..., 1]
    z = omega[..., 2]
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def rodrigues_terms(omega: ArrayLike) -> Array:
    """Return the constant matrices E (3, 3, 3) of the rotations about a unit vector ω (3,).

    The rotation by θ is e^{ω̂θ} = E[0] + cos θ E[1] + sin θ E[2].
    """
    omega = np.asarray(omega, dtype=float)
    projection = np.outer(omega, omega)
    return np.stack((projection, np.eye(3) - projection, cross_product_matrix(omega)))


def rotation(omega: ArrayLike, angle: ArrayLike) -> Array:
    """Return the rotation matrices (..., 3, 3) about a unit axis (3,) by angles (...) in rad."""
    angle = np.asarray(angle, dtype=float)
    monomials = np.stack((np.ones_like(angle), np.cos(angle), np.sin(angle)), axis=-1)
    return np.tensordot(monomials, rodrigues_terms(omega), axes=1)


def rotation_symbolic(omega: Any, angle: Any) -> "casadi.SX":
    """Return the rotation matrix (3, 3) about a unit axis in CasADi.

    Parameters
    ----------
    omega : (3,) array or (3, 1) expression
        Unit axis.
    angle : float or expression
        Angle, rad.
    """
    import casadi

    if isinstance(omega, casadi.SX):
        projection = omega @ omega.T
        constant_term = projection
        cosine = casadi.SX.eye(3) - projection
        sine = casadi.skew(omega)
    else:
        constant_term, cosine, sine = map(casadi_constant, rodrigues_terms(omega))
    return constant_term + casadi.cos(angle) * cosine + casadi.sin(angle) * sine


def casadi_constant(value: Any) -> Any:
    """Convert an array to a sparse CasADi constant, and drop rounding errors of zero.

    CasADi expressions are returned unchanged.
    """
    import casadi

    if isinstance(value, casadi.SX):
        return value
    matrix = np.array(value, dtype=float)
    matrix[np.abs(matrix) < 1e-15 * np.abs(matrix).max(initial=0.0)] = 0.0
    return casadi.sparsify(casadi.DM(matrix))


def check_rows(name: str, value: ArrayLike, width: int) -> Array:
    """Check an argument, and return it as rows of finite numbers (n, width).

    A single row (width,) becomes a batch of one.

    Parameters
    ----------
    name : str
        Name of the argument. The error message contains it.
    value : array-like
        Value of the argument.
    width : int
        Required length of a row.

    Raises
    ------
    GeometryError
        If the shape is wrong or a value is not finite.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise GeometryError(f"{name} is not an array of numbers: {error}") from error
    if array.ndim == 1 and array.shape[0] == width:
        array = array[np.newaxis]
    if array.ndim != 2 or array.shape[1] != width:
        is_transposed = array.ndim == 2 and array.shape[0] == width
        hint = f"; it looks transposed: pass {name}.T" if is_transposed else ""
        raise GeometryError(f"{name} has shape {array.shape}: must be (n, {width}){hint}")
    check_finite(name, array)
    return array


def check_finite(name: str, array: Array) -> None:
    """Raise GeometryError with the index of the first value that is not finite.

    `name` is the name of the argument in the message. The array may have any shape.
    """
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise GeometryError(
            f"{name} of shape {array.shape} is not finite at {list(index)}: {array[index]}"
        )
