"""Define the parameters of an identification and set them in a drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from ssm_planner.dynamics import friction_coefficient, friction_of
from ssm_planner.dynamics.transmission import motor_torque, output_effort, self_locking_margin
from ssm_planner.errors import RecordingError
from ssm_planner.problem import LAWS, Drive, Friction, FrictionLawName, unchecked
from ssm_planner.typing import Array, Keywords

TYPICAL_MU = 0.15
"""Prior centre of μ if the drive file omits it, for metal on greased metal or polymer."""

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
"""Names of parameters that a map can determine or that can be fixed."""


def names_of(law: str) -> tuple[str, ...]:
    """Return the parameters that are fitted by default for a law."""
    if law not in LAWS:
        raise RecordingError(f"unknown friction law {law!r}; known: {', '.join(LAWS)}")
    base = ("b_c", "b_v", "mu", "b_oc")
    return base if law == "coulomb" else (*base, "mu_stribeck", "stribeck_speed")


def with_parameters(drive: Drive, law: str, values: Mapping[str, float]) -> Drive:
    """Return the drive with another friction law and other parameters.

    `values` contains the parameters by name, in SI units. Arrays represent many sets at once.
    """
    friction: Keywords = {name: values[name] for name in _FRICTION_FIELDS if name in values}
    base = drive.friction or Friction(mu=TYPICAL_MU, mu_static=TYPICAL_MU, b_c=0.0, b_v=0.0)
    if law == "coulomb":
        friction |= {"mu_stribeck": 0.0, "stribeck_speed": None}
    return unchecked(
        drive,
        friction=unchecked(base, law=cast(FrictionLawName, law), **friction),
        preload=values.get("preload", drive.preload),
    )


def map_torque(drive: Drive, w: Array, load: float | Array) -> Array:
    """Return the motor torque in N·m of steady motion at motor speeds w (points,) in rad/s.

    `load` is the constant effort on the output, N·m or N. If the load or the friction contains
    columns (sets, 1), the torque has the shape (sets, points).
    """
    effort = output_effort(drive, load, w / drive.ratio, 0.0)
    return motor_torque(drive, effort, w, 0.0)


def locking_mu(drive: Drive) -> float:
    """Return the smallest μ with which a self-locking drive locks, slightly above tan λ · cos θ_n.

    The result is 0 for other drives.
    """
    return (
        _ABOVE_CRITICAL * float(-self_locking_margin(drive, 0.0)[0]) if drive.self_locking else 0.0
    )


def rest_coefficient(drive: Drive) -> float:
    """Return the limit of μ for a moving drive as w → 0.

    The static coefficient is at least this value.
    """
    return float(friction_coefficient(friction_of(drive), 0.0))
