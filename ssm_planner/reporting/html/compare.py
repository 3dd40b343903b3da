"""Write a page that compares two plans."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ssm_planner.display import NOTHING, number, percent, signed
from ssm_planner.plans import Plan
from ssm_planner.reporting.figures.style import COLOURS
from ssm_planner.reporting.html.channels import channels_of, encoded, time_grid
from ssm_planner.reporting.html.page import render, write_page
from ssm_planner.reporting.html.panels import Panel, panels_of
from ssm_planner.reporting.html.report import verdict
from ssm_planner.reporting.html.scene import scene_of
from ssm_planner.reporting.text import Table
from ssm_planner.units import RPM
from ssm_planner.verification.certificate import Certificate

LEFT_OUT = ("Parts of the motor torque",)
NAMES = ("A", "B")


def write_comparison(first: Plan, second: Plan, out: Path) -> Path:
    """Write the comparison of two plans. Raises ExportError."""
    return write_page(out, comparison_page(first, second), first.sha256)


def comparison_page(first: Plan, second: Plan) -> str:
    """Return the comparison of two plans as an HTML document."""
    plans = first, second
    return render(
        "compare.html",
        comparison_data(plans),
        title=f"{first.problem.name} against {second.problem.name} – plan comparison",
        plans=[
            {
                "letter": letter,
                "title": f"{letter}: {plan.problem.name} on {plan.robot.name}",
                "marks": verdict(plan),
                "notes": plan.notes,
            }
            for letter, plan in zip(NAMES, plans, strict=True)
        ],
        joints=first.robot.joints,
        durations=_durations(plans),
        limits=_limits(first.certificate, second.certificate),
        motors=_motors(first, second),
    )


def comparison_data(plans: tuple[Plan, Plan]) -> dict[str, Any]:
    """Return the data for the scripts of the page.

    Both plans have the same time grid. The shorter plan holds its last position.
    """
    duration = max(plan.motion.duration for plan in plans)
    t = time_grid(duration)
    channels = [channels_of(plan, t) for plan in plans]
    # Held values after the end of a plan are no activity.
    played = [t <= plan.motion.duration + 1e-9 for plan in plans]
    return {
        "duration": duration,
        "ends": [plan.motion.duration for plan in plans],
        "colours": list(COLOURS),
        "panels": _together(
            *(
                panels_of(plan, {name: values[inside] for name, values in each.items()})
                for plan, each, inside in zip(plans, channels, played, strict=True)
            )
        ),
        "scenes": [scene_of(plan.robot, plan.limits) for plan in plans],
        "channels": [encoded(each) for each in channels],
    }


def _durations(plans: tuple[Plan, Plan]) -> Table:
    gaps = [None if plan.gap is None else 100 * plan.gap for plan in plans]
    rows = [
        ("duration s", *_pair([plan.duration for plan in plans])),
        ("lower bound s", *_pair([plan.lower_bound for plan in plans])),
        ("TOPP-RA s", *_pair([plan.toppra_duration for plan in plans])),
        ("above the lower bound %", *_pair(gaps, relative=False)),
    ]
    return Table(("", "A", "B", "change"), rows, (1, 2, 3))


def _limits(first: Certificate | None, second: Certificate | None) -> Table:
    margins = [_margins(certificate) for certificate in (first, second)]
    rows = []
    keys = margins[0].keys() | margins[1].keys()
    for key in sorted(keys, key=lambda key: (min(m.get(key, math.inf) for m in margins), key)):
        a, b = (each.get(key) for each in margins)
        change = None if a is None or b is None else b - a
        rows.append((*key, *(percent(share, 4) for share in (a, b, change))))
    return Table(("limit", "joint", "margin A", "margin B", "change"), rows, (2, 3, 4))


def _margins(certificate: Certificate | None) -> dict[tuple[str, str], float]:
    if certificate is None:
        return {}
    return {(limit.name, limit.joint or ""): limit.margin for limit in certificate.limits}


def _motors(first: Plan, second: Plan) -> Table:
    sides = [{r.joint: r.to_dict() for r in plan.requirements} for plan in (first, second)]
    rows = []
    for joint in sides[0].keys() | sides[1].keys():
        a, b = (side.get(joint, {}) for side in sides)
        motors = dict.fromkeys(side.get("motor") or NOTHING for side in (a, b))
        for key, name, scale in (
            ("peak_torque", "peak torque mN·m", 1e3),
            ("rms_torque", "RMS torque mN·m", 1e3),
            ("peak_speed", "peak speed rpm", RPM),
        ):
            values = [None if key not in side else scale * side[key] for side in (a, b)]
            rows.append((joint, " / ".join(motors), name, *_pair(values)))
    rows.sort(key=lambda row: row[0])
    return Table(("joint", "motor", "", "A", "B", "change"), rows, (3, 4, 5))


def _pair(values: Sequence[float | None], relative: bool = True) -> tuple[str, str, str]:
    """Return the values of A and B and their change as text."""
    a, b = values
    change = NOTHING
    if a is not None and b is not None and (a or not relative):
        change = percent(b / a - 1, 2) if relative else signed(b - a, 2)
    return number(a, 5), number(b, 5), change


def _together(first: list[Panel], second: list[Panel]) -> list[Panel]:
    """Return one panel for each quantity with the limits of both plans.

    Colour 0 belongs to A and colour 1 to B. A limit has a colour if only one plan has it.
    """
    merged: dict[tuple[str, str], Panel] = {}
    for side, panels in enumerate((first, second)):
        for panel in (
            single
            for line in panels
            if line["section"] not in LEFT_OUT
            for single in _singles(line)
        ):
            key = panel["section"], panel["channel"]
            shared = merged.setdefault(key, {**panel, "limits": [], "active": [], "sides": []})
            shared["sides"].append(side)
            for limit in panel["limits"]:
                same = [
                    line
                    for line in shared["limits"]
                    if all(line[key] == limit[key] for key in ("name", "low", "high"))
                ]
                for line in same:
                    line["side"] = None
                if not same:
                    shared["limits"].append({**limit, "of": NAMES[side], "side": side})
            for stretch in panel["active"]:
                shared["active"].append(
                    {**stretch, "joint": side, "label": f"{NAMES[side]}: {stretch['label']}"}
                )
    return list(merged.values())


def _singles(panel: Panel) -> Iterator[Panel]:
    """Yield one panel for each series of a panel."""
    for series in panel["series"]:
        limits = [limit for limit in panel["limits"] if limit["joint"] == series["joint"]]
        active = [stretch for stretch in panel["active"] if stretch["joint"] == series["joint"]]
        title = panel["title"]
        if len(panel["series"]) > 1:
            title = f"{title.partition(':')[0]}: {series['label']}"
        content = {
            "title": title,
            "channel": series["channel"],
            "series": [series],
            "limits": limits,
            "active": active,
        }
        yield {**panel, **content, "missing": []}
