"""Run the command line from tests, in this process or in a process of its own."""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from ssm_planner.cli import COMMANDS
from ssm_planner.cli.shared import add_arguments, check_needs
from tests.support.paths import ROOT


def run(command: str, *words: object) -> int:
    """Run a command without the error handling of the program, and return the exit status.

    Errors are raised to the caller.
    """
    module = importlib.import_module(f"ssm_planner.cli.{COMMANDS[command][0]}")
    parser = argparse.ArgumentParser()
    add_arguments(parser, command)
    if command == "export":
        module.add_format_arguments(parser)
    options = parser.parse_args([str(word) for word in words])
    check_needs(options)
    return int(getattr(module, f"run_{command}")(options))


def environment(**changes: str) -> dict[str, str]:
    """Return the environment of a child that imports this checkout from any working directory."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100", **changes}


def python(*words: object, cwd: Path = ROOT, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run Python with this checkout importable, and return its output and exit status."""
    return subprocess.run(
        [sys.executable, *(str(word) for word in words)],
        cwd=cwd,
        env=options.pop("env", environment()),
        capture_output=True,
        text=True,
        check=False,
        **options,
    )
