"""Run `ssm-planner export PLAN --to FORMAT`, which writes files for controllers and simulators."""

from __future__ import annotations

import argparse
from typing import Any

from ssm_planner.cli.shared import (
    OK,
    output_arguments,
    plan_argument,
    progress_reporter,
    rate_argument,
    share,
    show,
)
from ssm_planner.errors import ExportError

FORMATS = ("csv", "epos4", "pvt", "ros2", "urdf", "c")


def export_arguments(parser: argparse.ArgumentParser) -> None:
    plan_argument(parser)
    parser.add_argument("--to", required=True, choices=FORMATS, help="form to write")
    output_arguments(parser, "folder (default: beside the plan)")
    parser.add_argument(
        "--force",
        action="store_true",
        help="export an unverified plan as well; its files are marked",
    )
    parser.add_argument(
        "--rate",
        type=rate_argument,
        metavar="HZ",
        help="csv: equidistant rows (default: as the limits require); epos4: setpoints per second "
        "(default 1000); ros2: states in the bag (default 100)",
    )
    parser.add_argument(
        "--columns", metavar="LIST", help="csv: groups of columns such as q,qd,torque, or counts"
    )
    parser.add_argument(
        "--mode", choices=("csp", "csv", "cst"), help="epos4: cyclic mode (default csp)"
    )
    parser.add_argument(
        "--counts-per-turn",
        nargs="+",
        metavar="[JOINT=]N",
        help="epos4, pvt, counts: increments per motor turn (4 × encoder counts) if the motor file "
        "has no encoder",
    )
    parser.add_argument(
        "--speed",
        metavar="PERCENT",
        help="speed of the exported motion, such as 10%%",
    )
    parser.add_argument(
        "--stops", type=int, metavar="N", help="csv, epos4: add controlled stops from N instants"
    )
    parser.add_argument(
        "--effort", action="store_true", default=None, help="ros2: add joint efforts"
    )
    parser.add_argument(
        "--no-bag", dest="bag", action="store_false", default=None, help="ros2: no rosbag2"
    )


def run_export(options: argparse.Namespace) -> int:
    progress = progress_reporter()
    progress(f"reading {options.plan}")
    from ssm_planner.formats.export import export

    settings: dict[str, Any] = {
        "rate": options.rate,
        "columns": None
        if options.columns is None
        else [word.strip() for word in options.columns.split(",")],
        "mode": options.mode,
        "counts_per_turn": None
        if options.counts_per_turn is None
        else _counts(options.counts_per_turn),
        "effort": options.effort,
        "bag": options.bag,
        "speed": None if options.speed is None else share(options.speed),
        "stops": options.stops,
    }
    settings = {name: value for name, value in settings.items() if value is not None}
    files, manifest = export(
        options.plan, options.to, options.output, force=options.force, **settings
    )
    progress("done")
    paths = {name: str(path) for name, path in files.items()}
    lines = [f"note: {note}" for note in manifest.get("notes", [])]
    if not manifest["verified"]:
        lines.append("UNVERIFIED: the plan has no passed certificate; every file is marked so")
    show(
        options.json,
        {**manifest, "files": paths},
        lambda: [*lines, *(f"file: {path}" for path in paths.values())],
    )
    return OK


def _counts(words: list[str]) -> int | dict[str, int]:
    """Parse [JOINT=]N words, and return the increments of all joints or a mapping by joint.

    Raises ExportError if a word is invalid.
    """
    counts: dict[str, int] = {}
    for word in words:
        joint, _, number = word.rpartition("=")
        if not number.isdigit():
            raise ExportError(f"--counts-per-turn {word}: expected [JOINT=]N with a whole number N")
        counts[joint] = int(number)
    if "" in counts and len(counts) > 1:
        raise ExportError("--counts-per-turn: give one number for all joints, or JOINT=N for each")
    return counts.get("", counts)
