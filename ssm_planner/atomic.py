"""Files that appear whole or not at all, on the disk too, whatever interrupts the program."""

from __future__ import annotations

import glob
import os
import secrets
import shutil
import signal
import stat
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from ssm_planner.errors import ExportError

HELD = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
LONGEST_STEM = 60
SWEPT_AFTER = 60.0
"""Age of a forgotten temporary folder from which on it is removed, s."""
_temporaries: set[Path] = set()
"""Temporary files and folders of this process that have not been removed yet."""
written: list[Path] = []
"""What this process has put in place, in order: what an interruption leaves is said from it."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its place when the block ends without an exception.

    A symbolic link is followed. Raises ExportError where the folder cannot be written or `path` is no regular file, such
    as a device; an existing file then stays as it was.
    """
    temporary = None
    try:
        target = destination(path)
        whole = not any(
            target.is_relative_to(stage) for stage in _temporaries
        )  # else put in place with its folder
        target.parent.mkdir(parents=True, exist_ok=True)
        # no file is created ahead: whoever writes it gives it the permissions that the umask leaves
        temporary = target.with_name(
            f".{target.stem[:LONGEST_STEM]}-{secrets.token_hex(6)}{target.suffix}"
        )
        _temporaries.add(temporary)
        yield temporary
        if not whole:
            temporary.replace(target)
            return
        sync(temporary)
        with held_signals():
            temporary.replace(target)
            sync(target.parent, content=False)
            written.append(path)
    except OSError as error:
        raise ExportError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
            _temporaries.discard(temporary)


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """An empty temporary folder in `folder`, or beside it where there is none; removed in the end. Raises ExportError."""
    temporary = None
    try:
        target = destination(folder, kind=stat.S_IFDIR)
        parent, stem = (
            target if target.is_dir() else target.parent,
            f".{target.name[:LONGEST_STEM]}-",
        )
        parent.mkdir(parents=True, exist_ok=True)
        _sweep(parent, stem)
        temporary = parent / (stem + secrets.token_hex(6))
        _temporaries.add(temporary)
        temporary.mkdir()
        with locked(temporary):
            yield temporary
    except OSError as error:
        raise ExportError(f"{folder}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
            _temporaries.discard(temporary)


def remove_temporaries() -> None:
    """Remove what is left of this process where an interruption came while it was being removed; call at the very end."""
    for path in list(_temporaries):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink(missing_ok=True)
        _temporaries.discard(path)


def _sweep(parent: Path, stem: str) -> None:
    """Remove temporary folders whose process was killed: nobody holds their lock."""
    for left in parent.glob(f"{glob.escape(stem)}{'[0-9a-f]' * 12}"):
        with suppress(OSError):
            if time.time() - left.stat().st_mtime > SWEPT_AFTER:
                with locked(left, wait=False):
                    shutil.rmtree(left, ignore_errors=True)


@contextmanager
def locked(folder: Path, wait: bool = True) -> Iterator[None]:
    """No other process holds the folder's lock meanwhile. Raises OSError where one does and this is not to wait."""
    if os.name != "posix":
        yield
        return
    import fcntl

    try:
        handle = os.open(folder, os.O_RDONLY)
    except (OSError, ValueError):  # no folder, or one that may be entered and not listed
        yield
        return
    try:
        if wait:
            with suppress(OSError):  # file systems without locks
                fcntl.flock(handle, fcntl.LOCK_EX)
        else:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def destination(path: Path, kind: int = stat.S_IFREG) -> Path:
    """Where a path leads, its symbolic links followed. Raises ExportError where something of another kind is there."""
    target = Path(os.path.realpath(path))
    try:
        found = stat.S_IFMT(target.stat().st_mode)
    except FileNotFoundError:
        return target
    if found != kind:
        names = {stat.S_IFREG: "a file", stat.S_IFDIR: "a folder"}
        wanted = "an export needs a folder" if kind == stat.S_IFDIR else "a file is needed"
        what = names.get(found, "a device or another special file")
        raise ExportError(f"{path}: cannot be written: is {what}; {wanted}")
    return target


def sync(path: Path, content: bool = True) -> None:
    """Have a file, or a folder and its content, on the disk and not only on its way there."""
    if path.is_dir():
        for entry in path.iterdir() if content else ():
            sync(entry)
        if os.name != "posix":  # elsewhere folders cannot be opened
            return
    handle = os.open(path, os.O_RDONLY)
    try:
        with suppress(OSError):  # some file systems cannot
            os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def held_signals() -> Iterator[None]:
    """Ctrl-C and requests to end wait until the block is done; for the few milliseconds in which files change places."""
    if threading.current_thread() is not threading.main_thread():  # signals go to the main thread
        yield
        return
    arrived: list[int] = []
    before = {number: signal.getsignal(number) for number in HELD}

    def note(number: int, _: FrameType | None) -> None:
        arrived.append(number)

    try:
        for number, handler in before.items():
            if callable(handler):  # what ends the process at once cannot be put off
                signal.signal(number, note)
        yield
    finally:
        for number, handler in before.items():
            if callable(handler):
                signal.signal(number, handler)
        for number in arrived[:1]:
            signal.raise_signal(number)


@contextmanager
def first_interruption() -> Iterator[Callable[[], bool]]:
    """Tells whether the first Ctrl-C within the block has come, which is raised there; the next one is as outside.

    Where Ctrl-C is none of this thread's, none ever comes.
    """
    handler, came = signal.getsignal(signal.SIGINT), threading.Event()
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield came.is_set
        return

    def note(number: int, _: FrameType | None) -> None:
        came.set()
        signal.signal(number, handler)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield came.is_set
    finally:
        signal.signal(signal.SIGINT, handler)
