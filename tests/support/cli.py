"""How tests run the command line: in this process, or as a program of its own."""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from ssm_planner.cli import COMMANDS
from ssm_planner.cli.shared import add_arguments
from tests.support.paths import ROOT


def run(command: str, *words: object) -> int:
    """Run a command without the outer skin of the command line: errors are raised.

    Returns the exit status.
    """
    module = importlib.import_module(f"ssm_planner.cli.{COMMANDS[command][0]}")
    parser = argparse.ArgumentParser()
    add_arguments(parser, command)
    if command == "export":
        module.add_format_arguments(parser)
    status = getattr(module, f"run_{command}")(parser.parse_args([str(word) for word in words]))
    return int(status)


def environment(**changes: str) -> dict[str, str]:
    """The environment of a child that imports this checkout, whatever its working directory."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100", **changes}


def python(*words: object, cwd: Path = ROOT, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a Python that imports this checkout, and return what it printed and its status."""
    return subprocess.run(
        [sys.executable, *(str(word) for word in words)],
        cwd=cwd,
        env=options.pop("env", environment()),
        capture_output=True,
        text=True,
        check=False,
        **options,
    )
