"""A motorisation file → Motorisation: runs of single joints that say what motors the joints need."""

from __future__ import annotations

from pathlib import Path

from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.robots import robot_from
from ssm_planner.loading.schema.motor import MotorisationModel
from ssm_planner.loading.shipped import find
from ssm_planner.loading.yaml_nodes import Section, follow, read
from ssm_planner.problem.motorisation import Motorisation, Stroke


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
        stroke = getattr(run, joint)
        strokes.append(
            Stroke(
                joint,
                stroke.centre,
                reach=stroke.reach,
                velocity=stroke.velocity,
                acceleration=stroke.acceleration,
                home=model.held,
            )
        )
    keys = {f"strokes[{i}].joint": ("back_and_forth", i, stroke.joint) for i, stroke in enumerate(strokes)}
    with located(section, keys):
        return Motorisation(model.name or section.name, robot, tuple(strokes), str(section.file))
