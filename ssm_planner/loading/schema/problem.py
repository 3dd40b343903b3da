"""Schema of points and rates of a motion.

Schema of a scan: spots on the retina.

Schema of the eye in a problem file, in the base frame at the remote centre.

Schema of a problem file: start, motion list, limits, objective.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ssm_planner.loading.eye import EyeModel
from ssm_planner.loading.schema.common import Model, Part, Text, model_of, of, quantity, vector, wrong
from ssm_planner.loading.schema.robot import Reference, TaskLimitsModel
from ssm_planner.problem.limits import TaskRate
from ssm_planner.problem.motion import LARGEST_GRID, Dwell, Scan, Straight
from ssm_planner.problem.problem import Objective, Planner, Problem

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


KEYS = {"raster": ("rows", "columns"), "ring": ("diameter",), "triple ring": ("diameters",)}
"""What each pattern has beside the common keys."""
Count = Annotated[float, quantity("number", at_least=1)] | None


class _ScanModel(Model):
    @model_validator(mode="before")
    @classmethod
    def _keys_of_its_pattern(cls, data: Any) -> Any:
        pattern = data.get("pattern") if isinstance(data, dict) else None
        if pattern not in KEYS:
            return data
        for key in (key for other, keys in KEYS.items() if other != pattern for key in keys):
            if key in data:
                raise wrong(f"not for the pattern {pattern!r}", f"for it: {', '.join(KEYS[pattern])}", key)
        for key in KEYS[pattern]:
            if key not in data and key != "diameters":
                raise wrong(f"missing: the pattern {pattern!r} needs it", None, key)
        at = data.get("at")
        if isinstance(at, dict) and "tilt" not in at:
            raise wrong("missing: no pattern is there without a tilt", "roll, tilt, spin", "at")
        if isinstance(at, dict) and "depth" in at:
            raise wrong("depth: how deep the tip goes is what distance says", "roll, tilt, spin", "at")
        return data

    @model_validator(mode="after")
    def _sizes(self) -> _ScanModel:
        for name in ("rows", "columns"):
            count = getattr(self, name)
            if count is not None and (count != int(count) or count > LARGEST_GRID):
                raise wrong("not a count", f"a whole number from 1 to {LARGEST_GRID}", name)
        low, middle, high = dict(self)["diameters"]
        if not 0 < low < middle < high:
            raise wrong("not three rings one around the other", "three growing lengths", "diameters")
        return self


ScanModel = model_of(
    Scan,
    {
        "pattern": (Literal["raster", "ring", "triple ring"], ...),
        "at": (TaskModel, ...),
        "distance": "length",
        "spacing": "length",
        "dwell": "time",
        "diameter": (Annotated[float, quantity("length", above=0)] | None, None),
        "diameters": (Annotated[tuple[float, ...], vector("length", "length", "length")], (1e-3, 2e-3, 3e-3)),
        "rows": (Count, None),
        "columns": (Count, None),
    },
    base=_ScanModel,
)
"""What a problem file may say of a scan."""


LONGEST_MOTION = 10_000
MOST_POINTS = 200
"""Points that one motion passes without stopping."""
Rate = Annotated[float, of(TaskRate, "largest", "angular_velocity")]
Speed = Annotated[float, of(TaskRate, "largest", "velocity")]


class Timed(Model):
    duration: Annotated[float, of(Straight, "duration", "time")] | None = None
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
    dwell: Annotated[float, of(Dwell, "duration", "time")] | None = None
    scan: Annotated[Any, Part(ScanModel)] | None = None

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
    tip_speed: Speed | None = None
    roll_rate: Rate | None = None
    tilt_rate: Rate | None = None
    spin_rate: Rate | None = None
    insertion_speed: Speed | None = None


class ProblemModel(Model):
    """See values.Problem."""

    name: Text | None = None
    """By default the file's name without its ending."""
    robot: Reference
    start: PointModel
    motion: Annotated[list[EntryModel], Field(min_length=1, max_length=LONGEST_MOTION)]
    limits: LimitsModel = LimitsModel()
    eye: Annotated[Any, Part(EyeModel)] | None = None
    objective: Objective = "time then heat"
    duration: Annotated[float, of(Problem, "duration", "time")] | None = None
    planner: Planner = "optimal"
    start_rate: RateModel = RateModel()
    end_rate: RateModel = RateModel()
