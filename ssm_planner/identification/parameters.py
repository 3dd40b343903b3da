"""Define the parameters of an identification and set them in a drive.

The parameters are those of `Friction`: the bearing friction b_c (Coulomb) and b_v (viscous) of the
motor side, b_oc and b_ov of the output side, and the coefficient mu of the gear mesh, which the
Stribeck laws extend by mu_stribeck and stribeck_speed. The preload of a nut may be fitted as well.
"""

from collections.abc import Mapping
from typing import cast

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
"""Names of two parameters: the change of ln friction during a session, and its time constant.

The time constant is a share of the duration of the session.
"""
MAP_PARAMETERS = (*FRICTION_PARAMETERS, "stribeck_speed", "preload")
"""Names of the parameters that can be fitted to a torque–velocity map or fixed by the user."""


def parameter_names(law: str) -> tuple[str, ...]:
    """Return the names of the parameters that are fitted by default for a friction law.

    Parameters
    ----------
    law : str
        Name of the law, one of `FRICTION_LAWS`.

    Returns
    -------
    tuple of str
        Fields of `Friction`.

    Raises
    ------
    RecordingError
        If the law is unknown.
    """
    if law not in FRICTION_LAWS:
        raise RecordingError(f"unknown friction law {law!r}; known: {', '.join(FRICTION_LAWS)}")
    base = ("b_c", "b_v", "mu", "b_oc")
    return base if law == "coulomb" else base + ("mu_stribeck", "stribeck_speed")


def drive_with_parameters(drive: Drive, law: str, values: Mapping[str, float]) -> Drive:
    """Return the drive with another friction law and other parameters.

    The values are not checked, so that arrays of them can represent many parameter sets at once.

    Parameters
    ----------
    drive : Drive
        Drive whose other data are copied.
    law : str
        One of `FRICTION_LAWS`.
    values : Mapping
        Parameters by name, in SI units: numbers, or (sets, 1) arrays. Parameters that are missing
        keep the value of the drive. A drive without friction has μ = `TYPICAL_MU` and no bearing
        friction. The Coulomb law removes the Stribeck term.

    Returns
    -------
    Drive
        The drive with these parameters.
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
    """Compute the motor torque of motion at constant speed.

    Parameters
    ----------
    drive : Drive
        Drive with its friction. Its parameters may be (sets, 1) arrays.
    w : (points,) array
        Motor speeds (rad/s).
    load : float or (sets, 1) array
        Constant effort on the output (N·m or N).

    Returns
    -------
    (points,) or (sets, points) array
        Motor torques (N·m). There is one row for each parameter set if the load or the friction is
        an array.
    """
    effort = output_effort(drive, load, w / drive.ratio, 0.0)
    return motor_torque(drive, effort, w, 0.0)


def smallest_locking_mu(drive: Drive) -> float:
    """Return the smallest friction coefficient that the fit permits for a self-locking drive.

    It is `_LOCKING_MU_FACTOR` times tan λ · cos θ_n, with the lead angle λ and the normal pressure
    angle θ_n. Below tan λ · cos θ_n, the output could drive the motor.

    Parameters
    ----------
    drive : Drive
        Drive with the geometry of its mesh.

    Returns
    -------
    float
        Friction coefficient (dimensionless). 0 for a drive that need not be self-locking.
    """
    if not drive.self_locking:
        return 0.0
    margin, *_ = self_locking_margin(drive, 0.0)
    return _LOCKING_MU_FACTOR * float(-margin)
