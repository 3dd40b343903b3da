"""C compiled in the background, where there is a compiler, into libraries that are kept.

Compiling takes from a tenth of a second to some five, so it is for what has taken long, and a library is kept in the user's
cache by content, with its own hash in its name: one that was cut off is not loaded. The compiler ends with the program, or
after PATIENCE. Without one, or with SSM_PLANNER_COMPILE=0, there are no libraries, and everything is done without.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ssm_planner.children import python_command

FLAGS = ("-O1", "-ffp-contract=off", "-shared", "-fPIC")
"""No optimisation that changes rounding: the result is that of NumPy and of CasADi's interpreter to the last bit."""
LONG = 0.15
"""Time spent on what a library does from which on it is made, s."""
PATIENCE = 120.0
"""Time after which a compiler is ended, s."""
KEPT_FILES = 200
"""Libraries on disk: those used last."""


@dataclass(frozen=True, eq=False)
class Source:
    """C text, and where libraries made of it are kept, each as <of the source>-<of the library>.so."""

    text: str
    folder: Path
    sha256: str

    @classmethod
    def of(cls, text: str, folder: Path, *versions: str) -> Source:
        """versions: of what the text came from, where that matters."""
        # a home folder may be shared between machines of several kinds
        machine = platform.system(), platform.machine()
        content = hashlib.sha256("\n".join([text, *versions, *machine, *FLAGS]).encode()).hexdigest()
        return cls(text, folder, content[:32])

    def library(self) -> Path | None:
        """A whole library that the user alone could have written; None where there is none."""
        for path in self.folder.glob(f"{self.sha256}-*.so"):
            with suppress(OSError):
                if _safe(path) and path.stem.rpartition("-")[2] == hashlib.sha256(path.read_bytes()).hexdigest()[:32]:
                    return path
                path.unlink()
        return None

    def compile(self) -> subprocess.Popen[bytes] | None:
        """Begin to make the library, in a process of low priority; whole or not at all.

        Raises OSError where the folder cannot be written.
        """
        compiler = _compiler()
        if compiler is None:
            return None
        libraries = sorted(self.folder.glob("*.so"), key=lambda path: path.stat().st_mtime)
        for old in libraries[: max(0, len(libraries) - KEPT_FILES + 1)]:
            old.unlink(missing_ok=True)
        work = Path(tempfile.mkdtemp(dir=self.folder))
        (work / "source.c").write_text(self.text, encoding="utf-8")
        command = python_command(_MAKE, (str(PATIENCE), compiler, str(work), self.sha256, *FLAGS), watch=False)
        quiet = subprocess.DEVNULL
        return subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, cwd=work, start_new_session=True)


_MAKE = """
import hashlib, shutil, signal, subprocess, sys
patience, compiler, work, source, *flags = sys.argv[1:]
os.nice(10)
quiet = subprocess.DEVNULL
try:
    made = os.path.join(work, "library.so")
    command = [compiler, *flags, "-o", made, os.path.join(work, "source.c")]
    end = time.monotonic() + float(patience)
    with subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True) as process:
        while process.poll() is None and time.monotonic() < end and os.getppid() == parent:
            time.sleep(0.02)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    if process.returncode == 0:
        with open(made, "rb") as file:
            content = file.read()
            os.fsync(file.fileno())
        name = source + "-" + hashlib.sha256(content).hexdigest()[:32] + ".so"
        os.chmod(made, 0o600)
        os.replace(made, os.path.join(os.path.dirname(work), name))
finally:
    shutil.rmtree(work, ignore_errors=True)
"""


def _compiler() -> str | None:
    """cc; not that of macOS without its developer tools, which only opens a window that offers them."""
    tools = ["xcode-select", "-p"]
    if platform.system() == "Darwin" and subprocess.run(tools, capture_output=True, check=False).returncode != 0:
        return None
    found = shutil.which("cc")
    return found if found is None or os.path.isabs(found) else None  # none of the working directory


def cache() -> Path | None:
    """The folder of compiled functions, which only the user can write; None where nothing is to be compiled."""
    folder = _folder()
    if folder is None:
        return None
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if _safe(folder) else None


def filled_cache() -> Path | None:
    """The folder of compiled functions, where there is one with something in it: looking them up takes some time."""
    folder = _folder()
    return folder if folder is not None and _safe(folder) and any(folder.glob("*.so")) else None


def _folder() -> Path | None:
    if os.name != "posix" or os.environ.get("SSM_PLANNER_COMPILE") == "0":
        return None
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ssm_planner"
    except RuntimeError:  # a user without a home
        return None


def _safe(path: Path) -> bool:
    """Whether only the user can have written what lies there: it is executed."""
    try:
        state = path.stat()
    except OSError:
        return False
    return state.st_uid == os.getuid() and not state.st_mode & 0o022
