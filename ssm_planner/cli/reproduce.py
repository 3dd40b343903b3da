"""`ssm-planner reproduce`: the paper's tables and figures, recomputed beside the published values."""

from __future__ import annotations

import argparse
from pathlib import Path

from ssm_planner.cli.output import FAILED, OK, print_json, progress_reporter


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", default=Path("results"), help="the document goes into DIR/paper"
    )
    parser.add_argument(
        "--recordings",
        type=Path,
        metavar="DIR",
        default=Path("../shared/recordings"),
        help="recordings of the three rigs (default ../shared/recordings); where absent, their rows are left out",
    )
    parser.add_argument(
        "--problems", type=Path, metavar="DIR", default=Path("problems"), help="the project's problem files"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(options: argparse.Namespace) -> int:
    progress = progress_reporter()
    progress("reading the problem files")
    from ssm_planner.paper.document import compute, write
    from ssm_planner.paper.published import read_inputs

    document = compute(read_inputs(options.problems, options.recordings), progress)
    progress("drawing and writing")
    folder = options.output / "paper"
    files = write(document, folder)
    progress("done")
    if options.json:
        paths = {name: str(path) for name, path in files.items()}
        print_json({"passed": document.passed, "left_out": list(document.left_out), "files": paths})
    else:
        print("\n".join([*(f"left out: {line}" for line in document.left_out), f"Results: {folder}"]))
    return OK if document.passed else FAILED
