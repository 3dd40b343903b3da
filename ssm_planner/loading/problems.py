"""Read problem files, and relate the fields of a Problem to the keys of its file.

The models describe the keys of the file. The functions build the values from a validated model.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Annotated, Any

import numpy as np

from ssm_planner import units
from ssm_planner.loading.files import follow
from ssm_planner.loading.missions import written_out
from ssm_planner.loading.motions import (
    BUILT_IN,
    MOTIONS,
    KeyPath,
    PointModel,
    key_locations,
    motion_list,
    motions_from,
    or_word,
    point_from,
    set_coordinates,
)
from ssm_planner.loading.path_file import in_tables
from ssm_planner.loading.robots import RANGES, Rotations, ranges_from, robot_from, rotation
from ssm_planner.loading.schema import (
    POSITIVE,
    UNBOUND,
    Axis,
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
)
from ssm_planner.loading.schema import Field as Reader
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem import (
    TASK,
    Bound,
    Eye,
    Joint,
    Lens,
    Limit,
    Motion,
    Problem,
    Robot,
    TaskRate,
    ToolLimit,
    read_only_array,
)
from ssm_planner.typing import Array
from ssm_planner.units import KINDS

ONCE = "once"
"""Duty of a motion that does not repeat."""
AXIS_TOLERANCE = math.radians(0.5)
"""Largest deviation of the lens axes from a right angle, rad. Smaller deviations are corrected."""


def _rate(name: str, bound: Bound = UNBOUND) -> Any:
    """Return the type of the rate of a task coordinate (such as "tilt") with bounds in SI units."""
    return Annotated[Any, quantity("velocity" if name == "depth" else "angular_velocity", bound)]


def _bound_field(limit_type: type[ToolLimit]) -> Any:
    """Return the type of the bound of a limit on the tool, which must be positive."""
    (kind_name, *_) = (
        name for name, candidate in KINDS.items() if candidate.unit == limit_type.unit
    )
    return positive(kind_name)


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


_SHARE = Reader(units.share, {"type": ["string", "number"]}, ("number",), "such as 95 %")
_TOOL_KEYS = {
    kind.field: optional(
        _bound_field(kind), " ".join(str(kind.__doc__).partition("Examples")[0].split())
    )
    for kind in ToolLimit.kinds()
}
_RATE_KEYS = {
    TaskRate.field_of(name): optional(_rate(name, POSITIVE), "Largest, by magnitude.")
    for name in TASK
}
_MARGIN_KEYS = {
    "friction": optional(
        Annotated[Any, _SHARE],
        "Confidence level of the drives' friction for which motor torques hold.",
    ),
    "payload": optional(
        Annotated[Any, interval("mass")], "Point masses at the tip for which motor torques hold."
    ),
}
LimitsModel = model_from({**RANGES, **_TOOL_KEYS, **_RATE_KEYS, **_MARGIN_KEYS})
RatesModel = model_from({name: optional(_rate(name), f"Rate of the {name}.") for name in TASK})
_PAUSE = quantity("time", Bound(at_least=0.0))
_DUTY = Annotated[Any, or_word(_PAUSE, ONCE, f"a pause before the motion repeats, or {ONCE}")]
_NAMED_POINTS = Annotated[
    dict[str, Any],
    Reader(lambda value: value, {"type": "object", "additionalProperties": {"type": "object"}}),
]


def _overrides(slides: bool) -> Any:
    """Build the model of joint limits that replace those of the robot.

    `slides` is true for the prismatic joint.
    """
    names = ("velocity", "acceleration", "jerk")
    keys = {
        name: optional(reading(Joint, name, slides), "Value instead of the robot's.")
        for name in names
    }
    return model_from(keys)


OverridesModel = by_joint(_overrides)
_START = "Start point: four task coordinates, or joints, or tip with spin."


@cache
def problem_model(motion_keys: tuple[str, ...]) -> Any:
    """Build the model of problem files whose motions have the keys `motion_keys` of `MOTIONS`."""
    keys = {
        "name": optional(Text, "Name. The default is the file's name without its suffix."),
        "robot": (Reference, ...),
        "start": required(nested(PointModel), _START),
        "motion": (motion_list(motion_keys), ...),
        "limits": (nested(LimitsModel), LimitsModel()),
        "eye": optional(nested(EyeModel)),
        "start_rate": (nested(RatesModel), RatesModel()),
        "end_rate": (nested(RatesModel), RatesModel()),
        "duty": (_DUTY, 0.0),
        "points": optional(
            _NAMED_POINTS, "Named points that `start`, `to`, `through` and `at` may use."
        ),
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
    }
    without = ("friction", "payload", "start_acceleration", "excess_ranges")
    return model_of(Problem, keys, without=without)


def _motion_keys(section: Section) -> tuple[str, ...]:
    """Return the keys of motions that the model of a file needs.

    They are the keys of this package or, if the file has a key of another package, all registered
    keys. This saves time, because a model with all keys takes longer to build.
    """
    entries = section.value.get("motion")
    mappings = [entry for entry in entries if isinstance(entry, dict)] if entries else []
    names = {name for entry in mappings for name in entry}
    return BUILT_IN if names <= set(BUILT_IN) else tuple(MOTIONS)


def problem_from(section: Section) -> Problem:
    """Build the problem that a section describes, with its robot.

    Raises ProblemError if a value is invalid.
    """
    section = written_out(section)
    if "geometry" in section.value:
        raise section.error(
            "a robot file instead of a problem file", allowed="a file with start and motion"
        )
    model: Any = validated(section, problem_model(_motion_keys(section)))
    robot = _robot(section, model)
    if (
        model.start.joints is None
        and model.start.tip is None
        and (missing := set(TASK) - set(set_coordinates(model.start)))
    ):
        missing_name = next(name for name in TASK if name in missing)
        reason = "missing: a start needs all four coordinates"
        raise section.error(reason, "start", missing_name, allowed=", ".join(TASK))
    motions: list[Motion] = []
    locations: dict[str, KeyPath] = {
        "start.values": ("start", "joints"),
        "start.position": ("start", "tip"),
        "friction": ("limits", "friction"),
        "payload": ("limits", "payload"),
    }
    for i, entry in enumerate(model.motion):
        (name,) = entry.model_fields_set
        value = getattr(entry, name)
        for motion in motions_from(section.sub("motion", i, name), value):
            locations |= key_locations(f"motion[{len(motions)}]", ("motion", i, name), value)
            motions.append(motion)
    with located(section, locations), in_tables(tuple(motions)):
        problem = Problem(
            name=model.name or section.name,
            robot=robot,
            start=point_from(section.sub("start"), model.start),
            motion=tuple(motions),
            limits=(*ranges_from(model.limits), *_speeds(model.limits)),
            friction=model.limits.friction,
            payload=model.limits.payload,
            objective=model.objective,
            duration=model.duration,
            duty=None if model.duty == ONCE else model.duty,
            planner=model.planner,
            start_rate=_rates(model.start_rate),
            end_rate=_rates(model.end_rate),
            file=section.file_name,
            eye=None if model.eye is None else _eye(section.sub("eye"), model.eye),
        )
        problem.check_total()
    return problem


def _robot(section: Section, model: Any) -> Robot:
    """Build the robot of a problem with the problem's joint limits, mounting and payload.

    Raises ProblemError if a value is invalid.
    """
    robot = robot_from(follow(section, "robot"))
    if model.speed is not None and not 0 < model.speed <= 1:
        raise section.error(
            "invalid share of the speed", "speed", allowed="above 0 and at most 100 %"
        )
    joints: Any = []
    for joint in robot.joints:
        joint_model = None if model.joints is None else getattr(model.joints, joint.name)
        overrides = (
            {}
            if joint_model is None
            else {name: value for name, value in joint_model if value is not None}
        )
        velocity = overrides.get("velocity", joint.velocity) * (model.speed or 1.0)
        joints.append(replace(joint, **{**overrides, "velocity": velocity}))
    gravity = robot.gravity
    if model.mounting is not None:
        if preset := next((angle for _, angle in model.mounting if isinstance(angle, str)), None):
            raise section.error(
                f"names {preset}, an angle of the robot", "mounting", allowed="angles"
            )
        turn = rotation(tuple((axis, float(angle)) for axis, angle in model.mounting))
        gravity = read_only_array(turn.T @ gravity, (3,))
    robot = replace(robot, joints=tuple(joints), gravity=gravity)
    if not model.tip_payload:
        return robot
    from ssm_planner.dynamics import with_payload

    return with_payload(robot, model.tip_payload)


def _rates(model: Any) -> dict[str, float]:
    """Return the rates of task coordinates at one end that are not 0, by name."""
    return {name: rate for name, rate in set_coordinates(model).items() if rate}


def _speeds(model: Any) -> Iterable[Limit]:
    """Yield the limits on the rates of task coordinates and on the tool."""
    for name in TASK:
        if (bound := getattr(model, TaskRate.field_of(name))) is not None:
            yield TaskRate(name, bound)
    for limit_type in ToolLimit.kinds():
        if (bound := getattr(model, limit_type.field, None)) is not None:
            yield limit_type(bound)


def _eye(section: Section, model: Any) -> Eye:
    """Build the eye that a section describes. Raises ProblemError if a value is invalid."""
    lens = None
    if model.lens is not None:
        lens_section = section.sub("lens")
        with located(lens_section):
            lens = Lens(model.lens.centre, model.lens.semi_axes, _frame(lens_section, model.lens))
    with located(section):
        return Eye(**{**dict(model), "lens": lens})


def _frame(section: Section, model: Any) -> Array:
    """Return the rotation matrix (3, 3) whose columns are the directions of the lens's semi-axes.

    Raises ProblemError if the directions in the file are not perpendicular.
    """

    def direction(name: str) -> Array:
        """Return the unit vector (3,) that the file states under a key."""
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
        if abs(float(axis @ third)) > math.sin(AXIS_TOLERANCE):
            angle = math.degrees(math.acos(float(axis @ third)))
            raise section.error(
                f"at {angle:.4g} deg to axis", "first_axis", allowed="a right angle, within 0.5 deg"
            )
    axis = axis - third * float(axis @ third)
    axis /= np.linalg.norm(axis)
    return np.column_stack((axis, np.cross(third, axis), third))
