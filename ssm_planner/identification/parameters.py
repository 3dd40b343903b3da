"""The parameters an identification can vary, and their place in a drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from ssm_planner.dynamics.friction import friction_coefficient, friction_of
from ssm_planner.dynamics.transmission import motor_torque, output_effort, self_locking_margin
from ssm_planner.errors import RecordingError
from ssm_planner.problem.drive import Drive, Friction, FrictionLawName
from ssm_planner.problem.posterior import LAWS
from ssm_planner.problem.value import unchecked
from ssm_planner.typing import Array

TYPICAL_MU = 0.15
"""Sliding metal on greased metal or polymer: where a fit starts when the drive file gives no value."""

_ABOVE_CRITICAL = 1.005

_FRICTION_FIELDS = (
    "b_c",
    "b_v",
    "mu",
    "b_oc",
    "b_ov",
    "mu_stribeck",
    "stribeck_speed",
    "mu_static",
)
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


def map_torque(drive: Drive, w: Array, load: float | Array) -> Array:
    """Motor torque in steady motion at motor speeds w (points,) against the constant effort `load` on the output.

    load and the friction may hold columns (sets, 1); the torque is then (sets, points).
    """
    effort = output_effort(drive, load, w / drive.ratio, 0.0)
    return motor_torque(drive, effort, w, 0.0)


def locking_mu(drive: Drive) -> float:
    """Least coefficient of a drive that is relied on to lock itself, just above tan λ · cos θ_n; 0 for others."""
    return (
        _ABOVE_CRITICAL * float(-self_locking_margin(drive, 0.0)[0]) if drive.self_locking else 0.0
    )


def rest_coefficient(drive: Drive) -> float:
    """μ as w → 0 in motion: what breakaway cannot be below."""
    return float(friction_coefficient(friction_of(drive), 0.0))
