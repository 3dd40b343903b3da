"""A problem file → Problem: what the file may say, and where each field of the value stands in it."""

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
    optional,
    quantity,
    reading,
    validated,
    vector,
    wrong,
)
from ssm_planner.loading.schema import Field as Reader
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.limits import TASK, Limit, TaskRate, ToolLimit
from ssm_planner.problem.motion import (
    LARGEST_GRID,
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
from ssm_planner.problem.problem import Eye, Lens, Problem
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.problem.value import Bound, frozen
from ssm_planner.typing import Array
from ssm_planner.units import KINDS


def share(value: object) -> float:
    """A percentage as a text, or a share as a number."""
    text = (
        value.strip().removesuffix("%").strip()
        if isinstance(value, str) and value.strip().endswith("%")
        else None
    )
    try:
        return units.number(value) if text is None else float(text) / 100
    except (units.BadQuantity, ValueError):
        raise units.BadQuantity(
            f"{units.describe(value)} where a share is needed", "a share such as 95 %"
        ) from None


JointValues = Annotated[
    tuple[float, float, float, float], vector("angle", "angle", "angle", "length")
]
MOST_POINTS = 200
"""Points that one motion passes without stopping."""
ONCE = "once"
"""The duty of a motion that does not repeat."""
PATTERNS = {"raster": ("rows", "columns"), "ring": ("diameter",), "triple ring": ("diameters",)}
"""What each pattern of a scan has beside the common keys."""
SQUARE = math.radians(0.5)
"""How far the axes of a lens may be from a right angle; the first is then turned into it."""
Place = tuple[str | int, ...]
"""Keys and list positions that lead to a value of the file."""
_FORMS = "task coordinates (roll, tilt, spin, depth), or joints: [four values], or tip: [x, y, z] with spin"


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
            raise wrong("no point is given", _FORMS)
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


class _ScanModel(Model):
    pattern: Literal["raster", "ring", "triple ring"]
    """A grid, or one or three circles of spots."""

    @model_validator(mode="before")
    @classmethod
    def _keys_of_its_pattern(cls, data: Any) -> Any:
        pattern = data.get("pattern") if isinstance(data, dict) else None
        if pattern not in PATTERNS:
            return data
        for key in (key for other, keys in PATTERNS.items() if other != pattern for key in keys):
            if key in data:
                raise wrong(
                    f"not for the pattern {pattern!r}",
                    f"for it: {', '.join(PATTERNS[pattern])}",
                    key,
                )
        for key in PATTERNS[pattern]:
            if key not in data and key != "diameters":
                raise wrong(f"missing: the pattern {pattern!r} needs it", None, key)
        return data


def or_word(of: Reader, word: str, allowed: str) -> Reader:
    """What a field reads, or one word in its place."""

    def read(value: object) -> object:
        try:
            return word if value == word else of.read(value)
        except units.BadQuantity as error:
            raise units.BadQuantity(error.reason, f"{error.allowed}, or {word}") from None

    return replace(
        of, read=read, json_schema={"anyOf": [of.json_schema, {"const": word}]}, allowed=allowed
    )


def _part(model: Any) -> Any:
    return Annotated[Any, Part(model)]


def _rate(name: str, bound: Bound | None = None) -> Any:
    """Of a task coordinate."""
    return Annotated[
        Any, quantity("velocity" if name == "depth" else "angular_velocity", bound or Bound())
    ]


def _largest(kind: type[ToolLimit]) -> Any:
    """The largest value of a limit of the tool, in its unit."""
    (of, *_) = (name for name, each in KINDS.items() if each.unit == kind.unit)
    return Annotated[Any, quantity(of, Bound(above=0.0))]


TaskModel = model_of(Task, base=_NamedModel)
_TIP = Annotated[Any, vector("length", "length", "length")]
_FORMS_OF_POINT = {
    "joints": optional(JointValues, "Values of the four joints, in place of everything else."),
    "tip": optional(
        _TIP, "Position of the tool's tip in the base frame, in place of roll, tilt and depth."
    ),
}
PointModel = model_of(Task, _FORMS_OF_POINT, base=_PointModel)
FREE = "free"
"""The spin of a target that the planner chooses."""
_ANY_SPIN = or_word(
    quantity("angle"), FREE, "an angle, or free: the one with which the motion is fastest"
)
FreeTargetModel = model_of(
    Task,
    {
        "spin": optional(Annotated[Any, _ANY_SPIN], "Turn of the tool about itself, or free."),
        **_FORMS_OF_POINT,
    },
    base=_PointModel,
)
_COUNT = Annotated[Any, quantity("number", Bound(at_least=1, at_most=LARGEST_GRID), whole=True)]
ScanModel = model_of(
    Scan,
    {
        "at": (_part(TaskModel), ...),
        "diameter": optional(Annotated[Any, quantity("length", Bound(above=0.0))], "Of a ring."),
        "diameters": (Annotated[Any, vector("length", "length", "length")], (1e-3, 2e-3, 3e-3)),
        "rows": optional(_COUNT),
        "columns": optional(_COUNT),
    },
    without=("name",),
    base=_ScanModel,
)
LensModel = model_of(
    Lens,
    {
        "axis": (Axis, Field(description="Direction of the third semi-axis; its length is free.")),
        "first_axis": optional(
            Axis, "Direction of the first semi-axis, where it differs from the second."
        ),
    },
)
EyeModel = model_of(Eye, {"lens": optional(_part(LensModel))})


class RepeatModel(Model):
    """Motions done several times."""

    times: Annotated[Any, quantity("number", Bound(at_least=1, at_most=LONGEST_MOTION), whole=True)]
    """How often."""
    motion: list[Any]
    """What is done."""


class _EntryModel(Model):
    @model_validator(mode="before")
    @classmethod
    def _one_key(cls, data: Any) -> Any:
        if isinstance(data, dict) and len(data) != 1:
            several = f"{len(data)} motions in one entry ({', '.join(map(str, data))})"
            found = several if data else "no motion is given"
            raise wrong(found, f"one motion per list entry: {', '.join(cls.model_fields)}")
        return data


def _motion_to(
    to: Any, description: str, more: Mapping[str, Any] | None = None, without: tuple[str, ...] = ()
) -> Any:
    to_key = to, Field(description="Where it ends.")
    without = (*TASK, "name", *without)
    model = model_of(Straight, {"to": to_key, **(more or {})}, without=without)
    return optional(_part(model), description)


_THROUGH = Annotated[tuple[Annotated[Any, Part(PointModel)], ...], Field(max_length=MOST_POINTS)]
_PASSED = {
    "through": (_THROUGH, Field((), description="Points passed without stopping, in order."))
}
_ROUNDED = {
    "through": (_THROUGH, Field((), description="Corners on its way, rounded as `blend` says."))
}
_BY_TASKS = {
    "through": (
        Annotated[tuple[Annotated[Any, Part(TaskModel)], ...], Field(max_length=MOST_POINTS)],
        _ROUNDED["through"][1],
    )
}
_CONSTANT = {
    "constant_speed": optional(
        reading(Follow, "constant_speed"), "Of the tip all along, but for the ramps."
    )
}
_FROM_RETINA = Annotated[Any, quantity("length", Bound(above=0.0))]
_OVER = _CONSTANT | {
    "distance": (_FROM_RETINA, Field(description="Of the tip from the retina, m."))
}
_BY = {"through": (_part(PointModel), Field(description="Point that the arc passes."))}
EntryModel = model_from(
    {
        "tilt": _motion_to(reading(Task, "tilt"), "To a tilt, the other task coordinates held."),
        "roll": _motion_to(reading(Task, "roll"), "To a roll, the other task coordinates held."),
        "spin": _motion_to(reading(Task, "spin"), "To a spin, the other task coordinates held."),
        "insert": _motion_to(
            reading(Task, "depth"), "To a depth, the other task coordinates held."
        ),
        "straight": _motion_to(
            _part(TaskModel), "Straight in task coordinates; those left out are held.", _BY_TASKS
        ),
        "free": _motion_to(
            _part(FreeTargetModel),
            "On whatever way the planner finds fastest.",
            _PASSED,
            ("blend",),
        ),
        "line": _motion_to(
            _part(PointModel),
            "The tip on the straight line to a point, spin in proportion.",
            _ROUNDED | _CONSTANT,
        ),
        "arc": _motion_to(
            _part(PointModel),
            "The tip on a circle, spin in proportion to the way.",
            _BY | _CONSTANT,
        ),
        "retina": _motion_to(
            _part(TaskModel), "Along the retina, the tip at a distance from it.", _OVER, ("blend",)
        ),
        "spline": _motion_to(
            _part(PointModel), "The joints on a smooth curve through points.", _PASSED, ("blend",)
        ),
        "path": optional(
            Text, "CSV of joints, task coordinates or tip and spin, units in the headings."
        ),
        "dwell": optional(reading(Dwell, "duration"), "At rest for a while."),
        "scan": optional(_part(ScanModel), "Spots on the retina."),
        "repeat": optional(_part(RepeatModel), "Motions done several times."),
        "include": optional(
            Text, "Problem file whose motions come here; its names of points are its own."
        ),
    },
    base=_EntryModel,
)
_SHARE = Reader(share, {"type": ["string", "number"]}, ("number",), "such as 95 %")
_OF_TOOL = {kind.field: optional(_largest(kind), kind.__doc__ or "") for kind in ToolLimit.kinds()}
_RATES = {
    TaskRate.field_of(name): optional(_rate(name, Bound(above=0.0)), "Largest, by magnitude.")
    for name in TASK
}
_WITHIN = {
    "friction": optional(
        Annotated[Any, _SHARE],
        "Share of what is known of the drives' friction for which motor torques hold.",
    ),
    "payload": optional(
        Annotated[Any, interval("mass")], "Point masses at the tip for which motor torques hold."
    ),
}
LimitsModel = model_from({**RANGES, **_OF_TOOL, **_RATES, **_WITHIN})
RatesModel = model_from({name: optional(_rate(name), f"Of the {name}.") for name in TASK})
_PAUSE = quantity("time", Bound(at_least=0.0))
_DUTY = Annotated[Any, or_word(_PAUSE, ONCE, f"a pause before it repeats, or {ONCE}")]
_MOTION = Annotated[
    list[Annotated[Any, Part(EntryModel)]], Field(min_length=1, max_length=LONGEST_MOTION)
]
_NAMED = Annotated[
    dict[str, Any],
    Reader(lambda value: value, {"type": "object", "additionalProperties": {"type": "object"}}),
]


def _overrides(slides: bool = False) -> Any:
    given = ("velocity", "acceleration", "jerk")
    keys = {
        name: optional(reading(Joint, name, slides), "In the place of the robot's.")
        for name in given
    }
    return model_from(keys)


OverridesModel = by_joint(_overrides(), _overrides(slides=True))
_PAYLOAD = Annotated[Any, quantity("mass", Bound(above=0.0))]
_START = "Where all of the tool is: four task coordinates, or joints, or tip with spin."
ProblemModel = model_of(
    Problem,
    {
        "name": optional(Text, "By default the file's name without its ending."),
        "robot": (Reference, ...),
        "start": (_part(PointModel), Field(description=_START)),
        "motion": (_MOTION, ...),
        "limits": (_part(LimitsModel), LimitsModel()),
        "eye": optional(_part(EyeModel)),
        "start_rate": (_part(RatesModel), RatesModel()),
        "end_rate": (_part(RatesModel), RatesModel()),
        "duty": (_DUTY, 0.0),
        "points": optional(
            _NAMED, "Points by names, under which `start`, `to`, `through` and `at` may give them."
        ),
        "joints": optional(_part(OverridesModel), "Limits of joints in the place of the robot's."),
        "speed": optional(
            Annotated[Any, _SHARE], "Share of the joints' largest velocities, such as 30 %."
        ),
        "mounting": optional(
            Rotations, "How the robot's base is turned, from how its file states gravity."
        ),
        "tip_payload": optional(_PAYLOAD, "Point mass at the tip, beside the robot's bodies."),
    },
    without=("friction", "payload", "start_acceleration", "wider"),
)
"""What a problem file may say."""


def problem_from(section: Section) -> Problem:
    """The problem that a section describes, its robot loaded. Raises ProblemError."""
    section = written_out(section)
    model: Any = validated(section, ProblemModel)
    robot = _robot(section, model)
    if (
        model.start.joints is None
        and model.start.tip is None
        and (missing := set(TASK) - set(_given(model.start)))
    ):
        first = next(name for name in TASK if name in missing)
        reason = "missing: a start says where all of the tool is"
        raise section.error(reason, "start", first, allowed=", ".join(TASK))
    motion = tuple(_motion(section.sub("motion", i), entry) for i, entry in enumerate(model.motion))
    with located(section, _places(model)), in_tables(motion):
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
            start_rate={name: rate for name, rate in _given(model.start_rate).items() if rate},
            end_rate={name: rate for name, rate in _given(model.end_rate).items() if rate},
            file=section.file_name,
            eye=None if model.eye is None else _eye(section.sub("eye"), model.eye),
        )
        problem.check_total()
    return problem


def _robot(section: Section, model: Any) -> Robot:
    """The robot with what the problem says of it."""
    robot = robot_from(follow(section, "robot"))
    if model.speed is not None and not 0 < model.speed <= 1:
        raise section.error("not a share of the speed", "speed", allowed="above 0 and up to 100 %")
    joints = []
    for joint in robot.joints:
        stated = None if model.joints is None else getattr(model.joints, joint.name)
        given = (
            {} if stated is None else {name: value for name, value in stated if value is not None}
        )
        velocity = given.get("velocity", joint.velocity) * (
            1.0 if model.speed is None else model.speed
        )
        joints.append(replace(joint, **{**given, "velocity": velocity}))
    gravity = robot.gravity
    if model.mounting is not None:
        if named := next((angle for _, angle in model.mounting if isinstance(angle, str)), None):
            raise section.error(
                f"names {named}, an angle of the robot", "mounting", allowed="angles"
            )
        turn = rotation(tuple((axis, float(angle)) for axis, angle in model.mounting))
        gravity = frozen(turn.T @ gravity, (3,))
    robot = replace(robot, joints=(joints[0], joints[1], joints[2], joints[3]), gravity=gravity)
    if not model.tip_payload:
        return robot
    from ssm_planner.dynamics.rigid_body import (
        with_payload,
    )  # with CasADi, which takes longer than to read a problem

    return with_payload(robot, model.tip_payload)


def _places(model: Any) -> dict[str, Place]:
    """Where fields of a Problem stand in the file, by the names that its messages use."""
    places: dict[str, Place] = {
        "start.values": ("start", "joints"),
        "start.position": ("start", "tip"),
    }
    places |= {name: ("limits", name) for name in ("friction", "payload")}
    for i, entry in enumerate(model.motion):
        (name,) = entry.model_fields_set
        here, there = f"motion[{i}]", ("motion", i, name)
        places |= {
            f"{here}.{key}": (*there, key)
            for key in ("blend", "duration", "constant_speed", "distance")
        }
        points: dict[str, Place] = {f"{here}.to": (*there, "to")}
        if (along := entry.free or entry.spline) is not None:
            passed = range(len(along.through))
            points |= {f"{here}.through[{k}]": (*there, "through", k) for k in passed}
        if entry.arc is not None:
            points[f"{here}.through[0]"] = (*there, "through")
        for field, place in points.items():
            places |= {
                f"{field}.values": (*place, "joints"),
                f"{field}.position": (*place, "tip"),
                field: place,
            }
        if entry.scan is not None and entry.scan.pattern == "ring":
            places[f"{here}.diameters"] = (*there, "diameter")
        if name in ("tilt", "roll", "spin", "insert"):
            places[f"{here}.{'depth' if name == 'insert' else name}"] = (*there, "to")
        places[here] = (*there, "to") if entry.straight is not None else there
    return places


def _speeds(model: Any) -> Iterable[Limit]:
    """Limits on the rates of task coordinates and of the tool."""
    for name in TASK:
        if (largest := getattr(model, TaskRate.field_of(name))) is not None:
            yield TaskRate(name, largest)
    for kind in ToolLimit.kinds():
        if (largest := getattr(model, kind.field, None)) is not None:
            yield kind(largest)


def _motion(section: Section, entry: Any) -> Motion:
    (name,) = entry.model_fields_set
    model, line, here = getattr(entry, name), section.line(name), section.sub(name)
    with located(here):
        if entry.dwell is not None:
            return Dwell(entry.dwell, name, line)
        if entry.scan is not None:
            return _scan(here, model)
        if entry.path is not None:
            return path_from(here, name, line)
        if name in ("free", "spline"):
            through = tuple(
                _point(here.sub("through", k), point) for k, point in enumerate(model.through)
            )
            end = _point(here.sub("to"), model.to)
            return (
                Follow(end, through, name, line=line, duration=model.duration)
                if name == "spline"
                else Free(end, through, model.duration, name, line, spin_free=model.to.spin == FREE)
            )
        if entry.retina is not None:
            end = Task(**_given(model.to), line=here.line("to"))
            own = {
                "duration": model.duration,
                "constant_speed": model.constant_speed,
                "distance": model.distance,
            }
            if model.to.depth is not None:
                raise here.error(
                    "how deep the tip goes is what distance says",
                    "to",
                    "depth",
                    allowed="roll, tilt, spin",
                )
            return Follow(end, (), name, name, line=line, **own)
        if name in ("line", "arc"):
            by = () if name == "line" else (_point(here.sub("through"), model.through),)
            timing = {
                "duration": model.duration,
                "blend": model.blend,
                "constant_speed": model.constant_speed,
            }
            return Follow(_point(here.sub("to"), model.to), by, name, name, line=line, **timing)
        to = (
            _given(model.to)
            if entry.straight is not None
            else {"depth" if name == "insert" else name: model.to}
        )
        return Straight(**to, duration=model.duration, name=name, line=line, blend=model.blend)


def _scan(section: Section, model: Any) -> Scan:
    low, middle, high = model.diameters
    if not 0 < low < middle < high:
        reason = "not three rings one around the other"
        raise section.error(reason, "diameters", allowed="three growing lengths")
    diameters = {"raster": (), "ring": (model.diameter,), "triple ring": model.diameters}[
        model.pattern
    ]
    return Scan(
        Task(**_given(model.at), line=section.line("at")),
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


def _given(model: Any) -> dict[str, float]:
    """What is given of task coordinates, or of their rates."""
    return {name: value for name in TASK if (value := getattr(model, name)) not in (None, FREE)}


def _point(section: Section, model: Any) -> Point:
    line = section.line()
    with located(section, {"values": ("joints",), "position": ("tip",)}):
        if model.joints is not None:
            return Joints(model.joints, line)
        if model.tip is not None:
            return Tip(model.tip, 0.0 if model.spin == FREE else model.spin, line)
        return Task(**_given(model), line=line)


def _eye(section: Section, model: Any) -> Eye:
    lens = None
    if model.lens is not None:
        here = section.sub("lens")
        with located(here):
            lens = Lens(model.lens.centre, model.lens.semi_axes, _frame(here, model.lens))
    with located(section):
        return Eye(**{**dict(model), "lens": lens})


def _frame(section: Section, model: Any) -> Array:
    """Columns: the directions of the semi-axes, right-handed; (3, 3)."""

    def direction(name: str) -> Array:
        vector = np.array(getattr(model, name))
        length = float(np.linalg.norm(vector))
        if not 1e-9 < length < np.inf:
            allowed = "three numbers that are not all zero; the length is free"
            raise section.error("no direction", name, allowed=allowed)
        return vector / length

    third = direction("axis")
    if model.first_axis is None:
        first, second, _ = model.semi_axes
        if min(first, second) > 0 and not math.isclose(first, second, rel_tol=1e-9):
            allowed = "the direction of the first semi-axis"
            raise section.error(
                "missing: the first two semi-axes differ", "first_axis", allowed=allowed
            )
        # any direction will do: the base axis that is farthest from the third
        along = np.eye(3)[int(np.argmin(np.abs(third)))]
    else:
        along = direction("first_axis")
        if abs(float(along @ third)) > math.sin(SQUARE):
            angle = math.degrees(math.acos(float(along @ third)))
            raise section.error(
                f"at {angle:.4g} deg to axis", "first_axis", allowed="a right angle, within 0.5 deg"
            )
    along = along - third * float(along @ third)
    along /= np.linalg.norm(along)
    return np.column_stack((along, np.cross(third, along), third))
