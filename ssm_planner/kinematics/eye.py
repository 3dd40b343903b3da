"""Compute the distance of the tip from the retina, and the clearance of the shaft from the lens.

The remote centre of motion is the origin of the base frame. The retina is a sphere with centre c
and radius R, and the lens is an ellipsoid. Each function accepts NumPy arrays and CasADi
expressions. The argument `xp` is namespace.NUMPY or namespace.casadi_namespace(), and `tip`
contains the three components of the tip position p in the base frame, m. Each result has the shape
of one component.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ssm_planner.codegen import Namespace
from ssm_planner.problem import Eye, Lens, LensClearance, RetinaClearance

SMALLEST_SQUARED_LENGTH = 1e-12
"""Squared scaled length below which a shaft counts as a point without direction."""


def retina_distance(xp: Namespace, eye: Eye, tip: Any) -> Any:
    """Return the distance of the tip from the retina in m, which must be at least `eye.clearance`.

    The instrument enters the eye through a hole of the retina about the remote centre with the
    radius `port`. The distance is therefore max(R − |p − c|, clearance + port − |p|) with the tip
    position p, the centre c and the radius R of the retina. The function is continuous but has
    kinks, so only the check uses it. The optimiser uses the smooth `retina_constraint`.
    """
    depth = eye.radius - xp.sqrt(_squared_length(_difference(tip, eye.centre)))
    at_port = eye.clearance + eye.port - xp.sqrt(_squared_length(tip))
    return xp.where(depth > at_port, depth, at_port)


def lens_ratio(xp: Namespace, lens: Lens, tip: Any) -> Any:
    """Return the factor ρ by which the lens must grow to touch the axis of the shaft.

    A permitted ρ is at least `smallest_lens_ratio`. The part of the shaft in the eye is the
    segment from the remote centre to the tip. In coordinates that are scaled by the semi-axes,
    the lens is the unit ball, and ρ is the distance of the segment from the centre of this
    ball.
    """
    return xp.sqrt(_squared_lens_ratio(xp, lens, tip))


def smallest_lens_ratio(eye: Eye) -> float:
    """Return the smallest permitted ρ of `lens_ratio`, which is 1 + r/a. Without a lens it is 1.

    r is the radius of the shaft and a the smallest semi-axis of the lens E. The lens contains a
    ball of radius a, so (r/a) E contains a ball of radius r. E is convex, so E + (r/a) E = (1 +
    r/a) E. A shaft axis outside (1 + r/a) E is therefore at least r away from E.
    """
    if eye.lens is None:
        return 1.0
    return LensClearance(eye.shaft_radius, float(np.min(eye.lens.semi_axes))).low


def eye_limits(xp: Namespace, eye: Eye, tip: Any) -> dict[str, tuple[Any, float]]:
    """Return the value and the smallest permitted value of each eye limit, by its name.

    The value of the retina is a distance in m (`retina_distance`). The value of the lens, if the
    eye has one, is the ratio ρ of `lens_ratio`.
    """
    limits = {RetinaClearance.name: (retina_distance(xp, eye, tip), eye.clearance)}
    if eye.lens is not None:
        limits[LensClearance.name] = (lens_ratio(xp, eye.lens, tip), smallest_lens_ratio(eye))
    return limits


def retina_constraint(xp: Namespace, eye: Eye, tip: Any) -> Any:
    """Return |p − c|²/(R − clearance)² − 1, which the optimiser keeps ≤ 0 beyond the port.

    p is the tip, and c and R are centre and radius of the retina. The expression is smooth, unlike
    `retina_distance`.
    """
    return _squared_length(_difference(tip, eye.centre)) / (eye.radius - eye.clearance) ** 2 - 1.0


def lens_constraint(xp: Namespace, eye: Eye, lens: Lens, tip: Any) -> Any:
    """Return 1 − (ρ / lens_limit)² with ρ of `lens_ratio`, which the optimiser keeps ≤ 0.

    The expression is continuously differentiable, except for a tip at the remote centre.
    """
    return 1.0 - _squared_lens_ratio(xp, lens, tip) / smallest_lens_ratio(eye) ** 2


def eye_constraints(xp: Namespace, eye: Eye, tip: Any) -> dict[str, Any]:
    """Return the expressions that the optimiser keeps ≤ 0, by the name of the eye limit."""
    rows = {RetinaClearance.name: retina_constraint(xp, eye, tip)}
    if eye.lens is not None:
        rows[LensClearance.name] = lens_constraint(xp, eye, eye.lens, tip)
    return rows


def _squared_lens_ratio(xp: Namespace, lens: Lens, tip: Any) -> Any:
    """Return ρ², the square of `lens_ratio`."""
    scale = (lens.frame / lens.semi_axes).T.tolist()
    offset = [-_inner_product(axis, lens.centre.tolist()) for axis in scale]
    shaft = [_inner_product(axis, tip) for axis in scale]
    length = _squared_length(shaft)
    # The perpendicular from the centre of the lens to a shaft without a length is not determined.
    # The smallest divisor SMALLEST_SQUARED_LENGTH keeps the value and its derivatives finite.
    foot = -_inner_product(offset, shaft) / xp.where(length > SMALLEST_SQUARED_LENGTH, length, 1.0)
    foot = xp.where(foot > 0.0, xp.where(foot < 1.0, foot, 1.0), 0.0)
    return _squared_length(
        [start + foot * direction for start, direction in zip(offset, shaft, strict=True)]
    )


def _difference(tip: Any, centre: Any) -> list[Any]:
    """Return the components of tip − centre."""
    return [tip[k] - centre[k] for k in range(3)]


def _inner_product(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return the inner product of two vectors of three components."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _squared_length(vector: Sequence[Any]) -> Any:
    """Return the squared length of a vector of three components."""
    return _inner_product(vector, vector)
