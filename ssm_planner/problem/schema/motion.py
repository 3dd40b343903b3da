"""Schema of a problem file: start, motion list, limits, objective."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ssm_planner.problem.schema.common import Model, Text, quantity, wrong
from ssm_planner.problem.schema.eye import EyeModel
from ssm_planner.problem.schema.points import Angle, Length, PointModel, RateModel, TaskModel
from ssm_planner.problem.schema.robot import Reference, TaskLimitsModel
from ssm_planner.problem.schema.scan import ScanModel

LONGEST_MOTION = 10_000
MOST_POINTS = 200
"""Points that one motion passes without stopping."""
Rate = Annotated[float, quantity("angular_velocity", above=0)]


class Timed(Model):
    duration: Annotated[float, quantity("time", above=0)] | None = None
    """Asked for; the motion then takes it with the least motor heat."""


class ToAngle(Timed):
    to: Angle


class ToLength(Timed):
    to: Length


class ToTask(Timed):
    to: TaskModel


class ToPoint(Timed):
    to: PointModel
    through: Annotated[tuple[PointModel, ...], Field(max_length=MOST_POINTS)] = ()
    """Points that are passed without stopping."""


class EntryModel(Model):
    """One motion; exactly one key."""

    tilt: ToAngle | None = None
    roll: ToAngle | None = None
    spin: ToAngle | None = None
    insert: ToLength | None = None
    straight: ToTask | None = None
    free: ToPoint | None = None
    dwell: Annotated[float, quantity("time", above=0)] | None = None
    scan: ScanModel | None = None

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
    roll_rate: Rate | None = None
    tilt_rate: Rate | None = None
    spin_rate: Rate | None = None
    insertion_speed: Annotated[float, quantity("velocity", above=0)] | None = None


class ProblemModel(Model):
    """See values.Problem."""

    name: Text | None = None
    """By default the file's name without its ending."""
    robot: Reference
    start: PointModel
    motion: Annotated[list[EntryModel], Field(min_length=1, max_length=LONGEST_MOTION)]
    limits: LimitsModel = LimitsModel()
    eye: EyeModel | None = None
    objective: Literal["time", "time then heat", "effort"] = "time then heat"
    duration: Annotated[float, quantity("time", above=0)] | None = None
    planner: Literal["optimal", "toppra"] = "optimal"
    start_rate: RateModel = RateModel()
    end_rate: RateModel = RateModel()
