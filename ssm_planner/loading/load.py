"""Load problem, robot, drive, motor, controller and motorisation files.

The public functions `load_…` find a file by its path or shipped name, read it and build the value
that it describes. `json_schema` and `file_keys` describe the keys of each kind of file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Union

from pydantic import Field, TypeAdapter

from ssm_planner.arguments import checked
from ssm_planner.loading.drives import drive_from, drive_model
from ssm_planner.loading.files import (
    find_file,
    follow_reference,
    read_section,
    section_from_data,
    section_from_text,
)
from ssm_planner.loading.motions import MOTIONS, JointValues
from ssm_planner.loading.motors import MotorModel, motor_from
from ssm_planner.loading.problems import problem_from, problem_model
from ssm_planner.loading.robots import RobotModel, robot_from
from ssm_planner.loading.schema import (
    SOURCE_KEY,
    Key,
    Model,
    Nested,
    Reference,
    Text,
    build_class_model,
    describe_keys,
    field_type,
    joint_mapping_model,
    locate_errors,
    nested_type,
    validate_section,
)
from ssm_planner.problem import (
    TRANSMISSIONS,
    AxisController,
    Controller,
    Drive,
    JointCompliance,
    Motor,
    Motorisation,
    Robot,
    Stroke,
)
from ssm_planner.problem import Problem as Problem
from ssm_planner.typing import JsonObject


@checked
def load_problem(name: str | Path) -> Problem:
    """Load a problem from a YAML file or by its shipped name.

    Parameters
    ----------
    name : str or Path
        File, or name of a shipped problem.

    Returns
    -------
    Problem
        The problem with its robot.

    Raises
    ------
    ProblemError
        If a value is invalid, or a point of the motion is outside its limits. The error names the
        file, the line and the key.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> problem = ssm.load_problem("tilt_insert")
    >>> [motion.kind for motion in problem.motion]
    ['straight', 'straight']
    """
    return problem_from(read_section(find_file(name, "problems")))


def problem_from_dict(data: Mapping[str, Any]) -> Problem:
    """Build a problem from a mapping with the keys of a problem file.

    Raises ProblemError, which names the key, if a value is invalid.
    """
    return problem_from(section_from_data(data))


Problem.from_dict = problem_from_dict
Problem.from_yaml = lambda text: problem_from(section_from_text(text))


@checked
def load_robot(name: str | Path) -> Robot:
    """Load a robot with its drives and motors from a YAML file or by its shipped name.

    Parameters
    ----------
    name : str or Path
        File, or name of a shipped robot.

    Returns
    -------
    Robot
        The robot.

    Raises
    ------
    ProblemError
        If a value is invalid. The error names the file, the line and the key.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> [joint.name for joint in ssm.load_robot("vitreoretinal").joints]
    ['roll', 'tilt', 'spin', 'insertion']
    """
    return robot_from(read_section(find_file(name, "robots")))


@checked
def load_drive(name: str | Path) -> Drive:
    """Load a drive from a YAML file or by its shipped name.

    Parameters
    ----------
    name : str or Path
        File, or name of a shipped drive.

    Returns
    -------
    Drive
        The drive. Its friction is None if the file states that it is still to be identified.

    Raises
    ------
    ProblemError
        If a value is invalid.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> drive = ssm.load_drive("rig1_lead_screw")
    >>> drive.kind, round(drive.ratio, 3)
    ('lead_screw', 3141.593)
    """
    return drive_from(read_section(find_file(name, "drives")))


@checked
def load_motor(name: str | Path) -> Motor:
    """Load a motor from a YAML file or by its shipped name.

    Parameters
    ----------
    name : str or Path
        File, or name of a shipped motor.

    Returns
    -------
    Motor
        The motor.

    Raises
    ------
    ProblemError
        If a value is invalid.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.load_motor("maxon_ec_13_6w").nominal_voltage
    24.0
    """
    return motor_from(read_section(find_file(name, "motors")))


def _values_by_joint_model(cls: Any) -> Any:
    """Return the model of a mapping from joint names to instances of a class.

    Every joint is optional.

    Parameters
    ----------
    cls : type
        Class whose fields are the keys for each joint.

    Returns
    -------
    type
        Pydantic model of the mapping.
    """
    return joint_mapping_model(lambda slides: build_class_model(cls, slides=slides))


_AxesModel = _values_by_joint_model(AxisController)
_ComplianceModel = _values_by_joint_model(JointCompliance)
ControllerModel = build_class_model(
    Controller,
    {
        "source": SOURCE_KEY,
        "joints": (nested_type(_AxesModel), _AxesModel()),
        "compliance": (nested_type(_ComplianceModel), _ComplianceModel()),
    },
)
"""Model of a controller file. Every key is optional."""


@checked
def load_controller(name: str | Path) -> Controller:
    """Load a motor controller from a YAML file or by its shipped name.

    Parameters
    ----------
    name : str or Path
        File, or name of a shipped controller.

    Returns
    -------
    Controller
        The controller.

    Raises
    ------
    ProblemError
        If a value is invalid.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.load_controller("epos4").loop_period
    0.0004
    """
    section = read_section(find_file(name, "controllers"))
    fields = dict(validate_section(section, ControllerModel))
    del fields["source"]
    with locate_errors(section):
        for key, cls in (("joints", AxisController), ("compliance", JointCompliance)):
            fields[key] = {
                joint: cls(**dict(axis)) for joint, axis in fields[key] if axis is not None
            }
        return Controller(file=section.file_name, **fields)


def _stroke_model(slides: bool) -> Any:
    """Return the model of a stroke of one joint.

    Parameters
    ----------
    slides : bool
        True for the units of a prismatic joint.
    """
    centre = field_type(Stroke, "centre", slides), 0.0
    return build_class_model(Stroke, {"centre": centre}, slides=slides, without=("joint",))


_StrokesModel = joint_mapping_model(_stroke_model)


class MotorisationModel(Model):
    """Model of a motorisation file."""

    name: Text | None = None
    """Name. The default is the file's name without its suffix."""
    source: Text | None = None
    """Source of the figures."""
    robot: Reference
    """Robot whose joints move."""
    held: JointValues = (0.0, 0.0, 0.0, 0.0)
    """Positions of the joints that do not move."""
    back_and_forth: Annotated[
        list[Annotated[Any, Nested(_StrokesModel)]], Field(min_length=1, max_length=100)
    ]
    """Back-and-forth strokes of one joint each."""


def load_motorisation(name: str | Path) -> Motorisation:
    """Load a motorisation and its robot from a YAML file or by its shipped name.

    A motorisation contains back-and-forth strokes of single joints, for which motors are sized.

    Parameters
    ----------
    name : str or Path
        File, or name of a shipped motorisation.

    Returns
    -------
    Motorisation
        The strokes and the robot.

    Raises
    ------
    ProblemError
        If a value is invalid.
    """
    section = read_section(find_file(name, "motorisation"))
    if section.has_key("motion") and not section.has_key("back_and_forth"):
        raise section.error(
            "this is a problem file: plan it first, then size its plan.json", "motion", show=False
        )
    model = validate_section(section, MotorisationModel)
    robot = robot_from(follow_reference(section, "robot"))
    strokes: list[Stroke] = []
    for i, run in enumerate(model.back_and_forth):
        joints = list(run.model_fields_set)
        if len(joints) != 1:
            entry = section.sub("back_and_forth", i)
            raise entry.error(
                f"{len(joints)} joints in one run",
                allowed="one joint per run: roll, tilt or insertion",
            )
        strokes.append(Stroke(joints[0], home=model.held, **dict(getattr(run, joints[0]))))
    locations = {
        f"strokes[{i}].joint": ("back_and_forth", i, stroke.joint)
        for i, stroke in enumerate(strokes)
    }
    with locate_errors(section, locations):
        return Motorisation(model.name or section.name, robot, tuple(strokes), section.file_name)


FileKind = Literal["problem", "robot", "drive", "motor", "motorisation", "controller"]
"""Kinds of files that users write."""


def _file_models(file_kind: FileKind) -> tuple[Any, ...]:
    """Return the pydantic models of a kind of file.

    Parameters
    ----------
    file_kind : str
        "problem", "robot", "drive", "motor", "motorisation" or "controller".

    Returns
    -------
    tuple of type
        One model for each kind of drive, or a single model for any other file.
    """
    models = {
        "problem": problem_model(tuple(MOTIONS)),
        "robot": RobotModel,
        "motor": MotorModel,
        "motorisation": MotorisationModel,
        "controller": ControllerModel,
    }
    return tuple(map(drive_model, TRANSMISSIONS)) if file_kind == "drive" else (models[file_kind],)


def json_schema(file_kind: FileKind) -> JsonObject:
    """Return the JSON schema of a kind of file.

    Editors complete and check YAML files with the schema.

    Parameters
    ----------
    file_kind : str
        "problem", "robot", "drive", "motor", "motorisation" or "controller".

    Returns
    -------
    dict
        JSON schema of the file.
    """
    every: Any = Union[_file_models(file_kind)]  # noqa: UP007 - of a tuple
    return TypeAdapter(every).json_schema()


def file_keys(file_kind: FileKind) -> tuple[Key, ...]:
    """Return a description of every key in a kind of file.

    A description contains the unit, the allowed values, the default and the meaning of the key.
    """
    return tuple(
        dict.fromkeys(key for model in _file_models(file_kind) for key in describe_keys(model))
    )
