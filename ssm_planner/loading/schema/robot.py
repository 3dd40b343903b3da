"""Schema of a robot file: geometry, bodies, joints with drive and motor, limits."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field as PydanticField

from ssm_planner import units
from ssm_planner.loading.schema.common import (
    Axis,
    Field,
    Model,
    Part,
    Text,
    interval,
    model_of,
    quantity,
    vector,
    wrong,
)
from ssm_planner.problem.robot import Joint
from ssm_planner.problem.value import Sign

Interval = tuple[float, float]
_REFERENCE = {"anyOf": [{"type": "string", "description": "a file, relative to this one"}, {"type": "object"}]}


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


def _reference(value: object) -> Any:
    if isinstance(value, dict) or (isinstance(value, str) and value.strip()):
        return value
    raise wrong("neither a file name nor a mapping", "a file, relative to this one, or the file's content")


Rotations = Annotated[tuple[tuple[str, float], ...], Field(_rotations, {"type": "array", "items": {"type": "string"}})]
Reference = Annotated[Any, Field(_reference, _REFERENCE)]


class AxesModel(Model):
    """Unit vectors in the base frame at q = 0."""

    joint1: Axis
    joint2: Axis
    joint3: Axis


class GeometryModel(Model):
    """Axes, or angles: see mechanism.py."""

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
    """See values.Body; frame is relative to the previous body at q = 0."""

    name: Text
    mass: Annotated[float, quantity("mass", at_least=0)]
    com: Annotated[tuple[float, float, float], vector("length", "length", "length")] = (0.0, 0.0, 0.0)
    inertia: InertiaModel | None = None
    products_of_inertia: Literal["cad", "tensor"] | None = None
    frame: Rotations


_ACTUATION = {"drive": (Reference | None, None), "motor": (Reference | None, None), "motor_direction": (Sign, 1)}


def _joint(*kinds: str) -> Any:
    return model_of(
        Joint, {**dict(zip(("position", "velocity", "acceleration", "jerk"), kinds, strict=True)), **_ACTUATION}
    )


RevoluteModel = _joint("angle", "angular_velocity", "angular_acceleration", "angular_jerk")
PrismaticModel = _joint("length", "velocity", "acceleration", "jerk")


class JointsModel(Model):
    roll: Annotated[Any, Part(RevoluteModel)]
    tilt: Annotated[Any, Part(RevoluteModel)]
    spin: Annotated[Any, Part(RevoluteModel)]
    insertion: Annotated[Any, Part(PrismaticModel)]


class TaskLimitsModel(Model):
    """Ranges of the task coordinates."""

    roll: Annotated[Interval, interval("angle")] | None = None
    tilt: Annotated[Interval, interval("angle")] | None = None
    spin: Annotated[Interval, interval("angle")] | None = None
    depth: Annotated[Interval, interval("length")] | None = None


class RobotModel(Model):
    """See values.Robot."""

    name: Text
    source: Text | None = None
    geometry: GeometryModel
    gravity: Annotated[tuple[float, float, float], vector("acceleration", "acceleration", "acceleration")]
    bodies: Annotated[list[BodyModel], PydanticField(min_length=4, max_length=4)]
    joints: JointsModel
    limits: TaskLimitsModel = TaskLimitsModel()
