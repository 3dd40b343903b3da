"""Optional parts of a drive file that only sizing reads: what the manufacturer allows, and ranges of friction."""

from __future__ import annotations

from ssm_planner.problem.schema.common import Figure
from ssm_planner.problem.schema.drive import FrictionRanges, RatingsModel
from ssm_planner.problem.source import Section
from ssm_planner.problem.values import Friction, Range, Ratings


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
