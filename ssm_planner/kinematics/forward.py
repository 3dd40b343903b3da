"""Compute forward kinematics, Jacobians and tool speeds by the product of exponentials (eq. 2).

The equation numbers are those of the paper. The rotation e^{ω̂θ} about an axis ω is linear in the
terms 1, cos θ and sin θ. The orientation R of the tool is therefore a constant matrix times the 27
products of these terms for three joints. One matrix product evaluates a block of configurations
that fits into the cache. Functions whose names end with _symbolic express the same equations for
one configuration in CasADi.
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
    """Compute the tool poses for joint positions (paper, eq. 2).

    With the rotations e^{ω̂_i θ_i} about the axes ω_i of joints i = 1, 2, 3 and the position θ4 of
    the sliding joint, the product of exponentials gives

        R = e^{ω̂1 θ1} e^{ω̂2 θ2} e^{ω̂3 θ3} R_0
        p = θ4 e^{ω̂1 θ1} e^{ω̂2 θ2} ω3,

    where R_0 is the orientation of the tool at q = 0. The origin is the remote centre of motion.

    Parameters
    ----------
    mechanism : Mechanism
        Axes ω1, ω2 and ω3, and the orientation R_0 (`tool_home`).
    q : (n, 4) array
        Joint positions θ1 to θ4 (rad, and m for joint 4).

    Returns
    -------
    R : (n, 3, 3) array
        Rotations from the tool frame to the base frame.
    p : (n, 3) array
        Tip positions in the base frame (m).

    Raises
    ------
    GeometryError
        If the shape is wrong or a value is not finite.
    """
    q = check_rows("q", q, 4)
    rotations = np.empty((len(q), 9))
    positions = np.empty((len(q), 3))
    for block in blocks(len(q), CONFIGURATIONS_PER_BLOCK):
        terms_1, terms_2, terms_3 = (_trigonometric_terms(q[block, i]) for i in range(3))
        products = _term_products(_term_products(terms_1, terms_2), terms_3)
        np.matmul(products.T, mechanism.orientation_terms, out=rotations[block])
        # The z column of the orientation is the tool axis.
        np.multiply(rotations[block, 2::3], q[block, 3:], out=positions[block])
    return rotations.reshape(-1, 3, 3), positions


def tip_position(mechanism: Mechanism, q: ArrayLike) -> Array:
    """Compute the positions of the tool tip for joint positions (paper, eq. 2).

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (n, 4) array
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    (n, 3) array
        Tip positions p of `forward` in the base frame (m).
    """
    return forward(mechanism, q)[1]


def space_jacobian(mechanism: Mechanism, q: ArrayLike) -> Array:
    """Compute the space Jacobian of the tool.

    Source: Murray, Li and Sastry, 1994, eq. 3.54.

    Column i is the twist (v, ω) of the tool in the base frame for unit velocity of joint i. ω is
    the angular velocity of the tool, and v is the velocity of the point of the tool that coincides
    with the origin. With a2 = e^{ω̂1 θ1} ω2 and the tool axis a3 = e^{ω̂1 θ1} e^{ω̂2 θ2} ω3, the
    columns are (0, ω1), (0, a2), (0, a3) and (a3, 0), because the three revolute axes pass through
    the origin.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (n, 4) array
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    (n, 6, 4) array
        Jacobians. Rows 0 to 2 belong to v and rows 3 to 5 to ω.
    """
    q = check_rows("q", q, 4)
    jacobians = np.zeros((len(q), 6, 4))
    tool = forward(mechanism, q)[0][:, :, 2]
    jacobians[:, 3:, 0] = mechanism.omega1
    term_1 = mechanism.exponentials[0]
    jacobians[:, 3:, 1] = _trigonometric_terms(q[:, 0]).T @ (term_1 @ mechanism.omega2)
    jacobians[:, 3:, 2] = tool
    jacobians[:, :3, 3] = tool
    return jacobians


def _trigonometric_terms(angle: Array) -> Array:
    """Return the terms 1, cos θ and sin θ in which a rotation about one axis is linear.

    Parameters
    ----------
    angle : (n,) array
        Angles θ (rad).

    Returns
    -------
    (3, n) array
        Rows of ones, cosines and sines.
    """
    terms = np.empty((3, len(angle)))
    terms[0] = 1.0
    np.cos(angle, out=terms[1])
    np.sin(angle, out=terms[2])
    return terms


def _term_products(a: Array, b: Array) -> Array:
    """Compute the product of each row of one array with each row of another.

    Parameters
    ----------
    a : (k, n) array
        Terms of one joint, or products of the terms of several joints.
    b : (m, n) array
        Terms of another joint.

    Returns
    -------
    (k · m, n) array
        Products. Row i · m + j is a[i] · b[j].
    """
    return (a[:, np.newaxis] * b[np.newaxis]).reshape(len(a) * len(b), -1)


def forward_symbolic(mechanism: Mechanism, q: "casadi.SX") -> "tuple[casadi.SX, casadi.SX]":
    """Return the tool pose for one configuration as CasADi expressions (paper, eq. 2).

    The equations are those of `forward`.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (4, 1) expression
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    R : (3, 3) expression
        Rotation from the tool frame to the base frame.
    p : (3, 1) expression
        Tip position in the base frame (m).
    """
    rotation_1 = rotation_symbolic(mechanism.omega1, q[0])
    rotation_12 = rotation_1 @ rotation_symbolic(mechanism.omega2, q[1])
    rotation_3 = rotation_symbolic(mechanism.omega3, q[2])
    orientation = rotation_12 @ rotation_3 @ casadi_constant(mechanism.tool_home)
    position = rotation_12 @ casadi_constant(mechanism.omega3) * q[3]
    return orientation, position


def tip_position_symbolic(mechanism: Mechanism, q: "casadi.SX") -> "casadi.SX":
    """Return the tip position of one configuration as a CasADi expression.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (4, 1) expression
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    (3, 1) expression
        Tip position p of `forward_symbolic` in the base frame (m).
    """
    return forward_symbolic(mechanism, q)[1]


def tip_jacobian(mechanism: Mechanism, q: "casadi.SX") -> "casadi.SX":
    """Build the Jacobian of the tip position as a CasADi expression.

    It is ∂p/∂q for one configuration.

    Parameters
    ----------
    mechanism : Mechanism
        Axes and tool frame.
    q : (4, 1) symbol
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    (3, 4) expression
        Jacobian (m/rad for joints 1 to 3, and without a unit for joint 4).
    """
    import casadi  # It takes long to import.

    return casadi.jacobian(tip_position_symbolic(mechanism, q), q)


SPEED_JACOBIANS: "dict[type[SpeedLimit], Callable[[Mechanism, casadi.SX], casadi.SX]]" = {
    TipSpeed: tip_jacobian
}
"""Jacobian J(q) (k, 4) of each kind of speed limit, as a function that returns a CasADi expression.

The limit applies to the speed |J(q) q̇|.
"""


def tool_speed(limit_type: type[SpeedLimit], mechanism: Mechanism, q: Array, qd: Array) -> Array:
    """Compute the speed of the tool to which a kind of speed limit applies.

    The speed is |J(q) q̇| with the Jacobian J of the limit in `SPEED_JACOBIANS`.

    Parameters
    ----------
    limit_type : type of SpeedLimit
        Kind of limit, such as TipSpeed.
    mechanism : Mechanism
        Axes and tool frame.
    q : (n, 4) array
        Joint positions (rad, and m for joint 4).
    qd : (n, 4) array
        Joint velocities (rad/s, and m/s for joint 4).

    Returns
    -------
    (n,) array
        Speeds in SI units, for TipSpeed in m/s.
    """
    from ssm_planner.codegen import call  # It imports CasADi, which takes long.

    return call(_tool_speed_function(limit_type, mechanism), q, qd)[0][:, 0]


def speed_bounds(limits: Iterable[SpeedLimit], unlimited: float) -> Array:
    """Return the largest permitted speed for each kind of speed limit.

    Parameters
    ----------
    limits : iterable of SpeedLimit
        Limits of a problem.
    unlimited : float
        Value for kinds of speed without a limit.

    Returns
    -------
    (k,) array
        Largest speeds in SI units, in the order of the k kinds in `SPEED_JACOBIANS`.

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
    """Build the CasADi function that computes the speed of the tool for one configuration.

    Its arguments are q (4,) and q̇ (4,), and its result is the scalar |J(q) q̇|.

    Parameters
    ----------
    limit_type : type of SpeedLimit
        Kind of limit.
    mechanism : Mechanism
        Axes and tool frame.

    Returns
    -------
    casadi.Function
        Function of q and q̇.
    """
    import casadi  # It takes long to import.

    q = casadi.SX.sym("q", 4)
    qd = casadi.SX.sym("qd", 4)
    velocity = SPEED_JACOBIANS[limit_type](mechanism, q) @ qd
    return casadi.Function("speed", [q, qd], [casadi.norm_2(velocity)])
