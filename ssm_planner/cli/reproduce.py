"""`ssm-planner reproduce`: the paper's tables and figures, recomputed beside the published values."""

from __future__ import annotations

import argparse
from pathlib import Path

from ssm_planner.cli.output import FAILED, OK, progress_reporter, show


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
    paths, left_out = {name: str(path) for name, path in files.items()}, document.left_out
    result = {"passed": document.passed, "left_out": list(left_out), "files": paths}
    show(options.json, result, lambda: [*(f"left out: {line}" for line in left_out), f"Results: {folder}"])
    return OK if document.passed else FAILED
