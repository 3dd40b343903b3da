"""Compute forward kinematics, Jacobians and tool speeds by the product of exponentials (eq. 2).

The equation numbers are those of the paper. The rotation e^{ω̂θ} about an axis ω is linear in the
terms 1, cos θ and sin θ. The orientation R of the tool is therefore a constant matrix times the 27
products of these terms for three joints. The tool axis and the columns of the Jacobian need the
nine products of two joints. One matrix product evaluates a block of configurations that fits into
the cache. Functions whose names end with _symbolic express the same equations for one configuration
in CasADi.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import casadi_constant, check_rows, rotation_symbolic
from ssm_planner.problem import SpeedLimit, TipSpeed
from ssm_planner.trajectory import blocks
from ssm_planner.typing import Array

if TYPE_CHECKING:
    import casadi


CONFIGURATIONS_PER_BLOCK = 1024
"""Number of configurations per block.

Temporary arrays then stay in the cache, and BLAS starts no threads.
"""


def forward(mechanism: Mechanism, q: ArrayLike) -> tuple[Array, Array]:
    """Compute the tool pose by forward kinematics (paper, eq. 2).

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (n, 4)
        Joint positions, rad and m.

    Returns
    -------
    R : (n, 3, 3)
        Rotations from the tool frame to the base frame.
    p : (n, 3)
        Tip positions in the base frame, m.

    Raises
    ------
    GeometryError
        If the shape is wrong or a value is not finite.
    """
    q = check_rows("q", q, 4)
    rotations = np.empty((len(q), 9))
    positions = np.empty((len(q), 3))
    for block in blocks(len(q), CONFIGURATIONS_PER_BLOCK):
        terms = [_trigonometric_terms(q[block, i]) for i in range(3)]
        _write_poses(
            mechanism,
            q[block, 3],
            _term_products(terms[0], terms[1]),
            terms[2],
            results=(rotations[block], positions[block]),
        )
    return rotations.reshape(-1, 3, 3), positions


def tip_position(mechanism: Mechanism, q: ArrayLike) -> Array:
    """Return the position p (n, 3) of the tool tip in the base frame, m, for joints q (n, 4)."""
    return forward(mechanism, q)[1]


def space_jacobian(mechanism: Mechanism, q: ArrayLike) -> Array:
    """Return the space Jacobian (n, 6, 4) for joint positions q (n, 4), rad and m.

    Column i is the twist (v, ω) of joint i in the base frame: ω is the angular velocity of the
    tool, and v is the velocity of the point of the tool that is at the origin, both for unit
    velocity of the joint. In the notation of Murray, Li and Sastry (eq. 3.54), it is Ad(e^{ξ̂1θ1} …
    e^{ξ̂(i−1)θ(i−1)}) ξ_i.
    """
    q = check_rows("q", q, 4)
    jacobians = np.empty((len(q), 24))
    space = _space_jacobian_terms(mechanism)
    for block in blocks(len(q), CONFIGURATIONS_PER_BLOCK):
        products = _term_products(
            _trigonometric_terms(q[block, 0]), _trigonometric_terms(q[block, 1])
        )
        np.matmul(products.T, space, out=jacobians[block])
    return jacobians.reshape(-1, 6, 4)


def _trigonometric_terms(angle: Array) -> Array:
    """Return the rows 1, cos θ and sin θ (3, n) for n angles θ in rad."""
    terms = np.empty((3, len(angle)))
    terms[0] = 1.0
    np.cos(angle, out=terms[1])
    np.sin(angle, out=terms[2])
    return terms


def _term_products(a: Array, b: Array) -> Array:
    """Return the products of each row of `a` with each row of `b`, (rows of a · rows of b, n)."""
    return (a[:, np.newaxis] * b[np.newaxis]).reshape(len(a) * len(b), -1)


def _write_poses(
    mechanism: Mechanism,
    theta4: Array,
    products_12: Array,
    terms_3: Array,
    *,
    results: tuple[Array, Array],
) -> None:
    """Compute orientations and tip positions, and write them into given arrays.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    theta4 : (n,)
        Positions of joint 4, m.
    products_12 : (9, n)
        Products of the terms (1, cos θ, sin θ) of joint 1 and joint 2.
    terms_3 : (3, n)
        Terms of joint 3.
    results : ((n, 9), (n, 3))
        Arrays that receive the rows of R one after the other, and the tip positions in m.
    """
    rotations, positions = results
    np.matmul(_term_products(products_12, terms_3).T, mechanism.orientation_terms, out=rotations)
    np.multiply(rotations[:, 2::3], theta4[:, np.newaxis], out=positions)


def _space_jacobian_terms(mechanism: Mechanism) -> Array:
    """Return the constant matrix (9, 24) that turns products of terms into space Jacobians.

    The 9 rows belong to the products of the terms (1, cos θ, sin θ) of joints 1 and 2, and the 24
    columns to the entries of a Jacobian (6, 4).
    """
    term_1, term_2, _ = mechanism.exponentials
    terms = np.zeros((3, 3, 6, 4))
    terms[0, 0, 3:, 0] = mechanism.omega1
    terms[:, 0, 3:, 1] = term_1 @ mechanism.omega2
    tool = np.einsum("aij,bjk,k->abi", term_1, term_2, mechanism.omega3)
    terms[:, :, 3:, 2] = tool
    terms[:, :, :3, 3] = tool
    return terms.reshape(9, 24)


def forward_symbolic(mechanism: Mechanism, q: "casadi.SX") -> "tuple[casadi.SX, casadi.SX]":
    """Return the tool pose (R (3, 3), p (3, 1)) in CasADi for joints q (4, 1) (paper, eq. 2).

    R rotates from the tool frame to the base frame, and p is the tip position in m.
    """
    rotation_1 = rotation_symbolic(mechanism.omega1, q[0])
    rotation_12 = rotation_1 @ rotation_symbolic(mechanism.omega2, q[1])
    rotation_3 = rotation_symbolic(mechanism.omega3, q[2])
    orientation = rotation_12 @ rotation_3 @ casadi_constant(mechanism.tool_home)
    position = rotation_12 @ casadi_constant(mechanism.omega3) * q[3]
    return orientation, position


def tip_position_symbolic(mechanism: Mechanism, q: "casadi.SX") -> "casadi.SX":
    """Return the tip position (3, 1) in the base frame, m, in CasADi for joints q (4, 1)."""
    return forward_symbolic(mechanism, q)[1]


def tip_jacobian(mechanism: Mechanism, q: "casadi.SX") -> "casadi.SX":
    """Return the Jacobian ∂p/∂q (3, 4) of the tip position p in CasADi for joints q (4, 1)."""
    import casadi

    return casadi.jacobian(tip_position_symbolic(mechanism, q), q)


SPEED_JACOBIANS: "dict[type[SpeedLimit], Callable[[Mechanism, casadi.SX], casadi.SX]]" = {
    TipSpeed: tip_jacobian
}
"""Jacobian J(q) (k, 4) of each kind of speed limit, as a function that returns a CasADi expression.

The limit applies to the speed |J(q) q̇|.
"""


def tool_speed(limit_type: type[SpeedLimit], mechanism: Mechanism, q: Array, qd: Array) -> Array:
    """Return the speed of the tool (n,) to which a kind of speed limit applies, in SI units.

    Parameters
    ----------
    limit_type : type of SpeedLimit
        Kind of limit. Its entry J in `SPEED_JACOBIANS` defines the speed |J(q) q̇|.
    mechanism : Mechanism
        Axes and tool frame.
    q, qd : (n, 4)
        Joint positions in rad and m, and joint velocities.
    """
    from ssm_planner.codegen import call

    return call(_tool_speed_function(limit_type, mechanism), q, qd)[0][:, 0]


def speed_bounds(limits: Iterable[SpeedLimit], unlimited: float) -> Array:
    """Return the largest permitted speeds (kinds,) in SI units, in the order of `SPEED_JACOBIANS`.

    Kinds of speed without a limit get the value `unlimited`.

    Raises
    ------
    ProblemError
        If `SPEED_JACOBIANS` lacks the kind of a limit.
    """
    bounds = {type(limit): limit.largest for limit in limits}
    for limit_type in bounds:
        if limit_type not in SPEED_JACOBIANS:
            raise ProblemError(f"kinematics/forward.py lacks a Jacobian for {limit_type.__name__}")
    return np.array([bounds.get(limit_type, unlimited) for limit_type in SPEED_JACOBIANS])


@lru_cache(maxsize=16)
def _tool_speed_function(limit_type: type[SpeedLimit], mechanism: Mechanism) -> "casadi.Function":
    """Build the CasADi function of q and qd (4,) that returns the limited speed."""
    import casadi

    q = casadi.SX.sym("q", 4)
    qd = casadi.SX.sym("qd", 4)
    velocity = SPEED_JACOBIANS[limit_type](mechanism, q) @ qd
    return casadi.Function("speed", [q, qd], [casadi.norm_2(velocity)])
