"""Friction laws of the sliding mesh: the coefficient μ as a function of motor speed, dwell time and history."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import namespace_of
from ssm_planner.errors import ProblemError
from ssm_planner.problem.drive import Drive, Friction
from ssm_planner.problem.posterior import LAWS
from ssm_planner.typing import Array, Expression

STANDSTILL = 0.005
"""Motor speed at and below which a measured drive counts as standing still, rad/s (as in the authors' package)."""


def friction_of(drive: Drive) -> Friction:
    """The friction of a drive; ProblemError where it is still to be identified."""
    if drive.friction is None:
        raise ProblemError(
            "its friction is still to be identified", file=drive.file, key="friction"
        )
    return drive.friction


def stribeck_shape(law: str | Array, x: Expression) -> Expression:
    """s(x) of μ(w) = mu + mu_stribeck · s(|w| / stribeck_speed): 0 for coulomb, exp(−2x), or exp(−x²).

    law: its name, or for many sets at once an array of numbers in LAWS that broadcasts against x.

    `stribeck_exponential` is exp(−2x), the form in which the authors' package states its Stribeck speeds.
    x ≥ 0 is an array or a CasADi expression.
    """
    if isinstance(law, np.ndarray):
        return sum(np.where(law == k, stribeck_shape(name, x), 0.0) for k, name in enumerate(LAWS))
    if law == "stribeck_exponential":
        return math.e ** (-2.0 * x)
    if law == "stribeck_gaussian":
        return math.e ** (-(x * x))
    if law == "coulomb":
        return 0.0 * x
    raise ValueError(f"unknown friction law {law!r}")


def friction_coefficient(friction: Friction, w: Expression) -> Expression:
    """Kinetic coefficient of the mesh μ(|w|) at motor speed w (rad/s); array or CasADi expression in, the same out.

    At w = 0 it is the limit from motion, mu + mu_stribeck; where a drive starts, `breakaway_coefficient` applies.
    """
    if friction.stribeck_speed is None:
        return friction.mu + 0.0 * w
    x = abs(w) / friction.stribeck_speed
    return friction.mu + friction.mu_stribeck * stribeck_shape(friction.law, x)


def breakaway_coefficient(friction: Friction, w: Expression = 0.0) -> Expression:
    """Coefficient where a drive starts to move, shape of w: the larger of the kinetic one at w (rad/s) and mu_static."""
    return namespace_of(w).maximum(friction_coefficient(friction, w), friction.mu_static)


def static_coefficient(
    friction: Friction, dwell: Expression, arrival: Expression | None = None
) -> Expression:
    """Coefficient at breakaway after a rest of `dwell` seconds, shape of `dwell`; arrays or CasADi expressions.

    Rises from its value on arrival at rest (default mu) to mu_static as exp(−c / t_dwell); with no dwell constant c the
    rise is immediate.
    """
    start = friction.mu if arrival is None else arrival
    xp = namespace_of(dwell, start)
    # shorter rests than any count as none: the exponential is 0 there
    grown = xp.exp(-(friction.dwell_constant or 0.0) / xp.maximum(dwell, 1e-9))
    return start + (friction.mu_static - start) * grown


def remembered_speed(friction: Friction, time: ArrayLike, w: ArrayLike) -> Array:
    """The speed that friction feels: w delayed by the frictional memory, shape (samples,); time increasing, s."""
    time, w = np.asarray(time, dtype=float), np.asarray(w, dtype=float)
    if friction.memory == 0.0:
        return w
    return np.interp(time - friction.memory, time, w)
