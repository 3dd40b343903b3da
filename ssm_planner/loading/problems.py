"""A problem file → Problem: what the file may say, and where each field of the value stands in it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ssm_planner.loading.eye import EyeModel, eye_from
from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.robots import TaskLimitsModel, robot_from, task_limits
from ssm_planner.loading.schema.common import Model, Part, Reference, Text, model_of, of, quantity, vector, wrong
from ssm_planner.loading.yaml_nodes import Section, follow
from ssm_planner.problem.limits import TASK, Limit, SpeedLimit, TaskRange, TaskRate
from ssm_planner.problem.motion import LARGEST_GRID, Dwell, Free, Joints, Motion, Point, Scan, Straight, Task, Tip
from ssm_planner.problem.problem import Objective, Planner, Problem

Angle = Annotated[float, quantity("angle")]
Length = Annotated[float, quantity("length")]
Turning = Annotated[float, quantity("angular_velocity")]
JointValues = Annotated[tuple[float, float, float, float], vector("angle", "angle", "angle", "length")]
TipPosition = Annotated[tuple[float, float, float], vector("length", "length", "length")]
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

    joints: JointValues | None = None
    tip: TipPosition | None = None

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
    """A motion that may be asked to last."""

    duration: Annotated[float, of(Straight, "duration", "time")] | None = None
    """Asked for; the motion then takes it with the least motor heat."""


class ToAngle(Timed):
    """To an angle."""

    to: Angle


class ToLength(Timed):
    """To a length."""

    to: Length


class ToTask(Timed):
    """Straight to a point in task coordinates."""

    to: TaskModel


class ToPoint(Timed):
    """To a point in any form."""

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
    """Ranges, rates and speeds of the task."""

    tip_speed: Speed | None = None
    roll_rate: Rate | None = None
    tilt_rate: Rate | None = None
    spin_rate: Rate | None = None
    insertion_speed: Speed | None = None


class ProblemModel(Model):
    """What a problem file may say."""

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


Place = tuple[str | int, ...]
"""Keys and list positions that lead to a value of the file."""


def problem_from(section: Section) -> Problem:
    """The problem that a section describes, its robot loaded. Raises ProblemError."""
    model = validated(section, ProblemModel)
    robot = robot_from(follow(section, "robot"))
    missing = [name for name in TASK if getattr(model.start, name) is None]
    if model.start.joints is None and model.start.tip is None and missing:
        raise section.error(
            "missing: a start says where all of the tool is", "start", missing[0], allowed=", ".join(TASK)
        )
    with located(section, _places(model)):
        problem = Problem(
            name=model.name or section.name,
            robot=robot,
            start=_point(section.sub("start"), model.start),
            motion=tuple(_motion(section.sub("motion", i), entry) for i, entry in enumerate(model.motion)),
            limits=(
                *(TaskRange(name, *ends) for name, ends in task_limits(model.limits).items()),
                *_speeds(model.limits),
            ),
            objective=model.objective,
            duration=model.duration,
            planner=model.planner,
            start_rate=_rates(model.start_rate),
            end_rate=_rates(model.end_rate),
            file=None if section.file is None else str(section.file),
            eye=None if model.eye is None else eye_from(section.sub("eye"), model.eye),
        )
        problem.check_total()
    return problem


def _places(model: ProblemModel) -> dict[str, Place]:
    """Where fields of a Problem stand in the file, by the names that its messages use."""
    places: dict[str, Place] = {"start.values": ("start", "joints"), "start.position": ("start", "tip")}
    for i, entry in enumerate(model.motion):
        (name,) = entry.model_fields_set
        here, there = f"motion[{i}]", ("motion", i, name)
        points: dict[str, Place] = {f"{here}.to": (*there, "to")}
        if entry.free is not None:
            passed = range(len(entry.free.through))
            points |= {f"{here}.through[{k}]": (*there, "through", k) for k in passed}
        for field, place in points.items():
            places |= {f"{field}.values": (*place, "joints"), f"{field}.position": (*place, "tip"), field: place}
        if entry.scan is not None and entry.scan.pattern == "ring":
            places[f"{here}.diameters"] = (*there, "diameter")
        if name not in ("straight", "free", "scan", "dwell"):
            places[f"{here}.{'depth' if name == 'insert' else name}"] = (*there, "to")
        places[here] = (*there, "to") if entry.straight is not None else there
    return places


def _speeds(model: LimitsModel) -> list[Limit]:
    """Limits on the rates of task coordinates and on speeds of the tool."""
    found: list[Limit] = []
    for name in TASK:
        rate = getattr(model, TaskRate.field_of(name))
        if rate is not None:
            found.append(TaskRate(name, rate))
    for kind in SpeedLimit.__subclasses__():
        largest = getattr(model, kind.field, None)
        if largest is not None:
            found.append(kind(largest))
    return found


def _motion(section: Section, entry: EntryModel) -> Motion:
    (name,) = entry.model_fields_set
    line = section.line(name)
    if entry.dwell is not None:
        return Dwell(entry.dwell, name, line)
    if entry.scan is not None:
        return _scan(section.sub(name), entry.scan)
    to = section.sub(name, "to")
    if entry.free is not None:
        passed = enumerate(entry.free.through)
        through = tuple(_point(section.sub(name, "through", k), point) for k, point in passed)
        return Free(_point(to, entry.free.to), through, entry.free.duration, name, line)
    if entry.straight is not None:
        return Straight(**_given(entry.straight.to), duration=entry.straight.duration, name=name, line=line)
    model = getattr(entry, name)
    coordinate = "depth" if name == "insert" else name
    return Straight(**{coordinate: model.to}, duration=model.duration, name=name, line=line)


def _scan(section: Section, model: Any) -> Scan:
    diameters: tuple[float, ...] = ()
    if model.pattern != "raster":
        diameters = (model.diameter or 0.0,) if model.pattern == "ring" else model.diameters
    with located(section):
        return Scan(
            Task(**_given(model.at), line=section.line("at")),
            model.distance,
            diameters,
            rows=int(model.rows or 0),
            columns=int(model.columns or 0),
            spacing=model.spacing,
            dwell=model.dwell,
            name=model.pattern,
            line=section.line(),
        )


def _given(model: TaskModel | RateModel) -> dict[str, float]:
    """What is given of task coordinates, or of their rates."""
    return {name: value for name in TASK if (value := getattr(model, name)) is not None}


def _rates(model: RateModel) -> dict[str, float]:
    return {name: rate for name, rate in _given(model).items() if rate}


def _point(section: Section, model: PointModel) -> Point:
    line = section.line()
    with located(section, {"values": ("joints",), "position": ("tip",)}):
        if model.joints is not None:
            return Joints(model.joints, line)
        if model.tip is not None:
            return Tip(model.tip, float(model.spin or 0.0), line)
        return Task(**_given(model), line=line)
