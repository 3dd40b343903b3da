"""The section of the page on motors and gears: margins of every check, and what could not be checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ssm_planner.export.plan_file import PlanFile
from ssm_planner.report.html_elements import Markup, table, tag
from ssm_planner.report.sizing_words import ANSWERS, gear_margin, missing_figures, motors_verdict

MARGINS = ("torque", "speed", "continuous_torque", "voltage", "heat")
CONDITIONS = (
    "The motion repeated without pause in surroundings of 25 °C. Margin: (limit − worst)/limit, worst at the "
    "stated confidence where the friction's uncertainty is known. “–”: a figure is missing."
)


def sizing(plan: PlanFile) -> Markup:
    """Which motors and gears suffice, by what margins, and what is not known."""
    found = plan.sizing
    rows = [_row(motor, found) for motor in found["motors"]]
    header = (
        "joint",
        "motor",
        "suffices",
        "binds",
        *(name.replace("_", " ") for name in MARGINS),
        "gear",
        "confidence",
    )
    unknown = list(missing_figures(found))
    open_ = table(("joint", "motor or gear", "not checked", "figures that are missing"), unknown) if unknown else None
    return tag(
        "section",
        tag("h2", "Whether the motors suffice"),
        tag("p", ": ".join(filter(None, motors_verdict(found)[1:])) + ". ", CONDITIONS),
        table(header, rows, numbers=range(4, 4 + len(MARGINS) + 2)) if rows else None,
        open_,
        id="sizing",
    )


def _row(motor: Mapping[str, Any], found: Mapping[str, Any]) -> tuple[str, ...]:
    margins = (motor["margins"].get(name) for name in MARGINS)
    probability = motor["probability"]
    return (
        motor["joint"],
        motor["motor"] + (" (placeholder figures)" if motor["placeholder"] else ""),
        ANSWERS[motor["adequate"]],
        (motor["binds"] or "–").replace("_", " "),
        *map(_percent, margins),
        _percent(gear_margin(motor, found)),
        "–" if probability is None else f"{100 * probability:.3g} %",
    )


def _percent(margin: float | None) -> str:
    return "–" if margin is None else f"{100 * margin + 0.0:+.1f} %"
