"""What the terminal shows of a plan and of its sizing: aligned tables, what is not known, verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ssm_planner.problem.limits import JUMPS
from ssm_planner.sizing.assess import CONFIDENCE, MotorVerdict
from ssm_planner.sizing.checks import Check
from ssm_planner.sizing.requirements import PARTS
from ssm_planner.sizing.size import JointSizing, Sizing, WhatIf
from ssm_planner.units import RPM, shown

if TYPE_CHECKING:  # `check` prints tables and never loads the planner
    from ssm_planner.plans import Plan

SizingObject = Mapping[str, Any]
"""What `size --json` prints and plan.json holds."""
ANSWERS = {True: "yes", False: "no", None: "not known"}
LOUD = {**ANSWERS, False: "NO"}
MOTOR_MARGINS = ("torque", "speed", "continuous_torque", "voltage", "heat")


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int] = (0,)) -> list[str]:
    """Lines of a table under a ruled heading; left: columns that are aligned to the left."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        padded = (
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return "  ".join(padded).rstrip()

    return [line(header), "  ".join("-" * width for width in widths), *(line(row) for row in rows)]


def summary_lines(plan: Plan) -> list[str]:
    """Phases, motors, limits, what is unknown, and the verdicts."""
    if plan.trajectory is None:
        reason = plan.reason.message if plan.reason else plan.status
        lines = [f"{plan.problem.name}: no plan ({plan.status})", f"  reason: {reason}"]
        if plan.reason is not None and plan.reason.relaxation:
            lines.append(f"  relaxation: {plan.reason.relaxation}")
        return lines
    lines = [f"{plan.problem.name}, robot {plan.problem.robot.name}", ""]
    phases = [
        (phase.name, f"{phase.duration:.4f}", _seconds(phase.toppra_duration), f"{phase.lower_bound:.4f}")
        for phase in plan.phases
    ]
    total = ("total", f"{plan.duration:.4f}", _seconds(plan.toppra_duration), f"{plan.lower_bound:.4f}")
    lines += text_table(("phase", "duration s", "TOPP-RA s", "lower bound s"), [*phases, total])
    lines += ["", *_motor_table(plan), "", *_limit_table(plan)]
    if plan.notes:
        lines += ["", "What is not known", *(f"  {note}" for note in plan.notes)]
    if plan.reason is not None:
        lines += ["", plan.reason.message]
        if plan.reason.relaxation:
            lines.append(f"relaxation: {plan.reason.relaxation}")
    return [*lines, "", "Verdicts", *(f"  {verdict}" for verdict in verdicts(plan))]


def _seconds(duration: float | None) -> str:
    return "–" if duration is None else f"{duration:.4f}"


def verdicts(plan: Plan) -> list[str]:
    """One line per question: planned, checked, motors."""
    lines = []
    if plan.duration is not None and plan.toppra_duration:
        ratio = plan.duration / plan.toppra_duration
        lines.append(
            f"planned      {plan.duration:.4f} s, {100 * (ratio - 1):+.3f} % of TOPP-RA's time on the same path"
        )
    lines += [f"cross-check  FAILED: {text}" for text in plan.disagreements]
    if plan.certificate is not None:
        worst = plan.certificate.worst
        word = "PASSED" if plan.certificate.passed else "FAILED"
        joint = f" of joint {worst.joint}" if worst.joint else ""
        lines.append(
            f"check        {word}: {len(plan.certificate.limits)} limits at {plan.certificate.instants} instants; "
            f"smallest margin {worst.margin:+.1e} ({worst.name}{joint}, t = {worst.time:.3f} s)"
        )
        for violation in plan.certificate.violations:
            lines.append(
                f"             exceeded: {violation.name} {violation.joint or ''} at t = {violation.time:.4f} s"
            )
    if plan.doubt is not None:
        lines.append(f"check        NOT CERTIFIED: {plan.doubt}")
    for requirement in plan.requirements:
        motor = requirement.motor
        if motor is None:
            lines.append(f"motor        joint {requirement.joint}: not checked, needs a motor in the robot file")
            continue
        within = requirement.peak_torque <= motor.max_torque and requirement.rms_torque <= motor.nominal_torque
        within = within and requirement.peak_speed <= motor.max_speed
        mark = " (placeholder figures: no verdict on the real motor)" if motor.placeholder else ""
        lines.append(f"motor        joint {requirement.joint}: {'within' if within else 'BEYOND'} {motor.name}{mark}")
    if plan.sizing is not None:
        _, word, reason = motors_verdict(plan.sizing.to_dict())
        lines.append(f"sizing       {word}: {reason}")
    return lines


def _motor_table(plan: Plan) -> list[str]:
    rows = []
    for r in plan.requirements:
        motor = r.motor
        limit = "–" if motor is None else f"{1e3 * motor.max_torque:.4g} / {1e3 * motor.nominal_torque:.4g}"
        speed = f"{RPM * r.peak_speed:.0f}"
        rows.append((r.joint, f"{1e3 * r.peak_torque:.4g}", f"{1e3 * r.rms_torque:.4g}", limit, speed))
    return text_table(("motor of joint", "peak mN·m", "RMS mN·m", "largest / nominal mN·m", "peak rpm"), rows)


def _limit_table(plan: Plan) -> list[str]:
    if plan.certificate is None:
        return []
    rows = []
    for limit in sorted(plan.certificate.limits, key=lambda limit: limit.margin):
        if limit.name in JUMPS:
            continue
        unit, scale = shown(limit.unit)
        values = f"{scale * limit.worst:.5g}", f"{scale * limit.limit:.5g}", unit
        rows.append((limit.name, limit.joint or "", *values, f"{100 * limit.margin:+.4f} %", f"{limit.time:.3f}"))
    return text_table(("limit", "joint", "worst", "limit", "unit", "margin", "at s"), rows)


def motors_verdict(sizing: SizingObject) -> tuple[str, str, str]:
    """("good", "bad" or "open", the verdict, its reason)."""
    motors, gears = sizing["motors"], sizing["gears"]
    placeholders = ", ".join(motor["joint"] for motor in motors if motor["placeholder"])
    without = ", ".join(sorted({gear["joint"] for gear in gears} - {motor["joint"] for motor in motors}))
    if sizing["adequate"] is False:
        return "bad", "Motors or gears do not suffice", "; ".join(_failures(sizing))
    if not gears:
        return "open", "Motors open", "no joint has a drive"
    if without:
        return "open", "Motors open", f"no motor given for {without}"
    if sizing["adequate"] is None:
        kept, open_ = _by_outcome(sizing)
        reasons = [
            f"{', '.join(kept)} are enough" if kept else "",
            f"not checked or not decided: {', '.join(open_)}",
        ]
        reasons.append(f"placeholder figures: {placeholders}" if placeholders else "")
        return "open", "Motors suffice: not known", "; ".join(filter(None, reasons))
    if placeholders:
        return "open", "Motors suffice by placeholder figures", f"no verdict on the real ones of {placeholders}"
    return "good", "Motors and gears suffice", f"with at least {100 * sizing['confidence']:g} % each"


def missing_figures(sizing: SizingObject) -> Iterator[tuple[str, str, str, str]]:
    """(joint, motor or gear, checks not made, figures they need) for every part of which something is not known."""
    of_gears = _gear_checks(sizing)
    for motor in sizing["motors"]:
        lacking = {name: needs for name, needs in motor["not_checked"].items() if name not in of_gears}
        if lacking:
            yield (motor["joint"], motor["motor"], *_lines(lacking))
    for gear in sizing["gears"]:
        if gear["not_checked"]:
            yield (gear["joint"], gear["drive"], *_lines(gear["not_checked"]))


def gear_margin(motor: Mapping[str, Any], sizing: SizingObject) -> float | None:
    """The smallest margin of the gear that a motor drives; None where none could be checked."""
    margins = [margin for name, margin in motor["margins"].items() if name in _gear_checks(sizing)]
    return min((margin for margin in margins if margin is not None), default=None)


def _by_outcome(sizing: SizingObject) -> tuple[list[str], list[str]]:
    """Checks that were made on every joint, and those that some joint lacks figures for; a gear's are one."""
    of_gears = _gear_checks(sizing)
    every: dict[str, bool] = {}
    for part in (*sizing["motors"], *sizing["gears"]):
        for name in dict.fromkeys((*part["margins"], *part["not_checked"])):
            word = "gear" if name in of_gears else name.replace("_", " ")
            every[word] = every.get(word, True) and name not in part["not_checked"]
    return [word for word, made in every.items() if made], [word for word, made in every.items() if not made]


def _failures(sizing: SizingObject) -> list[str]:
    """Joint, check and margin of everything that does not suffice."""
    failed = {
        (motor["joint"], check["name"]): check["margin"]
        for motor in sizing["motors"]
        for check in motor["checks"]
        if check["passed"] is False
    }
    for gear in sizing["gears"]:
        if gear["adequate"] is False:
            failed.setdefault((gear["joint"], gear["binds"]), gear["margins"][gear["binds"]])
    return [f"{joint}: {name.replace('_', ' ')} {100 * margin:+.1f} %" for (joint, name), margin in failed.items()]


def _gear_checks(sizing: SizingObject) -> set[str]:
    return {name for gear in sizing["gears"] for name in gear["margins"]}


def _lines(lacking: Mapping[str, str]) -> tuple[str, str]:
    figures = dict.fromkeys(figure for needs in lacking.values() for figure in needs.split(" and "))
    return ", ".join(name.replace("_", " ") for name in lacking), ", ".join(figures)


def sizing_lines(sizing: Sizing) -> list[str]:
    """Requirement, split, candidates, gears, what could not be checked, verdict."""
    known = all(joint.band.known for joint in sizing.joints)
    sure = f"at {100 * sizing.conditions.confidence:g} % confidence" if known else "at the stated friction"
    lines = ["Required of the motors", *_requirements(sizing), ""]
    lines += ["Parts of the peak torque, mN·m (+ adds to it, − relieves it)", *_split(sizing), ""]
    lines += [f"Margins {sure}", *_candidates(sizing), "", "Gears", *_gears(sizing)]
    unknown = [*_not_checked(sizing), *_notes(sizing)]
    if unknown:
        lines += ["", "What is not known", *(f"  {line}" for line in unknown)]
    return [*lines, "", *_verdict(sizing)]


def what_if_lines(payload: WhatIf, duration: WhatIf) -> list[str]:
    """One line for each question."""
    mass = "" if payload.value is None else f"{payload.value:.4g} kg"
    times = "" if duration.value is None else f"{duration.value:.4f} times the present one"
    lines = []
    for question, answer, value in (("largest payload", payload, mass), ("shortest duration", duration, times)):
        text = {
            "found": f"{value} (then joint {answer.joint}: {answer.binds})",
            "never": f"none: joint {answer.joint}: {answer.binds} is exceeded whatever it is",
            "unlimited": "no limit found by the checks that can be made",
        }[answer.status]
        lines.append(f"{question:18} {text}")
    return lines


def _requirements(sizing: Sizing) -> list[str]:
    head = ("joint", "peak mN·m", "RMS mN·m", "mean mN·m", "peak rpm", "peak rad/s²", "peak W", "mean W", "Joule W")
    rows = []
    for joint in sizing.joints:
        r, confidence = joint.requirement, sizing.conditions.confidence
        peak, rms = f"{1e3 * r.peak_torque:.4g}", f"{1e3 * r.rms_torque:.4g}"
        if joint.band.known:
            peak += f" (≤ {1e3 * joint.band.high('peak_torque', confidence):.4g})"
            rms += f" (≤ {1e3 * joint.band.high('rms_torque', confidence):.4g})"
        heat = "–" if r.joule_power is None else f"{r.joule_power:.3g}"
        figures = (r.mean_torque * 1e3, RPM * r.peak_speed, r.peak_acceleration, r.peak_power, r.mean_power)
        rows.append((r.joint, peak, rms, *(f"{value:.4g}" for value in figures), heat))
    return text_table(head, rows)


def _split(sizing: Sizing) -> list[str]:
    head = ("joint", *(part.replace("_", " ") for part in PARTS))
    rows = []
    for joint in sizing.joints:
        parts = joint.requirement.split.at_peak
        sign = math.copysign(1e3, sum(parts.values()))
        rows.append((joint.load.joint, *(f"{sign * parts[name] + 0.0:+.4f}" for name in PARTS)))
    return text_table(head, rows)


def _candidates(sizing: Sizing) -> list[str]:
    margins_of = (name.replace("_", " ") for name in MOTOR_MARGINS)
    head = ("joint", "motor", "adequate", "binds", *margins_of, "gear", "winding")
    rows = []
    for verdict in (*sizing.verdicts, *sizing.alternatives):
        margins = {check.name: check for check in verdict.checks}
        gear = [check.margin for check in verdict.gear if check.margin is not None]
        name = verdict.motor.name + (" *" if verdict.motor.placeholder else "")
        name = f"or {name}" if verdict in sizing.alternatives else name
        shown = [_percent(margins[key]) for key in MOTOR_MARGINS]
        binds = (verdict.binds or "–").replace("_", " ")
        through_gear = f"{100 * min(gear):+.1f} %" if gear else "–"
        rows.append((verdict.joint, name, LOUD[verdict.adequate], binds, *shown, through_gear, _winding(verdict)))
    lines = text_table(head, rows, left=(0, 1))
    if any(verdict.motor.placeholder for verdict in sizing.verdicts):
        lines.append("* placeholder figures: no verdict on the real motor")
    return lines


def _winding(verdict: MotorVerdict) -> str:
    if verdict.heat is None:
        return "–"
    hottest = verdict.heat.winding
    return "no steady state" if hottest is None else f"{hottest - 273.15:.0f} °C"


def _gears(sizing: Sizing) -> list[str]:
    rows = []
    for joint in sizing.joints:
        made = [check for check in joint.gear if check.margin is not None]
        shown = ", ".join(f"{check.name.replace('_', ' ')} {_percent(check)}" for check in made)
        rows.append((joint.load.joint, joint.load.drive.name, shown or "nothing could be checked"))
    return text_table(("joint", "drive", "margins"), rows, left=(0, 1, 2))


def _not_checked(sizing: Sizing) -> list[str]:
    """What was not checked or not decided, a line for each motor, gear and joint, and what is missing."""
    groups: dict[tuple[str, str], tuple[dict[str, None], dict[str, None]]] = {}
    judged = (*sizing.verdicts, *sizing.alternatives)
    pairs = [(_subject(verdict, check), check) for verdict in judged for check in verdict.checks]
    pairs += [(joint.load.drive.name, check) for joint in sizing.joints for check in joint.gear]
    for subject, check in pairs:
        if check.needs is not None:
            how = "not checked" if check.margin is None else "not decided"
            names, needs = groups.setdefault((subject, how), ({}, {}))
            names[check.name.replace("_", " ")] = None
            needs.update(dict.fromkeys(check.needs.split(" and ")))
    return [
        f"{subject}: {', '.join(names)} {how}: needs {'; '.join(needs)}"
        for (subject, how), (names, needs) in groups.items()
    ]


def _subject(verdict: MotorVerdict, check: Check) -> str:
    return (
        f"joint {verdict.joint}, friction"
        if check.name == CONFIDENCE
        else f"joint {verdict.joint}, {verdict.motor.name}"
    )


def _notes(sizing: Sizing) -> list[str]:
    lines = []
    judged = (*sizing.verdicts, *sizing.alternatives)
    for verdict in judged:
        heat = verdict.heat
        if heat is not None and heat.time_until_limit is not None:
            until = f"reaches {heat.limit - 273.15:.0f} °C after {heat.time_until_limit:.4g} s"
            lines.append(f"joint {verdict.joint}, {verdict.motor.name}: the winding {until}")
    return [*lines, *dict.fromkeys(note for verdict in judged for note in verdict.notes)]


def _verdict(sizing: Sizing) -> list[str]:
    lines = ["Verdicts"]
    for joint in sizing.joints:
        lines.append(f"  {joint.load.joint:10} {_joint_verdict(joint, sizing.conditions.confidence)}")
        lines += [f"  {'':10} if it is {each.motor.name}: {LOUD[each.adequate]}" for each in joint.alternatives]
    of_what = "motors and gears" if sizing.joints else "no joint has a drive: there is nothing to judge"
    return [*lines, f"  all        {LOUD[sizing.adequate]} ({of_what})"]


def _joint_verdict(joint: JointSizing, confidence: float) -> str:
    best = joint.smallest
    if best is not None:
        mark = " (placeholder figures)" if best.motor.placeholder else ""
        return f"{best.motor.name} suffices with at least {100 * confidence:g} %: the smallest that does{mark}"
    if joint.adequate is None:
        return "not known: see above for what would decide it" if joint.candidates else "no motor given"
    return "no motor of the list suffices" if len(joint.candidates) > 1 else "the motor does NOT suffice"


def _percent(check: Check) -> str:
    return "–" if check.margin is None else f"{100 * check.margin:+.1f} %"
