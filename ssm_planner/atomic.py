"""Write files atomically and durably, so that a file appears completely or not at all."""

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

DELAYED_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals that are delayed while files are replaced."""
LONGEST_STEM = 60
"""Largest number of characters of a name that the name of its temporary folder repeats."""
ABANDONED_AGE = 60.0
"""Age in s at which an abandoned temporary folder is removed."""
_temporaries: set[Path] = set()
"""Temporary files and folders of this process that still exist."""
written_files: list[Path] = []
"""Files that this process has completed, in order.

The message about an interruption lists them.
"""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` when the block ends without an exception.

    A symbolic link is followed. Raises ExportError if the folder cannot be written or if `path` is
    not a regular file, such as a device. An existing file is then unchanged.
    """
    temporary = None
    try:
        target = resolve_destination(path)
        # Files in a temporary folder become visible with that folder.
        is_in_temporary = any(target.is_relative_to(folder) for folder in _temporaries)
        target.parent.mkdir(parents=True, exist_ok=True)
        # the block creates the file, so that its permissions follow the umask
        temporary = target.with_name(
            f".{target.stem[:LONGEST_STEM]}-{secrets.token_hex(6)}{target.suffix}"
        )
        _temporaries.add(temporary)
        yield temporary
        if is_in_temporary:
            temporary.replace(target)
            return
        flush_to_disk(temporary)
        with held_signals():
            temporary.replace(target)
            flush_to_disk(target.parent, content=False)
            written_files.append(path)
    except OSError as error:
        raise ExportError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
            _temporaries.discard(temporary)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 that replaces `path` at once. Raises what `replacing` raises."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """Yield an empty temporary folder, and remove it at the end of the block.

    The temporary folder is in `folder`, or beside it if `folder` does not exist. Raises ExportError
    if it cannot be created.
    """
    temporary = None
    try:
        target = resolve_destination(folder, file_type_wanted=stat.S_IFDIR)
        parent = target if target.is_dir() else target.parent
        stem = f".{target.name[:LONGEST_STEM]}-"
        parent.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(parent, stem)
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
    """Remove the temporary files and folders of this process after an interruption.

    This must be the last step of the process, because other threads may still use them.
    """
    for path in list(_temporaries):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink(missing_ok=True)
        _temporaries.discard(path)


def _remove_abandoned(parent: Path, stem: str) -> None:
    """Remove temporary folders that killed processes left behind.

    `stem` is the beginning of their names. A process that still runs holds a lock on its folder.
    """
    for stale_path in parent.glob(f"{glob.escape(stem)}{'[0-9a-f]' * 12}"):
        with suppress(OSError):
            if time.time() - stale_path.stat().st_mtime > ABANDONED_AGE:
                with locked(stale_path, wait=False):
                    shutil.rmtree(stale_path, ignore_errors=True)


@contextmanager
def locked(folder: Path, wait: bool = True) -> Iterator[None]:
    """Hold an exclusive lock on a folder during a `with` block.

    The lock has no effect on systems or file systems without locks. Raises OSError if `wait` is
    false and another process has the lock.
    """
    if os.name != "posix":
        yield
        return
    import fcntl

    try:
        handle = os.open(folder, os.O_RDONLY)
    except (OSError, ValueError):  # no folder, or no permission to list it
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


def resolve_destination(path: Path, file_type_wanted: int = stat.S_IFREG) -> Path:
    """Follow symbolic links, and return the path to which they lead.

    `file_type_wanted` is stat.S_IFREG for a file or stat.S_IFDIR for a folder. Raises ExportError
    if the path exists and is of another type.
    """
    target = Path(os.path.realpath(path))
    try:
        file_type = stat.S_IFMT(target.stat().st_mode)
    except FileNotFoundError:
        return target
    if file_type != file_type_wanted:
        descriptions = {stat.S_IFREG: "a file", stat.S_IFDIR: "a folder"}
        description = descriptions.get(file_type, "a device or another special file")
        requirement = "a file is needed"
        if file_type_wanted == stat.S_IFDIR:
            requirement = "an export needs a folder"
        raise ExportError(f"{path}: cannot be written: is {description}; {requirement}")
    return target


def flush_to_disk(path: Path, content: bool = True) -> None:
    """Flush a file to the disk, or a folder with (`content`) the files in it."""
    if path.is_dir():
        for entry in path.iterdir() if content else ():
            flush_to_disk(entry)
        if os.name != "posix":  # other systems cannot open folders
            return
    handle = os.open(path, os.O_RDONLY)
    try:
        with suppress(OSError):  # some file systems do not support it
            os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def held_signals() -> Iterator[None]:
    """Delay Ctrl-C and termination signals until the end of a `with` block.

    The block must be short, such as the replacement of files, which takes a few milliseconds.
    """
    # Only the main thread receives signals.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received_signals: list[int] = []
    handlers = {}
    for number in DELAYED_SIGNALS:
        handler = signal.getsignal(number)
        if callable(handler):  # signals that end the process at once cannot be delayed
            handlers[number] = handler

    def delay(number: int, _: FrameType | None) -> None:
        """Store a signal until the end of the block."""
        received_signals.append(number)

    try:
        for number in handlers:
            signal.signal(number, delay)
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if received_signals:
            signal.raise_signal(received_signals[0])


@contextmanager
def first_interruption() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns True after the first Ctrl-C in a `with` block.

    The first Ctrl-C raises KeyboardInterrupt in the block. The next one is handled as outside the
    block. Only the main thread receives signals; in another thread the function always returns
    False.
    """
    handler = signal.getsignal(signal.SIGINT)
    interruption = threading.Event()
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield interruption.is_set
        return

    def interrupt(number: int, _: FrameType | None) -> None:
        """Restore the handler, and raise KeyboardInterrupt."""
        interruption.set()
        signal.signal(number, handler)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield interruption.is_set
    finally:
        signal.signal(signal.SIGINT, handler)
