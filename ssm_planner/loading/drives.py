"""Read drive files, complete the geometry of the gear, and record the source of each figure."""

import math
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field as PydanticField
from pydantic import FiniteFloat, field_validator

from ssm_planner.dynamics import of_efficiencies
from ssm_planner.errors import ProblemError
from ssm_planner.loading.motors import check_rule
from ssm_planner.loading.schema import (
    POSITIVE,
    SOURCE,
    Field,
    Figure,
    Model,
    Text,
    interval,
    located,
    model_from,
    model_of,
    nested,
    optional,
    positive,
    quantity,
    reading,
    required,
    sourced_field,
    validated,
    vector,
    wrong,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.package_table import package_table
from ssm_planner.problem import (
    PARAMETERS,
    RANGED,
    TRANSMISSIONS,
    WEDGE,
    BadGeometry,
    Bound,
    Drive,
    Friction,
    Gearhead,
    Harmonics,
    Posterior,
    Ratings,
    Reaction,
    Rig,
    Ripple,
    Transmission,
    hints,
    quantities,
    unit_kind,
)
from ssm_planner.typing import JsonObject, Keywords, Numbers

TO_IDENTIFY = "to_identify"
LARGEST_MU = 1.5
ZERO_PRESSURE_ANGLE = 1e-9
"""Pressure angle in rad that represents a drive with efficiencies. Its cosine is 1."""


def _numbers(value: Any) -> tuple[float, ...]:
    """Read a text of finite numbers in SI units that are separated by spaces."""
    try:
        numbers = tuple(float(text) for text in value.split())
    except (AttributeError, ValueError):
        numbers = ()
    if not numbers or not all(map(math.isfinite, numbers)):
        raise wrong("expected a row of numbers", "finite numbers in SI, separated by spaces")
    return numbers


_Numbers = Annotated[
    tuple[float, ...], Field(_numbers, {"type": "string"}, allowed="a row of numbers, SI")
]

PART_TYPES = {
    "forwards": Ripple,
    "backwards": Ripple,
    "harmonics_forwards": Harmonics,
    "harmonics_backwards": Harmonics,
    "reaction": Reaction,
}
"""Parts of a posterior, which may be None."""
_PART_MODELS: dict[type, Any] = {
    part: nested(
        model_from(
            {name: (bool if hint is bool else _Numbers, ...) for name, hint in hints(part).items()},
            value_types=(part,),
        )
    )
    for part in (Ripple, Harmonics, Reaction)
}
PosteriorModel = model_of(
    Posterior,
    {
        "scatter": (Annotated[float, quantity("torque", Bound(at_least=0.0))], ...),
        "common": (float, 0.0),
        **dict.fromkeys(("speeds", "departures"), (_Numbers, ())),
        **{name: optional(_PART_MODELS[part_of]) for name, part_of in PART_TYPES.items()},
        "draws": (
            dict[str, _Numbers],
            PydanticField(min_length=1, description="Equally likely values of each parameter."),
        ),
    },
)


class _ThreadModel(Model):
    """Base of the models of worms and screws, whose friction may still have to be identified."""

    @field_validator("friction", mode="before", check_fields=False)
    @classmethod
    def _friction(cls, value: Any) -> Any:
        """Convert the text "to_identify" to None, and reject any other text."""
        if isinstance(value, str):
            if value != TO_IDENTIFY:
                raise wrong("invalid friction", f"{TO_IDENTIFY}, or a mapping with mu, b_c, b_v …")
            return None
        return value


def _range(name: str, slides: bool) -> Any:
    """Return the type and default of the range of a friction parameter.

    The range covers lubrication, temperature and wear. It is in the units of a prismatic joint if
    `slides` is true.
    """
    quantity_kind = unit_kind(quantities(Friction)[name], slides)
    # the bounds of a dimensionless number may be equal
    return optional(
        Annotated[
            Any,
            vector("number", "number") if quantity_kind == "number" else interval(quantity_kind),
        ]
    )


SCREW_RATINGS = ("free_length", "root_diameter", "ends")
"""Ratings that only a drive with a linear output has."""
GEARHEAD_RULES = package_table(Path(__file__).with_name("gearheads.csv"))
"""Ranges of the figures of gear stages in SI units, in the form of `motors.RULES`."""
THREAD_FIELDS = ("self_locking", "friction_ranges", "rig")
"""Fields that only a worm or screw has."""
ANTIBACKLASH_FIELDS = ("preload", "second_nut_mass")
"""Fields that only an antibacklash screw has."""
MESH_PARAMETERS = (
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
"""Fields of Friction that only a drive with a thread has."""
_SHARE = Annotated[Figure, sourced_field(quantity("number", Bound(above=0.0, at_most=1.0)))]


@cache
def drive_model(drive_kind: str) -> Any:
    """Return the model of the drive files of one kind, which is a name in `TRANSMISSIONS`.

    The model is built on first use because building it is slow.
    """
    kind: Any = TRANSMISSIONS.find(drive_kind)
    slides = kind.slides
    keys = {
        "kind": (Literal[drive_kind], ...),
        "source": SOURCE,
        "ratings": optional(nested(_ratings_model(slides))),
        "gearhead": optional(nested(gearhead_model())),
        "belt": optional(nested(gearhead_model())),
    }
    if hints(kind):
        geometry = model_of(kind, sourced=True)
        geometry.__doc__ = kind.__doc__
        keys["geometry"] = required(nested(geometry), "Dimensions of the transmission.")
    keys |= _thread_keys(slides) if kind.threaded else _efficiency_keys(kind)
    without: tuple[str, ...] = () if kind.threaded else THREAD_FIELDS
    if kind.two_nuts:
        keys["preload"] = Annotated[Figure, sourced_field(quantity("force", POSITIVE))], ...
        keys["second_nut_mass"] = reading(Drive, "second_nut_mass", slides, sourced=True), ...
    else:
        without += ANTIBACKLASH_FIELDS
    base = _ThreadModel if kind.threaded else Model
    return model_of(Drive, keys, slides=slides, sourced=True, without=without, base=base)


def _ratings_model(slides: bool) -> Any:
    """Return the model of the ratings of a drive with a rotary or a linear output (`slides`)."""
    without = () if slides else SCREW_RATINGS
    return model_of(Ratings, {"source": SOURCE}, slides=slides, sourced=True, without=without)


@cache
def gearhead_model() -> Any:
    """Return the model of a gear stage between motor and drive."""
    return model_of(Gearhead, {"ratings": optional(nested(_ratings_model(slides=False)))})


def gearhead_from(section: Section, model: Any = None) -> Gearhead:
    """Build the gear stage that a section describes. Raises ProblemError if a value is invalid."""
    fields = dict(model or validated(section, gearhead_model()))
    figures = {name: math.nan if fields[name] is None else fields[name] for name in fields}
    with located(section.sub("ratings")):
        if fields["ratings"] is not None:
            ratings = _values(fields["ratings"])
            fields["ratings"] = Ratings(**ratings)
            figures |= {f"ratings.{name}": value for name, value in ratings.items()}
    for rule in GEARHEAD_RULES:
        check_rule(section, defaultdict(lambda: math.nan, figures), rule)
    with located(section):
        return Gearhead(**fields)


def _thread_keys(slides: bool) -> Keywords:
    """Return the keys of a file of a worm or screw that are not simply fields of Drive.

    Each key has a pair of type and default. The units are those of a prismatic joint if `slides` is
    true.
    """
    friction = {
        "mu_static": optional(reading(Friction, "mu_static", sourced=True)),
        "covariance": optional(dict[str, dict[str, FiniteFloat]]),
        "posterior": optional(nested(PosteriorModel)),
    }
    ranges = {"source": (Text, ...), **{name: _range(name, slides) for name in RANGED}}
    published = {
        name: optional(reading(Friction, name, slides, sourced=True)) for name in PARAMETERS
    }
    published["preload"] = optional(reading(Drive, "preload", sourced=True))
    rig = {
        "payload_direction": (Literal["positive", "negative"], "positive"),
        "published": optional(
            nested(model_from({**published, "source": SOURCE}, value_types=(Drive, Friction)))
        ),
        "source": SOURCE,
    }
    if not slides:
        rig["payload_arm"] = positive("length"), ...
    friction_model = model_of(Friction, friction, slides=slides, sourced=True)
    return {
        "self_locking": (Literal["required", "not required"], "required"),
        "friction": (
            nested(friction_model) | None,
            PydanticField(None, description=_FRICTION_TEXT, json_schema_extra=_add_to_identify),
        ),
        "friction_ranges": optional(nested(model_from(ranges, value_types=(Friction,)))),
        "rig": optional(nested(model_of(Rig, rig, slides=slides, without=("payload_arm",)))),
    }


_FRICTION_TEXT = f"Friction of mesh and bearings. {TO_IDENTIFY!r} is allowed for a drive on a rig."


def _efficiency_keys(kind: Any) -> Keywords:
    """Return the keys of a file of a drive with efficiencies that are not simply fields of Drive.

    Each key has a pair of type and default.
    """
    friction = {name: optional(reading(Friction, name, sourced=True)) for name in ("b_c", "b_v")}
    if hints(kind):
        friction["efficiency"] = optional(
            _SHARE, "Ratio of output to input power while the motor drives. The default is 1."
        )
        friction["backward_efficiency"] = optional(
            _SHARE, "Ratio of output to input power while the load drives. The default is forwards."
        )
    model = model_of(Friction, friction, slides=kind.slides, sourced=True, without=MESH_PARAMETERS)
    return {"friction": optional(nested(model), "Friction, none by default.")}


def _add_to_identify(schema: JsonObject) -> None:
    """Add the text "to_identify" to the values that a JSON schema allows."""
    schema["anyOf"].append({"const": TO_IDENTIFY})


def drive_from(section: Section) -> Drive:
    """Build the drive that a section describes. Raises ProblemError if a value is invalid."""
    with located(section):
        kind = TRANSMISSIONS.find(section.value.get("kind"), "Drive.kind")
    model: Any = validated(section, drive_model(kind.name))
    dimensions = _dimensions(section, model, kind)
    fields = (_thread_fields if kind.threaded else _efficiency_fields)(
        section, model, kind, dimensions
    )
    sources, placeholders = _origins(model)
    for name in ("gearhead", "belt"):
        if getattr(model, name) is not None:
            fields[name] = stage = gearhead_from(section.sub(name), getattr(model, name))
            fields["ratio"] *= stage.ratio
            placeholders += (name,) * stage.placeholder
    with located(section.sub("ratings")):
        ratings = None if model.ratings is None else Ratings(**_values(model.ratings))
    with located(section):
        drive = Drive(
            model.name,
            model.kind,
            sources=sources,
            placeholders=placeholders,
            file=section.file_name,
            ratings=ratings,
            **model.numbers(),
            **fields,
        )
        if kind.threaded:
            drive.check_locking()
    return drive


def _dimensions(section: Section, model: Any, kind: Any) -> dict[str, float]:
    """Return all dimensions of a drive in SI units, by key.

    Raises ProblemError if the stated dimensions contradict each other or do not suffice.
    """
    try:
        return kind.complete(model.geometry.numbers() if hints(kind) else {})
    except BadGeometry as error:
        show = error.key is not None
        path = ("geometry", error.key) if error.key else ("geometry",)
        raise section.error(str(error), *path, allowed=error.allowed, show=show) from None


def _thread_fields(
    section: Section, model: Any, kind: type[Transmission], dimensions: Numbers
) -> Keywords:
    """Return the fields of a worm or screw that follow from its geometry and friction.

    `dimensions` contains all dimensions in SI units by key.
    """
    lead_angle = dimensions["lead_angle"]
    friction = None
    if model.friction is not None:
        friction = _friction(section.sub("friction"), model.friction)
    ranges = {} if model.friction_ranges is None else _values(model.friction_ranges)
    ranges.pop("source", None)
    return {
        "ratio": kind.motor_ratio(dimensions),
        "gamma": kind.effort_arm(dimensions),
        "lead_angle": lead_angle,
        "pressure_angle": math.atan(
            math.tan(dimensions["thread_angle"] / 2) * math.cos(lead_angle)
        ),
        "friction": friction,
        "self_locking": model.self_locking == "required",
        "dimensions": dimensions,
        "rig": None if model.rig is None else _rig(model.rig),
        "friction_ranges": ranges,
    }


def _efficiency_fields(
    section: Section, model: Any, kind: type[Transmission], dimensions: Numbers
) -> Keywords:
    """Return the fields of a drive whose file states efficiencies instead of friction.

    The friction law needs a thread. The fields therefore describe the thread whose efficiencies
    in both directions equal the stated ones (dynamics/transmission.of_efficiencies). `dimensions`
    contains all dimensions in SI units by key.
    """
    ratio = kind.motor_ratio(dimensions)
    bearings = {} if model.friction is None else model.friction.numbers()
    forwards = bearings.pop("efficiency", 1.0)
    backwards = bearings.pop("backward_efficiency", forwards)
    gamma, mu = of_efficiencies(ratio, forwards, backwards)
    with located(section):
        friction = Friction(**{"b_c": 0.0, "b_v": 0.0, **bearings, "mu": mu, "mu_static": mu})
    return {
        "ratio": ratio,
        "gamma": gamma,
        "lead_angle": WEDGE,
        "pressure_angle": ZERO_PRESSURE_ANGLE,
        "friction": friction,
        "self_locking": False,
        "dimensions": {**dimensions, "efficiency": forwards, "backward_efficiency": backwards},
    }


def _values(model: Model) -> Keywords:
    """Return the figures of a model in SI units, by the fields of the value that it describes."""
    numbers = {
        name: field_value.value if isinstance(field_value, Figure) else field_value
        for name, field_value in model
        if field_value is not None
    }
    return {name: value for name, value in numbers.items() if name in hints(model.of[-1])}


def _friction(section: Section, model: Any) -> Friction:
    """Build the friction that a section describes. A missing `mu_static` is set to `mu`.

    Raises ProblemError if a coefficient is implausible or if a parameter of the law is missing.
    """
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


def _posterior(model: Any) -> Posterior:
    """Build the posterior. Raises ProblemError if its columns have different lengths."""
    if len({len(column) for column in model.draws.values()}) != 1:
        raise ProblemError(
            "columns of different lengths",
            key="posterior.draws",
            allowed="as many sets of each parameter",
        )
    fields = dict(model)
    for name, part_of in PART_TYPES.items():
        if fields[name] is not None:
            fields[name] = part_of(**dict(fields[name]))
    fields["draws"] = np.column_stack(list(model.draws.values()))
    return Posterior(names=tuple(model.draws), **fields)


def _rig(model: Any) -> Rig:
    """Build the test rig that a drive file describes."""
    published = {} if model.published is None else model.published.numbers()
    direction = 1 if model.payload_direction == "positive" else -1
    return Rig(**{**_values(model), "payload_direction": direction, "published": published})


def _origins(model: Any) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Return the source of each figure by key, and the names of the placeholders."""
    sourced: dict[str, Figure] = {}
    sources: dict[str, str] = {}
    for submodel in (model, getattr(model, "geometry", None), model.friction, model.ratings):
        if submodel is not None:
            origin = getattr(submodel, "source", None) or model.source
            sourced |= submodel.sourced_figures()
            sources |= {} if origin is None else dict.fromkeys(submodel.sourced_figures(), origin)
    if getattr(model, "friction_ranges", None) is not None:
        sources["friction_ranges"] = model.friction_ranges.source
    sources |= {name: item.source for name, item in sourced.items() if item.source is not None}
    return sources, tuple(name for name, item in sourced.items() if item.placeholder)
