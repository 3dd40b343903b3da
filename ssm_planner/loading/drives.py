"""Read drive files, complete the geometry of the gear, and record the source of each figure.

A drive file states the geometry of a worm, screw, gear, belt or cable, its friction or efficiency,
its inertias and its ratings. `drive_model` returns the pydantic model with the keys of one kind of
drive, and `drive_from` builds the `Drive`.
"""

import math
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field as PydanticField
from pydantic import FiniteFloat, field_validator

from ssm_planner.dynamics import thread_from_efficiencies
from ssm_planner.errors import ProblemError
from ssm_planner.loading.motors import check_rule
from ssm_planner.loading.schema import (
    POSITIVE,
    SOURCE_KEY,
    Figure,
    Model,
    Reader,
    Text,
    build_class_model,
    build_keys_model,
    field_type,
    interval_reader,
    invalid_value,
    locate_errors,
    nested_type,
    optional_key,
    positive_type,
    quantity_reader,
    required_key,
    sourced_reader,
    validate_section,
    vector_reader,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.package_table import package_table
from ssm_planner.problem import (
    EFFICIENCY_LEAD_ANGLE,
    FRICTION_PARAMETERS,
    RANGE_PARAMETERS,
    TRANSMISSIONS,
    Bound,
    DimensionError,
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
    field_hints,
    field_quantities,
    unit_kind,
)
from ssm_planner.typing import JsonObject, Keywords, Numbers

TO_IDENTIFY = "to_identify"
"""Text in place of the friction in the file of a drive whose friction must still be identified."""
LARGEST_FRICTION_COEFFICIENT = 1.5
"""Largest plausible coefficient of friction."""
ZERO_PRESSURE_ANGLE = 1e-9
"""Pressure angle in rad that represents a drive with efficiencies. Its cosine is 1."""


def _parse_numbers(value: Any) -> tuple[float, ...]:
    """Read a text of finite numbers in SI units that are separated by spaces.

    The posterior in a drive file, that is, the uncertainty of its friction, contains many numbers.
    A list with units would be too long.

    Parameters
    ----------
    value : object
        Value in the file, which should be a text.

    Returns
    -------
    tuple of float
        The numbers.

    Raises
    ------
    PydanticCustomError
        If the value is not a text, or if the text is empty or contains anything else.
    """
    try:
        numbers = tuple(float(text) for text in value.split())
    except (AttributeError, ValueError):
        numbers = ()
    if not numbers or not all(map(math.isfinite, numbers)):
        raise invalid_value(
            "expected a row of numbers", "finite numbers in SI, separated by spaces"
        )
    return numbers


_NumberRow = Annotated[
    tuple[float, ...], Reader(_parse_numbers, {"type": "string"}, allowed="a row of numbers, SI")
]

POSTERIOR_PART_TYPES = {
    "forwards": Ripple,
    "backwards": Ripple,
    "harmonics_forwards": Harmonics,
    "harmonics_backwards": Harmonics,
    "reaction": Reaction,
}
"""Classes of the fields of a posterior that may be None, by field."""
_POSTERIOR_PART_MODELS: dict[type, Any] = {
    part: nested_type(
        build_keys_model(
            {
                name: (bool if hint is bool else _NumberRow, ...)
                for name, hint in field_hints(part).items()
            },
            value_types=(part,),
        )
    )
    for part in (Ripple, Harmonics, Reaction)
}
PosteriorModel = build_class_model(
    Posterior,
    {
        "scatter": (Annotated[float, quantity_reader("torque", Bound(at_least=0.0))], ...),
        "common": (float, 0.0),
        **dict.fromkeys(("speeds", "departures"), (_NumberRow, ())),
        **{
            name: optional_key(_POSTERIOR_PART_MODELS[part_of])
            for name, part_of in POSTERIOR_PART_TYPES.items()
        },
        "draws": (
            dict[str, _NumberRow],
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
                raise invalid_value(
                    "invalid friction", f"{TO_IDENTIFY}, or a mapping with mu, b_c, b_v …"
                )
            return None
        return value


def _friction_range_type(name: str, slides: bool) -> Any:
    """Return the type and the default of the key for the range of a friction parameter.

    The range covers lubrication, temperature and wear.

    Parameters
    ----------
    name : str
        Name of the parameter, a field of Friction.
    slides : bool
        True for the units of a drive with a linear output.

    Returns
    -------
    tuple
        Type and default of the key, as pydantic expects them.
    """
    quantity_kind = unit_kind(field_quantities(Friction)[name], slides)
    # An interval requires different bounds. Those of a dimensionless number may be equal.
    return optional_key(
        Annotated[
            Any,
            vector_reader("number", "number")
            if quantity_kind == "number"
            else interval_reader(quantity_kind),
        ]
    )


SCREW_RATINGS = ("free_length", "root_diameter", "ends")
"""Ratings that only a drive with a linear output has."""
GEARHEAD_RULES = package_table(Path(__file__).with_name("gearheads.csv"))
"""Ranges of the figures of gear stages in SI units, in the form of `motors.PLAUSIBILITY_RULES`."""
THREAD_FIELDS = ("self_locking", "friction_ranges", "rig")
"""Fields of Drive that only a worm or screw has."""
ANTIBACKLASH_FIELDS = ("preload", "second_nut_mass")
"""Fields of Drive that only an antibacklash screw has."""
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
_EFFICIENCY = Annotated[
    Figure, sourced_reader(quantity_reader("number", Bound(above=0.0, at_most=1.0)))
]


@cache
def drive_model(drive_kind: str) -> Any:
    """Return the pydantic model of the drive files of one kind.

    The model is built on first use because building it is slow.

    Parameters
    ----------
    drive_kind : str
        Name of the kind of drive in `TRANSMISSIONS`, such as "lead_screw".

    Returns
    -------
    type
        Model with a field for each key of the file.
    """
    kind: Any = TRANSMISSIONS.find(drive_kind)
    slides = kind.slides
    keys = {
        "kind": (Literal[drive_kind], ...),
        "source": SOURCE_KEY,
        "ratings": optional_key(nested_type(_ratings_model(slides))),
        "gearhead": optional_key(nested_type(gearhead_model())),
        "belt": optional_key(nested_type(gearhead_model())),
    }
    if field_hints(kind):
        geometry = build_class_model(kind, sourced=True)
        geometry.__doc__ = kind.__doc__
        keys["geometry"] = required_key(nested_type(geometry), "Dimensions of the transmission.")
    keys |= _thread_keys(slides) if kind.threaded else _efficiency_keys(kind)
    without: tuple[str, ...] = () if kind.threaded else THREAD_FIELDS
    if kind.two_nuts:
        keys["preload"] = Annotated[Figure, sourced_reader(quantity_reader("force", POSITIVE))], ...
        keys["second_nut_mass"] = field_type(Drive, "second_nut_mass", slides, sourced=True), ...
    else:
        without += ANTIBACKLASH_FIELDS
    base = _ThreadModel if kind.threaded else Model
    return build_class_model(Drive, keys, slides=slides, sourced=True, without=without, base=base)


def _ratings_model(slides: bool) -> Any:
    """Return the model of the ratings of a drive with a rotary or a linear output (`slides`)."""
    without = () if slides else SCREW_RATINGS
    return build_class_model(
        Ratings, {"source": SOURCE_KEY}, slides=slides, sourced=True, without=without
    )


@cache
def gearhead_model() -> Any:
    """Return the model of a gear stage between motor and drive."""
    return build_class_model(
        Gearhead, {"ratings": optional_key(nested_type(_ratings_model(slides=False)))}
    )


def gearhead_from(section: Section, model: Any = None) -> Gearhead:
    """Build the gear stage that a section describes.

    Parameters
    ----------
    section : Section
        Part of the file that describes the gear stage.
    model : object, optional
        Validated content of the section. By default, the function validates the section.

    Returns
    -------
    Gearhead
        The gear stage with its ratings.

    Raises
    ------
    ProblemError
        If a value is invalid, or if figures contradict each other.
    """
    fields = dict(model or validate_section(section, gearhead_model()))
    figures = {name: math.nan if fields[name] is None else fields[name] for name in fields}
    with locate_errors(section.sub("ratings")):
        if fields["ratings"] is not None:
            ratings = _si_values(fields["ratings"])
            fields["ratings"] = Ratings(**ratings)
            figures |= {f"ratings.{name}": value for name, value in ratings.items()}
    for rule in GEARHEAD_RULES:
        check_rule(section, defaultdict(lambda: math.nan, figures), rule)
    with locate_errors(section):
        return Gearhead(**fields)


def _thread_keys(slides: bool) -> Keywords:
    """Return those keys of a worm or screw file that are not simply fields of Drive.

    Parameters
    ----------
    slides : bool
        True for the units of a drive with a linear output.

    Returns
    -------
    dict
        A pair of type and default for each key.
    """
    friction = {
        "mu_static": optional_key(field_type(Friction, "mu_static", sourced=True)),
        "covariance": optional_key(dict[str, dict[str, FiniteFloat]]),
        "posterior": optional_key(nested_type(PosteriorModel)),
    }
    ranges = {
        "source": (Text, ...),
        **{name: _friction_range_type(name, slides) for name in RANGE_PARAMETERS},
    }
    published = {
        name: optional_key(field_type(Friction, name, slides, sourced=True))
        for name in FRICTION_PARAMETERS
    }
    published["preload"] = optional_key(field_type(Drive, "preload", sourced=True))
    rig = {
        "payload_direction": (Literal["positive", "negative"], "positive"),
        "published": optional_key(
            nested_type(
                build_keys_model({**published, "source": SOURCE_KEY}, value_types=(Drive, Friction))
            )
        ),
        "source": SOURCE_KEY,
    }
    if not slides:
        rig["payload_arm"] = positive_type("length"), ...
    friction_model = build_class_model(Friction, friction, slides=slides, sourced=True)
    return {
        "self_locking": (Literal["required", "not required"], "required"),
        "friction": (
            nested_type(friction_model) | None,
            PydanticField(None, description=_FRICTION_TEXT, json_schema_extra=_add_to_identify),
        ),
        "friction_ranges": optional_key(
            nested_type(build_keys_model(ranges, value_types=(Friction,)))
        ),
        "rig": optional_key(
            nested_type(build_class_model(Rig, rig, slides=slides, without=("payload_arm",)))
        ),
    }


_FRICTION_TEXT = f"Friction of mesh and bearings. {TO_IDENTIFY!r} is allowed for a drive on a rig."


def _efficiency_keys(kind: Any) -> Keywords:
    """Return those keys of a drive file with efficiencies that are not simply fields of Drive.

    Parameters
    ----------
    kind : type
        Subclass of Transmission. Efficiencies are only keys if it has dimensions.

    Returns
    -------
    dict
        A pair of type and default for each key.
    """
    friction = {
        name: optional_key(field_type(Friction, name, sourced=True)) for name in ("b_c", "b_v")
    }
    if field_hints(kind):
        friction["efficiency"] = optional_key(
            _EFFICIENCY, "Ratio of output to input power while the motor drives. The default is 1."
        )
        friction["backward_efficiency"] = optional_key(
            _EFFICIENCY,
            "Ratio of output to input power while the load drives. The default is forwards.",
        )
    model = build_class_model(
        Friction, friction, slides=kind.slides, sourced=True, without=MESH_PARAMETERS
    )
    return {"friction": optional_key(nested_type(model), "Friction, none by default.")}


def _add_to_identify(schema: JsonObject) -> None:
    """Add the text "to_identify" to the values that a JSON schema allows."""
    schema["anyOf"].append({"const": TO_IDENTIFY})


def drive_from(section: Section) -> Drive:
    """Build the drive that a section of a file describes.

    Parameters
    ----------
    section : Section
        Content of a drive file, or the part of a robot file that contains the drive.

    Returns
    -------
    Drive
        The drive with its gear stages, friction and ratings.

    Raises
    ------
    ProblemError
        If a value is invalid, or if the drive is not self-locking although it must be.
    """
    with locate_errors(section):
        kind = TRANSMISSIONS.find(section.value.get("kind"), "Drive.kind")
    model: Any = validate_section(section, drive_model(kind.name))
    dimensions = _complete_dimensions(section, model, kind)
    fields = (_thread_fields if kind.threaded else _efficiency_fields)(
        section, model, kind, dimensions
    )
    sources, placeholders = _figure_sources(model)
    for name in ("gearhead", "belt"):
        if getattr(model, name) is not None:
            fields[name] = stage = gearhead_from(section.sub(name), getattr(model, name))
            fields["ratio"] *= stage.ratio
            placeholders += (name,) * stage.placeholder
    with locate_errors(section.sub("ratings")):
        ratings = None if model.ratings is None else Ratings(**_si_values(model.ratings))
    with locate_errors(section):
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


def _complete_dimensions(section: Section, model: Any, kind: Any) -> dict[str, float]:
    """Return all dimensions of a drive in SI units, by key.

    Parameters
    ----------
    section : Section
        The drive file, for messages.
    model : object
        The validated section.
    kind : type
        Subclass of Transmission, which computes the dimensions that the file does not state.

    Returns
    -------
    dict of float
        Stated and computed dimensions.

    Raises
    ------
    ProblemError
        If the stated dimensions contradict each other or do not suffice.
    """
    try:
        return kind.complete(model.geometry.numbers() if field_hints(kind) else {})
    except DimensionError as error:
        show = error.key is not None
        path = ("geometry", error.key) if error.key else ("geometry",)
        raise section.error(str(error), *path, allowed=error.allowed, show=show) from None


def _thread_fields(
    section: Section, model: Any, kind: type[Transmission], dimensions: Numbers
) -> Keywords:
    """Return the fields of a Drive that follow from the geometry and the friction of a thread.

    Parameters
    ----------
    section : Section
        The drive file.
    model : object
        The validated section.
    kind : type
        Subclass of Transmission.
    dimensions : mapping
        All dimensions in SI units by key.

    Returns
    -------
    dict
        Keyword arguments of the constructor of Drive.
    """
    lead_angle = dimensions["lead_angle"]
    friction = None
    if model.friction is not None:
        friction = _friction_from(section.sub("friction"), model.friction)
    ranges = {} if model.friction_ranges is None else _si_values(model.friction_ranges)
    ranges.pop("source", None)
    return {
        "ratio": kind.motor_ratio(dimensions),
        "gamma": kind.effort_arm(dimensions),
        "lead_angle": lead_angle,
        # The thread angle is measured in the axial section of the thread, and the pressure angle in
        # the section normal to the thread.
        "pressure_angle": math.atan(
            math.tan(dimensions["thread_angle"] / 2) * math.cos(lead_angle)
        ),
        "friction": friction,
        "self_locking": model.self_locking == "required",
        "dimensions": dimensions,
        "rig": None if model.rig is None else _rig_from(model.rig),
        "friction_ranges": ranges,
    }


def _efficiency_fields(
    section: Section, model: Any, kind: type[Transmission], dimensions: Numbers
) -> Keywords:
    """Return the fields of a Drive whose file states efficiencies instead of friction.

    The friction law of this package needs a thread. The fields therefore describe the thread whose
    efficiencies in both directions equal the stated ones
    (dynamics/transmission.thread_from_efficiencies).

    Parameters
    ----------
    section : Section
        The drive file.
    model : object
        The validated section.
    kind : type
        Subclass of Transmission.
    dimensions : mapping
        All dimensions in SI units by key.

    Returns
    -------
    dict
        Keyword arguments of the constructor of Drive.
    """
    ratio = kind.motor_ratio(dimensions)
    bearings = {} if model.friction is None else model.friction.numbers()
    forwards = bearings.pop("efficiency", 1.0)
    backwards = bearings.pop("backward_efficiency", forwards)
    gamma, mu = thread_from_efficiencies(ratio, forwards, backwards)
    with locate_errors(section):
        friction = Friction(**{"b_c": 0.0, "b_v": 0.0, **bearings, "mu": mu, "mu_static": mu})
    return {
        "ratio": ratio,
        "gamma": gamma,
        "lead_angle": EFFICIENCY_LEAD_ANGLE,
        "pressure_angle": ZERO_PRESSURE_ANGLE,
        "friction": friction,
        "self_locking": False,
        "dimensions": {**dimensions, "efficiency": forwards, "backward_efficiency": backwards},
    }


def _si_values(model: Model) -> Keywords:
    """Return the values of a section as keyword arguments for the class that it describes.

    Parameters
    ----------
    model : Model
        Validated content of the section.

    Returns
    -------
    dict
        Values in SI units by name of the field. Keys that the file omits, and keys that are not
        fields of the class, are absent.
    """
    numbers = {
        name: field_value.value if isinstance(field_value, Figure) else field_value
        for name, field_value in model
        if field_value is not None
    }
    return {
        name: value for name, value in numbers.items() if name in field_hints(model.value_types[-1])
    }


def _friction_from(section: Section, model: Any) -> Friction:
    """Build the friction that a section describes.

    Parameters
    ----------
    section : Section
        Part of the file that describes the friction.
    model : object
        The validated section.

    Returns
    -------
    Friction
        The friction. A missing static coefficient of friction equals the kinetic one.

    Raises
    ------
    ProblemError
        If a coefficient is implausible or if a parameter of the law is missing.
    """
    values = _si_values(model)
    values.setdefault("mu_static", values["mu"])
    for name in ("mu", "mu_static"):
        if values[name] > LARGEST_FRICTION_COEFFICIENT:
            raise section.error(
                "implausible for a coefficient of friction",
                name,
                allowed=f"0 to {LARGEST_FRICTION_COEFFICIENT}",
            )
    if model.law != "coulomb" and not {"mu_stribeck", "stribeck_speed"} <= values.keys():
        raise section.error(f"the law {model.law} needs mu_stribeck and stribeck_speed", "law")
    with locate_errors(section):
        if model.posterior is not None:
            values["posterior"] = _posterior_from(model.posterior)
        return Friction(**values)


def _posterior_from(model: Any) -> Posterior:
    """Build the posterior of the friction parameters from its validated section.

    The posterior consists of equally likely sets of parameters, which are called draws.

    Parameters
    ----------
    model : object
        Validated content of the section, with a column of values for each parameter.

    Returns
    -------
    Posterior
        The posterior. Its draws have one row for each set and one column for each parameter.

    Raises
    ------
    ProblemError
        If the columns have different lengths.
    """
    if len({len(column) for column in model.draws.values()}) != 1:
        raise ProblemError(
            "columns of different lengths",
            key="posterior.draws",
            allowed="as many sets of each parameter",
        )
    fields = dict(model)
    for name, part_of in POSTERIOR_PART_TYPES.items():
        if fields[name] is not None:
            fields[name] = part_of(**dict(fields[name]))
    fields["draws"] = np.column_stack(list(model.draws.values()))
    return Posterior(names=tuple(model.draws), **fields)


def _rig_from(model: Any) -> Rig:
    """Build the test rig that a drive file describes, from its validated section."""
    published = {} if model.published is None else model.published.numbers()
    direction = 1 if model.payload_direction == "positive" else -1
    return Rig(**{**_si_values(model), "payload_direction": direction, "published": published})


def _figure_sources(model: Any) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Return the sources of the figures of a drive file, and the names of its placeholders.

    Parameters
    ----------
    model : object
        The validated file.

    Returns
    -------
    sources : dict of str
        Source of each figure by key. A figure without its own source has that of its section or
        file.
    placeholders : tuple of str
        Keys of the figures that replace unknown ones.
    """
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
