"""report.html: one plan as a self-contained page made from plan.json alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Joint
from ssm_planner.reporting.figures.style import COLOURS, FIFTH, RPM, unit_of
from ssm_planner.reporting.html.channels import channels_of, encoded, time_grid
from ssm_planner.reporting.html.page import Table, render, write_page
from ssm_planner.reporting.html.panels import TEMPERATURE, limit_rows, motor_map, panels_of, without_temperature
from ssm_planner.reporting.html.scene import scene_of
from ssm_planner.reporting.text import ANSWERS, MOTOR_MARGINS, gear_margin, missing_figures, motors_verdict
from ssm_planner.verification.certificate import LimitCheck

JOINT_COLUMNS = ("joint", "kind", "position", "velocity", "acceleration", "jerk", "drive", "motor")
Mark = tuple[str, str, str]
"""("good", "bad" or "open", a word, its reason)."""


def write_report(plan: Plan, out: Path) -> Path:
    """Write the report of a plan. Raises ExportError."""
    return write_page(out, report_page(plan))


def report_page(plan: Plan) -> str:
    """The report of a plan as an HTML document."""
    limits = () if plan.certificate is None else plan.certificate.limits
    return render(
        "report.html",
        report_data(plan),
        title=f"{plan.document['problem'].get('name')} – plan report",
        name=name_of(plan),
        robot=plan.robot.name,
        marks=verdict(plan),
        figures=_figures(plan.document),
        notes=unknowns(plan),
        certificate=plan.certificate,
        limits=[_limit_row(limit) for limit in sorted(limits, key=lambda limit: limit.margin)],
        phases=_phases(plan.document),
        motors=_motors(plan),
        sizing=_sizing(plan),
        motion=_motion(plan),
        task_limits=Table(("limit", "from", "to", "unit"), limit_rows(plan.limits), (1, 2), "Limits of the task"),
        joints=Table(JOINT_COLUMNS, [_joint_row(joint) for joint in plan.robot.joints], (2, 3, 4, 5), "Joints"),
        sources=[(joint.name, table) for joint in plan.robot.joints if (table := _sources(joint)).rows],
        provenance=_provenance(plan),
    )


def report_data(plan: Plan) -> dict[str, Any]:
    """What the page's scripts read: channels, panels, phases, joints and scene."""
    channels = channels_of(plan, time_grid(plan.motion.duration))
    motors = {i: joint.motor for i, joint in enumerate(plan.robot.joints) if joint.motor is not None and joint.drive}
    start = float(plan.motion.breaks[0])
    return {
        "duration": plan.motion.duration,
        "colours": [*COLOURS, FIFTH],
        "phases": [{"name": p.name, "start": p.start - start, "end": p.end - start} for p in plan.motion.phases],
        "joints": [{"name": joint.name, "kind": joint.kind} for joint in plan.robot.joints],
        "panels": panels_of(plan, channels),
        "maps": [motor_map(i, motor) for i, motor in motors.items()],
        "notes": {TEMPERATURE: without_temperature(channels, motors)},
        "scene": scene_of(plan.robot, plan.limits),
        "channels": encoded(channels),
    }


def name_of(plan: Plan) -> str:
    """The problem's name, or the file's where it has none."""
    return str(plan.document["problem"].get("name", plan.path.stem))


def verdict(plan: Plan) -> list[Mark]:
    """Whether the motion is planned, certified and possible with the motors."""
    return [_feasible(plan.document), _certified(plan), motors_verdict(plan.document["sizing"])]


def unknowns(plan: Plan) -> list[str]:
    """What is a placeholder, extrapolated or not checked."""
    return [str(note) for note in plan.document.get("notes") or []]


def percent(share: float) -> str:
    """A margin with its sign, without a negative zero."""
    return f"{round(100 * share, 4) + 0.0:+.4f} %"


def _feasible(document: dict[str, Any]) -> Mark:
    status = str(document.get("status"))
    return ("good", "Feasible", "") if status == "solved" else ("bad", "No plan", status)


def _certified(plan: Plan) -> Mark:
    certificate = plan.certificate
    if certificate is None:
        return "bad", "Not certified", "the plan holds no certificate"
    if not certificate.passed:
        worst = certificate.worst
        of = f" of joint {worst.joint}" if worst.joint else ""
        return "bad", "Not certified", f"{worst.name}{of} exceeded at {worst.time:.3f} s"
    return "good", "Certified", f"{len(certificate.limits)} limits kept at {certificate.instants:,} instants"


def _figures(document: dict[str, Any]) -> list[tuple[str, str, str]]:
    """(name, value, note) of duration, lower bound, gap, TOPP-RA's time."""
    duration, bound, gap, toppra = (document.get(key) for key in ("duration", "lower_bound", "gap", "toppra_duration"))
    against = f"this plan: {100 * (duration / toppra - 1):+.3f} %" if duration and toppra else ""
    return [
        ("Duration", _seconds(duration), ""),
        ("Lower bound", _seconds(bound), "no motion on this path can be shorter"),
        ("Gap", "–" if gap is None else f"{100 * gap:.2f} %", "duration above the bound"),
        ("TOPP-RA", _seconds(toppra), against),
    ]


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f} s"


def _limit_row(limit: LimitCheck) -> dict[str, Any]:
    """One row of the certificate: the limit in SI for the script that sorts, and its cells as text."""
    unit, scale = unit_of("rpm" if limit.name == "motor speed" else limit.unit)
    return {
        "limit": limit,
        "name": limit.name,
        "joint": limit.joint or "",
        "worst": f"{scale * limit.worst + 0.0:.6g}",
        "allowed": f"{scale * limit.limit + 0.0:.6g}",
        "unit": unit,
        "margin": percent(limit.margin),
    }


def _phases(document: Mapping[str, Any]) -> Table:
    """Duration of every phase beside TOPP-RA's and the bound."""
    entries = [(str(phase["name"]), phase) for phase in document.get("phases") or []]
    rows = []
    for name, entry in [*entries, ("total", document)]:
        durations = (entry.get(key) for key in ("duration", "toppra_duration", "lower_bound"))
        rows.append((name, *("–" if value is None else f"{value:.4f}" for value in durations)))
    return Table(("phase", "duration s", "TOPP-RA s", "lower bound s"), rows, (1, 2, 3))


def _motors(plan: Plan) -> Table:
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
    return Table(header, rows, (2, 3, 4, 5))


def _sizing(plan: Plan) -> dict[str, Any]:
    """Which motors and gears suffice, by what margins (one column for each motor), and which figures are missing."""
    found = plan.document["sizing"]
    columns = [_motor_column(motor, found) for motor in found["motors"]]
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]] if columns else [("joint",)]
    return {
        "verdict": ": ".join(filter(None, motors_verdict(found)[1:])),
        "motors": Table(rows[0], rows[1:]),
        "missing": Table(
            ("joint", "motor or gear", "not checked", "figures that are missing"), [*missing_figures(found)]
        ),
    }


def _motor_column(motor: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, str]:
    probability = motor["probability"]
    return {
        "joint": motor["joint"],
        "motor": motor["motor"],
        "its figures": "placeholders among them" if motor["placeholder"] else "with a source",
        "suffices": ANSWERS[motor["adequate"]],
        "binds": (motor["binds"] or "–").replace("_", " "),
        **{name.replace("_", " "): _margin(motor["margins"].get(name)) for name in MOTOR_MARGINS},
        "gear": _margin(gear_margin(motor, found)),
        "confidence": "–" if probability is None else f"{100 * probability:.3g} %",
    }


def _margin(margin: float | None) -> str:
    return "–" if margin is None else f"{100 * margin + 0.0:+.1f} %"


def _motion(plan: Plan) -> Table:
    """The start and every entry of the motion as stated in the problem."""
    stated = plan.document["problem"]
    start = ("start", "", _target({"target": stated.get("start")}))
    moves = [(str(m["name"]), str(m["kind"]), _target(m)) for m in stated.get("motion") or []]
    return Table(("motion", "kind", "to"), [start, *moves], caption="Motion")


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


def _joint_row(joint: Joint) -> tuple[str, ...]:
    unit, scale = unit_of("rad" if joint.kind == "revolute" else "m")
    low, high = joint.position
    return (
        joint.name,
        joint.kind,
        f"{scale * low:g} … {scale * high:g} {unit}",
        f"{scale * joint.velocity:g} {unit}/s",
        f"{scale * joint.acceleration:g} {unit}/s²",
        "–" if joint.jerk is None else f"{scale * joint.jerk:g} {unit}/s³",
        "–" if joint.drive is None else joint.drive.name,
        "–" if joint.motor is None else joint.motor.name,
    )


def _sources(joint: Joint) -> Table:
    """Where the figures of a joint's drive and motor come from."""
    rows = [
        (part, key, source, "placeholder" if key in owner.placeholders else "")
        for part, owner in (("drive", joint.drive), ("motor", joint.motor))
        if owner is not None
        for key, source in owner.sources.items()
    ]
    return Table(("of", "figure", "source", ""), rows)


def _provenance(plan: Plan) -> Table:
    """Versions, files and the plan's fingerprint."""
    return Table(("what", "which"), list(_origin(plan)))


def _origin(plan: Plan) -> Iterator[tuple[str, str]]:
    for name, version in (plan.document.get("software") or {}).items():
        yield str(name), str(version)
    yield "problem file", str(plan.document["problem"].get("file"))
    yield "robot file", str(plan.robot.file)
    yield "plan file", plan.path.name
    yield "SHA-256 of the plan file", plan.sha256
