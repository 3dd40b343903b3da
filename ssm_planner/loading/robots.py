"""A robot file → Robot, with the drives and motors that it names; what the file may say."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from ssm_planner.loading.drives import drive_from
from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.mechanism import BodyModel, GeometryModel, bodies_from, geometry_from
from ssm_planner.loading.motors import motor_from
from ssm_planner.loading.schema.common import Model, Part, Reference, Text, interval, model_of, vector
from ssm_planner.loading.yaml_nodes import Section, follow
from ssm_planner.problem.limits import TASK, TaskRange
from ssm_planner.problem.robot import JOINTS, Joint, Robot, frozen
from ssm_planner.problem.value import Sign
from ssm_planner.typing import Range

_ACTUATION: dict[str, Any] = {
    "drive": (Reference | None, None),
    "motor": (Reference | None, None),
    "alternatives": (list[Reference], []),
    "motor_direction": (Sign, 1),
}


def _model(*kinds: str) -> Any:
    return model_of(
        Joint, {**dict(zip(("position", "velocity", "acceleration", "jerk"), kinds, strict=True)), **_ACTUATION}
    )


RevoluteModel = _model("angle", "angular_velocity", "angular_acceleration", "angular_jerk")
PrismaticModel = _model("length", "velocity", "acceleration", "jerk")


class JointsModel(Model):
    """The four joints."""

    roll: Annotated[Any, Part(RevoluteModel)]
    tilt: Annotated[Any, Part(RevoluteModel)]
    spin: Annotated[Any, Part(RevoluteModel)]
    insertion: Annotated[Any, Part(PrismaticModel)]


class TaskLimitsModel(Model):
    """Ranges of the task coordinates."""

    roll: Annotated[tuple[float, float], interval("angle")] | None = None
    tilt: Annotated[tuple[float, float], interval("angle")] | None = None
    spin: Annotated[tuple[float, float], interval("angle")] | None = None
    depth: Annotated[tuple[float, float], interval("length")] | None = None


class RobotModel(Model):
    """What a robot file may say."""

    name: Text
    source: Text | None = None
    geometry: GeometryModel
    gravity: Annotated[tuple[float, float, float], vector("acceleration", "acceleration", "acceleration")]
    bodies: Annotated[list[BodyModel], Field(min_length=4, max_length=4)]
    joints: JointsModel
    limits: TaskLimitsModel = TaskLimitsModel()


def robot_from(section: Section) -> Robot:
    """The robot that a section describes. Raises ProblemError."""
    model = validated(section, RobotModel)
    bodies = bodies_from(section.sub("bodies"), model.bodies)
    geometry = geometry_from(section.sub("geometry"), model.geometry, bodies[-1].frame)
    roll, tilt, spin, insertion = (
        _joint(section.sub("joints", name), name, getattr(model.joints, name)) for name in JOINTS
    )
    with located(section):
        return Robot(
            name=model.name,
            geometry=geometry,
            bodies=bodies,
            joints=(roll, tilt, spin, insertion),
            gravity=frozen(model.gravity, (3,)),
            limits=tuple(TaskRange(name, *ends) for name, ends in task_limits(model.limits).items()),
            file=None if section.file is None else str(section.file),
        )


def task_limits(model: TaskLimitsModel) -> dict[str, Range]:
    """The ranges that are given, by task coordinate."""
    ranges = ((name, getattr(model, name)) for name in TASK)
    return {name: range_ for name, range_ in ranges if range_ is not None}


def _joint(section: Section, name: str, model: Any) -> Joint:
    drive = None if model.drive is None else drive_from(follow(section, "drive"))
    motor = None if model.motor is None else motor_from(follow(section, "motor"))
    others = range(len(model.alternatives))
    alternatives = tuple(motor_from(follow(section, "alternatives", i, kind="motor")) for i in others)
    kind = "prismatic" if name == "insertion" else "revolute"
    with located(section):
        found = {"drive": drive, "motor": motor, "alternatives": alternatives}
        return Joint(**{**dict(model), "name": name, "kind": kind, **found})
