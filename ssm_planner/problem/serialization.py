"""Convert values to JSON types and back, as plan.json stores them.

`to_plain` converts any value, and `problem_from_plain` and `robot_from_plain` restore it bit for
bit. The values are complete: all files that a problem names have been read. A plan can therefore be
checked without these files. `robot_hash` identifies the data of a robot.
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
from ssm_planner.problem.limits import TASK_COORDINATES, Limit, TaskRange, TaskRate, ToolLimit
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
    build_value,
    check_mapping,
    convert_value,
    get_attributes,
    wrong_type_error,
)
from ssm_planner.typing import Fields, JsonObject

JSON_PRIMITIVES = {type(None), bool, int, float, str}
"""Types that JSON represents directly."""
LATER_FIELDS = ("no_load_current", "gearhead", "belt")
"""Fields that earlier versions of this program did not have.

They are omitted if they are None, so that the hash of a robot in an older certificate remains
valid.
"""


def to_plain(value: Any) -> Any:
    """Convert a value to JSON types, as plan.json stores it.

    Parameters
    ----------
    value : object
        Dataclass, mapping, sequence, array, number, text or None.

    Returns
    -------
    dict, list, str, float, int, bool or None
        Dataclasses become dictionaries, and arrays and tuples become lists. The limits of a problem
        or a robot become a dictionary from the limited quantity to its bound.
    """
    value_type: Any = type(value)
    if value_type in JSON_PRIMITIVES:
        return value
    if isinstance(value, (list, tuple)):
        return [to_plain(item) for item in value]
    if value_type is np.ndarray:
        return value.tolist()
    if value_type in _CONVERTERS:
        return _CONVERTERS[value_type](value)
    if names := _field_names(value_type):
        items = ((name, to_plain(getattr(value, name))) for name in names)
        return {name: item for name, item in items if item is not None or name not in LATER_FIELDS}
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    return value.item() if isinstance(value, np.generic) else value


def robot_hash(robot: Robot) -> str:
    """Return the SHA-256 of a robot's data, which does not depend on the names of its files."""
    return hashlib.sha256(robot_text(robot).encode()).hexdigest()


def robot_text(robot: Robot) -> str:
    """Return a robot's data as JSON text without the names of files.

    The text of the last robot is cached, because one plan needs it several times. `robot_hash` is
    its SHA-256.
    """
    global _cached_text
    cached = _cached_text
    if cached is None or cached[0] is not robot:
        cached = _cached_text = robot, json.dumps(_without_files(to_plain(robot)), sort_keys=True)
    return cached[1]


_cached_text: tuple[Robot, str] | None = None
"""Last robot of `robot_text`, and its text."""


def _without_files(data: Any) -> Any:
    """Return a copy of JSON data without the names of files."""
    if isinstance(data, dict):
        return {key: _without_files(item) for key, item in data.items() if key != "file"}
    return [_without_files(item) for item in data] if isinstance(data, list) else data


EXCESS_KEY = "wider"
"""Key of Problem.excess_ranges in plan.json."""


@cache
def _field_names(cls: Any) -> tuple[str, ...]:
    """Return the field names of a dataclass, or an empty tuple for any other class."""
    if dataclasses.is_dataclass(cls):
        return tuple(field.name for field in dataclasses.fields(cls))
    return ()


def _robot_to_plain(robot: Robot) -> JsonObject:
    """Convert a robot to JSON types.

    Parameters
    ----------
    robot : Robot
        Robot to convert.

    Returns
    -------
    dict
        Fields of the robot. The variants `corners` and `lightest` are omitted, because the planner
        computes them again.
    """
    fields = {
        name: to_plain(getattr(robot, name))
        for name in _field_names(Robot)
        if name not in ("corners", "lightest")
    }
    return fields | {"limits": to_plain(robot.ranges)}


def _problem_to_plain(problem: Problem) -> JsonObject:
    """Convert a problem to the form in plan.json."""
    bounds = {field: bound for field, bound in limits_to_plain(problem).items() if field != "eye"}
    fields = {name: to_plain(getattr(problem, name)) for name in _field_names(Problem)} | bounds
    return {EXCESS_KEY if name == "excess_ranges" else name: fields[name] for name in fields}


def _point_to_plain(point: Point) -> JsonObject:
    """Convert a point to JSON types.

    Parameters
    ----------
    point : Task, Joints or Tip
        Point to convert.

    Returns
    -------
    dict
        `task`, `joints` or `tip` contains the coordinates, in rad and m, and the other two are
        None. `spin` belongs to a tip, and `line` is the line in the problem file.
    """
    return {
        "task": point.set_coordinates if isinstance(point, Task) else None,
        "joints": to_plain(getattr(point, "values", None)),
        "tip": to_plain(getattr(point, "position", None)),
        "spin": point.spin if isinstance(point, Tip) else None,
        "line": point.line,
    }


def _motion_to_plain(motion: Motion) -> JsonObject:
    """Convert an entry of the motion list to JSON types.

    Parameters
    ----------
    motion : Motion
        Entry to convert.

    Returns
    -------
    dict
        Values by key of plan.json. All kinds of motions share the same keys, and each kind may have
        further keys (`_KEYS_BY_KIND`).
    """
    target = getattr(motion, "to", getattr(motion, "at", None))
    scan = None
    if isinstance(motion, Scan):
        scan = to_plain(get_attributes(motion, _SCAN_KEYS))
        scan |= {"order": motion.order} if motion.order != "given" else {}
    kind_fields = get_attributes(motion, _KEYS_BY_KIND.get(motion.kind, ()))
    return {
        "kind": motion.kind,
        "name": motion.name,
        "target": to_plain(target),
        "duration": motion.duration,
        "line": motion.line,
        "through": to_plain(getattr(motion, "through", ())),
        "scan": scan,
        **{name: value for name, value in kind_fields.items() if value or name in _ALWAYS_WRITTEN},
    }


_SCAN_KEYS = ("diameters", "rows", "columns", "spacing", "distance", "dwell")
"""Fields of a Scan that plan.json stores under the key `scan`."""
_KEYS_BY_KIND: dict[str, tuple[str, ...]] = {
    Follow.kind: ("blend", "curve", "file", "constant_speed", "distance"),
    Free.kind: ("spin_free",),
    Straight.kind: ("blend",),
}
"""Keys that only motions of one kind have."""
_ALWAYS_WRITTEN = ("curve", "file")
"""Keys in `_KEYS_BY_KIND` that plan.json contains even if their value is None."""
_MOTION_CLASSES = {kind.kind: kind for kind in (Straight, Free, Follow, Dwell, Scan)}
"""Classes of motions, by the value of `kind` in plan.json."""


def _point_from_plain(data: Any, location: str) -> Point:
    """Build a point from its form in plan.json.

    Parameters
    ----------
    data : object
        Dictionary that `_point_to_plain` returned. It may come from a damaged file.
    location : str
        Key of the data, for messages.

    Returns
    -------
    Task, Joints or Tip
        The point.

    Raises
    ------
    ProblemError
        If the data are invalid.
    """
    check_mapping(data, ("task", "joints", "tip", "spin", "line"), location)
    line = {"line": data.get("line")}
    if data.get("joints") is not None:
        point = build_value(Joints, {"values": data["joints"], **line}, location)
    elif data.get("tip") is not None:
        point = build_value(
            Tip, {"position": data["tip"], "spin": data.get("spin"), **line}, location
        )
    else:
        task = data.get("task")
        check_mapping(task, TASK_COORDINATES, f"{location}.task")
        point = build_value(Task, {**task, **line}, location)
    return point


def _motion_from_plain(data: Any, location: str) -> Motion:
    """Build an entry of the motion list from its form in plan.json.

    Parameters
    ----------
    data : object
        Dictionary that `_motion_to_plain` returned. It may come from a damaged file.
    location : str
        Key of the data, for messages.

    Returns
    -------
    Motion
        The entry.

    Raises
    ------
    ProblemError
        If the data are invalid.
    """
    kind = str(data.get("kind")) if isinstance(data, Mapping) else ""
    own_keys = ("name", "line", *_KEYS_BY_KIND.get(kind, ()))
    check_mapping(data, ("kind", "target", "duration", "through", "scan", *own_keys), location)
    cls: Any = _MOTION_CLASSES.get(kind)
    if cls is None:
        raise wrong_type_error(f"{location}.kind", data.get("kind"), ", ".join(_MOTION_CLASSES))
    values = {name: data[name] for name in own_keys if name in data}
    if cls is Scan:
        check_mapping(data.get("scan"), (*_SCAN_KEYS, "order"), f"{location}.scan")
        values |= data["scan"]
    else:
        values["duration"] = data.get("duration")
    if cls is not Dwell:
        target = _point_from_plain(data.get("target"), f"{location}.target")
        if cls is Straight and isinstance(target, Task):
            values |= target.set_coordinates
        else:
            values["at" if cls is Scan else "to"] = target
    if cls in (Free, Follow):
        through = data.get("through") or ()
        values["through"] = tuple(
            _point_from_plain(point, f"{location}.through[{k}]") for k, point in enumerate(through)
        )
    return build_value(cls, values, location)


def limits_to_plain(value: Problem | TaskLimits) -> JsonObject:
    """Convert the limits of a task to JSON types.

    Parameters
    ----------
    value : Problem or TaskLimits
        Value with the limits.

    Returns
    -------
    dict
        Ranges and rates by task coordinate under `limits` and `rates`, limits on the tool by their
        names in files, the eye, and the ranges of friction and payload.
    """
    speeds = {"tip_speed": None, **{limit.field: limit.largest for limit in value.of_tool}}
    bounds = {
        "limits": to_plain(value.ranges),
        **speeds,
        "rates": to_plain(value.rates),
        "eye": to_plain(value.eye),
    }
    return bounds | {name: to_plain(getattr(value, name)) for name in ("friction", "payload")}


_CONVERTERS: dict[type, Callable[[Any], JsonObject]] = {
    Robot: _robot_to_plain,
    Problem: _problem_to_plain,
    TaskLimits: limits_to_plain,
    **dict.fromkeys((Task, Joints, Tip), _point_to_plain),
    **dict.fromkeys(_MOTION_CLASSES.values(), _motion_to_plain),
}
"""Functions that convert the values whose keys in plan.json differ from their fields, by class."""


@contextmanager
def _add_file_to_errors(file: str | None) -> Iterator[None]:
    """Add the name of the file to each ProblemError that the `with` statement raises."""
    try:
        yield
    except ProblemError as error:
        error.file = file
        raise


def problem_from_plain(data: Fields, file: str | None = None) -> Problem:
    """Build a problem from the JSON types that `to_plain` returned for it.

    The result is equal bit for bit.

    Parameters
    ----------
    data : Mapping
        Content of the key `problem` of a plan.json.
    file : str, optional
        Name of the file, for messages.

    Returns
    -------
    Problem
        The problem.

    Raises
    ------
    ProblemError
        If the data are invalid. The error states the key, its value and the allowed values.
    """
    task = task_limits_from_plain(data, file)
    fields = {"robot": robot_from_plain(data.get("robot", {}), file), "limits": task.limits}
    with _add_file_to_errors(file):
        fields |= {"friction": task.friction, "payload": task.payload, "eye": task.eye}
        fields |= {"start": _point_from_plain(data.get("start"), "problem.start")}
        entries = data.get("motion")
        if not isinstance(entries, (list, tuple)):
            raise wrong_type_error("problem.motion", entries, "a list")
        fields["motion"] = tuple(
            _motion_from_plain(entry, f"problem.motion[{i}]") for i, entry in enumerate(entries)
        )
        fields_left = {
            "excess_ranges" if key == EXCESS_KEY else key: item
            for key, item in data.items()
            if key not in {*fields, *limits_to_plain(task)}
        }
        problem = build_value(Problem, fields_left, "problem", fields)
    return problem


def robot_from_plain(data: Fields, file: str | None = None) -> Robot:
    """Build a robot from the JSON types that `to_plain` returned for it.

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
    with _add_file_to_errors(file):
        check_mapping(data, _field_names(Robot), "robot")
        robot = build_value(
            Robot,
            {**data, "limits": _ranges_from_plain(data.get("limits"), "robot.limits")},
            "robot",
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

    Returns
    -------
    TaskLimits
        The limits.

    Raises
    ------
    ProblemError
        If the data are invalid. The error states the key, its value and the allowed values.
    """
    with _add_file_to_errors(file):
        limits: list[Limit] = _ranges_from_plain(problem.get("limits"), "problem.limits")
        rates = _convert_by_coordinate(Positive, problem.get("rates"), "problem.rates")
        limits += [TaskRate(name, rate) for name, rate in rates.items()]
        for limit_type in ToolLimit.kinds():
            bound = convert_value(
                Positive | None, problem.get(limit_type.field), f"problem.{limit_type.field}"
            )
            limits += [] if bound is None else [limit_type(bound)]
        eye = convert_value(Eye | None, problem.get("eye"), "problem.eye", build=True)
        friction = convert_value(Positive | None, problem.get("friction"), "problem.friction")
        payload = convert_value(Interval | None, problem.get("payload"), "problem.payload")
    return TaskLimits(tuple(limits), eye, friction=friction, payload=payload)


def _ranges_from_plain(data: Any, location: str) -> list[Limit]:
    """Build the limits on the ranges of task coordinates.

    Parameters
    ----------
    data : object
        Mapping of pairs (lower, upper) by task coordinate, rad and m, or None.
    location : str
        Key of the data, for messages.

    Raises
    ------
    ProblemError
        If the data are invalid.
    """
    return [
        TaskRange(name, low, high)
        for name, (low, high) in _convert_by_coordinate(Interval, data, location).items()
    ]


def _convert_by_coordinate(hint: Any, data: Any, location: str) -> dict[str, Any]:
    """Check a mapping whose keys are task coordinates, and convert its values.

    Parameters
    ----------
    hint : type
        Annotated type of the values.
    data : object
        The mapping. None gives an empty result.
    location : str
        Key of the data, for messages.

    Raises
    ------
    ProblemError
        If a key or a value is invalid.
    """
    hint = Annotated[Mapping[str, hint], Names(TASK_COORDINATES)]
    return convert_value(hint, {} if data is None else data, location)
