"""`ssm-planner compare PLAN RECORDING...`: an executed motion against its plan."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ssm_planner.cli.shared import FAILED, OK, output_arguments, plan_argument, progress_reporter, show

if TYPE_CHECKING:
    from ssm_planner.comparison import AxisComparison


def compare_arguments(parser: argparse.ArgumentParser) -> None:
    plan_argument(parser)
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="[JOINT=]RECORDING",
        help="EPOS recorder exports or CSV, one for each axis; the joint is taken from the file's name where not given",
    )
    parser.add_argument(
        "--counts-per-turn", type=int, metavar="N", help="increments per motor turn of a position channel"
    )
    output_arguments(parser)


def run_compare(options: argparse.Namespace) -> int:
    progress = progress_reporter()
    progress(f"reading {options.plan}")
    from ssm_planner.comparison import assign, compare, read_measured
    from ssm_planner.plans import load_plan

    plan = load_plan(options.plan)
    axes = []
    for joint, path in assign(options.recordings, plan.robot):
        progress(f"comparing joint {joint}")
        measured = read_measured(path, plan.robot, joint, options.counts_per_turn)
        axes.append(compare(plan.motion, plan.robot, plan.certificate, measured))
    progress("done")
    held = all(axis.held for axis in axes)
    document = {"plan": str(options.plan), "held": held, "axes": [axis.to_dict() for axis in axes]}
    show(options.json, document, lambda: compare_lines(axes))
    return OK if held else FAILED


def compare_lines(axes: list[AxisComparison]) -> list[str]:
    """Errors of every axis, then its limits in reality beside the planned margins."""
    from ssm_planner.display import fixed, number, percent
    from ssm_planner.reporting.text import Table, unit_of_limit

    errors = []
    for axis in axes:
        shares = (fixed(axis.differences[name].nrmsd, 4) for name in ("position", "speed", "torque"))
        found = axis.alignment
        errors.append((axis.joint, axis.recording, fixed(found.delay, 4), fixed(found.correlation, 4), *shares))
    header = ("axis", "recording", "begins at s", "correlation", "NRMSD position", "speed", "torque")
    lines = [*Table(header, errors, range(2, 7)).lines(), ""]
    rows = []
    for axis in axes:
        for limit in axis.limits:
            unit, scale = unit_of_limit(limit)
            values = number(scale * limit.measured, 5), number(scale * limit.limit, 5), unit
            margins = percent(limit.planned_margin, 2), percent(limit.margin, 2)
            rows.append((limit.name, axis.joint, *values, *margins, "held" if limit.held else "EXCEEDED"))
    of_limits = ("limit", "joint", "measured", "limit", "unit", "margin planned", "measured", "")
    lines += Table(of_limits, rows, (2, 3, 5, 6)).lines()
    notes = [f"note: {axis.joint}: {note}" for axis in axes for note in axis.notes]
    held = all(axis.held for axis in axes)
    return [*lines, "", *notes, f"margins: {'held in reality' if held else 'NOT held in reality'}"]
