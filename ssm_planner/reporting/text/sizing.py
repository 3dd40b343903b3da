"""The verdict on motors and gears in words, from the object that `size --json` prints and plan.json holds.

The tables of `size` on the terminal: what is required, the candidates with their margins, the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ssm_planner.sizing.assess import CONFIDENCE, ROTOR, MotorVerdict
from ssm_planner.sizing.size import JointSizing, Sizing
from ssm_planner.sizing.torque_breakdown import PARTS
from ssm_planner.sizing.verdict import Check
from ssm_planner.sizing.what_if import WhatIf

SizingObject = Mapping[str, Any]
ANSWERS = {True: "yes", False: "no", None: "not known"}


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
            f"not checked for want of figures: {', '.join(open_)}",
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


ANSWER = {True: "yes", False: "NO", None: "not known"}
MOTOR_MARGINS = ("torque", "speed", "continuous_torque", "voltage", "heat")


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
    for question, answer, shown in (("largest payload", payload, mass), ("shortest duration", duration, times)):
        text = {
            "found": f"{shown} (then joint {answer.joint}: {answer.binds})",
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
        figures = (r.mean_torque * 1e3, r.peak_speed * 30 / math.pi, r.peak_acceleration, r.peak_power, r.mean_power)
        rows.append((r.joint, peak, rms, *(f"{value:.4g}" for value in figures), heat))
    return columns(head, rows, left=(0,))


def _split(sizing: Sizing) -> list[str]:
    head = ("joint", *(part.replace("_", " ") for part in PARTS))
    rows = []
    for joint in sizing.joints:
        parts = joint.requirement.split.at_peak
        sign = math.copysign(1e3, sum(parts.values()))
        rows.append((joint.load.joint, *(f"{sign * parts[name] + 0.0:+.4f}" for name in PARTS)))
    return columns(head, rows, left=(0,))


def _candidates(sizing: Sizing) -> list[str]:
    head = (
        "joint",
        "motor",
        "adequate",
        "binds",
        *(name.replace("_", " ") for name in MOTOR_MARGINS),
        "gear",
        "winding",
    )
    rows = []
    for verdict in sizing.verdicts:
        margins = {check.name: check for check in verdict.checks}
        gear = [check.margin for check in verdict.gear if check.margin is not None]
        name = verdict.motor.name + (" *" if verdict.motor.placeholder else "")
        shown = [_percent(margins[key]) for key in MOTOR_MARGINS]
        binds = (verdict.binds or "–").replace("_", " ")
        through_gear = f"{100 * min(gear):+.1f} %" if gear else "–"
        rows.append((verdict.joint, name, ANSWER[verdict.adequate], binds, *shown, through_gear, _winding(verdict)))
    lines = columns(head, rows)
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
    return columns(("joint", "drive", "margins"), rows, left=(0, 1, 2))


def _not_checked(sizing: Sizing) -> list[str]:
    """What was not checked, one line for each motor, gear and joint, with the figures that are missing."""
    groups: dict[str, tuple[dict[str, None], dict[str, None]]] = {}
    pairs = [(_subject(verdict, check), check) for verdict in sizing.verdicts for check in verdict.checks]
    pairs += [(joint.load.drive.name, check) for joint in sizing.joints for check in joint.gear]
    for subject, check in pairs:
        if check.needs is not None:
            names, needs = groups.setdefault(subject, ({}, {}))
            names[check.name.replace("_", " ")] = None
            needs.update(dict.fromkeys(check.needs.split(" and ")))
    lines = []
    for subject, (names, needs) in groups.items():
        how = "not accounted for" if list(names) == ["rotor inertia"] else "not checked"
        lines.append(f"{subject}: {', '.join(names)} {how}: needs {'; '.join(needs)}")
    return lines


def _subject(verdict: MotorVerdict, check: Check) -> str:
    if check.name == CONFIDENCE:
        return f"joint {verdict.joint}, friction"
    return f"joint {verdict.joint}" if check.name == ROTOR else verdict.motor.name


def _notes(sizing: Sizing) -> list[str]:
    lines = []
    for verdict in sizing.verdicts:
        heat = verdict.heat
        if heat is not None and heat.time_until_limit is not None:
            until = f"reaches {heat.limit - 273.15:.0f} °C after {heat.time_until_limit:.4g} s"
            lines.append(f"joint {verdict.joint}, {verdict.motor.name}: the winding {until}")
    return [*lines, *dict.fromkeys(note for verdict in sizing.verdicts for note in verdict.notes)]


def _verdict(sizing: Sizing) -> list[str]:
    lines = ["Verdicts"]
    for joint in sizing.joints:
        lines.append(f"  {joint.load.joint:10} {_joint_verdict(joint, sizing.conditions.confidence)}")
    return [*lines, f"  all        {ANSWER[sizing.adequate]} (motors and gears)"]


def _joint_verdict(joint: JointSizing, confidence: float) -> str:
    best = joint.smallest
    if best is not None:
        mark = " (placeholder figures)" if best.motor.placeholder else ""
        return f"{best.motor.name} suffices with at least {100 * confidence:g} %: the smallest that does{mark}"
    if joint.adequate is None:
        return "not known: see above for the figures that are missing" if joint.candidates else "no motor given"
    return "no motor of the list suffices" if len(joint.candidates) > 1 else "the motor does NOT suffice"


def _percent(check: Check) -> str:
    return "–" if check.margin is None else f"{100 * check.margin:+.1f} %"


def columns(head: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int] = (0, 1)) -> list[str]:
    """Aligned columns under a ruled heading."""
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        padded = (
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return "  ".join(padded).rstrip()

    return [line(head), "  ".join("-" * width for width in widths), *(line(row) for row in rows)]
