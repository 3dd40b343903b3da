"""Run Python child processes that end with their parent and ignore the working directory."""

import os
import sys
from pathlib import Path

_WATCH_PARENT = """
def watch():
    while os.getppid() == parent:
        time.sleep(0.1)
    os._exit(1)
if os.name == "posix":
    threading.Thread(target=watch, daemon=True).start()
"""
"""Code that ends a child process when its parent has ended."""


def python_command(code: str) -> list[str]:
    """Return the command that runs Python code in a child process.

    The child imports modules from the same folders as this process. It ignores the working
    directory and the environment variables of Python. It checks every 0.1 s whether this process
    still exists, and otherwise ends (on POSIX systems).

    Parameters
    ----------
    code : str
        Python program. It can use the modules os, sys, threading and time without importing them.

    Returns
    -------
    list of str
        Command for `subprocess`.
    """
    preamble = (
        f"import os, sys, threading, time; sys.path[:] = {module_folders()!r}; parent = "
        f"{os.getpid()}\n"
    )
    return [sys.executable, "-I", "-c", preamble + _WATCH_PARENT + code]


def module_folders() -> list[str]:
    """Return the folders from which a child process may import modules.

    They are those of this process without the working directory, so that the child cannot import a
    module that lies in the working directory by accident. The working directory remains if it
    contains this package.

    Returns
    -------
    list of str
        Absolute paths.
    """
    home = Path(__file__).resolve().parents[1]
    current_folder = Path.cwd()
    folders = [os.path.abspath(entry) for entry in sys.path if entry]
    return [
        folder
        for folder in folders
        if Path(folder).resolve() != current_folder or current_folder == home
    ]
