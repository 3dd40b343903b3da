"""The section of the page on motors and gears: margins of every check, and what could not be checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ssm_planner.exports.plan_file import PlanFile
from ssm_planner.report.html_elements import Markup, table, tag
from ssm_planner.report.sizing_words import ANSWERS, gear_margin, missing_figures, motors_verdict

MARGINS = ("torque", "speed", "continuous_torque", "voltage", "heat")
CONDITIONS = (
    "The motion repeated without pause in surroundings of 25 °C. Margins (limit − worst)/limit, worst at the "
    "stated confidence where the friction's uncertainty is known. “–”: a figure is missing."
)


def sizing(plan: PlanFile) -> Markup:
    """Which motors and gears suffice, by what margins, and what is not known."""
    found = plan.sizing
    columns = [_column(motor, found) for motor in found["motors"]]
    unknown = list(missing_figures(found))
    details = None
    if unknown:
        open_ = table(("joint", "motor or gear", "not checked", "figures that are missing"), unknown)
        details = tag("details", tag("summary", "Figures that are missing"), open_, open=True)
    return tag(
        "section",
        tag("h2", "Whether the motors suffice"),
        tag("p", ": ".join(filter(None, motors_verdict(found)[1:])) + "."),
        tag("p", CONDITIONS),
        _side_by_side(columns) if columns else None,
        details,
        id="sizing",
    )


def _side_by_side(columns: Sequence[Mapping[str, str]]) -> Markup:
    """A table with one column for each motor."""
    first, *rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    return table(first, rows)


def _column(motor: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, str]:
    probability = motor["probability"]
    return {
        "joint": motor["joint"],
        "motor": motor["motor"],
        "its figures": "placeholders among them" if motor["placeholder"] else "with a source",
        "suffices": ANSWERS[motor["adequate"]],
        "binds": (motor["binds"] or "–").replace("_", " "),
        **{name.replace("_", " "): _percent(motor["margins"].get(name)) for name in MARGINS},
        "gear": _percent(gear_margin(motor, found)),
        "confidence": "–" if probability is None else f"{100 * probability:.3g} %",
    }


def _percent(margin: float | None) -> str:
    return "–" if margin is None else f"{100 * margin + 0.0:+.1f} %"
