"""Convert values to JSON types and back, as plan.json stores them.

The values are complete: all files that a problem names have been read.
"""

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
    attributes,
    built,
    check_mapping,
    converted,
    wrong,
)
from ssm_planner.typing import Fields, JsonObject

PRIMITIVE = {type(None), bool, int, float, str}
"""Types that JSON represents directly."""
ADDED = ("no_load_current", "gearhead", "belt")
"""Fields that earlier versions do not have. Without a value, they do not change a certificate."""


def plain(value: Any) -> Any:
    """Convert a value to JSON types. Dataclasses become mappings, and arrays become lists.

    The limits of a problem or a robot become a mapping from the limited quantity to its bound.
    """
    value_type: Any = type(value)
    if value_type in PRIMITIVE:
        return value
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if value_type is np.ndarray:
        return value.tolist()
    if value_type in _SPECIAL:
        return _SPECIAL[value_type](value)
    if names := _names(value_type):
        items = ((name, plain(getattr(value, name))) for name in names)
        return {name: item for name, item in items if item is not None or name not in ADDED}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    return value.item() if isinstance(value, np.generic) else value


def robot_hash(robot: Robot) -> str:
    """Return the SHA-256 of a robot's data, which does not depend on the names of its files."""
    return hashlib.sha256(robot_text(robot).encode()).hexdigest()


def robot_text(robot: Robot) -> str:
    """Return a robot's data as JSON text without the names of files.

    The text of the last robot is cached, because one plan needs it several times.
    """
    global _last
    cached = _last
    if cached is None or cached[0] is not robot:
        cached = _last = robot, json.dumps(_without_files(plain(robot)), sort_keys=True)
    return cached[1]


_last: tuple[Robot, str] | None = None


def _without_files(data: Any) -> Any:
    """Return a copy of JSON data without the names of files."""
    if isinstance(data, dict):
        return {key: _without_files(item) for key, item in data.items() if key != "file"}
    return [_without_files(item) for item in data] if isinstance(data, list) else data


EXCESS_KEY = "wider"
"""Key of Problem.excess_ranges in plan.json."""


@cache
def _names(cls: Any) -> tuple[str, ...]:
    """Return the field names of a dataclass, or an empty tuple for any other class."""
    if dataclasses.is_dataclass(cls):
        return tuple(field.name for field in dataclasses.fields(cls))
    return ()


def _robot(robot: Robot) -> JsonObject:
    """Convert a robot to the form in plan.json.

    The planner computes `corners` and `lightest` again, so they are omitted.
    """
    fields = {
        name: plain(getattr(robot, name))
        for name in _names(Robot)
        if name not in ("corners", "lightest")
    }
    return fields | {"limits": plain(robot.ranges)}


def _problem(problem: Problem) -> JsonObject:
    """Convert a problem to the form in plan.json."""
    bounds = {field: bound for field, bound in limits_to_plain(problem).items() if field != "eye"}
    fields = {name: plain(getattr(problem, name)) for name in _names(Problem)} | bounds
    return {EXCESS_KEY if name == "excess_ranges" else name: fields[name] for name in fields}


def _point(point: Point) -> JsonObject:
    """Convert a point to the form in plan.json, in which task, joints or tip is not None."""
    return {
        "task": point.set_coordinates if isinstance(point, Task) else None,
        "joints": plain(getattr(point, "values", None)),
        "tip": plain(getattr(point, "position", None)),
        "spin": point.spin if isinstance(point, Tip) else None,
        "line": point.line,
    }


def _motion(motion: Motion) -> JsonObject:
    """Convert an entry of the motion list to the form in plan.json."""
    target = getattr(motion, "to", getattr(motion, "at", None))
    scan = None
    if isinstance(motion, Scan):
        scan = plain(attributes(motion, _SCAN))
        scan |= {"order": motion.order} if motion.order != "given" else {}
    kind_fields = attributes(motion, _OF_KIND.get(motion.kind, ()))
    return {
        "kind": motion.kind,
        "name": motion.name,
        "target": plain(target),
        "duration": motion.duration,
        "line": motion.line,
        "through": plain(getattr(motion, "through", ())),
        "scan": scan,
        **{name: value for name, value in kind_fields.items() if value or name in _ALWAYS},
    }


_SCAN = ("diameters", "rows", "columns", "spacing", "distance", "dwell")
_OF_KIND: dict[str, tuple[str, ...]] = {
    Follow.kind: ("blend", "curve", "file", "constant_speed", "distance"),
    Free.kind: ("spin_free",),
    Straight.kind: ("blend",),
}
"""Keys that only motions of one kind have."""
_ALWAYS = ("curve", "file")
"""Those of these keys that plan.json contains even if their value is None."""
_KINDS = {kind.kind: kind for kind in (Straight, Free, Follow, Dwell, Scan)}


def _point_from(data: Any, location: str) -> Point:
    """Build a point from its form in plan.json.

    `location` is the key of the data. Raises ProblemError if the data are invalid.
    """
    check_mapping(data, ("task", "joints", "tip", "spin", "line"), location)
    line = {"line": data.get("line")}
    if data.get("joints") is not None:
        point = built(Joints, {"values": data["joints"], **line}, location)
    elif data.get("tip") is not None:
        point = built(Tip, {"position": data["tip"], "spin": data.get("spin"), **line}, location)
    else:
        task = data.get("task")
        check_mapping(task, TASK, f"{location}.task")
        point = built(Task, {**task, **line}, location)
    return point


def _motion_from(data: Any, location: str) -> Motion:
    """Build an entry of the motion list from its form in plan.json.

    `location` is the key of the data. Raises ProblemError if the data are invalid.
    """
    kind = str(data.get("kind")) if isinstance(data, Mapping) else ""
    own_keys = ("name", "line", *_OF_KIND.get(kind, ()))
    check_mapping(data, ("kind", "target", "duration", "through", "scan", *own_keys), location)
    cls: Any = _KINDS.get(kind)
    if cls is None:
        raise wrong(f"{location}.kind", data.get("kind"), ", ".join(_KINDS))
    values = {name: data[name] for name in own_keys if name in data}
    if cls is Scan:
        check_mapping(data.get("scan"), (*_SCAN, "order"), f"{location}.scan")
        values |= data["scan"]
    else:
        values["duration"] = data.get("duration")
    if cls is not Dwell:
        target = _point_from(data.get("target"), f"{location}.target")
        if cls is Straight and isinstance(target, Task):
            values |= target.set_coordinates
        else:
            values["at" if cls is Scan else "to"] = target
    if cls in (Free, Follow):
        through = data.get("through") or ()
        values["through"] = tuple(
            _point_from(point, f"{location}.through[{k}]") for k, point in enumerate(through)
        )
    return built(cls, values, location)


def limits_to_plain(value: Problem | TaskLimits) -> JsonObject:
    """Convert the limits of a task to the form in plan.json.

    The result contains ranges and rates by task coordinate, limits on the tool by
    `ToolLimit.field`, and the eye.
    """
    speeds = {"tip_speed": None, **{limit.field: limit.largest for limit in value.of_tool}}
    bounds = {
        "limits": plain(value.ranges),
        **speeds,
        "rates": plain(value.rates),
        "eye": plain(value.eye),
    }
    return bounds | {name: plain(getattr(value, name)) for name in ("friction", "payload")}


_SPECIAL: dict[type, Callable[[Any], JsonObject]] = {
    Robot: _robot,
    Problem: _problem,
    TaskLimits: limits_to_plain,
    **dict.fromkeys((Task, Joints, Tip), _point),
    **dict.fromkeys(_KINDS.values(), _motion),
}
"""Conversions of the values whose keys in plan.json differ from their fields."""


@contextmanager
def _name_file(file: str | None) -> Iterator[None]:
    """Add the name of the file to each ProblemError that the with block raises."""
    try:
        yield
    except ProblemError as error:
        error.file = file
        raise


def problem_from_plain(data: Fields, file: str | None = None) -> Problem:
    """Build a problem from the JSON types that `plain` returned for it.

    The result is equal bit for bit.

    Parameters
    ----------
    data : Mapping
        Content of the key `problem` of a plan.json.
    file : str, optional
        Name of the file, for messages.

    Raises
    ------
    ProblemError
        If the data are invalid. The error states the key, its value and the allowed values.
    """
    task = task_limits_from_plain(data, file)
    fields = {"robot": robot_from_plain(data.get("robot", {}), file), "limits": task.limits}
    with _name_file(file):
        fields |= {"friction": task.friction, "payload": task.payload, "eye": task.eye}
        fields |= {"start": _point_from(data.get("start"), "problem.start")}
        entries = data.get("motion")
        if not isinstance(entries, (list, tuple)):
            raise wrong("problem.motion", entries, "a list")
        fields["motion"] = tuple(
            _motion_from(entry, f"problem.motion[{i}]") for i, entry in enumerate(entries)
        )
        fields_left = {
            "excess_ranges" if key == EXCESS_KEY else key: item
            for key, item in data.items()
            if key not in {*fields, *limits_to_plain(task)}
        }
        problem = built(Problem, fields_left, "problem", fields)
    return problem


def robot_from_plain(data: Fields, file: str | None = None) -> Robot:
    """Build a robot from the JSON types that `plain` returned for it.

    The result is equal bit for bit.

    Parameters
    ----------
    data : Mapping
        Data of the robot.
    file : str, optional
        Name of the file, for messages.

    Raises
    ------
    ProblemError
        If the data are invalid. The error states the key, its value and the allowed values.
    """
    with _name_file(file):
        robot = built(
            Robot, {**data, "limits": _ranges(data.get("limits"), "robot.limits")}, "robot"
        )
    return robot


def task_limits_from_plain(problem: Fields, file: str | None = None) -> TaskLimits:
    """Build the limits of a task from the JSON types of its problem.

    Limits without a key in the data are absent from the result.

    Parameters
    ----------
    problem : Mapping
        Content of the key `problem` of a plan.json.
    file : str, optional
        Name of the file, for messages.

    Raises
    ------
    ProblemError
        If the data are invalid. The error states the key, its value and the allowed values.
    """
    with _name_file(file):
        limits: list[Limit] = _ranges(problem.get("limits"), "problem.limits")
        rates = _by_task(Positive, problem.get("rates"), "problem.rates")
        limits += [TaskRate(name, rate) for name, rate in rates.items()]
        for limit_type in ToolLimit.kinds():
            bound = converted(
                Positive | None, problem.get(limit_type.field), f"problem.{limit_type.field}"
            )
            limits += [] if bound is None else [limit_type(bound)]
        eye = converted(Eye | None, problem.get("eye"), "problem.eye", build=True)
        friction = converted(Positive | None, problem.get("friction"), "problem.friction")
        payload = converted(Interval | None, problem.get("payload"), "problem.payload")
    return TaskLimits(tuple(limits), eye, friction=friction, payload=payload)


def _ranges(data: Any, location: str) -> list[Limit]:
    """Build the limits on the ranges of task coordinates from a mapping of lower and upper bounds.

    `location` is the key of the data. Raises ProblemError if the data are invalid.
    """
    return [
        TaskRange(name, low, high)
        for name, (low, high) in _by_task(Interval, data, location).items()
    ]


def _by_task(hint: Any, data: Any, location: str) -> dict[str, Any]:
    """Check a mapping whose keys are task coordinates, and convert its values to the type `hint`.

    The result is empty if `data` is None. `location` is the key of the data for messages.
    """
    hint = Annotated[Mapping[str, hint], Names(TASK)]
    return converted(hint, {} if data is None else data, location)
