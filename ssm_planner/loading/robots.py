"""A robot file → Robot with its drives and motors: axes as vectors or angles, inertias in either sign convention."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field as PydanticField

from ssm_planner import units
from ssm_planner.dynamics import shapes
from ssm_planner.errors import ProblemError
from ssm_planner.loading.drives import drive_from
from ssm_planner.loading.files import follow
from ssm_planner.loading.motors import motor_from
from ssm_planner.loading.schema import (
    SOURCE,
    Axis,
    Field,
    Model,
    Part,
    Reference,
    by_joint,
    interval,
    located,
    model_from,
    model_of,
    optional,
    quantity,
    validated,
    vector,
    wrong,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.limits import TASK, TaskRange
from ssm_planner.problem.robot import (
    JOINTS,
    SMALLEST_ANGLE,
    Body,
    Geometry,
    Joint,
    Robot,
    possible,
    principal_moments,
    unit_vector,
)
from ssm_planner.problem.value import Bound, frozen
from ssm_planner.typing import Array

FOLLOWED = ("alpha", "home_tilt", "home_roll")
"""Angles of the geometry that a frame may name, so that the bodies follow it."""


def _rotations(value: object) -> tuple[tuple[str, float | str], ...]:
    allowed = "a list of rotations about the axes of the turned frame, such as [x 90 deg, y 30 deg] or [y alpha]"
    if not isinstance(value, list):
        raise wrong("not a chain of rotations", allowed)
    chain: list[tuple[str, float | str]] = []
    for part in value:
        axis, _, angle = part.strip().partition(" ") if isinstance(part, str) else ("", "", "")
        if axis not in ("x", "y", "z"):
            raise wrong(f"{part!r} does not start with x, y or z", allowed)
        follows = angle.strip().removeprefix("-") in FOLLOWED
        chain.append((axis, angle.strip() if follows else units.quantity(angle, "angle")))
    return tuple(chain)


_ROTATIONS = Field(
    _rotations,
    {"type": "array", "items": {"type": "string"}},
    ("angle",),
    "such as [x 90 deg, y 30 deg]",
)
Rotations = Annotated[tuple[tuple[str, float | str], ...], _ROTATIONS]
_Angle = Annotated[float, quantity("angle")] | None
_PositiveAngle = Annotated[float, quantity("angle", Bound(above=0.0))] | None
_Place = Annotated[tuple[float, float, float], vector("length", "length", "length")]
_Size = Annotated[float, quantity("length", Bound(above=0.0))]
_Mass = Annotated[float, quantity("mass", Bound(at_least=0.0))]
_Density = Annotated[float, quantity("density", Bound(above=0.0))]
_Side = Literal["positive", "negative"]
_MOTORS = tuple(f"motor {name}" for name in JOINTS)
_MASS_OF = Field(
    lambda value: value if value in _MOTORS else units.quantity(value, "mass"),
    {"type": "string"},
    ("mass",),
    f"or {', '.join(_MOTORS)}",
)
_Moment = Annotated[float, quantity("inertia", Bound(at_least=0.0))]
_Product = Annotated[float, quantity("inertia")]


class AxesModel(Model):
    """Unit vectors in the base frame at q = 0."""

    joint1: Axis
    """Turns everything; roll of the tool is about it."""
    joint2: Axis
    """At alpha to joint 1."""
    joint3: Axis
    """At beta to joint 2: the tool's axis."""


class GeometryModel(Model):
    """Axes, or angles."""

    axes: AxesModel | None = None
    """Of joints 1 to 3 as unit vectors in the base frame at q = 0; or alpha and home_tilt."""
    alpha: _PositiveAngle = None
    """Between the axes of joints 1 and 2."""
    beta: _PositiveAngle = None
    """Between the axes of joints 2 and 3."""
    home_tilt: _Angle = None
    """Of the tool at q = 0."""
    home_roll: _Angle = None
    """Of the tool at q = 0; by default what beta asks for, or 0."""
    insertion: Literal["negative", "positive"]
    """Direction of joint 4 that moves the tool inwards."""
    tool_home: Rotations | None = None
    """Base to tool at q = 0; by default the last body's frame."""


class InertiaModel(Model):
    """About the origin of the body frame."""

    xx: _Moment
    """Moment."""
    yy: _Moment
    """Moment."""
    zz: _Moment
    """Moment."""
    yz: _Product = 0.0
    """Product; its sign as products_of_inertia says."""
    xz: _Product = 0.0
    """Product; its sign as products_of_inertia says."""
    xy: _Product = 0.0
    """Product; its sign as products_of_inertia says."""


class _Solid(Model):
    frame: Literal["own", "next"] = "own"
    """In whose coordinates it is placed: the body's own, or those of the next body at q = 0, which follow the geometry."""


class _Weighed(_Solid):
    at: _Place
    """Where its centre is."""
    mass: Annotated[float | str, _MASS_OF]
    """A quantity, or whose it is: motor roll, motor tilt …"""


class ArcModel(Model):
    """A curved bar about the remote centre, from the joint's own axis to the next joint's."""

    shape: Literal["arc"]
    """A bar of rectangular section, bent to a circle about the remote centre."""
    radius: _Size
    """Of its middle line."""
    width: _Size
    """Of its section, in the plane of the arc."""
    height: _Size
    """Of its section, across that plane."""
    density: _Density
    """Of its material."""
    sides: tuple[_Side, _Side] = ("positive", "positive")
    """On which side of the remote centre it starts on the own axis and ends on the next one."""


class RodModel(_Solid):
    """A straight round bar."""

    shape: Literal["rod"]
    """A straight round bar between two places."""
    start: _Place
    """One end."""
    end: _Place
    """The other end."""
    diameter: _Size
    """Of its section."""
    density: _Density
    """Of its material."""


class BoxModel(_Weighed):
    """A box along the axes of its frame."""

    shape: Literal["box"]
    """A block along the axes of the frame."""
    size: Annotated[tuple[float, float, float], vector("length", "length", "length")]
    """Along the axes."""


class PointModel(_Weighed):
    """A point mass."""

    shape: Literal["point"]
    """A mass at one place, such as a motor."""


class _BodyModel(Model):
    parts: (
        list[
            Annotated[
                ArcModel | RodModel | BoxModel | PointModel, PydanticField(discriminator="shape")
            ]
        ]
        | None
    ) = None
    """What it is made of, in the place of mass, com and inertia, which follow from them."""
    com: Annotated[tuple[float, float, float], vector("length", "length", "length")] = (
        0.0,
        0.0,
        0.0,
    )
    inertia: InertiaModel | None = None
    """About the origin of the body frame; of a body without mass none."""
    products_of_inertia: Literal["cad", "tensor"] | None = None
    """Their sign: cad (∫xy dm, as CAD programs print) or tensor (−∫xy dm)."""
    frame: Rotations
    """Relative to the previous body at q = 0."""


BodyModel = model_of(
    Body, {"mass": optional(_Mass, "Or parts.")}, base=_BodyModel, without=("com",)
)
_ACTUATION: dict[str, Any] = {
    "drive": (Reference | None, None),
    "motor": (Reference | None, None),
    "alternatives": (list[Reference], []),
}


def _joint_model(slides: bool = False) -> Any:
    return model_of(Joint, _ACTUATION, slides=slides, without=("name", "kind"))


JointsModel = by_joint(_joint_model(), _joint_model(slides=True), required=True)
RANGES = {
    name: optional(
        Annotated[Any, interval("length" if name == "depth" else "angle")], f"Range of the {name}."
    )
    for name in TASK
}
"""Keys of the ranges of the task coordinates."""
RangesModel = model_from(RANGES)
_BODIES = PydanticField(
    min_length=4, max_length=4, description="What joints 1 to 4 move, in this order."
)
RobotModel = model_of(
    Robot,
    {
        "source": SOURCE,
        "geometry": (
            GeometryModel,
            PydanticField(description="Axes of joints 1 to 3, as vectors or as angles."),
        ),
        "bodies": (list[Annotated[Any, Part(BodyModel)]], _BODIES),
        "joints": (
            Annotated[Any, Part(JointsModel)],
            PydanticField(description="Ranges, limits and actuation."),
        ),
        "limits": (Annotated[Any, Part(RangesModel)], RangesModel()),
    },
)
"""What a robot file may say."""

BETA_TOLERANCE = math.radians(0.5)
LARGEST_GYRATION = 1.0
"""m; a link of a surgical tool is smaller."""


def robot_from(section: Section) -> Robot:
    """The robot that a section describes. Raises ProblemError."""
    model: Any = validated(section, RobotModel)
    omegas = _axes(section.sub("geometry"), model.geometry)
    frames: list[Array] = []
    for i, body in enumerate(model.bodies):
        turn = _frame(section.sub("bodies", i), body.frame, model.geometry)
        frames.append((frames[-1] if frames else np.eye(3)) @ turn)
    geometry = _geometry(section.sub("geometry"), model.geometry, omegas, frames[-1])
    joints = tuple(
        _joint(section.sub("joints", name), name, getattr(model.joints, name)) for name in JOINTS
    )
    bodies = []
    for i, body in enumerate(model.bodies):
        setting = _Setting(i, frames, geometry, joints)
        bodies.append(_body(section.sub("bodies", i), body, setting))
    with located(section):
        return Robot(
            name=model.name,
            geometry=geometry,
            bodies=(bodies[0], bodies[1], bodies[2], bodies[3]),
            joints=(joints[0], joints[1], joints[2], joints[3]),
            gravity=frozen(model.gravity, (3,)),
            limits=ranges_from(model.limits),
            file=section.file_name,
        )


def ranges_from(model: Any) -> tuple[TaskRange, ...]:
    """The ranges of task coordinates that are given."""
    given = ((name, getattr(model, name)) for name in TASK)
    return tuple(TaskRange(name, *ends) for name, ends in given if ends is not None)


def _joint(section: Section, name: str, model: Any) -> Joint:
    drive = None if model.drive is None else drive_from(follow(section, "drive"))
    motor = None if model.motor is None else motor_from(follow(section, "motor"))
    others = range(len(model.alternatives))
    alternatives = tuple(
        motor_from(follow(section, "alternatives", i, kind="motor")) for i in others
    )
    kind = "prismatic" if name == "insertion" else "revolute"
    with located(section):
        found = {"drive": drive, "motor": motor, "alternatives": alternatives}
        return Joint(**{**dict(model), "name": name, "kind": kind, **found})


def _frame(
    section: Section, chain: tuple[tuple[str, float | str], ...], geometry: GeometryModel
) -> Array:
    """The rotation (3, 3) of a chain, the geometry's angles in the place of their names. Raises ProblemError."""
    angles = []
    for axis, angle in chain:
        if isinstance(angle, str):
            name = angle.removeprefix("-")
            value = 0.0 if name == "home_roll" and geometry.beta is None else None
            value = value if getattr(geometry, name) is None else getattr(geometry, name)
            if value is None:
                raise section.error(
                    f"names {name}, which geometry does not give", "frame", allowed="angles"
                )
            angle = -value if angle.startswith("-") else value
        angles.append((axis, angle))
    return rotation(tuple(angles))


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


def _axes(section: Section, model: GeometryModel) -> list[Array]:
    """Of joints 1 to 3 in the base frame at q = 0, (3,) each."""
    angles = [
        name
        for name in ("alpha", "beta", "home_tilt", "home_roll")
        if getattr(model, name) is not None
    ]
    if model.axes is None:
        return _from_angles(section, model)
    if angles:
        raise section.error(
            "axes are given as well", angles[0], allowed="either axes, or alpha with home_tilt"
        )
    with located(section.sub("axes")):
        return [unit_vector(np.array(axis), f"axes.{name}") for name, axis in model.axes]


def _geometry(
    section: Section, model: GeometryModel, omegas: Sequence[Array], last_frame: Array
) -> Geometry:
    """last_frame: base ← last body at q = 0, (3, 3)."""
    places: dict[str, tuple[str, ...]] = {f"omega{i}": ("axes", f"joint{i}") for i in (1, 2, 3)}
    if model.axes is None:
        places = {"omega2": ("alpha",), "omega3": ("home_tilt",)}
    tool_home = last_frame if model.tool_home is None else _frame(section, model.tool_home, model)
    with located(section, places):
        return Geometry(
            omegas[0], omegas[1], omegas[2], tool_home, -1 if model.insertion == "negative" else 1
        )


def _from_angles(section: Section, model: GeometryModel) -> list[Array]:
    """ω1 = x, ω2 = (cos α, sin α, 0), ω3 = Rx(home_roll) Ry(home_tilt) x; the tilt axis is y."""
    for name in ("alpha", "home_tilt"):
        if getattr(model, name) is None:
            allowed = "axes, or alpha and home_tilt with beta or home_roll"
            raise section.error("missing: this key is required", name, allowed=allowed)
    alpha, tilt = float(model.alpha or 0.0), float(model.home_tilt or 0.0)
    for name, angle in (("alpha", alpha), ("beta", model.beta)):
        if angle is not None and not SMALLEST_ANGLE < angle < math.pi - SMALLEST_ANGLE:
            raise section.error(
                "the axes would be parallel", name, allowed="between 0.1 and 179.9 deg"
            )
    roll = _home_roll(section, model, alpha, tilt)
    omega3 = rotation((("x", roll), ("y", tilt)))[:, 0]
    return [np.array([1.0, 0, 0]), np.array([math.cos(alpha), math.sin(alpha), 0]), omega3]


def _home_roll(section: Section, model: GeometryModel, alpha: float, tilt: float) -> float:
    """As given (0 by default) where that agrees with beta; otherwise the one that beta asks for.

    cos β = cos α cos φ_h + sin α sin φ_h sin ψ_h.
    """

    def angle(cosine: float) -> float:
        return math.acos(max(-1.0, min(1.0, cosine)))

    roll = model.home_roll or 0.0
    along, across = math.cos(alpha) * math.cos(tilt), math.sin(alpha) * math.sin(tilt)
    beta = angle(along + across * math.sin(roll))
    if model.beta is None or abs(model.beta - beta) <= BETA_TOLERANCE:
        return roll
    if model.home_roll is not None:
        reason = f"alpha, home_tilt and home_roll give {math.degrees(beta):.4f} deg"
        raise section.error(reason, "beta", allowed="within 0.5 deg of it")
    wanted = math.cos(model.beta) - along
    if abs(wanted) > abs(across):
        low, high = (math.degrees(angle(along + sign * abs(across))) for sign in (1, -1))
        reason = "no home_roll gives this beta together with alpha and home_tilt"
        raise section.error(reason, "beta", allowed=f"{low:.4g} to {high:.4g} deg")
    return math.asin(wanted / across)


@dataclass(frozen=True, eq=False)
class _Setting:
    """Where a body is: its place in the chain, all frames base ← body at q = 0 (3, 3), axes and joints."""

    place: int
    frames: Sequence[Array]
    geometry: Geometry
    joints: Sequence[Joint]

    @property
    def frame(self) -> Array:
        return self.frames[self.place]

    def axis(self, beyond: int) -> Array:
        """Of the joint that moves the body, or the one beyond it, in the body's frame, (3,)."""
        omegas = (
            self.geometry.omega1,
            self.geometry.omega2,
            self.geometry.omega3,
            self.geometry.omega3,
        )
        return np.asarray(self.frame.T @ omegas[self.place + beyond])


def _body(section: Section, model: Any, setting: _Setting) -> Body:
    if model.parts is not None:
        return _made_of_parts(section, model, setting)
    if model.mass is None:
        raise section.error(
            "missing: this key is required", "mass", allowed="mass with com and inertia, or parts"
        )
    tensor = _inertia(section, model)
    with located(section):
        try:
            body = Body(model.name, model.mass, np.array(model.com), tensor, setting.frame)
        except ProblemError as error:
            error.reason += _sign_hint(model, tensor) if model.mass > 0 else ""
            raise
    return _plausible(section, body)


def _plausible(section: Section, body: Body) -> Body:
    gyration = (
        float(np.sqrt(principal_moments(body.mass, body.com, body.inertia)[2] / body.mass))
        if body.mass > 0
        else 0.0
    )
    if gyration > LARGEST_GYRATION:
        reason = f"implausible: a radius of gyration of {gyration:.3g} m; are mass and inertia in the right unit?"
        raise section.error(
            reason, "inertia", allowed=f"a radius of gyration up to {LARGEST_GYRATION:g} m"
        )
    return body


def _made_of_parts(section: Section, model: Any, setting: _Setting) -> Body:
    for key in ("mass", "com", "inertia", "products_of_inertia"):
        if section.holds(key):
            raise section.error(
                "follows from the parts", key, allowed="either parts, or mass, com and inertia"
            )
    parts = [_solid(section.sub("parts", i), part, setting) for i, part in enumerate(model.parts)]
    total = sum(parts, shapes.point(0.0, np.zeros(3)))
    with located(section, {"inertia": ("parts",), "mass": ("parts",)}):
        body = Body(model.name, total.mass, total.com, total.inertia, setting.frame)
    return _plausible(section, body)


def _solid(section: Section, part: Any, setting: _Setting) -> shapes.Moments:
    """A part in the body's frame."""
    last = setting.place == len(setting.frames) - 1
    if isinstance(part, ArcModel):
        if setting.place > 1:
            raise section.error(
                "no other axis follows on this body's", "shape", allowed="rod, box, point"
            )
        if part.width >= 2 * part.radius:
            raise section.error(
                "reaches beyond the remote centre", "width", allowed="less than twice the radius"
            )
        start, end = (
            (1 if side == "positive" else -1) * setting.axis(i) for i, side in enumerate(part.sides)
        )
        return shapes.arc(
            start, end, part.radius, section=(part.width, part.height), density=part.density
        )
    if part.frame == "next" and last:
        raise section.error("this is the last body", "frame", allowed="own")
    turn = np.eye(3) if part.frame == "own" else setting.frame.T @ setting.frames[setting.place + 1]
    if isinstance(part, RodModel):
        start, end = np.array(part.start), np.array(part.end)
        if not np.any(end - start):
            raise section.error("the rod has no length", "end", allowed="another place than start")
        return shapes.rod(start, end, part.diameter, part.density).turned(turn)
    mass = _mass_of(section, part, setting.joints)
    size = np.array(part.size) if isinstance(part, BoxModel) else np.zeros(3)
    return shapes.box(mass, np.array(part.at), size).turned(turn)


def _mass_of(section: Section, part: Any, joints: Sequence[Joint]) -> float:
    if not isinstance(part.mass, str):
        if part.mass < 0:
            raise section.error("not a mass", "mass", allowed="0 kg or more")
        return float(part.mass)
    motor = joints[_MOTORS.index(part.mass)].motor
    if motor is None or motor.mass is None:
        reason = (
            "this joint has no motor"
            if motor is None
            else f"the file of {motor.name} gives no mass"
        )
        raise section.error(
            reason, "mass", allowed="a quantity, or the motor of a joint, whose file gives its mass"
        )
    return motor.mass


def _inertia(section: Section, model: Any) -> Array:
    """The tensor about the frame's origin (3, 3): products −∫xy dm, whatever sign the file uses."""
    inertia, convention = model.inertia, model.products_of_inertia
    if inertia is None:
        if model.mass > 0:
            raise section.error("missing: a body with mass has an inertia", "inertia")
        return np.zeros((3, 3))
    sign = -1.0 if convention == "cad" else 1.0
    xy, xz, yz = sign * inertia.xy, sign * inertia.xz, sign * inertia.yz
    if convention is None and any((xy, xz, yz)):
        reason = "missing: the sign convention of the products of inertia"
        allowed = "cad (∫xy dm, as CAD programs print) or tensor (−∫xy dm)"
        raise section.error(reason, "products_of_inertia", allowed=allowed)
    return np.array([[inertia.xx, xy, xz], [xy, inertia.yy, yz], [xz, yz, inertia.zz]])


def _sign_hint(model: Any, tensor: Array) -> str:
    """What to try where no body can have the tensor."""
    convention = model.products_of_inertia
    if convention is None:
        return ""
    other = "tensor" if convention == "cad" else "cad"
    hint = f"; the usual cause is the sign of the products of inertia: here products_of_inertia is {convention}"
    flipped = principal_moments(
        model.mass, frozen(model.com, (3,)), 2 * np.diag(np.diag(tensor)) - tensor
    )
    if possible(flipped):
        listed = ", ".join(f"{moment:.4g}" for moment in flipped)
        return f"{hint}, and with {other} the moments are ({listed}) kg*m^2, which a body can have: try it"
    return f"{hint}, but {other} would not do either; check that it is about the origin of the body frame, and its unit"
