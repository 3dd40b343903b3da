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
    """Compute the distance of the tip from the retina.

    It must be at least `eye.clearance`.

    The instrument enters the eye through a hole of the retina about the remote centre with the
    radius `port`. With the tip position p, and the centre c and the radius R of the retina, the
    distance is therefore

        max(R − |p − c|, clearance + port − |p|).

    The second term is at least `clearance` for a tip within `port` of the remote centre. The
    function is continuous but has kinks, so only the check uses it. The optimiser uses the smooth
    `retina_constraint`.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    eye : Eye
        Retina, port and required clearance.
    tip : three arrays or expressions
        Components of the tip position p in the base frame (m).

    Returns
    -------
    array or expression
        Distance (m) in the shape of one component.
    """
    depth = eye.radius - xp.sqrt(_squared_length(_difference(tip, eye.centre)))
    at_port = eye.clearance + eye.port - xp.sqrt(_squared_length(tip))
    return xp.where(depth > at_port, depth, at_port)


def lens_ratio(xp: Namespace, lens: Lens, tip: Any) -> Any:
    """Compute the factor ρ by which the lens must grow to touch the axis of the shaft.

    A permitted ρ is at least `smallest_lens_ratio`. The part of the shaft in the eye is the segment
    from the remote centre to the tip. In coordinates that are divided by the semi-axes of the lens,
    the lens is the unit ball, and ρ is the distance of the segment from the centre of this ball.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    lens : Lens
        Ellipsoid with its centre (m), the directions of its axes and its semi-axes (m).
    tip : three arrays or expressions
        Components of the tip position in the base frame (m).

    Returns
    -------
    array or expression
        Ratio ρ in the shape of one component. It is below 1 if the axis of the shaft passes
        through the lens.
    """
    return xp.sqrt(_squared_lens_ratio(xp, lens, tip))


def smallest_lens_ratio(eye: Eye) -> float:
    """Compute the smallest permitted distance of the shaft from the lens, as a ratio.

    It is the smallest value of `lens_ratio` at which the shaft does not touch the lens.

    Parameters
    ----------
    eye : Eye
        Lens and radius of the shaft.

    Returns
    -------
    float
        Smallest permitted ratio, which is 1 without a lens.

    Notes
    -----
    The ratio is 1 + r/a with the radius r of the shaft and the smallest semi-axis a of the lens E.
    The lens contains a ball of radius a, so (r/a) E contains a ball of radius r. E is convex, so
    E + (r/a) E = (1 + r/a) E. A shaft axis outside (1 + r/a) E is therefore at least r away from E,
    and the shaft does not touch the lens.
    """
    if eye.lens is None:
        return 1.0
    return LensClearance(eye.shaft_radius, float(np.min(eye.lens.semi_axes))).low


def eye_limits(xp: Namespace, eye: Eye, tip: Any) -> dict[str, tuple[Any, float]]:
    """Compute the value and the smallest permitted value of each eye limit.

    The check compares the two values of every limit.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    eye : Eye
        Retina and lens.
    tip : three arrays or expressions
        Components of the tip position in the base frame (m).

    Returns
    -------
    dict of (array or expression, float)
        Value and smallest permitted value by the name of the limit. The value of the retina is the
        distance of `retina_distance` (m). The value of the lens, if the eye has one, is the ratio ρ
        of `lens_ratio`.
    """
    limits = {RetinaClearance.name: (retina_distance(xp, eye, tip), eye.clearance)}
    if eye.lens is not None:
        limits[LensClearance.name] = (lens_ratio(xp, eye.lens, tip), smallest_lens_ratio(eye))
    return limits


def retina_constraint(xp: Namespace, eye: Eye, tip: Any) -> Any:
    """Compute a smooth expression that is at most 0 while the tip is far enough from the retina.

    The expression is |p − c|²/(R − clearance)² − 1 with the tip position p, and the centre c and
    the radius R of the retina. The optimiser keeps it ≤ 0 beyond the port. The expression of
    `retina_distance` is not smooth.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    eye : Eye
        Retina and required clearance.
    tip : three arrays or expressions
        Components of the tip position p in the base frame (m).

    Returns
    -------
    array or expression
        Dimensionless value in the shape of one component.
    """
    return _squared_length(_difference(tip, eye.centre)) / (eye.radius - eye.clearance) ** 2 - 1.0


def lens_constraint(xp: Namespace, eye: Eye, lens: Lens, tip: Any) -> Any:
    """Compute an expression that is at most 0 while the shaft does not touch the lens.

    The expression is 1 − (ρ / ρ_min)², where ρ is the ratio of `lens_ratio`, and ρ_min is
    `smallest_lens_ratio`. It is continuously differentiable, except for a tip at the remote centre.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    eye : Eye
        Radius of the shaft, and the lens.
    lens : Lens
        The lens of the eye.
    tip : three arrays or expressions
        Components of the tip position in the base frame (m).

    Returns
    -------
    array or expression
        Dimensionless value in the shape of one component.
    """
    return 1.0 - _squared_lens_ratio(xp, lens, tip) / smallest_lens_ratio(eye) ** 2


def eye_constraints(xp: Namespace, eye: Eye, tip: Any) -> dict[str, Any]:
    """Compute the expressions of all eye limits that the optimiser keeps below 0.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    eye : Eye
        Retina and lens.
    tip : three arrays or expressions
        Components of the tip position in the base frame (m).

    Returns
    -------
    dict of array or expression
        Values of `retina_constraint` and, if the eye has a lens, of `lens_constraint`.
    """
    rows = {RetinaClearance.name: retina_constraint(xp, eye, tip)}
    if eye.lens is not None:
        rows[LensClearance.name] = lens_constraint(xp, eye, eye.lens, tip)
    return rows


def _squared_lens_ratio(xp: Namespace, lens: Lens, tip: Any) -> Any:
    """Compute the square of the factor by which the lens must grow to touch the shaft.

    The factor is ρ of `lens_ratio`.

    With the centre of the lens as origin and coordinates divided by the semi-axes, let o be the
    remote centre and d the vector from it to the tip. The point of the segment closest to the
    origin is o + f d with f = −(o · d) / |d|², limited to 0 ≤ f ≤ 1. ρ is the length of this
    point's vector.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    lens : Lens
        Ellipsoid with its centre (m), the directions of its axes and its semi-axes (m).
    tip : three arrays or expressions
        Components of the tip position in the base frame (m).

    Returns
    -------
    array or expression
        Squared ratio ρ² in the shape of one component.
    """
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
    """Subtract one position from another.

    Parameters
    ----------
    tip, centre : three arrays, expressions or floats
        Components of both positions, m.

    Returns
    -------
    list
        Three components of tip − centre, m.
    """
    return [tip[k] - centre[k] for k in range(3)]


def _inner_product(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Compute the inner product of two vectors of three components.

    Parameters
    ----------
    a, b : sequence of three arrays, expressions or floats
        Components of both vectors.

    Returns
    -------
    array, expression or float
        The inner product.
    """
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _squared_length(vector: Sequence[Any]) -> Any:
    """Compute the squared length of a vector.

    Parameters
    ----------
    vector : sequence of three arrays, expressions or floats
        Components of the vector.

    Returns
    -------
    array, expression or float
        The squared length.
    """
    return _inner_product(vector, vector)
