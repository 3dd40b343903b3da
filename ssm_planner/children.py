"""Second Python processes: they run nothing that lies in the working directory, and end when this process does."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

_WATCH = """
def watch():
    while os.getppid() == parent:
        time.sleep(0.1)
    os._exit(1)
if os.name == "posix":
    threading.Thread(target=watch, daemon=True).start()
"""


def python_command(code: str, words: Sequence[str] = (), watch: bool = True) -> list[str]:
    """The command that runs `code`, with `words` as its arguments, in this interpreter.

    watch: it ends when its parent does; else the code looks whether `os.getppid() == parent` itself. Isolated: modules
    come from where this process has them, never from the working directory or what the environment says.
    """
    begin = f"import os, sys, threading, time; sys.path[:] = {module_folders()!r}; parent = {os.getpid()}\n"
    return [sys.executable, "-I", "-c", begin + (_WATCH if watch else "") + code, *words]


def module_folders() -> list[str]:
    """Where this process finds modules, but not the working directory unless this package itself lies in it."""
    home = Path(__file__).resolve().parents[1]
    here = Path.cwd()
    folders = [os.path.abspath(entry) for entry in sys.path if entry]
    return [folder for folder in folders if Path(folder).resolve() != here or here == home]
