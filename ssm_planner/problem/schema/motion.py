"""Schema of a problem file: start, motion list, limits, objective."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ssm_planner.problem.schema.common import Model, Text, quantity, vector, wrong
from ssm_planner.problem.schema.robot import Reference, TaskLimitsModel

LONGEST_MOTION = 10_000
Angle = Annotated[float, quantity("angle")]
Length = Annotated[float, quantity("length")]
Joints = Annotated[tuple[float, float, float, float], vector("angle", "angle", "angle", "length")]
Tip = Annotated[tuple[float, float, float], vector("length", "length", "length")]
_FORMS = "task coordinates (roll, tilt, spin, depth), or joints: [four values], or tip: [x, y, z] with spin"


class TaskModel(Model):
    """Any of the task coordinates; those left out are held."""

    roll: Angle | None = None
    tilt: Angle | None = None
    spin: Angle | None = None
    depth: Length | None = None

    @model_validator(mode="before")
    @classmethod
    def _not_empty(cls, data: Any) -> Any:
        if data == {}:
            raise wrong("no point is given", _FORMS if "joints" in cls.model_fields else "roll, tilt, spin or depth")
        return data


class PointModel(TaskModel):
    """A point in one of three forms."""

    joints: Joints | None = None
    tip: Tip | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_form(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        if "joints" in data and len(data) > 1:
            other = next(key for key in data if key != "joints")
            raise wrong("given besides joints, which say everything", _FORMS, other)
        if "tip" in data:
            for key in ("roll", "tilt", "depth"):
                if key in data:
                    raise wrong("given besides tip, which fixes roll, tilt and depth", _FORMS, key)
            if "spin" not in data:
                raise wrong("missing: a tip position does not fix the spin", _FORMS, "spin")
        return data


class ToAngle(Model):
    to: Angle


class ToLength(Model):
    to: Length


class ToTask(Model):
    to: TaskModel


class ToPoint(Model):
    to: PointModel


class EntryModel(Model):
    """One motion; exactly one key."""

    tilt: ToAngle | None = None
    roll: ToAngle | None = None
    spin: ToAngle | None = None
    insert: ToLength | None = None
    straight: ToTask | None = None
    free: ToPoint | None = None
    dwell: Annotated[float, quantity("time", above=0)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_key(cls, data: Any) -> Any:
        if isinstance(data, dict) and len(data) != 1:
            found = (
                "no motion is given" if not data else f"{len(data)} motions in one entry ({', '.join(map(str, data))})"
            )
            raise wrong(found, f"one motion per list entry: {', '.join(cls.model_fields)}")
        return data


class LimitsModel(TaskLimitsModel):
    tip_speed: Annotated[float, quantity("velocity", above=0)] | None = None


class ProblemModel(Model):
    """See values.Problem."""

    name: Text | None = None
    """By default the file's name without its ending."""
    robot: Reference
    start: PointModel
    motion: Annotated[list[EntryModel], Field(min_length=1, max_length=LONGEST_MOTION)]
    limits: LimitsModel = LimitsModel()
    objective: Literal["time"] = "time"
