"""The eye of a problem file → Eye: a globe about the port that the tip can enter, and a lens beside the port."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ssm_planner.loading.faults import located
from ssm_planner.loading.schema.common import Axis, model_of
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.problem import Eye, Lens
from ssm_planner.typing import Array

LensModel = model_of(
    Lens, {"centre": "length", "semi_axes": "length", "axis": (Axis, ...), "first_axis": (Axis | None, None)}
)
"""An ellipsoid. axis: direction of the third semi-axis; first_axis: of the first, where it differs from the second."""
_LENGTHS = dict.fromkeys(("centre", "radius", "clearance", "port", "shaft_radius"), "length")
EyeModel = model_of(Eye, {**_LENGTHS, "lens": (LensModel | None, None)})
"""What a problem file may say of an eye."""

SQUARE = math.radians(0.5)
"""How far the axes of a lens may be from a right angle; the first is then turned into it."""


def eye_from(section: Section, model: Any) -> Eye:
    """The eye that a section describes, validated by EyeModel. Raises ProblemError."""
    with located(section):
        lens = None if model.lens is None else _lens(section.sub("lens"), model.lens)
        return Eye(**{**dict(model), "lens": lens})


def as_written(eye: Eye) -> dict[str, Any]:
    """What a problem file says of an eye, exactly: eye_from gives it back."""
    written: dict[str, Any] = {
        "centre": _lengths(eye.centre),
        **{name: f"{getattr(eye, name)!r} m" for name in ("radius", "clearance", "port", "shaft_radius")},
    }
    if eye.lens is not None:
        written["lens"] = {
            "centre": _lengths(eye.lens.centre),
            "semi_axes": _lengths(eye.lens.semi_axes),
            "axis": eye.lens.frame[:, 2].tolist(),
            "first_axis": eye.lens.frame[:, 0].tolist(),
        }
    return written


def _lengths(vector: Array) -> list[str]:
    return [f"{length!r} m" for length in vector.tolist()]


def _lens(section: Section, model: Any) -> Lens:
    with located(section):
        return Lens(model.centre, model.semi_axes, _frame(section, model))


def _frame(section: Section, model: Any) -> Array:
    """Columns: the directions of the semi-axes, right-handed."""
    third = _direction(section, model.axis, "axis")
    if model.first_axis is None:
        first, second, _ = model.semi_axes
        if min(first, second) > 0 and not math.isclose(first, second, rel_tol=1e-9):
            raise section.error(
                "missing: the first two semi-axes differ", "first_axis", allowed="the direction of the first semi-axis"
            )
        # any direction will do: the base axis that is farthest from the third
        along = np.eye(3)[int(np.argmin(np.abs(third)))]
    else:
        along = _direction(section, model.first_axis, "first_axis")
        if abs(float(along @ third)) > math.sin(SQUARE):
            angle = math.degrees(math.acos(float(along @ third)))
            raise section.error(f"at {angle:.4g} deg to axis", "first_axis", allowed="a right angle, within 0.5 deg")
    along = along - third * float(along @ third)
    along /= np.linalg.norm(along)
    return np.column_stack((along, np.cross(third, along), third))


def _direction(section: Section, value: tuple[float, ...], name: str) -> Array:
    vector = np.array(value)
    length = float(np.linalg.norm(vector))
    if not 1e-9 < length < np.inf:
        raise section.error("no direction", name, allowed="three numbers that are not all zero; the length is free")
    return vector / length
