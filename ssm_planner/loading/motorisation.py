"""A motorisation file → Motorisation: runs of single joints that say what motors the joints need."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.problems import JointValues
from ssm_planner.loading.robots import robot_from
from ssm_planner.loading.schema.common import Model, Part, Reference, Text, model_of, quantity
from ssm_planner.loading.shipped import find
from ssm_planner.loading.yaml_nodes import Section, follow, read
from ssm_planner.problem.motorisation import Motorisation, Stroke


def _run(kind: str, velocity: str, acceleration: str) -> Any:
    """Centre ± reach, at the speed and acceleration of a trapezoid."""
    centre = Annotated[float, quantity(kind)], 0.0
    return model_of(Stroke, {"reach": kind, "centre": centre, "velocity": velocity, "acceleration": acceleration})


RevoluteRun = _run("angle", "angular_velocity", "angular_acceleration")
PrismaticRun = _run("length", "velocity", "acceleration")


class RunModel(Model):
    """One of the joints."""

    roll: Annotated[Any, Part(RevoluteRun)] | None = None
    tilt: Annotated[Any, Part(RevoluteRun)] | None = None
    spin: Annotated[Any, Part(RevoluteRun)] | None = None
    insertion: Annotated[Any, Part(PrismaticRun)] | None = None


class MotorisationModel(Model):
    """What a motorisation file may say; held: where the joints stand that do not move."""

    name: Text | None = None
    source: Text | None = None
    robot: Reference
    held: JointValues = (0.0, 0.0, 0.0, 0.0)
    back_and_forth: Annotated[list[RunModel], Field(min_length=1, max_length=100)]


def load_motorisation(name: str | Path) -> Motorisation:
    """The motorisation runs in a YAML file, or the shipped ones of this name, their robot loaded. Raises ProblemError."""
    return motorisation_from(read(find(name, "motorisation")))


def motorisation_from(section: Section) -> Motorisation:
    """The motorisation runs that a section describes. Raises ProblemError."""
    if section.holds("motion") and not section.holds("back_and_forth"):
        raise section.error("a problem to plan: plan it first, then size its plan.json", "motion", show=False)
    model = validated(section, MotorisationModel)
    robot = robot_from(follow(section, "robot"))
    strokes: list[Stroke] = []
    for i, run in enumerate(model.back_and_forth):
        here = section.sub("back_and_forth", i)
        given = list(run.model_fields_set)
        if len(given) != 1:
            raise here.error(f"{len(given)} joints in one run", allowed="one joint per run: roll, tilt or insertion")
        (joint,) = given
        strokes.append(Stroke(joint, home=model.held, **dict(getattr(run, joint))))
    keys = {f"strokes[{i}].joint": ("back_and_forth", i, stroke.joint) for i, stroke in enumerate(strokes)}
    with located(section, keys):
        return Motorisation(model.name or section.name, robot, tuple(strokes), str(section.file))
