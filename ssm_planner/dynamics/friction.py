"""Friction laws of the sliding mesh: the coefficient μ as a function of motor speed, dwell time and history."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.errors import ProblemError
from ssm_planner.problem.drive import Drive, Friction
from ssm_planner.typing import Array

STANDSTILL = 0.005
"""Motor speed at and below which a measured drive counts as standing still, rad/s (as in the authors' package)."""


def friction_of(drive: Drive) -> Friction:
    """The friction of a drive; ProblemError where it is still to be identified."""
    if drive.friction is None:
        raise ProblemError("its friction is still to be identified", file=drive.file, key="friction")
    return drive.friction


def stribeck_shape(law: str, x: Any) -> Any:
    """s(x) of μ(w) = mu + mu_stribeck · s(|w| / stribeck_speed): 0 for coulomb, exp(−2x), or exp(−x²).

    `stribeck_exponential` is exp(−2x), the form in which the authors' package states its Stribeck speeds.
    x ≥ 0 is an array or a CasADi expression.
    """
    if law == "stribeck_exponential":
        return math.e ** (-2.0 * x)
    if law == "stribeck_gaussian":
        return math.e ** (-(x * x))
    if law == "coulomb":
        return 0.0 * x
    raise ValueError(f"unknown friction law {law!r}")


def friction_coefficient(friction: Friction, w: Any) -> Any:
    """Kinetic coefficient of the mesh μ(|w|) at motor speed w (rad/s); array or CasADi expression in, the same out.

    At w = 0 it is the limit from motion, mu + mu_stribeck; breakaway uses `friction.mu_static`.
    """
    if friction.law == "coulomb" or friction.stribeck_speed is None:
        return friction.mu + 0.0 * w
    x = abs(w) / friction.stribeck_speed
    return friction.mu + friction.mu_stribeck * stribeck_shape(friction.law, x)


def static_coefficient(friction: Friction, dwell: ArrayLike, arrival: ArrayLike | None = None) -> Array:
    """Coefficient at breakaway after a rest of `dwell` seconds, shape of `dwell`.

    Rises from its value on arrival at rest (default mu) to mu_static as exp(−c / t_dwell); with no dwell constant c the
    rise is immediate.
    """
    dwell = np.asarray(dwell, dtype=float)
    start = np.asarray(friction.mu if arrival is None else arrival, dtype=float)
    grown = np.ones_like(dwell)
    if friction.dwell_constant is not None and friction.dwell_constant > 0:
        grown = np.where(dwell > 0, np.exp(-friction.dwell_constant / np.maximum(dwell, 1e-300)), 0.0)
    return start + (friction.mu_static - start) * grown


def remembered_speed(friction: Friction, time: ArrayLike, w: ArrayLike) -> Array:
    """The speed that friction feels: w delayed by the frictional memory, shape (samples,); time increasing, s."""
    time, w = np.asarray(time, dtype=float), np.asarray(w, dtype=float)
    if friction.memory == 0.0:
        return w
    return np.interp(time - friction.memory, time, w)
