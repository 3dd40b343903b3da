"""The bounds within which the package's scripts identify the rigs, and published parameters that lie outside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ssm_planner.problem.values import Drive

_NONE, _SUPPORT = (0.0, 0.0), (1e-5, 1e-3)

BOUNDS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "rig1_lead_screw": {
        "preload": _NONE,
        "b_c": (1e-3, 1e-2),
        "b_v": _SUPPORT,
        "b_oc": (1e-3, 5e-2),
        "b_ov": (0.0, 1e-5),
        "mu": (0.20, 0.21),
        "mu_stribeck": (0.0, 0.08),
        "stribeck_speed": (0.0, 15.0),
        "dwell_constant": _NONE,
        "memory": _NONE,
    },
    "rig2_antibacklash_screw": {
        "preload": (0.5, 1.5),
        "b_c": (1e-5, 1e-2),
        "b_v": _SUPPORT,
        "b_oc": (1e-5, 5e-2),
        "b_ov": (0.0, 1e-5),
        "mu": (0.15, 0.27),
        "mu_stribeck": (0.0, 0.2),
        "stribeck_speed": (0.0, 15.0),
        "dwell_constant": _NONE,
        "memory": _NONE,
    },
    "rig3_worm": {
        "preload": _NONE,
        "b_c": (1e-4, 1e-3),
        "b_v": _SUPPORT,
        "b_oc": (1e-5, 1e-2),
        "b_ov": (0.0, 1e-5),
        "mu": (0.12, 0.16),
        "mu_stribeck": (0.0, 0.1),
        "stribeck_speed": (0.0, 1.0),
        "dwell_constant": _NONE,
        "memory": (0.0, 0.25),
    },
}
"""Lower and upper bound by rig and parameter, SI (sd_1dof.m of the package)."""


@dataclass(frozen=True)
class Outside:
    """A published parameter that the package's own identification cannot return; SI."""

    rig: str
    parameter: str
    value: float
    bounds: tuple[float, float]


def outside_bounds(name: str, drive: Drive) -> tuple[Outside, ...]:
    """Published parameters of a rig outside the package's bounds."""
    published = {} if drive.rig is None else drive.rig.published
    return tuple(
        Outside(drive.name, parameter, published[parameter], bounds)
        for parameter, bounds in BOUNDS[name].items()
        if parameter in published and not bounds[0] <= published[parameter] <= bounds[1]
    )
