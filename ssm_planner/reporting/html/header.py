"""The top of the page: the verdict in one line, the figures behind it, and what is not known.

The section of the page on motors and gears: margins of every check, and what could not be checked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ssm_planner.formats.plan_json import PlanFile
from ssm_planner.reporting.html.elements import Markup, join, table, tag
from ssm_planner.reporting.text.sizing import ANSWERS, gear_margin, missing_figures, motors_verdict


def header(plan: PlanFile) -> Markup:
    """Title, verdict, figures and unknowns of one plan."""
    name = str(plan.document["problem"].get("name", plan.path.stem))
    return tag(
        "header",
        tag("h1", name, tag("span", f" on {plan.robot.name}", class_="robot")),
        verdict(plan),
        figures(plan.document),
        unknowns(plan.document),
    )


def verdict(plan: PlanFile) -> Markup:
    """Planned, certified and what the motors say: one line of three marked words with their reasons."""
    parts = [_feasible(plan.document), _certified(plan), motors_verdict(plan.sizing)]
    return tag("p", *(_mark(*part) for part in parts), class_="verdict")


def figures(document: dict[str, Any]) -> Markup:
    """Duration, lower bound, gap, TOPP-RA's time."""
    duration, bound, gap, toppra = (document.get(key) for key in ("duration", "lower_bound", "gap", "toppra_duration"))
    pairs = [
        ("Duration", _seconds(duration), ""),
        ("Lower bound", _seconds(bound), "no motion on this path can be shorter"),
        ("Gap", "–" if gap is None else f"{100 * gap:.2f} %", "duration above the bound"),
        ("TOPP-RA", _seconds(toppra), _against(duration, toppra)),
    ]
    cells = [tag("div", tag("dt", name), tag("dd", value, tag("small", note))) for name, value, note in pairs]
    return tag("dl", *cells, class_="figures")


def unknowns(document: dict[str, Any]) -> Markup:
    """What is a placeholder, extrapolated or not checked."""
    notes = [str(note) for note in document.get("notes") or []]
    if not notes:
        return tag("p", "Nothing is a placeholder, extrapolated or left unchecked.", class_="unknowns")
    items = join(tag("li", note) for note in notes)
    title = f"Placeholder, extrapolated or not checked ({len(notes)})"
    return tag("details", tag("summary", title), tag("ul", items), class_="unknowns", open=True)


def _feasible(document: dict[str, Any]) -> tuple[str, str, str]:
    status = str(document.get("status"))
    return ("good", "Feasible", "") if status == "solved" else ("bad", "No plan", status)


def _certified(plan: PlanFile) -> tuple[str, str, str]:
    certificate = plan.certificate
    if certificate is None:
        return "bad", "Not certified", "the plan holds no certificate"
    if not certificate.passed:
        worst = certificate.worst
        of = f" of joint {worst.joint}" if worst.joint else ""
        return "bad", "Not certified", f"{worst.name}{of} exceeded at {worst.time:.3f} s"
    return "good", "Certified", f"{len(certificate.limits)} limits kept at {certificate.instants:,} instants"


def _mark(state: str, word: str, reason: str) -> Markup:
    symbol = {"good": "✓", "bad": "✗", "open": "?"}[state]
    icon = tag("span", symbol, class_="icon", aria_hidden="true")
    return tag("span", icon, tag("strong", word), f" {reason}" if reason else None, class_=f"mark {state}")


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f} s"


def _against(duration: float | None, toppra: float | None) -> str:
    if not duration or not toppra:
        return ""
    return f"this plan: {100 * (duration / toppra - 1):+.3f} %"


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
