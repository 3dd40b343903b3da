"""The command line: an outer skin that parses, calls, prints and sets the exit status."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

from ssm_planner.errors import SsmPlannerError

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0: done and checked, 1: infeasible or a failed check, 2: bad input."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except SsmPlannerError as error:
        print(f"ssm-planner: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("\nssm-planner: interrupted; earlier results are untouched", file=sys.stderr)
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ssm-planner",
        description="Plan, verify and export motions of serial spherical mechanisms with self-locking drives.",
    )
    parser.add_argument("--version", action="version", version=f"ssm-planner {metadata.version('ssm-planner')}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    plan = commands.add_parser("plan", help="plan, cross-check, verify, size, report")
    plan.add_argument("problem", type=Path, help="problem file (YAML)")
    plan.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="result folder (default: results/<problem name>)"
    )
    plan.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    plan.set_defaults(run=_plan)
    return parser


def _plan(options: argparse.Namespace) -> int:
    progress = _progress()
    progress(f"reading {options.problem}")
    from ssm_planner.problem.load import load_problem
    from ssm_planner.report.summary import summary_lines
    from ssm_planner.run import plan_to_folder

    problem = load_problem(options.problem)
    folder = options.output or Path("results") / problem.name
    result, files = plan_to_folder(problem, folder, progress)
    progress("done")
    if options.json:
        print(json.dumps({**result.summary(), "files": {name: str(path) for name, path in files.items()}}, indent=1))
    else:
        print("\n".join(summary_lines(result)))
        if files:
            print(f"\nResults: {folder}")
    return OK if result.passed else FAILED


def _progress() -> Callable[[str], None]:
    """Reports each step on stderr with the time since the start."""
    begin = time.perf_counter()

    def report(step: str) -> None:
        print(f"[{time.perf_counter() - begin:6.2f} s] {step}", file=sys.stderr, flush=True)

    return report


if __name__ == "__main__":
    sys.exit(main())
