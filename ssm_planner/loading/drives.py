"""Optional parts of a drive file that only sizing reads: what the manufacturer allows, and ranges of friction.

A drive file → Drive: geometry resolved, friction checked, self-locking proven.
"""

from __future__ import annotations

import math

from ssm_planner.errors import ProblemError
from ssm_planner.loading.drive_geometry import BadGeometry, resolve
from ssm_planner.loading.faults import validated
from ssm_planner.loading.schema.common import Figure
from ssm_planner.loading.schema.drive import (
    DRIVES,
    AntibacklashScrewModel,
    FrictionModel,
    FrictionRanges,
    LeadScrewModel,
    RatingsModel,
    WormModel,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.drive import Drive, Friction, Ratings, Rig
from ssm_planner.typing import Range


def ratings_from(section: Section, model: RatingsModel | None) -> Ratings | None:
    """The rated figures of a drive. Raises ProblemError where they contradict each other."""
    if model is None:
        return None
    values = {name: figure.value for name, figure in model.figures()}
    here = section.sub("ratings")
    continuous, peak = values.get("continuous_output"), values.get("peak_output")
    if continuous is not None and peak is not None and peak < continuous:
        raise here.error("smaller than continuous_output", "peak_output", allowed=f"at least {continuous:g} in SI")
    if values.get("duty", 0.0) > 1:
        raise here.error("more than all of the time", "duty", allowed="a share above 0 and up to 1")
    length, diameter = values.get("free_length"), values.get("root_diameter")
    if length is not None and diameter is not None and diameter > length:
        raise here.error("thicker than long: is the unit right?", "root_diameter", allowed="less than free_length")
    return Ratings(ends=getattr(model, "ends", None), **values)


def rating_figures(model: RatingsModel | None, default: str | None) -> tuple[dict[str, Figure], dict[str, str]]:
    """The rated figures and their sources by name."""
    if model is None:
        return {}, {}
    figures = dict(model.figures())
    origin = model.source or default
    return figures, {} if origin is None else dict.fromkeys(figures, origin)


def friction_ranges_from(section: Section, model: FrictionRanges | None, friction: Friction | None) -> dict[str, Range]:
    """Ranges of friction parameters by name; each must hold the parameter's own value. Raises ProblemError."""
    if model is None:
        return {}
    here = section.sub("friction_ranges")
    if friction is None:
        raise section.error("ranges of a friction that is still to be identified", "friction_ranges", show=False)
    ranges: dict[str, Range] = {}
    for name in type(model).model_fields:
        ends = getattr(model, name)
        if name == "source" or ends is None:
            continue
        value = getattr(friction, name)
        low, high = ends
        if low < 0:
            raise here.error("friction is not negative", name, allowed="[lower, upper], from 0")
        if not low <= value <= high:
            raise here.error(
                f"does not hold the value of {name} itself, {value:g} in SI", name, allowed="a range around it"
            )
        ranges[name] = (float(low), float(high))
    return ranges


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
        file=str(section.file),
        ratings=ratings_from(section, model.ratings),
        friction_ranges=friction_ranges_from(section, model.friction_ranges, friction),
    )
    if drive.friction is None and drive.rig is None:
        raise section.error("missing: only a drive with a rig may leave its friction to be identified", "friction")
    _check_locking(section, drive)
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


def _friction(section: Section, model: FrictionModel | None) -> Friction | None:
    if model is None:
        return None
    values = {name: figure.value for name, figure in model.figures()}
    values.setdefault("mu_static", values["mu"])
    mu = values["mu"]
    here = section.sub("friction")
    for name in ("mu", "mu_static"):
        if values[name] > LARGEST_MU:
            raise here.error("implausible for a coefficient of friction", name, allowed=f"0 to {LARGEST_MU}")
    if values["mu_static"] < mu:
        raise here.error("smaller than mu", "mu_static", allowed=f"at least mu = {mu:g}")
    if values.get("mu_lowest", mu) > mu:
        raise here.error("larger than mu", "mu_lowest", allowed=f"at most mu = {mu:g}")
    stribeck = [name for name in ("mu_stribeck", "stribeck_speed") if name in values]
    if model.law == "coulomb" and stribeck:
        raise here.error("not a parameter of the coulomb law", stribeck[0], allowed="law: stribeck_exponential or …")
    if model.law != "coulomb" and len(stribeck) < 2:
        raise here.error(f"the law {model.law} needs mu_stribeck and stribeck_speed", "law")
    return Friction(law=model.law, covariance=model.covariance, source=model.source, **values)


def _rig(model: AnyModel) -> Rig | None:
    rig = model.rig
    if rig is None:
        return None
    published = {} if rig.published is None else {name: figure.value for name, figure in rig.published.figures()}
    return Rig(
        payload_mass=rig.payload_mass,
        motor_nominal_torque=rig.motor_nominal_torque,
        payload_arm=getattr(rig, "payload_arm", None),
        payload_direction=1 if rig.payload_direction == "positive" else -1,
        gravity=rig.gravity,
        direction=rig.direction,
        published=published,
    )


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


def _check_locking(section: Section, drive: Drive) -> None:
    """φ_f = atan(μ/cos θ_n) ≤ λ: the load drives the motor (values at rest do not count: they can be shaken off)."""
    friction = drive.friction
    if friction is None:
        return
    lowest, path = friction.mu, ("friction", "mu")
    if friction.mu_lowest is not None:
        lowest, path = friction.mu_lowest, ("friction", "mu_lowest")
    if drive.friction_ranges.get("mu", (lowest,))[0] < lowest:
        lowest, path = drive.friction_ranges["mu"][0], ("friction_ranges", "mu")
    repose = math.atan(lowest / math.cos(drive.pressure_angle))
    if drive.self_locking and repose <= drive.lead_angle:
        raise _not_locking(section, drive, path, repose)
    highest = max(friction.mu_static, friction.mu + friction.mu_stribeck)
    if drive.lead_angle + math.atan(highest / math.cos(drive.pressure_angle)) >= math.pi / 2:
        raise section.error("with this lead angle and friction the gear jams: λ + φ_f is 90 deg or more", "friction")


def _not_locking(section: Section, drive: Drive, path: tuple[str, str], repose: float) -> ProblemError:
    needed = math.tan(drive.lead_angle) * math.cos(drive.pressure_angle)
    return section.error(
        f"the drive does not lock itself: lead angle λ = {math.degrees(drive.lead_angle):.4g} deg, "
        f"friction angle φ_f = {math.degrees(repose):.4g} deg, and φ_f must be larger",
        *path,
        allowed=f"mu above {needed:.4g}, or self_locking: not required",
    )
