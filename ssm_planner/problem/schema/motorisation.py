"""Schema of a motorisation file: single joints moved back and forth to find what their motors need."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field as PydanticField

from ssm_planner.problem.schema.common import Model, Text, quantity
from ssm_planner.problem.schema.points import Joints
from ssm_planner.problem.schema.robot import Reference

Angle = Annotated[float, quantity("angle")]
Length = Annotated[float, quantity("length")]


class RevoluteRun(Model):
    """Centre ± reach, at the speed and acceleration of a trapezoid."""

    reach: Annotated[float, quantity("angle", above=0)]
    centre: Angle = 0.0
    velocity: Annotated[float, quantity("angular_velocity", above=0)]
    acceleration: Annotated[float, quantity("angular_acceleration", above=0)]


class PrismaticRun(Model):
    """Centre ± reach, at the speed and acceleration of a trapezoid."""

    reach: Annotated[float, quantity("length", above=0)]
    centre: Length = 0.0
    velocity: Annotated[float, quantity("velocity", above=0)]
    acceleration: Annotated[float, quantity("acceleration", above=0)]


class RunModel(Model):
    """One of the joints."""

    roll: RevoluteRun | None = None
    tilt: RevoluteRun | None = None
    spin: RevoluteRun | None = None
    insertion: PrismaticRun | None = None


class MotorisationModel(Model):
    """See problem/motorisation.py."""

    name: Text | None = None
    source: Text | None = None
    robot: Reference
    held: Joints = (0.0, 0.0, 0.0, 0.0)
    """Where the joints stand that do not move."""
    back_and_forth: Annotated[list[RunModel], PydanticField(min_length=1, max_length=100)]
