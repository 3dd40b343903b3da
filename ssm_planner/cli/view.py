"""`ssm-planner view [PROBLEM]`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ssm_planner.cli.output import OK
from ssm_planner.errors import ProblemError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "problem", type=Path, nargs="?", help="problem file (YAML); without it the paper's mechanism, without planning"
    )
    parser.add_argument("--port", type=int, default=0, help="port on 127.0.0.1 (default: any free one)")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")


def run(options: argparse.Namespace) -> int:
    from ssm_planner.loading.load import load_problem
    from ssm_planner.view.page import Study
    from ssm_planner.view.server import ADDRESS, ViewServer

    if not 0 <= options.port <= 65535:
        raise ProblemError("not a port", key="--port", value=options.port, allowed="0 to 65535")
    problem = None if options.problem is None else load_problem(options.problem)
    try:
        server = ViewServer(Study(problem), options.port)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ProblemError(f"{ADDRESS} cannot be used: {reason}", key="--port", value=options.port) from error
    with server:
        print(f"{server.url}  (Ctrl-C ends it)", file=sys.stderr, flush=True)
        if not options.no_browser:
            import webbrowser

            webbrowser.open(server.url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print("", file=sys.stderr)
    return OK
