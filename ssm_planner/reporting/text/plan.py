"""The table on the terminal, ending with the verdicts."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ssm_planner.plans import Plan
from ssm_planner.reporting.text.sizing import motors_verdict

SHOWN = {"rad": ("deg", 180 / math.pi), "m": ("mm", 1e3), "N·m": ("mN·m", 1e3)}


def summary_lines(plan: Plan) -> list[str]:
    """Phases, motors, limits, what is unknown, and the verdicts."""
    if plan.trajectory is None:
        reason = plan.reason.message if plan.reason else plan.status
        lines = [f"{plan.problem.name}: no plan ({plan.status})", f"  reason: {reason}"]
        if plan.reason is not None and plan.reason.relaxation:
            lines.append(f"  would do: {plan.reason.relaxation}")
        return lines
    lines = [f"{plan.problem.name}, robot {plan.problem.robot.name}", ""]
    phases = [
        (phase.phase.motion.name, f"{phase.duration:.4f}", _seconds(phase.toppra_duration), f"{phase.lower_bound:.4f}")
        for phase in plan.phases
    ]
    total = ("total", f"{plan.duration:.4f}", _seconds(plan.toppra_duration), f"{plan.lower_bound:.4f}")
    lines += _table(("phase", "duration s", "TOPP-RA s", "lower bound s"), [*phases, total])
    lines += ["", *_motor_table(plan), "", *_limit_table(plan)]
    if plan.notes:
        lines += ["", "What is not known", *(f"  {note}" for note in plan.notes)]
    if plan.reason is not None:
        lines += ["", plan.reason.message]
        if plan.reason.relaxation:
            lines.append(f"would do: {plan.reason.relaxation}")
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
        speed = f"{r.peak_speed * 30 / math.pi:.0f}"
        rows.append((r.joint, f"{1e3 * r.peak_torque:.4g}", f"{1e3 * r.rms_torque:.4g}", limit, speed))
    return _table(("motor of joint", "peak mN·m", "RMS mN·m", "largest / nominal mN·m", "peak rpm"), rows)


def _limit_table(plan: Plan) -> list[str]:
    if plan.certificate is None:
        return []
    rows = []
    for limit in sorted(plan.certificate.limits, key=lambda limit: limit.margin):
        if limit.name.endswith("jump"):
            continue
        unit, scale = _shown(limit.unit)
        rows.append(
            (
                limit.name,
                limit.joint or "",
                f"{scale * limit.worst:.5g}",
                f"{scale * limit.limit:.5g}",
                unit,
                f"{100 * limit.margin:+.4f} %",
                f"{limit.time:.3f}",
            )
        )
    return _table(("limit", "joint", "worst", "limit", "unit", "margin", "at s"), rows)


def _shown(unit: str) -> tuple[str, float]:
    base, slash, per = unit.partition("/")
    name, scale = SHOWN.get(base, (base, 1.0))
    return name + slash + per, scale


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        first = cells[0].ljust(widths[0])
        return "  ".join(
            [first, *(cell.rjust(width) for cell, width in zip(cells[1:], widths[1:], strict=True))]
        ).rstrip()

    return [line(header), "  ".join("-" * width for width in widths), *(line(row) for row in rows)]
