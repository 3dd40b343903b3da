"""The tables of the page: certificate, phases, motors, problem, provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from typing import Any

from ssm_planner.formats.plan_json import PlanFile
from ssm_planner.problem.robot import Joint
from ssm_planner.reporting.figures.style import RPM, unit_of
from ssm_planner.reporting.html.elements import Markup, join, table, tag
from ssm_planner.reporting.html.header import sizing
from ssm_planner.reporting.html.tool import limit_rows
from ssm_planner.verification.certificate import LimitCheck


def certificate(plan: PlanFile) -> Markup:
    """Every limit with its worst value; the page's script sorts it, "at" moves the scrubber."""
    if plan.certificate is None:
        return tag("section", tag("h2", "Certificate"), tag("p", "This plan holds no certificate."), id="certificate")
    limits = sorted(plan.certificate.limits, key=lambda limit: limit.margin)
    columns = ("limit", "joint", "worst", "allowed", "unit", "margin", "at", "")
    head = tag("thead", tag("tr", *(_column(name, i) for i, name in enumerate(columns))))
    body = tag("tbody", *map(_limit_row, limits))
    text = (
        "Found by code that did not plan the motion, on its exact polynomials. Margin: (limit − worst)/limit, for a range "
        "the distance to its nearer end by half its width; negative: violated."
    )
    note = f"Interpolation: {plan.certificate.interpolation}; {plan.certificate.instants:,} instants."
    frame = tag("div", tag("table", head, body, class_="sortable"), class_="scroll")
    return tag("section", tag("h2", "Certificate"), tag("p", text, " ", note), frame, id="certificate")


def _column(name: str, i: int) -> Markup:
    if not name:
        return tag("th", tag("span", "verdict", class_="hidden"), scope="col")
    order = "ascending" if name == "margin" else None
    kind = "number" if name in ("worst", "allowed", "margin", "at") else "text"
    button = tag("button", name, type="button", data_column=i)
    return tag("th", button, scope="col", class_=kind, aria_sort=order)


def _limit_row(limit: LimitCheck) -> Markup:
    unit, scale = unit_of("rpm" if limit.name == "motor speed" else limit.unit)
    word = "kept" if limit.passed else "violated"
    moment = tag("button", f"{limit.time:.3f} s", type="button", class_="moment", data_time=str(limit.time))
    return tag(
        "tr",
        tag("td", limit.name),
        tag("td", limit.joint or ""),
        tag("td", f"{scale * limit.worst + 0.0:.6g}", class_="number", data_value=str(limit.worst)),
        tag("td", f"{scale * limit.limit + 0.0:.6g}", class_="number", data_value=str(limit.limit)),
        tag("td", unit),
        tag("td", percent(limit.margin), class_="number", data_value=str(limit.margin)),
        tag("td", moment, class_="number", data_value=str(limit.time)),
        tag("td", word, class_="state"),
        class_=None if limit.passed else "violated",
    )


def phases(document: Mapping[str, Any]) -> Markup:
    """Duration of every phase beside TOPP-RA's and the bound."""
    rows = [
        (str(phase["name"]), *(_figure(phase.get(key)) for key in ("duration", "toppra_duration", "lower_bound")))
        for phase in document.get("phases") or []
    ]
    total = ("total", *(_figure(document.get(key)) for key in ("duration", "toppra_duration", "lower_bound")))
    header = ("phase", "duration s", "TOPP-RA s", "lower bound s")
    return tag("section", tag("h2", "Phases"), table(header, [*rows, total], numbers=(1, 2, 3)), id="phases")


def motors(plan: PlanFile) -> Markup:
    """What the motion requires of each motor beside the motor file's figures."""
    joints = {joint.name: joint for joint in plan.robot.joints}
    rows = []
    for required in plan.document.get("motors") or []:
        motor = joints[required["joint"]].motor
        have = ("–",) * 3
        if motor is not None:
            have = f"{1e3 * motor.max_torque:.4g}", f"{1e3 * motor.nominal_torque:.4g}", f"{RPM * motor.max_speed:.0f}"
        need = (
            f"{1e3 * required['peak_torque']:.4g}",
            f"{1e3 * required['rms_torque']:.4g}",
            f"{RPM * required['peak_speed']:.0f}",
        )
        pairs = (f"{a} of {b}" for a, b in zip(need, have, strict=True))
        source = "–" if motor is None else str(len(motor.placeholders) or "none")
        rows.append((required["joint"], motor.name if motor else "no motor given", *pairs, source))
    header = ("joint", "motor", "peak torque mN·m", "RMS torque mN·m", "peak speed rpm", "placeholder figures")
    return tag("section", tag("h2", "Motors"), table(header, rows, numbers=(2, 3, 4, 5)), id="motors")


def problem(plan: PlanFile) -> Markup:
    """The problem and the robot as resolved."""
    stated = plan.document["problem"]
    moves = [(str(m["name"]), str(m["kind"]), _target(m)) for m in stated.get("motion") or []]
    moves.insert(0, ("start", "", _target({"target": stated.get("start")})))
    return tag(
        "section",
        tag("h2", "Problem"),
        table(("motion", "kind", "to"), moves, caption="Motion"),
        table(("limit", "from", "to", "unit"), limit_rows(plan.limits), caption="Limits of the task", numbers=(1, 2)),
        table(JOINT_COLUMNS, map(_joint_row, plan.robot.joints), caption="Joints", numbers=(2, 3, 4, 5)),
        *(_sources(joint) for joint in plan.robot.joints),
        id="problem",
    )


JOINT_COLUMNS = ("joint", "kind", "position", "velocity", "acceleration", "jerk", "drive", "motor")


def _joint_row(joint: Joint) -> Sequence[str]:
    unit, scale = unit_of("rad" if joint.kind == "revolute" else "m")
    jerk = "–" if joint.jerk is None else f"{scale * joint.jerk:g} {unit}/s³"
    return (
        joint.name,
        joint.kind,
        f"{scale * joint.position[0]:g} … {scale * joint.position[1]:g} {unit}",
        f"{scale * joint.velocity:g} {unit}/s",
        f"{scale * joint.acceleration:g} {unit}/s²",
        jerk,
        "–" if joint.drive is None else joint.drive.name,
        "–" if joint.motor is None else joint.motor.name,
    )


def _sources(joint: Joint) -> Markup | None:
    """Where the figures of a joint's drive and motor come from."""
    rows = [
        (part, key, source, "placeholder" if key in owner.placeholders else "")
        for part, owner in (("drive", joint.drive), ("motor", joint.motor))
        if owner is not None
        for key, source in owner.sources.items()
    ]
    if not rows:
        return None
    title = tag("summary", f"Sources of the figures of joint {joint.name}")
    return tag("details", title, table(("of", "figure", "source", ""), rows))


def provenance(plan: PlanFile) -> Markup:
    """Versions, files and the plan's fingerprint."""
    document = plan.document
    rows = [(str(name), str(version)) for name, version in (document.get("software") or {}).items()]
    stated = document["problem"]
    rows += [
        ("problem file", str(stated.get("file"))),
        ("robot file", str(plan.robot.file)),
        ("plan file", plan.path.name),
        ("SHA-256 of the plan file", plan.sha256),
        ("page made", datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC")),
    ]
    solved = document.get("solve_time")
    if solved is not None:
        rows.append(("time to plan", f"{solved:.2f} s"))
    return tag("section", tag("h2", "Provenance"), table(("what", "which"), rows), id="provenance")


def percent(share: float) -> str:
    """A margin with its sign, without a negative zero."""
    return f"{round(100 * share, 4) + 0.0:+.4f} %"


def _target(motion: Mapping[str, Any]) -> str:
    if motion.get("duration") is not None:
        return f"{motion['duration']:g} s"
    target = motion.get("target") or {}
    for name in ("joints", "tip"):
        if target.get(name):
            return f"{name} " + ", ".join(f"{value:.6g}" for value in target[name]) + " (rad, m)"
    words = []
    for name, value in (target.get("task") or {}).items():
        unit, scale = unit_of("m" if name == "depth" else "rad")
        words.append(f"{name} {scale * value:.6g} {unit}")
    return ", ".join(words)


def _figure(value: Any) -> str:
    return "–" if value is None else f"{value:.4f}"


def all_tables(plan: PlanFile) -> Markup:
    """The sections after the plots, in the order of the page."""
    return join((certificate(plan), phases(plan.document), motors(plan), sizing(plan), problem(plan), provenance(plan)))
