"""Schema of a drive file: one model per kind of drive."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field as PydanticField
from pydantic import FiniteFloat, field_validator

from ssm_planner.loading.schema.common import Field, Figure, Model, Text, figure, interval, quantity, wrong

Number = Annotated[Figure, figure("number", above=0)]
Coefficient = Annotated[Figure, figure("number", at_least=0)]
Length = Annotated[Figure, figure("length", above=0)]
Angle = Annotated[Figure, figure("angle", above=0)]
Force = Annotated[Figure, figure("force", at_least=0)]
Preload = Annotated[Figure, figure("force", above=0)]
Torque = Annotated[Figure, figure("torque", at_least=0)]
Mass = Annotated[Figure, figure("mass", at_least=0)]
Inertia = Annotated[Figure, figure("inertia", at_least=0)]
Time = Annotated[Figure, figure("time", at_least=0)]
MotorSpeed = Annotated[Figure, figure("motor_speed", above=0)]
RotaryViscosity = Annotated[Figure, figure("rotary_viscosity", at_least=0)]
LinearViscosity = Annotated[Figure, figure("linear_viscosity", at_least=0)]
Share = Annotated[Figure, figure("number", above=0)]
RatedForce = Annotated[Figure, figure("force", above=0)]
RatedTorque = Annotated[Figure, figure("torque", above=0)]
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


class FrictionModel(Model):
    """What friction has in common for all drives; see values.Friction."""

    law: Literal["coulomb", "stribeck_exponential", "stribeck_gaussian"] = "coulomb"
    mu: Coefficient
    mu_static: Coefficient | None = None
    mu_lowest: Coefficient | None = None
    mu_stribeck: Coefficient | None = None
    stribeck_speed: MotorSpeed | None = None
    b_c: Torque
    b_v: RotaryViscosity
    dwell_constant: Time | None = None
    memory: Time | None = None
    identified_speed: MotorSpeed | None = None
    covariance: dict[str, dict[str, FiniteFloat]] | None = None
    posterior: PosteriorModel | None = None
    source: Text | None = None


class WormFriction(FrictionModel):
    b_oc: Torque | None = None
    b_ov: RotaryViscosity | None = None


class ScrewFriction(FrictionModel):
    b_oc: Force | None = None
    b_ov: LinearViscosity | None = None


class FrictionRanges(Model):
    """What lubrication, temperature and wear may make of the friction; see values.Drive."""

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


class RatingsModel(Model):
    """What the manufacturer allows; see values.Ratings."""

    source: Text | None = None
    input_speed: MotorSpeed | None = None
    duty: Share | None = None


class WormRatings(RatingsModel):
    continuous_output: RatedTorque | None = None
    peak_output: RatedTorque | None = None


class ScrewRatings(RatingsModel):
    continuous_output: RatedForce | None = None
    peak_output: RatedForce | None = None
    free_length: Length | None = None
    root_diameter: Length | None = None
    ends: Literal["fixed-free", "supported-supported", "fixed-supported", "fixed-fixed"] | None = None


class Published(Model):
    """Parameters as others published them, for comparison."""

    source: Text | None = None
    mu: Coefficient | None = None
    mu_static: Coefficient | None = None
    mu_stribeck: Coefficient | None = None
    stribeck_speed: MotorSpeed | None = None
    b_c: Torque | None = None
    b_v: RotaryViscosity | None = None
    dwell_constant: Time | None = None
    memory: Time | None = None
    preload: Force | None = None


class WormPublished(Published):
    b_oc: Torque | None = None
    b_ov: RotaryViscosity | None = None


class ScrewPublished(Published):
    b_oc: Force | None = None
    b_ov: LinearViscosity | None = None


class RigModel(Model):
    """See rig.Rig."""

    payload_mass: Annotated[float, quantity("mass", at_least=0)]
    payload_direction: Literal["positive", "negative"] = "positive"
    gravity: Annotated[float, quantity("acceleration", above=0)] = 9.81
    motor_nominal_torque: Annotated[float, quantity("torque", above=0)]
    direction: Literal[-1, 1] = 1
    source: Text | None = None


class WormRig(RigModel):
    payload_arm: Annotated[float, quantity("length", above=0)]
    load_offset: Annotated[float, quantity("torque")] = 0.0
    published: WormPublished | None = None


class ScrewRig(RigModel):
    load_offset: Annotated[float, quantity("force")] = 0.0
    published: ScrewPublished | None = None


class DriveModel(Model):
    """What all drive files have in common; see values.Drive."""

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
    friction: WormFriction | None = _FRICTION
    friction_ranges: WormFrictionRanges | None = None
    ratings: WormRatings | None = None
    rig: WormRig | None = None


class LeadScrewModel(DriveModel):
    kind: Literal["lead_screw"]
    geometry: ScrewGeometry
    output_inertia: Mass
    friction: ScrewFriction | None = _FRICTION
    friction_ranges: ScrewFrictionRanges | None = None
    ratings: ScrewRatings | None = None
    rig: ScrewRig | None = None


class AntibacklashScrewModel(DriveModel):
    kind: Literal["antibacklash_screw"]
    geometry: ScrewGeometry
    output_inertia: Mass
    friction: ScrewFriction | None = _FRICTION
    friction_ranges: ScrewFrictionRanges | None = None
    ratings: ScrewRatings | None = None
    preload: Preload
    second_nut_mass: Mass
    rig: ScrewRig | None = None


DRIVES: dict[str, type[WormModel] | type[LeadScrewModel] | type[AntibacklashScrewModel]] = {
    "worm": WormModel,
    "lead_screw": LeadScrewModel,
    "antibacklash_screw": AntibacklashScrewModel,
}
"""The model of a drive file by its kind."""
