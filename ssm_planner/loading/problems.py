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
from ssm_planner.problem.problem import Eye, Motion, Problem, Scan, Target
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
    motion = tuple(_motion(section.sub("motion", i), entry, robot, limits, eye) for i, entry in entries)
    _refuse_durations(section, model, motion)
    if model.planner == "toppra":
        _refuse_for_toppra(section, model, motion, robot)
    return Problem(
        name=model.name or section.file.stem,
        robot=robot,
        start=start,
        motion=motion,
        limits=(*(TaskRange(name, *ends) for name, ends in limits.items()), *_speeds(model.limits)),
        objective=model.objective,
        duration=model.duration,
        planner=model.planner,
        start_rate=_rates(model.start_rate),
        end_rate=_rates(model.end_rate),
        file=str(section.file),
        eye=eye,
    )


def _refuse_durations(section: Section, model: ProblemModel, motion: tuple[Motion, ...]) -> None:
    """Raises where durations are missing for the objective, or contradict it."""
    timed = [entry.duration is not None for entry in motion]
    if model.objective == "effort" and model.duration is None and not all(timed):
        raise section.error(
            "the least effort has no duration of its own",
            "objective",
            allowed="a duration of the whole problem, or one for every motion",
        )
    if model.duration is None:
        return
    fixed = sum(entry.duration or 0.0 for entry in motion)
    if all(timed):
        raise section.error("every motion has a duration of its own already", "duration")
    if fixed >= model.duration:
        raise section.error(f"dwells and timed motions alone take {fixed:g} s", "duration", allowed="more than that")


def _refuse_for_toppra(section: Section, model: ProblemModel, motion: tuple[Motion, ...], robot: Robot) -> None:
    """Raises where a problem asks of TOPP-RA what it cannot do."""
    asks = [f"a jerk limit of joint {joint.name}" for joint in robot.joints if joint.jerk is not None]
    asks += [f"a {entry.kind} motion ({entry.name})" for entry in motion if entry.kind not in ("straight", "dwell")]
    asks += [f"a duration of {entry.name}" for entry in motion if entry.duration is not None and entry.kind != "dwell"]
    if model.duration is not None or model.objective == "effort":
        asks.append("a duration or effort as the objective")
    if asks:
        raise section.error(f"TOPP-RA cannot take {asks[0]}", "planner", allowed="straight motions as fast as possible")


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


def _motion(section: Section, entry: EntryModel, robot: Robot, limits: Mapping[str, Range], eye: Eye | None) -> Motion:
    (name,) = entry.model_fields_set
    line = section.line(name)
    if entry.dwell is not None:
        return Motion("dwell", name, duration=entry.dwell, line=line)
    if entry.scan is not None:
        return _scan(section.sub(name), entry.scan, robot, limits, eye)
    here = section.sub(name, "to")
    if entry.free is not None:
        target = _target(here, entry.free.to, robot, limits)
        passed = enumerate(entry.free.through)
        through = tuple(_target(section.sub(name, "through", k), point, robot, limits) for k, point in passed)
        return Motion("free", name, target=target, duration=entry.free.duration, line=line, through=through)
    if entry.straight is not None:
        return Motion("straight", name, _target(here, entry.straight.to, robot, limits), entry.straight.duration, line)
    coordinate = "depth" if name == "insert" else name
    model = getattr(entry, name)
    _inside(here, (), coordinate, model.to, limits)
    return Motion("straight", name, Target(task={coordinate: model.to}, line=here.line()), model.duration, line)


def _scan(section: Section, model: ScanModel, robot: Robot, limits: Mapping[str, Range], eye: Eye | None) -> Motion:
    if eye is None:
        raise section.error("a scan is of spots on a retina, and no eye is given", allowed="a problem with an eye")
    if model.distance < eye.clearance:
        allowed = f"at least the eye's clearance, {eye.clearance * 1e3:g} mm"
        raise section.error("nearer to the retina than the clearance", "distance", allowed=allowed)
    diameters: tuple[float, ...] = ()
    if model.pattern != "raster":
        diameters = (model.diameter or 0.0,) if model.pattern == "ring" else model.diameters
    if any(diameter >= eye.radius for diameter in diameters):
        raise section.error("larger than the eye's radius", "diameter" if model.pattern == "ring" else "diameters")
    rows, columns = int(model.rows or 0), int(model.columns or 0)
    scan = Scan(diameters, rows, columns=columns, spacing=model.spacing, distance=model.distance, dwell=model.dwell)
    target = _target(section.sub("at"), model.at, robot, limits)
    return Motion("scan", model.pattern, target, line=section.line(), scan=scan)


def _rates(model: RateModel) -> dict[str, float]:
    rates = {name: getattr(model, name) for name in TASK}
    return {name: rate for name, rate in rates.items() if rate}


def _target(section: Section, point: TaskModel, robot: Robot, limits: Mapping[str, Range]) -> Target:
    line = section.line()
    if isinstance(point, PointModel) and point.joints is not None:
        _joints_inside(section, point.joints, robot, limits)
        return Target(joints=point.joints, line=line)
    if isinstance(point, PointModel) and point.tip is not None:
        _tip_inside(section, point.tip, limits)
        _inside(section, ("spin",), "spin", float(point.spin or 0.0), limits)
        return Target(tip=point.tip, spin=point.spin, line=line)
    values = ((name, getattr(point, name)) for name in TASK)
    task = {name: value for name, value in values if value is not None}
    for name, value in task.items():
        _inside(section, (name,), name, value, limits)
    return Target(task=task, line=line)


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
