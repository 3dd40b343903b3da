"""The command line: an outer skin that parses, calls, prints and sets the exit status."""

from __future__ import annotations

import argparse
import importlib
import os
import re
import sys
from collections.abc import Sequence
from importlib import metadata

from ssm_planner.errors import SsmPlannerError

BAD_INPUT, INTERRUPTED, CLOSED_PIPE = 2, 130, 141

COMMANDS = {
    "plan": ("plan", "plan, cross-check, verify, size, report"),
    "check": ("check", "certificate for a plan.json, a CSV or a JointTrajectory of anyone's"),
    "export": ("export", "files for the controller: csv, epos4, ros2, urdf, c"),
    "compare": ("compare", "a recording of the executed motion against the plan"),
    "size": ("size", "what the motion requires; which motors and gears satisfy it"),
    "report": ("report", "a page with mechanism, plots and certificate; of two plans, a comparison"),
    "view": ("view", "a local page: workspace, inverse kinematics and planning by sliders"),
    "workspace": ("workspace", "closed-form tilt range, or the (alpha, beta) that reach a range"),
    "identify": ("identify", "friction with confidence, map figure, a drive file to use"),
    "predict": ("predict", "predicted against measured torque, NRMSD"),
    "ik": ("ik", "closed-form inverse kinematics, all branches"),
    "reproduce": ("reproduce", "the paper's tables and figures, ours beside the published values"),
}
"""Module in ssm_planner.cli and help of every command; the module is imported only when its command is used.

A module has add_arguments(parser) and run(options) -> exit status: 0 done and every check passed, 1 infeasible or a failed
check, 2 bad input.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    # Before NumPy loads: on vectors as short as these, threads of its linear algebra wait for each other more than they work.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = [_kept_apart(word) for word in (sys.argv[1:] if arguments is None else arguments)]
    options = _parser(words).parse_args(words)
    try:
        status = int(options.run(options))
        sys.stdout.flush()
        return status
    except SsmPlannerError as error:
        print(f"ssm-planner: {error}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CLOSED_PIPE
    except KeyboardInterrupt:
        print("\nssm-planner: interrupted; earlier results are untouched", file=sys.stderr)
        return INTERRUPTED


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ssm-planner",
        description="Plan, verify and export motions of serial spherical mechanisms with self-locking drives.",
        epilog="Exit status: 0 done and every check passed; 1 infeasible, or a check failed; 2 bad input.",
    )
    parser.add_argument("--version", action="version", version=f"ssm-planner {metadata.version('ssm-planner')}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, (module, text) in COMMANDS.items():
        command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        if name in words:
            implementation = importlib.import_module(f"ssm_planner.cli.{module}")
            implementation.add_arguments(command)
            command.set_defaults(run=implementation.run)
    return parser


def _kept_apart(word: str) -> str:
    """`-140deg` is a value, not an option: argparse takes a word with a space in it as a value."""
    return f" {word}" if re.match(r"-\.?\d", word) else word


if __name__ == "__main__":
    sys.exit(main())
