"""Element functions in C, where there is a compiler: the same numbers about ten times faster than interpreted.

Compiling takes from half a second to some five, so it is done in the background, for an element model that has taken long,
and kept in the user's cache by content, with the library's own hash in its name: one that was cut off is not loaded. The
compiler ends with the program, or after PATIENCE. Without one, or with SSM_PLANNER_COMPILE=0, everything is interpreted.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca

from ssm_planner.children import python_command
from ssm_planner.planning.ocp.element import ElementFunctions, ElementModel, element_functions

FLAGS = ("-O1", "-ffp-contract=off", "-shared", "-fPIC")
"""No optimisation that changes rounding: the result is the interpreter's to the last bit."""
LONG = 0.15
"""Time spent evaluating the functions of a model from which on they are compiled, s."""
PATIENCE = 120.0
"""Time after which a compiler is ended, s."""
KEPT, KEPT_FILES = 24, 200
"""Models in memory, and libraries on disk: those used last."""


@dataclass(frozen=True, eq=False)
class Source:
    """Element functions as C, and where libraries made of them are kept, each as <of the source>-<of the library>.so."""

    text: str
    folder: Path
    sha256: str

    @classmethod
    def of(cls, element: ElementFunctions, folder: Path) -> Source:
        generator = ca.CodeGenerator("element.c")
        for function in element.by_name().values():
            generator.add(function)
        text = generator.dump()
        # a home folder may be shared between machines of several kinds
        machine = platform.system(), platform.machine()
        content = hashlib.sha256("\n".join([text, ca.CasadiMeta.version(), *machine, *FLAGS]).encode()).hexdigest()
        return cls(text, folder, content[:32])

    def library(self) -> Path | None:
        """A whole library that the user alone could have written; None where there is none."""
        for path in self.folder.glob(f"{self.sha256}-*.so"):
            with suppress(OSError):
                if _safe(path) and path.stem.rpartition("-")[2] == hashlib.sha256(path.read_bytes()).hexdigest()[:32]:
                    return path
                path.unlink()
        return None

    def load(self, element: ElementFunctions, library: Path) -> ElementFunctions:
        """The same functions from the library. Raises OSError or RuntimeError where it cannot be used."""
        os.utime(library)  # of the libraries, the last used are kept
        names = element.by_name().items()
        return replace(element, **{name: ca.external(function.name(), str(library)) for name, function in names})

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
        (work / "element.c").write_text(self.text, encoding="utf-8")
        command = python_command(_MAKE, (str(PATIENCE), compiler, str(work), self.sha256, *FLAGS), watch=False)
        quiet = subprocess.DEVNULL
        return subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, cwd=work, start_new_session=True)


class FunctionStore:
    """The functions of the element models in use, compiled where that is done already."""

    def __init__(self) -> None:
        self._entries: dict[ElementModel, _Entry] = {}
        """Last used last."""
        self._running: subprocess.Popen[bytes] | None = None

    def functions(self, element: ElementModel) -> ElementFunctions:
        """The functions of an element model; a new value once they are compiled."""
        entry = self._entries.pop(element, None)
        if entry is None:
            entry = _Entry(element_functions(element))
            entry.load_from(filled_cache())
        self._entries[element] = entry
        while len(self._entries) > KEPT:
            del self._entries[next(iter(self._entries))]
        if not entry.compiled and entry.seconds > LONG:
            self._compile(entry)
        return entry.functions

    def note_time(self, element: ElementModel, seconds: float) -> None:
        """Note how long the functions of a model have been evaluated."""
        if element in self._entries:
            self._entries[element].seconds += seconds

    def compile_all(self) -> None:
        """Compile the functions of all models in use, one after the other, and load them; nothing without a compiler."""
        for entry in self._entries.values():
            for _ in range(2):
                self.wait()
                self._compile(entry)

    def wait(self) -> None:
        """Wait for the library that is being made."""
        if self._running is not None:
            self._running.wait()

    def _compile(self, entry: _Entry) -> None:
        """Load the library, or begin to make it where no other is being made; once, for a compiler may fail."""
        entry.load_from(cache())
        idle = self._running is None or self._running.poll() is not None
        if entry.source is not None and not entry.compiled and not entry.tried and idle:
            entry.tried = True
            with suppress(OSError):  # a full disk, a folder that became read-only: it stays interpreted
                self._running = entry.source.compile()


@dataclass
class _Entry:
    functions: ElementFunctions
    seconds: float = 0.0
    tried: bool = False
    compiled: bool = False
    source: Source | None = None

    def load_from(self, folder: Path | None) -> None:
        """Take the functions from the folder's library, where it is there."""
        if folder is None or self.compiled:
            return
        self.source = self.source or Source.of(self.functions, folder)
        library = self.source.library()
        if library is not None:
            with suppress(OSError, RuntimeError):  # taken away meanwhile: it stays interpreted
                self.functions, self.compiled = self.source.load(self.functions, library), True


_MAKE = """
import hashlib, shutil, signal, subprocess, sys
patience, compiler, work, source, *flags = sys.argv[1:]
os.nice(10)
quiet = subprocess.DEVNULL
try:
    made = os.path.join(work, "element.so")
    command = [compiler, *flags, "-o", made, os.path.join(work, "element.c")]
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


function_store = FunctionStore()
