"""A problem file → Problem: every point inside the limits that hold for it."""

from __future__ import annotations

from typing import Any

from ssm_planner.loading.eye import eye_from
from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.robots import robot_from, task_limits
from ssm_planner.loading.schema.problem import (
    EntryModel,
    LimitsModel,
    PointModel,
    ProblemModel,
    RateModel,
    TaskModel,
)
from ssm_planner.loading.yaml_nodes import Section, follow
from ssm_planner.problem.limits import TASK, Limit, SpeedLimit, TaskRange, TaskRate
from ssm_planner.problem.motion import Dwell, Free, Joints, Motion, Point, Scan, Straight, Task, Tip
from ssm_planner.problem.problem import Problem

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
