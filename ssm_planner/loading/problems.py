"""A problem file → Problem: every point inside the limits that hold for it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ssm_planner.loading.eye import eye_from
from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.robots import robot_from, task_limits
from ssm_planner.loading.schema.problem import (
    EntryModel,
    LimitsModel,
    PointModel,
    ProblemModel,
    RateModel,
    ScanModel,
    TaskModel,
)
from ssm_planner.loading.yaml_nodes import Section, follow
from ssm_planner.problem.limits import TASK, Limit, SpeedLimit, TaskRange, TaskRate
from ssm_planner.problem.motion import Dwell, Free, Joints, Motion, Point, Scan, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Range

SLACK = 1e-9
"""rad or m, so that a target may sit on a limit."""


def problem_from(section: Section) -> Problem:
    """The problem that a section describes, its robot loaded. Raises ProblemError."""
    model = validated(section, ProblemModel)
    robot = robot_from(follow(section, "robot"))
    limits = _narrowed(section.sub("limits"), robot, task_limits(model.limits))
    missing = [name for name in TASK if getattr(model.start, name) is None]
    if model.start.joints is None and model.start.tip is None and missing:
        raise section.error(
            "missing: a start says where all of the tool is", "start", missing[0], allowed=", ".join(TASK)
        )
    start = _target(section.sub("start"), model.start, robot, limits)
    eye = None if model.eye is None else eye_from(section.sub("eye"), model.eye)
    if eye is not None:
        with located(section.sub("eye")):
            eye.check_port()
    entries = enumerate(model.motion)
    motion = tuple(_motion(section.sub("motion", i), entry, robot, limits) for i, entry in entries)
    keys: dict[str, tuple[str | int, ...]] = {}
    for i, entry in enumerate(model.motion):
        if entry.scan is not None:
            diameters = "diameter" if entry.scan.pattern == "ring" else "diameters"
            keys |= {f"motion[{i}].diameters": ("motion", i, "scan", diameters), f"motion[{i}]": ("motion", i, "scan")}
    with located(section, keys):
        problem = Problem(
            name=model.name or section.name,
            robot=robot,
            start=start,
            motion=motion,
            limits=(*(TaskRange(name, *ends) for name, ends in limits.items()), *_speeds(model.limits)),
            objective=model.objective,
            duration=model.duration,
            planner=model.planner,
            start_rate=_rates(model.start_rate),
            end_rate=_rates(model.end_rate),
            file=None if section.file is None else str(section.file),
            eye=eye,
        )
        problem.check_total()
    return problem


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


def _narrowed(section: Section, robot: Robot, own: Mapping[str, Range]) -> dict[str, Range]:
    """The robot's ranges narrowed by the problem's; depth also by the travel of joint 4."""
    result = robot.ranges
    for name, range_ in (("depth", robot.travel), *own.items()):
        if name not in result:
            result[name] = range_
            continue
        low, high = max(result[name][0], range_[0]), min(result[name][1], range_[1])
        if not low < high:
            raise section.error(
                "nothing is left of the range that the robot allows", name, allowed=_range(name, result[name])
            )
        result[name] = (low, high)
    return result


def _motion(section: Section, entry: EntryModel, robot: Robot, limits: Mapping[str, Range]) -> Motion:
    (name,) = entry.model_fields_set
    line = section.line(name)
    if entry.dwell is not None:
        return Dwell(entry.dwell, name, line)
    if entry.scan is not None:
        return _scan(section.sub(name), entry.scan, robot, limits)
    here = section.sub(name, "to")
    if entry.free is not None:
        to = _target(here, entry.free.to, robot, limits)
        passed = enumerate(entry.free.through)
        through = tuple(_target(section.sub(name, "through", k), point, robot, limits) for k, point in passed)
        return Free(to, through, entry.free.duration, name, line)
    if entry.straight is not None:
        point = _target(here, entry.straight.to, robot, limits)
        assert isinstance(point, Task)
        return Straight(**point.given, duration=entry.straight.duration, name=name, line=line)
    coordinate = "depth" if name == "insert" else name
    model = getattr(entry, name)
    _inside(here, (), coordinate, model.to, limits)
    return Straight(**{coordinate: model.to}, duration=model.duration, name=name, line=line)


def _scan(section: Section, model: ScanModel, robot: Robot, limits: Mapping[str, Range]) -> Scan:
    diameters: tuple[float, ...] = ()
    if model.pattern != "raster":
        diameters = (model.diameter or 0.0,) if model.pattern == "ring" else model.diameters
    at = _target(section.sub("at"), model.at, robot, limits)
    assert isinstance(at, Task)
    with located(section):
        return Scan(
            at,
            model.distance,
            diameters,
            rows=int(model.rows or 0),
            columns=int(model.columns or 0),
            spacing=model.spacing,
            dwell=model.dwell,
            name=model.pattern,
            line=section.line(),
        )


def _rates(model: RateModel) -> dict[str, float]:
    rates = {name: getattr(model, name) for name in TASK}
    return {name: rate for name, rate in rates.items() if rate}


def _target(section: Section, point: TaskModel, robot: Robot, limits: Mapping[str, Range]) -> Point:
    line = section.line()
    if isinstance(point, PointModel) and point.joints is not None:
        _joints_inside(section, point.joints, robot, limits)
        return Joints(point.joints, line)
    if isinstance(point, PointModel) and point.tip is not None:
        _tip_inside(section, point.tip, limits)
        _inside(section, ("spin",), "spin", float(point.spin or 0.0), limits)
        return Tip(point.tip, float(point.spin or 0.0), line)
    values = ((name, getattr(point, name)) for name in TASK)
    task = {name: value for name, value in values if value is not None}
    for name, value in task.items():
        _inside(section, (name,), name, value, limits)
    return Task(**task, line=line)


def _inside(section: Section, path: tuple[str, ...], name: str, value: float, limits: Mapping[str, Range]) -> None:
    low, high = limits.get(name, (-math.inf, math.inf))
    if not low - SLACK <= value <= high + SLACK:
        raise section.error(f"outside the limits of {name}", *path, allowed=_range(name, (low, high)))


def _joints_inside(
    section: Section, joints: tuple[float, float, float, float], robot: Robot, limits: Mapping[str, Range]
) -> None:
    for i, (value, joint) in enumerate(zip(joints, robot.joints, strict=True)):
        low, high = joint.position
        if not low - SLACK <= value <= high + SLACK:
            raise section.error(
                f"outside the position limits of joint {i + 1} ({joint.name})",
                "joints",
                i,
                allowed=_range(joint.name, joint.position),
            )
    depth = robot.geometry.insertion_sign * joints[3]
    low, high = limits["depth"]
    if not low - SLACK <= depth <= high + SLACK:
        raise section.error(
            f"gives a depth of {depth * 1e3:g} mm, outside the limits",
            "joints",
            3,
            allowed=_range("depth", (low, high)),
        )


def _tip_inside(section: Section, tip: tuple[float, float, float], limits: Mapping[str, Range]) -> None:
    distance = math.hypot(*tip)
    if distance < 1e-6:
        raise section.error(
            "the tip at the remote centre leaves roll and tilt open",
            "tip",
            allowed="a point away from [0 mm, 0 mm, 0 mm]; or roll, tilt, spin and depth",
        )
    low, high = limits["depth"]
    if distance > max(abs(low), abs(high)) + SLACK:
        raise section.error(
            f"{distance * 1e3:.4g} mm from the remote centre, outside the limits of depth",
            "tip",
            allowed=_range("depth", (low, high)),
        )


def _range(name: str, range_: Range) -> str:
    scale, unit = (1e3, "mm") if name in ("depth", "insertion") else (180 / math.pi, "deg")
    low, high = (f"{bound * scale:.6g} {unit}" for bound in range_)
    return f"{low} to {high}"
