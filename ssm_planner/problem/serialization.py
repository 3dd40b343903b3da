"""Resolved values as JSON types and back: what plan.json holds of a problem, and the problem rebuilt from it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Annotated, Any

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem.limits import TASK, Limit, TaskRange, TaskRate, ToolLimit
from ssm_planner.problem.motion import (
    Dwell,
    Follow,
    Free,
    Joints,
    Motion,
    Point,
    Scan,
    Straight,
    Task,
    Tip,
)
from ssm_planner.problem.problem import Eye, Problem, TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.value import (
    Interval,
    Names,
    Positive,
    built,
    check_mapping,
    converted,
    wrong,
)

PRIMITIVE = {type(None), bool, int, float, str}
"""What most fields hold, and JSON as it is."""


def plain(value: Any) -> Any:
    """Dataclasses, arrays and mappings as JSON types; limits by the names of what they limit."""
    kind: Any = type(value)
    if kind in PRIMITIVE:
        return value
    if kind is tuple or kind is list:
        return [plain(item) for item in value]
    if kind is np.ndarray:
        return value.tolist()
    if kind in _SPECIAL:
        return _SPECIAL[kind](value)
    if names := _names(kind):
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def robot_hash(robot: Robot) -> str:
    """SHA-256 of a robot's resolved values, whatever files they came from."""
    return hashlib.sha256(robot_text(robot).encode()).hexdigest()


def robot_text(robot: Robot) -> str:
    """A robot's resolved values as JSON, whatever files they came from; of the one last asked for it is known."""
    global _last
    known = _last
    if known is None or known[0] is not robot:
        known = _last = robot, json.dumps(_without_files(plain(robot)), sort_keys=True)
    return known[1]


_last: tuple[Robot, str] | None = None


def _without_files(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without_files(item) for key, item in data.items() if key != "file"}
    return [_without_files(item) for item in data] if isinstance(data, list) else data


@cache
def _names(cls: Any) -> tuple[str, ...]:
    """Of the fields of a dataclass; none of another class."""
    return (
        tuple(field.name for field in dataclasses.fields(cls))
        if dataclasses.is_dataclass(cls)
        else ()
    )


def _robot(robot: Robot) -> dict[str, Any]:
    # corners and lightest are of a planner's making
    own = {
        name: plain(getattr(robot, name))
        for name in _names(Robot)
        if name not in ("corners", "lightest")
    }
    return own | {"limits": plain(robot.ranges)}


def _problem(problem: Problem) -> dict[str, Any]:
    stated = {field: bound for field, bound in limits_to_plain(problem).items() if field != "eye"}
    return {name: plain(getattr(problem, name)) for name in _names(Problem)} | stated


def _point(point: Point) -> dict[str, Any]:
    """A point as plan.json states it: one of task, joints, tip (with spin)."""
    return {
        "task": point.given if isinstance(point, Task) else None,
        "joints": list(point.values) if isinstance(point, Joints) else None,
        "tip": list(point.position) if isinstance(point, Tip) else None,
        "spin": point.spin if isinstance(point, Tip) else None,
        "line": point.line,
    }


def _motion(motion: Motion) -> dict[str, Any]:
    """An entry of the motion list as plan.json states it, whatever its kind."""
    scan: Any = None
    target: Point | None = None
    if isinstance(motion, Scan):
        target = motion.at
        scan = {name: plain(getattr(motion, name)) for name in _SCAN}
        scan |= {"order": motion.order} if motion.order != "given" else {}
    elif not isinstance(motion, Dwell):
        target = motion.to
    entry = {
        "kind": motion.kind,
        "name": motion.name,
        "target": None if target is None else _point(target),
        "duration": motion.duration,
        "line": motion.line,
        "through": [_point(point) for point in motion.through]
        if isinstance(motion, (Free, Follow))
        else [],
        "scan": scan,
    }
    if isinstance(motion, Free) and motion.spin_free:
        entry["spin_free"] = True
    if isinstance(motion, (Straight, Follow)) and motion.blend is not None:
        entry["blend"] = motion.blend
    if not isinstance(motion, Follow):
        return entry
    more = {"constant_speed": motion.constant_speed, "distance": motion.distance}
    return {
        **entry,
        "curve": motion.curve,
        "file": motion.file,
        **{k: v for k, v in more.items() if v is not None},
    }


_SCAN = ("diameters", "rows", "columns", "spacing", "distance", "dwell")
_KINDS = {"straight": Straight, "free": Free, "path": Follow, "dwell": Dwell, "scan": Scan}


def _point_from(data: Any, where: str) -> Point:
    check_mapping(data, ("task", "joints", "tip", "spin", "line"), where)
    line = {"line": data.get("line")}
    if data.get("joints") is not None:
        point: Point = built(Joints, {"values": data["joints"], **line}, where)
    elif data.get("tip") is not None:
        point = built(Tip, {"position": data["tip"], "spin": data.get("spin"), **line}, where)
    else:
        task = data.get("task")
        check_mapping(task, TASK, f"{where}.task")
        point = built(Task, {**task, **line}, where)
    return point


def _motion_from(data: Any, where: str) -> Motion:
    more = {
        Follow.kind: ("curve", "file", "blend", "constant_speed", "distance"),
        Free.kind: ("spin_free",),
        Straight.kind: ("blend",),
    }
    of_kind = more.get(str(data.get("kind")), ()) if isinstance(data, Mapping) else ()
    check_mapping(
        data, ("kind", "name", "target", "duration", "line", "through", "scan", *of_kind), where
    )
    cls: Any = _KINDS.get(data.get("kind"))
    if cls is None:
        raise wrong(f"{where}.kind", data.get("kind"), ", ".join(_KINDS))
    values = {
        "name": data.get("name", ""),
        "line": data.get("line"),
        "duration": data.get("duration"),
    }
    if cls is Scan:
        del values["duration"]
    if cls is Scan:
        check_mapping(data.get("scan"), (*_SCAN, "order"), f"{where}.scan")
        values |= data["scan"]
    if cls is not Dwell:
        target = _point_from(data.get("target"), f"{where}.target")
        if cls is Straight and isinstance(target, Task):
            values |= target.given
        else:
            values["at" if cls is Scan else "to"] = target
    values |= {name: data[name] for name in of_kind if name in data}
    if cls in (Free, Follow):
        through = data.get("through") or ()
        values["through"] = tuple(
            _point_from(point, f"{where}.through[{k}]") for k, point in enumerate(through)
        )
    motion: Motion = built(cls, values, where)
    return motion


def limits_to_plain(value: Problem | TaskLimits) -> dict[str, Any]:
    """Limits of the task as plan.json states them: ranges and rates by coordinate, the tool's by field, the eye."""
    speeds = {"tip_speed": None, **{limit.field: limit.largest for limit in value.of_tool}}
    stated = {
        "limits": plain(value.ranges),
        **speeds,
        "rates": plain(value.rates),
        "eye": plain(value.eye),
    }
    return stated | {name: plain(getattr(value, name)) for name in ("friction", "payload")}


_SPECIAL: dict[type, Callable[[Any], dict[str, Any]]] = {
    Robot: _robot,
    Problem: _problem,
    TaskLimits: limits_to_plain,
    **dict.fromkeys((Task, Joints, Tip), _point),
    **dict.fromkeys((Straight, Free, Follow, Dwell, Scan), _motion),
}
"""Values whose fields are not their keys."""


@contextmanager
def _named(file: str | None) -> Iterator[None]:
    """Errors of what is read within name the file."""
    try:
        yield
    except ProblemError as error:
        error.file = file
        raise


def problem_from_plain(data: Mapping[str, Any], file: str | None = None) -> Problem:
    """The problem that `plain` made JSON types of, bit for bit; arrays read-only.

    file: named in messages. Raises ProblemError naming the key, its value and what is allowed.
    """
    task = task_limits_from_plain(data, file)
    given: dict[str, Any] = {
        "robot": robot_from_plain(data.get("robot", {}), file),
        "limits": task.limits,
    }
    with _named(file):
        given |= {"friction": task.friction, "payload": task.payload, "eye": task.eye}
        given |= {"start": _point_from(data.get("start"), "problem.start")}
        entries = data.get("motion")
        if not isinstance(entries, (list, tuple)):
            raise wrong("problem.motion", entries, "a list")
        given["motion"] = tuple(
            _motion_from(entry, f"problem.motion[{i}]") for i, entry in enumerate(entries)
        )
        rest = {
            key: item for key, item in data.items() if key not in {*given, *limits_to_plain(task)}
        }
        problem: Problem = built(Problem, rest, "problem", given)
    return problem


def robot_from_plain(data: Mapping[str, Any], file: str | None = None) -> Robot:
    """The robot that `plain` made JSON types of, bit for bit; arrays read-only.

    file: named in messages. Raises ProblemError naming the key, its value and what is allowed.
    """
    with _named(file):
        robot: Robot = built(
            Robot, {**data, "limits": _ranges(data.get("limits"), "robot.limits")}, "robot"
        )
    return robot


def task_limits_from_plain(problem: Mapping[str, Any], file: str | None = None) -> TaskLimits:
    """The limits of the task in a problem that `plain` made JSON types of; those that it does not name are none.

    file: named in messages. Raises ProblemError naming the key, its value and what is allowed.
    """
    with _named(file):
        limits: list[Limit] = _ranges(problem.get("limits"), "problem.limits")
        rates = _by_task(Positive, problem.get("rates"), "problem.rates")
        limits += [TaskRate(name, rate) for name, rate in rates.items()]
        for kind in ToolLimit.kinds():
            largest = converted(Positive | None, problem.get(kind.field), f"problem.{kind.field}")
            limits += [] if largest is None else [kind(largest)]
        eye: Eye | None = converted(Eye | None, problem.get("eye"), "problem.eye", build=True)
        friction: float | None = converted(
            Positive | None, problem.get("friction"), "problem.friction"
        )
        payload: tuple[float, float] | None = converted(
            Interval | None, problem.get("payload"), "problem.payload"
        )
    return TaskLimits(tuple(limits), eye, friction=friction, payload=payload)


def _ranges(data: Any, where: str) -> list[Limit]:
    return [
        TaskRange(name, low, high) for name, (low, high) in _by_task(Interval, data, where).items()
    ]


def _by_task(hint: Any, data: Any, where: str) -> dict[str, Any]:
    """A mapping from task coordinates; none is an empty one."""
    found: dict[str, Any] = converted(
        Annotated[Mapping[str, hint], Names(TASK)], {} if data is None else data, where
    )
    return found
