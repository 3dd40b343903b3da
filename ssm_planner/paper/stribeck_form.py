"""Stribeck's term as the package computes it, exp(−|w|/w_s)², and as a Gaussian, exp(−(w/w_s)²)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.identification.fit import fit_map
from ssm_planner.model.friction import friction_coefficient, friction_of, stribeck_shape
from ssm_planner.paper.rigs import RigResult, published_drive
from ssm_planner.problem.values import Drive

SPEEDS = (0.25, 0.5, 1.0, 2.0)
"""Motor speed by Stribeck speed at which μ is shown."""


@dataclass(frozen=True, eq=False)
class StribeckForms:
    """Of one rig with a published Stribeck term. Each pair: the package's form, the Gaussian."""

    title: str
    mu: tuple[tuple[float, float], ...]
    """At SPEEDS."""
    largest: tuple[float, float, float]
    """|w|/w_s at which the coefficients lie farthest apart, and both there."""
    published_nrmsd: tuple[float, float]
    """Of the map, with the published parameters."""
    fitted_nrmsd: tuple[float, float]
    fitted_speed: tuple[float, float]
    """w_s, rad/s."""
    criterion: tuple[float, float]
    """AICc of the two fits."""


def stribeck_forms(drive: Drive, result: RigResult) -> StribeckForms | None:
    """Both forms on one rig; None where its authors give no Stribeck speed."""
    pair = tuple(published_drive(drive, law) for law in ("stribeck_exponential", "stribeck_gaussian"))
    exponential, gaussian = pair
    speed = friction_of(exponential).stribeck_speed
    if not speed:
        return None
    x = np.linspace(0.0, 4.0, 4001)
    gap = np.abs(stribeck_shape("stribeck_gaussian", x) - stribeck_shape("stribeck_exponential", x))
    widest = float(x[int(np.argmax(gap))])
    other = fit_map(drive, result.data, result.rig.F_payload, law="stribeck_gaussian", reference=result.rig.published)
    fits = (result.fits["stribeck_exponential"], other)
    return StribeckForms(
        result.title,
        tuple((_mu(exponential, s * speed), _mu(gaussian, s * speed)) for s in SPEEDS),
        (widest, _mu(exponential, widest * speed), _mu(gaussian, widest * speed)),
        (result.map_nrmsd(exponential), result.map_nrmsd(gaussian)),
        (fits[0].nrmsd, fits[1].nrmsd),
        (fits[0].estimates["stribeck_speed"].value, fits[1].estimates["stribeck_speed"].value),
        (fits[0].criterion["stribeck_exponential"], fits[1].criterion["stribeck_gaussian"]),
    )


def _mu(drive: Drive, w: float) -> float:
    return float(friction_coefficient(friction_of(drive), w))
