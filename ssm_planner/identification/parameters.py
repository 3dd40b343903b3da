"""Define the parameters of an identification and set them in a drive."""

from collections.abc import Mapping
from typing import cast

from ssm_planner.dynamics import friction_coefficient, required_friction
from ssm_planner.dynamics.transmission import motor_torque, output_effort, self_locking_margin
from ssm_planner.errors import RecordingError
from ssm_planner.problem import (
    FRICTION_LAWS,
    LAW_PARAMETERS,
    Drive,
    Friction,
    FrictionLawName,
    unchecked_copy,
)
from ssm_planner.typing import Array, Keywords

TYPICAL_MU = 0.15
"""Assumed friction coefficient μ before the fit, for metal on greased metal or polymer.

It applies if the drive file does not state μ.
"""

_LOCKING_MU_FACTOR = 1.005
"""Ratio of the smallest fitted μ of a self-locking drive to the μ at which self-locking begins."""

FRICTION_PARAMETERS = ("b_c", "b_v", "mu", "b_oc", "b_ov", "mu_stribeck")
"""Parameters that change in proportion if friction changes during a session."""
CHANGE, WARM_UP = SESSION_CHANGE_PARAMETERS = ("change", "warm_up")
"""Change of ln friction during a session, and its time constant as a share of the session."""
MAP_PARAMETERS = (*FRICTION_PARAMETERS, "stribeck_speed", "preload")
"""Names of the parameters that can be fitted to a torque–velocity map or fixed by the user."""


def parameter_names(law: str) -> tuple[str, ...]:
    """Return the names of the parameters that are fitted by default for a friction law.

    Raises RecordingError for an unknown law.
    """
    if law not in FRICTION_LAWS:
        raise RecordingError(f"unknown friction law {law!r}; known: {', '.join(FRICTION_LAWS)}")
    base = ("b_c", "b_v", "mu", "b_oc")
    return base if law == "coulomb" else (*base, "mu_stribeck", "stribeck_speed")


def drive_with_parameters(drive: Drive, law: str, values: Mapping[str, float]) -> Drive:
    """Return the drive with another friction law and other parameters.

    Parameters
    ----------
    drive : Drive
        Drive whose other data are copied.
    law : str
        One of `FRICTION_LAWS`.
    values : Mapping
        Parameters by name, in SI units. Arrays represent many parameter sets at once.
    """
    friction: Keywords = {name: values[name] for name in LAW_PARAMETERS if name in values}
    base = drive.friction or Friction(mu=TYPICAL_MU, mu_static=TYPICAL_MU, b_c=0.0, b_v=0.0)
    if law == "coulomb":
        friction |= {"mu_stribeck": 0.0, "stribeck_speed": None}
    return unchecked_copy(
        drive,
        friction=unchecked_copy(base, law=cast(FrictionLawName, law), **friction),
        preload=values.get("preload", drive.preload),
    )


def map_torque(drive: Drive, w: Array, load: float | Array) -> Array:
    """Compute the motor torque in N·m of motion at constant speed.

    Parameters
    ----------
    drive : Drive
        Drive with its friction. Its parameters may be columns (sets, 1).
    w : (points,)
        Motor speeds, rad/s.
    load : float or (sets, 1)
        Constant effort on the output, N·m or N.

    Returns
    -------
    (points,) or (sets, points)
        Motor torques. There is one row for each parameter set if the load or the friction has
        columns.
    """
    effort = output_effort(drive, load, w / drive.ratio, 0.0)
    return motor_torque(drive, effort, w, 0.0)


def smallest_locking_mu(drive: Drive) -> float:
    """Return the smallest friction coefficient that the fit permits for a self-locking drive.

    It is slightly above tan λ · cos θ_n, with the lead angle λ and the normal pressure angle θ_n,
    below which the output could drive the motor. The result is 0 for other drives.
    """
    return (
        _LOCKING_MU_FACTOR * float(-self_locking_margin(drive, 0.0)[0])
        if drive.self_locking
        else 0.0
    )


def zero_speed_coefficient(drive: Drive) -> float:
    """Return the limit of the friction coefficient of a moving drive as its speed tends to 0.

    The static coefficient cannot be smaller.
    """
    return float(friction_coefficient(required_friction(drive), 0.0))
