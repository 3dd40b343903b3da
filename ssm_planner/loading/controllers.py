"""A controller file → Controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import create_model

from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.schema.common import Model, Text, Truth, model_of
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.controller import AxisController, Controller, JointCompliance
from ssm_planner.problem.robot import JOINTS

_GAINS = {
    "bandwidth": "rate",
    "p": "position_gain",
    "i": "integral_gain",
    "d": "derivative_gain",
    "ff_velocity": "derivative_gain",
    "ff_acceleration": "acceleration_gain",
    "max_current": "current",
}
_SPRING: Mapping[str, Any] = {"frequency": "rate", "damping_ratio": "number", "source": (Text | None, None)}
_TURNS, _SLIDES = (model_of(AxisController, {**_GAINS, "following_error": kind}) for kind in ("angle", "length"))
_TWISTS, _STRETCHES = (model_of(JointCompliance, {**_SPRING, "backlash": kind}) for kind in ("angle", "length"))


def _by_joint(turning: Any, sliding: Any) -> Any:
    """The model of a mapping from joints to what one of them has."""
    each = {name: (sliding if name == "insertion" else turning) | None for name in JOINTS}
    fields: dict[str, Any] = {name: (model, None) for name, model in each.items()}
    return create_model("JointsModel", __base__=Model, **fields)


AxesModel, ComplianceModel = _by_joint(_TURNS, _SLIDES), _by_joint(_TWISTS, _STRETCHES)

ControllerModel = model_of(
    Controller,
    {
        "name": (Text, Controller.name),
        "source": (Text | None, None),
        "loop_period": "time",
        "current_lag": "time",
        "supply": "voltage",
        "output_share": "number",
        "counts_per_turn": "number",
        "torque_offset": (Truth, True),
        "joints": (AxesModel, AxesModel()),
        "compliance": (ComplianceModel, ComplianceModel()),
    },
)
"""What a controller file may say; all of it may be left out."""


def controller_from(section: Section) -> Controller:
    """The controller that a section describes; what it leaves out is the default. Raises ProblemError."""
    given = dict(validated(section, ControllerModel))
    del given["source"]
    counts = given["counts_per_turn"]
    if counts is not None and counts == round(counts):
        given["counts_per_turn"] = round(counts)
    axes = {name: dict(axis) for name, axis in given.pop("joints") if axis is not None}
    parts = {name: dict(part) for name, part in given.pop("compliance") if part is not None}
    with located(section):
        return Controller(
            joints={name: AxisController(**axis) for name, axis in axes.items()},
            compliance={name: JointCompliance(**part) for name, part in parts.items()},
            file=None if section.file is None else str(section.file),
            **given,
        )
