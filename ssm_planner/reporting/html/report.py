"""Write report.html, a self-contained page built only from plan.json."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.display import NOTHING, format_fixed, number
from ssm_planner.plans import PhaseSummary, Plan
from ssm_planner.problem.limits import (
    JUMPS,
    TASK,
    JointAcceleration,
    JointJerk,
    JointVelocity,
    MotorSpeed,
    MotorTorque,
)
from ssm_planner.problem.robot import Joint
from ssm_planner.problem.serialization import plain
from ssm_planner.reporting.figures.film import still
from ssm_planner.reporting.figures.style import COLOURS, FIFTH
from ssm_planner.reporting.html.channels import channels_of, encoded, time_grid
from ssm_planner.reporting.html.outcome import write_outcome
from ssm_planner.reporting.html.page import render, write_page
from ssm_planner.reporting.html.panels import (
    TEMPERATURE,
    Panel,
    limit_rows,
    motor_map,
    panels_of,
    without_temperature,
)
from ssm_planner.reporting.html.scene import scene_of
from ssm_planner.reporting.text import (
    MOTOR_MARGINS,
    Table,
    candidates_table,
    closest_limit,
    confirmation,
    joints_table,
    limit_cells,
    missing_figures,
    motors_table,
    motors_verdict,
    phases_table,
    range_lines,
    rate_words,
)
from ssm_planner.typing import Array
from ssm_planner.units import display_unit
from ssm_planner.verification.certificate import Certificate, LimitCheck

JOINT_COLUMNS = ("joint", "kind", "position", "velocity", "acceleration", "jerk", "drive", "motor")
TIGHTEST = 10
"""Number of limits that the certificate always shows."""
MOST_PARTS = 5
"""Largest number of parts in the sentence about the motion."""
STILL = 1e-6
"""Largest change of an unchanged coordinate, rad or m."""
NOTABLE = 0.15
"""Fraction of the duration from which the sentence mentions an active limit."""
JOINT_LIMITS = tuple(
    kind.name for kind in (JointVelocity, JointAcceleration, JointJerk, MotorSpeed, MotorTorque)
)
LimitRow = tuple[LimitCheck, tuple[str, ...]]
"""A limit of the certificate and the cells of `limit_cells`."""
Mark = tuple[str, str, str]
"""("good", "bad" or "open", word, reason)."""


def write_report(plan: Plan, out: Path) -> Path:
    """Write the report of a plan. Raises ExportError."""
    return write_page(out, report_page(plan), plan.sha256)


def report_page(plan: Plan) -> str:
    """Return the report of a plan as an HTML document."""
    data = report_data(plan)
    return render(
        "report.html",
        data,
        title=f"{plan.problem.name} – plan report",
        name=plan.problem.name,
        robot=plan.robot.name,
        sentence=sentence(plan, data["panels"]),
        verdict_marks=verdict(plan),
        plan=plan,
        confirmation=confirmation(plan),
        ranges=range_lines(plan),
        notes=plan.notes,
        certificate=plan.certificate,
        closest=plan.certificate and closest_limit(plan.certificate.limits),
        tiers=_tiers(plan.certificate),
        phases=phases_table(plan),
        candidates=candidates_table(plan),
        ends=joints_table(plan),
        motors=motors_table(plan.requirements),
        stops=_stops(plan),
        sizing=judged(plan),
        margins=MOTOR_MARGINS,
        missing=Table(
            ("joint", "motor or gear", "not checked", "missing data"),
            [*missing_figures(judged(plan))],
        ),
        repeated=repeated(plan.problem.duty),
        problem=problem_tables(plan),
        still=still(plan),
    )


def write_no_plan(plan: Plan, out: Path) -> Path:
    """Write the page of a problem without a certified motion. Raises ExportError."""
    reason = plan.reason
    if reason is None:
        conclusion = f"The motion is not certified: {_certified(plan)[2]}."
    else:
        conclusion = f"No motion keeps every limit: {reason.message}."
        if reason.relaxation:
            conclusion += f" A change that permits a motion: {reason.relaxation}."
    return write_outcome(out, plan.problem.name, conclusion, tables=problem_tables(plan))


def problem_tables(plan: Plan) -> list[Table]:
    """Return the motion, the limits of the task and the joints of a problem as tables."""
    joints = [_joint_row(joint) for joint in plan.problem.robot.joints]
    limits = limit_rows(plan.limits)
    return [
        _motion(plan),
        Table(("limit", "from", "to", "unit"), limits, (1, 2), "Limits of the task"),
        Table(JOINT_COLUMNS, joints, (2, 3, 4, 5), "Joints"),
    ]


def repeated(duty: float | None) -> str:
    """Describe how often the motion is performed. duty: pause in s, or None for a single motion."""
    if duty is None:
        return "The motion done once, from cold,"
    return f"The motion repeated {f'after a pause of {duty:.6g} s' if duty else 'without pause'}"


def report_data(plan: Plan) -> dict[str, Any]:
    """Return the data for the scripts of the page: channels, panels, phases, joints and scene."""
    channels = channels_of(plan, time_grid(plan.motion.duration))
    motors = {
        i: joint.motor
        for i, joint in enumerate(plan.robot.joints)
        if joint.motor is not None and joint.drive
    }
    start = float(plan.motion.breaks[0])
    return {
        "duration": plan.motion.duration,
        "colours": [*COLOURS, FIFTH],
        "stops": _tip_stops(plan, channels),
        "phases": [
            {"name": p.name, "start": p.start - start, "end": p.end - start}
            for p in plan.motion.phases
        ],
        "joints": [{"name": joint.name, "kind": joint.kind} for joint in plan.robot.joints],
        "panels": panels_of(plan, channels),
        "maps": [motor_map(i, motor) for i, motor in motors.items()],
        "notes": {TEMPERATURE: without_temperature(channels, motors)},
        "scene": scene_of(plan.robot, plan.limits),
        "channels": encoded(channels),
    }


def sentence(plan: Plan, panels: list[Panel]) -> str:
    """Describe the motion, its duration and the limits that determine the duration."""
    groups: dict[str, list[PhaseSummary]] = {}
    for phase in plan.phases:
        groups.setdefault(
            phase.name.rpartition(", ")[0] or f"{phase.name} {len(groups)}", []
        ).append(phase)
    parts: list[str] = []
    for name, phases in groups.items():
        if len(phases) > 1:
            spots = sum(_is_spot(phase) for phase in phases)
            parts.append(
                f"visits {spots} spots ({name})" if spots else f"{name} in {len(phases)} phases"
            )
        else:
            parts += _changes(phases[0])
    shown_parts = parts if len(parts) <= MOST_PARTS else [f"makes {len(plan.phases)} phases"]
    text = f"{', '.join(shown_parts) or 'stands still'} in {_seconds(plan.duration, 2)}"
    limited = _limited_by(plan, panels)
    return text[0].upper() + text[1:] + (f"; limited by {limited}" if limited else "") + "."


def _changes(phase: PhaseSummary) -> Iterator[str]:
    """Describe the task coordinates that a phase changes."""
    for name, begin, end in zip(TASK, phase.task_start, phase.task_end, strict=True):
        if name == "depth" and abs(end - begin) > STILL:
            yield f"{'inserts' if end > begin else 'withdraws'} {number(1e3 * abs(end - begin), 3)} mm"
        elif name != "depth" and abs(end - begin) > STILL:
            first, last = (number(math.degrees(angle), 4) for angle in (begin, end))
            yield f"{name}s {first}° → {last}°"


def _limited_by(plan: Plan, panels: list[Panel]) -> str:
    """Name the speed and acceleration limits that are active longest, in descending order."""
    share: dict[str, dict[int, float]] = {}
    for stretch in (interval for panel in panels for interval in panel["active"]):
        if not stretch["name"].endswith(("range", "position", "clearance")):
            times = share.setdefault(stretch["name"], {})
            times[stretch["joint"]] = (
                times.get(stretch["joint"], 0.0) + stretch["end"] - stretch["start"]
            )
    longest = sorted(share, key=lambda name: -max(share[name].values()))
    named = [
        name for name in longest if max(share[name].values()) > NOTABLE * plan.motion.duration
    ][:2]
    return " and ".join(_of_joints(name, sorted(share[name])) for name in named)


def _of_joints(name: str, joints: list[int]) -> str:
    """Name a limit with the numbers of its joints. Names of tool limits need no addition."""
    quantity = {"velocity": "speed"}.get(name, name)
    if name not in JOINT_LIMITS:
        return f"the {quantity}"
    numbers = [str(i + 1) for i in joints]
    joint_numbers = " and ".join(filter(None, (", ".join(numbers[:-1]), numbers[-1])))
    return f"the {quantity} of joint{'s' if len(joints) > 1 else ''} {joint_numbers}"


def _is_spot(phase: PhaseSummary) -> bool:
    """Return True if the tool stands at a spot of a scan. Such phases are named after the scan."""
    return phase.task_start == phase.task_end and ", " in phase.name


def _tip_stops(plan: Plan, channels: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Return the tip position (m) at the end of every phase, and True for spots of a scan."""
    spots = {phase.name for phase in plan.phases if _is_spot(phase)}
    t, start = channels["t"], float(plan.motion.breaks[0])
    tip = np.column_stack([channels[f"tip{i}"] for i in range(3)])
    stops: dict[tuple[float, ...], bool] = {}
    for phase in plan.motion.phases:
        position = tuple(
            np.round(tip[min(int(np.searchsorted(t, phase.end - start)), len(t) - 1)], 5).tolist()
        )
        stops[position] = stops.get(position, False) or phase.name in spots
    return [{"position": list(position), "spot": spot} for position, spot in stops.items()]


def _tiers(certificate: Certificate | None) -> list[tuple[str, list[LimitRow]]]:
    """Group the limits of a certificate, smallest margin first.

    The groups are the tightest and all violated limits, other limits, and numerical continuity.
    """
    limits = () if certificate is None else certificate.limits
    rows: list[LimitRow] = [
        (check, limit_cells(check, "°")) for check in sorted(limits, key=lambda each: each.margin)
    ]
    numerical = [row for row in rows if row[0].name in JUMPS and row[0].passed]
    main_rows = [row for row in rows if row not in numerical]
    shown = max(TIGHTEST, sum(not check.passed for check, _ in main_rows))
    return [
        ("tightest", main_rows[:shown]),
        ("Other limits", main_rows[shown:]),
        ("Numerical continuity: jumps between polynomials, rest at both ends", numerical),
    ]


def verdict(plan: Plan) -> list[Mark]:
    """Return the marks for planning, certification and motors."""
    return [_feasible(plan), _certified(plan), motors_verdict(judged(plan))]


def judged(plan: Plan) -> dict[str, Any]:
    """Return the object that `size --json` prints for a plan with a trajectory."""
    assert plan.sizing is not None
    return plan.sizing.to_dict()


def _feasible(plan: Plan) -> Mark:
    return ("good", "Feasible", "") if plan.status == "solved" else ("bad", "No plan", plan.status)


def _certified(plan: Plan) -> Mark:
    certificate = plan.certificate
    if certificate is None:
        return "bad", "Not certified", plan.uncertified_reason or "the plan has no certificate"
    if not certificate.passed:
        worst = certificate.worst
        joint = f" of joint {worst.joint}" if worst.joint else ""
        return "bad", "Not certified", f"{worst.name}{joint} exceeded at {worst.time:.3f} s"
    return (
        "good",
        "Certified",
        f"{len(certificate.limits)} limits kept",
    )


def _seconds(value: float | None, decimals: int = 4) -> str:
    return NOTHING if value is None else f"{format_fixed(value, decimals)} s"


def _stops(plan: Plan) -> dict[str, Any] | None:
    """Return the longest of the controlled stops and the one with the longest travel."""
    stops = plan.stops
    if stops is None:
        return None
    broken = {f"{each.name} {each.joint or ''}".strip() for each in stops.certificate.violations}
    longest, farthest = int(np.argmax(stops.duration)), int(np.argmax(stops.travel))
    return {
        "count": len(stops.time),
        "passed": stops.passed,
        "broken": sorted(broken),
        "longest": (stops.time[longest], 1e3 * stops.duration[longest]),
        "farthest": (stops.time[farthest], 1e3 * stops.travel[farthest]),
    }


def _motion(plan: Plan) -> Table:
    """Build the table of the start and every entry of the motion in the problem."""
    stated = plain(plan.problem)
    start = ("start", "", _target({"target": stated.get("start")}))
    moves = [(str(m["name"]), str(m["kind"]), _target(m)) for m in stated.get("motion") or []]
    ends = (("at the start", plan.problem.start_rate), ("at the end", plan.problem.end_rate))
    rates = [(words, "speed", rate_words(rate)) for words, rate in ends if any(rate.values())]
    return Table(("motion", "kind", "to"), [start, *moves, *rates], caption="Motion")


def _target(motion: Mapping[str, Any]) -> str:
    if motion.get("duration") is not None:
        return f"{motion['duration']:g} s"
    target = motion.get("target") or {}
    for name in ("joints", "tip"):
        if target.get(name):
            return f"{name} " + ", ".join(number(value, 6) for value in target[name]) + " (rad, m)"
    words = []
    for name, value in (target.get("task") or {}).items():
        unit, scale = display_unit("m" if name == "depth" else "rad", "°")
        words.append(f"{name} {number(scale * value, 6)} {unit}")
    return ", ".join(words)


def _joint_row(joint: Joint) -> tuple[str, ...]:
    unit, scale = display_unit("rad" if joint.kind == "revolute" else "m", "°")
    low, high = (number(scale * end, 6) for end in joint.position)
    derivatives = ((joint.velocity, "/s"), (joint.acceleration, "/s²"), (joint.jerk, "/s³"))
    largest = (
        NOTHING if value is None else f"{number(scale * value, 6)} {unit}{per}"
        for value, per in derivatives
    )
    hardware = (NOTHING if part is None else part.name for part in (joint.drive, joint.motor))
    return (joint.name, joint.kind, f"{low} … {high} {unit}", *largest, *hardware)
