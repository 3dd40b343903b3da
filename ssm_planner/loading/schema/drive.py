"""Schema of a drive file: one model per kind of drive."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field as PydanticField
from pydantic import FiniteFloat, field_validator

from ssm_planner.loading.schema.common import (
    Field,
    Figure,
    Model,
    Part,
    Text,
    figure,
    interval,
    model_of,
    of,
    quantity,
    wrong,
)
from ssm_planner.problem.drive import Drive, Friction, FrictionLawName, Ratings, Rig, ScrewEnds
from ssm_planner.problem.value import Sign

Number = Annotated[Figure, figure("number", above=0)]
Length = Annotated[Figure, figure("length", above=0)]
Angle = Annotated[Figure, figure("angle", above=0)]
Preload = Annotated[Figure, figure("force", above=0)]
Torque = Annotated[Figure, figure("torque", at_least=0)]
Mass = Annotated[Figure, figure("mass", at_least=0)]
Inertia = Annotated[Figure, figure("inertia", at_least=0)]
Interval = tuple[float, float]

TO_IDENTIFY = "to_identify"


def _may_be_identified(schema: dict[str, Any]) -> None:
    schema["anyOf"].append({"const": TO_IDENTIFY})


_FRICTION: Any = PydanticField(default=None, json_schema_extra=_may_be_identified)


class WormGeometry(Model):
    """Any set that fixes ratio, both diameters and the lead (drive_geometry.py)."""

    ratio: Number | None = None
    worm_diameter: Length | None = None
    wheel_diameter: Length | None = None
    lead: Length | None = None
    lead_angle: Angle | None = None
    starts: Number | None = None
    pitch: Length | None = None
    thread_angle: Angle


class ScrewGeometry(Model):
    """Any set that fixes lead and effective diameter (drive_geometry.py)."""

    lead: Length | None = None
    diameter: Length | None = None
    effective_diameter: Length | None = None
    lead_angle: Angle | None = None
    starts: Number | None = None
    pitch: Length | None = None
    thread_angle: Angle
    outer_diameter: Length | None = None
    """Informational; friction acts at the effective diameter."""


def _numbers(value: Any) -> tuple[float, ...]:
    try:
        found = tuple(float(word) for word in value.split())
    except (AttributeError, ValueError):
        found = ()
    if not found or not all(map(math.isfinite, found)):
        raise wrong("not a row of numbers", "finite numbers in SI, separated by spaces")
    return found


Numbers = Annotated[tuple[float, ...], Field(_numbers, {"type": "string"})]


class RippleModel(Model):
    """Torque about its mean in steady motion, N·m: an entry per recording; see posterior.Ripple."""

    torque: Numbers
    ripple: Numbers
    noise: Numbers
    peak: Numbers


class PosteriorModel(Model):
    """What an identification leaves open, SI; see posterior.Posterior."""

    scatter: Annotated[float, quantity("torque", at_least=0)]
    forwards: RippleModel | None = None
    backwards: RippleModel | None = None
    draws: dict[str, Numbers] = PydanticField(min_length=1)
    """Equally likely values of each parameter."""


_SOURCE: Any = (Text | None, None)
_OUTPUT = {
    "worm": {"b_oc": "torque", "b_ov": "rotary_viscosity"},
    "screw": {"b_oc": "force", "b_ov": "linear_viscosity"},
}
"""Kinds of quantity of the output side by family."""
_PUBLISHED = {
    "mu": "number",
    "mu_static": "number",
    "mu_stribeck": "number",
    "stribeck_speed": "motor_speed",
    "b_c": "torque",
    "b_v": "rotary_viscosity",
    "dwell_constant": "time",
    "memory": "time",
}


def _optional(cls: Any, name: str, kind: str) -> Any:
    """A figure that may be left out of a file."""
    return Annotated[Any, of(cls, name, kind, figures=True)] | None, None


def _friction(family: str) -> Any:
    fields = {
        "law": (FrictionLawName, "coulomb"),
        **_PUBLISHED,
        "mu_static": _optional(Friction, "mu_static", "number"),
        "mu_lowest": "number",
        "identified_speed": "motor_speed",
        **_OUTPUT[family],
        "covariance": (dict[str, dict[str, FiniteFloat]] | None, None),
        "posterior": (PosteriorModel | None, None),
        "source": _SOURCE,
    }
    return model_of(Friction, fields, figures=True)


WormFriction, ScrewFriction = _friction("worm"), _friction("screw")


class FrictionRanges(Model):
    """What lubrication, temperature and wear may make of the friction; see problem/drive.Drive."""

    source: Text
    mu: tuple[FiniteFloat, FiniteFloat] | None = None
    mu_static: tuple[FiniteFloat, FiniteFloat] | None = None
    b_c: Annotated[Interval, interval("torque")] | None = None
    b_v: Annotated[Interval, interval("rotary_viscosity")] | None = None


class WormFrictionRanges(FrictionRanges):
    b_oc: Annotated[Interval, interval("torque")] | None = None
    b_ov: Annotated[Interval, interval("rotary_viscosity")] | None = None


class ScrewFrictionRanges(FrictionRanges):
    b_oc: Annotated[Interval, interval("force")] | None = None
    b_ov: Annotated[Interval, interval("linear_viscosity")] | None = None


def _ratings(effort: str, **more: Any) -> Any:
    kinds = {"continuous_output": effort, "peak_output": effort, "input_speed": "motor_speed", "duty": "number"}
    return model_of(Ratings, {"source": _SOURCE, **kinds, **more}, figures=True)


WormRatings = _ratings("torque")
ScrewRatings = _ratings("force", free_length="length", root_diameter="length", ends=(ScrewEnds | None, None))


def _rig(family: str, **more: Any) -> Any:
    kinds = {**_PUBLISHED, **_OUTPUT[family]}
    published = {name: _optional(Friction, name, kind) for name, kind in kinds.items()}
    published |= {"preload": _optional(Drive, "preload", "force"), "source": _SOURCE}
    fields = {
        "payload_mass": "mass",
        "payload_direction": (Literal["positive", "negative"], "positive"),
        "gravity": "acceleration",
        "motor_nominal_torque": "torque",
        "direction": (Sign, 1),
        "load_offset": _OUTPUT[family]["b_oc"],
        "published": (model_of(Friction, published) | None, None),
        "source": _SOURCE,
    }
    return model_of(Rig, {**fields, **more})


WormRig = _rig("worm", payload_arm=(Annotated[float, of(Rig, "payload_arm", "length")], ...))
ScrewRig = _rig("screw")


class DriveModel(Model):
    """What all drive files have in common; see problem/drive.Drive."""

    name: Text
    input_inertia: Inertia
    self_locking: Literal["required", "not required"] = "required"
    source: Text | None = None

    @field_validator("friction", mode="before", check_fields=False)
    @classmethod
    def _friction(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value != TO_IDENTIFY:
                raise wrong("not a friction", f"{TO_IDENTIFY}, or a mapping with mu, b_c, b_v …")
            return None
        return value


class WormModel(DriveModel):
    kind: Literal["worm"]
    geometry: WormGeometry
    output_inertia: Inertia
    friction: Annotated[Any, Part(WormFriction)] | None = _FRICTION
    friction_ranges: WormFrictionRanges | None = None
    ratings: Annotated[Any, Part(WormRatings)] | None = None
    rig: Annotated[Any, Part(WormRig)] | None = None


class LeadScrewModel(DriveModel):
    kind: Literal["lead_screw"]
    geometry: ScrewGeometry
    output_inertia: Mass
    friction: Annotated[Any, Part(ScrewFriction)] | None = _FRICTION
    friction_ranges: ScrewFrictionRanges | None = None
    ratings: Annotated[Any, Part(ScrewRatings)] | None = None
    rig: Annotated[Any, Part(ScrewRig)] | None = None


class AntibacklashScrewModel(DriveModel):
    kind: Literal["antibacklash_screw"]
    geometry: ScrewGeometry
    output_inertia: Mass
    friction: Annotated[Any, Part(ScrewFriction)] | None = _FRICTION
    friction_ranges: ScrewFrictionRanges | None = None
    ratings: Annotated[Any, Part(ScrewRatings)] | None = None
    preload: Preload
    second_nut_mass: Mass
    rig: Annotated[Any, Part(ScrewRig)] | None = None


DRIVES: dict[str, type[WormModel] | type[LeadScrewModel] | type[AntibacklashScrewModel]] = {
    "worm": WormModel,
    "lead_screw": LeadScrewModel,
    "antibacklash_screw": AntibacklashScrewModel,
}
"""The model of a drive file by its kind."""
