"""Write files atomically and durably, so that a file appears completely or not at all.

`replacing` writes one file, and `staging` provides a temporary folder for several. Both write next
to the destination, so that the final step is a renaming, which operating systems do at once.
`held_signals` and `first_interruption` control the effect of Ctrl-C.
"""

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
def replacing(path: Path, beginning: str = "") -> Iterator[Path]:
    """Yield a temporary path that replaces a file when the `with` block ends without an exception.

    The block writes the temporary file, which is in the folder of the destination. At the end of
    the block, its content is flushed to the disk, and it is renamed. If anything fails, an existing
    file remains unchanged. A symbolic link is followed, so that the file to which it leads is
    replaced.

    Parameters
    ----------
    path : Path
        Destination. Missing folders are created.
    beginning : str
        Text with which all files of this kind begin. An existing file with another beginning is
        kept, because this program did not write it.

    Yields
    ------
    Path
        Temporary path that the block must write.

    Raises
    ------
    ExportError
        If the folder cannot be written, if `path` is not a regular file, such as a device, or if
        the existing file is of another kind.
    """
    temporary = None
    try:
        target = resolve_destination(path)
        if beginning and target.exists() and not target.read_bytes().startswith(beginning.encode()):
            raise ExportError(f"{path}: exists, and is not from this program: name another file")
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
            with suppress(OSError):  # a name that no file can have
                temporary.unlink(missing_ok=True)
            _temporaries.discard(temporary)


def write_text(path: Path, text: str, mark: str = "\n") -> None:
    """Write a text file in UTF-8 that replaces an existing file of the same kind at once.

    Parameters
    ----------
    path : Path
        Destination.
    text : str
        Content of the file.
    mark : str
        End of the part of the text with which all files of this kind begin.

    Raises
    ------
    ExportError
        For the reasons of `replacing`.
    """
    with replacing(path, text.partition(mark)[0]) as temporary:
        temporary.write_text(text, encoding="utf-8")


def output_file(path: Path | None, suffix: str, default: Path) -> Path:
    """Return the path of the main file that a command or function writes.

    Parameters
    ----------
    path : Path or None
        The file itself if its name ends with `suffix`, otherwise its folder.
    suffix : str
        Suffix of the file, such as ".yaml".
    default : Path
        Result for None. Its name is also the name of the file in a folder.
    """
    if path is None:
        return default
    is_file = path.suffix.lower() == suffix and not os.path.isdir(path)
    return path if is_file else path / default.name


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """Yield an empty temporary folder, and remove it at the end of the `with` block.

    The block moves the files to their destination before it ends. A lock on the temporary folder
    shows other processes that it is in use.

    Parameters
    ----------
    folder : Path
        Destination of the files. The temporary folder is in `folder`, or beside it if `folder` does
        not exist.

    Yields
    ------
    Path
        Temporary folder.

    Raises
    ------
    ExportError
        If the temporary folder cannot be created, or if `folder` is not a folder.
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
    """Remove the temporary folders that killed processes left behind.

    A process that still runs holds a lock on its folder, so its folder remains. Folders younger
    than `ABANDONED_AGE` remain, too, because their process may not have locked them yet.

    Parameters
    ----------
    parent : Path
        Folder that contains the temporary folders.
    stem : str
        Beginning of their names, which 12 hexadecimal digits follow.
    """
    for stale_path in parent.glob(f"{glob.escape(stem)}{'[0-9a-f]' * 12}"):
        with suppress(OSError):
            if time.time() - stale_path.stat().st_mtime > ABANDONED_AGE:
                with locked(stale_path, wait=False):
                    shutil.rmtree(stale_path, ignore_errors=True)


@contextmanager
def locked(folder: Path, wait: bool = True) -> Iterator[None]:
    """Hold an exclusive lock on a folder during a `with` block.

    The lock has no effect on systems or file systems without locks, or if the folder cannot be
    opened.

    Parameters
    ----------
    folder : Path
        Folder that no other process may lock meanwhile.
    wait : bool
        True to wait until another process releases the lock.

    Raises
    ------
    OSError
        If `wait` is false and another process has the lock.
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

    Parameters
    ----------
    path : Path
        File or folder, which need not exist.
    file_type_wanted : int
        stat.S_IFREG for a file, or stat.S_IFDIR for a folder.

    Returns
    -------
    Path
        Absolute path without symbolic links.

    Raises
    ------
    ExportError
        If the path exists and is of another type.
    """
    target = Path(os.path.realpath(path))
    try:
        file_type = stat.S_IFMT(target.stat().st_mode)
    except FileNotFoundError:
        return target
    if file_type != file_type_wanted:
        descriptions = {stat.S_IFREG: "a file", stat.S_IFDIR: "a folder"}
        description = descriptions.get(file_type, "a device or another special file")
        wanted = descriptions[file_type_wanted]
        raise ExportError(f"{path}: cannot be written: is {description}; {wanted} is needed")
    return target


def flush_to_disk(path: Path, content: bool = True) -> None:
    """Wait until the operating system has written a file or a folder to the disk.

    After a power failure, the file then still has its content, and the folder its entries.

    Parameters
    ----------
    path : Path
        File or folder.
    content : bool
        True to flush the files in a folder and in its subfolders, too.
    """
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

    An interruption can therefore not occur between two steps that belong together. The block must
    be short, such as the replacement of files, which takes a few milliseconds. If several signals
    arrive, only the first one is raised at the end. In other threads than the main thread, which do
    not receive signals, the function has no effect.
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
    """Yield a function that tells whether the user has pressed Ctrl-C in a `with` block.

    The first Ctrl-C raises KeyboardInterrupt in the block, so that a search can end with its best
    result. The next Ctrl-C has the same effect as outside the block. Only the main thread receives
    signals, so in another thread the function always returns False.

    Yields
    ------
    callable
        Function without arguments that returns True after the first Ctrl-C.
    """
    handler = signal.getsignal(signal.SIGINT)
    interruption = threading.Event()
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield interruption.is_set
        return

    def interrupt(number: int, _: FrameType | None) -> None:
        """Restore the previous handler of Ctrl-C, and raise KeyboardInterrupt."""
        interruption.set()
        signal.signal(number, handler)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield interruption.is_set
    finally:
        signal.signal(signal.SIGINT, handler)
