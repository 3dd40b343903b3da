"""Reader of problem files, which maps the fields of a Problem to their keys in the file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ssm_planner import units
from ssm_planner.loading.files import follow
from ssm_planner.loading.missions import LONGEST_MOTION, written_out
from ssm_planner.loading.path_file import in_tables, path_from
from ssm_planner.loading.robots import RANGES, Rotations, ranges_from, robot_from, rotation
from ssm_planner.loading.schema import (
    POSITIVE,
    UNBOUND,
    Axis,
    Model,
    Part,
    Reference,
    Text,
    by_joint,
    interval,
    located,
    model_from,
    model_of,
    nested,
    optional,
    positive,
    quantity,
    reading,
    required,
    validated,
    vector,
    wrong,
)
from ssm_planner.loading.schema import Field as Reader
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem import (
    LARGEST_GRID,
    TASK,
    Bound,
    Dwell,
    Eye,
    Follow,
    Free,
    Joint,
    Joints,
    Lens,
    Limit,
    Motion,
    Point,
    Problem,
    Robot,
    Scan,
    Straight,
    Task,
    TaskRate,
    Tip,
    ToolLimit,
    read_only_array,
)
from ssm_planner.typing import Array
from ssm_planner.units import KINDS


def share(value: object) -> float:
    """Return a share that is given as a percentage or a number."""
    text = (
        value.strip().removesuffix("%").strip()
        if isinstance(value, str) and value.strip().endswith("%")
        else None
    )
    try:
        return units.number(value) if text is None else float(text) / 100
    except (units.BadQuantity, ValueError):
        raise units.BadQuantity(
            f"{units.describe(value)} instead of a share", "a share such as 95 %"
        ) from None


JointValues = Annotated[
    tuple[float, float, float, float], vector("angle", "angle", "angle", "length")
]
MOST_POINTS = 200
"""Largest number of points that one motion passes without stopping."""
ONCE = "once"
"""Duty of a motion that does not repeat."""
PATTERNS = {"raster": ("rows", "columns"), "ring": ("diameter",), "triple ring": ("diameters",)}
"""Keys of each pattern of a scan in addition to the common ones."""
SQUARE = math.radians(0.5)
"""Largest deviation of the lens axes from a right angle. The first axis is then corrected."""
Place = tuple[str | int, ...]
"""Keys and list positions that lead to a value of the file."""
_FORMS = (
    "task coordinates (roll, tilt, spin, depth), or joints: [four values], or tip: [x, y, z] "
    "with spin"
)


class _NamedModel(Model):
    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> dict[str, Any]:
        schema = super().__get_pydantic_json_schema__(core, handler)
        return {"anyOf": [schema, {"type": "string", "description": "A name among `points`."}]}


class _PointModel(_NamedModel):
    @model_validator(mode="before")
    @classmethod
    def _one_form(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        if not data:
            raise wrong("the point is empty", _FORMS)
        if "joints" in data and len(data) > 1:
            other_key = next(key for key in data if key != "joints")
            raise wrong("redundant: joints determine the point", _FORMS, other_key)
        if "tip" in data:
            for key in ("roll", "tilt", "depth"):
                if key in data:
                    raise wrong("redundant: tip determines roll, tilt and depth", _FORMS, key)
            if "spin" not in data:
                raise wrong("missing: a tip position does not determine the spin", _FORMS, "spin")
        return data


class _ScanModel(Model):
    pattern: Literal["raster", "ring", "triple ring"]
    """Grid, or one or three circles of spots."""

    @model_validator(mode="before")
    @classmethod
    def _keys_of_its_pattern(cls, data: Any) -> Any:
        pattern = data.get("pattern") if isinstance(data, dict) else None
        if pattern not in PATTERNS:
            return data
        for key in (
            key
            for pattern_name, keys in PATTERNS.items()
            if pattern_name != pattern
            for key in keys
        ):
            if key in data:
                raise wrong(
                    f"not allowed for the pattern {pattern!r}",
                    f"for it: {', '.join(PATTERNS[pattern])}",
                    key,
                )
        for key in PATTERNS[pattern]:
            if key not in data and key != "diameters":
                raise wrong(f"missing: the pattern {pattern!r} needs it", None, key)
        return data


def or_word(reader: Reader, keyword: str, allowed: str) -> Reader:
    """Return a reader that also accepts one word."""

    def read(value: object) -> object:
        try:
            return keyword if value == keyword else reader.read(value)
        except units.BadQuantity as error:
            raise units.BadQuantity(error.reason, f"{error.allowed}, or {keyword}") from None

    return replace(
        reader,
        read=read,
        json_schema={"anyOf": [reader.json_schema, {"const": keyword}]},
        allowed=allowed,
    )


def _rate(name: str, bound: Bound = UNBOUND) -> Any:
    """Return the type of the rate of a task coordinate."""
    return Annotated[Any, quantity("velocity" if name == "depth" else "angular_velocity", bound)]


def _bound_field(limit_type: type[ToolLimit]) -> Any:
    """Return the largest value of a limit on the tool, in its unit."""
    (kind_name, *_) = (
        name for name, candidate in KINDS.items() if candidate.unit == limit_type.unit
    )
    return positive(kind_name)


TaskModel = model_of(Task, base=_NamedModel)
_LENGTHS = Annotated[Any, vector("length", "length", "length")]
_FORMS_OF_POINT = {
    "joints": optional(JointValues, "Positions of the four joints, instead of all other keys."),
    "tip": optional(
        _LENGTHS, "Position of the tool tip in the base frame, instead of roll, tilt and depth."
    ),
}
PointModel = model_of(Task, _FORMS_OF_POINT, base=_PointModel)
FREE = "free"
"""Spin of a target that the planner chooses."""
_ANY_SPIN = or_word(quantity("angle"), FREE, "an angle, or free to choose the fastest one")
FreeTargetModel = model_of(
    Task,
    {
        "spin": optional(
            Annotated[Any, _ANY_SPIN], "Rotation of the tool about its own axis, or free."
        ),
        **_FORMS_OF_POINT,
    },
    base=_PointModel,
)
_COUNT = Annotated[Any, quantity("number", Bound(at_least=1, at_most=LARGEST_GRID), integer=True)]
ScanModel = model_of(
    Scan,
    {
        "at": (nested(TaskModel), ...),
        "diameter": optional(positive("length"), "Diameter of a ring."),
        "diameters": (_LENGTHS, (1e-3, 2e-3, 3e-3)),
        "rows": optional(_COUNT),
        "columns": optional(_COUNT),
    },
    without=("name",),
    base=_ScanModel,
)
LensModel = model_of(
    Lens,
    {
        "axis": required(Axis, "Direction of the third semi-axis, of any length."),
        "first_axis": optional(
            Axis, "Direction of the first semi-axis, required if it differs from the second."
        ),
    },
)
EyeModel = model_of(Eye, {"lens": optional(nested(LensModel))})


class RepeatModel(Model):
    """Motions to repeat."""

    times: Annotated[
        Any, quantity("number", Bound(at_least=1, at_most=LONGEST_MOTION), integer=True)
    ]
    """Number of repetitions."""
    motion: list[Any]
    """Motions to repeat, in order."""


class _EntryModel(Model):
    @model_validator(mode="before")
    @classmethod
    def _one_key(cls, data: Any) -> Any:
        if isinstance(data, dict) and len(data) != 1:
            several = f"{len(data)} motions in one entry ({', '.join(map(str, data))})"
            reason = several if data else "the entry has no motion"
            raise wrong(reason, f"one motion per list entry: {', '.join(cls.model_fields)}")
        return data


def _motion_to(
    to: Any,
    description: str,
    extra_keys: Mapping[str, Any] | None = None,
    without: tuple[str, ...] = (),
) -> Any:
    keys = {"to": required(to, "End point."), **(extra_keys or {})}
    model = model_of(Straight, keys, without=(*TASK, "name", *without))
    return optional(nested(model), description)


def _through(model: Any, description: str) -> dict[str, Any]:
    """Return the optional key of the points between the start and the end."""
    points = Annotated[tuple[Annotated[Any, Part(model)], ...], Field(max_length=MOST_POINTS)]
    return {"through": (points, Field((), description=description))}


_PASSED = _through(PointModel, "Points passed without stopping, in order.")
_CORNERS = "Corners of the path, rounded according to `blend`."
_CONSTANT = {
    "constant_speed": optional(
        reading(Follow, "constant_speed"), "Speed of the tip outside the ramps."
    )
}
_OVER = _CONSTANT | {
    "distance": required(positive("length"), "Distance of the tip from the retina.")
}
_BY = {"through": required(nested(PointModel), "Point that the arc passes.")}
_OF_ONE_COORDINATE = {"tilt": "tilt", "roll": "roll", "spin": "spin", "insert": "depth"}
"""Task coordinates that change, by the key of the motion."""
EntryModel = model_from(
    {
        **{
            key: _motion_to(
                reading(Task, coordinate),
                f"Motion to a {coordinate}. The other task coordinates stay constant.",
            )
            for key, coordinate in _OF_ONE_COORDINATE.items()
        },
        "straight": _motion_to(
            nested(TaskModel),
            "Straight motion in task coordinates. Missing ones stay constant.",
            _through(TaskModel, _CORNERS),
        ),
        "free": _motion_to(
            nested(FreeTargetModel),
            "Motion along the fastest path that the planner finds.",
            _PASSED,
            ("blend",),
        ),
        "line": _motion_to(
            nested(PointModel),
            "Straight line of the tip, with proportional spin.",
            _through(PointModel, _CORNERS) | _CONSTANT,
        ),
        "arc": _motion_to(
            nested(PointModel), "Circular arc of the tip, with proportional spin.", _BY | _CONSTANT
        ),
        "retina": _motion_to(
            nested(TaskModel), "Motion along the retina at a constant distance.", _OVER, ("blend",)
        ),
        "spline": _motion_to(
            nested(PointModel), "Smooth curve of the joints through points.", _PASSED, ("blend",)
        ),
        "path": optional(
            Text, "CSV with joints, task coordinates, or tip and spin, and units in the headings."
        ),
        "dwell": optional(reading(Dwell, "duration"), "Pause at rest."),
        "scan": optional(nested(ScanModel), "Spots on the retina."),
        "repeat": optional(nested(RepeatModel), "Motions to repeat."),
        "include": optional(
            Text, "Problem file whose motions are inserted. It has separate names of points."
        ),
    },
    base=_EntryModel,
)
_SHARE = Reader(share, {"type": ["string", "number"]}, ("number",), "such as 95 %")
_OF_TOOL = {
    kind.field: optional(_bound_field(kind), kind.__doc__ or "") for kind in ToolLimit.kinds()
}
_RATES = {
    TaskRate.field_of(name): optional(_rate(name, POSITIVE), "Largest, by magnitude.")
    for name in TASK
}
_WITHIN = {
    "friction": optional(
        Annotated[Any, _SHARE],
        "Confidence level of the drives' friction for which motor torques hold.",
    ),
    "payload": optional(
        Annotated[Any, interval("mass")], "Point masses at the tip for which motor torques hold."
    ),
}
LimitsModel = model_from({**RANGES, **_OF_TOOL, **_RATES, **_WITHIN})
RatesModel = model_from({name: optional(_rate(name), f"Rate of the {name}.") for name in TASK})
_PAUSE = quantity("time", Bound(at_least=0.0))
_DUTY = Annotated[Any, or_word(_PAUSE, ONCE, f"a pause before the motion repeats, or {ONCE}")]
_MOTION = Annotated[
    list[Annotated[Any, Part(EntryModel)]], Field(min_length=1, max_length=LONGEST_MOTION)
]
_NAMED = Annotated[
    dict[str, Any],
    Reader(lambda value: value, {"type": "object", "additionalProperties": {"type": "object"}}),
]


def _overrides(slides: bool = False) -> Any:
    names = ("velocity", "acceleration", "jerk")
    keys = {
        name: optional(reading(Joint, name, slides), "Value instead of the robot's.")
        for name in names
    }
    return model_from(keys)


OverridesModel = by_joint(_overrides(), _overrides(slides=True))
_START = "Start point: four task coordinates, or joints, or tip with spin."
ProblemModel = model_of(
    Problem,
    {
        "name": optional(Text, "Name. The default is the file's name without its suffix."),
        "robot": (Reference, ...),
        "start": required(nested(PointModel), _START),
        "motion": (_MOTION, ...),
        "limits": (nested(LimitsModel), LimitsModel()),
        "eye": optional(nested(EyeModel)),
        "start_rate": (nested(RatesModel), RatesModel()),
        "end_rate": (nested(RatesModel), RatesModel()),
        "duty": (_DUTY, 0.0),
        "points": optional(_NAMED, "Named points that `start`, `to`, `through` and `at` may use."),
        "joints": optional(nested(OverridesModel), "Limits of joints instead of the robot's."),
        "speed": optional(
            Annotated[Any, _SHARE], "Share of the largest joint velocities, such as 30 %."
        ),
        "mounting": optional(
            Rotations,
            "Rotation of the robot's base relative to the pose for which its file states gravity.",
        ),
        "tip_payload": optional(
            positive("mass"), "Point mass at the tip in addition to the robot's bodies."
        ),
    },
    without=("friction", "payload", "start_acceleration", "excess_ranges"),
)
"""Model of a problem file."""


def problem_from(section: Section) -> Problem:
    """Return the problem that a section describes, with its robot. Raises ProblemError."""
    section = written_out(section)
    if "geometry" in section.value:
        raise section.error(
            "a robot file instead of a problem file", allowed="a file with start and motion"
        )
    model: Any = validated(section, ProblemModel)
    robot = _robot(section, model)
    if (
        model.start.joints is None
        and model.start.tip is None
        and (missing := set(TASK) - set(_set_coordinates(model.start)))
    ):
        missing_name = next(name for name in TASK if name in missing)
        reason = "missing: a start needs all four coordinates"
        raise section.error(reason, "start", missing_name, allowed=", ".join(TASK))
    motion = tuple(_motion(section.sub("motion", i), entry) for i, entry in enumerate(model.motion))
    with located(section, _key_locations(model)), in_tables(motion):
        problem = Problem(
            name=model.name or section.name,
            robot=robot,
            start=_point(section.sub("start"), model.start),
            motion=motion,
            limits=(*ranges_from(model.limits), *_speeds(model.limits)),
            friction=model.limits.friction,
            payload=model.limits.payload,
            objective=model.objective,
            duration=model.duration,
            duty=None if model.duty == ONCE else model.duty,
            planner=model.planner,
            start_rate={
                name: rate for name, rate in _set_coordinates(model.start_rate).items() if rate
            },
            end_rate={
                name: rate for name, rate in _set_coordinates(model.end_rate).items() if rate
            },
            file=section.file_name,
            eye=None if model.eye is None else _eye(section.sub("eye"), model.eye),
        )
        problem.check_total()
    return problem


def _robot(section: Section, model: Any) -> Robot:
    """Return the robot with the changes that the problem states."""
    robot = robot_from(follow(section, "robot"))
    if model.speed is not None and not 0 < model.speed <= 1:
        raise section.error(
            "invalid share of the speed", "speed", allowed="above 0 and at most 100 %"
        )
    joints = []
    for joint in robot.joints:
        joint_model = None if model.joints is None else getattr(model.joints, joint.name)
        overrides = (
            {}
            if joint_model is None
            else {name: value for name, value in joint_model if value is not None}
        )
        velocity = overrides.get("velocity", joint.velocity) * (
            1.0 if model.speed is None else model.speed
        )
        joints.append(replace(joint, **{**overrides, "velocity": velocity}))
    gravity = robot.gravity
    if model.mounting is not None:
        if preset := next((angle for _, angle in model.mounting if isinstance(angle, str)), None):
            raise section.error(
                f"names {preset}, an angle of the robot", "mounting", allowed="angles"
            )
        turn = rotation(tuple((axis, float(angle)) for axis, angle in model.mounting))
        gravity = read_only_array(turn.T @ gravity, (3,))
    robot = replace(robot, joints=(joints[0], joints[1], joints[2], joints[3]), gravity=gravity)
    if not model.tip_payload:
        return robot
    from ssm_planner.dynamics.rigid_body import (
        with_payload,
    )  # with CasADi, which takes longer than to read a problem

    return with_payload(robot, model.tip_payload)


def _key_locations(model: Any) -> dict[str, Place]:
    """Return the keys in the file of the fields of a Problem, by the names in its messages."""
    locations: dict[str, Place] = {
        "start.values": ("start", "joints"),
        "start.position": ("start", "tip"),
    }
    locations |= {name: ("limits", name) for name in ("friction", "payload")}
    for i, entry in enumerate(model.motion):
        (name,) = entry.model_fields_set
        prefix = f"motion[{i}]"
        there = ("motion", i, name)
        locations |= {
            f"{prefix}.{key}": (*there, key)
            for key in ("blend", "duration", "constant_speed", "distance")
        }
        points: dict[str, Place] = {f"{prefix}.to": (*there, "to")}
        if (path_entry := entry.free or entry.spline) is not None:
            indices = range(len(path_entry.through))
            points |= {f"{prefix}.through[{k}]": (*there, "through", k) for k in indices}
        if entry.arc is not None:
            points[f"{prefix}.through[0]"] = (*there, "through")
        for field, location in points.items():
            locations |= {
                f"{field}.values": (*location, "joints"),
                f"{field}.position": (*location, "tip"),
                field: location,
            }
        if entry.scan is not None and entry.scan.pattern == "ring":
            locations[f"{prefix}.diameters"] = (*there, "diameter")
        if name in _OF_ONE_COORDINATE:
            locations[f"{prefix}.{_OF_ONE_COORDINATE[name]}"] = (*there, "to")
        locations[prefix] = (*there, "to") if entry.straight is not None else there
    return locations


def _speeds(model: Any) -> Iterable[Limit]:
    """Return the limits on the rates of task coordinates and of the tool."""
    for name in TASK:
        if (bound := getattr(model, TaskRate.field_of(name))) is not None:
            yield TaskRate(name, bound)
    for limit_type in ToolLimit.kinds():
        if (bound := getattr(model, limit_type.field, None)) is not None:
            yield limit_type(bound)


def _motion(section: Section, entry: Any) -> Motion:
    (name,) = entry.model_fields_set
    model = getattr(entry, name)
    line = section.line(name)
    motion_section = section.sub(name)
    with located(motion_section):
        if entry.dwell is not None:
            return Dwell(entry.dwell, name, line)
        if entry.scan is not None:
            return _scan(motion_section, model)
        if entry.path is not None:
            return path_from(motion_section, name, line)
        if name in ("free", "spline"):
            through = tuple(
                _point(motion_section.sub("through", k), point)
                for k, point in enumerate(model.through)
            )
            end = _point(motion_section.sub("to"), model.to)
            if name == "spline":
                return Follow(end, through, name, line=line, duration=model.duration)
            return Free(end, through, model.duration, name, line, spin_free=model.to.spin == FREE)
        if entry.retina is not None:
            end = Task(**_set_coordinates(model.to), line=motion_section.line("to"))
            fields_set = {
                "duration": model.duration,
                "constant_speed": model.constant_speed,
                "distance": model.distance,
            }
            if model.to.depth is not None:
                raise motion_section.error(
                    "do not give depth: distance already determines it",
                    "to",
                    "depth",
                    allowed="roll, tilt, spin",
                )
            return Follow(end, (), name, name, line=line, **fields_set)
        if name in ("line", "arc"):
            by = () if name == "line" else (_point(motion_section.sub("through"), model.through),)
            timing = {
                "duration": model.duration,
                "blend": model.blend,
                "constant_speed": model.constant_speed,
            }
            return Follow(
                _point(motion_section.sub("to"), model.to), by, name, name, line=line, **timing
            )
        to = (
            {_OF_ONE_COORDINATE[name]: model.to}
            if name in _OF_ONE_COORDINATE
            else _set_coordinates(model.to)
        )
        return Straight(**to, duration=model.duration, name=name, line=line, blend=model.blend)


def _scan(section: Section, model: Any) -> Scan:
    low, middle, high = model.diameters
    if not 0 < low < middle < high:
        reason = "rings must be concentric"
        raise section.error(reason, "diameters", allowed="three increasing lengths")
    diameters = {"raster": (), "ring": (model.diameter,), "triple ring": model.diameters}[
        model.pattern
    ]
    return Scan(
        Task(**_set_coordinates(model.at), line=section.line("at")),
        model.distance,
        diameters,
        rows=model.rows or 0,
        columns=model.columns or 0,
        spacing=model.spacing,
        dwell=model.dwell,
        order=model.order,
        name=model.pattern,
        line=section.line(),
    )


def _set_coordinates(model: Any) -> dict[str, float]:
    """Return the stated task coordinates or rates."""
    return {name: value for name in TASK if (value := getattr(model, name)) not in (None, FREE)}


def _point(section: Section, model: Any) -> Point:
    line = section.line()
    with located(section, {"values": ("joints",), "position": ("tip",)}):
        if model.joints is not None:
            return Joints(model.joints, line)
        if model.tip is not None:
            return Tip(model.tip, 0.0 if model.spin == FREE else model.spin, line)
        return Task(**_set_coordinates(model), line=line)


def _eye(section: Section, model: Any) -> Eye:
    lens = None
    if model.lens is not None:
        lens_section = section.sub("lens")
        with located(lens_section):
            lens = Lens(model.lens.centre, model.lens.semi_axes, _frame(lens_section, model.lens))
    with located(section):
        return Eye(**{**dict(model), "lens": lens})


def _frame(section: Section, model: Any) -> Array:
    """Return the directions of the semi-axes as columns, right-handed, (3, 3)."""

    def direction(name: str) -> Array:
        vector = np.array(getattr(model, name))
        length = float(np.linalg.norm(vector))
        if not 1e-9 < length < np.inf:
            allowed = "three numbers that are not all zero"
            raise section.error("no direction", name, allowed=allowed)
        return vector / length

    third = direction("axis")
    if model.first_axis is None:
        size_1, size_2, _ = model.semi_axes
        if min(size_1, size_2) > 0 and not math.isclose(size_1, size_2, rel_tol=1e-9):
            allowed = "the direction of the first semi-axis"
            raise section.error(
                "missing: required because the first two semi-axes differ",
                "first_axis",
                allowed=allowed,
            )
        # the direction is arbitrary, so the base axis farthest from the third one is used
        axis = np.eye(3)[int(np.argmin(np.abs(third)))]
    else:
        axis = direction("first_axis")
        if abs(float(axis @ third)) > math.sin(SQUARE):
            angle = math.degrees(math.acos(float(axis @ third)))
            raise section.error(
                f"at {angle:.4g} deg to axis", "first_axis", allowed="a right angle, within 0.5 deg"
            )
    axis = axis - third * float(axis @ third)
    axis /= np.linalg.norm(axis)
    return np.column_stack((axis, np.cross(third, axis), third))
