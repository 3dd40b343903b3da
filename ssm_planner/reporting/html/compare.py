"""Two plans on one page: before and after, two motors, two designs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ssm_planner.formats.plan_json import PlanFile, read_plan
from ssm_planner.reporting.figures.style import COLOURS
from ssm_planner.reporting.html.elements import Markup, table, tag
from ssm_planner.reporting.html.header import unknowns, verdict
from ssm_planner.reporting.html.page import page
from ssm_planner.reporting.html.panels import Panel
from ssm_planner.reporting.html.report import stage, write_page
from ssm_planner.reporting.html.scene import scene_of
from ssm_planner.reporting.html.series import channels_of, encoded, panels_of, time_grid
from ssm_planner.reporting.html.tables import percent
from ssm_planner.verification.certificate import Certificate

LEFT_OUT = ("What the motor torque is spent on",)
NAMES = ("A", "B")


def write_comparison(first: Path, second: Path, out: Path) -> Path:
    """Write the comparison of two plan.json files. Raises TrajectoryError or ProblemError, ExportError (the page)."""
    return write_page(out, comparison_page(read_plan(first), read_plan(second)))


def comparison_page(first: PlanFile, second: PlanFile) -> str:
    """The comparison of two plans as an HTML document."""
    plans = first, second
    tables = (_limits(first.certificate, second.certificate), _motors(first, second))
    body = Markup(_header(plans) + stage() + "".join(tables) + "</div></main>")
    title = f"{_name(first)} against {_name(second)} – plan comparison"
    return page(title, body, comparison_data(plans), ("maps.js", "compare.js"))


def comparison_data(plans: tuple[PlanFile, PlanFile]) -> dict[str, Any]:
    """What the page's scripts read; both plans on one time grid, the shorter one held at its end."""
    duration = max(plan.trajectory.duration for plan in plans)
    t = time_grid(duration)
    channels = [channels_of(plan, t) for plan in plans]
    return {
        "duration": duration,
        "ends": [plan.trajectory.duration for plan in plans],
        "colours": list(COLOURS),
        "joints": [{"name": joint.name, "kind": joint.kind} for joint in plans[0].robot.joints],
        "panels": _together(*(panels_of(plan, each) for plan, each in zip(plans, channels, strict=True))),
        "scenes": [scene_of(plan.robot, plan.limits) for plan in plans],
        "channels": [encoded(each) for each in channels],
    }


def _header(plans: tuple[PlanFile, PlanFile]) -> Markup:
    titles = [f"{name}: {_name(plan)} on {plan.robot.name}" for name, plan in zip(NAMES, plans, strict=True)]
    verdicts = (tag("div", tag("h2", title), verdict(plan)) for title, plan in zip(titles, plans, strict=True))
    rows = []
    for key, name in (
        ("duration", "duration s"),
        ("lower_bound", "lower bound s"),
        ("toppra_duration", "TOPP-RA s"),
    ):
        rows.append((name, *_pair([plan.document.get(key) for plan in plans])))
    gaps = [plan.document.get("gap") for plan in plans]
    rows.append(("gap %", *_pair([None if gap is None else 100 * gap for gap in gaps], relative=False)))
    notes = (tag("div", tag("h3", f"{name}"), unknowns(plan.document)) for name, plan in zip(NAMES, plans, strict=True))
    details = tag("details", tag("summary", "Placeholder, extrapolated or not checked"), *notes)
    figures = table(("", "A", "B", "change"), rows, numbers=(1, 2, 3))
    return tag("header", tag("h1", "Two plans"), *verdicts, figures, details)


def _limits(first: Certificate | None, second: Certificate | None) -> Markup:
    margins = [_margins(certificate) for certificate in (first, second)]
    rows = []
    for key in sorted(margins[0].keys() | margins[1].keys(), key=lambda key: min(m.get(key, 1e9) for m in margins)):
        a, b = (each.get(key) for each in margins)
        change = "–" if a is None or b is None else percent(b - a)
        rows.append((*key, *("–" if m is None else percent(m) for m in (a, b)), change))
    header = ("limit", "joint", "margin A", "margin B", "change")
    return tag("section", tag("h2", "Certificates"), table(header, rows, numbers=(2, 3, 4)), id="certificate")


def _margins(certificate: Certificate | None) -> dict[tuple[str, str], float]:
    if certificate is None:
        return {}
    return {(limit.name, limit.joint or ""): limit.margin for limit in certificate.limits}


def _motors(first: PlanFile, second: PlanFile) -> Markup:
    sides = [{str(motor["joint"]): motor for motor in plan.document.get("motors") or []} for plan in (first, second)]
    rows = []
    for joint in sides[0].keys() | sides[1].keys():
        a, b = (side.get(joint, {}) for side in sides)
        names = f"{a.get('motor') or '–'} / {b.get('motor') or '–'}" if a.get("motor") != b.get("motor") else a["motor"]
        for key, name, scale in (
            ("peak_torque", "peak torque mN·m", 1e3),
            ("rms_torque", "RMS torque mN·m", 1e3),
            ("peak_speed", "peak speed rad/s", 1.0),
        ):
            values = [None if key not in side else scale * side[key] for side in (a, b)]
            rows.append((joint, names or "–", name, *_pair(values)))
    rows.sort(key=lambda row: row[0])
    header = ("joint", "motor", "", "A", "B", "change")
    return tag("section", tag("h2", "Motors"), table(header, rows, numbers=(3, 4, 5)), id="motors")


def _pair(values: Sequence[float | None], relative: bool = True) -> tuple[str, str, str]:
    """A's value, B's, and the change."""
    first, second = ("–" if value is None else f"{value:.5g}" for value in values)
    a, b = values
    if a is None or b is None or (relative and not a):
        return first, second, "–"
    return first, second, f"{100 * (b / a - 1):+.2f} %" if relative else f"{b - a:+.3g}"


def _name(plan: PlanFile) -> str:
    return str(plan.document["problem"].get("name", plan.path.stem))


def _together(first: list[Panel], second: list[Panel]) -> list[Panel]:
    """One panel for each single quantity, with both plans' limits; colour 0 is A's, 1 is B's."""
    merged: dict[tuple[str, str], Panel] = {}
    for side, panels in enumerate((first, second)):
        for panel in (single for each in panels if each["section"] not in LEFT_OUT for single in _singles(each)):
            key = panel["section"], panel["channel"]
            held = merged.setdefault(key, {**panel, "limits": [], "active": [], "sides": []})
            held["sides"].append(side)
            for limit in panel["limits"]:
                known = [(each["name"], each["low"], each["high"]) for each in held["limits"]]
                if (limit["name"], limit["low"], limit["high"]) not in known:
                    held["limits"].append({**limit, "of": NAMES[side]})
            for stretch in panel["active"]:
                held["active"].append({**stretch, "joint": side, "label": f"{NAMES[side]}: {stretch['label']}"})
    return list(merged.values())


def _singles(panel: Panel) -> Iterator[Panel]:
    """A panel for each of its series."""
    for series in panel["series"]:
        mine = [limit for limit in panel["limits"] if limit["joint"] == series["joint"]]
        active = [stretch for stretch in panel["active"] if stretch["joint"] == series["joint"]]
        title = panel["title"]
        if len(panel["series"]) > 1:
            title = f"{title.partition(':')[0]}: {series['label']}"
        own = {"title": title, "channel": series["channel"], "series": [series], "limits": mine, "active": active}
        yield {**panel, **own, "missing": []}
