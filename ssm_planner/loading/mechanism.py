"""Geometry and bodies of a robot file: axes from unit vectors or from angles, inertias in either sign convention."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np

from ssm_planner import units
from ssm_planner.errors import ProblemError
from ssm_planner.loading.faults import located
from ssm_planner.loading.schema.common import Axis, Field, Model, Text, quantity, vector, wrong
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.robot import SMALLEST_ANGLE, Body, Geometry, frozen, possible, principal_moments, unit_vector
from ssm_planner.typing import Array


def _rotations(value: object) -> tuple[tuple[str, float], ...]:
    allowed = "a list of rotations about the axes of the turned frame, such as [x 90 deg, y 30 deg]"
    if not isinstance(value, list):
        raise wrong("not a chain of rotations", allowed)
    chain = []
    for part in value:
        axis, _, angle = part.strip().partition(" ") if isinstance(part, str) else ("", "", "")
        if axis not in ("x", "y", "z"):
            raise wrong(f"{part!r} does not start with x, y or z", allowed)
        try:
            chain.append((axis, units.quantity(angle, "angle")))
        except units.BadQuantity as error:
            raise wrong(error.reason, error.allowed) from None
    return tuple(chain)


Rotations = Annotated[tuple[tuple[str, float], ...], Field(_rotations, {"type": "array", "items": {"type": "string"}})]


class AxesModel(Model):
    """Unit vectors in the base frame at q = 0."""

    joint1: Axis
    joint2: Axis
    joint3: Axis


class GeometryModel(Model):
    """Axes, or angles."""

    axes: AxesModel | None = None
    alpha: Annotated[float, quantity("angle", above=0)] | None = None
    beta: Annotated[float, quantity("angle", above=0)] | None = None
    home_tilt: Annotated[float, quantity("angle")] | None = None
    home_roll: Annotated[float, quantity("angle")] | None = None
    insertion: Literal["negative", "positive"]
    """Direction of joint 4 that moves the tool inwards."""
    tool_home: Rotations | None = None
    """Base to tool at q = 0; by default the last body's frame."""


class InertiaModel(Model):
    """About the origin of the body frame."""

    xx: Annotated[float, quantity("inertia", at_least=0)]
    yy: Annotated[float, quantity("inertia", at_least=0)]
    zz: Annotated[float, quantity("inertia", at_least=0)]
    yz: Annotated[float, quantity("inertia")] = 0.0
    xz: Annotated[float, quantity("inertia")] = 0.0
    xy: Annotated[float, quantity("inertia")] = 0.0


class BodyModel(Model):
    """See problem/robot.Body; frame is relative to the previous body at q = 0."""

    name: Text
    mass: Annotated[float, quantity("mass", at_least=0)]
    com: Annotated[tuple[float, float, float], vector("length", "length", "length")] = (0.0, 0.0, 0.0)
    inertia: InertiaModel | None = None
    products_of_inertia: Literal["cad", "tensor"] | None = None
    frame: Rotations


BETA_TOLERANCE = math.radians(0.5)


def rotation(chain: tuple[tuple[str, float], ...]) -> Array:
    """Product of elementary rotations (axis letter, angle), each about the axes of the frame turned so far; (3, 3)."""
    result = np.eye(3)
    for axis, angle in chain:
        i = "xyz".index(axis)
        j, k = (i + 1) % 3, (i + 2) % 3
        turn = np.eye(3)
        turn[j, j] = turn[k, k] = math.cos(angle)
        turn[k, j] = math.sin(angle)
        turn[j, k] = -math.sin(angle)
        result = result @ turn
    return result


def geometry_from(section: Section, model: GeometryModel, last_frame: Array) -> Geometry:
    """The geometry that a section describes; last_frame: base ← last body at q = 0, (3, 3). Raises ProblemError."""
    angles = [name for name in ("alpha", "beta", "home_tilt", "home_roll") if getattr(model, name) is not None]
    if model.axes is not None and angles:
        raise section.error("axes are given as well", angles[0], allowed="either axes, or alpha with home_tilt")
    if model.axes is not None:
        omegas = tuple(_unit(section, model, name) for name in ("joint1", "joint2", "joint3"))
    else:
        omegas = _from_angles(section, model)
    tool_home = last_frame if model.tool_home is None else rotation(model.tool_home)
    axes = {f"omega{i}": ("axes", f"joint{i}") for i in (1, 2, 3)}
    keys = axes if model.axes is not None else {"omega2": ("alpha",), "omega3": ("home_tilt",)}
    with located(section, keys):
        return Geometry(omegas[0], omegas[1], omegas[2], tool_home, -1 if model.insertion == "negative" else 1)


def _unit(section: Section, model: GeometryModel, name: str) -> Array:
    with located(section.sub("axes")):
        return unit_vector(np.array(getattr(model.axes, name)), f"axes.{name}")


def _from_angles(section: Section, model: GeometryModel) -> tuple[Array, Array, Array]:
    """ω1 = x, ω2 = (cos α, sin α, 0), ω3 = Rx(home_roll) Ry(home_tilt) x; the tilt axis is y."""
    for name in ("alpha", "home_tilt"):
        if getattr(model, name) is None:
            raise section.error(
                "missing: this key is required", name, allowed="axes, or alpha and home_tilt with beta or home_roll"
            )
    alpha, tilt = float(model.alpha or 0.0), float(model.home_tilt or 0.0)
    for name, angle in (("alpha", alpha), ("beta", model.beta)):
        if angle is not None and not SMALLEST_ANGLE < angle < math.pi - SMALLEST_ANGLE:
            raise section.error("the axes would be parallel", name, allowed="between 0.1 and 179.9 deg")
    roll = _home_roll(section, model, alpha, tilt)
    omega3 = rotation((("x", roll), ("y", tilt)))[:, 0]
    return np.array([1.0, 0, 0]), np.array([math.cos(alpha), math.sin(alpha), 0]), omega3


def _home_roll(section: Section, model: GeometryModel, alpha: float, tilt: float) -> float:
    """As given (0 by default) where that agrees with beta; otherwise the one that beta asks for.

    cos β = cos α cos φ_h + sin α sin φ_h sin ψ_h.
    """
    roll = model.home_roll or 0.0
    across = math.sin(alpha) * math.sin(tilt)
    cosine = math.cos(alpha) * math.cos(tilt) + across * math.sin(roll)
    beta = math.acos(max(-1.0, min(1.0, cosine)))
    if model.beta is None or abs(model.beta - beta) <= BETA_TOLERANCE:
        return roll
    if model.home_roll is not None:
        raise section.error(
            f"alpha, home_tilt and home_roll give {math.degrees(beta):.4f} deg", "beta", allowed="within 0.5 deg of it"
        )
    wanted = math.cos(model.beta) - math.cos(alpha) * math.cos(tilt)
    if abs(wanted) > abs(across):
        low, high = (
            math.degrees(math.acos(max(-1.0, min(1.0, math.cos(alpha) * math.cos(tilt) + sign * abs(across)))))
            for sign in (1, -1)
        )
        raise section.error(
            "no home_roll gives this beta together with alpha and home_tilt",
            "beta",
            allowed=f"{low:.4g} to {high:.4g} deg",
        )
    return math.asin(wanted / across)


LARGEST_GYRATION = 1.0
"""m; a link of a surgical tool is smaller."""


def bodies_from(section: Section, models: list[BodyModel]) -> tuple[Body, Body, Body, Body]:
    """Four bodies; each frame is given relative to the one before it at q = 0. Raises ProblemError."""
    frame = np.eye(3)
    bodies = []
    for i, model in enumerate(models):
        frame = frame @ rotation(model.frame)
        bodies.append(_body(section.sub(i), model, frame))
    first, second, third, fourth = bodies
    return first, second, third, fourth


def _body(section: Section, model: BodyModel, frame: Array) -> Body:
    tensor = _inertia(section, model)
    with located(section):
        try:
            body = Body(model.name, model.mass, np.array(model.com), tensor, frame)
        except ProblemError as error:
            error.reason += _sign_hint(model, tensor) if model.mass > 0 else ""
            raise
    gyration = float(np.sqrt(principal_moments(body.mass, body.com, tensor)[2] / body.mass)) if body.mass > 0 else 0.0
    if gyration > LARGEST_GYRATION:
        raise section.error(
            f"implausible: a radius of gyration of {gyration:.3g} m; are mass and inertia in the right unit?",
            "inertia",
            allowed=f"a radius of gyration up to {LARGEST_GYRATION:g} m",
        )
    return body


def _tensor(model: InertiaModel, sign: float) -> Array:
    xy, xz, yz = sign * model.xy, sign * model.xz, sign * model.yz
    return np.array([[model.xx, xy, xz], [xy, model.yy, yz], [xz, yz, model.zz]])


def _inertia(section: Section, model: BodyModel) -> Array:
    """The tensor about the frame's origin: products −∫xy dm, whatever sign the file uses."""
    if model.inertia is None:
        if model.mass > 0:
            raise section.error("missing: a body with mass has an inertia", "inertia")
        return np.zeros((3, 3))
    products = any((model.inertia.xy, model.inertia.xz, model.inertia.yz))
    convention = model.products_of_inertia
    if products and convention is None:
        raise section.error(
            "missing: the sign convention of the products of inertia",
            "products_of_inertia",
            allowed="cad (∫xy dm, as CAD programs print) or tensor (−∫xy dm)",
        )
    sign = -1.0 if convention == "cad" else 1.0
    tensor = _tensor(model.inertia, sign)
    return tensor


def _sign_hint(model: BodyModel, tensor: Array) -> str:
    """What to try where no body can have the tensor."""
    convention = model.products_of_inertia
    if convention is None:
        return ""
    other = "tensor" if convention == "cad" else "cad"
    hint = f"; the usual cause is the sign of the products of inertia: here products_of_inertia is {convention}"
    flipped = principal_moments(model.mass, frozen(model.com, (3,)), 2 * np.diag(np.diag(tensor)) - tensor)
    if possible(flipped):
        listed = ", ".join(f"{moment:.4g}" for moment in flipped)
        return f"{hint}, and with {other} the moments are ({listed}) kg*m^2, which a body can have: try it"
    return f"{hint}, but {other} would not do either; check that it is about the origin of the body frame, and its unit"
