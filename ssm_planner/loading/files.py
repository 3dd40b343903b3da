"""Find files by path or shipped name, read them, and follow the references between them.

A problem file names a robot file, which names drive and motor files. `read_section` reads one file
as a `Section`, whose values know their line. `follow_reference` reads the file that a value names.
All functions raise ProblemError with the file and the fault.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from ssm_planner.errors import ProblemError, suggestion
from ssm_planner.loading.yaml_nodes import Node, Section, node_from_data, parse_yaml

ShippedFolder = Literal[
    "problems", "robots", "drives", "motors", "motorisation", "controllers", "studies"
]
"""Folders of files that are shipped with the package."""
_PACKAGE = Path(__file__).parents[1]
LARGEST_FILE = 10_000_000
"""Largest size of a file that is read, bytes. Files written by hand are much smaller."""


def shipped_folder() -> Path:
    """Return the folder of the shipped files.

    It is part of an installed package. In a checkout, it is next to the package.
    """
    within = _PACKAGE / "problems"
    return within if within.is_dir() else _PACKAGE.parent / "problems"


def shipped_files(folder: ShippedFolder) -> dict[str, Path]:
    """Return the paths of the shipped files in a folder, by name (such as "tilt_insert")."""
    directory = shipped_folder() if folder == "problems" else shipped_folder() / folder
    return {file.stem: file for file in sorted(directory.glob("*.yaml"))}


def find_file(name: str | Path, folder: ShippedFolder) -> Path:
    """Find a file by its path or, if no such file exists, by its shipped name.

    Parameters
    ----------
    name : str or Path
        Path, or shipped name such as "tilt_insert".
    folder : str
        Folder of the shipped files.

    Returns
    -------
    Path
        Path of the file. If the name cannot be the name of a file, it is returned unchanged, and
        reading it raises the error.

    Raises
    ------
    ProblemError
        If no file has this path or this shipped name. The message suggests a similar name.
    """
    path = Path(name)
    names = shipped_files(folder)
    try:
        if path.is_file() or (path.exists() and str(name) not in names):
            return path
    except (OSError, ValueError):
        return path  # reading it raises the appropriate error
    if str(name) in names:
        return names[str(name)]
    neighbours = [file.name for file in path.parent.glob("*.yaml")] if path.parent.is_dir() else []
    similar = suggestion(path.name, [*names, *neighbours])
    raise ProblemError(
        "a link that leads to no file" if path.is_symlink() else f"no such file{similar}",
        file=path,
        allowed=f"a file, or a shipped name: {', '.join(names)}",
    )


def read_section(path: str | Path) -> Section:
    """Read a YAML file that contains a mapping. Raise ProblemError for other files."""
    file = Path(path)
    return _whole_file(file, parse_yaml(file, read_text(file)))


def section_from_text(text: str) -> Section:
    """Parse a YAML text. File names in it are relative to the working directory.

    Raises ProblemError if its content is not a mapping.
    """
    return _whole_file(None, parse_yaml(None, text))


def section_from_data(data: Mapping[str, Any]) -> Section:
    """Convert a mapping from Python to a section without file and line numbers.

    Raises ProblemError if the data are nested too deeply.
    """
    return _whole_file(None, node_from_data(data))


def _whole_file(file: Path | None, root: Node) -> Section:
    """Return the section that represents a whole file.

    Parameters
    ----------
    file : Path or None
        The file, or None for a text or data from Python.
    root : Node
        Root of its tree.

    Returns
    -------
    Section
        Section with an empty path.

    Raises
    ------
    ProblemError
        If the content is not a mapping.
    """
    if isinstance(root.value, dict):
        return Section(file, root)
    subject = "the problem is" if file is None else "the file holds"
    content = (
        "a list" if isinstance(root.value, list) else f"only the text {str(root.value)[:40]!r}"
    )
    reason = f"{subject} {'nothing' if root.value is None else content}"
    raise ProblemError(reason, file=file, line=root.line, allowed="a mapping of key: value lines")


def follow_reference(section: Section, *path: str | int, file_kind: str | None = None) -> Section:
    """Return the mapping under a key, or the mapping in the file that the key names.

    A file name is relative to the file that contains it, or it is a shipped name.

    Parameters
    ----------
    section : Section
        Section that contains the key.
    *path : str or int
        Keys and list positions that lead to the entry.
    file_kind : str, optional
        Kind of the file: robot, drive, motor or problem. The default is the name of the key.

    Returns
    -------
    Section
        The mapping, as a part of its file.

    Raises
    ------
    ProblemError
        If the file does not exist or is not a mapping.
    """
    reference = section.sub(*path)
    if isinstance(reference.value, dict):
        return reference
    target = Path(
        os.path.normpath(
            (Path() if section.file is None else section.file.parent) / reference.value
        )
    )
    names = shipped_files(f"{file_kind or path[-1]}s")  # type: ignore[arg-type]
    try:
        shipped = names.get(reference.value)
        if shipped is not None and not target.exists():
            return read_section(shipped)
        problem = (
            "" if target.is_file() else "is not a file" if target.exists() else "does not exist"
        )
    except (OSError, ValueError) as error:
        problem = f"cannot be read: {error}"
    if problem:
        allowed = f"a file, named relative to this one, or a shipped name: {', '.join(names)}"
        similar = suggestion(reference.value, names)
        raise reference.error(f"the file {target} {problem}{similar}", allowed=allowed)
    return read_section(target)


def read_file_bytes(file: Path, largest: int = LARGEST_FILE) -> bytes:
    """Read a regular file of limited size.

    Parameters
    ----------
    file : Path
        File to read.
    largest : int
        Largest permitted size, bytes.

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    ProblemError
        If the file is missing, too large or unreadable.
    """
    try:
        if not file.is_file():
            fault = "this is a directory, not a file" if file.is_dir() else "not a regular file"
            raise ProblemError(fault if file.exists() else "no such file", file=file)
        size = file.stat().st_size
        if size > largest:
            reason = f"the file has {size} bytes, too large for a file of this kind"
            raise ProblemError(reason, file=file, allowed=f"at most {largest / 1e6:g} MB")
        return file.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ProblemError(f"cannot be read: {reason}", file=file) from None


def decode_text(file: Path, data: bytes) -> str:
    """Return the content of a file as text.

    Raises ProblemError, which names the file and the line, if the content is not UTF-8.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ProblemError("not a text file in UTF-8", file=file, line=line) from None


def read_text(file: Path) -> str:
    """Read a text file in UTF-8. Raise ProblemError if the file is empty or cannot be read."""
    text = decode_text(file, read_file_bytes(file))
    if not text.strip():
        raise ProblemError("the file is empty", file=file, line=1)
    return text
