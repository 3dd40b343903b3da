"""report.html: one plan as a self-contained page made from plan.json alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.display import NOTHING, fixed, number, percent, words
from ssm_planner.plans import PhaseSummary, Plan
from ssm_planner.problem.limits import (
    JUMPS,
    PROMISES,
    TASK,
    JointAcceleration,
    JointJerk,
    JointVelocity,
    LensClearance,
    MotorSpeed,
    MotorTorque,
    RetinaClearance,
    SelfLocking,
)
from ssm_planner.problem.robot import Joint
from ssm_planner.problem.serialization import plain
from ssm_planner.reporting.figures.style import COLOURS, FIFTH
from ssm_planner.reporting.html.channels import channels_of, encoded, time_grid
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
    ANSWERS,
    MOTOR_MARGINS,
    Table,
    confirmation,
    gear_margin,
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
from ssm_planner.units import shown
from ssm_planner.verification.certificate import Certificate, LimitCheck

SHOWN_STOPS = 12
JOINT_COLUMNS = ("joint", "kind", "position", "velocity", "acceleration", "jerk", "drive", "motor")
TIGHTEST = 10
"""Limits that the certificate shows unfolded."""
MOST_PARTS = 5
"""Of a sentence about the motion."""
STILL = 1e-6
"""rad or m below which a coordinate stays."""
NOTABLE = 0.15
"""Share of a motion's duration from which a limit is said to limit it."""
FLOORS = (SelfLocking.name, RetinaClearance.name, LensClearance.name)
JOINT_LIMITS = tuple(
    kind.name for kind in (JointVelocity, JointAcceleration, JointJerk, MotorSpeed, MotorTorque)
)
Mark = tuple[str, str, str]
"""("good", "bad" or "open", a word, its reason)."""


def write_report(plan: Plan, out: Path) -> Path:
    """Write the report of a plan. Raises ExportError."""
    return write_page(out, report_page(plan), plan.sha256)


def report_page(plan: Plan) -> str:
    """The report of a plan as an HTML document."""
    data = report_data(plan)
    marks = verdict(plan)
    return render(
        "report.html",
        data,
        title=f"{plan.problem.name} – plan report",
        name=plan.problem.name,
        robot=plan.robot.name,
        sentence=sentence(plan, data["panels"]),
        marks=[mark for mark in marks if mark[0] != "open"],
        open_marks=[mark for mark in marks if mark[0] == "open"],
        figures=_figures(plan),
        notes=plan.notes,
        certificate=plan.certificate,
        tiers=_tiers(plan.certificate),
        phases=phases_table(plan),
        ends=joints_table(plan),
        motors=motors_table(plan.requirements),
        stops=_stops(plan),
        sizing=_sizing(plan),
        repeated=repeated(plan.problem.duty),
        motion=_motion(plan),
        task_limits=Table(
            ("limit", "from", "to", "unit"), limit_rows(plan.limits), (1, 2), "Limits of the task"
        ),
        joints=Table(
            JOINT_COLUMNS,
            [_joint_row(joint) for joint in plan.robot.joints],
            (2, 3, 4, 5),
            "Joints",
        ),
        sources=[
            (joint.name, table) for joint in plan.robot.joints if (table := _sources(joint)).rows
        ],
        provenance=_provenance(plan),
    )


def repeated(duty: float | None) -> str:
    """How often the motion is done, in words."""
    if duty is None:
        return "The motion done once, from cold,"
    return f"The motion repeated {f'after a pause of {duty:.6g} s' if duty else 'without pause'}"


def report_data(plan: Plan) -> dict[str, Any]:
    """What the page's scripts read: channels, panels, phases, joints and scene."""
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
    """What the motion does, in which time, and what limits it."""
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
    few = parts if len(parts) <= MOST_PARTS else [f"makes {len(plan.phases)} phases"]
    text = f"{', '.join(few) or 'stands still'} in {_seconds(plan.duration, 2)}"
    limited = _limited_by(plan, panels)
    return text[0].upper() + text[1:] + (f"; limited by {limited}" if limited else "") + "."


def _changes(phase: PhaseSummary) -> Iterator[str]:
    """The task coordinates that a phase changes, in words."""
    for name, begin, end in zip(TASK, phase.task_start, phase.task_end, strict=True):
        if name == "depth" and abs(end - begin) > STILL:
            yield f"{'inserts' if end > begin else 'withdraws'} {number(1e3 * abs(end - begin), 3)} mm"
        elif name != "depth" and abs(end - begin) > STILL:
            first, last = (number(math.degrees(angle), 4) for angle in (begin, end))
            yield f"{name}s {first}° → {last}°"


def _limited_by(plan: Plan, panels: list[Panel]) -> str:
    """The limits on speeds and accelerations that are active for a good part of the motion, longest first."""
    share: dict[str, dict[int, float]] = {}
    for stretch in (each for panel in panels for each in panel["active"]):
        if not stretch["name"].endswith(("range", "position", "clearance")):
            of = share.setdefault(stretch["name"], {})
            of[stretch["joint"]] = of.get(stretch["joint"], 0.0) + stretch["end"] - stretch["start"]
    longest = sorted(share, key=lambda name: -max(share[name].values()))
    said = [name for name in longest if max(share[name].values()) > NOTABLE * plan.motion.duration][
        :2
    ]
    return " and ".join(_of_joints(name, sorted(share[name])) for name in said)


def _of_joints(name: str, joints: list[int]) -> str:
    """A limit with the numbers of its joints; those of the tool say themselves of what."""
    word = {"velocity": "speed"}.get(name, name)
    if name not in JOINT_LIMITS:
        return f"the {word}"
    numbers = [str(i + 1) for i in joints]
    which = " and ".join(filter(None, (", ".join(numbers[:-1]), numbers[-1])))
    return f"the {word} of joint{'s' if len(joints) > 1 else ''} {which}"


def _is_spot(phase: PhaseSummary) -> bool:
    """The tool stands at a spot of a scan, whose phases are named after it."""
    return phase.task_start == phase.task_end and ", " in phase.name


def _tip_stops(plan: Plan, channels: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Where the tip is at the end of every phase, m, and whether it is a spot of a scan."""
    spots = {phase.name for phase in plan.phases if _is_spot(phase)}
    t, start = channels["t"], float(plan.motion.breaks[0])
    tip = np.column_stack([channels[f"tip{i}"] for i in range(3)])
    found: dict[tuple[float, ...], bool] = {}
    for phase in plan.motion.phases:
        place = tuple(
            np.round(tip[min(int(np.searchsorted(t, phase.end - start)), len(t) - 1)], 5).tolist()
        )
        found[place] = found.get(place, False) or phase.name in spots
    return [{"position": list(place), "spot": spot} for place, spot in found.items()]


@dataclass(frozen=True)
class LimitRow:
    """One limit of the certificate as the page shows it."""

    check: LimitCheck
    name: str
    joint: str
    worst: str
    allowed: str
    unit: str

    @property
    def margin(self) -> float:
        """Without the rounding that a kept limit may be exceeded by."""
        return max(self.check.margin, 0.0) if self.check.passed else self.check.margin

    @property
    def bar(self) -> int:
        """% of the margin's bar that is full."""
        return round(100 * min(max(self.margin, 0.0), 1.0))


def _tiers(certificate: Certificate | None) -> list[tuple[str, list[LimitRow]]]:
    """The certificate's limits, tightest first: the ten that matter most and all that are violated, others, continuity."""
    limits = () if certificate is None else certificate.limits
    rows = []
    for check in sorted(limits, key=lambda limit: limit.margin):
        name, joint, worst, allowed, unit, _ = limit_cells(check, "°")
        floor = name in FLOORS or (
            name.endswith(("range", "position", *PROMISES)) and check.worst > check.limit
        )
        name = {SelfLocking.name: "friction that self-locking needs"}.get(name, name)
        allowed = f"{'≥' if floor else '≤'} {allowed}"
        rows.append(
            LimitRow(check, name=name, joint=joint, worst=worst, allowed=allowed, unit=unit)
        )
    numerical = [row for row in rows if row.check.name in JUMPS and row.check.passed]
    first = [row for row in rows if row not in numerical]
    shown = max(TIGHTEST, sum(not row.check.passed for row in first))
    return [
        ("tightest", first[:shown]),
        ("Other limits", first[shown:]),
        ("Numerical continuity: jumps between polynomials, rest at both ends", numerical),
    ]


def verdict(plan: Plan) -> list[Mark]:
    """Whether the motion is planned, certified and possible with the motors."""
    return [_feasible(plan), _certified(plan), motors_verdict(judged(plan))]


def judged(plan: Plan) -> dict[str, Any]:
    """The object that `size --json` prints, of a plan with a trajectory."""
    assert plan.sizing is not None
    return plan.sizing.to_dict()


def _feasible(plan: Plan) -> Mark:
    return ("good", "Feasible", "") if plan.status == "solved" else ("bad", "No plan", plan.status)


def _certified(plan: Plan) -> Mark:
    certificate = plan.certificate
    if certificate is None:
        return "bad", "Not certified", plan.doubt or "the plan holds no certificate"
    if not certificate.passed:
        worst = certificate.worst
        of = f" of joint {worst.joint}" if worst.joint else ""
        return "bad", "Not certified", f"{worst.name}{of} exceeded at {worst.time:.3f} s"
    return (
        "good",
        "Certified",
        f"{len(certificate.limits)} limits kept",
    )


def _figures(plan: Plan) -> list[tuple[str, str, str]]:
    """(name, value, note) of duration, lower bound, gap, TOPP-RA's time, and Ipopt's confirmation."""
    duration, toppra, gap = plan.duration, plan.toppra_duration, plan.gap
    against = f"this plan: {percent(duration / toppra - 1, 3)}" if duration and toppra else ""
    return [
        ("Duration", _seconds(duration), ""),
        ("Lower bound", _seconds(plan.lower_bound), "no motion on this path can be shorter"),
        ("Gap", NOTHING if gap is None else f"{fixed(100 * gap, 2)} %", "duration above the bound"),
        ("TOPP-RA", _seconds(toppra), against),
        *([("Ipopt", *confirmation(plan))] if plan.confirmation else []),
        *(
            [("Without the range", _seconds(plan.nominal_duration), _range(plan))]
            if plan.nominal_duration
            else []
        ),
    ]


def _range(plan: Plan) -> str:
    """What the plan holds for, and the cost."""
    return range_lines(plan)[0].removeprefix("range").strip()


def _seconds(value: float | None, decimals: int = 4) -> str:
    return NOTHING if value is None else f"{fixed(value, decimals)} s"


def _stops(plan: Plan) -> dict[str, Any] | None:
    """From some instants, the longest and the farthest stop among them: how long it takes, how far the tip goes."""
    stops = plan.stops
    if stops is None:
        return None
    shown = np.linspace(0, len(stops.time) - 1, SHOWN_STOPS).astype(int)
    longest, farthest = int(np.argmax(stops.duration)), int(np.argmax(stops.travel))
    marks = (
        {longest: "longest", farthest: "farthest"}
        if longest != farthest
        else {longest: "longest and farthest"}
    )
    rows = [
        (
            fixed(stops.time[k], 3),
            fixed(1e3 * stops.duration[k], 1),
            fixed(1e3 * stops.travel[k], 3),
            marks.get(k, ""),
        )
        for k in sorted({*shown.tolist(), *marks})
    ]
    return {
        "count": len(stops.time),
        "passed": stops.passed,
        "broken": sorted(
            {f"{each.name} {each.joint or ''}".strip() for each in stops.certificate.violations}
        ),
        "table": Table(("from s", "stands after ms", "way of the tip mm", ""), rows, (0, 1, 2)),
    }


def _sizing(plan: Plan) -> dict[str, Any]:
    """Which motors and gears suffice, by what margins (one column for each motor), and which figures are missing."""
    found = judged(plan)
    columns = [_motor_column(motor, found) for motor in (*found["motors"], *found["alternatives"])]
    rows = (
        [(name, *(column[name] for column in columns)) for name in columns[0]]
        if columns
        else [("joint",)]
    )
    return {
        "verdict": ": ".join(filter(None, motors_verdict(found)[1:])),
        "motors": Table(rows[0], rows[1:]),
        "missing": Table(
            ("joint", "motor or gear", "not checked", "figures that are missing"),
            [*missing_figures(found)],
        ),
    }


def _motor_column(motor: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, str]:
    probability = motor["probability"]
    return {
        "joint": motor["joint"],
        "motor": motor["motor"],
        "its figures": "placeholders among them" if motor["placeholder"] else "with a source",
        "suffices": ANSWERS[motor["adequate"]],
        "binds": words(motor["binds"] or NOTHING),
        **{words(name): percent(motor["margins"].get(name)) for name in MOTOR_MARGINS},
        "gear": percent(gear_margin(motor, found)),
        "confidence": NOTHING if probability is None else f"{number(100 * probability)} %",
    }


def _motion(plan: Plan) -> Table:
    """The start and every entry of the motion as stated in the problem."""
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
        unit, scale = shown("m" if name == "depth" else "rad", "°")
        words.append(f"{name} {number(scale * value, 6)} {unit}")
    return ", ".join(words)


def _joint_row(joint: Joint) -> tuple[str, ...]:
    unit, scale = shown("rad" if joint.kind == "revolute" else "m", "°")
    low, high = (number(scale * end, 6) for end in joint.position)
    derivatives = ((joint.velocity, "/s"), (joint.acceleration, "/s²"), (joint.jerk, "/s³"))
    largest = (
        NOTHING if value is None else f"{number(scale * value, 6)} {unit}{per}"
        for value, per in derivatives
    )
    parts = (NOTHING if part is None else part.name for part in (joint.drive, joint.motor))
    return (joint.name, joint.kind, f"{low} … {high} {unit}", *largest, *parts)


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
    files = ("problem file", str(plan.problem.file)), ("robot file", str(plan.robot.file))
    return Table(
        ("what", "which"),
        [
            *plan.software.items(),
            *files,
            ("plan file", plan.path.name),
            ("SHA-256 of the plan file", plan.sha256),
        ],
    )
