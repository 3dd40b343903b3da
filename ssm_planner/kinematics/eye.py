"""The eye about the remote centre: how far the tip is from the retina, and how the shaft passes the lens.

The remote centre is the origin of the base frame. Written once for NumPy arrays and CasADi expressions: `xp` is
namespace.NUMPY or namespace.casadi_namespace(), `tip` holds the three components of the tip position in the base
frame, m, arrays of one shape or expressions; values have the shape of a component.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ssm_planner.codegen.namespace import Namespace
from ssm_planner.problem.limits import LensClearance, RetinaClearance
from ssm_planner.problem.problem import Eye, Lens

NO_LENGTH = 1e-12
"""Square of the scaled length below which a shaft is a point and has no direction."""


def retina_distance(xp: Namespace, eye: Eye, tip: Any) -> Any:
    """Distance of the tip from the retina, m; must be at least eye.clearance.

    max(R − |p − c|, clearance + port − |p|): within the distance `port` of the remote centre there is no retina. It is
    continuous, with kinks: for judging; optimisation takes retina_row where the tip is beyond the port.
    """
    inside = eye.radius - xp.sqrt(_square(_minus(tip, eye.centre)))
    at_port = eye.clearance + eye.port - xp.sqrt(_square(tip))
    return xp.where(inside > at_port, inside, at_port)


def lens_ratio(xp: Namespace, lens: Lens, tip: Any) -> Any:
    """ρ: the lens enlarged ρ times about its centre just touches the shaft's axis; must be at least lens_limit.

    The shaft inside the eye is the segment from the remote centre to the tip. Scaled by the semi-axes the lens is the
    unit ball, and ρ the distance of the segment from its centre.
    """
    return xp.sqrt(_lens_square(xp, lens, tip))


def lens_limit(eye: Eye) -> float:
    """Least ρ for the eye's shaft_radius r: 1 + r/a with the smallest semi-axis a; 1 without a lens.

    The lens E contains a ball of radius a, so a ball of radius r lies in (r/a) E, and E + (r/a) E = (1 + r/a) E because
    E is convex. An axis outside (1 + r/a) E is therefore at least r away from E; beside the longer semi-axes, further.
    """
    return (
        1.0
        if eye.lens is None
        else LensClearance(eye.shaft_radius, float(np.min(eye.lens.semi_axes))).low
    )


def eye_limits(xp: Namespace, eye: Eye, tip: Any) -> dict[str, tuple[Any, float]]:
    """(value, least value allowed) by the name of the limit: retina in m and, where there is one, lens as ρ."""
    limits = {RetinaClearance.name: (retina_distance(xp, eye, tip), eye.clearance)}
    if eye.lens is not None:
        limits[LensClearance.name] = (lens_ratio(xp, eye.lens, tip), lens_limit(eye))
    return limits


def retina_row(xp: Namespace, eye: Eye, tip: Any) -> Any:
    """A row ≤ 0, smooth, no unit: |p − c|²/(R − clearance)² − 1, for a tip beyond the port."""
    return _square(_minus(tip, eye.centre)) / (eye.radius - eye.clearance) ** 2 - 1.0


def lens_row(xp: Namespace, eye: Eye, lens: Lens, tip: Any) -> Any:
    """A row ≤ 0, no unit: 1 − (ρ / lens_limit)²; once continuously differentiable except at a tip in the remote centre."""
    return 1.0 - _lens_square(xp, lens, tip) / lens_limit(eye) ** 2


def eye_rows(xp: Namespace, eye: Eye, tip: Any) -> dict[str, Any]:
    """The rows ≤ 0 by the name of the limit: retina and, where there is one, lens."""
    rows = {RetinaClearance.name: retina_row(xp, eye, tip)}
    if eye.lens is not None:
        rows[LensClearance.name] = lens_row(xp, eye, eye.lens, tip)
    return rows


def _lens_square(xp: Namespace, lens: Lens, tip: Any) -> Any:
    """ρ²."""
    scale = (lens.frame / lens.semi_axes).T.tolist()
    begin = [-_dot(row, lens.centre.tolist()) for row in scale]
    shaft = [_dot(row, tip) for row in scale]
    length = _square(shaft)
    # without a length there is no foot: the guarded quotient keeps value and derivatives finite there
    foot = -_dot(begin, shaft) / xp.where(length > NO_LENGTH, length, 1.0)
    foot = xp.where(foot > 0.0, xp.where(foot < 1.0, foot, 1.0), 0.0)
    return _square([b + foot * s for b, s in zip(begin, shaft, strict=True)])


def _minus(tip: Any, centre: Any) -> list[Any]:
    return [tip[k] - centre[k] for k in range(3)]


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _square(vector: Sequence[Any]) -> Any:
    return _dot(vector, vector)
