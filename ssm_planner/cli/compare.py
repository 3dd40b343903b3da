"""`ssm-planner compare PLAN RECORDING...`: an executed motion against its plan."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ssm_planner.cli.output import FAILED, OK, progress_reporter, show, shown_unit

if TYPE_CHECKING:
    from ssm_planner.comparison import AxisComparison


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("plan", type=Path, help="plan.json")
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="[JOINT=]RECORDING",
        help="EPOS recorder exports or CSV, one for each axis; the joint is taken from the file's name where not given",
    )
    parser.add_argument(
        "--counts-per-turn", type=int, metavar="N", help="increments per motor turn of a position channel"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(options: argparse.Namespace) -> int:
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
    from ssm_planner.reporting.text import text_table

    header = ("axis", "recording", "begins at s", "correlation", "NRMSD position", "speed", "torque")
    rows = [
        (
            axis.joint,
            axis.recording,
            f"{axis.alignment.delay:.4f}",
            f"{axis.alignment.correlation:.4f}",
            *(_share(axis.differences[name].nrmsd) for name in ("position", "speed", "torque")),
        )
        for axis in axes
    ]
    lines = [*text_table(header, rows), ""]
    rows = []
    for axis in axes:
        for limit in axis.limits:
            unit, scale = shown_unit(limit.unit, limit.name)
            planned = "–" if limit.planned_margin is None else f"{100 * limit.planned_margin:+.2f} %"
            values = (f"{scale * limit.measured:.5g}", f"{scale * limit.limit:.5g}", unit)
            verdict = "held" if limit.held else "EXCEEDED"
            rows.append((limit.name, axis.joint, *values, planned, f"{100 * limit.margin:+.2f} %", verdict))
    lines += text_table(("limit", "joint", "measured", "limit", "unit", "margin planned", "measured", ""), rows)
    notes = [f"note: {axis.joint}: {note}" for axis in axes for note in axis.notes]
    held = all(axis.held for axis in axes)
    return [*lines, "", *notes, f"margins: {'held in reality' if held else 'NOT held in reality'}"]


def _share(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"
