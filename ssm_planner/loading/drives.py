"""A drive file → Drive: what it may say, its geometry resolved, the source of each figure beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Field as PydanticField
from pydantic import FiniteFloat, field_validator

from ssm_planner.dynamics.transmission import of_efficiencies
from ssm_planner.errors import ProblemError
from ssm_planner.loading.drive_geometry import BadGeometry, resolve
from ssm_planner.loading.schema import (
    SOURCE,
    Field,
    Figure,
    Model,
    Part,
    Text,
    figure,
    interval,
    located,
    model_from,
    model_of,
    optional,
    quantity,
    reading,
    validated,
    vector,
    wrong,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.drive import (
    PARAMETERS,
    RANGED,
    TURNING,
    WEDGE,
    Drive,
    EfficientKind,
    Friction,
    Ratings,
    Rig,
    ThreadKind,
)
from ssm_planner.problem.posterior import Harmonics, Posterior, Ripple
from ssm_planner.problem.value import Bound, Quantity, bare, hints

TO_IDENTIFY = "to_identify"
LARGEST_MU = 1.5
FLAT = 1e-9
"""Pressure angle of a drive that has efficiencies: its cosine is 1."""
_POSITIVE = Bound(above=0.0)
_Number = Annotated[Figure, figure(quantity("number", _POSITIVE))] | None
_Length = Annotated[Figure, figure(quantity("length", _POSITIVE))] | None
_Angle = Annotated[Figure, figure(quantity("angle", _POSITIVE))]


class WormDimensions(Model):
    """Any set that fixes ratio, both diameters and the lead (drive_geometry.py)."""

    ratio: _Number = None
    """Turns of the worm by those of the wheel."""
    worm_diameter: _Length = None
    """Pitch diameter of the worm."""
    wheel_diameter: _Length = None
    """Pitch diameter of the wheel."""
    lead: _Length = None
    """Advance of the thread in one turn."""
    lead_angle: _Angle | None = None
    """Of the thread at that diameter: tan = lead / (π · diameter)."""
    starts: _Number = None
    """Threads beside each other: lead = starts · pitch."""
    pitch: _Length = None
    """From one thread to the next."""
    thread_angle: _Angle
    """Between the two flanks, in the axial section."""


class ScrewDimensions(Model):
    """Any set that fixes lead and effective diameter (drive_geometry.py)."""

    lead: _Length = None
    """Advance of the thread in one turn."""
    diameter: _Length = None
    """At which friction acts."""
    effective_diameter: _Length = None
    """The same as diameter."""
    lead_angle: _Angle | None = None
    """Of the thread at that diameter: tan = lead / (π · diameter)."""
    starts: _Number = None
    """Threads beside each other: lead = starts · pitch."""
    pitch: _Length = None
    """From one thread to the next."""
    thread_angle: _Angle
    """Between the two flanks, in the axial section."""
    outer_diameter: _Length = None
    """Informational; friction acts at the effective diameter."""


def _numbers(value: Any) -> tuple[float, ...]:
    try:
        found = tuple(float(word) for word in value.split())
    except (AttributeError, ValueError):
        found = ()
    if not found or not all(map(math.isfinite, found)):
        raise wrong("not a row of numbers", "finite numbers in SI, separated by spaces")
    return found


_Numbers = Annotated[
    tuple[float, ...], Field(_numbers, {"type": "string"}, allowed="a row of numbers, SI")
]
RippleModel = model_from(dict.fromkeys(hints(Ripple), (_Numbers, ...)), of=(Ripple,))

HarmonicsModel = model_from(
    dict.fromkeys(("orders", "cosine", "sine"), (_Numbers, ...)) | {"phased": (bool, ...)},
    of=(Harmonics,),
)


class PosteriorModel(Model):
    """What an identification leaves open, SI; see posterior.Posterior."""

    scatter: Annotated[float, quantity("torque", Bound(at_least=0.0))]
    """Of the mean torque from one recording to the next."""
    common: float = 0.0
    """Share of its variance that recordings of near speed have in common."""
    speeds: _Numbers = ()
    """Motor speeds of the recordings."""
    departures: _Numbers = ()
    """Their mean torque beyond the law's."""
    forwards: Annotated[Any, Part(RippleModel)] | None = None
    """Ripple and noise in positive motion."""
    backwards: Annotated[Any, Part(RippleModel)] | None = None
    """Ripple and noise in negative motion."""
    harmonics_forwards: Annotated[Any, Part(HarmonicsModel)] | None = None
    """What of the ripple repeats with the motor's angle in positive motion."""
    harmonics_backwards: Annotated[Any, Part(HarmonicsModel)] | None = None
    """The same in negative motion."""
    draws: dict[str, _Numbers] = PydanticField(min_length=1)
    """Equally likely values of each parameter."""


class _DriveModel(Model):
    @field_validator("friction", mode="before", check_fields=False)
    @classmethod
    def _friction(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value != TO_IDENTIFY:
                raise wrong("not a friction", f"{TO_IDENTIFY}, or a mapping with mu, b_c, b_v …")
            return None
        return value


def _part(model: Any) -> Any:
    """A part that may be left out."""
    return Annotated[Any, Part(model)] | None, None


def _range(name: str, slides: bool) -> Any:
    """What lubrication, temperature and wear may make of a parameter of the friction."""
    (of,) = (mark for mark in bare(hints(Friction)[name])[1] if isinstance(mark, Quantity))
    kind = of.kind(slides)
    # the bounds of a bare number may be equal
    return Annotated[Any, vector(kind, kind) if kind == "number" else interval(kind)] | None, None


_OF_FRICTION = f"Of mesh and bearings; {TO_IDENTIFY!r} where the drive stands on a rig and it is still to be found."


def _drive(kind: str) -> Any:
    """What the file of a kind of drive may say."""
    slides, has_nuts = kind != "worm", kind == "antibacklash_screw"
    friction = {
        "mu_static": (reading(Friction, "mu_static", figures=True) | None, None),
        "covariance": (dict[str, dict[str, FiniteFloat]] | None, None),
        "posterior": (PosteriorModel | None, None),
    }
    # of the output side, a length or shape of the screw alone
    ratings = () if slides else ("free_length", "root_diameter", "ends")
    ranges = {"source": (Text, ...), **{name: _range(name, slides) for name in RANGED}}
    published = {name: reading(Friction, name, slides, figures=True) for name in PARAMETERS}
    given = {name: (hint | None, None) for name, hint in published.items()}
    given["preload"] = optional(reading(Drive, "preload", figures=True))
    rig = {
        "payload_direction": (Literal["positive", "negative"], "positive"),
        "published": _part(model_from({**given, "source": SOURCE}, of=(Drive, Friction))),
        "source": SOURCE,
    }
    if not slides:
        rig["payload_arm"] = Annotated[Any, quantity("length", _POSITIVE)], ...
    more = {
        "kind": (Literal[kind], ...),
        "source": SOURCE,
        "geometry": (
            ScrewDimensions if slides else WormDimensions,
            PydanticField(description="Dimensions of the thread."),
        ),
        "self_locking": (Literal["required", "not required"], "required"),
        "friction": (
            Annotated[Any, Part(model_of(Friction, friction, slides=slides, figures=True))] | None,
            PydanticField(None, description=_OF_FRICTION, json_schema_extra=_may_be_identified),
        ),
        "friction_ranges": _part(model_from(ranges, of=(Friction,))),
        "ratings": _part(
            model_of(Ratings, {"source": SOURCE}, slides=slides, figures=True, without=ratings)
        ),
        "rig": _part(model_of(Rig, rig, slides=slides, without=("payload_arm",))),
    }
    if has_nuts:
        more["preload"] = Annotated[Figure, figure(quantity("force", _POSITIVE))], ...
        more["second_nut_mass"] = (
            Annotated[Figure, figure(quantity("mass", Bound(at_least=0.0)))],
            ...,
        )
    without = () if has_nuts else ("preload", "second_nut_mass")
    return model_of(Drive, more, slides=slides, figures=True, without=without, base=_DriveModel)


class RatioDimensions(Model):
    """Of a gear, belt or cable whose output turns."""

    ratio: Annotated[Figure, figure(quantity("number", _POSITIVE))]
    """Turns of the motor by those of the output."""


class LeadDimensions(Model):
    """Of a ball screw."""

    lead: Annotated[Figure, figure(quantity("length", _POSITIVE))]
    """Advance of the nut in one turn."""


class PulleyDimensions(Model):
    """Of a belt or cable that pulls a slide."""

    pulley_diameter: Annotated[Figure, figure(quantity("length", _POSITIVE))]
    """At which the belt or cable runs."""
    ratio: Annotated[Figure, figure(quantity("number", _POSITIVE))] | None = None
    """Turns of the motor by those of the pulley; 1 unless given."""


_GEOMETRY: dict[str, type[Model]] = {
    "gear": RatioDimensions,
    "belt": RatioDimensions,
    "cable": RatioDimensions,
    "ball_screw": LeadDimensions,
}
_GEOMETRY |= {"cable_slide": PulleyDimensions}
_SHARE = Annotated[Figure, figure(quantity("number", Bound(above=0.0, at_most=1.0)))]
_MESH = (
    "mu",
    "mu_static",
    "law",
    "mu_stribeck",
    "stribeck_speed",
    "dwell_constant",
    "mu_lowest",
    "covariance",
    "posterior",
)


def _efficient(kind: str) -> Any:
    """What the file of a kind of drive that has efficiencies may say."""
    slides = kind not in TURNING
    ratings = () if slides else ("free_length", "root_diameter", "ends")
    friction = {
        name: optional(reading(Friction, name, slides, figures=True)) for name in ("b_c", "b_v")
    }
    if kind != "direct":
        friction["efficiency"] = optional(
            _SHARE, "Output by input power while the motor drives; 1 unless given."
        )
        friction["backward_efficiency"] = optional(
            _SHARE, "The same while the load drives; by default as forwards."
        )
    model = model_of(Friction, friction, slides=slides, figures=True, without=_MESH)
    more = {
        "kind": (Literal[kind], ...),
        "source": SOURCE,
        "friction": (
            Annotated[Any, Part(model)] | None,
            PydanticField(None, description="None unless given."),
        ),
        "ratings": _part(
            model_of(Ratings, {"source": SOURCE}, slides=slides, figures=True, without=ratings)
        ),
    }
    if kind != "direct":
        more["geometry"] = (
            _GEOMETRY[kind],
            PydanticField(description="From the motor to the output."),
        )
    without = ("preload", "second_nut_mass", "self_locking", "friction_ranges", "rig")
    return model_of(Drive, more, slides=slides, figures=True, without=without)


def _with_efficiencies(section: Section, model: Any) -> Drive:
    """A drive that has efficiencies in the place of a thread. Raises ProblemError."""
    geometry = getattr(model, "geometry", None)
    dimensions = (
        {} if geometry is None else {name: each.value for name, each in geometry.figures().items()}
    )
    ratio = dimensions.get("ratio", 1.0)
    if "lead" in dimensions:
        ratio = 2 * math.pi / dimensions["lead"]
    elif "pulley_diameter" in dimensions:
        ratio *= 2 / dimensions["pulley_diameter"]
    given = {} if model.friction is None else model.friction.figures()
    values: dict[str, Any] = {name: each.value for name, each in given.items()}
    forwards = values.pop("efficiency", 1.0)
    backwards = values.pop("backward_efficiency", forwards)
    gamma, mu = of_efficiencies(ratio, forwards, backwards)
    sources, placeholders = _origins(model)
    with located(section.sub("ratings")):
        ratings = None if model.ratings is None else Ratings(**_values(model.ratings))
    with located(section):
        return Drive(
            name=model.name,
            kind=model.kind,
            ratio=ratio,
            gamma=gamma,
            lead_angle=WEDGE,
            pressure_angle=FLAT,
            input_inertia=model.input_inertia.value,
            output_inertia=model.output_inertia.value,
            friction=Friction(**{"b_c": 0.0, "b_v": 0.0, **values, "mu": mu, "mu_static": mu}),
            self_locking=False,
            dimensions={**dimensions, "efficiency": forwards, "backward_efficiency": backwards},
            sources=sources,
            placeholders=placeholders,
            file=section.file_name,
            ratings=ratings,
        )


def _may_be_identified(schema: dict[str, Any]) -> None:
    schema["anyOf"].append({"const": TO_IDENTIFY})


KINDS: tuple[str, ...] = (*get_args(ThreadKind), *get_args(EfficientKind))
"""Of drives that a file may describe."""


@cache
def drive_model(kind: str) -> Any:
    """The model of a drive file of one of KINDS: made when it is asked for, which takes a while."""
    return _drive(kind) if kind in get_args(ThreadKind) else _efficient(kind)


def drive_from(section: Section) -> Drive:
    """The drive that a section describes. Raises ProblemError."""
    kind = section.value.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        reason = (
            "missing: this key is required" if kind is None else "not a kind of drive known here"
        )
        raise section.error(reason, "kind", allowed=", ".join(KINDS))
    model: Any = validated(section, drive_model(kind))
    if kind in get_args(EfficientKind):
        return _with_efficiencies(section, model)
    dimensions = _dimensions(section, model)
    lead_angle, thread_angle = dimensions["lead_angle"], dimensions["thread_angle"]
    given = {name: figure.value for name, figure in model.figures().items()}
    sources, placeholders = _origins(model)
    friction = (
        None if model.friction is None else _friction(section.sub("friction"), model.friction)
    )
    with located(section.sub("ratings")):
        ratings = None if model.ratings is None else Ratings(**_values(model.ratings))
    ranges = {} if model.friction_ranges is None else dict(model.friction_ranges)
    with located(section):
        drive = Drive(
            name=model.name,
            kind=model.kind,
            ratio=dimensions["ratio"],
            gamma=dimensions["diameter"] / 2
            if kind != "worm"
            else dimensions["worm_diameter"] / dimensions["wheel_diameter"],
            lead_angle=lead_angle,
            pressure_angle=math.atan(math.tan(thread_angle / 2) * math.cos(lead_angle)),
            friction=friction,
            self_locking=model.self_locking == "required",
            dimensions=dimensions,
            sources=sources,
            placeholders=placeholders,
            rig=None if model.rig is None else _rig(model.rig),
            file=section.file_name,
            ratings=ratings,
            friction_ranges={
                name: ends for name, ends in ranges.items() if name != "source" and ends is not None
            },
            **given,
        )
        drive.check_locking()
    return drive


def _values(model: Model) -> dict[str, Any]:
    """What a model of figures holds, by the fields of its value."""
    given = {
        name: each.value if isinstance(each, Figure) else each
        for name, each in model
        if each is not None
    }
    return {name: value for name, value in given.items() if name in hints(model.of[-1])}


def _dimensions(section: Section, model: Any) -> dict[str, float]:
    given = {name: figure.value for name, figure in model.geometry.figures().items()}
    thread_angle = given.pop("thread_angle")
    outer = given.pop("outer_diameter", None)
    if not thread_angle < math.radians(120):
        raise section.error(
            "implausible", "geometry", "thread_angle", allowed="an angle below 120 deg"
        )
    try:
        dimensions = resolve("worm" if model.kind == "worm" else "screw", given)
    except BadGeometry as error:
        path = ("geometry",) if error.key is None else ("geometry", error.key)
        raise section.error(str(error), *path, show=error.key is not None) from None
    if outer is not None:
        if outer < dimensions["diameter"]:
            raise section.error(
                "smaller than the diameter at which friction acts", "geometry", "outer_diameter"
            )
        dimensions["outer_diameter"] = outer
    return {**dimensions, "thread_angle": thread_angle}


def _friction(section: Section, model: Any) -> Friction:
    values = _values(model)
    values.setdefault("mu_static", values["mu"])
    for name in ("mu", "mu_static"):
        if values[name] > LARGEST_MU:
            raise section.error(
                "implausible for a coefficient of friction", name, allowed=f"0 to {LARGEST_MU}"
            )
    if model.law != "coulomb" and not {"mu_stribeck", "stribeck_speed"} <= values.keys():
        raise section.error(f"the law {model.law} needs mu_stribeck and stribeck_speed", "law")
    with located(section):
        if model.posterior is not None:
            values["posterior"] = _posterior(model.posterior)
        return Friction(**values)


def _posterior(model: PosteriorModel) -> Posterior:
    if len({len(column) for column in model.draws.values()}) != 1:
        raise ProblemError(
            "columns of different lengths",
            key="posterior.draws",
            allowed="as many sets of each parameter",
        )
    given = {"forwards": model.forwards, "backwards": model.backwards}
    own: dict[str, Any] = {
        way: Ripple(**dict(ripple)) for way, ripple in given.items() if ripple is not None
    }
    waves = {f"harmonics_{way}": getattr(model, f"harmonics_{way}") for way in given}
    own |= {way: Harmonics(**dict(found)) for way, found in waves.items() if found is not None}
    draws = np.column_stack(list(model.draws.values()))
    own |= {name: getattr(model, name) for name in ("scatter", "common", "speeds", "departures")}
    return Posterior(names=tuple(model.draws), draws=draws, **own)


def _rig(model: Any) -> Rig:
    published = (
        {}
        if model.published is None
        else {name: f.value for name, f in model.published.figures().items()}
    )
    direction = 1 if model.payload_direction == "positive" else -1
    return Rig(**{**_values(model), "payload_direction": direction, "published": published})


def _origins(model: Any) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Source of each figure, and the names of those that are placeholders."""
    figures: dict[str, Figure] = {}
    sources: dict[str, str] = {}
    for part in (model, getattr(model, "geometry", None), model.friction, model.ratings):
        if part is not None:
            origin = getattr(part, "source", None) or model.source
            figures |= part.figures()
            sources |= {} if origin is None else dict.fromkeys(part.figures(), origin)
    if getattr(model, "friction_ranges", None) is not None:
        sources["friction_ranges"] = model.friction_ranges.source
    sources |= {
        name: figure.source for name, figure in figures.items() if figure.source is not None
    }
    return sources, tuple(name for name, figure in figures.items() if figure.placeholder)
