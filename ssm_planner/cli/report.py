"""`ssm-planner report PLAN` and `ssm-planner report A B`."""

from __future__ import annotations

import argparse
from pathlib import Path

from ssm_planner.cli.output import OK, show


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("plan", type=Path, help="plan.json, or the result folder that holds it")
    parser.add_argument("other", type=Path, nargs="?", help="a second one, to compare the first with")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="page to write (default: report.html or comparison.html beside PLAN)",
    )
    parser.add_argument(
        "--figures", type=Path, metavar="DIR", help="also write the figures of PLAN there, as PNG and PDF"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(options: argparse.Namespace) -> int:
    from ssm_planner.plans import load_plan
    from ssm_planner.reporting.html.compare import write_comparison
    from ssm_planner.reporting.html.report import write_report

    plan = load_plan(options.plan)
    if options.other is None:
        files = {"report": write_report(plan, options.output or plan.path.with_name("report.html"))}
    else:
        out = options.output or plan.path.with_name("comparison.html")
        files = {"comparison": write_comparison(plan, load_plan(options.other), out)}
    if options.figures is not None:
        from ssm_planner.reporting.figures.process import write_figures_of_file

        files |= write_figures_of_file(plan, options.figures)
    named = {name: str(path) for name, path in files.items()}
    show(options.json, {"files": named}, lambda: [f"{name}: {path}" for name, path in named.items()])
    return OK
