"""Resolved values as JSON types and back: what plan.json holds of a problem, and the problem rebuilt from it."""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from typing import Any, Literal, get_args, get_origin

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem.limits import TASK, Limit, SpeedLimit, TaskRange, TaskRate
from ssm_planner.problem.problem import Eye, Lens, Problem, TaskLimits
from ssm_planner.problem.robot import Body, Geometry, Robot, frozen
from ssm_planner.typing import Range

SHAPES = {
    (Geometry, "omega1"): (3,),
    (Geometry, "omega2"): (3,),
    (Geometry, "omega3"): (3,),
    (Geometry, "tool_home"): (3, 3),
    (Body, "com"): (3,),
    (Body, "inertia"): (3, 3),
    (Body, "frame"): (3, 3),
    (Robot, "gravity"): (3,),
    (Eye, "centre"): (3,),
    (Lens, "centre"): (3,),
    (Lens, "semi_axes"): (3,),
    (Lens, "frame"): (3, 3),
}
"""Shapes of the arrays among the resolved values."""


def plain(value: Any) -> Any:
    """Dataclasses, arrays and mappings as JSON types; limits by the names of what they limit."""
    if isinstance(value, Robot):
        return {**_fields(value), "limits": plain(value.ranges)}
    if isinstance(value, Problem):
        stated = {field: bound for field, bound in limits_to_plain(value).items() if field != "eye"}
        return {**_fields(value), **stated}
    if isinstance(value, TaskLimits):
        return limits_to_plain(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _fields(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


def _fields(value: Any) -> dict[str, Any]:
    return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}


def limits_to_plain(value: Problem | TaskLimits) -> dict[str, Any]:
    """Limits of the task as plan.json states them: ranges and rates by coordinate, speeds by their field, the eye."""
    speeds = {"tip_speed": None, **{limit.field: limit.largest for limit in value.speeds}}
    return {"limits": plain(value.ranges), **speeds, "rates": plain(value.rates), "eye": plain(value.eye)}


def problem_from_plain(data: Mapping[str, Any], file: str | None = None) -> Problem:
    """The problem that `plain` made JSON types of, bit for bit; arrays read-only.

    file: named in messages. Raises ProblemError naming the key, its value and what is allowed.
    """
    task = task_limits_from_plain(data, file)
    robot = robot_from_plain(data.get("robot", {}), file)
    given = {"robot": robot, "limits": task.limits, "eye": task.eye}
    try:
        rest = {key: item for key, item in data.items() if key not in {*given, *limits_to_plain(task)}}
        problem: Problem = from_plain(Problem, rest, "problem", given)
    except ProblemError as error:
        error.file = file
        raise
    return problem


def robot_from_plain(data: Mapping[str, Any], file: str | None = None) -> Robot:
    """The robot that `plain` made JSON types of, bit for bit; arrays read-only.

    file: named in messages. Raises ProblemError naming the key, its value and what is allowed.
    """
    try:
        robot: Robot = from_plain(Robot, data, "robot")
    except ProblemError as error:
        error.file = file
        raise
    for joint in robot.joints:
        for name, allowed in (("velocity", joint.velocity), ("acceleration", joint.acceleration)):
            if not allowed > 0:
                raise ProblemError(
                    "not a limit", file=file, key=f"robot.joints.{joint.name}.{name}", value=allowed, allowed="above 0"
                )
    return robot


def task_limits_from_plain(problem: Mapping[str, Any], file: str | None = None) -> TaskLimits:
    """The limits of the task in a problem that `plain` made JSON types of; those that it does not name are none.

    file: named in messages. Raises ProblemError naming the key, its value and what is allowed.
    """
    try:
        ranges = _by_task(problem.get("limits"), Mapping[str, Range], "problem.limits")
        rates = _by_task(problem.get("rates"), Mapping[str, float], "problem.rates")
        fields = {cls.field: cls for cls in SpeedLimit.__subclasses__()}
        speeds = {field: _value(float | None, problem.get(field), f"problem.{field}") for field in fields}
        eye: Eye | None = _value(Eye | None, problem.get("eye"), "problem.eye")
        positive = {f"rates.{name}": rate for name, rate in rates.items()} | speeds
        if eye is not None:
            positive |= {"eye.port": eye.port, "eye.radius": eye.radius - eye.clearance}
            if eye.lens is not None:
                positive["eye.lens.semi_axes"] = float(eye.lens.semi_axes.min())
        for key, number in positive.items():
            if number is not None and not number > 0:
                raise _wrong(f"problem.{key}", number, "above 0")
        limits: list[Limit] = _ranges(ranges, "problem.limits")
        limits += [TaskRate(name, rate) for name, rate in rates.items()]
        limits += [fields[field](largest) for field, largest in speeds.items() if largest is not None]
    except ProblemError as error:
        error.file = file
        raise
    return TaskLimits(tuple(limits), eye)


def _ranges(ranges: Mapping[str, Range], where: str) -> list[Limit]:
    for name, (low, high) in ranges.items():
        if not low < high:
            raise _wrong(f"{where}.{name}", [low, high], "the lower bound first")
    return [TaskRange(name, low, high) for name, (low, high) in ranges.items()]


def _by_task(data: Any, hint: Any, where: str) -> dict[str, Any]:
    """A mapping from names of task coordinates; none is an empty one."""
    found: dict[str, Any] = _value(hint, {} if data is None else data, where)
    for key in found:
        if key not in TASK:
            raise ProblemError("unknown key", key=f"{where}.{key}", allowed=", ".join(TASK))
    return found


def from_plain(cls: Any, data: object, where: str, given: Mapping[str, Any] | None = None) -> Any:
    """A dataclass that `plain` made JSON types of. Raises ProblemError.

    where: its place, for messages. given: values of fields that are not to be read from data.
    """
    if not isinstance(data, Mapping):
        raise _wrong(where, data, f"a mapping with the keys of {cls.__name__}")
    hints = typing.get_type_hints(cls)
    fields = {field.name: field for field in dataclasses.fields(cls)}
    for key in data:
        if key not in fields:
            raise ProblemError("unknown key", key=f"{where}.{key}", allowed=", ".join(fields))
    values = dict(given or {})
    for name, field in fields.items():
        if name in values:
            continue
        place = f"{where}.{name}"
        if name not in data:
            if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
                raise ProblemError("missing", key=place)
            continue
        if cls is Robot and name == "limits":
            values[name] = tuple(_ranges(_by_task(data[name], Mapping[str, Range], place), place))
            continue
        shape = SHAPES.get((cls, name))
        values[name] = _array(shape, data[name], place) if shape else _value(hints[name], data[name], place)
    return cls(**values)


def _value(hint: Any, data: Any, where: str) -> Any:
    """A value of the type that the hint names."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is typing.Union or origin is types.UnionType:
        inner = [part for part in parts if part is not type(None)]
        return None if data is None else _value(inner[0], data, where)
    if origin is Literal:
        if data not in parts or isinstance(data, bool):
            raise _wrong(where, data, ", ".join(map(str, parts)))
        return data
    if origin is tuple:
        return _tuple(parts, data, where)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        if not isinstance(data, Mapping):
            raise _wrong(where, data, "a mapping")
        return {str(key): _value(parts[1], item, f"{where}.{key}") for key, item in data.items()}
    if dataclasses.is_dataclass(hint):
        return from_plain(hint, data, where)
    return _scalar(hint, data, where)


def _tuple(parts: tuple[Any, ...], data: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(data, (list, tuple)):
        raise _wrong(where, data, "a list")
    hints = (parts[0],) * len(data) if parts[-1] is Ellipsis else parts
    if len(hints) != len(data):
        raise _wrong(where, data, f"a list of {len(hints)}")
    return tuple(_value(hint, item, f"{where}[{i}]") for i, (hint, item) in enumerate(zip(hints, data, strict=True)))


def _scalar(hint: Any, data: Any, where: str) -> Any:
    if hint is float and isinstance(data, (int, float)) and not isinstance(data, bool) and math.isfinite(data):
        return float(data)
    if hint is int and isinstance(data, int) and not isinstance(data, bool):
        return data
    if hint in (str, bool) and isinstance(data, hint):
        return data
    names = {float: "a finite number", int: "a whole number", str: "a text", bool: "true or false"}
    raise _wrong(where, data, names[hint])


def _array(shape: tuple[int, ...], data: Any, where: str) -> Any:
    allowed = f"finite numbers of shape {shape}"
    try:
        array = np.array(data, dtype=float)
    except (TypeError, ValueError) as error:
        raise _wrong(where, data, allowed) from error
    if array.shape != shape or not np.isfinite(array).all():
        raise _wrong(where, data, allowed)
    return frozen(array, shape)


def _wrong(where: str, data: object, allowed: str) -> ProblemError:
    return ProblemError("not what belongs here", key=where, value=data, allowed=allowed)
