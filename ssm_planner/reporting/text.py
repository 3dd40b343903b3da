"""What is said of a plan and of its sizing, on the terminal and on pages: tables, what is not known, verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, zip_longest
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ssm_planner.display import NOTHING, columns, fixed, number, percent, signed, words
from ssm_planner.problem.limits import JUMPS, READ_IN, MotorTorque
from ssm_planner.problem.robot import JOINTS
from ssm_planner.sizing.assess import CONFIDENCE, MotorVerdict
from ssm_planner.sizing.checks import Check
from ssm_planner.sizing.requirements import PARTS, MotorRequirement
from ssm_planner.sizing.size import JointSizing, Sizing, WhatIf
from ssm_planner.units import RPM, shown
from ssm_planner.verification.certificate import LimitCheck

if TYPE_CHECKING:  # `check` prints tables and never loads the planner
    from ssm_planner.plans import PhaseSummary, Plan
    from ssm_planner.simulation.simulate import SimulationResult

SizingObject = Mapping[str, Any]
"""What `size --json` prints and plan.json holds."""
ANSWERS = {True: "yes", False: "no", None: "not known"}
LOUD = {**ANSWERS, False: "NO"}
MOTOR_MARGINS = ("torque", "speed", "continuous_torque", "voltage", "heat")
KELVIN = 273.15
AGREES_IPOPT = 1e-6
"""Share within which Ipopt's duration is the structured solver's, as `planning/ocp/refinement.SAME`."""


@dataclass(frozen=True)
class Table:
    """A table of text; numbers: columns that are aligned to the right."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Sequence[int] = ()
    caption: str = ""

    def lines(self, width: int | None = None) -> list[str]:
        """For the terminal (or a width of its own), under a ruled heading.

        Cells that are too wide are wrapped; columns that still do not fit stand in a table below.
        """
        most = columns() if width is None else width
        widths = self._widths(most)
        fit = sum(
            end <= most for end in accumulate(width + 2 for width in [widths[0] - 2, *widths[1:]])
        )
        label = next((i for i in range(len(widths)) if i in self.numbers), 1)
        if label < fit < len(widths):
            return [
                *self._of(range(fit)).lines(most),
                "",
                *self._of([*range(label), *range(fit, len(widths))]).lines(most),
            ]
        rows = [self.header, ["-" * width for width in widths], *self.rows]
        return [
            "  ".join(self._aligned(line, widths)).rstrip()
            for row in rows
            for line in _wrapped(row, widths)
        ]

    def _of(self, places: Sequence[int]) -> Table:
        """Some of the columns."""
        rows = [[row[i] for i in places] for row in self.rows]
        numbers = [k for k, i in enumerate(places) if i in self.numbers]
        return Table([self.header[i] for i in places], rows, numbers)

    def _widths(self, most: int) -> list[int]:
        """Of the columns; the widest become narrower, as far as words go, until all of them fit."""
        cells = [*zip(self.header, *self.rows, strict=True)]
        widths = [max(map(len, column)) for column in cells]
        least = [
            max(len(word) for cell in column for word in (cell.split() or [""])) for column in cells
        ]
        for i in self.numbers:  # numbers stay on one line, their heading does not
            least[i] = max([least[i], *map(len, cells[i][1:])])
        while sum(widths) + 2 * (len(widths) - 1) > most:
            spare = [width - smallest for width, smallest in zip(widths, least, strict=True)]
            if not any(spare):
                break
            widths[
                max(range(len(widths)), key=lambda i: (spare[i] > 0, i in self.numbers, widths[i]))
            ] -= 1
        return widths

    def _aligned(self, row: Sequence[str], widths: Sequence[int]) -> Iterator[str]:
        for i, (cell, width) in enumerate(zip(row, widths, strict=True)):
            yield cell.rjust(width) if i in self.numbers else cell.ljust(width)


def _wrapped(row: Sequence[str], widths: Sequence[int]) -> Iterator[Sequence[str]]:
    """The lines of a row, each cell wrapped to its column."""
    parts = [
        wrap(cell, max(width, 1), break_on_hyphens=False) or [""]
        for cell, width in zip(row, widths, strict=True)
    ]
    return zip_longest(*parts, fillvalue="")


class Judged(Protocol):
    """A value beside its limit, from a check or a recording."""

    @property
    def name(self) -> str:
        """Of the limit."""

    @property
    def unit(self) -> str:
        """SI."""


def unit_of_limit(limit: Judged, degree: str = "deg") -> tuple[str, float]:
    """(unit to show, factor) of a limit's values: motors turn in rpm."""
    return shown(READ_IN.get(limit.name, limit.unit), degree)


def limit_cells(limit: LimitCheck, degree: str = "deg") -> tuple[str, str, str, str, str, str]:
    """Name, joint, worst value, limit, unit and margin."""
    unit, scale = unit_of_limit(limit, degree)
    values = number(scale * limit.worst, 6), number(scale * limit.limit, 6)
    return limit.name, limit.joint or "", *values, unit, percent(limit.margin, 4)


def limits_table(limits: Iterable[LimitCheck]) -> Table:
    """Worst value, limit, margin, joint and time of every limit, worst first, without jumps that there are not."""
    rows = [
        (*limit_cells(limit), fixed(limit.time, 4), "" if limit.passed else "EXCEEDED")
        for limit in sorted(limits, key=lambda limit: limit.margin)
        if limit.name not in JUMPS or not limit.passed
    ]
    return Table(
        ("limit", "joint", "worst", "limit", "unit", "margin", "at s", ""), rows, (2, 3, 5, 6)
    )


def phases_table(plan: Plan) -> Table:
    """Duration of every phase beside TOPP-RA's and the bound."""
    entries: list[tuple[str, PhaseSummary | Plan]] = [(phase.name, phase) for phase in plan.phases]
    rows = [
        (
            name,
            *(
                fixed(value, 4)
                for value in (entry.duration, entry.toppra_duration, entry.lower_bound)
            ),
        )
        for name, entry in [*entries, ("total", plan)]
    ]
    return Table(("phase", "duration s", "TOPP-RA s", "lower bound s"), rows, (1, 2, 3))


def joints_table(plan: Plan) -> Table:
    """Where the joints start and end: which of the configurations that reach the points the motion takes."""
    if plan.trajectory is None:
        return Table(("joint", "from", "to", "unit"), [], (1, 2))
    ends = plan.trajectory.sample(np.array([0.0, plan.trajectory.duration])).q
    rows = []
    for joint, (start, end) in zip(plan.problem.robot.joints, ends.T, strict=True):
        unit, scale = shown(joint.unit)
        rows.append((joint.name, number(scale * start, 5), number(scale * end, 5), unit))
    return Table(("joint", "from", "to", "unit"), rows, (1, 2))


def motors_table(requirements: Iterable[MotorRequirement]) -> Table:
    """What the motion requires of each motor beside the motor file's figures."""
    rows = []
    for r in requirements:
        motor = r.motor
        need = (
            number(1e3 * r.peak_torque, 4),
            number(1e3 * r.rms_torque, 4),
            fixed(RPM * r.peak_speed, 0),
        )
        have = (NOTHING,) * 3
        if motor is not None:
            torques = number(1e3 * motor.max_torque, 4), number(1e3 * motor.nominal_torque, 4)
            have = *torques, fixed(RPM * motor.max_speed, 0)
        pairs = (f"{a} of {b}" for a, b in zip(need, have, strict=True))
        placeholders = NOTHING if motor is None else str(len(motor.placeholders) or "none")
        rows.append((r.joint, motor.name if motor else "no motor given", *pairs, placeholders))
    header = (
        "joint",
        "motor",
        "peak torque mN·m",
        "RMS torque mN·m",
        "peak speed rpm",
        "placeholder figures",
    )
    return Table(header, rows, (2, 3, 4, 5))


def summary_lines(plan: Plan) -> list[str]:
    """The verdicts, then phases, motors, limits and what is unknown."""
    if plan.trajectory is None:
        reason = plan.reason.message if plan.reason else plan.status
        lines = [f"{plan.problem.name}: no plan ({plan.status})", f"  reason: {reason}"]
        if plan.reason is not None and plan.reason.relaxation:
            lines.append(f"  relaxation: {plan.reason.relaxation}")
        return lines
    lines = [f"{plan.problem.name}, robot {plan.problem.robot.name}", "", *verdicts(plan)]
    if plan.reason is not None:
        lines += ["", plan.reason.message]
        if plan.reason.relaxation:
            lines.append(f"relaxation: {plan.reason.relaxation}")
    limits = () if plan.certificate is None else plan.certificate.limits
    for table in (
        phases_table(plan),
        joints_table(plan),
        motors_table(plan.requirements),
        limits_table(limits),
    ):
        lines += ["", *table.lines()] if table.rows else []
    if plan.notes:
        lines += ["", "What is not known", *(f"  {note}" for note in plan.notes)]
    return lines


def rate_words(rates: Mapping[str, float]) -> str:
    """Rates of task coordinates, such as tilt -10 deg/s."""
    units = {name: shown("m" if name == "depth" else "rad") for name in rates}
    return ", ".join(
        f"{name} {number(units[name][1] * rate, 4)} {units[name][0]}/s"
        for name, rate in rates.items()
        if rate
    )


def solvers(plan: Plan) -> str:
    """Which found the phases; Ipopt's are named, for the structured solver did not converge there."""
    by_ipopt = [phase.name for phase in plan.phases if phase.solver == "Ipopt"]
    if not by_ipopt:
        return "structured"
    return (
        "Ipopt"
        if len(by_ipopt) == len(plan.phases)
        else f"structured; Ipopt in {', '.join(by_ipopt)}"
    )


def confirmation(plan: Plan) -> tuple[str, str]:
    """Ipopt's iterations from the structured solver's motions, and how both durations agree; "" where either solved alone."""
    if plan.confirmation is None:
        return "", ""
    iterations, difference = plan.confirmation
    apart = f"{abs(difference):.0e}"
    agreement = f"durations agree within {apart}"
    if abs(difference) > AGREES_IPOPT:
        agreement = f"durations differ by up to {apart}: the shorter motion is taken"
    alone = [
        phase.name
        for phase in plan.phases
        if phase.solver == "Ipopt" and phase.confirmation_iterations is None
    ]
    agreement += f"; Ipopt alone in {', '.join(alone)}" if alone else ""
    return f"{iterations} iteration{'' if iterations == 1 else 's'}", agreement


def range_lines(plan: Plan) -> list[str]:
    """What a range of friction and payload costs, and where in it each motor has most to do."""
    friction, payload = plan.problem.friction, plan.problem.payload
    if friction is None and payload is None:
        return []
    what = [f"friction within {100 * friction:g} %"] if friction else []
    what += [f"payload up to {1e3 * payload[1]:g} g"] if payload else []
    cost = ""
    if plan.duration is not None and plan.nominal_duration:
        longer = 100 * (plan.duration / plan.nominal_duration - 1)
        cost = f": {longer:+.2f} % of the {plan.nominal_duration:.4f} s without"
    lines = [f"range        {', '.join(what)}{cost}"]
    for limit in () if plan.certificate is None else plan.certificate.limits:
        if limit.name == MotorTorque.name and limit.case:
            lines.append(
                f"             joint {limit.joint}: worst, margin {100 * limit.margin:+.2f} %, at {limit.case}"
            )
    return lines


def path_lines(plan: Plan) -> list[str]:
    """How phases keep to their paths, where that is asked for."""
    corners = [
        f"corners      {phase.name}: the tip is up to {1e3 * phase.corner_departure:.4g} mm off its lines, within "
        f"{1e3 * (phase.corner_reach or 0.0):.4g} mm of a corner"
        for phase in plan.phases
        if phase.corner_departure is not None
    ]
    constant = [
        f"tip speed    {phase.name}: {1e3 * phase.constant_speed:.4g} mm/s from {phase.constant_from:.4f} s to "
        f"{phase.constant_to:.4f} s of its {phase.duration:.4f} s, within {phase.constant_error:.0e}"
        for phase in plan.phases
        if phase.constant_speed is not None
    ]
    return corners + constant


def verdicts(plan: Plan) -> list[str]:
    """One line per question: planned, checked, motors."""
    lines = []
    if plan.duration is not None and plan.toppra_duration:
        more = percent(plan.duration / plan.toppra_duration - 1, 3)
        lines.append(
            f"planned      {plan.duration:.4f} s, {more} of TOPP-RA's time on the same path"
        )
    lines += path_lines(plan)
    if plan.problem.planner == "fast" and plan.phases:
        lines.append(f"solver       {solvers(plan)}")
    iterations, agreement = confirmation(plan)
    if iterations:
        lines.append(
            f"cross-check  Ipopt confirms the structured solver's motion in {iterations}: {agreement}"
        )
    for verb, rates in (("starts", plan.problem.start_rate), ("ends", plan.problem.end_rate)):
        lines += [f"{verb:<12} at {rate_words(rates)}, as declared"] if any(rates.values()) else []
    lines += range_lines(plan)
    lines += [f"cross-check  FAILED: {text}" for text in plan.disagreements]
    if plan.certificate is not None:
        worst = plan.certificate.worst
        word = "PASSED" if plan.certificate.passed else "FAILED"
        joint = f" of joint {worst.joint}" if worst.joint else ""
        lines.append(
            f"check        {word}: {len(plan.certificate.limits)} limits at {plan.certificate.instants} instants; "
            f"smallest margin {percent(worst.margin, 4)} ({worst.name}{joint}, t = {worst.time:.4f} s)"
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
            lines.append(
                f"motor        joint {requirement.joint}: not checked, needs a motor in the robot file"
            )
            continue
        within = (
            requirement.peak_torque <= motor.max_torque
            and requirement.rms_torque <= motor.nominal_torque
        )
        within = within and requirement.peak_speed <= motor.max_speed
        mark = " (placeholder figures: no verdict on the real motor)" if motor.placeholder else ""
        lines.append(
            f"motor        joint {requirement.joint}: {'within' if within else 'BEYOND'} {motor.name}{mark}"
        )
    if plan.sizing is not None:
        _, word, reason = motors_verdict(plan.sizing.to_dict())
        lines.append(f"sizing       {word}: {reason}")
    return lines


def motors_verdict(sizing: SizingObject) -> tuple[str, str, str]:
    """("good", "bad" or "open", the verdict, its reason)."""
    motors, gears = sizing["motors"], sizing["gears"]
    placeholders = ", ".join(motor["joint"] for motor in motors if motor["placeholder"])
    without = ", ".join(
        sorted({gear["joint"] for gear in gears} - {motor["joint"] for motor in motors})
    )
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
        return (
            "open",
            "Motors suffice by placeholder figures",
            f"no verdict on the real ones of {placeholders}",
        )
    return (
        "good",
        "Motors and gears suffice",
        f"with at least {100 * sizing['confidence']:g} % each",
    )


def missing_figures(sizing: SizingObject) -> Iterator[tuple[str, str, str, str]]:
    """(joint, motor or gear, checks not made, figures they need) for every part of which something is not known."""
    of_gears = _gear_checks(sizing)
    for motor in sizing["motors"]:
        lacking = {
            name: needs for name, needs in motor["not_checked"].items() if name not in of_gears
        }
        if lacking:
            yield (motor["joint"], motor["motor"], *_lacking(lacking))
    for gear in sizing["gears"]:
        if gear["not_checked"]:
            yield (gear["joint"], gear["drive"], *_lacking(gear["not_checked"]))


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
            word = "gear" if name in of_gears else words(name)
            every[word] = every.get(word, True) and name not in part["not_checked"]
    return [word for word, made in every.items() if made], [
        word for word, made in every.items() if not made
    ]


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
    return [f"{joint}: {words(name)} {percent(margin)}" for (joint, name), margin in failed.items()]


def _gear_checks(sizing: SizingObject) -> set[str]:
    return {name for gear in sizing["gears"] for name in gear["margins"]}


def _lacking(lacking: Mapping[str, str]) -> tuple[str, str]:
    figures = dict.fromkeys(figure for needs in lacking.values() for figure in needs.split(" and "))
    return ", ".join(words(name) for name in lacking), ", ".join(figures)


def sizing_lines(sizing: Sizing) -> list[str]:
    """The verdict, then requirement, split, candidates, gears and what could not be checked."""
    known = all(joint.band.known for joint in sizing.joints)
    sure = (
        f"at {100 * sizing.conditions.confidence:g} % confidence"
        if known
        else "at the stated friction"
    )
    lines = [*_verdict(sizing), "", "Required of the motors", *_requirements(sizing).lines(), ""]
    lines += [
        "Parts of the peak torque, mN·m (+ adds to it, − relieves it)",
        *_split(sizing).lines(),
        "",
    ]
    lines += [f"Margins {sure}", *_candidates(sizing), "", "Gears", *_gears(sizing).lines()]
    unknown = [*_not_checked(sizing), *_notes(sizing)]
    if unknown:
        lines += ["", "What is not known", *(f"  {line}" for line in unknown)]
    return lines


def what_if_lines(payload: WhatIf, duration: WhatIf) -> list[str]:
    """One line for each question."""
    mass = "" if payload.value is None else f"{payload.value:.4g} kg"
    times = "" if duration.value is None else f"{duration.value:.4f} times the present one"
    lines = []
    for question, answer, value in (
        ("largest payload", payload, mass),
        ("shortest duration", duration, times),
    ):
        text = {
            "found": f"{value} (then joint {answer.joint}: {answer.binds})",
            "never": f"none: joint {answer.joint}: {answer.binds} is exceeded whatever it is",
            "unlimited": "no limit found by the checks that can be made",
        }[answer.status]
        lines.append(f"{question:18} {text}")
    return lines


def selection_lines(selection: Sequence[dict[str, Any]]) -> list[str]:
    """Of `selection` in what `size --json` prints: the best pairs of each joint, and what rules out the others."""
    head = (
        "motor",
        "gear",
        "adequate",
        "binds",
        "margin",
        "g",
        "mm",
        "load/rotor inertia",
        "to bus mJ",
    )
    lines = []
    for joint in selection:
        answers = [answer for row in joint["adequate"] for answer in row]
        counts = [sum(each is word for each in answers) for word in (True, None, False)]
        lines += [
            "",
            f"{joint['joint']}: {len(joint['motors'])} motors × {len(joint['gears'])} gears",
        ]
        lines[-1] += (
            f": {counts[0]} suffice, {counts[1]} not known, {counts[2]} ruled out; by {joint['rank']}"
        )
        rows = []
        for pair in joint["best"]:
            margin = None if pair["binds"] is None else pair["margins"].get(pair["binds"])
            figures = (
                (pair["mass"], 1e3),
                (pair["length"], 1e3),
                (pair["inertia_ratio"], 1.0),
                (pair["energy_to_bus"], 1e3),
            )
            cells = (
                NOTHING if value is None else number(scale * value) for value, scale in figures
            )
            says = (LOUD[pair["adequate"]], words(pair["binds"] or NOTHING), percent(margin))
            rows.append((pair["motor"], pair["gear"], *says, *cells))
        lines += Table(head, rows, range(4, len(head))).lines() if rows else ["nothing is left"]
        reasons = [f"{words(name)} {count}" for name, count in joint["reasons"].items()]
        missing = {
            f"{words(name)}: {needs}"
            for pair in joint["best"]
            for name, needs in pair["not_checked"].items()
        }
        lines += [f"ruled out by: {', '.join(reasons)}"] if reasons else []
        lines += [f"not known: {each}" for each in sorted(missing)]
    return lines


def _requirements(sizing: Sizing) -> Table:
    head = (
        "joint",
        "peak mN·m",
        "RMS mN·m",
        "mean mN·m",
        "peak rpm",
        "peak rad/s²",
        "peak W",
        "mean W",
        "Joule W",
    )
    rows = []
    for joint in sizing.joints:
        r, confidence = joint.requirement, sizing.conditions.confidence
        peak, rms = number(1e3 * r.peak_torque, 4), number(1e3 * r.rms_torque, 4)
        if joint.band.known:
            peak += f" (≤ {number(1e3 * joint.band.high('peak_torque', confidence), 4)})"
            rms += f" (≤ {number(1e3 * joint.band.high('rms_torque', confidence), 4)})"
        figures = (
            r.mean_torque * 1e3,
            RPM * r.peak_speed,
            r.peak_acceleration,
            r.peak_power,
            r.mean_power,
        )
        rows.append(
            (r.joint, peak, rms, *(number(value, 4) for value in figures), number(r.joule_power))
        )
    return Table(head, rows, range(1, len(head)))


def _split(sizing: Sizing) -> Table:
    rows = []
    for joint in sizing.joints:
        parts = joint.requirement.split.at_peak
        sign = math.copysign(1e3, sum(parts.values()))
        rows.append((joint.load.joint, *(signed(sign * parts[name], 4) for name in PARTS)))
    return Table(("joint", *map(words, PARTS)), rows, range(1, len(PARTS) + 1))


def _candidates(sizing: Sizing) -> list[str]:
    head = ("joint", "motor", "adequate", "binds", *map(words, MOTOR_MARGINS), "gear", "winding")
    rows = []
    for verdict in (*sizing.verdicts, *sizing.alternatives):
        margins = {check.name: check.margin for check in verdict.checks}
        gear = min(
            (check.margin for check in verdict.gear if check.margin is not None), default=None
        )
        name = ("or " if verdict in sizing.alternatives else "") + verdict.motor.name
        name += " *" if verdict.motor.placeholder else ""
        shares = (percent(margin) for margin in (*(margins[key] for key in MOTOR_MARGINS), gear))
        binds = words(verdict.binds or NOTHING)
        rows.append(
            (verdict.joint, name, LOUD[verdict.adequate], binds, *shares, _winding(verdict))
        )
    lines = Table(head, rows, range(2, len(head))).lines()
    if any(verdict.motor.placeholder for verdict in sizing.verdicts):
        lines.append("* placeholder figures: no verdict on the real motor")
    return lines


def _winding(verdict: MotorVerdict) -> str:
    if verdict.heat is None:
        return NOTHING
    hottest = verdict.heat.winding
    return "no steady state" if hottest is None else f"{hottest - KELVIN:.0f} °C"


def _gears(sizing: Sizing) -> Table:
    rows = []
    for joint in sizing.joints:
        made = [
            f"{words(check.name)} {percent(check.margin)}"
            for check in joint.gear
            if check.margin is not None
        ]
        rows.append(
            (joint.load.joint, joint.load.drive.name, ", ".join(made) or "nothing could be checked")
        )
    return Table(("joint", "drive", "margins"), rows)


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
            names[words(check.name)] = None
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
            until = f"reaches {heat.limit - KELVIN:.0f} °C after {heat.time_until_limit:.4g} s"
            lines.append(f"joint {verdict.joint}, {verdict.motor.name}: the winding {until}")
    return [*lines, *dict.fromkeys(note for verdict in judged for note in verdict.notes)]


def _verdict(sizing: Sizing) -> list[str]:
    lines = ["Verdicts"]
    for joint in sizing.joints:
        lines.append(
            f"  {joint.load.joint:10} {_joint_verdict(joint, sizing.conditions.confidence)}"
        )
        lines += [
            f"  {'':10} if it is {each.motor.name}: {LOUD[each.adequate]}"
            for each in joint.alternatives
        ]
    of_what = (
        "motors and gears" if sizing.joints else "no joint has a drive: there is nothing to judge"
    )
    return [*lines, f"  all        {LOUD[sizing.adequate]} ({of_what})"]


def _joint_verdict(joint: JointSizing, confidence: float) -> str:
    best = joint.smallest
    if best is not None:
        mark = " (placeholder figures)" if best.motor.placeholder else ""
        return f"{best.motor.name} suffices with at least {100 * confidence:g} %: the smallest that does{mark}"
    if joint.adequate is None:
        return (
            "not known: what would decide it stands below" if joint.candidates else "no motor given"
        )
    return (
        "no motor of the list suffices"
        if len(joint.candidates) > 1
        else "the motor does NOT suffice"
    )


def simulation_tables(result: SimulationResult) -> tuple[Table, Table]:
    """Tracking errors joint by joint, and what the motors did, of a simulated playback."""
    errors = []
    for each in result.tracking:
        unit = "mm" if each.joint == JOINTS[3] else "mrad"
        errors.append(
            (each.joint, *(number(1e3 * value, 4) for value in (each.worst, each.rms)), unit)
        )
    motors = [
        (
            motor.joint,
            *(number(1e3 * torque, 4) for torque in (motor.peak_torque, motor.limit)),
            "SATURATED" if motor.saturated else "no",
            fixed(motor.following_error, 0),
            str(motor.window),
            "TRIPPED" if motor.tripped else "no",
        )
        for motor in result.motors
    ]
    header = (
        "motor",
        "peak mN·m",
        "largest mN·m",
        "saturated",
        "following error inc",
        "window inc",
        "tripped",
    )
    return Table(("joint", "largest error", "rms", "unit"), errors, (1, 2)), Table(
        header, motors, (1, 2, 4, 5)
    )
