"""The parameters an identification can vary: their meaning, bounds, first guesses and place in a drive."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from ssm_planner.dynamics.friction import friction_coefficient, friction_of
from ssm_planner.dynamics.transmission import mesh_coefficients, motor_torque, output_effort, self_locking_margin
from ssm_planner.errors import RecordingError
from ssm_planner.problem.drive import Drive, Friction, FrictionLawName
from ssm_planner.problem.value import unchecked
from ssm_planner.typing import Array

LAWS = ("coulomb", "stribeck_exponential", "stribeck_gaussian")

TYPICAL_MU = 0.15
"""Sliding metal on greased metal or polymer: where a fit starts when the drive file gives no value."""

_ABOVE_CRITICAL = 1.005
"""A drive known to lock itself has at least this many times the coefficient at which it just would."""

_FRICTION_FIELDS = ("b_c", "b_v", "mu", "b_oc", "b_ov", "mu_stribeck", "stribeck_speed", "mu_static")
ALL = (*_FRICTION_FIELDS[:-1], "preload")
"""Names that can be identified from a map or fixed."""


def names_of(law: str) -> tuple[str, ...]:
    """Parameters that a law fits by default; the others stay as the drive gives them."""
    if law not in LAWS:
        raise RecordingError(f"unknown friction law {law!r}; known: {', '.join(LAWS)}")
    base = ("b_c", "b_v", "mu", "b_oc")
    return base if law == "coulomb" else (*base, "mu_stribeck", "stribeck_speed")


def with_parameters(drive: Drive, law: str, values: Mapping[str, float]) -> Drive:
    """The drive with friction law and parameters replaced; values may be arrays that broadcast over many sets."""
    friction: dict[str, Any] = {name: values[name] for name in _FRICTION_FIELDS if name in values}
    base = drive.friction or Friction(mu=TYPICAL_MU, mu_static=TYPICAL_MU, b_c=0.0, b_v=0.0)
    if law == "coulomb":
        friction |= {"mu_stribeck": 0.0, "stribeck_speed": None}
    return unchecked(
        drive,
        friction=unchecked(base, law=cast(FrictionLawName, law), **friction),
        preload=values.get("preload", drive.preload),
    )


def map_torque(drive: Drive, w: Array, load: float) -> Array:
    """Motor torque in steady motion at motor speeds w (points,) against the constant effort `load` on the output."""
    effort = output_effort(drive, load, w / drive.ratio, 0.0)
    return motor_torque(drive, effort, w, 0.0)


def bounds(drive: Drive, w: Array, tau: Array) -> dict[str, tuple[float, float]]:
    """Physical bounds by name from a map (points,): nothing negative, nothing that alone exceeds the measured torque.

    The coefficient of a drive that is known to lock itself stays above tan λ · cos θ_n.
    """
    largest, fastest, slowest = float(np.abs(tau).max()), float(np.abs(w).max()), float(np.abs(w).min())
    up, _ = mesh_coefficients(drive, 0.0)
    effort = largest / up
    lowest_mu = _ABOVE_CRITICAL * float(-self_locking_margin(drive, 0.0)[0]) if drive.self_locking else 0.0
    return {
        "b_c": (0.0, largest),
        "b_v": (0.0, largest / fastest),
        "mu": (lowest_mu, min(1.0, 0.9 * math.cos(drive.pressure_angle) / math.tan(drive.lead_angle))),
        "b_oc": (0.0, effort),
        "b_ov": (0.0, effort * drive.ratio / fastest),
        "mu_stribeck": (0.0, 1.0),
        "stribeck_speed": (max(0.5 * slowest, 1e-3 * fastest), 2.0 * fastest),
        "preload": (0.0, effort),
    }


def first_guess(drive: Drive, w: Array, tau: Array, load: float, reference: Mapping[str, float]) -> dict[str, float]:
    """Where a fit to a map (points,) starts: reference values where there are any, else typical ones."""
    fastest = float(np.abs(w).max())
    friction = 0.5 * float(np.mean(np.abs(tau)))
    return {
        "b_c": 0.3 * friction,
        "b_v": 0.2 * friction / fastest,
        "mu": TYPICAL_MU,
        "b_oc": 0.1 * max(abs(load), friction / float(mesh_coefficients(drive, TYPICAL_MU)[0])),
        "b_ov": 0.0,
        "mu_stribeck": 0.05,
        "stribeck_speed": 0.1 * fastest,
        "preload": drive.preload,
    } | dict(reference)


def rest_coefficient(drive: Drive) -> float:
    """μ as w → 0 in motion: what breakaway cannot be below."""
    return float(friction_coefficient(friction_of(drive), 0.0))
