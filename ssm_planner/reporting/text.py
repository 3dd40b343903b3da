"""Format plans and sizing results as text and tables for the terminal and for pages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, zip_longest
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ssm_planner.display import NOTHING, columns, format_fixed, number, percent, plain_words, signed
from ssm_planner.problem.limits import (
    JUMPS,
    READ_IN,
    LensClearance,
    MotorTorque,
    RetinaClearance,
    SelfLocking,
)
from ssm_planner.problem.motion import Free
from ssm_planner.problem.robot import JOINTS
from ssm_planner.sizing.assess import MotorVerdict
from ssm_planner.sizing.requirements import PARTS, MotorRequirement
from ssm_planner.sizing.size import JointSizing, Sizing, WhatIf
from ssm_planner.units import RPM, display_unit
from ssm_planner.verification.certificate import LimitCheck

if TYPE_CHECKING:  # `check` prints tables without loading the planner.
    from ssm_planner.plans import PhaseSummary, Plan
    from ssm_planner.simulation.simulate import SimulationResult

SizingObject = Mapping[str, Any]
"""Object that `size --json` prints and plan.json contains."""
ANSWERS = {True: "yes", False: "no", None: "not known"}
LOUD = {**ANSWERS, False: "NO"}
MOTOR_MARGINS = ("torque", "speed", "continuous_torque", "voltage", "heat")
KELVIN = 273.15
FLOORS = (SelfLocking.name, RetinaClearance.name, LensClearance.name)
BINDING = 0.005
"""Margin up to which a limit binds, as in the plots of the report."""
LOWEST = {"max_torque": "torque", "max_speed": "speed", "nominal_torque": "continuous_torque"}
"""Check that a motor would fail if this figure of its file were lower."""
AGREES_IPOPT = 1e-6
"""Largest relative difference at which Ipopt confirms a duration, as in `planning/ocp`."""


@dataclass(frozen=True)
class Table:
    """A table of text. `numbers` holds the indices of right-aligned columns."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Sequence[int] = ()
    caption: str = ""

    def lines(self, width: int | None = None) -> list[str]:
        """Return the lines of the table for the terminal or another width, with a ruled heading.

        Cells that are too wide are wrapped. Columns that still do not fit continue in a second
        table below.
        """
        limit = columns() if width is None else width
        widths = self._widths(limit)
        fit = sum(
            end <= limit for end in accumulate(width + 2 for width in [widths[0] - 2, *widths[1:]])
        )
        label = next((i for i in range(len(widths)) if i in self.numbers), 1)
        if label < fit < len(widths):
            return [
                *self._select(range(fit)).lines(limit),
                "",
                *self._select([*range(label), *range(fit, len(widths))]).lines(limit),
            ]
        rows = [self.header, ["-" * width for width in widths], *self.rows]
        return [
            "  ".join(self._aligned(line, widths)).rstrip()
            for row in rows
            for line in _wrapped(row, widths)
        ]

    def _select(self, places: Sequence[int]) -> Table:
        """Return a table with the selected columns."""
        rows = [[row[i] for i in places] for row in self.rows]
        numbers = [k for k, i in enumerate(places) if i in self.numbers]
        return Table([self.header[i] for i in places], rows, numbers)

    def _widths(self, most: int) -> list[int]:
        """Return the widths of the columns.

        The widest columns become narrower, down to their longest word, until all columns fit into
        `most`.
        """
        cells = [*zip(self.header, *self.rows, strict=True)]
        widths = [max(map(len, column)) for column in cells]
        least = [
            max(len(word) for cell in column for word in (cell.split() or [""])) for column in cells
        ]
        for i in self.numbers:  # Numbers stay on one line, but their headings may be wrapped.
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
    """Yield the lines of a row, with each cell wrapped to its column."""
    cells = [
        wrap(cell, max(width, 1), break_on_hyphens=False) or [""]
        for cell, width in zip(row, widths, strict=True)
    ]
    return zip_longest(*cells, fillvalue="")


class Judged(Protocol):
    """A limited quantity, from a certificate or a recording."""

    @property
    def name(self) -> str:
        """Name of the limit."""

    @property
    def unit(self) -> str:
        """SI unit of the limit."""


def unit_of_limit(limit: Judged, degree: str = "deg") -> tuple[str, float]:
    """Return the display unit of a limit and its factor from SI. Motor speeds are in rpm."""
    return display_unit(READ_IN.get(limit.name, limit.unit), degree)


def limit_cells(limit: LimitCheck, degree: str = "deg") -> tuple[str, str, str, str, str, str]:
    """Return name, joint, worst value, limit with its sense, unit and margin of a limit as text."""
    unit, scale = unit_of_limit(limit, degree)
    beyond = limit.worst - limit.limit
    floor = limit.name in FLOORS or (
        abs(beyond) > 1e-5 * abs(limit.limit) + 1e-9 and (beyond > 0) == limit.passed
    )
    worst, bound = number(scale * limit.worst, 6), number(scale * limit.limit, 6)
    bound = f"{'≥' if floor else '≤'} {bound}"
    return limit.name, limit.joint or "", worst, bound, unit, percent(limit.margin, 4)


def limits_table(limits: Iterable[LimitCheck]) -> Table:
    """Build the table of all limits, smallest margin first.

    Limits on jumps are listed only if they are exceeded.
    """
    rows = [
        (*limit_cells(limit), format_fixed(limit.time, 4), "" if limit.passed else "EXCEEDED")
        for limit in sorted(limits, key=lambda limit: limit.margin)
        if limit.name not in JUMPS or not limit.passed
    ]
    return Table(
        ("limit", "joint", "worst", "limit", "unit", "margin", "at s", ""), rows, (2, 3, 5, 6)
    )


def phases_table(plan: Plan) -> Table:
    """Build the table of phase durations with TOPP-RA's durations and the lower bounds."""
    entries: list[tuple[str, PhaseSummary | Plan]] = [(phase.name, phase) for phase in plan.phases]
    rows = [
        (
            name,
            *(
                format_fixed(value, 4)
                for value in (entry.duration, entry.toppra_duration, entry.lower_bound)
            ),
        )
        for name, entry in [*entries, ("total", plan)]
    ]
    return Table(("phase", "duration s", "TOPP-RA s", "lower bound s"), rows, (1, 2, 3))


def candidates_table(plan: Plan) -> Table:
    """Return the ways to move every phase that were tried, and why each was not taken."""
    names = [phase.name for phase in plan.phases]
    rows = []
    for name, candidates in zip_longest(names, plan.candidates, fillvalue=()):
        for each in candidates:
            times = (each["bound"], each["estimate"], each["duration"])
            shown_times = (NOTHING if value is None else format_fixed(value, 4) for value in times)
            rows.append((name or NOTHING, each["kind"], *shown_times, each["outcome"]))
    header = ("phase", "candidate", "bound s", "estimate s", "duration s", "outcome")
    return Table(header, rows, (2, 3, 4))


def explanation(plan: Plan) -> list[str]:
    """Return the lines of `--explain`: the candidates, and what further reversals would save."""
    remaining = [
        f"{phase.name}: a further reversal would save {phase.reversal_multiplier:.1e} of the "
        "duration, to first order"
        for phase in plan.phases
        if phase.reversal_multiplier is not None
    ]
    return [*candidates_table(plan).lines(), "", *remaining, *([""] if remaining else [])]


def joints_table(plan: Plan) -> Table:
    """Build the table of joint positions at the start and the end of the motion.

    They show which of the configurations that reach the points is used.
    """
    ends = plan.motion.sample(np.array([0.0, plan.motion.duration])).q
    rows = []
    for joint, (start, end) in zip(plan.problem.robot.joints, ends.T, strict=True):
        unit, scale = display_unit(joint.unit)
        rows.append((joint.name, number(scale * start, 5), number(scale * end, 5), unit))
    return Table(("joint", "from", "to", "unit"), rows, (1, 2))


def motors_table(requirements: Iterable[MotorRequirement]) -> Table:
    """Build the table of the motors' requirements and ratings."""
    rows = []
    for r in requirements:
        motor = r.motor
        required = (
            number(1e3 * r.peak_torque, 4),
            number(1e3 * r.rms_torque, 4),
            format_fixed(RPM * r.peak_speed, 0),
        )
        rated = (NOTHING,) * 3
        if motor is not None:
            torques = number(1e3 * motor.max_torque, 4), number(1e3 * motor.nominal_torque, 4)
            rated = *torques, format_fixed(RPM * motor.max_speed, 0)
        pairs = (f"{a} of {b}" for a, b in zip(required, rated, strict=True))
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


def summary_lines(plan: Plan, folder: Path | None = None, verbose: bool = False) -> list[str]:
    """Return the summary of a plan, which ends with its `answers`.

    Parameters
    ----------
    plan : Plan
    folder : Path, optional
        Folder of the written results.
    verbose : bool, optional
        Add solvers, motors, joints, limits and unknowns.
    """
    if plan.trajectory is None:
        reason = plan.reason.message if plan.reason else plan.status
        lines = [f"{plan.problem.name}: no plan ({plan.status})", f"  reason: {reason}"]
        if plan.reason is not None and plan.reason.relaxation:
            lines.append(f"  relaxation: {plan.reason.relaxation}")
        return lines
    lines = verdicts(plan) if verbose else conditions(plan)
    lines = [
        f"{plan.problem.name}, robot {plan.problem.robot.name}",
        *([""] if lines else []),
        *lines,
    ]
    if plan.reason is not None:
        lines += ["", plan.reason.message]
        if plan.reason.relaxation:
            lines.append(f"relaxation: {plan.reason.relaxation}")
    tables = [phases_table(plan)]
    if verbose:
        limits = () if plan.certificate is None else plan.certificate.limits
        tables += joints_table(plan), motors_table(plan.requirements), limits_table(limits)
    for table in tables:
        lines += ["", *table.lines()] if table.rows else []
    if verbose and plan.notes:
        lines += ["", "What is not known", *(f"  {note}" for note in plan.notes)]
    reason = "" if plan.sizing is None else motors_verdict(plan.sizing.to_dict())[2]
    return [*lines, "", *([f"Motors: {reason}", ""] if reason else []), *answers(plan, folder)]


def answers(plan: Plan, folder: Path | None = None) -> list[str]:
    """Return the time, the check, the closest limit, the motors and the file of a plan.

    Each answer is one line. The closest limit is the closest of those that do not bind by design.
    """
    bound = f"{format_fixed(plan.lower_bound, 4)} s"
    lines = [
        f"time     {format_fixed(plan.duration, 4)} s; no motion on this path is shorter than {bound}"
    ]
    if any(motion.kind == Free.kind for motion in plan.problem.motion):
        lines = [
            f"time     {format_fixed(plan.duration, 4)} s; lower bound {bound}, loose for free motions"
        ]
    certificate = plan.certificate
    if plan.uncertified_reason is not None or certificate is None:
        lines.append(
            f"check    NOT CERTIFIED: {plan.uncertified_reason or 'the plan has no certificate'}"
        )
    else:
        limits, violations = certificate.limits, certificate.violations
        bind = sum(limit.margin <= BINDING for limit in limits)
        lines.append(
            f"check    FAILED: {len(violations)} of {len(limits)} limits exceeded"
            if violations
            else f"check    PASSED: {len(limits)} limits kept; {bind} of them bind by design"
        )
        if (limit := closest_limit(limits)) is not None:
            name, joint, worst, allowed, unit, _ = limit_cells(limit)
            of = f" of {joint}" if joint else ""
            margin = percent(limit.margin)
            lines.append(f"closest  {name}{of}: {worst} ({allowed} {unit}), margin {margin}")
    if plan.sizing is not None:
        outcome = motors_verdict(plan.sizing.to_dict())[1]
        lines.append(f"motors   {outcome.removeprefix('Motors ')}")
    return [*lines, *([] if folder is None else [f"file     {folder / 'report.html'}"])]


def closest_limit(limits: Iterable[LimitCheck]) -> LimitCheck | None:
    """Return the limit with the smallest margin among those that do not bind by design.

    A limit binds by design if the motion uses it up, as the fastest motion and its points do.
    """
    rest = (each for each in limits if each.margin > BINDING and each.name not in JUMPS)
    return min(rest, key=lambda each: each.margin, default=None)


def rate_words(rates: Mapping[str, float]) -> str:
    """Format rates of task coordinates, for example "tilt -10 deg/s"."""
    units = {name: display_unit("m" if name == "depth" else "rad") for name in rates}
    return ", ".join(
        f"{name} {number(units[name][1] * rate, 4)} {units[name][0]}/s"
        for name, rate in rates.items()
        if rate
    )


def solvers(plan: Plan) -> str:
    """Return the name of the solver. The phases that Ipopt solved are listed.

    The structured solver did not converge for these phases.
    """
    by_ipopt = [phase.name for phase in plan.phases if phase.solver == "Ipopt"]
    if not by_ipopt:
        return "structured"
    return (
        "Ipopt"
        if len(by_ipopt) == len(plan.phases)
        else f"structured; Ipopt in {', '.join(by_ipopt)}"
    )


def confirmation(plan: Plan) -> tuple[str, str]:
    """Return how Ipopt changes the structured solver's motions, and how the durations agree.

    Both texts are empty if only one of the solvers was used. Iterations and the last digits of the
    difference depend on rounding, so neither is shown.
    """
    if plan.confirmation is None:
        return "", ""
    difference = abs(plan.confirmation[1])
    verb, agreement = "confirms", f"durations agree within {AGREES_IPOPT:.0e}"
    if difference > AGREES_IPOPT:
        verb = "shortens"
        agreement = f"durations differ by up to {difference:.0e}: the shorter motion is used"
    alone = [
        phase.name
        for phase in plan.phases
        if phase.solver == "Ipopt" and phase.confirmation_iterations is None
    ]
    return verb, agreement + (f"; only Ipopt solved {', '.join(alone)}" if alone else "")


def range_lines(plan: Plan) -> list[str]:
    """Return the cost of a range of friction and payload, and the worst case for each motor."""
    friction, payload = plan.problem.friction, plan.problem.payload
    if friction is None and payload is None:
        return []
    ranges = [f"friction within {100 * friction:g} %"] if friction else []
    ranges += [f"payload up to {1e3 * payload[1]:g} g"] if payload else []
    cost = ""
    if plan.duration is not None and plan.nominal_duration:
        increase = 100 * (plan.duration / plan.nominal_duration - 1)
        cost = f": {increase:+.2f} % compared with {plan.nominal_duration:.4f} s without the range"
    lines = [f"range        {', '.join(ranges)}{cost}"]
    for limit in () if plan.certificate is None else plan.certificate.limits:
        if limit.name == MotorTorque.name and limit.case:
            lines.append(
                f"             joint {limit.joint}: worst, margin {100 * limit.margin:+.2f} %, at "
                f"{limit.case}"
            )
    return lines


def path_lines(plan: Plan) -> list[str]:
    """Return the deviations at corners and the constant tip speeds of phases that request them."""
    corners = [
        f"corners      {phase.name}: the tip deviates from its lines by up to "
        f"{1e3 * phase.corner_departure:.4g} mm, within "
        f"{1e3 * (phase.corner_reach or 0.0):.4g} mm of a corner"
        for phase in plan.phases
        if phase.corner_departure is not None
    ]
    constant = [
        f"tip speed    {phase.name}: {1e3 * phase.constant_speed:.4g} mm/s from "
        f"{phase.constant_from:.4f} s to "
        f"{phase.constant_to:.4f} s of its {phase.duration:.4f} s, within "
        f"{phase.constant_error:.0e}"
        for phase in plan.phases
        if phase.constant_speed is not None
    ]
    return corners + constant


def conditions(plan: Plan) -> list[str]:
    """Return what a plan was asked to keep beyond its limits, and what it does not keep."""
    lines = path_lines(plan)
    for verb, rates in (("starts", plan.problem.start_rate), ("ends", plan.problem.end_rate)):
        lines += [f"{verb:<12} at {rate_words(rates)}, as declared"] if any(rates.values()) else []
    lines += range_lines(plan)
    lines += [f"cross-check  FAILED: {text}" for text in plan.disagreements]
    if plan.certificate is not None:
        for violation in plan.certificate.violations:
            lines.append(
                f"exceeded     {violation.name} {violation.joint or ''} at t = "
                f"{violation.time:.4f} s"
            )
    return lines


def verdicts(plan: Plan) -> list[str]:
    """Return one line for each result beyond the `answers`: solvers and conditions."""
    lines = []
    if plan.duration is not None and plan.toppra_duration:
        difference = percent(plan.duration / plan.toppra_duration - 1, 3)
        lines.append(
            f"planned      {plan.duration:.4f} s, {difference} of TOPP-RA's time on the same path"
        )
    if plan.problem.planner == "fast" and plan.phases:
        lines.append(f"solver       {solvers(plan)}")
    verb, agreement = confirmation(plan)
    if verb:
        lines.append(f"cross-check  Ipopt {verb} the structured solver's motion: {agreement}")
    lines += conditions(plan)
    return lines


def motors_verdict(sizing: SizingObject) -> tuple[str, str, str]:
    """Return ("good", "bad" or "open", verdict, reason) for the motors and gears."""
    motors, gears = sizing["motors"], sizing["gears"]
    missing_motors = ", ".join(
        sorted({gear["joint"] for gear in gears} - {motor["joint"] for motor in motors})
    )
    if sizing["adequate"] is False:
        return "bad", "Motors or gears do not suffice", "; ".join(_failures(sizing))
    if not gears:
        return "open", "Motors open", "no joint has a drive"
    if missing_motors:
        return "open", "Motors open", f"no motor given for {missing_motors}"
    undecided = _undecided(sizing)
    margins = [
        (margin, f"{plain_words(name)} of {motor['joint']} is the tightest check")
        for motor in motors
        for name, margin in motor["margins"].items()
        if margin is not None
    ]
    margin, tightest = min(margins)
    lacking = f"Not checked or undecided: {', '.join(undecided)}"
    if margin < 0:
        return "open", "Motors suffice: not known", lacking
    figures = list(stand_ins(sizing))
    outcome, reasons = f"Motors suffice with {format_fixed(100 * margin, 1)} % margin", [tightest]
    if figures:
        outcome += f" if {len(figures)} stand-in figure{'s hold' if figures[1:] else ' holds'}"
        reasons.append(f"Stand-in figures: {', '.join(figures)}")
    if undecided:
        outcome += f"; {len(undecided)} check{'s' if undecided[1:] else ''} open"
        reasons.append(lacking)
    if figures or undecided:
        return "open", outcome, ". ".join(reasons)
    return (
        "good",
        "Motors and gears suffice",
        f"with at least {100 * sizing['confidence']:g} % each",
    )


def stand_ins(sizing: SizingObject) -> Iterator[str]:
    """Yield each placeholder on which a check rests, with the error that the check permits."""
    for motor in sizing["motors"]:
        margins = motor["margins"]
        electrical = margins["voltage"] is not None or margins["heat"] is not None
        for name in motor["placeholders"]:
            margin = margins.get(LOWEST.get(name))
            if margin is not None:
                spare = f" (may be {format_fixed(100 * margin, 1)} % lower)"
                yield f"{motor['joint']} {plain_words(name)}{spare}"
            elif electrical and name not in (*LOWEST, "encoder_counts"):
                yield f"{motor['joint']} {plain_words(name)}"
    for gear in sizing["gears"]:
        if any(margin is not None for margin in gear["margins"].values()):
            yield from (f"{gear['joint']} {plain_words(name)}" for name in gear["placeholders"])


def missing_figures(sizing: SizingObject) -> Iterator[tuple[str, str, str, str]]:
    """Yield (joint, motor or gear, skipped checks, missing values) for each part with unknowns."""
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


def _undecided(sizing: SizingObject) -> list[str]:
    """Return the checks that lack a value for some joint. All checks of gears count as one."""
    of_gears = _gear_checks(sizing)
    return list(
        dict.fromkeys(
            "gear" if name in of_gears else plain_words(name)
            for part in (*sizing["motors"], *sizing["gears"])
            for name in part["not_checked"]
        )
    )


def _failures(sizing: SizingObject) -> list[str]:
    """Return joint, check and margin of each failed check."""
    failed = {
        (motor["joint"], check["name"]): check["margin"]
        for motor in sizing["motors"]
        for check in motor["checks"]
        if check["passed"] is False
    }
    for gear in sizing["gears"]:
        if gear["adequate"] is False:
            failed.setdefault((gear["joint"], gear["binds"]), gear["margins"][gear["binds"]])
    return [
        f"{joint}: {plain_words(name)} {percent(margin)}"
        for (joint, name), margin in failed.items()
    ]


def _gear_checks(sizing: SizingObject) -> set[str]:
    return {name for gear in sizing["gears"] for name in gear["margins"]}


def _lacking(lacking: Mapping[str, str]) -> tuple[str, str]:
    figures = dict.fromkeys(figure for needs in lacking.values() for figure in needs.split(" and "))
    return ", ".join(plain_words(name) for name in lacking), ", ".join(figures)


def sizing_lines(sizing: Sizing) -> list[str]:
    """Return the text of a sizing: unknowns, requirements, split, candidates and gears.

    `sizing_verdict` ends the text.
    """
    has_bands = all(joint.band.known for joint in sizing.joints)
    confidence = (
        f"at {100 * sizing.conditions.confidence:g} % confidence"
        if has_bands
        else "at the stated friction"
    )
    unknowns = [
        f"joint {joint}, {part}: {checks} not checked: needs {figures}"
        for joint, part, checks, figures in missing_figures(sizing.to_dict())
    ]
    unknowns += _notes(sizing)
    lines = ["What is not known", *(f"  {line}" for line in unknowns), ""] if unknowns else []
    lines += ["Required of the motors", *_requirements(sizing).lines(), ""]
    lines += [
        "Parts of the peak torque, mN·m (+ increases it, − reduces it)",
        *_split(sizing).lines(),
        "",
    ]
    return [
        *(*lines, f"Margins {confidence}", *_candidates(sizing), "", "Gears"),
        *_gears(sizing).lines(),
    ]


def what_if_lines(payload: WhatIf, duration: WhatIf) -> list[str]:
    """Return the lines for the largest payload and the shortest duration."""
    mass = "" if payload.value is None else f"{payload.value:.4g} kg"
    times = "" if duration.value is None else f"{duration.value:.4f} times the present one"
    lines = []
    for question, answer, value in (
        ("largest payload", payload, mass),
        ("shortest duration", duration, times),
    ):
        text = {
            "found": f"{value} (then joint {answer.joint}: {answer.binds})",
            "never": f"none: joint {answer.joint}: {answer.binds} is exceeded for every value",
            "unlimited": "the checks found no limit",
        }[answer.status]
        lines.append(f"{question:18} {text}")
    return lines


def selection_lines(selection: Sequence[dict[str, Any]]) -> list[str]:
    """Return the best pairs of motor and gear for each joint, and reasons that exclude others.

    selection: object `selection` of `size --json`.
    """
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
        counts = [sum(answer is word for answer in answers) for word in (True, None, False)]
        lines += [
            "",
            f"{joint['joint']}: {len(joint['motors'])} motors × {len(joint['gears'])} gears",
        ]
        lines[-1] += (
            f": {counts[0]} suffice, {counts[1]} not known, {counts[2]} ruled out; by "
            f"{joint['rank']}"
        )
        rows = []
        for pair in joint["best"]:
            margin = None if pair["binds"] is None else pair["margins"].get(pair["binds"])
            quantities = (
                (pair["mass"], 1e3),
                (pair["length"], 1e3),
                (pair["inertia_ratio"], 1.0),
                (pair["energy_to_bus"], 1e3),
            )
            cells = (
                NOTHING if value is None else number(scale * value) for value, scale in quantities
            )
            verdict = (
                LOUD[pair["adequate"]],
                plain_words(pair["binds"] or NOTHING),
                percent(margin),
            )
            rows.append((pair["motor"], pair["gear"], *verdict, *cells))
        lines += Table(head, rows, range(4, len(head))).lines() if rows else ["no pair remains"]
        reasons = [f"{plain_words(name)} {count}" for name, count in joint["reasons"].items()]
        missing = {
            f"{plain_words(name)}: {needs}"
            for pair in joint["best"]
            for name, needs in pair["not_checked"].items()
        }
        lines += [f"ruled out by: {', '.join(reasons)}"] if reasons else []
        lines += [f"not known: {answer}" for answer in sorted(missing)]
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
    return Table(("joint", *map(plain_words, PARTS)), rows, range(1, len(PARTS) + 1))


def _candidates(sizing: Sizing) -> list[str]:
    head = (
        "joint",
        "motor",
        "adequate",
        "binds",
        *map(plain_words, MOTOR_MARGINS),
        "gear",
        "winding",
    )
    rows = []
    for verdict in (*sizing.verdicts, *sizing.alternatives):
        margins = {check.name: check.margin for check in verdict.checks}
        gear = min(
            (check.margin for check in verdict.gear if check.margin is not None), default=None
        )
        name = ("or " if verdict in sizing.alternatives else "") + verdict.motor.name
        name += " *" if verdict.motor.placeholder else ""
        shares = (percent(margin) for margin in (*(margins[key] for key in MOTOR_MARGINS), gear))
        binds = plain_words(verdict.binds or NOTHING)
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
        margins = [
            f"{plain_words(check.name)} {percent(check.margin)}"
            for check in joint.gear
            if check.margin is not None
        ]
        rows.append(
            (joint.load.joint, joint.load.drive.name, ", ".join(margins) or "no check was possible")
        )
    return Table(("joint", "drive", "margins"), rows)


def _notes(sizing: Sizing) -> list[str]:
    lines = []
    assessed = (*sizing.verdicts, *sizing.alternatives)
    for verdict in assessed:
        heat = verdict.heat
        if heat is not None and heat.time_until_limit is not None:
            duration = f"reaches {heat.limit - KELVIN:.0f} °C after {heat.time_until_limit:.4g} s"
            lines.append(f"joint {verdict.joint}, {verdict.motor.name}: the winding {duration}")
    return [*lines, *dict.fromkeys(note for verdict in assessed for note in verdict.notes)]


def sizing_verdict(sizing: Sizing) -> list[str]:
    """Return the verdict on the motors and gears of each joint, and on all of them."""
    lines = ["", "Verdicts"]
    for joint in sizing.joints:
        lines.append(
            f"  {joint.load.joint:10} {_joint_verdict(joint, sizing.conditions.confidence)}"
        )
        lines += [
            f"  {'':10} with {alternative.motor.name}: {LOUD[alternative.adequate]}"
            for alternative in joint.alternatives
        ]
    _, outcome, reason = motors_verdict(sizing.to_dict())
    if sizing.adequate is not None:
        return [*lines, f"Motors and gears suffice: {LOUD[sizing.adequate]}"]
    return [*lines, f"  why        {reason}", outcome]


def _joint_verdict(joint: JointSizing, confidence: float) -> str:
    smallest = joint.smallest
    if smallest is not None:
        mark = " (placeholder figures)" if smallest.motor.placeholder else ""
        return f"{smallest.motor.name}: smallest suitable motor at {100 * confidence:g} %{mark}"
    if joint.adequate is None:
        return (
            "not known: the missing values are listed above"
            if joint.candidates
            else "no motor given"
        )
    return (
        "no motor of the list suffices"
        if len(joint.candidates) > 1
        else "the motor does NOT suffice"
    )


def simulation_tables(result: SimulationResult) -> tuple[Table, Table]:
    """Build the tables of a simulated playback: tracking errors by joint, and loads by motor."""
    errors = []
    driven = [motor.joint for motor in result.motors]
    for tracking in (each for each in result.tracking if each.joint in driven):
        unit = "mm" if tracking.joint == JOINTS[3] else "mrad"
        errors.append(
            (
                tracking.joint,
                *(number(1e3 * value, 4) for value in (tracking.worst, tracking.rms)),
                unit,
            )
        )
    motors = [
        (
            motor.joint,
            *(number(1e3 * torque, 4) for torque in (motor.peak_torque, motor.limit)),
            "SATURATED" if motor.saturated else "no",
            format_fixed(motor.following_error, 0),
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
