"""Compile the C sources in this folder into libraries if there is a compiler.

The build of the package runs this module (.hatch_build.py). Run it manually with
`python -m ssm_planner.native.compiling`. It needs only the standard library, because the build has
no other packages. Each library contains the key of its sources, which `library.load` compares.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

FOLDER = Path(__file__).parent
FLAGS = (
    *("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
    *("-fPIC", "-shared", "-fvisibility=hidden"),
)
"""Compiler flags without optimisations that change rounding, so all variants give the same bits."""
VARIANTS = {"portable": (), "avx2": ("-mavx2",)}
"""Additional flags by variant. The variant avx2 runs only on processors with AVX2."""


def key() -> str:
    """Return a key that identifies the current sources and flags."""
    digest = hashlib.sha256("\n".join([*FLAGS, str(VARIANTS)]).encode())
    for path in sorted([*FOLDER.glob("*.c"), *FOLDER.glob("*.h")]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:32]


def path_of(variant: str) -> Path:
    """Return the path of the library of a variant."""
    return FOLDER / "libraries" / f"{variant}.so"


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
    variants = {name: flags for name, flags in VARIANTS.items() if x86 or not flags}
    with ThreadPoolExecutor() as threads:  # Each thread waits for its compiler.
        results = threads.map(
            lambda name: _is_made(name) or _make(compiler, name, variants[name]), variants
        )
        return [path_of(name) for name, success in zip(variants, results, strict=True) if success]


def _is_made(variant: str) -> bool:
    """Return True if the library matches the current sources and loads on this system."""
    path = path_of(variant)
    try:
        return key().encode() in path.read_bytes() and ctypes.CDLL(str(path)) is not None
    except OSError:
        return False


def _make(compiler: list[str], variant: str, flags: tuple[str, ...]) -> bool:
    """Compile a variant and return True on success.

    The library is written atomically.
    """
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "library"
        sources = [str(path) for path in sorted(FOLDER.glob("*.c"))]
        command = [
            *compiler,
            *FLAGS,
            *flags,
            f'-DSSM_KEY="{key()}"',
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
        temporary = path_of(variant).with_suffix(f".{os.getpid()}")
        temporary.parent.mkdir(exist_ok=True)
        shutil.copyfile(output, temporary)
        os.replace(temporary, path_of(variant))
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
