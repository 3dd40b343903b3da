"""Compile the C sources of ssm_planner/native into libraries if there is a compiler.

The build of the package runs this file (.hatch_build.py). Run it by `python .native_build.py`. It needs only the standard
library, because the build has no other packages. Sources, flags and places are those of ssm_planner/native/library.py.
"""

from __future__ import annotations

import ctypes
import os
import platform
import runpy
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

SOURCES: Any = SimpleNamespace(
    **runpy.run_path(str(Path(__file__).parent / "ssm_planner/native/library.py"))
)
"""Contents of library.py: FOLDER, FLAGS, VARIANTS, key and path_of."""


def build() -> list[Path]:
    """Compile the libraries that do not match the current sources; return the paths of all that
    match.

    The result is empty without a working C compiler. `sysconfig.get_platform()` names the target,
    so a cross compiler in `CC` and the variable _PYTHON_HOST_PLATFORM compile for another system.
    """
    compiler = _compiler()
    if not compiler:
        return []
    x86 = sysconfig.get_platform().endswith(("x86_64", "amd64"))
    variants = {name: flags for name, flags in SOURCES.VARIANTS.items() if x86 or not flags}
    with ThreadPoolExecutor() as threads:  # Each thread waits for its compiler.
        results = threads.map(
            lambda name: _is_made(name) or _make(compiler, name, variants[name]), variants
        )
        return [
            SOURCES.path_of(name)
            for name, success in zip(variants, results, strict=True)
            if success
        ]


def _is_made(variant: str) -> bool:
    """Return True if the library matches the current sources and loads on this system."""
    path = SOURCES.path_of(variant)
    try:
        return SOURCES.key().encode() in path.read_bytes() and ctypes.CDLL(str(path)) is not None
    except OSError:
        return False


def _make(compiler: list[str], variant: str, flags: tuple[str, ...]) -> bool:
    """Compile a variant and return True on success.

    The library is written atomically.
    """
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "library"
        sources = [str(path) for path in sorted(SOURCES.FOLDER.glob("*.c"))]
        command = [
            *compiler,
            *SOURCES.FLAGS,
            *flags,
            f'-DSSM_KEY="{SOURCES.key()}"',
            "-o",
            str(output),
            *sources,
            "-lm",
        ]
        process = subprocess.run(command, capture_output=True, text=True, check=False)
        if process.returncode != 0:
            print(
                f"ssm_planner is built without its compiled library ({variant}): "
                f"{process.stderr.strip()}",
                file=sys.stderr,
            )
            return False
        temporary = SOURCES.path_of(variant).with_suffix(f".{os.getpid()}")
        temporary.parent.mkdir(exist_ok=True)
        shutil.copyfile(output, temporary)
        os.replace(temporary, SOURCES.path_of(variant))
    return True


def _compiler() -> list[str]:
    """Return the command of the compiler, or an empty list if there is none.

    It is the variable `CC`, which may contain options, and cc otherwise. Windows has no cc. macOS
    without its developer tools has one that only opens an installation window. It is not used.
    """
    tools = ["xcode-select", "-p"]
    if (
        platform.system() == "Darwin"
        and subprocess.run(tools, capture_output=True, check=False).returncode != 0
    ):
        return []
    program, *options = shlex.split(os.environ.get("CC", "")) or ["cc"]
    path = shutil.which(program)
    return [path, *options] if path else []


if __name__ == "__main__":
    paths = build()
    print(
        "\n".join(map(str, paths)) or "nothing was compiled: there is no C compiler, or it failed"
    )
