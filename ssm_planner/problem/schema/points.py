"""Schema of points and rates of a motion."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import model_validator

from ssm_planner.problem.schema.common import Model, quantity, vector, wrong

Angle = Annotated[float, quantity("angle")]
Length = Annotated[float, quantity("length")]
Turning = Annotated[float, quantity("angular_velocity")]
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


class RateModel(Model):
    """Rates of task coordinates at one end of a motion."""

    roll: Turning | None = None
    tilt: Turning | None = None
    spin: Turning | None = None
    depth: Annotated[float, quantity("velocity")] | None = None
