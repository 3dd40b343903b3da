"""Compute rotation matrices by Rodrigues' formula, and check array arguments.

The rotation by an angle θ about a unit vector ω is, by Rodrigues' formula (Murray, Li and Sastry, A
Mathematical Introduction to Robotic Manipulation, 1994, eq. 2.14),

    e^{ω̂θ} = 1 + ω̂ sin θ + ω̂² (1 − cos θ),

where ω̂ is the matrix of the cross product, ω̂ a = ω × a. `rotation` evaluates the formula with
NumPy, and `rotation_symbolic` with CasADi. `check_rows` and `check_finite` check the array
arguments of all functions of this package. Their messages name the argument and its shape.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.errors import GeometryError
from ssm_planner.typing import Array

if TYPE_CHECKING:
    import casadi


def cross_product_matrix(omega: ArrayLike) -> Array:
    """Build the skew-symmetric matrix of the cross product.

    The matrix ω̂ satisfies ω̂ a = ω × a for every vector a.

    Source: Murray, Li and Sastry, 1994, chapter 2.

    Parameters
    ----------
    omega : (..., 3) array
        Vectors ω.

    Returns
    -------
    (..., 3, 3) array
        One matrix for each vector.
    """
    omega = np.asarray(omega, dtype=float)
    x = omega[..., 0]
    y = omega[..., 1]
    z = omega[..., 2]
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def rodrigues_terms(omega: ArrayLike) -> Array:
    """Return the three constant matrices in Rodrigues' formula for one axis.

    Because ω̂² = ω ωᵀ − 1 for a unit vector ω, the rotation by an angle θ is

        e^{ω̂θ} = ω ωᵀ + cos θ (1 − ω ωᵀ) + sin θ ω̂.

    Functions that need many rotations about one axis multiply these matrices by (1, cos θ, sin θ).

    Parameters
    ----------
    omega : (3,) array
        Unit vector ω of the axis.

    Returns
    -------
    (3, 3, 3) array
        The matrices ω ωᵀ, 1 − ω ωᵀ and ω̂.
    """
    omega = np.asarray(omega, dtype=float)
    projection = np.outer(omega, omega)
    return np.stack((projection, np.eye(3) - projection, cross_product_matrix(omega)))


def rotation(omega: ArrayLike, angle: ArrayLike) -> Array:
    """Compute rotation matrices about one axis by Rodrigues' formula.

    See the equation of `rodrigues_terms`.

    Parameters
    ----------
    omega : (3,) array
        Unit vector of the axis.
    angle : (...) array
        Angles (rad).

    Returns
    -------
    (..., 3, 3) array
        One rotation matrix for each angle.
    """
    angle = np.asarray(angle, dtype=float)
    monomials = np.stack((np.ones_like(angle), np.cos(angle), np.sin(angle)), axis=-1)
    return np.tensordot(monomials, rodrigues_terms(omega), axes=1)


def angle_between(a: Array, b: Array) -> Array:
    """Compute the angles between pairs of orientations.

    Parameters
    ----------
    a, b : (n, 3, 3) arrays
        Rotation matrices.

    Returns
    -------
    (n,) array
        Angles in [0, π] (rad).

    Notes
    -----
    The Frobenius norm of a − b is √8 sin(θ/2), which is accurate for small angles θ.
    """
    return 2 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=(1, 2)) / 8**0.5, 1.0))


def rotation_symbolic(omega: Any, angle: Any) -> "casadi.SX":
    """Return the rotation matrix about one axis as a CasADi expression.

    It has the equation of `rodrigues_terms`.

    Parameters
    ----------
    omega : (3,) array or (3, 1) expression
        Unit vector of the axis.
    angle : float or expression
        Angle (rad).

    Returns
    -------
    (3, 3) expression
        Rotation matrix.
    """
    import casadi  # It takes long to import.

    if isinstance(omega, casadi.SX):
        projection = omega @ omega.T
        constant_term = projection
        cosine = casadi.SX.eye(3) - projection
        sine = casadi.skew(omega)
    else:
        constant_term, cosine, sine = map(casadi_constant, rodrigues_terms(omega))
    return constant_term + casadi.cos(angle) * cosine + casadi.sin(angle) * sine


def casadi_constant(value: Any) -> Any:
    """Convert an array to a sparse CasADi constant without the rounding errors of zeros.

    Entries below 1e-15 times the largest magnitude become zeros of the sparse matrix, so that they
    do not add operations to an expression.

    Parameters
    ----------
    value : array or expression
        Constant. A CasADi expression is returned unchanged.

    Returns
    -------
    casadi.DM or casadi.SX
        Sparse constant, or the unchanged expression.
    """
    import casadi  # It takes long to import.

    if isinstance(value, casadi.SX):
        return value
    matrix = np.array(value, dtype=float)
    matrix[np.abs(matrix) < 1e-15 * np.abs(matrix).max(initial=0.0)] = 0.0
    return casadi.sparsify(casadi.DM(matrix))


def check_rows(name: str, value: ArrayLike, width: int) -> Array:
    """Check an array argument, and return it as rows of finite numbers.

    Parameters
    ----------
    name : str
        Name of the argument. The error message contains it.
    value : (width,) or (n, width) array-like
        Value of the argument. A single row becomes a batch of one.
    width : int
        Required length of a row.

    Returns
    -------
    (n, width) array
        The same numbers.

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
    """Raise an error if an array contains a value that is not finite.

    Parameters
    ----------
    name : str
        Name of the argument. The error message contains it.
    array : (...) array
        Values in any shape.

    Raises
    ------
    GeometryError
        With the index of the first value that is not finite.
    """
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise GeometryError(
            f"{name} of shape {array.shape} is not finite at {list(index)}: {array[index]}"
        )
