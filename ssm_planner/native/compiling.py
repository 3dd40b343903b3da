"""Compiles the C of this folder into libraries: once when the package is built, where there is a compiler.

Run by the build (.hatch_build.py), and by hand: python -m ssm_planner.native.compiling. It needs the standard library
alone, for then nothing else is installed. A library carries the key of what it was made from (`library.load`).
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

FOLDER = Path(__file__).parent
FLAGS = (
    *("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
    *("-fPIC", "-shared", "-fvisibility=hidden"),
)
"""No optimisation that changes rounding: every variant gives the same bits."""
VARIANTS = {"portable": (), "avx2": ("-mavx2",)}
"""Flags by name; avx2 where the processor is of that kind."""


def key() -> str:
    """Of the sources, as they are."""
    digest = hashlib.sha256("\n".join([*FLAGS, str(VARIANTS)]).encode())
    for path in sorted([*FOLDER.glob("*.c"), *FOLDER.glob("*.h")]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:32]


def path_of(variant: str) -> Path:
    """Where the library of a variant lies."""
    return FOLDER / "libraries" / f"{variant}.so"


def build() -> list[Path]:
    """Make the libraries that are not of these sources already; which there are then: none without a compiler that can."""
    compiler = _compiler()
    if compiler is None:
        return []
    x86 = platform.machine().lower() in ("x86_64", "amd64")
    chosen = {name: flags for name, flags in VARIANTS.items() if x86 or not flags}
    with ThreadPoolExecutor() as threads:  # each waits for its compiler
        made = threads.map(
            lambda name: _is_made(name) or _make(compiler, name, chosen[name]), chosen
        )
        return [path_of(name) for name, done in zip(chosen, made, strict=True) if done]


def _is_made(variant: str) -> bool:
    """Of the sources as they are, for this system."""
    path = path_of(variant)
    try:
        return key().encode() in path.read_bytes() and ctypes.CDLL(str(path)) is not None
    except OSError:
        return False


def _make(compiler: str, variant: str, flags: tuple[str, ...]) -> bool:
    """Whole or not at all."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "library"
        sources = [str(path) for path in sorted(FOLDER.glob("*.c"))]
        command = [
            compiler,
            *FLAGS,
            *flags,
            f'-DSSM_KEY="{key()}"',
            "-o",
            str(made),
            *sources,
            "-lm",
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            print(
                f"ssm_planner is built without its compiled part ({variant}): {done.stderr.strip()}",
                file=sys.stderr,
            )
            return False
        beside = path_of(variant).with_suffix(f".{os.getpid()}")
        beside.parent.mkdir(exist_ok=True)
        shutil.copyfile(made, beside)
        os.replace(beside, path_of(variant))
    return True


def _compiler() -> str | None:
    """CC or cc; not that of macOS without its developer tools, which only opens a window that offers them."""
    if os.name != "posix":
        return None
    tools = ["xcode-select", "-p"]
    if (
        platform.system() == "Darwin"
        and subprocess.run(tools, capture_output=True, check=False).returncode != 0
    ):
        return None
    return shutil.which(os.environ.get("CC") or "cc")


if __name__ == "__main__":
    made = build()
    print(
        "\n".join(map(str, made)) or "nothing was compiled: no C compiler was found, or it failed"
    )
