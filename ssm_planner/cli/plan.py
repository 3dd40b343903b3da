"""Run `ssm-planner plan PROBLEM`, which plans, checks and sizes a motion and writes its results."""

from argparse import Namespace
from pathlib import Path

from ssm_planner.cli.shared import FAILED, OK, print_result, progress_reporter
from ssm_planner.cli.terminal import shorten
from ssm_planner.progress import Step


def run_plan(options: Namespace) -> int:
    """Plan a motion, write its result folder, and return the exit status.

    With --from and --at, the motion starts at an instant of another plan.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0 if a motion was found and passed the check, and 1 otherwise.
    """
    from ssm_planner.reporting import FigureProcess

    progress = progress_reporter(f"reading {options.problem}")
    # The process starts before the planning, so that it is ready when the plan is.
    with FigureProcess() as drawer:
        from ssm_planner.loading import load_problem
        from ssm_planner.pipeline.run import plan_to_folder, starting_from
        from ssm_planner.plans import load_plan
        from ssm_planner.publishing import file_name
        from ssm_planner.reporting import explanation_lines, summary_lines

        current_plan = getattr(options, "from")  # `from` is a keyword of Python.
        problem = load_problem(options.problem)
        name = file_name(problem.name)
        if current_plan is not None:
            problem = starting_from(problem, load_plan(current_plan), options.at)
            name += "_replanned"  # The plan that the robot is executing must remain.
        folder = options.output or Path("results") / name
        result, files = plan_to_folder(problem, folder, progress, drawer, options.rate)
    progress(Step("done"))
    lines = summary_lines(result, options.verbose)
    lines.append(f"file     {files['report' if result.passed else 'page']}")
    if not options.verbose:
        lines = shorten(lines)
    if options.explain:
        lines = explanation_lines(result) + lines
    print_result(options, {**result.summary(), "files": files}, lines)
    return OK if result.passed else FAILED
