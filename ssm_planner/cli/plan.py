"""Run `ssm-planner plan PROBLEM`, which plans, checks and sizes a motion and writes its results."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from ssm_planner.cli.shared import (
    FAILED,
    OK,
    output_arguments,
    progress_reporter,
    quantity_option,
    rate_argument,
    show,
)
from ssm_planner.cli.terminal import shorten
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step


def plan_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the command `plan`."""
    parser.add_argument(
        "problem", type=Path, help="problem file (YAML), or a shipped name such as tilt_insert"
    )
    parser.add_argument(
        "--rate",
        type=rate_argument,
        metavar="HZ",
        help="rows per second of trajectory.csv (default: 1000, reduced by powers of ten to at "
        "most 100 000 rows)",
    )
    parser.add_argument(
        "--from",
        type=Path,
        dest="moving",
        metavar="PLAN",
        help="begin during the motion of this plan (plan.json or its folder) instead of at the "
        "problem's start",
    )
    quantity_option(parser, "--at", "time", "with --from: the time in that plan, such as 1.2s")
    parser.add_argument(
        "--explain",
        action="store_true",
        help="list the ways to move every phase that were tried, and why each was not taken",
    )
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="print all phases, motors, limits and unknowns"
    )
    output_arguments(
        parser,
        "result folder (default: results/<problem name>, or <problem name>_replanned with --from)",
    )


def run_plan(options: Namespace) -> int:
    """Plan a motion, write its result folder, and return the exit status."""
    from ssm_planner.reporting import FigureProcess

    progress = progress_reporter(f"reading {options.problem}")
    # The process starts before the planning, so that it is ready when the plan is.
    with FigureProcess() as drawer:
        from ssm_planner.loading import load_problem
        from ssm_planner.pipeline.run import plan_to_folder, starting_from
        from ssm_planner.plans import load_plan
        from ssm_planner.publishing import file_name
        from ssm_planner.reporting import explanation, summary_lines

        if (options.moving is None) != (options.at is None):
            raise ProblemError(
                "--from needs a time in its plan",
                key="--at",
                allowed="--from PLAN and --at TIME together",
            )
        problem = load_problem(options.problem)
        if options.moving is not None:
            problem = starting_from(problem, load_plan(options.moving), options.at)
        # A plan must not replace the one that the robot is executing.
        name = file_name(problem.name) + ("" if options.moving is None else "_replanned")
        folder = options.output or Path("results") / name
        result, files = plan_to_folder(problem, folder, progress, drawer, options.rate)
    progress(Step("done"))
    text = summary_lines(result, folder if result.passed else None, options.verbose)
    text += [f"file     {files['page']}"] if "page" in files else []
    document = {**result.summary(), "files": files}
    show(
        options.json,
        document,
        lambda: [
            *(explanation(result) if options.explain else ()),
            *(text if options.verbose else shorten(text)),
        ],
    )
    return OK if result.passed else FAILED
