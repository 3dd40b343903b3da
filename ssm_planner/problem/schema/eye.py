"""Schema of the eye in a problem file, in the base frame at the remote centre."""

from __future__ import annotations

from typing import Annotated

from ssm_planner.problem.schema.common import Model, quantity, vector
from ssm_planner.problem.schema.robot import Axis

Point = Annotated[tuple[float, float, float], vector("length", "length", "length")]
Size = Annotated[float, quantity("length", above=0)]


class LensModel(Model):
    """An ellipsoid. axis: direction of the third semi-axis; first_axis: of the first, where it differs from the second."""

    centre: Point
    semi_axes: Annotated[tuple[float, float, float], vector("length", "length", "length")]
    axis: Axis
    first_axis: Axis | None = None


class EyeModel(Model):
    """See values.Eye."""

    centre: Point
    radius: Size
    clearance: Annotated[float, quantity("length", at_least=0)]
    port: Size = 3e-3
    shaft_radius: Annotated[float, quantity("length", at_least=0)] = 0.0
    lens: LensModel | None = None
