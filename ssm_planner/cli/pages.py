"""Run `ssm-planner report PLAN [OTHER]`, `film PLAN`, `view [PROBLEM]` and `reproduce`."""

import sys
from argparse import Namespace

import ssm_planner as ssm
from ssm_planner.cli.shared import FAILED, OK, print_result, progress_reporter
from ssm_planner.progress import Step


def run_report(options: Namespace) -> int:
    """Write the page of a plan or of a comparison of two plans, and return the exit status.

    With the option --figures, also write the figures of the plan.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.
    """
    plan = ssm.load_plan(options.plan)
    name = "report" if options.other is None else "comparison"
    files = {name: ssm.report(plan, options.output, options.other)}
    if options.figures is not None:
        from ssm_planner.reporting import DEFAULT_WIDTH, NAMED_WIDTHS, write_figures_of_file

        files |= write_figures_of_file(
            plan, options.figures, NAMED_WIDTHS.get(options.width, DEFAULT_WIDTH)
        )
    print_result(options, {"files": files}, [f"{name}: {path}" for name, path in files.items()])
    return OK


def run_film(options: Namespace) -> int:
    """Write a film of the motion of a plan, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.
    """
    plan = ssm.load_plan(options.plan)
    path = options.output or plan.path.with_name("film")
    files = ssm.film(plan, path, options.speed)
    lines = [f"{name}: {file}" for name, file in files.items()]
    if len(files) > 1 and "film.mp4" not in files:
        lines.append("mp4: not written, because the program ffmpeg is not on the PATH")
    print_result(options, {"files": files}, lines)
    return OK


def run_view(options: Namespace) -> int:
    """Serve the local page until Ctrl-C, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.
    """
    with ssm.serve_view(options.problem, options.port) as server:
        print(f"{server.url}  (Ctrl-C ends it)", file=sys.stderr, flush=True)
        if not options.no_browser:
            import webbrowser

            webbrowser.open(server.url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print("", file=sys.stderr)
    return OK


def run_reproduce(options: Namespace) -> int:
    """Recompute the tables and figures of the paper, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0 if every motion was planned and passed the check, and 1 otherwise.
    """
    progress = progress_reporter()
    folder = options.output / "paper"
    outcome = ssm.reproduce(folder, options.problems, options.recordings, progress)
    progress(Step("done"))
    left_out = outcome.left_out
    result = {"passed": outcome.passed, "left_out": left_out, "files": outcome.files}
    lines = [f"left out: {line}" for line in left_out] + [f"Results: {folder}"]
    print_result(options, result, lines)
    return OK if outcome.passed else FAILED
