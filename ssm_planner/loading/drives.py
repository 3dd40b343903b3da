"""A drive file → Drive: its geometry resolved, the source of each figure beside it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.loading.drive_geometry import BadGeometry, resolve
from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.schema.common import Figure
from ssm_planner.loading.schema.drive import (
    DRIVES,
    AntibacklashScrewModel,
    FrictionRanges,
    LeadScrewModel,
    PosteriorModel,
    WormModel,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.drive import Drive, Friction, Ratings, Rig
from ssm_planner.problem.posterior import Posterior, Ripple
from ssm_planner.typing import Range


def ratings_from(model: Any) -> Ratings | None:
    """The rated figures of a drive."""
    if model is None:
        return None
    return Ratings(ends=getattr(model, "ends", None), **{name: figure.value for name, figure in model.figures()})


def rating_figures(model: Any, default: str | None) -> tuple[dict[str, Figure], dict[str, str]]:
    """The rated figures and their sources by name."""
    if model is None:
        return {}, {}
    figures = dict(model.figures())
    origin = model.source or default
    return figures, {} if origin is None else dict.fromkeys(figures, origin)


def friction_ranges_from(model: FrictionRanges | None) -> dict[str, Range]:
    """Ranges of friction parameters by name."""
    if model is None:
        return {}
    ranges = {name: getattr(model, name) for name in type(model).model_fields if name != "source"}
    return {name: ends for name, ends in ranges.items() if ends is not None}


LARGEST_MU = 1.5
AnyModel = WormModel | LeadScrewModel | AntibacklashScrewModel


def drive_from(section: Section) -> Drive:
    """The drive that a section describes. Raises ProblemError."""
    model = validated(section, _model(section))
    dimensions = _dimensions(section, model)
    lead_angle, thread_angle = dimensions["lead_angle"], dimensions["thread_angle"]
    worm = model.kind == "worm"
    sources, placeholders = _origins(model)
    friction = _friction(section, model.friction)
    with located(section.sub("ratings")):
        ratings = ratings_from(model.ratings)
    with located(section):
        drive = Drive(
            name=model.name,
            kind=model.kind,
            ratio=dimensions["ratio"],
            gamma=dimensions["worm_diameter"] / dimensions["wheel_diameter"] if worm else dimensions["diameter"] / 2,
            lead_angle=lead_angle,
            pressure_angle=math.atan(math.tan(thread_angle / 2) * math.cos(lead_angle)),
            input_inertia=model.input_inertia.value,
            output_inertia=model.output_inertia.value,
            friction=friction,
            preload=model.preload.value if isinstance(model, AntibacklashScrewModel) else 0.0,
            second_nut_mass=model.second_nut_mass.value if isinstance(model, AntibacklashScrewModel) else 0.0,
            self_locking=model.self_locking == "required",
            dimensions=dimensions,
            sources=sources,
            placeholders=placeholders,
            rig=_rig(model),
            file=None if section.file is None else str(section.file),
            ratings=ratings,
            friction_ranges=friction_ranges_from(model.friction_ranges),
        )
        drive.check_locking()
    return drive


def _model(section: Section) -> type[WormModel] | type[LeadScrewModel] | type[AntibacklashScrewModel]:
    kind = section.value.get("kind")
    allowed = ", ".join(DRIVES)
    if kind is None:
        raise section.error("missing: this key is required", "kind", allowed=allowed)
    if not isinstance(kind, str) or kind not in DRIVES:
        raise section.error("not a kind of drive known here", "kind", allowed=allowed)
    return DRIVES[kind]


def _dimensions(section: Section, model: AnyModel) -> dict[str, float]:
    given = {name: figure.value for name, figure in model.geometry.figures()}
    thread_angle = given.pop("thread_angle")
    outer = given.pop("outer_diameter", None)
    if not thread_angle < math.radians(120):
        raise section.error("implausible", "geometry", "thread_angle", allowed="an angle below 120 deg")
    try:
        dimensions = resolve("worm" if model.kind == "worm" else "screw", given)
    except BadGeometry as error:
        path = ("geometry",) if error.key is None else ("geometry", error.key)
        raise section.error(str(error), *path, show=error.key is not None) from None
    if outer is not None:
        if outer < dimensions["diameter"]:
            raise section.error("smaller than the diameter at which friction acts", "geometry", "outer_diameter")
        dimensions["outer_diameter"] = outer
    return {**dimensions, "thread_angle": thread_angle}


def _friction(section: Section, model: Any) -> Friction | None:
    if model is None:
        return None
    values = {name: figure.value for name, figure in model.figures()}
    values.setdefault("mu_static", values["mu"])
    here = section.sub("friction")
    for name in ("mu", "mu_static"):
        if values[name] > LARGEST_MU:
            raise here.error("implausible for a coefficient of friction", name, allowed=f"0 to {LARGEST_MU}")
    if model.law != "coulomb" and not {"mu_stribeck", "stribeck_speed"} <= values.keys():
        raise here.error(f"the law {model.law} needs mu_stribeck and stribeck_speed", "law")
    with located(here):
        posterior = None if model.posterior is None else _posterior(model.posterior)
        return Friction(law=model.law, covariance=model.covariance, posterior=posterior, source=model.source, **values)


def _posterior(model: PosteriorModel) -> Posterior:
    lengths = {len(column) for column in model.draws.values()}
    if len(lengths) != 1:
        raise ProblemError(
            "columns of different lengths", key="posterior.draws", allowed="as many sets of each parameter"
        )
    ripples = {
        way: Ripple(**dict(getattr(model, way))) for way in ("forwards", "backwards") if getattr(model, way) is not None
    }
    draws = np.column_stack(list(model.draws.values()))
    return Posterior(names=tuple(model.draws), draws=draws, scatter=model.scatter, **ripples)


def _rig(model: AnyModel) -> Rig | None:
    rig = model.rig
    if rig is None:
        return None
    published = {} if rig.published is None else {name: figure.value for name, figure in rig.published.figures()}
    direction = 1 if rig.payload_direction == "positive" else -1
    fields = {name: value for name, value in rig if name != "source"}
    return Rig(**{**fields, "payload_direction": direction, "published": published})


def _origins(model: AnyModel) -> tuple[dict[str, str], tuple[str, ...]]:
    """Source of each figure, and the names of those that are placeholders."""
    figures: dict[str, Figure] = {**dict(model.figures()), **dict(model.geometry.figures())}
    sources: dict[str, str] = {}
    if model.source is not None:
        sources = dict.fromkeys(figures, model.source)
    if model.friction is not None:
        friction = dict(model.friction.figures())
        origin = model.friction.source or model.source
        if origin is not None:
            sources |= dict.fromkeys(friction, origin)
        figures |= friction
    rated, rated_sources = rating_figures(model.ratings, model.source)
    figures |= rated
    sources |= rated_sources
    if model.friction_ranges is not None:
        sources["friction_ranges"] = model.friction_ranges.source
    sources |= {name: figure.source for name, figure in figures.items() if figure.source is not None}
    return sources, tuple(name for name, figure in figures.items() if figure.placeholder)
