"""Run `ssm-planner report PLAN [OTHER]`, `film PLAN`, `view [PROBLEM]` and `reproduce`."""

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

import ssm_planner as ssm
from ssm_planner.cli.shared import (
    FAILED,
    OK,
    output_arguments,
    output_file,
    plan_argument,
    progress_reporter,
    quantity_option,
    show,
)
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step


def report_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the command `report`."""
    plan_argument(parser)
    parser.add_argument("other", type=Path, nargs="?", help="second plan for a comparison")
    output_arguments(parser, "folder of the page (default: that of PLAN); FILE.html names the page")
    parser.add_argument(
        "--figures",
        type=Path,
        metavar="DIR",
        help="also write the figures of PLAN there, as PNG (300 dpi) and PDF",
    )
    parser.add_argument(
        "--width",
        choices=("single", "double", "slide"),
        help="width of the figures: one (89 mm) or two columns (182 mm), or a slide (203 mm); "
        "default 229 mm",
    )


def run_report(options: Namespace) -> int:
    """Write the page of a plan or of a comparison of two plans, and return the exit status."""
    if options.width is not None and options.figures is None:
        raise ProblemError(
            "--width requires a folder for the figures", key="--width", allowed="--figures DIR"
        )
    plan = ssm.load_plan(options.plan)
    name = "report" if options.other is None else "comparison"
    out = output_file(options.output, ".html", plan.path.with_name(f"{name}.html"))
    files = {name: ssm.report(plan, out, options.other)}
    if options.figures is not None:
        from ssm_planner.reporting import WIDE, WIDTHS, write_figures_of_file

        files |= write_figures_of_file(plan, options.figures, WIDTHS.get(options.width, WIDE))
    show(
        options.json, {"files": files}, lambda: [f"{name}: {path}" for name, path in files.items()]
    )
    return OK


def film_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the command `film`."""
    plan_argument(parser)
    quantity_option(parser, "--speed", "share", "playback speed, such as 25%%", 1.0)
    output_arguments(
        parser,
        "folder of the film (default: film in the folder of PLAN); FILE.gif or FILE.mp4 writes "
        "that file alone",
    )


def run_film(options: Namespace) -> int:
    """Write a film of a motion, and return the exit status."""
    plan = ssm.load_plan(options.plan)
    out = options.output or plan.path.with_name("film")
    files = ssm.film(plan, out, options.speed)
    lines = [f"{name}: {path}" for name, path in files.items()]
    if out.suffix != ".gif" and not any(name.endswith(".mp4") for name in files):
        lines.append("mp4: not written, because the program ffmpeg is not on the PATH")
    show(options.json, {"files": files}, lambda: lines)
    return OK


def view_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the command `view`."""
    parser.add_argument(
        "problem",
        type=Path,
        nargs="?",
        help="problem file (YAML); without it the paper's mechanism, without planning",
    )
    parser.add_argument(
        "--port", type=int, default=0, help="port on 127.0.0.1 (default: any free one)"
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the address")


def run_view(options: Namespace) -> int:
    """Serve the local page until Ctrl-C, and return the exit status."""
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


def reproduce_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the command `reproduce`."""
    output_arguments(parser, "the document goes into DIR/paper", default=Path("results"))
    parser.add_argument(
        "--recordings",
        type=Path,
        metavar="DIR",
        default=Path("../shared/recordings"),
        help="recordings of the three rigs (default ../shared/recordings); missing ones leave out "
        "their rows",
    )
    parser.add_argument(
        "--problems",
        type=Path,
        metavar="DIR",
        default=Path("problems"),
        help="the project's problem files",
    )


def run_reproduce(options: Namespace) -> int:
    """Recompute the tables and figures of the paper, and return the exit status."""
    progress, folder = progress_reporter(), options.output / "paper"
    outcome = ssm.reproduce(folder, options.problems, options.recordings, progress)
    progress(Step("done"))
    left_out = outcome.left_out
    result = {"passed": outcome.passed, "left_out": left_out, "files": outcome.files}
    show(
        options.json,
        result,
        lambda: [*(f"left out: {line}" for line in left_out), f"Results: {folder}"],
    )
    return OK if outcome.passed else FAILED
