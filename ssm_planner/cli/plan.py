"""`ssm-planner plan PROBLEM`."""

from __future__ import annotations

import argparse
from pathlib import Path

from ssm_planner.cli.shared import (
    FAILED,
    OK,
    output_arguments,
    progress_reporter,
    quantity_argument,
    rate_argument,
    show,
)
from ssm_planner.errors import ProblemError


def plan_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "problem", type=Path, help="problem file (YAML), or a shipped name such as tilt_insert"
    )
    parser.add_argument(
        "--rate",
        type=rate_argument,
        metavar="HZ",
        help="rows per second of trajectory.csv (default: 1000; a power of ten less where these were more than 100 000 rows)",
    )
    parser.add_argument(
        "--from",
        type=Path,
        dest="moving",
        metavar="PLAN",
        help="begin while the robot moves as in this plan (plan.json or its folder), in the place of the problem's start",
    )
    parser.add_argument(
        "--at",
        type=quantity_argument("time"),
        metavar="TIME",
        help="with --from: the instant of that plan, such as 1.2s",
    )
    output_arguments(parser, "result folder (default: results/<problem name>)")


def run_plan(options: argparse.Namespace) -> int:
    from ssm_planner.reporting.figures.process import FigureProcess

    progress = progress_reporter()
    progress(f"reading {options.problem}")
    with FigureProcess() as drawer:  # first of all, so that it is ready when the plan is
        from ssm_planner.loading.load import load_problem
        from ssm_planner.pipeline.folder import load_plan
        from ssm_planner.pipeline.run import begun_at, plan_to_folder
        from ssm_planner.publishing import file_name
        from ssm_planner.reporting.text import summary_lines

        if (options.moving is None) != (options.at is None):
            raise ProblemError(
                "where does the motion begin?",
                key="--at",
                allowed="--from PLAN and --at TIME together",
            )
        problem = load_problem(options.problem)
        if options.moving is not None:
            problem = begun_at(problem, load_plan(options.moving), options.at)
        folder = options.output or Path("results") / file_name(problem.name)
        result, files = plan_to_folder(problem, folder, progress, drawer, options.rate)
    progress("done")
    document = {**result.summary(), "files": {name: str(path) for name, path in files.items()}}
    show(
        options.json,
        document,
        lambda: [*summary_lines(result), *(("", f"Results: {folder}") if files else ())],
    )
    return OK if result.passed else FAILED
