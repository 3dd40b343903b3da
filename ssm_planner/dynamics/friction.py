"""Friction laws of the sliding mesh.

The coefficient μ depends on the motor speed, the dwell time at rest, and the recent motion.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen import namespace_of
from ssm_planner.errors import ProblemError
from ssm_planner.problem import FRICTION_LAWS, Drive, Friction
from ssm_planner.typing import Array, Expression

STANDSTILL_SPEED = 0.005
"""Largest motor speed at which a measured drive counts as resting, rad/s (authors' package)."""


def required_friction(drive: Drive) -> Friction:
    """Return the friction of a drive, which must have been identified.

    Parameters
    ----------
    drive : Drive
        The drive.

    Returns
    -------
    Friction
        Parameters of its friction law.

    Raises
    ------
    ProblemError
        If the friction has not been identified yet.
    """
    if drive.friction is None:
        raise ProblemError(
            "its friction is still to be identified", file=drive.file, key="friction"
        )
    return drive.friction


def stribeck_shape(law: str | Array, x: Expression) -> Expression:
    """Compute how friction falls from its value at low speed as the speed grows (Stribeck effect).

    The shape s multiplies the term mu_stribeck of the friction coefficient. It is 0 for `coulomb`,
    exp(−2x) for `stribeck_exponential`, as in the authors' package, and exp(−x²) for
    `stribeck_gaussian`.

    Parameters
    ----------
    law : str or array of int
        Name of the law. An array of indices in `FRICTION_LAWS` evaluates many laws at once. It
        broadcasts against x.
    x : array or CasADi expression
        Values ≥ 0 of |w| / stribeck_speed, with the motor speed w.

    Returns
    -------
    array or expression
        Shape s, from 0 to 1.
    """
    if isinstance(law, np.ndarray):
        return sum(
            np.where(law == k, stribeck_shape(name, x), 0.0) for k, name in enumerate(FRICTION_LAWS)
        )
    if law == "stribeck_exponential":
        return math.e ** (-2.0 * x)
    if law == "stribeck_gaussian":
        return math.e ** (-(x * x))
    if law == "coulomb":
        return 0.0 * x
    raise ValueError(f"unknown friction law {law!r}")


def friction_coefficient(friction: Friction, w: Expression) -> Expression:
    """Compute the kinetic friction coefficient μ(w) of the mesh at a motor speed w.

        μ(w) = mu + mu_stribeck · s(|w| / stribeck_speed),

    where s is the function of `stribeck_shape` for the law of the drive. A law without a
    stribeck_speed has the constant coefficient mu.

    Parameters
    ----------
    friction : Friction
        Parameters of the friction law.
    w : float, array or expression
        Motor speed (rad/s). At w = 0, the result is the limit for a moving drive, mu + mu_stribeck.
        For a drive that starts to move, use `breakaway_coefficient`.

    Returns
    -------
    float, array or expression with the shape of w
        Friction coefficients.
    """
    if friction.stribeck_speed is None:
        return friction.mu + 0.0 * w
    x = abs(w) / friction.stribeck_speed
    return friction.mu + friction.mu_stribeck * stribeck_shape(friction.law, x)


def breakaway_coefficient(friction: Friction, w: Expression = 0.0) -> Expression:
    """Compute the friction coefficient at which a drive starts to move.

    Parameters
    ----------
    friction : Friction
        Parameters of the friction law.
    w : float, array or expression
        Motor speed (rad/s), which is 0 or very small.

    Returns
    -------
    float, array or expression with the shape of w
        The larger of mu_static and the kinetic coefficient at w.
    """
    return namespace_of(w).maximum(friction_coefficient(friction, w), friction.mu_static)


def static_coefficient(
    friction: Friction, dwell: Expression, arrival: Expression | None = None
) -> Expression:
    """Compute the friction coefficient at breakaway, which grows with the time at rest.

        μ_s(t_d) = μ_a + (mu_static − μ_a) · exp(−c / t_d),

    where t_d is the time at rest, μ_a the coefficient on arrival, and c the dwell constant of the
    drive (Mablekos-Alexiou, da Cruz and Bergeles, 2021). Without a dwell constant, the coefficient
    is mu_static after any rest.

    Parameters
    ----------
    friction : Friction
        Parameters of the friction law.
    dwell : float, array or expression
        Time t_d at rest (s).
    arrival : float, array or expression, optional
        Friction coefficient μ_a when the motion ended. The default is mu.

    Returns
    -------
    float, array or expression
        Friction coefficients between μ_a and mu_static.
    """
    start = friction.mu if arrival is None else arrival
    xp = namespace_of(dwell, start)
    # The exponential is 0 for extremely short rests, so the smallest divisor does not matter.
    growth = xp.exp(-(friction.dwell_constant or 0.0) / xp.maximum(dwell, 1e-9))
    return start + (friction.mu_static - start) * growth


def delayed_speed(friction: Friction, time: ArrayLike, w: ArrayLike) -> Array:
    """Compute the speed that determines the friction of a drive with frictional memory.

    Friction follows a change of the speed after a delay. The result at a time t is therefore the
    speed at the time t − memory, which is interpolated linearly.

    Parameters
    ----------
    friction : Friction
        Parameters of the friction law. `memory` is the delay (s).
    time : (samples,) array
        Increasing times (s).
    w : (samples,) array
        Motor speeds (rad/s).

    Returns
    -------
    (samples,) array
        Delayed motor speeds (rad/s).
    """
    time = np.asarray(time, dtype=float)
    w = np.asarray(w, dtype=float)
    if friction.memory == 0.0:
        return w
    return np.interp(time - friction.memory, time, w)
