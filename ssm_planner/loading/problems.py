"""Read problem files, and relate the fields of a Problem to the keys of its file.

`problem_model` describes the keys of the file as a pydantic model, and `problem_from` builds the
Problem from a validated model.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Annotated, Any

import numpy as np

from ssm_planner import units
from ssm_planner.loading.files import follow_reference
from ssm_planner.loading.missions import expand_abbreviations
from ssm_planner.loading.motions import (
    BUILT_IN_KEYS,
    MOTIONS,
    FreeTargetModel,
    KeyPath,
    PointModel,
    accept_keyword,
    key_locations,
    motion_list_type,
    motions_from,
    point_from,
    stated_coordinates,
)
from ssm_planner.loading.path_file import locate_table_errors
from ssm_planner.loading.robots import (
    RANGE_KEYS,
    Rotations,
    chain_rotation,
    ranges_from,
    robot_from,
)
from ssm_planner.loading.schema import (
    POSITIVE,
    UNBOUNDED,
    Axis,
    Reader,
    Reference,
    Text,
    build_class_model,
    build_keys_model,
    field_type,
    interval_reader,
    joint_mapping_model,
    locate_errors,
    nested_type,
    optional_key,
    positive_type,
    quantity_reader,
    required_key,
    validate_section,
)
from ssm_planner.loading.yaml_nodes import Node, Section
from ssm_planner.problem import (
    TASK_COORDINATES,
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
from ssm_planner.units import QUANTITY_KINDS

DUTY_ONCE = "once"
"""Value of the key `duty` for a motion that does not repeat."""
AXIS_TOLERANCE = math.radians(0.5)
"""Largest deviation of the lens axes from a right angle, rad. Smaller deviations are corrected."""


def _rate_type(name: str, bound: Bound = UNBOUNDED) -> Any:
    """Return the type with which pydantic reads the rate of a task coordinate, such as "5 deg/s".

    Parameters
    ----------
    name : str
        Name of the coordinate, such as "tilt".
    bound : Bound
        Allowed values in SI units.

    Returns
    -------
    type
        A velocity for the depth, and an angular velocity for other coordinates.
    """
    return Annotated[
        Any, quantity_reader("velocity" if name == "depth" else "angular_velocity", bound)
    ]


def _tool_limit_type(limit_type: type[ToolLimit]) -> Any:
    """Return the type of a key whose value is the positive bound of a limit on the tool.

    The kind of quantity follows from the unit of the limit.

    Parameters
    ----------
    limit_type : type
        Class of the limit, such as the limit on the tip speed.

    Returns
    -------
    type
        Type for pydantic models.
    """
    (kind_name, *_) = (
        name for name, candidate in QUANTITY_KINDS.items() if candidate.unit == limit_type.unit
    )
    return positive_type(kind_name)


LensModel = build_class_model(
    Lens,
    {
        "axis": required_key(Axis, "Direction of the third semi-axis, of any length."),
        "first_axis": optional_key(
            Axis, "Direction of the first semi-axis, required if it differs from the second."
        ),
    },
)
EyeModel = build_class_model(Eye, {"lens": optional_key(nested_type(LensModel))})


_PERCENTAGE_READER = Reader(
    units.parse_share, {"type": ["string", "number"]}, ("number",), "such as 95 %"
)
_TOOL_KEYS = {
    kind.field: optional_key(
        _tool_limit_type(kind), " ".join(str(kind.__doc__).partition("Examples")[0].split())
    )
    for kind in ToolLimit.kinds()
}
_RATE_KEYS = {
    TaskRate.field_of(name): optional_key(_rate_type(name, POSITIVE), "Largest, by magnitude.")
    for name in TASK_COORDINATES
}
_MARGIN_KEYS = {
    "friction": optional_key(
        Annotated[Any, _PERCENTAGE_READER],
        "Confidence level of the drives' friction for which motor torques hold.",
    ),
    "payload": optional_key(
        Annotated[Any, interval_reader("mass")],
        "Point masses at the tip for which motor torques hold.",
    ),
}
LimitsModel = build_keys_model({**RANGE_KEYS, **_TOOL_KEYS, **_RATE_KEYS, **_MARGIN_KEYS})
RatesModel = build_keys_model(
    {name: optional_key(_rate_type(name), f"Rate of the {name}.") for name in TASK_COORDINATES}
)
_PAUSE_READER = quantity_reader("time", Bound(at_least=0.0))
_Duty = Annotated[
    Any,
    accept_keyword(_PAUSE_READER, DUTY_ONCE, f"a pause before the motion repeats, or {DUTY_ONCE}"),
]
_NamedPoints = Annotated[
    dict[str, Any],
    Reader(lambda value: value, {"type": "object", "additionalProperties": {"type": "object"}}),
]


def _joint_overrides_model(slides: bool) -> Any:
    """Return the model of the joint limits in a problem file, which replace those of the robot.

    Parameters
    ----------
    slides : bool
        True for the units of the prismatic joint.
    """
    names = ("velocity", "acceleration", "jerk")
    keys = {
        name: optional_key(field_type(Joint, name, slides), "Value instead of the robot's.")
        for name in names
    }
    return build_keys_model(keys)


OverridesModel = joint_mapping_model(_joint_overrides_model)
_START_TEXT = "Start point: four task coordinates, or joints, or tip with spin."


@cache
def problem_model(motion_keys: tuple[str, ...]) -> Any:
    """Return the model of problem files.

    Parameters
    ----------
    motion_keys : tuple of str
        Keys of motions that the file may contain, which are names in `MOTIONS`.

    Returns
    -------
    type
        Pydantic model with a field for each key of the file.
    """
    keys = {
        "name": optional_key(Text, "Name. The default is the file's name without its suffix."),
        "robot": (Reference, ...),
        "start": required_key(nested_type(PointModel), _START_TEXT),
        "motion": (motion_list_type(motion_keys), ...),
        "limits": (nested_type(LimitsModel), LimitsModel()),
        "eye": optional_key(nested_type(EyeModel)),
        "start_rate": (nested_type(RatesModel), RatesModel()),
        "end_rate": (nested_type(RatesModel), RatesModel()),
        "duty": (_Duty, 0.0),
        "points": optional_key(
            _NamedPoints, "Named points that `start`, `to`, `through` and `at` may use."
        ),
        "joints": optional_key(
            nested_type(OverridesModel), "Limits of joints instead of the robot's."
        ),
        "speed": optional_key(
            Annotated[Any, _PERCENTAGE_READER],
            "Share of the largest joint velocities, such as 30 %.",
        ),
        "mounting": optional_key(
            Rotations,
            "Rotation of the robot's base relative to the pose for which its file states gravity.",
        ),
        "tip_payload": optional_key(
            positive_type("mass"), "Point mass at the tip in addition to the robot's bodies."
        ),
    }
    without = ("friction", "payload", "start_acceleration", "excess_ranges")
    return build_class_model(Problem, keys, without=without)


def _motion_keys(section: Section) -> tuple[str, ...]:
    """Return the keys of motions that the model of a file needs.

    They are the keys of this package or, if the file has a key of another package, all registered
    keys. A model with all keys takes longer to build.
    """
    motion = section.root.children.get("motion", Node(None, None))
    names = {name for entry in motion.children.values() for name in entry.children}
    return BUILT_IN_KEYS if names <= set(BUILT_IN_KEYS) else tuple(MOTIONS)


def problem_from(section: Section) -> Problem:
    """Build the problem that a section describes, with its robot.

    Parameters
    ----------
    section : Section
        Content of a problem file.

    Returns
    -------
    Problem
        The problem.

    Raises
    ------
    ProblemError
        If a value is invalid. The error names the file, the line and the key.
    """
    section = expand_abbreviations(section)
    if "geometry" in section.value:
        raise section.error(
            "a robot file instead of a problem file", allowed="a file with start and motion"
        )
    for name in section.value.get("points", ()):  # the points that no motion uses as well
        point = section.sub("points", name)
        point_from(point, validate_section(point, FreeTargetModel))
    model: Any = validate_section(section, problem_model(_motion_keys(section)))
    robot = _robot_from(section, model)
    if (
        model.start.joints is None
        and model.start.tip is None
        and (missing := set(TASK_COORDINATES) - set(stated_coordinates(model.start)))
    ):
        missing_name = next(name for name in TASK_COORDINATES if name in missing)
        reason = "missing: a start needs all four coordinates"
        raise section.error(reason, "start", missing_name, allowed=", ".join(TASK_COORDINATES))
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
    with locate_errors(section, locations), locate_table_errors(tuple(motions)):
        problem = Problem(
            name=model.name or section.name,
            robot=robot,
            start=point_from(section.sub("start"), model.start),
            motion=tuple(motions),
            limits=(*ranges_from(model.limits), *_rate_and_tool_limits(model.limits)),
            friction=model.limits.friction,
            payload=model.limits.payload,
            objective=model.objective,
            duration=model.duration,
            duty=None if model.duty == DUTY_ONCE else model.duty,
            planner=model.planner,
            start_rate=_nonzero_rates(model.start_rate),
            end_rate=_nonzero_rates(model.end_rate),
            file=section.file_name,
            eye=None if model.eye is None else _eye_from(section.sub("eye"), model.eye),
        )
        problem.check_total()
    return problem


def _robot_from(section: Section, model: Any) -> Robot:
    """Build the robot of a problem with the problem's joint limits, mounting and payload.

    Parameters
    ----------
    section : Section
        The problem file.
    model : object
        The validated section.

    Returns
    -------
    Robot
        The robot of the problem.

    Raises
    ------
    ProblemError
        If a value is invalid.
    """
    robot = robot_from(follow_reference(section, "robot"))
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
        # Gravity in the base frame of the robot that is mounted in another pose.
        turn = chain_rotation(tuple((axis, float(angle)) for axis, angle in model.mounting))
        gravity = read_only_array(turn.T @ gravity, (3,))
    robot = replace(robot, joints=tuple(joints), gravity=gravity)
    if not model.tip_payload:
        return robot
    # Most problems do not need the dynamics of rigid bodies, which take time to import.
    from ssm_planner.dynamics import with_payload

    return with_payload(robot, model.tip_payload)


def _nonzero_rates(model: Any) -> dict[str, float]:
    """Return the rates of task coordinates at one end of the motion that are not 0, by name."""
    return {name: rate for name, rate in stated_coordinates(model).items() if rate}


def _rate_and_tool_limits(model: Any) -> Iterable[Limit]:
    """Yield the limits of a problem file on the rates of task coordinates and on the tool.

    Parameters
    ----------
    model : object
        Validated content of the key `limits`.

    Yields
    ------
    Limit
        Limit in SI units.
    """
    for name in TASK_COORDINATES:
        if (bound := getattr(model, TaskRate.field_of(name))) is not None:
            yield TaskRate(name, bound)
    for limit_type in ToolLimit.kinds():
        if (bound := getattr(model, limit_type.field, None)) is not None:
            yield limit_type(bound)


def _eye_from(section: Section, model: Any) -> Eye:
    """Build the eye that a section describes.

    Parameters
    ----------
    section : Section
        Part of the file that describes the eye.
    model : object
        The validated section.

    Returns
    -------
    Eye
        The eye with its lens.

    Raises
    ------
    ProblemError
        If a value is invalid.
    """
    lens = None
    if model.lens is not None:
        lens_section = section.sub("lens")
        with locate_errors(lens_section):
            lens = Lens(
                model.lens.centre, model.lens.semi_axes, _lens_frame(lens_section, model.lens)
            )
    with locate_errors(section):
        return Eye(**{**dict(model), "lens": lens})


def _lens_frame(section: Section, model: Any) -> Array:
    """Return the rotation matrix whose columns are the directions of the semi-axes of the lens.

    The file states the direction of the third semi-axis, and that of the first one if the first two
    semi-axes differ.

    Parameters
    ----------
    section : Section
        Part of the file that describes the lens.
    model : object
        The validated section.

    Returns
    -------
    (3, 3) array
        Rotation matrix from the frame of the lens to the base frame.

    Raises
    ------
    ProblemError
        If a direction is missing or zero, or if the directions are not perpendicular.
    """

    def direction(name: str) -> Array:
        """Read a direction and normalize it.

        Parameters
        ----------
        name : str
            Key of the section with three numbers.

        Returns
        -------
        (3,) array
            Unit vector.

        Raises
        ------
        ProblemError
            If all numbers are 0, or a number is not finite.
        """
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
        # The direction is arbitrary. The base axis that deviates most from the third semi-axis
        # gives the most accurate result.
        axis = np.eye(3)[int(np.argmin(np.abs(third)))]
    else:
        axis = direction("first_axis")
        if abs(float(axis @ third)) > math.sin(AXIS_TOLERANCE):
            angle = math.degrees(math.acos(float(axis @ third)))
            raise section.error(
                f"at {angle:.4g} deg to axis", "first_axis", allowed="a right angle, within 0.5 deg"
            )
    # Make the first axis perpendicular to the third one.
    axis = axis - third * float(axis @ third)
    axis /= np.linalg.norm(axis)
    return np.column_stack((axis, np.cross(third, axis), third))
